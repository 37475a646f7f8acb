"""What a fit by maximum likelihood found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.estimation.ascent import maximise
from fuzzykf.estimation.information import uncertainty
from fuzzykf.estimation.notes import at_their_bound, boundless, fewer, several, unfinished
from fuzzykf.gaussian import as_count, as_real, check_generator, normal_quantile
from fuzzykf.reprs import reprs
from fuzzykf.results import FitResult
from fuzzykf.summaries import FitSummary, SummaryTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.estimation.ascent import Search
    from fuzzykf.estimation.free import FreeNumbers
    from fuzzykf.estimation.information import LogLikelihood

__all__ = ["LikelihoodFit", "LocalMaximum", "maximum_likelihood"]

M = TypeVar("M")


@reprs()
class LocalMaximum(NamedTuple):
    """Local maximum of the log-likelihood.

    Attributes
    ----------
    log_likelihood : float
    estimates : dict of str to float

    Examples
    --------
    >>> from fuzzykf import KalmanFilter
    >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], P=0.0, Q=0.0)
    >>> fit = kf.fit([2.0, -2.0] * 100, free={"R": "full"})
    >>> fit.maxima[0].log_likelihood == fit.log_likelihood
    True
    """

    log_likelihood: float
    estimates: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class LikelihoodFit(FitResult[M], Generic[M]):
    """Maximum-likelihood estimates, with standard errors and intervals.

    Attributes
    ----------
    model : object
        New model, with the estimated parameters.
    log_likelihood : float
        Log-density of the observations.
    n_parameters : int
        Number of free parameters.
    n_observations : int
        Number of steps with an observation.
    trace : ndarray
        Log-likelihood at each iteration of the best search.
    converged : bool
        Whether the search ended because the gain fell below the tolerance.
    warnings : tuple of str
        Variances at zero, weakly identified parameters, other maxima.
    estimates : dict of str to float
        Estimates by name, such as ``"Q[0, 0]"``; a scale factor has the name of its matrix, ``"Q"``.
    standard_errors : dict of str to float
        From the observed information; NaN where it gives none.
    covariance : ndarray, shape (p, p)
        Covariance of the estimates, in their order.
    maxima : tuple of LocalMaximum
        Local maxima found, the best first.
    n_starts : int
        Number of searches.
    numbers : ndarray, shape (p,)
        Parameters in the coordinates of the search, at the maximum: variances are logarithms, minus infinity
        for zero.
    positive : frozenset of str
        Names of estimates that are variances or scale factors.
    shares : frozenset of str
        Names of estimates that are probabilities.

    See Also
    --------
    fuzzykf.KalmanFilter.fit

    Notes
    -----
    Standard errors are square roots of the diagonal of the inverse of the observed information: minus the
    second derivatives of the log-likelihood at the maximum, by finite differences of its gradient.  They are
    computed in the coordinates of the search; the delta method transforms them to the parameters.

    Examples
    --------
    >>> from fuzzykf import KalmanFilter
    >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], P=0.0, Q=0.0)
    >>> fit = kf.fit([2.0, -2.0] * 100, free={"R": "full"})  # noise of variance 4
    >>> round(fit.estimates["R[0, 0]"], 3), round(fit.standard_errors["R[0, 0]"], 3)
    (4.0, 0.4)
    >>> lower, upper = fit.intervals()["R[0, 0]"]
    >>> round(lower, 3), round(upper, 3)
    (3.288, 4.866)
    >>> fit.model.R.round(3)
    array([[4.]])
    """

    estimates: Mapping[str, float] = field(default_factory=dict)
    standard_errors: Mapping[str, float] = field(default_factory=dict)
    covariance: FloatArray | Any = field(default=None, repr=False)
    maxima: tuple[LocalMaximum, ...] = ()
    n_starts: int = 1
    numbers: FloatArray | Any = field(default=None, repr=False)
    positive: frozenset[str] = field(default=frozenset(), repr=False)
    shares: frozenset[str] = field(default=frozenset(), repr=False)
    replicate: Callable[[np.random.Generator], LikelihoodFit[M]] | None = field(default=None, repr=False)

    def intervals(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return a confidence interval for each parameter, from its standard error.

        Intervals of variances and scale factors are symmetric in the logarithm, those of probabilities in the
        logit; the others are symmetric.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        dict of str to (float, float)
            Lower and upper bound by name; NaN where there is no standard error.

        Raises
        ------
        ParameterError
            If ``level`` is not between 0 and 1.
        """
        if not 0.0 < as_real("level", level, "a number between 0 and 1") < 1.0:
            raise ParameterError(f"level: got {level}, expected a number between 0 and 1")
        quantile = normal_quantile(0.5 + 0.5 * level)
        found = {}
        for name, value in self.estimates.items():
            half = quantile * self.standard_errors[name]
            if name in self.shares:
                found[name] = _between(value, half)
            elif name in self.positive:
                factor = float(np.exp(half / value)) if value > 0.0 else np.nan
                found[name] = (value / factor, value * factor)
            else:
                found[name] = (value - half, value + half)
        return found

    def summary(self, level: float = 0.95) -> FitSummary:
        """Return a summary: estimates with standard errors and intervals, and warnings.

        Parameters
        ----------
        level : float
            Level of the intervals, between 0 and 1.

        Returns
        -------
        FitSummary
            Prints as plain text; in a notebook it is a table.

        Raises
        ------
        ParameterError
            As from `intervals`.
        """
        ends = self.intervals(level)
        tail = 50.0 * (1.0 - level)
        header = ("parameter", "estimate", "std err", f"[{tail:.4g} %", f"{100.0 - tail:.4g} %]")
        rows = tuple(
            (name, *map(_number, (value, self.standard_errors[name], *ends[name])))
            for name, value in self.estimates.items()
        )
        return FitSummary(
            title=f"{type(self.model).__name__}, by maximum likelihood",
            facts=self._facts(),
            tables=(SummaryTable("parameters", header, rows),),
            warnings=tuple(self.warnings),
            warnings_last=True,
        )

    def _facts(self) -> tuple[tuple[str, str], ...]:
        others = len(self.maxima) - 1
        starts = f"{self.n_starts}" + (f", {others + 1} maxima" if others > 0 else "")
        return (
            ("log-likelihood", f"{self.log_likelihood:.3f}"),
            ("AIC", f"{self.aic:.3f}"),
            ("BIC", f"{self.bic:.3f}"),
            ("observations", f"{self.n_observations:,}"),
            ("parameters", str(self.n_parameters)),
            ("converged", "yes" if self.converged else "no"),
            ("iterations", str(max(len(self.trace) - 1, 0))),
            *((("starts", starts),) if self.n_starts > 1 else ()),
            ("standard errors", "observed information; intervals of variances by their logarithms"),
        )

    def bootstrap(self, n_replicates: int, rng: np.random.Generator) -> list[FitResult[M]]:
        """Parametric bootstrap: simulate from the learned model and fit again.

        Each replicate has the lengths, gaps and inputs of the data; its search starts from the estimates.

        Parameters
        ----------
        n_replicates : int
            Number of replicates.
        rng : numpy.random.Generator

        Returns
        -------
        list of LikelihoodFit
            The standard deviation of an estimate over them is its standard error.

        Raises
        ------
        ParameterError
            If this result was not made by a fit, or cannot be simulated.
        """
        n_replicates = as_count("n_replicates", n_replicates, 1)
        check_generator(rng)
        if self.replicate is None:
            raise ParameterError("bootstrap: this result was not made by a fit")
        return [self.replicate(rng) for _ in range(n_replicates)]


def _between(value: float, half: float) -> tuple[float, float]:
    """Return the interval of a probability, symmetric for its logit."""
    if not 0.0 < value < 1.0:
        return np.nan, np.nan
    logit, off = np.log(value / (1.0 - value)), half / (value * (1.0 - value))
    return float(1.0 / (1.0 + np.exp(off - logit))), float(1.0 / (1.0 + np.exp(-off - logit)))


def _never(one: LocalMaximum, best: LocalMaximum) -> bool:
    return False


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.5g}"


def maximum_likelihood(
    f: LogLikelihood,
    free: FreeNumbers,
    build: Callable[[Mapping[str, Any]], M],
    n_observations: int,
    *,
    n_starts: int = 1,
    rng: np.random.Generator | None = None,
    prepare: Callable[[FloatArray], FloatArray] | None = None,
    max_iter: int = 500,
    tolerance: float = 1e-7,
    tick: Callable[[], None] | None = None,
    warnings: tuple[str, ...] = (),
    is_known: Callable[[LocalMaximum, LocalMaximum], bool] = _never,
) -> LikelihoodFit[M]:
    """Maximise a log-likelihood, and say what was found.

    Parameters
    ----------
    f, free, n_starts, rng, prepare, max_iter, tolerance, tick
        As in `fuzzykf.estimation.ascent.maximise`.
    build : callable
        Of the parameters by name, as `FreeNumbers.values` returns them, makes the model.
    n_observations : int
    warnings : tuple of str
        Others, which go before those of the search.
    is_known : callable
        Whether a maximum, given the best one, is not worth a warning.

    Returns
    -------
    LikelihoodFit
        Without ``replicate``.

    Raises
    ------
    ParameterError
        As from `maximise`; if an argument is inadmissible.
    """
    n_starts, max_iter = as_count("n_starts", n_starts, 1), as_count("max_iter", max_iter, 1)
    if not 0.0 < as_real("tolerance", tolerance, "a positive number") < np.inf:
        raise ParameterError(f"tolerance: got {tolerance!r}, expected a positive number")
    if rng is not None:
        check_generator(rng)
    found: Search = maximise(
        f,
        free,
        n_starts=n_starts,
        rng=rng,
        prepare=prepare,
        max_iter=max_iter,
        tolerance=tolerance,
        tick=tick,
    )
    best = found.maxima[0]
    how_well = uncertainty(f, free, best.numbers, best.information)
    notes = (
        unfinished(best, max_iter)
        + boundless(best, free)
        + at_their_bound(free, best.numbers)
        + how_well.notes
    )

    def named(values: FloatArray) -> dict[str, float]:
        return dict(zip(free.names, values.tolist(), strict=True))

    maxima = tuple(
        LocalMaximum(one.log_likelihood, named(free.estimates(one.numbers))) for one in found.maxima
    )
    others = [
        one for one, shown in zip(found.maxima[1:], maxima[1:], strict=True) if not is_known(shown, maxima[0])
    ]
    notes += several((best, *others), free) + fewer(found.n_starts, n_starts)
    return LikelihoodFit(
        model=build(free.values(best.numbers)),
        log_likelihood=best.log_likelihood,
        n_parameters=len(free.names),
        n_observations=n_observations,
        trace=np.array(best.trace),
        converged=best.converged,
        warnings=tuple(dict.fromkeys((*warnings, *notes))),
        estimates=named(free.estimates(best.numbers)),
        standard_errors=named(np.sqrt(np.diagonal(how_well.covariance))),
        covariance=how_well.covariance,
        maxima=maxima,
        n_starts=found.n_starts,
        numbers=best.numbers,
        positive=frozenset(name for name, is_one in zip(free.names, free.is_positive, strict=True) if is_one),
        shares=frozenset(name for name, is_one in zip(free.names, free.is_share, strict=True) if is_one),
    )
