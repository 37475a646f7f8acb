"""The way up: maxima of a log-likelihood of free numbers, from one start or from several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.estimation.information import curvature, units

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.estimation.free import FreeNumbers
    from fuzzykf.estimation.information import LogLikelihood

__all__ = ["Maximum", "Search", "ascend", "maximise"]

#: Steps of Newton at most, and how often one is halved.
NEWTON, HALVINGS = 12, 30

#: Curvature, in standard errors of numbers given all others, below which a direction is flat; and how far it
#: may bend upwards by rounding.
FLAT, UPWARDS = 1e-8, 1e-5

#: A log-variance with less curvature than this, in units of the spread, may be on its way to minus infinity.
AWAY = 1e-2

#: Where a log-variance is looked at when it is sent to zero: from below where it was to above where it was,
#: and where it began, in steps.
BELOW, ABOVE, RUNG = 20.0, 40.0, 2.0

#: A variance that is further below where it began counts for nothing: from there nobody climbs.
NOTHING = 80.0

#: What is gained there that is more than rounding, and a loss that shows, by how much it grows from one step
#: to the next, whether it is proportional to the variance, as at a bound, or to its square, as where other
#: numbers make up for it.
GAIN, LITTLE, LINEAR = 0.1, 1e-4, 20.0

#: How often a start is drawn that has a log-likelihood.
DRAWS = 20

#: Two maxima are one if they are this close, in standard errors.
SAME = 0.1


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where an ascent ended.

    Attributes
    ----------
    numbers : ndarray, shape (p,)
        Minus infinity for variances that are zero.
    log_likelihood : float
    trace : tuple of float
        Log-likelihoods on the way.
    gain : float
        What the last step of Newton promised; where nothing bends, what a large change would.
    converged : bool
        Whether that is less than the tolerance, and nothing bends upwards.
    information : ndarray, shape (p, p)
        Minus the matrix of second derivatives; zeros beside variances that are zero.
    """

    numbers: FloatArray
    log_likelihood: float
    trace: tuple[float, ...]
    gain: float
    converged: bool
    information: FloatArray

    @property
    def at_bound(self) -> BoolArray:
        """Which numbers are those of variances that are zero."""
        at_bound: BoolArray = np.isneginf(self.numbers)
        return at_bound


class Search(NamedTuple):
    """What several ascents found.

    Attributes
    ----------
    maxima : tuple of Maximum
        Those that differ, the best first; of all but the best only what converged.
    n_starts : int
        Ascents that were made: less than were asked for where no start with a log-likelihood was drawn.
    """

    maxima: tuple[Maximum, ...]
    n_starts: int


# --------------------------------------------------------------------------- from one start


class _Point(NamedTuple):
    numbers: FloatArray
    value: float
    gradient: FloatArray

    @property
    def at_bound(self) -> BoolArray:
        at_bound: BoolArray = np.isneginf(self.numbers)
        return at_bound


class _Climber:
    """An ascent from one start, and what it has seen."""

    def __init__(
        self,
        f: LogLikelihood,
        free: FreeNumbers,
        max_iter: int,
        tolerance: float,
        tick: Callable[[], None] | None,
    ) -> None:
        self.f, self.free, self.tolerance, self.tick = f, free, tolerance, tick
        self.left = max_iter
        self.trace: list[float] = []

    def look(self, numbers: FloatArray) -> _Point:
        """Evaluate; what is not finite in any part has no log-likelihood."""
        value, gradient = self.f(numbers)
        if not (np.isfinite(value) and np.isfinite(gradient).all()):
            return _Point(numbers, -np.inf, np.zeros(numbers.shape))
        return _Point(numbers, float(value), gradient)

    def told(self, value: float) -> None:
        """Note an iteration."""
        self.trace.append(value)
        self.left -= 1
        if self.tick is not None:
            self.tick()

    def quasi_newton(self, start: _Point) -> _Point:
        """Go up by L-BFGS, in units of the spread; variances that are zero stay."""
        from scipy.optimize import minimize

        moving = np.isfinite(start.numbers)
        unit = self.free.scale(start.numbers)[moving]
        if self.left <= 0 or not moving.any():
            return start
        best = last = start

        def there(z: FloatArray) -> FloatArray:
            numbers = start.numbers.copy()
            numbers[moving] += unit * z
            return numbers

        def negative(z: FloatArray) -> tuple[float, FloatArray]:
            nonlocal best, last
            point = self.look(there(z))
            if not np.isfinite(point.value):
                # a parabola that rises from where we were: the line search turns back into finite values
                way = z - (last.numbers[moving] - start.numbers[moving]) / unit
                height = max(1.0, abs(float(last.gradient[moving] @ (unit * way))))
                return height - last.value, 2.0 * height * way / max(float(way @ way), 1e-300)
            last = point
            best = point if point.value > best.value else best
            return -point.value, -point.gradient[moving] * unit

        options = {"maxiter": self.left, "maxfun": 30 * self.left, "maxcor": 20, "ftol": 1e-13, "gtol": 1e-6}
        minimize(
            negative,
            np.zeros(moving.sum()),
            jac=True,
            method="L-BFGS-B",
            callback=lambda _: self.told(best.value),
            options=options,
        )
        return best

    def bent(self, point: _Point) -> FloatArray:
        """Return the information at a point."""
        return curvature(self.f, self.free, point.numbers)

    def settled(self, point: _Point) -> tuple[_Point, FloatArray]:
        """Send variances to zero that are on their way there, or up again if there is more to be had.

        Returns the information there as well.
        """
        for _ in range(2 * len(point.numbers)):
            information = self.bent(point)
            bent = np.diagonal(information) * self.free.spread**2
            away = self.free.is_variance & np.isfinite(point.numbers) & (bent < AWAY)
            for i in np.flatnonzero(away)[np.argsort(point.numbers[away])]:
                found = self._sent(point, i)
                if found is not None:
                    point = found
                    break
            else:
                return point, information
        return point, self.bent(point)

    def _sent(self, point: _Point, i: int) -> _Point | None:
        """Return where to go on if number i goes to zero, or far up; None if neither is better."""
        numbers = point.numbers.copy()
        numbers[i] = -np.inf
        zero = self.look(numbers)
        if zero.value > point.value - GAIN:
            zero = self.quasi_newton(zero)
        if zero.value < point.value - self.tolerance:
            return None
        before = 0.0
        here = float(point.numbers[i])
        start = float(self.free.start[i])
        for rung in np.arange(max(here - BELOW, start - NOTHING), max(here, start) + ABOVE, RUNG):
            numbers = zero.numbers.copy()
            numbers[i] = rung
            up = self.look(numbers)
            if up.value > zero.value + GAIN:
                return self.quasi_newton(up)
            loss = zero.value - up.value
            if loss > LITTLE:
                return zero if loss < LINEAR * before else None
            before = loss
        return None  # nothing depends on it

    def newton(self, point: _Point, information: FloatArray) -> Maximum:
        """Finish by steps of Newton, and tell how much one more would gain."""
        for round_ in range(NEWTON + 1):
            if not np.isfinite(information).all():  # at an edge beyond which there is no value
                return Maximum(point.numbers, point.value, tuple(self.trace), np.inf, False, information)
            step, gain, is_peak = self._newton_step(point, information)
            if (gain < self.tolerance and is_peak) or round_ == NEWTON or self.left <= 0:
                break
            better = self._shortened(point, step)
            if better is None:
                break
            point, information = better, self.bent(better)
            self.told(point.value)
        converged = gain < self.tolerance and is_peak
        if converged and self.left > 0:  # the last digits cost one look more
            last = self.look(_moved(point, step))
            if np.isfinite(last.value) and self._newton_step(last, information)[1] < gain:
                point = last
                self.told(max(point.value, self.trace[-1]))
        return Maximum(point.numbers, point.value, tuple(self.trace), gain, converged, information)

    def _newton_step(self, point: _Point, information: FloatArray) -> tuple[FloatArray, float, bool]:
        """Return a step of Newton, what it promises, and whether the log-likelihood bends up nowhere."""
        unit = np.where(point.at_bound, 0.0, units(information, self.free.scale(point.numbers)))
        bent, ways = np.linalg.eigh(unit[:, None] * information * unit)
        slope = ways.T @ (unit * point.gradient)
        size = np.maximum(np.abs(bent), FLAT)
        gains = np.where(bent > FLAT, 0.5 * slope**2 / size, np.abs(slope))
        # where it bends upwards a step of one unit, at a saddle to either side
        uphill = np.where(slope == 0.0, 1.0, np.sign(slope))
        step = np.where(np.abs(bent) <= FLAT, 0.0, np.where(bent > 0.0, slope / size, uphill))
        is_peak = bool((bent > -UPWARDS).all())
        return unit * (ways @ step), float(gains.sum()), is_peak

    def _shortened(self, point: _Point, step: FloatArray) -> _Point | None:
        """Return the first point along a step, halved again and again, that is higher."""
        for _ in range(HALVINGS):
            found = self.look(_moved(point, step))
            if found.value > point.value:
                return found
            step = 0.5 * step
        return None


def _moved(point: _Point, step: FloatArray) -> FloatArray:
    """Return where a step leads to; variances that are zero stay."""
    return np.where(point.at_bound, point.numbers, point.numbers + step)


def ascend(
    f: LogLikelihood,
    free: FreeNumbers,
    start: FloatArray,
    *,
    max_iter: int = 500,
    tolerance: float = 1e-7,
    tick: Callable[[], None] | None = None,
) -> Maximum:
    """Return the maximum that a start leads to.

    By L-BFGS; then variances that go to zero are sent there, and steps of Newton finish.

    Parameters
    ----------
    f : callable
        Of numbers (p,), log-likelihood and gradient (p,).  Numbers of variances may be minus infinity.  A
        value that is not finite says that there is none: the search turns back.
    free : FreeNumbers
    start : ndarray, shape (p,)
    max_iter : int
    tolerance : float
        Gain in log-likelihood at which to stop.
    tick : callable, optional
        Called after each iteration.

    Raises
    ------
    ParameterError
        If there is no log-likelihood at the start.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.estimation.free import read_free
    >>> free = read_free({"R": "full"}, {"R": np.eye(1)}, covariances=["R"])
    >>> def f(numbers):  # ten observations of the variance 4
    ...     ratio = 4.0 * np.exp(-numbers)
    ...     return -5.0 * float(numbers[0] + ratio[0]), -5.0 * (1.0 - ratio)
    >>> free.estimates(ascend(f, free, free.start).numbers).round(6)
    array([4.])
    """
    climber = _Climber(f, free, max_iter, tolerance, tick)
    first = climber.look(start)
    if not np.isfinite(first.value):
        value, _ = f(start)
        raise ParameterError(
            f"free: the log-likelihood of the start is {value}, expected a finite number; set the parameters "
            "to values under which the observations are possible"
        )
    climber.trace.append(first.value)
    return climber.newton(*climber.settled(climber.quasi_newton(first)))


# --------------------------------------------------------------------------- from several starts


def maximise(
    f: LogLikelihood,
    free: FreeNumbers,
    *,
    n_starts: int = 1,
    rng: np.random.Generator | None = None,
    prepare: Callable[[FloatArray], FloatArray] | None = None,
    max_iter: int = 500,
    tolerance: float = 1e-7,
    tick: Callable[[], None] | None = None,
) -> Search:
    """Return the maxima that several starts lead to.

    Parameters
    ----------
    f, free, max_iter, tolerance, tick
        As in `ascend`; ``max_iter`` counts for each start.
    n_starts : int
        The first start is that of ``free``, the others are drawn around it.
    rng : numpy.random.Generator, optional
        For more than one start.
    prepare : callable, optional
        Of a start, returns the numbers from which the ascent begins, such as some steps of
        expectation-maximisation.

    Raises
    ------
    ParameterError
        If there is no log-likelihood at the first start; if there is no generator for others.
    """
    if n_starts > 1 and rng is None:
        raise ParameterError("rng: missing; more than one start is drawn at random and needs a Generator")
    starts: list[FloatArray | None] = [free.start]
    if rng is not None:
        starts += [_drawn(f, free, rng) for _ in range(n_starts - 1)]
    found = []
    for start in starts:
        if start is not None:
            start = prepare(start) if prepare is not None and np.isfinite(f(start)[0]) else start
            found.append(ascend(f, free, start, max_iter=max_iter, tolerance=tolerance, tick=tick))
    return Search(_distinct(found), len(found))


def _drawn(f: LogLikelihood, free: FreeNumbers, rng: np.random.Generator) -> FloatArray | None:
    """Return a start with a log-likelihood; None if none was drawn."""
    for _ in range(DRAWS):
        start = free.draw(rng)
        if np.isfinite(f(start)[0]):
            return start
    return None


def _distinct(found: Sequence[Maximum]) -> tuple[Maximum, ...]:
    """Return maxima that differ from better ones, the best first."""
    kept: list[Maximum] = []
    for one in sorted(found, key=lambda each: -each.log_likelihood):
        if not kept or (one.converged and not any(_is_same(one, better) for better in kept)):
            kept.append(one)
    return tuple(kept)


def _is_same(one: Maximum, better: Maximum) -> bool:
    if (one.at_bound != better.at_bound).any():
        return False
    away = np.where(better.at_bound, 0.0, one.numbers) - np.where(better.at_bound, 0.0, better.numbers)
    return bool(away @ better.information @ away < SAME**2)
