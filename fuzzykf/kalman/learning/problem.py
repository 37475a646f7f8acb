"""The log-likelihood of filters as a function of their free numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fuzzykf.engine.selected import QUIET
from fuzzykf.errors import FuzzykfError, NotPositiveDefiniteError, ParameterError
from fuzzykf.estimation.blocks import CovarianceBlock, ScaleBlock
from fuzzykf.gaussian import covariance_root
from fuzzykf.kalman.arguments import as_square, as_vector
from fuzzykf.kalman.learning.score import log_likelihood, score
from fuzzykf.kalman.series import given_per_step, named_per_step

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.estimation.free import FreeNumbers
    from fuzzykf.kalman.linear_series import LinearModel

__all__ = ["LinearProblem", "Problem", "VerbProblem", "place"]

#: Steps of expectation-maximisation before an ascent: the first ones go far, whatever the start.
EM_STEPS = 5

#: Step of differences, in spreads of the numbers.
STEP = 1e-4


class Problem(Protocol):
    """A filter, what is free of it, and series."""

    free: FreeNumbers

    def log_likelihood(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Return the log-likelihood of all series, minus infinity where there is none, and its gradient."""
        ...

    def prepared(self, numbers: FloatArray) -> FloatArray:
        """Return numbers from which an ascent is to begin instead of these."""
        ...

    def simulated(self, numbers: FloatArray, rng: np.random.Generator) -> Problem:
        """Return the problem with series drawn from the model of these numbers, with the same gaps."""
        ...


class LinearProblem:
    """A linear filter whose verbs are its own, by the exact gradient.

    Parameters
    ----------
    model : LinearModel
        Of the filter.
    B : ndarray, shape (dim_x, dim_u), or None
    zs : ndarray, shape (series, n, dim_z)
        NaN where missing, and beyond the end of a series.
    lengths : ndarray of int, shape (series,)
    us : ndarray, shape (series or 1, n, dim_u), or None
    free : FreeNumbers
        Of arrays by the names Q, R, F, H, B, x and P.
    """

    def __init__(
        self,
        model: LinearModel,
        B: FloatArray | None,
        zs: FloatArray,
        lengths: IntArray,
        us: FloatArray | None,
        free: FreeNumbers,
    ) -> None:
        self.model, self.B, self.zs, self.lengths, self.us, self.free = model, B, zs, lengths, us, free

    def _placed(self, values: Mapping[str, FloatArray]) -> tuple[LinearModel, FloatArray | None]:
        """Return the model with these values, and its terms B u."""
        arrays: dict[str, Any] = {name: values[name] for name in values if name != "B"}
        B = values.get("B", self.B)
        terms = None if self.us is None or B is None else self.us @ B.T
        return self.model._replace(**arrays), terms

    def log_likelihood(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """See `Problem`."""
        value, by_values = self._scored(numbers)
        if not by_values:
            return -np.inf, np.full(numbers.shape, np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            return value, self.free.gradient(numbers, by_values)

    @QUIET
    def _scored(self, numbers: FloatArray) -> tuple[float, dict[str, FloatArray]]:
        model, terms = self._placed(self.free.values(numbers))
        try:
            value, stored = log_likelihood(model, self.zs, terms)
            found = score(model, self.zs, stored)._asdict()
        except np.linalg.LinAlgError:  # what was observed, or its precision, is impossible
            return -np.inf, {}
        by_terms = found.pop("terms")
        if self.us is not None:
            us = np.broadcast_to(self.us, (len(self.zs), *self.us.shape[1:]))
            found["B"] = np.einsum("snd,snu->du", by_terms, us)
        return value, found

    def prepared(self, numbers: FloatArray) -> FloatArray:
        """Return what some steps of expectation-maximisation lead to, with all but covariances held.

        The expected second moments of the noises, given the observations, are V + V (2 G / n) V each, with
        G the gradient by the covariance V, which may be singular.
        """
        counts = {
            "Q": float(self.lengths.sum()),
            "R": float((~np.isnan(self.zs)).any(axis=-1).sum()),
            "P": float(len(self.zs)),
        }
        for _ in range(EM_STEPS):
            values = self.free.values(numbers)
            _, by_values = self._scored(numbers)
            if not by_values:
                return numbers
            raised = numbers.copy()
            try:
                for key, block in self.free.blocks.items():
                    if isinstance(block, CovarianceBlock | ScaleBlock):
                        V, G = values[key], by_values[key]
                        moment = V + (2.0 / counts[key]) * (V @ G @ V)
                        raised[self.free.places[key]] = block.of_moment(0.5 * (moment + moment.T))
            except NotPositiveDefiniteError:  # next to singular: the ascent goes on from here
                return numbers
            if not np.isfinite(raised).all():
                return numbers
            numbers = raised
        return numbers

    def simulated(self, numbers: FloatArray, rng: np.random.Generator) -> LinearProblem:
        """See `Problem`."""
        model, terms = self._placed(self.free.values(numbers))
        x, P, F, Q, H, R, _ = model
        series, n, m = self.zs.shape
        state = x.ravel() + rng.standard_normal((series, len(P))) @ covariance_root(P).T
        w = rng.standard_normal((series, n, len(Q))) @ covariance_root(Q).T
        zs = rng.standard_normal((series, n, m)) @ covariance_root(R).T
        for k in range(n):
            state = state @ F.T + w[:, k] + (0.0 if terms is None else terms[:, k])
            zs[:, k] += state @ H.T
        zs[np.isnan(self.zs)] = np.nan
        return LinearProblem(self.model, self.B, zs, self.lengths, self.us, self.free)


class VerbProblem:
    """A filter whose verbs may be anything, by differences of its log-likelihood.

    Parameters
    ----------
    filter_ : GaussianFilter
    series : sequence of ndarray, shapes (n, dim_z)
    arguments : sequence of mappings
        Keyword arguments of `filter` for each: us, fx_args, hx_args.
    free : FreeNumbers
    """

    def __init__(
        self,
        filter_: Any,
        series: Sequence[FloatArray],
        arguments: Sequence[Mapping[str, Any]],
        free: FreeNumbers,
    ) -> None:
        self.filter, self.series, self.arguments, self.free = filter_, series, arguments, free
        self.value(free.start)  # whatever is wrong with the filter is told, and not taken for impossible

    def value(self, numbers: FloatArray) -> float:
        """Return the log-likelihood of all series.

        Raises
        ------
        FuzzykfError
            As from `filter`.
        """
        values, total = self.free.values(numbers), 0.0
        for one, given in zip(self.series, self.arguments, strict=True):
            with self.filter._lent() as spare:
                place(spare, values)
                total += float(spare.filter(one, **given).log_likelihood.sum())
        return total

    def _value(self, numbers: FloatArray) -> float:
        try:
            return self.value(numbers)
        except (FuzzykfError, ArithmeticError, np.linalg.LinAlgError):
            return -np.inf

    def log_likelihood(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """See `Problem`."""
        value, gradient, scale = self._value(numbers), np.zeros(numbers.shape), self.free.scale(numbers)
        if not np.isfinite(value):
            return -np.inf, np.full(numbers.shape, np.nan)
        for k in np.flatnonzero(np.isfinite(numbers)):
            step = np.zeros(len(numbers))
            step[k] = STEP * scale[k]
            gradient[k] = (self._value(numbers + step) - self._value(numbers - step)) / (2.0 * step[k])
        return value, gradient

    def prepared(self, numbers: FloatArray) -> FloatArray:
        """Return the numbers themselves."""
        return numbers

    def simulated(self, numbers: FloatArray, rng: np.random.Generator) -> VerbProblem:
        """See `Problem`; of filters that predict by ``predict_x`` and have ``hx``."""
        f, values = self.filter, self.free.values(numbers)
        if getattr(f, "hx", None) is None or not hasattr(f, "predict_x"):
            raise ParameterError(
                f"bootstrap: a {type(f).__name__} with verbs of its own cannot be simulated; expected a "
                "KalmanFilter as it is, or an ExtendedKalmanFilter with hx"
            )
        drawn = []
        for one, given in zip(self.series, self.arguments, strict=True):
            with f._lent() as spare:
                place(spare, values)
                drawn.append(_simulated(spare, one, given, rng))
        return VerbProblem(f, drawn, self.arguments, self.free)


def _simulated(f: Any, series: FloatArray, given: Mapping[str, Any], rng: np.random.Generator) -> FloatArray:
    """Draw a series from an extended filter, which moves along, with the gaps of another one."""
    n, m = series.shape
    moves = given_per_step(n, us=given.get("us"))
    before = named_per_step("fx_args", given.get("fx_args"), n)
    looks = named_per_step("hx_args", given.get("hx_args"), n)
    x, P = f._state()
    Q, R = (covariance_root(as_square(k, getattr(f, k), d)) for k, d in (("Q", len(P)), ("R", m)))
    f.x = x + (covariance_root(P) @ rng.standard_normal(len(P))).reshape(x.shape)
    drawn = np.empty(series.shape)
    for k in range(n):
        f.predict_x(**{"u": 0, **moves[k]}, **before[k])
        f.x = f.x + (Q @ rng.standard_normal(len(P))).reshape(x.shape)
        seen = as_vector("hx", f.hx(f.x.flatten(), **looks[k]), drawn[k])
        drawn[k] = seen + R @ rng.standard_normal(m)
    drawn[np.isnan(series)] = np.nan
    return drawn


def place(f: Any, values: Mapping[str, FloatArray]) -> None:
    """Give a filter values of its attributes; x keeps its form, flat or column."""
    form = f._state()[0].shape
    for name, value in values.items():
        setattr(f, name, value.reshape(form) if name == "x" else value.copy())
