"""Dynamics with inputs and features of the window, and the systems that they become.

The regressions of `RegressionForm` get further regressors, which are known when they are used:

    Y' = Ayy y + Ny + By (common, own(y, u')) + N(0, Qyy),
    X' = Axx X + H y + G Y' + c + Bx (common, own(y', u')) + N(0, C),

see `fuzzykf.switching.dynamics.features.WindowFeatures`.  So the tables of a step stay what they are, with a
longer window w = (observations before, u', own(y, u'), own(y', u')): coefficients of means of blocks become
those of the observations in them.  Inputs may act
on the switch: with s_j the shares of the regimes in node j,

    P_ij(n) prop. to P_ij exp(s_j' tilt (u_n - centre)).

In a gap observations before stay unknown as far as the window reaches, as in any model of higher order.
Products with inputs are linear in what is missing.  Hinges of it have the mean, the variance and the
covariance with it that they have under the normal law which was expected, which is not exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fuzzykf.errors import NumericalRangeError, ParameterError
from fuzzykf.gaussian import as_array, brief, symmetrize
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
    from fuzzykf.switching.dynamics.features import Linearised
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
            "exact: given inputs and the switch, Y alone is Markov; in gaps hinges have the moments of a "
            "normal observation",
        )

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step on the longer window, given the shares of r_n and r_{n+1}."""
        found = super().pairs(u1, u2, describe, where)
        c, o = self.sizes
        q, k = self.dim_z, len(self.inputs)

        def wider(latest: FloatArray, beta: FloatArray, *, next_one: bool) -> FloatArray:
            lags, inputs = self.features.unrolled(beta[..., :c], q, k)
            lags[..., :q] = latest
            own, none = beta[..., c:], np.zeros((*beta.shape[:-1], o))
            both = (none, own) if next_one else (own, none)
            return np.concatenate([lags, inputs, *both], axis=-1)

        H = wider(found.H, bilinear(self.Bx, u1, u2), next_one=True)
        Ayy = wider(found.Ayy, bilinear(self.By, u1, u2), next_one=False)
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
        self.dim_u, self.features, self.order = form.dim_u, form.features, form.features.n_past
        #: How inputs act on each node, (M, k); None where they do not.
        self.push = chain.class_weights @ form.tilt if form.tilt.any() else None

    def driven_tables(
        self, past: FloatArray, spread: FloatArray, u: FloatArray, number: int = 0
    ) -> DrivenTables:
        """Return the tables of a step.

        Parameters
        ----------
        past : ndarray, shape (n_past, q)
            Observations before it, the latest first, with what was expected where they are missing.
        spread : ndarray, shape (q,)
            Variance that was expected of the latest one, zero where it is there.
        u : ndarray, shape (k,)
            Inputs of the new time.
        number : int
            Of the new observation, along a series.
        """
        return DrivenTables(self.at(u), self.features, past, spread, u, number)

    def told_tables(self, told: Mapping[str, FloatArray | None]) -> DrivenTables:
        """Return the tables of a step of which a file has kept what `DrivenTables.told` returns.

        Raises
        ------
        ShapeError
            If it does not fit the model.
        """
        u = as_array("u", told["u"], (self.dim_u or 0,))
        past = as_array("past", told["past"], (self.features.n_past, self.dim_z))
        return self.driven_tables(past, as_array("spread", told["spread"], (self.dim_z,)), u)

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
    past : ndarray, shape (n_past, q)
        Observations before, the latest first, with what was expected where they are missing.
    spread : ndarray, shape (q,)
        Variance that was expected of the latest one, zero where it is there.
    u : ndarray, shape (k,)
    number : int
        Of the new observation, along a series.
    next_law : tuple of ndarray, optional
        Mean and variance (q,) of the new observation, if they are known: those that were expected of what is
        missing, variance zero where it is there.
    """

    is_driven: ClassVar[bool] = True

    def __init__(
        self,
        tables: PairTables,
        features: WindowFeatures,
        past: FloatArray,
        spread: FloatArray,
        u: FloatArray,
        number: int = 0,
        next_law: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        self._tables, self._features, self._past, self._spread = tables, features, past, spread
        self._u, self.number, self.next_law = u, number, next_law
        self.transition, self.pairs = tables.transition, tables.pairs
        #: Whether the window has features of the new observation.
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

    def window(self, known: FloatArray, y: FloatArray) -> FloatArray:
        """Return the window (w,) from the latest observations, NaN where missing, and the new one (q,).

        At the start of a series there are fewer of them than the window holds: the first one stands for what
        was before it.  Where the latest or the new one is missing it is for `in_gap` to say what features
        take; here they are those of what was expected.
        """
        own = self._features.own(np.stack([self._past[0], np.nan_to_num(y)]), self._u).ravel()
        return np.concatenate([known, self._past.ravel()[known.size :], self._u, own])

    def without_features(self, known: FloatArray) -> FloatArray:
        """Return the window (w,) of the tables that `in_gap` makes, in which features are zero."""
        w = self.pairs.H.shape[-1]
        window = np.zeros(w)
        given = np.concatenate([known, self._past.ravel()[known.size :], self._u])
        window[: given.size] = given
        return window

    def in_gap(self, mean: FloatArray | None = None, variance: FloatArray | None = None) -> PairTables:
        """Return the tables of the step with features that are linear in what they are features of.

        Parameters
        ----------
        mean, variance : ndarray, shape (q,), optional
            Of the new observation, variance zero where it is there.  Without them nothing of the state holds
            that has to do with features of it.
        """
        if not self.reads_next:
            return self._tables
        pairs, q, o = self.pairs, self._past.shape[1], self._own
        w = pairs.H.shape[-1]
        before = self._features.linearised(self._past[0], self._spread, self._u)
        B = pairs.Ayy[..., w - 2 * o : w - o]
        Ayy = pairs.Ayy.copy()
        Ayy[..., :q] += B @ before.slope
        found = pairs._replace(
            Ayy=Ayy, Ny=pairs.Ny + B @ before.level, Qyy=symmetrize(pairs.Qyy + _square(B, before.left))
        )
        if mean is None or variance is None:
            return PairTables(self.transition, found)
        after, B = self._features.linearised(mean, variance, self._u), pairs.H[..., w - o :]
        return PairTables(
            self.transition,
            found._replace(
                G=pairs.G + B @ after.slope,
                c=pairs.c + B @ after.level,
                C=symmetrize(pairs.C + _square(B, after.left)),
            ),
        )

    def with_next(self, mean: FloatArray, variance: FloatArray) -> DrivenTables:
        """Return the same with what is known of the new observation."""
        parts = self._past, self._spread, self._u, self.number
        return DrivenTables(self._tables, self._features, *parts, (mean, variance))

    @property
    def _own(self) -> int:
        """How many features each observation has."""
        return self._features.sizes(self._past.shape[1], self._u.size)[1]

    def told(self) -> dict[str, FloatArray]:
        """Return what a file has to keep: see `InputSystem.told_tables`."""
        return {"past": self._past, "spread": self._spread, "u": self._u}


def _square(B: FloatArray, left: FloatArray) -> FloatArray:
    """B left B'."""
    return B @ left @ np.swapaxes(B, -1, -2)


@reprs("chain")
class DrivenSystem:
    """A system along a series of which inputs and observations are known.

    Parameters
    ----------
    system : InputSystem
    ys, spreads : ndarray, shape (n, q)
        Observations, and where one is missing what was expected of it; its variance, zero elsewhere.
    us : ndarray, shape (n, k)
    lead : ndarray, shape (n_past, q)
        What stands for observations before the first; that is number ``origin`` of the series.
    before : ndarray, shape (q,)
        Variance of the latest of these.
    origin : int
    """

    steady_from: int | None = None

    def __init__(
        self,
        system: InputSystem,
        ys: FloatArray,
        spreads: FloatArray,
        us: FloatArray,
        lead: FloatArray,
        before: FloatArray,
        origin: int = 0,
    ) -> None:
        self.chain, self.dim_x, self.dim_z, self.order = (
            system.chain,
            system.dim_x,
            system.dim_z,
            system.order,
        )
        self._system, self._ys, self._us, self._origin = system, ys, us, origin
        self._past = past_of(ys, lead, system.features.n_past)
        self._spreads = np.concatenate([before[None], spreads])  # of the observation before each
        #: Complete observations are for the method all at once.
        self.goes_through = True

    def initial(self) -> InitialLaw:
        """Return the law of (r_1, Z_1)."""
        return self._system.initial()

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``."""
        k = n + 1 - self._origin
        tables = self._system.driven_tables(self._past[k], self._spreads[k], self._us[k], n + 1)
        return tables.with_next(self._ys[k], self._spreads[k + 1])

    def windows(self, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Return what the windows of the steps to observations start, ..., stop - 1 hold.

        Returns
        -------
        known : ndarray, shape (n, n_past * q + k + o)
            Observations before, u' and own(y, u').
        own : ndarray, shape (n, o)
            own(y', u').
        """
        part = slice(start - self._origin, stop - self._origin)
        past, us = self._past[part], self._us[part]
        features = self._system.features
        flat = past.reshape(len(past), -1)
        known = np.concatenate([flat, us, features.own(past[:, 0], us)], axis=1)
        return known, features.own(self._ys[part], us)

    def kernels(self, start: int, stop: int) -> list[Any] | None:
        """Return the kernels of the steps to observations start, ..., stop - 1; None if all are one."""
        if self._system.push is None:
            return None
        us = self._us[start - self._origin : stop - self._origin]
        return [self._system.at(u).kernel for u in us]

    def transitions(self, start: int, n: int) -> FloatArray:
        """Return the transition probabilities of n steps, (n, M, M), or (M, M) if all are one."""
        if self._system.push is None:
            return self._system.tables.transition
        us = self._us[start - self._origin : start - self._origin + n]
        return np.array([self._system.at(u).transition for u in us])

    def linearised(self, mean: FloatArray, variance: FloatArray, start: int) -> Linearised:
        """Return features of the new observations, from number ``start`` on, by their normal laws."""
        at = start - self._origin
        return self._system.features.linearised(mean, variance, self._us[at : at + len(mean)])
