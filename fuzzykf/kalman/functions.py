"""The Kalman filter as functions on x and P, with the interface of filterpy's.

x may be a number, a flat vector or a column; the results have the same form.
Scalars stand for multiples of the identity wherever a matrix is expected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import predict_linear, seen_components
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_flag, as_numbers, as_real
from fuzzykf.kalman.arguments import as_covariance, check_in_range, control_term, observation_matrix
from fuzzykf.kalman.series import as_listed, per_step, run_batch
from fuzzykf.kalman.updates import condition_linear, log_density, observed
from fuzzykf.kalman.variants import update_with_gain
from fuzzykf.observations import check_aligned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, Numbers
    from fuzzykf.kalman.series import PerStep

__all__ = ["batch_filter", "predict", "predict_steadystate", "update", "update_steadystate"]


def _vector(x: ArrayLike) -> FloatArray:
    """Return x as a flat vector or a column; a number becomes a flat vector."""
    value = as_numbers("x", x)
    if value.ndim > 2 or (value.ndim == 2 and value.shape[1] != 1) or value.size == 0:
        raise ShapeError(f"x: got shape {value.shape}, expected a scalar, (n,) or (n, 1)")
    return as_array("x", np.atleast_1d(value), (None,) if value.ndim < 2 else (None, 1))


def _transition(F: Any, n: int) -> FloatArray:
    F = as_numbers("F", F)
    return float(F) * np.eye(n) if F.ndim == 0 else as_array("F", F, (n, n))


def _observation(H: Any, n: int) -> FloatArray:
    """Return H as a matrix; None, or a number, stands for a multiple of the identity."""
    if H is None:
        return np.eye(n)
    H = as_numbers("H", H)
    if np.ndim(H) == 0:
        return as_real("H", H) * np.eye(n)
    if np.ndim(H) == 1 and n == 1:
        H = np.reshape(H, (-1, 1))
    return observation_matrix("H", H, n, n)


def _like(value: FloatArray, pattern: Any) -> Any:
    """Return a number where the caller gave one, else the array."""
    return value.reshape(-1)[0] if np.ndim(pattern) == 0 else value


def predict(
    x: ArrayLike,
    P: ArrayLike,
    F: ArrayLike = 1,
    Q: ArrayLike = 0,
    u: ArrayLike = 0,
    B: ArrayLike = 1,
    alpha: float = 1.0,
) -> tuple[Any, Any]:
    """Predict the state: F x + B u and alpha^2 F P F' + Q.

    Parameters
    ----------
    x : array_like, a number or shape (n,) or (n, 1)
        Estimate of the state.
    P : array_like, shape (n, n)
        Its covariance.
    F, Q : array_like, shape (n, n)
        Transition and covariance of the process noise.
    u, B : array_like
        Control input and control matrix.
    alpha : float
        Fading memory, at least 1.

    Returns
    -------
    x, P : ndarray or float
        Same form as the arguments.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes do not agree, or P or Q is not a covariance.

    Examples
    --------
    >>> x, P = predict(x=10.0, P=3.0, u=1.0, Q=4.0)
    >>> float(x), float(P)
    (11.0, 7.0)
    """
    mean = _vector(x)
    n = mean.shape[0]
    covariance, noise = as_covariance("P", P, n), as_covariance("Q", Q, n)
    alpha = as_real("alpha", alpha, "a number of at least 1 and less than 1e150")
    if not 1.0 <= alpha < 1e150:
        raise ParameterError(f"alpha: got {alpha!r}, expected a number of at least 1 and less than 1e150")
    moved, covariance = predict_linear(mean, covariance, _transition(F, n), noise, alpha * alpha)
    moved = moved + control_term(B, u, mean)
    check_in_range(x=moved, P=covariance)
    return _like(moved, x), _like(covariance, P)


def update(
    x: ArrayLike,
    P: ArrayLike,
    z: Numbers,
    R: ArrayLike,
    H: ArrayLike | None = None,
    return_all: bool = False,
) -> tuple[Any, ...]:
    """Take an observation into account.

    Parameters
    ----------
    x : array_like, a number or shape (n,) or (n, 1)
        Predicted state.
    P : array_like, shape (n, n)
        Its covariance.
    z : array_like
        Observation of m components; None or NaN where missing.
    R : array_like, shape (m, m)
        Covariance of its noise.
    H : array_like, shape (m, n), optional
        Observation matrix; by default the identity.
    return_all : bool
        Return y, K, S and the log-likelihood as well.

    Returns
    -------
    x, P : ndarray or float
        Same form as the arguments.
    y, K, S : ndarray
        Residual, gain and covariance of the residual; None if z is missing.
    log_likelihood : float
        Log-density of z; None if z is missing.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes do not agree, P or R is not a covariance, or S cannot be inverted.

    Examples
    --------
    >>> x, P = update(x=1.0, P=1.0, z=2.0, R=1.0)
    >>> float(x), float(P)
    (1.5, 0.5)
    """
    mean = _vector(x)
    n = mean.shape[0]
    covariance, matrix = as_covariance("P", P, n), _observation(H, n)
    m = matrix.shape[0]
    noise = as_covariance("R", R, m)
    value = observed(z, m, mean)
    if value is None:
        return (x, P, None, None, None, None) if return_all else (x, P)
    mean, covariance, y, S, _, K = condition_linear(
        mean, covariance, value, matrix, noise, np.eye(n), np.linalg.inv
    )
    check_in_range(x=mean, P=covariance)
    estimate = _like(mean, x), _like(covariance, P)
    if not return_all:
        return estimate
    log_likelihood = log_density(y, S, seen_components(value))
    return *estimate, y, K.ravel() if np.ndim(x) == 0 else K, _like(S, P), log_likelihood


def predict_steadystate(x: ArrayLike, F: ArrayLike = 1, u: ArrayLike = 0, B: ArrayLike = 1) -> Any:
    """Predict the state without its covariance: F x + B u.

    Parameters
    ----------
    x, F, u, B
        As in `predict`.

    Returns
    -------
    ndarray or float
        In the form of ``x``.

    Examples
    --------
    >>> float(predict_steadystate(2.0, F=0.5, u=1.0))
    2.0
    """
    mean = _vector(x)
    transition = _transition(F, mean.shape[0])
    with np.errstate(over="ignore", invalid="ignore"):
        moved: FloatArray = transition.dot(mean) + control_term(B, u, mean)
    check_in_range(x=moved)
    return _like(moved, x)


def update_steadystate(x: ArrayLike, z: Numbers, K: ArrayLike, H: ArrayLike | None = None) -> Any:
    """Update the state with a given gain: x + K (z - H x).

    Parameters
    ----------
    x, z, H
        As in `update`; missing components of z change nothing.
    K : array_like, shape (n, m)
        Gain.

    Returns
    -------
    ndarray or float
        In the form of ``x``.

    Examples
    --------
    >>> float(update_steadystate(1.0, z=2.0, K=0.25))
    1.25
    """
    mean = _vector(x)
    matrix = _observation(H, mean.shape[0])
    given = as_numbers("K", K)
    gain = as_array("K", given.reshape(1, 1) if given.size == 1 else given, (mean.shape[0], matrix.shape[0]))
    value = observed(z, matrix.shape[0], mean)
    if value is None:
        return x
    moved, _, _ = update_with_gain(mean, value, matrix, gain)
    check_in_range(x=moved)
    return _like(moved, x)


def batch_filter(
    x: ArrayLike,
    P: ArrayLike,
    zs: Sequence[Numbers] | PerStep,
    Fs: PerStep,
    Qs: PerStep,
    Hs: PerStep,
    Rs: PerStep,
    Bs: PerStep | None = None,
    us: PerStep | None = None,
    update_first: bool = False,
    saver: Any = None,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Filter a series with given matrices for each step.

    Parameters
    ----------
    x, P : array_like, shapes (dim_x,) or (dim_x, 1), and (dim_x, dim_x)
        Where the series starts.
    zs : sequence of n observations
        None or NaN where missing.
    Fs, Qs, Hs, Rs : sequence of n matrices
    Bs, us : sequence of n values, optional
        Control matrices and controls.  A pandas index must equal that of ``zs``.
    update_first : bool
        Update before predicting, instead of after it.
    saver : filterpy.common.Saver, optional
        Its ``save`` is called after each step.

    Returns
    -------
    means, covariances, means_p, covariances_p : ndarray
        After the updates and after the predictions; means of shape (n, dim_x, 1), or
        (n, dim_x) if x is flat.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        As from `predict` and `update`.

    Examples
    --------
    >>> import numpy as np
    >>> one = [np.eye(1)] * 2
    >>> means, *_ = batch_filter(np.zeros(1), np.eye(1), [1.0, 2.0], one, one, one, one)
    >>> means.ravel().round(3)
    array([0.667, 1.5  ])
    """
    mean: Any = _vector(x)
    given = {"Fs": Fs, "Qs": Qs, "Hs": Hs, "Rs": Rs, "Bs": Bs, "us": us}
    check_aligned(zs=zs, **given)
    observations = as_listed("zs", zs, 0)
    n, d = len(observations), mean.shape[0]
    covariance: Any = as_covariance("P", P, d)
    F, Q, H, R, B, u = (per_step(name, values, n) for name, values in given.items())

    def move(k: int) -> tuple[Any, Any]:
        nonlocal mean, covariance
        mean, covariance = predict(mean, covariance, F[k], Q[k], u[k], B[k])
        return mean, covariance

    def look(k: int) -> tuple[Any, Any]:
        nonlocal mean, covariance
        mean, covariance = update(mean, covariance, observations[k], R[k], H[k])
        return mean, covariance

    return run_batch(n, mean.shape, move, look, as_flag("update_first", update_first), saver)
