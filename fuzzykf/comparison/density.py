"""The density of a state that a method claims: a mixture of normal laws, and its logarithm at the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import (
    LOG_2PI,
    RANK_TOLERANCE,
    as_numbers,
    as_real,
    logsumexp,
    mixture_moments,
    mixture_quantile,
    normal_quantile,
)
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.results import FilterResult

__all__ = ["NormalMixture", "normal_interval", "normal_log_score"]

#: Sums of weights may miss one by this much, and an error along a direction without spread may be this
#: share of the whole error: rounding.
ROUNDING = 1e-9


@reprs("weights", "means", "covariances")
@dataclass(frozen=True, kw_only=True, eq=False)
class NormalMixture:
    """Mixture of M normal distributions of the state at each of n steps.

    p(x_n) = sum over k of w_nk N(x_n; m_nk, P_nk)

    Parameters
    ----------
    weights : array_like, shape (n, M)
        Nonnegative weights that sum to one at each step.
    means : array_like, shape (n, M, m)
        Means of the components.
    covariances : array_like, shape (n, M, m, m)
        Covariances of the components; may be singular.

    Raises
    ------
    ShapeError
        If the shapes do not agree.
    ParameterError
        If a value is not finite, weights are inadmissible, or a variance is negative.

    Examples
    --------
    >>> import numpy as np
    >>> two = NormalMixture(
    ...     weights=[[0.5, 0.5]], means=[[[-2.0], [2.0]]], covariances=np.ones((1, 2, 1, 1))
    ... )
    >>> two.log_density([[2.0]]).round(3)
    array([-1.612])
    >>> [end.round(2).item() for end in two.interval(0.9)]
    [-3.28, 3.28]
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def __post_init__(self) -> None:
        """Check what was given."""
        given = {name: as_numbers(name, getattr(self, name)) for name in ("weights", "means", "covariances")}
        weights, means, covariances = given.values()
        if weights.ndim != 2 or weights.shape[1] == 0:
            raise ShapeError(f"weights: got shape {weights.shape}, expected (n, M) with M of at least 1")
        if means.ndim != 3 or means.shape[:2] != weights.shape or means.shape[2] == 0:
            n, M = weights.shape
            raise ShapeError(f"means: got shape {means.shape}, expected ({n}, {M}, m), as weights has it")
        if covariances.shape != (*means.shape, means.shape[2]):
            raise ShapeError(
                f"covariances: got shape {covariances.shape}, expected {(*means.shape, means.shape[2])}"
            )
        for name, array in given.items():
            if not np.isfinite(array).all():
                k = int(np.argwhere(~np.isfinite(array))[0, 0])
                raise ParameterError(f"{name}: got NaN or infinity at step {k}, expected finite numbers")
            object.__setattr__(self, name, array)
        wrong = (weights < 0.0).any(axis=1) | (abs(weights.sum(axis=1) - 1.0) > ROUNDING)
        if wrong.any():
            k = int(np.argmax(wrong))
            raise ParameterError(
                f"weights: got {weights[k].tolist()} at step {k}, expected at least 0 and the sum 1"
            )
        variances = np.diagonal(covariances, axis1=-2, axis2=-1)
        if (variances < 0.0).any():
            k = int(np.argwhere(variances < 0.0)[0, 0])
            raise ParameterError(
                f"covariances: got a variance of {variances[k].min():g} at step {k}, expected at least 0"
            )

    @classmethod
    def of(cls, result: FilterResult, rows: slice = slice(None)) -> Self:
        """Create the mixture over nodes of a filter result with ``keep_nodes=True``.

        The distribution given a node is approximated by a normal one with the same mean and covariance.

        Parameters
        ----------
        result : FilterResult
        rows : slice
            Steps to use; by default all.

        Returns
        -------
        NormalMixture

        Raises
        ------
        ParameterError
            If the result does not have the nodes.
        """
        found: Any = result
        if found.mu is None or found.node_x is None or found.node_P is None:
            raise ParameterError(
                "result: it holds no mu, node_x and node_P, expected one with keep_nodes=True"
            )
        return cls(weights=found.mu[rows], means=found.node_x[rows], covariances=found.node_P[rows])

    @classmethod
    def normal(cls, mean: FloatArray, std: FloatArray) -> Self:
        """Create a single normal distribution with independent components at each step.

        Parameters
        ----------
        mean, std : ndarray, shape (n, m)

        Returns
        -------
        NormalMixture
        """
        variances = np.asarray(std)[..., None] ** 2 * np.eye(np.shape(std)[-1])
        return cls(
            weights=np.ones((len(mean), 1)), means=np.asarray(mean)[:, None], covariances=variances[:, None]
        )

    @classmethod
    def pooled(cls, parts: Sequence[NormalMixture], weights: Sequence[float]) -> Self:
        """Create the linear opinion pool of mixtures: the sum over j of weight_j p_j.

        Parameters
        ----------
        parts : sequence of NormalMixture
            Of the same steps.
        weights : sequence of float
            Nonnegative, with sum one.

        Returns
        -------
        NormalMixture
        """
        shares = [weight * one.weights for weight, one in zip(weights, parts, strict=True)]
        return cls(
            weights=np.concatenate(shares, axis=1),
            means=np.concatenate([one.means for one in parts], axis=1),
            covariances=np.concatenate([one.covariances for one in parts], axis=1),
        )

    @classmethod
    def joined(cls, parts: Sequence[NormalMixture]) -> Self:
        """Concatenate mixtures in time; missing components get weight zero.

        Parameters
        ----------
        parts : sequence of NormalMixture
            Of consecutive steps.

        Returns
        -------
        NormalMixture
        """
        most = max(one.n_components for one in parts)

        def filled(array: FloatArray) -> FloatArray:
            room = [(0, 0), (0, most - array.shape[1]), *[(0, 0)] * (array.ndim - 2)]
            return np.pad(array, room)

        return cls(
            weights=np.concatenate([filled(one.weights) for one in parts]),
            means=np.concatenate([filled(one.means) for one in parts]),
            covariances=np.concatenate([filled(one.covariances) for one in parts]),
        )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.weights)

    @property
    def n_components(self) -> int:
        """Number of components M at each step."""
        return int(self.weights.shape[1])

    @property
    def dim_x(self) -> int:
        """Number of components of the state, m."""
        return int(self.means.shape[2])

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of each component of the state.

        Returns
        -------
        mean, std : ndarray, shape (n, m)
        """
        mean, covariance = mixture_moments(self.weights, self.means, self.covariances)
        return mean, np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))

    def log_density(self, x: ArrayLike) -> FloatArray:
        """Return the joint log-density of states.

        Parameters
        ----------
        x : array_like, shape (n, m)
            States.  NaN where unknown: the density is that of the known components, and 0 if there is none.

        Returns
        -------
        ndarray of shape (n,)
            Infinite if a component with zero variance is exact, minus infinity if all components have zero
            variance and are wrong.

        Raises
        ------
        ShapeError
            If ``x`` has the wrong shape.
        """
        states = as_numbers("x", x)
        if states.shape != (len(self), self.dim_x):
            raise ShapeError(f"x: got shape {states.shape}, expected {(len(self), self.dim_x)}")
        known = ~np.isnan(states)
        total = np.zeros(len(self))
        for part in np.unique(known, axis=0):  # which components are known
            rows = (known == part).all(axis=1)
            if part.any():
                error = states[rows][:, None, part] - self.means[rows][..., part]
                each = _log_normal(error, self.covariances[rows][..., part, :][..., part])
                weights = self.weights[rows]
                with np.errstate(divide="ignore", invalid="ignore"):  # the log of no weight, and its sum
                    total[rows] = logsumexp(np.where(weights > 0.0, np.log(weights) + each, -np.inf))
        return total

    def interval(self, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Return the central interval of each component, by quantiles.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        lower, upper : ndarray, shape (n, m)

        Raises
        ------
        ParameterError
            If ``level`` is not between 0 and 1.
        """
        tail = _tail(level)
        std = np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1))
        weights = self.weights[..., None]
        return (
            mixture_quantile(tail, weights, self.means, std),
            mixture_quantile(1.0 - tail, weights, self.means, std),
        )


def _log_normal(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Log of N(error; 0, P), shapes (..., k) and (..., k, k), for P that may be singular.

    Along the principal axes of the correlations, so that units do not matter: without spread along an axis
    the density is infinite where the error along it is none but rounding, and zero elsewhere.
    """
    deviation = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    unit = np.where(deviation > 0.0, deviation, 1.0)
    values, axes = np.linalg.eigh(covariance / unit[..., :, None] / unit[..., None, :])
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        along = (np.swapaxes(axes, -1, -2) @ (error / unit)[..., None])[..., 0]
        spread: BoolArray = values > RANK_TOLERANCE
        each = np.where(spread, -0.5 * (along**2 / values + LOG_2PI + np.log(values)), np.inf)
        allowed = ROUNDING * np.linalg.norm(along, axis=-1, keepdims=True)
        wrong = (~spread & (np.abs(along) > allowed)) | ~np.isfinite(along) | np.isneginf(each)
        total = each.sum(axis=-1) - np.log(unit).sum(axis=-1)
    return np.where(wrong.any(axis=-1), -np.inf, total)


def normal_interval(mean: FloatArray, std: FloatArray, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the central interval of normal laws.

    Raises
    ------
    ParameterError
        If ``level`` is not between 0 and 1.
    """
    half = normal_quantile(1.0 - _tail(level)) * std
    return mean - half, mean + half


def _tail(level: float) -> float:
    if not 0.0 < as_real("level", level, "a number between 0 and 1") < 1.0:
        raise ParameterError(f"level: got {level}, expected a number between 0 and 1")
    return 0.5 * (1.0 - level)


def normal_log_score(error: FloatArray, std: FloatArray) -> FloatArray:
    """Log-density of errors under independent normal laws of mean zero, summed over the components.

    log p = -sum over k of (e_k^2 / s_k^2 + log s_k^2 + log 2 pi) / 2

    Parameters
    ----------
    error : ndarray, shape (n, m)
        NaN where unknown: such components do not count.
    std : ndarray, shape (n, m)
        Numbers of at least 0.  Who claims certainty (0) has a density of infinity where
        right, and of zero where wrong, whatever the other components are.

    Returns
    -------
    ndarray of shape (n,)

    Examples
    --------
    >>> import numpy as np
    >>> normal_log_score(
    ...     np.array([[0.0], [2.0], [2.0]]), np.array([[1.0], [1.0], [0.0]])
    ... ).round(3)
    array([-0.919, -2.919,   -inf])
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = np.where(error == 0.0, 0.0, error / std)
        each = -0.5 * (ratio**2 + LOG_2PI) - np.log(std)
    each = np.where(np.isinf(ratio), -np.inf, each)  # at a std of zero the two infinities have no sum
    wrong = np.isneginf(each).any(axis=1, keepdims=True)
    rest = np.nansum(np.where(wrong, 0.0, each), axis=1)
    total: FloatArray = np.where(np.squeeze(wrong, axis=1), -np.inf, rest)
    return total
