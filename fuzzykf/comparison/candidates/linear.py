"""One linear model for all times (Kalman filter), and one per regime (IMM)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.comparison.candidates import WARM_UP, Candidate, Estimates, Learned
from fuzzykf.comparison.density import NormalMixture
from fuzzykf.errors import FuzzykfError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import LearningPart

__all__ = [
    "CANDIDATES",
    "LearnedIMM",
    "LearnedKalman",
    "LinearModel",
    "fit_linear_model",
    "learn_imm",
    "learn_kalman",
]


@dataclass(frozen=True, eq=False)
class LinearModel:
    """The law of Z = (X, Y) as one Gaussian autoregression of order one.

    Z' = offset + transition Z + N(0, noise), the best linear model of that order: the usual
    X' = A X + U, Y' = B X' + V, whatever the correlation of U and V, is a special case.

    Attributes
    ----------
    transition, noise : ndarray, shape (d, d)
    offset : ndarray, shape (d,)
    mean, covariance : ndarray, shapes (d,) and (d, d)
        Moments of Z in the learning part, from which a filter starts.
    """

    transition: FloatArray
    offset: FloatArray
    noise: FloatArray
    mean: FloatArray
    covariance: FloatArray

    def new_filter(self, kalman_filter: Any, dim_x: int) -> Any:
        """Return a Kalman filter on the model: fuzzykf's or filterpy's; the calls are the same.

        Its state is (X, Y), of which Y is observed without noise; the offset is a control
        that is always one.
        """
        d = len(self.mean)
        f = kalman_filter(dim_x=d, dim_z=d - dim_x, dim_u=1)
        f.x, f.P = self.mean[:, None].copy(), self.covariance.copy()
        f.F, f.Q = self.transition.copy(), self.noise.copy()
        f.B = self.offset[:, None].copy()
        f.H, f.R = np.eye(d)[dim_x:], np.zeros((d - dim_x, d - dim_x))
        return f


#: The control that multiplies the offset.
_ONE = np.ones((1, 1))


def fit_linear_model(x: FloatArray, y: FloatArray, weight: FloatArray | None = None) -> LinearModel:
    """Fit a `LinearModel` by maximum likelihood, given the first row: by least squares.

    Parameters
    ----------
    x, y : ndarray, shapes (n, m) and (n, q)
        NaN where missing; steps with something missing do not count.
    weight : ndarray, shape (n,), optional
        How much the step *to* each row counts.

    Raises
    ------
    FuzzykfError
        If fewer steps count than a regression needs.
    """
    z = np.concatenate([x, y], axis=1)
    d = z.shape[1]
    complete = np.isfinite(z).all(axis=1)
    mean = z[complete].mean(axis=0)
    deviation = z - mean
    steps = np.flatnonzero(complete[:-1] & complete[1:])
    share = np.ones(len(steps)) if weight is None else weight[steps + 1]
    total = float(share.sum())
    if total < 5.0 * (d + 1):
        raise FuzzykfError(
            f"a linear model of {d} components needs {5 * (d + 1)} steps at least, and has {total:.3g}"
        )
    root = np.sqrt(share)[:, None]
    design = np.column_stack([np.ones(len(steps)), deviation[steps]])
    coefficients, *_ = np.linalg.lstsq(root * design, root * deviation[steps + 1])
    residual = root * (deviation[steps + 1] - design @ coefficients)
    transition = coefficients[1:].T
    return LinearModel(
        transition=transition,
        offset=coefficients[0] + mean - transition @ mean,
        noise=residual.T @ residual / total,
        mean=mean,
        covariance=deviation[complete].T @ deviation[complete] / complete.sum(),
    )


class _LearnedLinear(Learned):
    """A filter of (X, Y) with predict(u), update(z), x, P and log_likelihood."""

    dim_x: int
    feedback = True

    @abstractmethod
    def _new_filter(self) -> Any: ...

    def _components(self, f: Any) -> tuple[Any, Any, Any]:
        """Return weights (M,), means (M, d) and covariances (M, d, d) of the normal laws of (X, Y)."""
        return np.ones(1), f.x.T, f.P[None]

    def restore(self, before: FloatArray, zs: FloatArray) -> Estimates:
        """Run the filter, beginning a little earlier; the density is that of the state, of all modes."""
        warm = before[-WARM_UP:]
        n, m = len(warm) + len(zs), self.dim_x
        mean, variance, log_likelihood = np.empty((n, m)), np.empty((n, m)), np.empty(n)
        f = self._new_filter()
        M = len(self._components(f)[0])
        weights, means, covariances = np.empty((n, M)), np.empty((n, M, m)), np.empty((n, M, m, m))
        for k, z in enumerate(np.concatenate([warm, zs])):
            if k > 0:  # the first observation belongs to the law that the filter starts from
                f.predict(_ONE)
            f.update(None if np.isnan(z).all() else z)
            mean[k], variance[k], log_likelihood[k] = f.x[:m, 0], np.diagonal(f.P)[:m], f.log_likelihood
            weights[k], x, P = self._components(f)
            means[k], covariances[k] = x[:, :m], P[:, :m, :m]
        part = slice(len(warm), None)
        return Estimates(
            mean=mean[part],
            std=np.sqrt(variance[part]),
            log_likelihood=log_likelihood[part],
            density=NormalMixture(weights=weights[part], means=means[part], covariances=covariances[part]),
        )

    def stepper(self) -> Callable[[FloatArray], object]:
        """Return predict and update."""
        f = self._new_filter()

        def step(z: FloatArray) -> None:
            f.predict(_ONE)
            f.update(z)

        return step


class LearnedKalman(_LearnedLinear):
    """A Kalman filter on one linear model.

    Parameters
    ----------
    model : LinearModel
    dim_x : int
    kalman_filter : type
        fuzzykf's KalmanFilter or filterpy's.
    """

    def __init__(self, model: LinearModel, dim_x: int, kalman_filter: Any) -> None:
        self.model, self.dim_x, self._class = model, dim_x, kalman_filter

    def _new_filter(self) -> Any:
        return self.model.new_filter(self._class, self.dim_x)


def learn_kalman(part: LearningPart, kalman_filter: Any = None) -> Learned:
    """Learn the best single linear model.

    Parameters
    ----------
    part : LearningPart
    kalman_filter : type, optional
        fuzzykf's KalmanFilter by default.
    """
    if kalman_filter is None:
        from fuzzykf.kalman import KalmanFilter as kalman_filter
    return LearnedKalman(fit_linear_model(part.x, part.y), part.x.shape[1], kalman_filter)


class LearnedIMM(_LearnedLinear):
    """An IMM estimator on one linear model per regime.

    Parameters
    ----------
    models : list of LinearModel
    transition : ndarray, shape (K, K)
    initial : ndarray, shape (K,)
    dim_x : int
    """

    def __init__(
        self, models: list[LinearModel], transition: FloatArray, initial: FloatArray, dim_x: int
    ) -> None:
        self.models, self.transition, self.initial, self.dim_x = models, transition, initial, dim_x

    def _new_filter(self) -> Any:
        from fuzzykf.kalman import IMMEstimator, KalmanFilter

        members = [model.new_filter(KalmanFilter, self.dim_x) for model in self.models]
        return IMMEstimator(members, self.initial, self.transition)

    def _components(self, f: Any) -> tuple[Any, Any, Any]:
        modes = f.filters
        return f.mu, np.stack([one.x[:, 0] for one in modes]), np.stack([one.P for one in modes])


def learn_imm(part: LearningPart) -> Learned:
    """Learn an IMM estimator with the two regimes of the learned hard model.

    The hard model says how likely each row is in which regime, and how the regimes follow
    one another.  In each regime a linear model is fitted to the rows, weighted by this, in which
    the observation may depend on the state before it; so the IMM has the feedback that an exact
    filter has to do without.

    Raises
    ------
    FuzzykfError
        If the hard model cannot be learned, or one of its regimes is hardly visited.
    """
    fit = part.hard(2)
    second = np.nan_to_num(np.asarray(fit.switch_mean, dtype=np.float64))  # incomplete rows do not count
    second = np.clip(second, 0.0, 1.0)  # probabilities, but for rounding
    models = []
    for regime, weight in enumerate((1.0 - second, second)):
        try:
            models.append(fit_linear_model(part.x, part.y, weight))
        except FuzzykfError as error:
            raise FuzzykfError(f"regime {regime} of the hard model is too rare: {error}") from error
    return LearnedIMM(models, fit.model.transition, fit.model.initial, part.x.shape[1])


CANDIDATES = (
    Candidate("imm", learn_imm, title="IMMEstimator"),
    Candidate("kalman", learn_kalman, title="KalmanFilter"),
)
