"""What the Kalman filters accept as a matrix, a control or a state, and what they say to the rest.

The attributes of a filter are plain and may be assigned anything, so every verb
looks at them when it needs them.  The usual case, a float64 array of the right
shape, is returned as it is after two comparisons.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError
from fuzzykf.gaussian import SYMMETRY_TOLERANCE, as_array, as_numbers, brief, check_covariance

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = [
    "SINGULAR",
    "TIMED",
    "DimensionError",
    "SingularInnovationError",
    "as_covariance",
    "as_matrix",
    "as_square",
    "as_state",
    "as_vector",
    "check_dimensions",
    "check_in_range",
    "control_term",
    "dimension",
    "fits",
    "given_matrix",
    "observation_matrix",
]

#: Attributes of the Kalman filter that may be functions of the time that passes.
TIMED = ("F", "Q")

_FLOAT64 = np.dtype(np.float64)
_ARRAY = np.ndarray


#: Said when a `SingularInnovationError` is raised.
SINGULAR = (
    "S = H P H' + R: expected a positive definite matrix, got one that is not (to rounding error); check P "
    "and R, or set the attribute inv to numpy.linalg.pinv if S is meant to be singular"
)


class SingularInnovationError(NotPositiveDefiniteError, np.linalg.LinAlgError):
    """The covariance S of the residual cannot be inverted.

    It is a `numpy.linalg.LinAlgError` too, which is what filterpy raises here.
    """


class DimensionError(ShapeError, AssertionError):
    """A matrix of the wrong shape, found by `KalmanFilter.test_matrix_dimensions`.

    It is an AssertionError too, which is what filterpy raises there.
    """


def dimension(name: str, value: Any, least: int) -> int:
    """Return ``value`` if it is an integer of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ParameterError(f"{name}: got {brief(value)}, expected an integer of at least {least}")
    if value > MOST:
        raise ParameterError(f"{name}: got {brief(value)}, expected at most {MOST:,}")
    return int(value)


#: Components that a covariance of which still fits into the memory of large machines.
MOST = 1 << 20


def fits(n: int, m: int, x: Any, P: Any, A: Any, V: Any) -> bool:
    """Whether all four are plain float arrays of the shapes of x, P, A (m, n) and V (m, m).

    The usual case in one look; where it is False, `as_state` and the others convert
    what can be converted and name what cannot.
    """
    if not (type(x) is type(P) is type(A) is type(V) is _ARRAY):
        return False
    if not (x.dtype is P.dtype is A.dtype is V.dtype is _FLOAT64):
        return False
    state_fits: bool = x.shape == (n, 1) or x.shape == (n,)
    return state_fits and bool(P.shape == (n, n) and A.shape == (m, n) and V.shape == (m, m))


def as_matrix(name: str, value: Any, shape: tuple[int, int]) -> FloatArray:
    """Return ``value`` as a float array of the given shape; a number is a matrix of one row and column."""
    if type(value) is np.ndarray and value.shape == shape and value.dtype == _FLOAT64:
        return value
    _check_no_function(name, value)
    return given_matrix(name, value, shape)


def _check_no_function(name: str, value: Any) -> None:
    """Raise if a matrix is needed, and there is a function of dt."""
    if name in TIMED and callable(value):
        raise ParameterError(
            f"{name}: got a function of dt, but no dt to go with it; expected a matrix, or dt in a call that "
            "takes it (predict, filter, filter_many, smooth, smooth_lag, forecast)"
        )


def given_matrix(
    name: str, value: Any, shape: tuple[int | None, int | None], *, may_be_one: bool = True
) -> FloatArray:
    """Copy a matrix that was given in a call, after checking its shape and finiteness.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like
        A number, or a vector of one, is a matrix of one row and column, where such a one is admissible.
    shape : tuple of int or None
        Expected shape; None admits any length.
    may_be_one : bool
        Whether a length that is not told may be 1.

    Raises
    ------
    ShapeError, ParameterError
        As from `fuzzykf.gaussian.as_array`.
    """
    if all(length == 1 or (length is None and may_be_one) for length in shape):
        numbers = as_numbers(name, value)
        if numbers.shape in {(), (1,)}:
            value = numbers.reshape(1, 1)
    return as_array(name, value, shape)


def as_square(name: str, value: Any, n: int) -> FloatArray:
    """Return a covariance as an (n, n) array; a scalar means that multiple of the identity."""
    if type(value) is np.ndarray and value.shape == (n, n) and value.dtype == _FLOAT64:
        return value
    _check_no_function(name, value)
    try:
        given = as_numbers(name, value)
    except ShapeError as error:
        raise ShapeError(f"{name}: got {brief(value)}, expected a number or shape ({n}, {n})") from error
    if given.ndim == 0 or (n == 1 and given.shape == (1,)):
        return float(given.reshape(())) * np.eye(n)
    return as_array(name, value, (n, n))


def as_covariance(name: str, value: Any, n: int) -> FloatArray:
    """Return a covariance that was given in a call, after proving that it is one."""
    P = as_square(name, value, n)
    if P.shape == (1, 1):
        if not 0.0 <= P[0, 0] < np.inf:
            raise NotPositiveDefiniteError(f"{name}: got the variance {P[0, 0]}, expected at least 0")
    elif not _plainly_definite(P):
        return check_covariance(name, P, (n, n))
    return P


def _plainly_definite(P: FloatArray) -> bool:
    """Whether P is symmetric and positive definite: the cheap proof, for most calls."""
    largest = np.abs(P).max()
    if not (largest < np.inf and np.abs(P - P.T).max() <= SYMMETRY_TOLERANCE * largest):
        return False
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return False
    return True


def check_in_range(**values: FloatArray) -> None:
    """Raise unless what would become of these is made of numbers.

    Raises
    ------
    NumericalRangeError
        Names the first that is not.
    """
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise NumericalRangeError(
                f"{name}: would become {brief(value.tolist())}, which double precision cannot hold; expected "
                "finite numbers (reset the filter, or measure in larger units)"
            )


def as_state(x: Any, n: int) -> FloatArray:
    """Return the state as a column (n, 1) or flat (n,) float array; a number is a column of one."""
    if type(x) is np.ndarray and (x.shape == (n, 1) or x.shape == (n,)) and x.dtype == _FLOAT64:
        return x
    array = as_numbers("x", x)
    if n == 1 and array.ndim == 0:
        array = array.reshape(1, 1)
    if array.shape not in {(n, 1), (n,)}:
        raise ShapeError(f"x: got shape {array.shape}, expected ({n}, 1) or ({n},)")
    return as_array("x", array, array.shape)


def as_vector(name: str, value: Any, like: FloatArray) -> FloatArray:
    """Return what a user's function gave as an array of the shape of ``like``.

    Flat, row and column vectors are all unambiguous here; a scalar is one of length 1.
    """
    n = like.shape[0]
    array = as_numbers(name, value)
    if array.size != n or array.shape not in {(n,), (n, 1), (1, n), (1,), (), (1, 1)}:
        raise ShapeError(f"{name}: got shape {array.shape}, expected ({n},) or ({n}, 1)")
    if not np.isfinite(array).all():
        raise ParameterError(f"{name}: got {array.ravel().tolist()}, expected finite numbers")
    return array.reshape(like.shape)


def observation_matrix(name: str, value: Any, n: int, m: int) -> FloatArray:
    """Return an observation matrix given in a call: any number of rows, n columns.

    A number stands for a matrix of one row and column where the filter's own has no more: m rows.
    """
    matrix = given_matrix(name, value, (None, n), may_be_one=m == 1)
    if len(matrix) == 0:
        raise ShapeError(f"{name}: got shape {matrix.shape}, expected at least one row")
    return matrix


def control_term(B: Any, u: Any, x: FloatArray) -> FloatArray | float:
    """Return B u in the shape of x; 0 where there is no control.

    A scalar times a scalar is added to every component, as in filterpy.
    """
    if B is None or u is None:
        return 0.0
    B, u = as_numbers("B", B), as_numbers("u", u)
    if u.ndim == 0 and u == 0.0:
        return 0.0
    inner = B.shape[1] if B.ndim > 1 else 1
    if u.ndim and B.ndim and u.shape not in {(inner,), (inner, 1)}:
        shape = (inner,) if x.ndim == 1 else (inner, 1)
        raise ShapeError(f"u: got shape {u.shape}, expected {shape} for B of shape {B.shape}")
    if B.ndim == 1 and u.ndim and u.size == 1:
        u = u.reshape(())
    term = np.asarray(B.dot(u))
    if not np.isfinite(term).all():
        raise ParameterError(f"u: B u is {term.tolist()}, expected finite numbers")
    if term.size == x.size == 1:
        return term.reshape(x.shape)
    if term.ndim and term.shape != x.shape:
        raise ShapeError(
            f"u: B of shape {B.shape} and u of shape {u.shape} give B u of shape {term.shape}, "
            f"expected {x.shape}, the shape of x"
        )
    return term


def check_dimensions(n: int, m: int, values: dict[str, Any], z: Any) -> None:
    """Check the shapes of x, P, Q, F, H and R, and of z unless it is None; see `DimensionError`."""
    H = values["H"]
    rows = np.shape(H)[0] if np.ndim(H) == 2 else m
    numbers: set[tuple[int, ...]] = {(), (1,), (1, 1)}
    one, one_state = (numbers if length == 1 else set() for length in (rows, n))
    expected: dict[str, set[tuple[int, ...]]] = {
        "x": {(n,), (n, 1)} | one_state,
        "P": {(n, n)} | one_state,
        "Q": {(n, n)} | one_state,
        "F": {(n, n)} | one_state,
        "H": {(rows, n)} | (one & one_state),
        "R": {(rows, rows)} | one,
    }
    if z is not None:
        values = values | {"z": z}
        expected["z"] = {(rows, 1) if np.ndim(values["x"]) == 2 else (rows,)} | one
    for name, admissible in expected.items():
        shape = as_numbers(name, values[name]).shape
        if shape not in admissible:
            shapes = " or ".join(str(each) for each in sorted(admissible, key=len, reverse=True))
            raise DimensionError(f"{name}: got shape {shape}, expected {shapes}")
