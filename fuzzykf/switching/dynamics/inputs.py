"""Dynamics with inputs and features of the window, and the systems that they become.

The regressions of `RegressionForm` get further regressors, which are known when they are used:

    Y' = Ayy y + Ny + By (common, own(y, u')) + N(0, Qyy),
    X' = Axx X + H y + G Y' + c + Bx (common, own(y', u')) + N(0, C),

see `fuzzykf.switching.dynamics.features.WindowFeatures`.  So the tables of a step stay what they are, with a
longer window w = (y, common, own(y, u'), own(y', u')) that is known but for what is missing of y.  Inputs may
act on the switch: with s_j the shares of the regimes in node j,

    P_ij(n) prop. to P_ij exp(s_j' tilt (u_n - centre)).

In a gap features take for a missing observation what the filter expected of it.  That is exact only where
they do not reach it; the latest observation itself stays unknown, as without features.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fuzzykf.errors import NumericalRangeError, ParameterError
from fuzzykf.gaussian import as_array, brief
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.exactness import Exactness
from fuzzykf.switching.dynamics.features import WindowFeatures, past_of
from fuzzykf.switching.dynamics.forms import RegressionForm, bilinear
from fuzzykf.switching.dynamics.pairs import PairCoefficients, PairTables
from fuzzykf.switching.dynamics.placed import StationarySystem
from fuzzykf.switching.dynamics.tilt import tilted_transition

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.dynamics.pairs import Describe, InitialLaw
    from fuzzykf.switching.dynamics.placed import KnownPath
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["DrivenSystem", "DrivenTables", "InputForm", "InputSystem"]


class InputForm(RegressionForm):
    """Regressions of pairs of regimes on the window, on inputs and on features.

    Parameters
    ----------
    By, Bx : array_like, shapes (K, K, q, c + o) and (K, K, m, c + o)
        Coefficients of (common, own) in the equations of Y' and X', bilinear in the shares.
    features : WindowFeatures or mapping
        The map, or what its ``to_dict`` returned.
    inputs : iterable of str
        Names of the k inputs.
    tilt : array_like, shape (K, k), optional
        How inputs act on the switch; not at all by default.
    centre : array_like, shape (k,), optional
        Inputs at which the law of the switch is that of the model; zero by default.
    **regressions
        As `RegressionForm` takes them.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes do not agree, or a covariance is indefinite.
    """

    kind = "inputs"

    def __init__(
        self,
        *,
        By: ArrayLike,
        Bx: ArrayLike,
        features: WindowFeatures | Mapping[str, Any],
        inputs: Iterable[str] = (),
        tilt: ArrayLike | None = None,
        centre: ArrayLike | None = None,
        **regressions: Any,
    ) -> None:
        super().__init__(**regressions)
        self.features = _as_map(features)
        self.inputs = _as_names(inputs)
        K, m, q, k = self.n_classes, self.dim_x, self.dim_z, len(self.inputs)
        if self.features.n_hinges and (self.features.knots is None or len(self.features.knots) != q):
            raise ParameterError(f"features: got {self.features!r}, expected knots of {q} components")
        self.sizes = self.features.sizes(q, k)
        width = sum(self.sizes)
        self.By, self.Bx = as_array("By", By, (K, K, q, width)), as_array("Bx", Bx, (K, K, m, width))
        self.tilt = np.zeros((K, k)) if tilt is None else as_array("tilt", tilt, (K, k))
        self.centre = np.zeros(k) if centre is None else as_array("centre", centre, (k,))

    @property
    def dim_u(self) -> int | None:
        """Number k of inputs; None where there are none."""
        return len(self.inputs) or None

    def facts(self) -> list[tuple[str, str]]:
        """Return what a table of the model says of inputs and features."""
        inputs = [("inputs", ", ".join(self.inputs))] if self.inputs else []
        return inputs if self.features.is_trivial else [*inputs, ("features", repr(self.features))]

    def exactness(self, chain: SwitchChain) -> Exactness:
        """Say whether filtering is exact on a chain."""
        return Exactness(
            True,
            "exact: given inputs and the switch, Y alone is Markov; in gaps features take what was expected",
        )

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step on the longer window, given the shares of r_n and r_{n+1}."""
        found = super().pairs(u1, u2, describe, where)
        c, o = self.sizes
        By, Bx = bilinear(self.By, u1, u2), bilinear(self.Bx, u1, u2)
        none_y, none_x = np.zeros((*By.shape[:-1], o)), np.zeros((*Bx.shape[:-1], o))
        H = np.concatenate([found.H, Bx[..., :c], none_x, Bx[..., c:]], axis=-1)
        Ayy = np.concatenate([found.Ayy, By, none_y], axis=-1)
        return found._replace(H=H, Ayy=Ayy)

    def placed(self, chain: SwitchChain) -> InputSystem:
        """Return the form on the nodes of a chain."""
        return InputSystem(chain, self)

    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> KnownPath:  # type: ignore[override]
        """Refuse: along a known path there is no place for inputs."""
        raise ParameterError(
            "model: got one with inputs or features of the window, which no KnownSwitchFilter takes; "
            "expected a model without"
        )

    along_many = along  # type: ignore[assignment]

    def simulate(self, shares: FloatArray, r: FloatArray, rng: np.random.Generator) -> Simulation:
        """Draw states and observations without inputs; see `fuzzykf.switching.dynamics.driven_simulation`."""
        from fuzzykf.switching.dynamics.driven_simulation import simulate_driven

        return simulate_driven(self, r, shares, np.zeros((len(r), 0)), rng)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists."""
        return super().to_dict() | {
            "By": self.By.tolist(),
            "Bx": self.Bx.tolist(),
            "features": self.features.to_dict(),
            "inputs": list(self.inputs),
            "tilt": self.tilt.tolist(),
            "centre": self.centre.tolist(),
        }


def _as_map(features: Any) -> WindowFeatures:
    """Return a map of the window, or make one from plain values."""
    if isinstance(features, WindowFeatures):
        return features
    if not isinstance(features, Mapping):
        raise ParameterError(f"features: got {brief(features)}, expected WindowFeatures or a mapping")
    return WindowFeatures.from_dict(dict(features))


def _as_names(inputs: Any) -> tuple[str, ...]:
    """Return names of inputs, of which no two are alike."""
    if isinstance(inputs, str) or not isinstance(inputs, Iterable):
        raise ParameterError(f"inputs: got {brief(inputs)}, expected a sequence of names")
    names = tuple(str(name) for name in inputs)
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"inputs: got {name!r} twice, expected names that differ")
    return names


@reprs("chain", "form")
class InputSystem(StationarySystem):
    """A form with inputs or features on the nodes of a chain.

    Its own tables are those of a step as long as nothing is told; a filter asks it for those of a step with
    inputs and a past, see `driven_tables`.

    Raises
    ------
    ParameterError
        If the chain has negative weights.
    """

    form: InputForm
    steady_from: int | None = None

    def __init__(self, chain: SwitchChain, form: InputForm) -> None:
        if chain.is_signed:
            raise ParameterError(
                "rule: got one that gives nodes negative weights, which a model with inputs or features does "
                "not take; expected 'cell', 'midpoint' or 'gauss'"
            )
        super().__init__(chain, form)
        self.dim_u, self.features = form.dim_u, form.features
        #: How inputs act on each node, (M, k); None where they do not.
        self.push = chain.class_weights @ form.tilt if form.tilt.any() else None

    def driven_tables(
        self, past: FloatArray, u: FloatArray, filled: FloatArray | None = None, number: int = 0
    ) -> DrivenTables:
        """Return the tables of a step.

        Parameters
        ----------
        past : ndarray, shape (n_past, q)
            Observations before it, the latest first, without gaps.
        u : ndarray, shape (k,)
            Inputs of the new time.
        filled : ndarray, shape (q,), optional
            What stands in the features for what is missing of the new observation.
        number : int
            Of the new observation, along a series.
        """
        features = self.features
        known = np.concatenate([features.common(past, u), features.own(past[0], u)])
        return DrivenTables(self.at(u), features, known, u, filled, number)

    def told_tables(self, told: Mapping[str, FloatArray | None]) -> DrivenTables:
        """Return the tables of a step of which a file has kept what `DrivenTables.told` returns.

        Raises
        ------
        ShapeError
            If it does not fit the model.
        """
        c, o = self.form.sizes
        known, u = as_array("known", told["known"], (c + o,)), as_array("u", told["u"], (self.dim_u or 0,))
        filled = told["filled"]
        filled = None if filled is None else as_array("filled", filled, (self.dim_z,))
        return DrivenTables(self.at(u), self.features, known, u, filled)

    def at(self, u: FloatArray) -> PairTables:
        """Return the tables of a step with these inputs, but for the window.

        Raises
        ------
        NumericalRangeError
            If the inputs are so far off that double precision cannot hold what they do to the switch.
        """
        if self.push is None:
            return self.tables
        with np.errstate(over="ignore", invalid="ignore"):
            weight = self.push @ (u - self.form.centre)
        if not np.isfinite(weight).all():
            raise NumericalRangeError(
                f"inputs: got {u.tolist()}, and double precision cannot hold what follows for the switch"
            )
        return PairTables(tilted_transition(self.tables.transition, weight), self.tables.pairs)


class DrivenTables:
    """The tables of one step with what the window holds beside the latest observation.

    They stand in for `PairTables`.

    Parameters
    ----------
    tables : PairTables
    features : WindowFeatures
    known : ndarray, shape (c + o,)
        (common, own(y, u')).
    u : ndarray, shape (k,)
    filled : ndarray, shape (q,), optional
        What stands in the features for what is missing of the new observation.
    number : int
        Of the new observation, along a series.
    """

    is_driven: ClassVar[bool] = True

    def __init__(
        self,
        tables: PairTables,
        features: WindowFeatures,
        known: FloatArray,
        u: FloatArray,
        filled: FloatArray | None,
        number: int = 0,
    ) -> None:
        self._tables, self._features, self._known, self._u, self._filled = tables, features, known, u, filled
        self.number = number
        self.transition, self.pairs = tables.transition, tables.pairs
        self.reads_next = features.n_hinges > 0 or features.products

    @property
    def kernel(self) -> Any:
        """As of `PairTables`."""
        return self._tables.kernel

    @property
    def in_slots(self) -> Any:
        """As of `PairTables`."""
        return self._tables.in_slots

    @property
    def noise_root(self) -> FloatArray:
        """As of `PairTables`."""
        return self._tables.noise_root

    @property
    def gaps(self) -> Any:
        """As of `PairTables`."""
        return self._tables.gaps

    def summary(self, chain: SwitchChain) -> Any:
        """As of `PairTables`."""
        return self._tables.summary(chain)

    def window(self, known: FloatArray, y: FloatArray | None = None) -> FloatArray:
        """Return the window (w,) from the latest observation (q,), NaN where missing, and the new one.

        Without a new one what the features take of it is zero: enough for what is said of Y'.
        """
        if y is None or not self.reads_next:
            own = np.zeros(self._tables.pairs.H.shape[-1] - known.size - self._known.size)
        else:
            missing = np.isnan(y)
            if missing.any():
                assert self._filled is not None  # whoever knows of a gap has filled it
                y = np.where(missing, self._filled, y)
            own = self._features.own(y, self._u)
        return np.concatenate([known, self._known, own])

    def lacks(self, y: FloatArray) -> bool:
        """Whether features of the new observation (q,) need something to stand for what is missing of it."""
        return self.reads_next and self._filled is None and bool(np.isnan(y).any())

    def told(self) -> dict[str, FloatArray | None]:
        """Return what a file has to keep: see `InputSystem.told_tables`."""
        return {"known": self._known, "u": self._u, "filled": self._filled}

    def filled(self, y: FloatArray) -> DrivenTables:
        """Return the same with what stands for missing parts of the new observation."""
        return DrivenTables(self._tables, self._features, self._known, self._u, y, self.number)


@reprs("chain")
class DrivenSystem:
    """A system along a series of which inputs and observations are known.

    Parameters
    ----------
    system : InputSystem
    ys : ndarray, shape (n, q)
        Observations without gaps: where one is missing, what was expected of it.
    us : ndarray, shape (n, k)
    lead : ndarray, shape (n_past, q)
        What stands for observations before the first; that is number ``origin`` of the series.
    origin : int
    """

    order: int = 1
    steady_from: int | None = None

    def __init__(
        self, system: InputSystem, ys: FloatArray, us: FloatArray, lead: FloatArray, origin: int = 0
    ) -> None:
        self.chain, self.dim_x, self.dim_z = system.chain, system.dim_x, system.dim_z
        self._system, self._ys, self._us, self._origin = system, ys, us, origin
        self._past = past_of(ys, lead, system.features.n_past)
        #: Whether complete observations need no more than one set of tables.
        self.goes_through = system.push is None

    def initial(self) -> InitialLaw:
        """Return the law of (r_1, Z_1)."""
        return self._system.initial()

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``."""
        k = n + 1 - self._origin
        return self._system.driven_tables(self._past[k], self._us[k], self._ys[k], n + 1)

    def windows(self, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Return what the windows of the steps to observations start, ..., stop - 1 hold beside y.

        Returns
        -------
        known : ndarray, shape (n, c + o)
            (common, own(y, u')).
        own : ndarray, shape (n, o)
            own(y', u').
        """
        part = slice(start - self._origin, stop - self._origin)
        past, us = self._past[part], self._us[part]
        features = self._system.features
        known = np.concatenate([features.common(past, us), features.own(past[:, 0], us)], axis=1)
        return known, features.own(self._ys[part], us)

    def own(self, ys: FloatArray, start: int) -> FloatArray:
        """Return own(y', u') for other observations y' (n, q), from number ``start`` on."""
        at = start - self._origin
        return self._system.features.own(ys, self._us[at : at + len(ys)])
