"""Looking back with a fixed lag: estimates of the state a few steps before the latest observation.

Between the filter, which tells at once, and the smoother, which waits for the end of a series.  A filter that
can look back has a `WayBack`: what it knows after an observation, and how it goes back over some of that.
All else is the same for all of them, and stands here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from fuzzykf.errors import ParameterError, SequenceError
from fuzzykf.gaussian import as_count, mixture_moments
from fuzzykf.reprs import shown

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager

    from fuzzykf.arrays import FloatArray

__all__ = ["FixedLag", "Nodes", "WayBack", "as_lag", "over_windows"]

#: Most steps that may be looked back.
MOST_LAG = 1_000_000_000


class Nodes(NamedTuple):
    """Estimates of the state at n times, given each of M nodes of a switch; one node where there is none."""

    mu: FloatArray  # (n, M)
    x: FloatArray  # (n, M, m)
    P: FloatArray  # (n, M, m, m)


class WayBack(Protocol):
    """How a filter looks back over what it knew."""

    def standing(self) -> Any:
        """Return something that is equal as long as nobody moves the filter."""

    def unchanged_on_error(self) -> AbstractContextManager[None]:
        """Return a context that leaves the filter as it was before it if an error is raised in it."""

    def step(self, z: Any, told: dict[str, Any]) -> Any:
        """Do a step of the filter, and return what is known after it.

        Parameters
        ----------
        z : array_like or None
            The observation.
        told : dict
            What the verbs are told beside it.
        """

    def look_back(self, states: Sequence[Any]) -> Nodes:
        """Estimate what was known at some times in a row, returned by `step`, from all of it."""


def as_lag(lag: Any) -> int:
    """Return how many steps are looked back, a whole number."""
    return as_count("lag", lag, 0, MOST_LAG)


def over_windows(look_back: Callable[[Sequence[Any]], Nodes], states: Sequence[Any], lag: int) -> Nodes:
    """Estimate the state at each time n of a series from what was observed up to n + lag, or to its end.

    Parameters
    ----------
    look_back : callable
        As that of a `WayBack`.
    states : sequence
        What was known after each observation, of which there is one at least.
    lag : int
    """
    last = max(0, len(states) - 1 - lag)  # from here on the end of the series comes first
    rows = [Nodes(*(one[:1] for one in look_back(states[n : n + lag + 1]))) for n in range(last)]
    return Nodes(*map(np.concatenate, zip(*rows, look_back(states[last:]), strict=True)))


class FixedLag:
    """Fixed-lag smoother: estimate each state a few steps later, step by step.

    Only the last ``lag`` states are stored.  Results equal the rows of the filter's ``smooth_lag``, up to
    rounding.

    Parameters
    ----------
    f : filter
        Filter with a method ``smooth_lag``: a `KalmanFilter`, an `IMMEstimator` of these, or a switching
        filter.  It is not copied; call `step` here, not on the filter.
    lag : int
        Number of steps to look ahead, at least 0.

    Attributes
    ----------
    filter : filter
        As given.
    lag : int
        As given.
    n : int or None
        Index of the observation to which ``x`` and ``P`` belong, from 0; None before there is any.
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x), or None
        Mean and covariance of that state, given all observations so far.
    mu : ndarray, shape (M,), or None
        Probabilities of the nodes of the switch, or of the modes, at that step; (1,) without a switch.

    Raises
    ------
    ParameterError
        If the filter cannot smooth, or ``lag`` is not an integer of at least 0.

    See Also
    --------
    KalmanFilter.smooth_lag : The same for a whole series.

    Examples
    --------
    >>> from fuzzykf import FixedLag, KalmanFilter
    >>> lagged = FixedLag(KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]), lag=1)
    >>> for z in (1.0, None, 2.0):
    ...     x = lagged.step(z)
    ...     print(lagged.n, None if x is None else round(x.item(), 3))
    None None
    0 0.667
    1 1.273
    """

    def __init__(self, f: Any, lag: int) -> None:
        if isinstance(f, type):
            raise ParameterError(f"f: got the class {f.__name__}, expected a filter, one of its objects")
        way = getattr(f, "_way_back", None)
        if way is None:
            raise ParameterError(
                f"f: got {type(f).__name__}, which cannot look back; expected a KalmanFilter, an "
                "IMMEstimator or a switching filter"
            )
        self.filter, self.lag = f, as_lag(lag)
        self._back: WayBack = way(f)
        self._states: list[Any] = []
        self._standing = self._back.standing()
        self.n: int | None = None
        self.x: FloatArray | None = None
        self.P: FloatArray | None = None
        self.mu: FloatArray | None = None

    def step(self, z: Any, **told: Any) -> FloatArray | None:
        """Do a step of the filter, and estimate the state ``lag`` steps earlier.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.
        **told
            Further arguments of the filter's ``predict`` and ``update``: ``u``, ``R``, ``H``, ``r``; for a
            Kalman filter also ``F``, ``Q`` and ``dt``.

        Returns
        -------
        ndarray, shape (dim_x, 1), or None
            The new ``x``; None during the first ``lag`` steps.

        Raises
        ------
        SequenceError
            If the filter was moved by other calls since the latest step.
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from the filter, which is then unchanged.
        """
        if self._standing != self._back.standing():
            raise SequenceError(
                f"step: this {type(self.filter).__name__} has moved since the latest step of FixedLag; "
                "expected all of its steps to be done here (make a new FixedLag to begin where it stands)"
            )
        given = {name: one for name, one in told.items() if one is not None}
        with self._back.unchanged_on_error():
            states = [*self._states, self._back.step(z, given)][-self.lag - 1 :]
            found = self._back.look_back(states) if len(states) > self.lag else None
        self._states, self._standing = states, self._back.standing()
        if found is None:
            return None
        mu, x, P = (one[0] for one in found)
        x, self.P = mixture_moments(mu, x, P)
        self.n, self.x, self.mu = 0 if self.n is None else self.n + 1, x[:, None], mu
        return self.x

    @shown
    def __repr__(self) -> str:
        latest = "none yet" if self.n is None else f"observation {self.n}"
        return f"FixedLag(lag={self.lag}): {latest}\n  filter: {type(self.filter).__name__}"
