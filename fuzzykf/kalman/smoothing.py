"""The smoother of Rauch, Tung and Striebel on the output of a filter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import FilterResult
from fuzzykf.engine.selected import predict_linear, rts_gains, smooth_linear
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.kalman.arguments import as_matrix, as_square, check_in_range, control_term
from fuzzykf.kalman.series import FIELDS, as_listed
from fuzzykf.observations import check_aligned

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.kalman.series import PerStep

__all__ = [
    "LinearMotions",
    "check_motion",
    "rts_smoother",
    "smooth_moments",
    "smooth_result",
]

#: How far, in parts of the largest number, what was predicted may be off what the attributes say.
_ROUNDING = 1e-9


def rts_smoother(
    Xs: ArrayLike,
    Ps: ArrayLike,
    Fs: PerStep,
    Qs: PerStep,
    inv: Callable[[Any], Any] = np.linalg.inv,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Smooth the means and covariances that `batch_filter` returned.

    Parameters
    ----------
    Xs : array_like, shape (n, dim_x) or (n, dim_x, 1)
        Filtered means.
    Ps : array_like, shape (n, dim_x, dim_x)
        Filtered covariances.
    Fs, Qs : sequence of n arrays (dim_x, dim_x)
        Transitions and covariances of the process noise.  Those of index k lead from
        step k - 1 to step k, as in `batch_filter`; the first of each is not used.  What has an index of
        pandas here has one index.
    inv : callable
        Inverts the predicted covariances; `numpy.linalg.pinv` where they are singular.

    Returns
    -------
    x, P : ndarray
        Smoothed means and covariances, in the shapes of ``Xs`` and ``Ps``.
    K : ndarray, shape (n, dim_x, dim_x)
        Gains of the smoother; the last is zero.
    Pp : ndarray, shape (n, dim_x, dim_x)
        ``Pp[k]`` is the covariance of step k + 1 predicted from step k; the last is ``Ps[-1]``.

    Raises
    ------
    ShapeError
        If the lengths or shapes do not agree.

    Notes
    -----
    Control inputs are not known here: x^s_k = x_k + K_k (x^s_{k+1} - F x_k) takes
    the state to move by F alone, as filterpy's function does.  With control inputs,
    or fading memory, use `KalmanFilter.smooth`.

    References
    ----------
    H. E. Rauch, F. Tung, C. T. Striebel, Maximum likelihood estimates of linear
    dynamic systems, AIAA Journal 3 (1965), 1445-1450.

    Examples
    --------
    >>> import numpy as np
    >>> means, covariances = np.array([[0.0], [1.0]]), np.ones((2, 1, 1))
    >>> x, P, K, Pp = rts_smoother(means, covariances, [np.eye(1)] * 2, [np.eye(1)] * 2)
    >>> x.ravel(), P.ravel()
    (array([0.5, 1. ]), array([0.75, 1.  ]))
    """
    check_aligned(Xs=Xs, Ps=Ps, Fs=Fs, Qs=Qs)
    x, P = as_numbers("Xs", Xs).copy(), as_numbers("Ps", Ps).copy()
    if x.ndim == 0 or P.ndim == 0:
        raise ShapeError(f"Xs, Ps: got shapes {x.shape} and {P.shape}, expected one entry a step")
    n = len(x)
    if len(P) != n:
        raise ShapeError(f"Ps: got {len(P)} covariances, expected {n}, one for each of Xs")
    d = x.shape[1] if x.ndim > 1 else 0
    if x.shape not in {(n, d), (n, d, 1)} or P.shape != (n, d, d):
        raise ShapeError(f"Xs, Ps: got shapes {x.shape} and {P.shape}, expected (n, dim_x[, 1]) and squares")
    transitions, noises = as_listed("Fs", Fs, n), as_listed("Qs", Qs, n)
    for name, values in (("Fs", transitions), ("Qs", noises)):
        if len(values) < n:
            raise ShapeError(f"{name}: got {len(values)} matrices, expected {n}, one for each of Xs")
    for name, array in (("Xs", x), ("Ps", P)):
        if not np.isfinite(array).all():
            raise ParameterError(f"{name}: got NaN or infinity, expected finite numbers")
    K, Pp = np.zeros((n, d, d)), P.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n - 2, -1, -1):
            F = as_matrix(f"Fs[{k + 1}]", transitions[k + 1], (d, d))
            Q = as_square(f"Qs[{k + 1}]", noises[k + 1], d)
            for name, matrix in (("Fs", F), ("Qs", Q)):
                if not np.isfinite(matrix).all():
                    raise ParameterError(f"{name}[{k + 1}]: got NaN or infinity, expected finite numbers")
            Pp[k] = F.dot(P[k]).dot(F.T) + Q
            K[k] = P[k].dot(F.T).dot(inv(Pp[k]))
            x[k] += K[k].dot(x[k + 1] - F.dot(x[k]))
            P[k] += K[k].dot(P[k + 1] - Pp[k]).dot(K[k].T)
    check_in_range(x=x, P=P)
    return x, P, K, Pp


def smooth_moments(
    x: FloatArray,
    P: FloatArray,
    x_prior: FloatArray,
    P_prior: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    alpha_sq: float,
) -> tuple[FloatArray, FloatArray]:
    """Smooth from the predictions that the filter made, whatever went into them.

    Parameters
    ----------
    x, x_prior : ndarray, shape (n, d)
    P, P_prior, F : ndarray, shape (n, d, d)
        ``F[k]`` leads to step k (the Jacobian, in the extended filter).
    Q : ndarray, shape (d, d) or (n, d, d)
    alpha_sq : float
        Square of the fading memory; it acts as process noise (alpha^2 - 1) F P F' more.

    Returns
    -------
    x, P : ndarray, shapes (n, d) and (n, d, d)
    """
    noise = np.broadcast_to(Q, F.shape)[1:]
    F, before = F[1:], P[:-1]
    C = rts_gains(before, P_prior[1:], F)
    if alpha_sq != 1.0:
        noise = noise + (alpha_sq - 1.0) * (F @ before @ np.swapaxes(F, -1, -2))
    return smooth_linear(x, P, x_prior, C, F, noise)


def smooth_result(forward: FilterResult, F: FloatArray, Q: FloatArray, alpha_sq: float = 1.0) -> FilterResult:
    """Smooth what a filter found on its way forward; F, Q and ``alpha_sq`` as in `smooth_moments`."""
    x, P, x_prior, P_prior = (getattr(forward, name) for name in FIELDS[:4])
    x, P = smooth_moments(x, P, x_prior, P_prior, F, Q, alpha_sq)
    check_in_range(x=x, P=P)
    return FilterResult(
        x=x, P=P, log_likelihood=forward.log_likelihood, index=forward.index, coords=forward.coords
    )


def check_motion(
    filter_: Any, k: int | None, expected: FloatArray | None, covariance: FloatArray, motion: str
) -> None:
    """Refuse to smooth where a predict of somebody else's did something that the way back does not know.

    Parameters
    ----------
    filter_ : GaussianFilter
        After its prediction.
    k : int or None
        Number of the step; None where they are not counted.
    expected : ndarray or None
        What x should be; None where any will do.
    covariance : ndarray, shape (d, d)
        What P should be.
    motion : str
        The attributes that say so.

    Raises
    ------
    ParameterError
        If x or P are others, or ``x_prior`` and ``P_prior`` are not what they are now.
    """
    f, same = filter_, [("P", filter_.P, covariance), ("P_prior", filter_.P_prior, covariance)]
    same += [("x_prior", f.x_prior, f.x)] + ([] if expected is None else [("x", f.x, expected)])
    for name, got, value in same:
        shape = np.shape(value)
        size = max(np.abs(value).max(initial=0.0), np.finfo(np.float64).tiny)
        if np.shape(got) != shape or not (np.abs(np.subtract(got, value)) <= _ROUNDING * size).all():
            when = "predict" if k is None else f"predict of step {k}"
            raise ParameterError(
                f"smooth: after {when}, {name} of this {type(f).__name__} is "
                f"{np.asarray(got).tolist()}, but {motion} lead to {np.asarray(value).tolist()}; the way "
                "back knows of no other motion: let predict set these attributes, or override smooth as well"
            )


class LinearMotions:
    """How the state of a Kalman filter moved along a series, which verbs of somebody else may change.

    Parameters
    ----------
    filter_ : KalmanFilter
    moves : sequence of n mappings
        The arguments of each prediction.

    Attributes
    ----------
    F, noise : ndarray, shape (n, d, d)
        Transition to each step, and what covariance came with it.
    """

    def __init__(self, filter_: Any, moves: Sequence[Mapping[str, Any]]) -> None:
        self.filter, self.moves = filter_, moves
        self.F, self.noise = np.empty((2, len(moves), filter_.dim_x, filter_.dim_x))

    def __call__(self, k: int, x: FloatArray, P: FloatArray) -> None:
        """Keep the motion of step k, between its verbs; x and P are those before it."""
        f, d = self.filter, self.filter.dim_x
        told, alpha_sq = self.moves[k], f._alpha_sq
        F, Q = as_matrix("F", told.get("F", f.F), (d, d)), as_square("Q", told.get("Q", f.Q), d)
        expected, covariance = predict_linear(x, P, F, Q, alpha_sq)
        if told.get("u") is not None:
            expected = expected + control_term(f.B, told["u"], x)
        check_motion(f, k, expected, covariance, "F, Q, B, alpha and us")
        self.F[k], self.noise[k] = F, Q + (alpha_sq - 1.0) * F.dot(P).dot(F.T)
