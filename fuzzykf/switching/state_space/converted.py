"""The system of a converted model (CMSHLM): tables made when they are asked for."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

import numpy as np

from fuzzykf.errors import FileFormatError, NotStableError, ParameterError
from fuzzykf.gaussian import check_definite, is_whole, semidefinite_root, square
from fuzzykf.io import decode, encode
from fuzzykf.switching.dynamics.pairs import InitialLaw, PairCoefficients, PairTables
from fuzzykf.switching.dynamics.placed import KnownPath
from fuzzykf.switching.laws.chain import SUM_TOLERANCE
from fuzzykf.switching.state_space import conversion
from fuzzykf.switching.state_space.conversion import WindowLaw
from fuzzykf.switching.state_space.offsets import first_mean, mixed_means, pair_means, with_offsets

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.state_space.cglssm import CGLSSM
    from fuzzykf.switching.state_space.conversion import PairMoments
    from fuzzykf.switching.state_space.offsets import PairMeans
    from fuzzykf.switching.state_space.space_on_nodes import SpaceOnNodes

__all__ = ["Construction", "ConvertedPath", "ConvertedSystem", "Mode", "Noise"]

Construction = Literal["gain", "markov_x", "clip"]
Noise = Literal["pair", "averaged"]
Mode = Literal["stationary", "time_varying"]

#: Laws of the window are kept for every so many steps, and recomputed in between.
_STRIDE = 64

#: Steps that are done again for the sake of a file that does not keep a law.
_REDONE = 1000

#: How many numbers the tables that are kept may hold, and how many tables they may be.
_KEPT_NUMBERS, _KEPT_TABLES = 1 << 22, 256

#: Standard deviations from here on are refused, while their squares still are finite.
_LARGEST = 1e150

#: Most past observations that a step conditions on: what older ones add is below rounding long before.
_LONGEST = 64

#: Steps that are proved when a time-varying model is made; of a construction that may fail later, more.
_PROVED_STEPS = 100


class ConvertedSystem:
    """A state-space model turned into one that has an exact filter, on its regimes.

    Parameters
    ----------
    cglssm : CGLSSM or SpaceOnNodes
        The latter, whose regimes are nodes, with ``construction="gain"`` and ``noise="pair"``.
    construction : {"gain", "markov_x", "clip"}
    noise : {"pair", "averaged"}
    order : int
        How many past observations a step conditions on.
    mode : {"stationary", "time_varying"}

    See Also
    --------
    fuzzykf.CGOMSModel.from_cglssm : What the parameters mean.

    Notes
    -----
    The tables of step n follow from the law of (X_n, w_n) given each regime, which is
    carried from step to step.  Of a time-varying model the latest tables are kept, and
    the law at every 64th step, from which it can be resumed.
    """

    def __init__(
        self,
        cglssm: CGLSSM | SpaceOnNodes,
        construction: Construction,
        noise: Noise,
        order: int,
        mode: Mode,
    ) -> None:
        for name, value, options in (
            ("construction", construction, get_args(Construction)),
            ("noise", noise, get_args(Noise)),
            ("mode", mode, get_args(Mode)),
        ):
            if value not in options:
                raise ParameterError(
                    f"{name}: got {value!r}, expected one of {', '.join(map(repr, options))}"
                )
        if not is_whole(order) or order < 1:
            raise ParameterError(f"order: got {order!r}, expected a whole number of at least 1")
        if order > _LONGEST:
            raise ParameterError(f"order: got {order}, expected at most {_LONGEST}")
        if order > 1 and construction != "gain":
            raise ParameterError(
                f"order: got {order}, expected 1 with construction={construction!r}; longer windows of "
                "observations go with construction='gain'"
            )
        if cglssm.offsets is not None and (construction, noise) != ("gain", "pair"):
            raise ParameterError(
                f"construction, noise: got {construction!r} and {noise!r}, expected 'gain' and 'pair' for a "
                "model with offsets"
            )
        if mode == "stationary":
            cglssm.check_stationary()
        self.cglssm, self.chain = cglssm, cglssm.chain
        self.construction, self.noise, self.order, self.mode = construction, noise, int(order), mode
        self.n_classes, self.dim_x, self.dim_z = cglssm.n_classes, cglssm.dim_x, cglssm.dim_z
        self.steady_from: int | None = self.order - 1 if mode == "stationary" else None
        self._laws = {0: self._first_law()}
        self._moments: tuple[int, PairMoments] | None = None
        size = self.n_classes**3 * (self.dim_x + self.order * self.dim_z) ** 2
        kept = min(max(_KEPT_NUMBERS // size, 2), _KEPT_TABLES)
        self._tables = lru_cache(maxsize=kept)(self._make_tables)
        for n in range(self._steps_to_prove()):
            self._tables(n)

    def _steps_to_prove(self) -> int:
        if self.steady_from is not None:
            return self.order
        if self.construction == "markov_x":
            return _PROVED_STEPS
        return self.order + self.n_classes  # by then the window is full and every regime was reached

    # ------------------------------------------------------------------ laws

    def _first_law(self) -> WindowLaw:
        with np.errstate(divide="ignore"):
            log_p = np.log(self.chain.initial)
        _, B, _, D = self.cglssm.space
        G = self.cglssm.initial_covariance
        Gy = B @ G @ np.swapaxes(B, -1, -2) + square(D)
        check_definite(
            Gy,
            lambda k: f"covariance of the first observation in the regime {k[0]}",
            strict=True,
            where=np.isfinite(log_p),
        )
        mean = None
        if self.cglssm.offsets is not None:
            mean = first_mean(self.cglssm.initial_mean, B, self.cglssm.offsets.d)
        return conversion.first_window(log_p, semidefinite_root(G), B, D, mean)

    def law(self, n: int) -> WindowLaw:
        """Return the law of the regime, the window and the state at observation ``n`` (0, 1, ...)."""
        if self.steady_from is not None:
            n = min(n, self.steady_from)
        if n not in self._laws:
            laws = dict(self._laws)
            k = n
            while k not in laws:
                k -= 1
            while k < n:
                laws[k + 1] = self._next_law(k, laws[k])
                k += 1
            start = n - n % _STRIDE
            self._laws = {k: v for k, v in laws.items() if k % _STRIDE == 0 or start < k < start + _STRIDE}
            return laws[n]
        return self._laws[n]

    def _next_law(self, n: int, law: WindowLaw) -> WindowLaw:
        kernel, log_next = conversion.backward_kernel(law.log_p, self.chain.transition)
        moments = self._pair_moments(n, law)
        length = min(n + 2, self.order) * self.dim_z
        pairs = self._pair_means(law)
        means = None if pairs is None else mixed_means(pairs, kernel, length)
        A = self.cglssm.space.A
        new = conversion.advance_window(law, moments, A, kernel, log_next, length, means)
        if not np.abs(new.factor).max() < _LARGEST:
            raise NotStableError(
                f"A: the covariance of the state has grown beyond {_LARGEST**2:g} at step {n + 1}"
            )
        return new

    def _pair_means(self, law: WindowLaw) -> PairMeans | None:
        """Return the means of a step from a law; None where all are zero."""
        if law.mean is None or self.cglssm.offsets is None:
            return None
        return pair_means(law.mean, self.cglssm.space, self.cglssm.offsets)

    def possible(self, law: WindowLaw) -> np.ndarray:
        """Tell which pairs of regimes can occur after a law, (K, K)."""
        pairs: np.ndarray = np.isfinite(law.log_p)[:, None] & (self.chain.transition > 0.0)
        return pairs

    def _pair_moments(self, n: int, law: WindowLaw) -> PairMoments:
        latest = self._moments
        if latest is not None and latest[0] == n:
            return latest[1]

        def describe(pair: tuple[int, ...]) -> str:
            return f"covariance of the observation after step {n}, {_regimes(pair)}"

        moments = conversion.pair_moments(law, self.cglssm.space, describe, self.possible(law))
        self._moments = n, moments
        return moments

    # ------------------------------------------------------------------ tables

    def initial(self) -> InitialLaw:
        """Return the law of the first regime and of (X_1, Y_1)."""
        law, m = self.law(0), self.dim_x
        factor = np.roll(law.factor, m, axis=-2)  # rows X, Y
        mean = np.zeros(factor.shape[:-1]) if law.mean is None else np.roll(law.mean, m, axis=-1)
        return InitialLaw(self.chain.initial, mean, square(factor))

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from observation ``n`` to ``n + 1``.

        Raises
        ------
        NotPositiveDefiniteError
            If the construction does not exist at this step of a time-varying model.
        """
        tables: PairTables = self._tables(n if self.steady_from is None else min(n, self.steady_from))
        return tables

    def _make_tables(self, n: int) -> PairTables:
        return PairTables(self.chain.transition, self._pairs(n))

    def _pairs(self, n: int) -> PairCoefficients:
        law = self.law(n)
        where = self.possible(law)
        moments = self._pair_moments(n, law)

        def describe(pair: tuple[int, ...]) -> str:
            return f"construction={self.construction!r} at step {n}, {_regimes(pair)}"

        def describe_average(regime: tuple[int, ...]) -> str:
            return f"construction={self.construction!r} at step {n}, averaged for the regime {regime[0]}"

        space = self.cglssm.space
        if self.construction == "gain":
            pairs = conversion.gain_coefficients(moments, space)
            means = self._pair_means(law)
            if means is not None and self.cglssm.offsets is not None:
                pairs = with_offsets(pairs, moments, means, space, self.cglssm.offsets)
        elif self.construction == "clip":
            pairs = conversion.clip_coefficients(moments, space, describe, where)
        else:
            pairs = conversion.markov_x_coefficients(moments, space)
        if self.noise == "averaged":
            kernel, _ = conversion.backward_kernel(law.log_p, self.chain.transition)
            return conversion.average_noise(pairs, moments, kernel, describe_average, where)
        if self.construction == "markov_x":
            return conversion.prove_noise(pairs, moments, describe, where)
        return pairs

    # ------------------------------------------------------------------ values

    @property
    def options(self) -> dict[str, Any]:
        """How the model is converted, as plain values."""
        return {name: getattr(self, name) for name in ("construction", "noise", "order", "mode")}

    def law_to_dict(self, n: int) -> dict[str, Any] | None:
        """Return the law at observation ``n`` as plain values, None where it can be had at once."""
        if self.steady_from is not None or n < _STRIDE:
            return None
        law = self.law(n)
        log_p = np.where(np.isfinite(law.log_p), law.log_p, np.nan)  # a regime that cannot occur
        mean = {} if law.mean is None else {"mean": law.mean.tolist()}
        return {"log_p": encode(log_p), "factor": law.factor.tolist()} | mean

    def restore_law(self, n: int, values: Mapping[str, Any] | None) -> None:
        """Take the law at observation ``n`` from what `law_to_dict` returned: no step is done again.

        Raises
        ------
        FileFormatError
            If it is no law of this system, or missing where it would take long to compute.
        """
        if values is None:
            if self.steady_from is None and n > _REDONE:
                raise FileFormatError(f"the law of a time-varying model after {n} observations is missing")
            return
        log_p, factor = decode(values["log_p"], 1), decode(values["factor"], 3)
        d = min(n + 1, self.order) * self.dim_z + self.dim_x
        if log_p.shape != (self.n_classes,) or factor.shape != (self.n_classes, d, d):
            raise FileFormatError(f"the law after {n} observations has the shape {factor.shape}")
        if not (np.isfinite(factor).all() and abs(np.nansum(np.exp(log_p)) - 1.0) < SUM_TOLERANCE):
            raise FileFormatError(f"the law after {n} observations is none: {log_p.tolist()}")
        mean = None
        if self.cglssm.offsets is not None:
            mean = decode(values["mean"], 2)
            if mean.shape != factor.shape[:-1] or not np.isfinite(mean).all():
                raise FileFormatError(f"the mean after {n} observations is none of {factor.shape[:-1]}")
        laws = {n: WindowLaw(np.where(np.isnan(log_p), -np.inf, log_p), factor, mean)}
        self._laws = self._laws | laws

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self.cglssm), self.cglssm.to_dict(), self.options)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


def _restored(
    kind: type[CGLSSM | SpaceOnNodes], cglssm: dict[str, Any], options: dict[str, Any]
) -> ConvertedSystem:
    return ConvertedSystem(kind.from_dict(cglssm), **options)


def _regimes(pair: tuple[int, ...]) -> str:
    return f"regimes ({pair[0]}, {pair[1]})"


class ConvertedPath(KnownPath):
    """A converted model along known regimes.

    Parameters
    ----------
    system : ConvertedSystem
    r : ndarray, shape (n,)
        Regimes.
    start : int
        Index of the observation to which the first of them belongs.
    """

    def __init__(self, system: ConvertedSystem, r: FloatArray, start: int = 0) -> None:
        super().__init__(system.dim_x, system.dim_z, r, system.order)
        self.system, self.start = system, start

    def initial(self) -> InitialLaw:
        """Return the law of (X_1, Y_1) in the first regime."""
        k, law = int(self.r[0]), self.system.initial()
        if law.probability[k] == 0.0:
            raise ParameterError(f"r: got regime {k} at first, which has probability zero in the model")
        return InitialLaw(np.ones(1), law.mean[k, None], law.covariance[k, None])

    def pair_tables(self, n: int) -> PairTables:
        """Return the tables of the step from the ``n``-th regime of the path to the next."""
        i, j, step = int(self.r[n]), int(self.r[n + 1]), self.start + n
        if not self.system.possible(self.system.law(step))[i, j]:
            raise ParameterError(
                f"r: got the regimes ({i}, {j}) at observations {step} and {step + 1}, which have "
                "probability zero in the model"
            )
        pairs = self.system.pair_tables(step).pairs
        chosen = (value[i, j, None, None] for value in pairs)
        return PairTables(np.ones((1, 1)), PairCoefficients(*chosen))
