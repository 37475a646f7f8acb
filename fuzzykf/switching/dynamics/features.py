"""What a step may depend on beside the latest observation: inputs, and a fixed map of the window.

The equations of Y' and X' may have further regressors, as long as these are functions of what is known when
they are used: of inputs u', known at all times (clock, calendar, control), of earlier observations and, in
that of X', of the new observation.  Filtering stays exact with any such functions.  With u' the inputs of the
new time, y the latest observation and y' the new one,

    Y':  phi = (common, own(y, u')),    X':  psi = (common, own(y', u')),
    common = (u', earlier observations one by one, means of blocks of still earlier ones),
    own(y, u) = (max(y - knot, 0) for each knot, products u y).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from scipy.special import ndtr

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_count, as_flag, as_numbers, brief, is_whole
from fuzzykf.immutable import Immutable
from fuzzykf.reprs import shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["WindowFeatures"]

#: Observations that a map looks back at, at most: beyond a month of hours nobody has use for one.
MOST_LAGS = 1000

#: Hinges of a component, at most.
MOST_HINGES = 20


class WindowFeatures(Immutable):
    """Lags, hinges and products of the latest observations, for a learned switching model.

    Parameters
    ----------
    order : int
        Number of lags with a coefficient of their own; 1 is the latest observation only, which
        every model has.
    blocks : sequence of int
        Lengths of blocks of older observations, whose means have coefficients (distributed lags).
        With order 2 and blocks (2, 4), these are the means of lags 3 to 4 and of lags 5 to 8.
    hinges : int or array_like, shape (q, h)
        Knots of the features max(y - knot, 0) for each component: they make the dependence on the latest
        observation piecewise linear, and that of the state on the new one.  A number h means h knots at
        equally spaced quantiles of the training data.
    products : bool
        Whether to add the product of each input with the latest observation and, for the state, with the new
        one.

    Attributes
    ----------
    n_past : int
        Number of past observations in the window.
    knots : ndarray, shape (q, h), or None
        The knots; None until they are learned.

    Raises
    ------
    ParameterError
        If a number is not an integer in its range, or there are too many features.

    Examples
    --------
    >>> WindowFeatures(order=2, blocks=(2, 4)).names(["t"], [])
    (['t[-2]', 't[-3..-4]', 't[-5..-8]'], [])
    >>> WindowFeatures(hinges=[[10.0]], products=True).names(["t"], ["day"])
    (['day'], ['t > 10', 'day * t'])
    """

    def __init__(
        self,
        *,
        order: int = 1,
        blocks: Iterable[int] = (),
        hinges: int | Sequence[Sequence[float]] | FloatArray = 0,
        products: bool = False,
    ) -> None:
        self.order = as_count("order", order, 1, MOST_LAGS)
        self.blocks = _as_lengths(blocks)
        self.n_past = self.order + sum(self.blocks)
        if self.n_past > MOST_LAGS:
            raise ParameterError(
                f"order, blocks: look back at {self.n_past} observations, expected at most {MOST_LAGS}"
            )
        knots = None if is_whole(hinges) else _as_knots(hinges)
        n_hinges = hinges if knots is None else knots.shape[1]
        self.n_hinges = as_count("hinges", n_hinges, 0, MOST_HINGES)  # type: ignore[arg-type]
        if knots is not None and not (np.diff(knots, axis=1) > 0.0).all():
            raise ParameterError(f"hinges: got {knots.tolist()}, expected knots that rise in each row")
        self.knots = knots
        self.products = as_flag("products", products)

    @property
    def is_trivial(self) -> bool:
        """Whether the only features are the latest observation and the inputs."""
        return self.n_past == 1 and not self.n_hinges and not self.products

    def sizes(self, q: int, k: int) -> tuple[int, int]:
        """Return the numbers of features in ``common`` and ``own``, for q components and k inputs.

        Parameters
        ----------
        q, k : int
            Numbers of components of an observation and of inputs.

        Returns
        -------
        tuple of int
        """
        common = k + q * (self.order - 1 + len(self.blocks))
        return common, q * (self.n_hinges + (k if self.products else 0))

    def learned(self, ys: FloatArray) -> Self:
        """Return the same features with knots at quantiles of observations (n, q).

        Parameters
        ----------
        ys : ndarray, shape (n, q)
            Observations; NaN where missing.

        Returns
        -------
        WindowFeatures

        Raises
        ------
        ParameterError
            If two knots coincide, because observations repeat too often.
        """
        if self.knots is not None or not self.n_hinges:
            if self.knots is not None and len(self.knots) != ys.shape[1]:
                raise ShapeError(
                    f"hinges: got knots of {len(self.knots)} components, expected {ys.shape[1]}, as y has"
                )
            return self
        at = np.arange(1, self.n_hinges + 1) / (self.n_hinges + 1)
        knots = np.quantile(ys, at, axis=0).T
        if not (np.diff(knots, axis=1) > 0.0).all():
            raise ParameterError(
                f"hinges: got {self.n_hinges}, but quantiles of y fall together ({knots.tolist()}), as "
                "values repeat; expected fewer, or the knots themselves"
            )
        return type(self)(order=self.order, blocks=self.blocks, hinges=knots, products=self.products)

    def names(self, observations: Sequence[str], inputs: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the names of ``common`` and of ``own``.

        Parameters
        ----------
        observations, inputs : sequence of str
            Names of the components of an observation and of the inputs.

        Returns
        -------
        common, own : list of str
        """
        common = list(inputs)
        common += [f"{y}[-{lag}]" for lag in range(2, self.order + 1) for y in observations]
        first = self.order + 1
        for length in self.blocks:
            last = first + length - 1
            span = f"-{first}" if length == 1 else f"-{first}..-{last}"
            common += [f"{y}[{span}]" for y in observations]
            first = last + 1
        own = []
        for row, y in enumerate(observations):
            at = [f"knot {k}" for k in range(self.n_hinges)]
            if self.knots is not None:
                at = [f"{knot:.4g}" for knot in self.knots[row]]
            own += [f"{y} > {knot}" for knot in at]
        if self.products:
            own += [f"{u} * {y}" for u in inputs for y in observations]
        return common, own

    def common(self, past: FloatArray, us: FloatArray) -> FloatArray:
        """Return the features of both equations, (..., c).

        Parameters
        ----------
        past : ndarray, shape (..., n_past, q)
            Observations before the step, the latest first.
        us : ndarray, shape (..., k)
            Inputs of the new time.

        Returns
        -------
        ndarray, shape (..., c)
        """
        lead = past.shape[:-2]
        parts = [us, past[..., 1 : self.order, :].reshape(*lead, -1)]
        first = self.order
        for length in self.blocks:
            parts.append(past[..., first : first + length, :].mean(axis=-2))
            first += length
        return np.concatenate(parts, axis=-1)

    def unrolled(self, beta: FloatArray, q: int, k: int) -> tuple[FloatArray, FloatArray]:
        """Return coefficients of ``common`` as coefficients of past observations and of inputs.

        Parameters
        ----------
        beta : ndarray, shape (..., c)
            Coefficients.
        q, k : int
            Numbers of components of an observation and of inputs.

        Returns
        -------
        lags : ndarray, shape (..., n_past * q)
            Coefficients of the window, the latest observation first, without the coefficient of its own.
        inputs : ndarray, shape (..., k)
        """
        lags = np.zeros((*beta.shape[:-1], self.n_past, q))
        given = beta[..., k:].reshape(*beta.shape[:-1], -1, q)
        lags[..., 1 : self.order, :] = given[..., : self.order - 1, :]
        first = self.order
        for block, length in enumerate(self.blocks, self.order - 1):
            lags[..., first : first + length, :] = given[..., block, None, :] / length
            first += length
        return lags.reshape(*beta.shape[:-1], -1), beta[..., :k]

    def own(self, ys: FloatArray, us: FloatArray) -> FloatArray:
        """Return the features of a single equation, (..., o).

        Parameters
        ----------
        ys : ndarray, shape (..., q)
            The latest observation for Y', the new one for X'.
        us : ndarray, shape (..., k)
            Inputs of the new time.

        Returns
        -------
        ndarray, shape (..., o)
        """
        lead, parts = ys.shape[:-1], []
        if self.n_hinges:
            assert self.knots is not None  # learned by now
            parts.append(np.maximum(ys[..., None] - self.knots, 0.0).reshape(*lead, -1))
        if self.products:
            parts.append((us[..., :, None] * ys[..., None, :]).reshape(*lead, -1))
        return np.concatenate(parts, axis=-1) if parts else np.empty((*lead, 0))

    def linearised(self, mean: FloatArray, variance: FloatArray, us: FloatArray) -> Linearised:
        """Return the linearisation of ``own`` for a normally distributed observation.

        Products are linear.  For hinges, the mean, the covariance with the observation and the residual
        covariance are those under the normal distribution of each component.

        Parameters
        ----------
        mean, variance : ndarray, shape (..., q)
        us : ndarray, shape (..., k)

        Returns
        -------
        Linearised
        """
        lead, q = mean.shape[:-1], mean.shape[-1]
        h, k = self.n_hinges, us.shape[-1] if self.products else 0
        slope = np.zeros((*lead, q * h + k * q, q))
        level, left = np.zeros(slope.shape[:-1]), np.zeros((*slope.shape[:-1], slope.shape[-2]))
        for c in range(q if h else 0):
            rows = slice(c * h, (c + 1) * h)
            assert self.knots is not None
            moments = _hinge_moments(mean[..., c], variance[..., c], self.knots[c])
            slope[..., rows, c], level[..., rows], left[..., rows, rows] = moments
        for c in range(q if k else 0):
            slope[..., q * h + c :: q, c] = us
        return Linearised(slope, level, left)

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments as plain values.

        Returns
        -------
        dict
        """
        hinges = self.n_hinges if self.knots is None else self.knots.tolist()
        return {"order": self.order, "blocks": list(self.blocks), "hinges": hinges, "products": self.products}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Create features from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        WindowFeatures
        """
        return cls(**values)

    @shown
    def __repr__(self) -> str:
        options = [f"order={self.order}"] if self.order > 1 else []
        options += [f"blocks={self.blocks}"] if self.blocks else []
        options += [f"hinges={self.n_hinges}"] if self.n_hinges else []
        options += ["products=True"] if self.products else []
        return f"WindowFeatures({', '.join(options)})"


def _as_lengths(blocks: Any) -> tuple[int, ...]:
    """Return lengths of blocks."""
    if isinstance(blocks, str) or not isinstance(blocks, Iterable):
        raise ParameterError(f"blocks: got {brief(blocks)}, expected a sequence of whole numbers")
    return tuple(as_count("blocks", length, 1, MOST_LAGS) for length in blocks)


def _as_knots(hinges: Any) -> FloatArray:
    """Return knots (q, h)."""
    knots = as_numbers("hinges", hinges)
    if knots.ndim != 2:
        raise ShapeError(
            f"hinges: got {brief(hinges)}, expected a whole number, or knots of shape (q, h): a row for each "
            "component of an observation"
        )
    return as_array("hinges", knots, (None, None))


class Linearised(NamedTuple):
    """own(y, u) = slope y + level + noise, in mean and covariance."""

    slope: FloatArray  # (..., o, q)
    level: FloatArray  # (..., o)
    left: FloatArray  # (..., o, o): covariance of the noise


def _hinge_moments(
    mean: FloatArray, variance: FloatArray, knots: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slopes, levels (..., h) and covariances (..., h, h) of hinges of a normal number.

    With a = (mean - knot) / s and t standard normal, E max(y - knot, 0) = s (a Phi(a) + phi(a)), its
    covariance with y is s^2 Phi(a), and for a_i >= a_j, E of the product of two is
    s^2 [(1 + a_i a_j) Phi(a_j) + a_i phi(a_j)].
    """
    s = np.sqrt(variance)[..., None]
    certain = s == 0.0
    a = np.where(certain, np.where(mean[..., None] > knots, np.inf, -np.inf), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.where(certain, a, (mean[..., None] - knots) / s)
    slope = ndtr(a)
    finite = np.where(np.isfinite(a), a, 0.0)
    density = np.where(certain, 0.0, np.exp(-0.5 * finite * finite) / np.sqrt(2.0 * np.pi))
    value = np.where(certain, np.maximum(mean[..., None] - knots, 0.0), s * (finite * slope + density))
    low, high = (
        np.minimum(finite[..., :, None], finite[..., None, :]),
        np.maximum(finite[..., :, None], finite[..., None, :]),
    )
    phi = np.exp(-0.5 * low * low) / np.sqrt(2.0 * np.pi)
    second = (s * s)[..., None] * ((1.0 + low * high) * ndtr(low) + high * phi)
    left = second - value[..., :, None] * value[..., None, :]
    left -= (s * s)[..., None] * slope[..., :, None] * slope[..., None, :]
    left = np.where(certain[..., None], 0.0, left)
    slope = np.where(certain, 0.0, slope)
    return slope, value - slope * mean[..., None], 0.5 * (left + np.swapaxes(left, -1, -2))


def past_of(ys: FloatArray, lead: FloatArray, n_past: int) -> FloatArray:
    """Return what stands before each of n observations (n, q), the latest first: (n, n_past, q).

    Parameters
    ----------
    ys : ndarray, shape (n, q)
    lead : ndarray, shape (n_past, q)
        Observations before the first, in their order.
    """
    whole = np.concatenate([lead, ys])[:-1] if len(ys) else lead[:0]
    windows = np.lib.stride_tricks.sliding_window_view(whole, n_past, axis=0) if len(ys) else None
    if windows is None:
        return np.empty((0, n_past, ys.shape[1]))
    return np.moveaxis(windows, -1, 1)[:, ::-1]


def carried(ys: FloatArray) -> FloatArray:
    """Return observations (n, q) in which what is missing counts as the last value before it.

    Before the first value there is that one itself; a component that was never seen is zero.
    """
    n = len(ys)
    there = ~np.isnan(ys)
    last = np.maximum.accumulate(np.where(there, np.arange(n)[:, None], -1), axis=0)
    first = np.where(there.any(axis=0), there.argmax(axis=0), -1)
    at = np.where(last >= 0, last, first)
    return np.where(at >= 0, np.take_along_axis(ys, np.maximum(at, 0), axis=0), 0.0)
