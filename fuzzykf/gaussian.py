"""Gaussian and mixture algebra in the log domain, and the proof of positive definiteness.

Pure functions on arrays.  Leading axes broadcast; the last one or two axes are
the vector and the matrix.
"""

from __future__ import annotations

from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.missing import as_floats

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = [
    "LOG_2PI",
    "RANK_TOLERANCE",
    "as_array",
    "as_choice",
    "as_flag",
    "as_numbers",
    "as_real",
    "brief",
    "check_broadcast",
    "check_covariance",
    "check_definite",
    "cholesky",
    "condition",
    "covariance_root",
    "is_complex",
    "is_whole",
    "log_density",
    "logsumexp",
    "lower_factor",
    "mixture_moments",
    "mixture_quantile",
    "mixture_root",
    "normal_quantile",
    "semidefinite_root",
    "solve_lower",
    "square",
    "symmetrize",
    "whitening",
]

LOG_2PI = float(np.log(2.0 * np.pi))

#: A covariance may be indefinite by this much, relative to its largest eigenvalue,
#: before it is refused: the size of the rounding error in the products it comes from.
EIGENVALUE_TOLERANCE = 1e-10

#: Largest relative difference between a matrix and its transpose that is rounding.
SYMMETRY_TOLERANCE = 1e-8

#: Eigenvalues of a correlation matrix below this count as zero: directions without spread.
RANK_TOLERANCE = 1e-13


#: How much of a value is shown in a message.
SHOWN = 200


def as_array(name: str, value: Any, shape: tuple[int | None, ...]) -> FloatArray:
    """Copy ``value`` into a float array after checking its shape and finiteness.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like
    shape : tuple of int or None
        Expected shape; None admits any length.

    Raises
    ------
    ShapeError
        If the shape differs, or ``value`` is not numeric.
    ParameterError
        If an entry is NaN or infinite.
    """
    if is_complex(value):
        raise ParameterError(f"{name}: got complex numbers, expected real ones")
    try:
        array = np.array(as_floats(value))
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: expected an array of numbers of shape {_show(shape)}") from error
    if array.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(array.shape, shape, strict=True)
    ):
        raise ShapeError(f"{name}: got shape {array.shape}, expected {_show(shape)}")
    if not np.isfinite(array).all():
        where = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise ParameterError(f"{name}: entry {where} is {array[where]}, expected finite numbers")
    return array


def is_complex(value: object) -> bool:
    """Whether an array, or a list, holds complex numbers, which NumPy would cut down to real ones."""
    if isinstance(value, list | tuple):
        return any(map(is_complex, value))
    return isinstance(value, complex) or getattr(getattr(value, "dtype", None), "kind", "") == "c"


def as_numbers(name: str, value: Any) -> FloatArray:
    """Return ``value`` as a float array of whatever shape; it shares memory where it can.

    Raises
    ------
    ShapeError
        If it is not numeric, or ragged.
    ParameterError
        If its numbers are complex.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value
    if is_complex(value):
        raise ParameterError(f"{name}: got complex numbers, expected real ones")
    try:
        return as_floats(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{name}: expected an array of numbers, got {brief(value)}") from error


def as_real(name: str, value: Any, expected: str = "a number") -> float:
    """Return one number as a float; ``expected`` says in the message what it should be.

    Raises
    ------
    ParameterError
        If it is none: a text, several numbers, a complex one.
    """
    if isinstance(value, float):
        return value
    try:
        if isinstance(value, str | bytes) or is_complex(value) or np.ndim(value) != 0:
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{name}: got {brief(value)}, expected {expected}") from error


def as_choice(name: str, value: Any, options: Iterable[str]) -> str:
    """Return a word that is one of a few.

    Raises
    ------
    ParameterError
        If it is not.
    """
    options = tuple(options)
    if not (isinstance(value, str) and value in options):
        *others, last = map(repr, options)
        either = f"one of {', '.join([*others, last])}"
        if len(others) < 3:
            either = f"{', '.join(others)} or {last}" if others else last
        raise ParameterError(f"{name}: got {brief(value)}, expected {either}")
    return value


def as_flag(name: str, value: Any) -> bool:
    """Return a truth value.

    Raises
    ------
    ParameterError
        If it is none: a text, or several.
    """
    if not isinstance(value, bool | np.bool_) and not (is_whole(value) and value in (0, 1)):
        raise ParameterError(f"{name}: got {brief(value)}, expected True or False")
    return bool(value)


def check_broadcast(**arrays: FloatArray) -> None:
    """Raise a ShapeError unless the arrays of these names can be broadcast."""
    try:
        np.broadcast_shapes(*(array.shape for array in arrays.values()))
    except ValueError as error:
        shapes = ", ".join(str(array.shape) for array in arrays.values())
        raise ShapeError(
            f"{', '.join(arrays)}: got shapes {shapes}, expected shapes that broadcast"
        ) from error


def brief(value: object) -> str:
    """Show a value in a message: on one line, which tables and arrays do not, and cut where it is long."""
    try:
        shown = " ".join(line.strip() for line in repr(value).splitlines())
    except ValueError:  # a whole number of too many digits
        return type(value).__name__
    return shown if len(shown) <= SHOWN else shown[:SHOWN] + "..."


def is_whole(value: object) -> bool:
    """Whether a value is a whole number, of whatever numeric type."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    return isinstance(value, Integral) or float(value) % 1.0 == 0.0


def as_count(name: str, value: float, least: int = 0, most: int | None = None) -> int:
    """Return a whole number that is within bounds.

    Raises
    ------
    ParameterError
        If it is not whole, or out of bounds.
    """
    if not is_whole(value) or value < least:
        raise ParameterError(f"{name}: got {value!r}, expected a whole number of at least {least}")
    if most is not None and value > most:
        raise ParameterError(f"{name}: got {int(value):,}, expected at most {most:,}")
    return int(value)


def check_generator(rng: object) -> None:
    """Raise a ParameterError unless ``rng`` is a generator of random numbers, and not its seed."""
    if not isinstance(rng, np.random.Generator):
        seed = f", for instance numpy.random.default_rng({rng})" if is_whole(rng) else ""
        raise ParameterError(f"rng: got {type(rng).__name__}, expected a numpy.random.Generator{seed}")


def _show(shape: tuple[int | None, ...]) -> str:
    return (
        "(" + ", ".join("n" if k is None else str(k) for k in shape) + ("," if len(shape) == 1 else "") + ")"
    )


def symmetrize(P: FloatArray) -> FloatArray:
    """Return the symmetric part of the matrices ``P`` (..., d, d)."""
    symmetric: FloatArray = 0.5 * P + 0.5 * np.swapaxes(P, -1, -2)
    return symmetric


def check_definite(
    P: FloatArray,
    describe: Callable[[tuple[int, ...]], str],
    *,
    strict: bool = False,
    where: np.ndarray | None = None,
    scale: FloatArray | None = None,
) -> None:
    """Prove that the symmetric matrices ``P`` are positive semi-definite.

    Parameters
    ----------
    P : ndarray, shape (..., d, d)
    describe : callable
        Maps the index of a matrix to its name in the message.
    strict : bool
        Ask for positive definiteness.
    where : ndarray of bool, shape (...), optional
        Which matrices count.
    scale : ndarray, shape (..., d), optional
        Standard deviation of each component to which rounding errors are relative, so
        that the verdict does not depend on units.  By default eigenvalues are compared
        with the largest one; for definite matrices, after scaling to a unit diagonal.

    Raises
    ------
    NotPositiveDefiniteError
        Names the worst matrix and its smallest eigenvalue.
    """
    if P.shape[-1] == 0 or P.size == 0:
        return
    size = 0.0 if scale is None else 1.0
    if scale is None:
        diagonal = np.diagonal(P, axis1=-2, axis2=-1)
        scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)) if strict else np.ones(P.shape[-1])
    scaled = np.linalg.eigvalsh(P / (scale[..., :, None] * scale[..., None, :]))
    bound = EIGENVALUE_TOLERANCE * np.maximum(np.abs(scaled).max(axis=-1), size)
    bad = (scaled[..., 0] <= bound * 1e-4) if strict else (scaled[..., 0] < -bound)
    if where is not None:
        bad = bad & where
    if bad.any():
        eigenvalues = np.linalg.eigvalsh(P)
        smallest, largest = eigenvalues[..., 0], np.abs(eigenvalues).max(axis=-1)
        worst = np.unravel_index(np.argmin(np.where(bad, smallest, np.inf)), smallest.shape)
        index = tuple(int(k) for k in worst)
        kind = "positive definite" if strict else "positive semi-definite"
        raise NotPositiveDefiniteError(
            f"{describe(index)}: expected a {kind} matrix, got the eigenvalue {smallest[index]:.6g} "
            f"(largest {largest[index]:.6g})"
        )


def check_covariance(
    name: str, value: ArrayLike, shape: tuple[int | None, ...], *, strict: bool = False
) -> FloatArray:
    """Copy, check and exactly symmetrise covariance matrices given by a user.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : array_like, shape (..., d, d)
    shape : tuple of int or None
        Expected shape.
    strict : bool
        Ask for positive definite instead of semi-definite matrices.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        Wrong shape; not finite or not symmetric; indefinite.

    Examples
    --------
    >>> check_covariance("P", [[1.0, 2.0], [2.0, 1.0]], (2, 2))
    Traceback (most recent call last):
        ...
    fuzzykf.errors.NotPositiveDefiniteError: P: expected a positive semi-definite matrix, \
got the eigenvalue -1 (largest 3)
    """
    P = as_array(name, value, shape)
    asymmetry = np.abs(P - np.swapaxes(P, -1, -2))
    scale = np.abs(P).max(axis=(-2, -1), keepdims=True) if P.size else P
    if (asymmetry > SYMMETRY_TOLERANCE * scale).any():
        where = tuple(int(k) for k in np.unravel_index(np.argmax(asymmetry), P.shape))
        other = (*where[:-2], where[-1], where[-2])
        raise ParameterError(
            f"{name}: expected symmetric matrices, got {P[where]:.6g} at {where} "
            f"but {P[other]:.6g} at {other}"
        )
    P = symmetrize(P)
    check_definite(P, lambda index: name + "".join(f"[{k}]" for k in index), strict=strict)
    return P


def cholesky(P: FloatArray, describe: Callable[[tuple[int, ...]], str]) -> FloatArray:
    """Lower Cholesky factors of positive definite matrices (..., d, d).

    Raises
    ------
    NotPositiveDefiniteError
        Names the worst matrix through ``describe`` and its smallest eigenvalue.
    """
    try:
        factor = np.linalg.cholesky(P).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        check_definite(P, describe, strict=True)
        raise
    return factor


def semidefinite_root(P: FloatArray) -> FloatArray:
    """Symmetric square roots S = S' with S S = P of positive semi-definite matrices.

    Eigenvalues that are negative by rounding only count as zero; prove
    semi-definiteness with `check_definite` before.
    """
    eigenvalues, vectors = np.linalg.eigh(P)
    root = np.sqrt(np.maximum(eigenvalues, 0.0))
    product: FloatArray = (vectors * root[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return product


def covariance_root(P: FloatArray) -> FloatArray:
    """Roots F with F F' = P of positive semi-definite matrices, whatever the units of their components.

    What is negative by rounding only counts as zero, as in `semidefinite_root`.
    """
    deviation = np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))
    unit = np.where(deviation > 0.0, deviation, 1.0)
    # rows of what has no variance are zero, not the rounding of eigenvectors
    root: FloatArray = deviation[..., None] * semidefinite_root(P / unit[..., None] / unit[..., None, :])
    return root


def square(factor: FloatArray) -> FloatArray:
    """F F' for factors F."""
    product: FloatArray = factor @ np.swapaxes(factor, -1, -2)
    return product


def lower_factor(F: FloatArray) -> FloatArray:
    """Lower triangular L with L L' = F F', (..., r, r) from (..., r, c), by orthogonal transformations.

    The columns are taken from the largest on, in units of the rows: what is small beside others
    keeps its digits then, however large they are (Cox and Higham, 1998).
    The diagonal is not negative.
    """
    r, c = F.shape[-2:]
    if c < r:
        F = np.concatenate([F, np.zeros((*F.shape[:-1], r - c))], axis=-1)
    size = np.abs(F)
    largest = size.max(axis=-1, keepdims=True)
    size = (size / np.where(largest > 0.0, largest, 1.0)).max(axis=-2)
    order = np.argsort(-size, axis=-1, kind="stable")
    F = np.take_along_axis(F, order[..., None, :], axis=-1)
    L = np.swapaxes(np.linalg.qr(np.swapaxes(F, -1, -2), mode="r"), -1, -2)
    sign = np.where(np.diagonal(L, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)
    factor: FloatArray = L * sign[..., None, :]
    return factor


def solve_lower(L: FloatArray, B: FloatArray) -> FloatArray:
    """L^-1 B for lower triangular L, (..., d, d) and (..., d, c), by forward substitution.

    Unlike by a solver for any matrix, no digit is lost where rows of L differ in size by any power of ten.
    """
    shape = np.broadcast_shapes(L.shape[:-1], B.shape[:-1])
    X = np.empty((*shape, B.shape[-1]))
    for k in range(shape[-1]):
        known = (L[..., k, None, :k] @ X[..., :k, :])[..., 0, :]
        X[..., k, :] = (B[..., k, :] - known) / L[..., k, k, None]
    return X


def mixture_root(p: FloatArray, means: FloatArray, roots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (..., d) and lower triangular root of the covariance (..., d, d) of mixtures.

    As `mixture_moments`, for components whose covariances are known by their roots.

    Parameters
    ----------
    p : ndarray, shape (..., k)
        Not negative; sums to one.
    means : ndarray, shape (..., k, d)
    roots : ndarray, shape (..., k, d, r)
    """
    first = np.take_along_axis(means, p.argmax(axis=-1)[..., None, None], axis=-2)
    off = means - first  # what all have in common then cancels to the last bit, however large
    # k - 1 columns for the spread of k means: each against the mean of those before it
    mass, moment = p.cumsum(axis=-1), (p[..., None] * off).cumsum(axis=-2)
    there = np.where(mass > 0.0, mass, 1.0)
    apart = off[..., 1:, :] - moment[..., :-1, :] / there[..., :-1, None]
    spread = np.sqrt(mass[..., :-1] / there[..., 1:] * p[..., 1:])[..., None] * apart
    columns = np.moveaxis(roots * np.sqrt(p)[..., None, None], -3, -1)
    wide = np.concatenate([np.swapaxes(spread, -1, -2), columns.reshape(*columns.shape[:-2], -1)], axis=-1)
    return first[..., 0, :] + moment[..., -1, :], lower_factor(wide)


def whitening(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split space into the directions with and without spread.

    Parameters
    ----------
    matrix : ndarray, shape (d, d)
        Symmetric and positive semi-definite.

    Returns
    -------
    whiten : ndarray, shape (r, d)
        |whiten v|^2 = v' matrix^-1 v on the range of ``matrix``; whiten' whiten is a
        generalised inverse.
    null : ndarray, shape (d - r, d)
        null v = 0 exactly for the v in the range.
    """
    deviation = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.where(deviation > 0.0, deviation, 1.0)
    # Ranks are judged on correlations: units of the components must not matter.
    eigenvalues, vectors = np.linalg.eigh(matrix / unit[:, None] / unit)
    spread = eigenvalues > RANK_TOLERANCE
    whiten = (vectors[:, spread] / np.sqrt(eigenvalues[spread])).T / unit
    return whiten, vectors[:, ~spread].T / unit


def log_density(residual: FloatArray, factor: FloatArray) -> FloatArray:
    """Log of N(residual; 0, L L') for lower triangular factors L.

    Parameters
    ----------
    residual : ndarray, shape (..., d)
    factor : ndarray, shape (..., d, d)

    Returns
    -------
    ndarray, shape (...)
    """
    white = np.linalg.solve(factor, residual[..., None])[..., 0]
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    value: FloatArray = -0.5 * ((white * white).sum(axis=-1) + residual.shape[-1] * LOG_2PI) - log_det
    return value


def condition(
    mean: FloatArray, covariance: FloatArray, split: int, value: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the first ``split`` components given the others.

    Parameters
    ----------
    mean : ndarray, shape (..., d)
    covariance : ndarray, shape (..., d, d)
        The block of the given components must be positive definite.
    split : int
        Number of components to keep.
    value : ndarray, shape (d - split,)
        What the other components are.
    """
    Pxy, Pyy = covariance[..., :split, split:], covariance[..., split:, split:]
    gain = np.swapaxes(np.linalg.solve(Pyy, np.swapaxes(Pxy, -1, -2)), -1, -2)
    residual = value - mean[..., split:]
    conditional_mean = mean[..., :split] + (gain @ residual[..., None])[..., 0]
    conditional = covariance[..., :split, :split] - gain @ np.swapaxes(Pxy, -1, -2)
    return conditional_mean, symmetrize(conditional)


def logsumexp(a: FloatArray, axis: int = -1) -> FloatArray:
    """Log of the sum of exponentials along one axis; minus infinity counts as zero."""
    top = a.max(axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        value: FloatArray = np.log(np.exp(a - top).sum(axis=axis)) + np.squeeze(top, axis=axis)
    return value


def mixture_moments(
    weights: FloatArray, means: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a Gaussian mixture, by central moments.

    Parameters
    ----------
    weights : ndarray, shape (..., M)
        Sum to one along the last axis.
    means : ndarray, shape (..., M, d)
    covariances : ndarray, shape (..., M, d, d)

    Returns
    -------
    mean : ndarray, shape (..., d)
    covariance : ndarray, shape (..., d, d)

    Examples
    --------
    >>> import numpy as np
    >>> mean, covariance = mixture_moments(
    ...     np.array([0.5, 0.5]), np.array([[-1.0], [1.0]]), np.ones((2, 1, 1))
    ... )
    >>> float(mean[0]), float(covariance[0, 0])
    (0.0, 2.0)
    """
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    top = np.broadcast_to(weights, means.shape[:-1]).argmax(axis=-1)[..., None, None]
    first = np.take_along_axis(means, top, axis=-2)
    deviation = means - first
    off = (weights[..., None, :] @ deviation)[..., 0, :]
    mean = first[..., 0, :] + off
    deviation = deviation - off[..., None, :]
    spread = np.swapaxes(deviation, -1, -2) @ (weights[..., :, None] * deviation)
    within = (weights[..., :, None, None] * covariances).sum(axis=-3)
    return mean, symmetrize(within + spread)


def normal_quantile(level: float) -> float:
    """Quantile of the standard normal law."""
    from scipy.special import ndtri

    return float(ndtri(level))


def mixture_quantile(level: float, weights: FloatArray, means: FloatArray, stds: FloatArray) -> FloatArray:
    """Quantile of mixtures of M scalar normal laws, by bisection to rounding.

    Parameters
    ----------
    level : float
    weights, means, stds : ndarray, shape (..., M, k)
        Weights sum to one along the axis before the last.

    Returns
    -------
    ndarray, shape (..., k)

    Examples
    --------
    >>> import numpy as np
    >>> both = np.array([[-1.0], [1.0]])
    >>> abs(
    ...     float(
    ...         mixture_quantile(0.5, np.full((2, 1), 0.5), both, np.ones((2, 1))).round(
    ...             12
    ...         )[0]
    ...     )
    ... )
    0.0
    """
    from scipy.special import ndtr

    reach = abs(normal_quantile(level)) + 1.0
    low, high = (means - reach * stds).min(axis=-2), (means + reach * stds).max(axis=-2)
    positive = np.where(stds > 0.0, stds, 1.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        off = middle[..., None, :] - means
        below = np.where(stds > 0.0, ndtr(off / positive), off >= 0.0)
        under = (weights * below).sum(axis=-2) < level
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    quantile: FloatArray = 0.5 * (low + high)
    return quantile
