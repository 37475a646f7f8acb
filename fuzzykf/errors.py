"""The exceptions of fuzzykf.

Every error that the package raises on purpose is a `FuzzykfError`.  Where the
input is at fault it is a `ValueError` as well, so that code written for
filterpy or numpy, which expects a `ValueError`, goes on working.
"""

from __future__ import annotations

__all__ = [
    "ClosenessWarning",
    "EmptyIntersectionError",
    "FileFormatError",
    "FuzzykfError",
    "HindsightWarning",
    "MissingDependencyError",
    "NotPositiveDefiniteError",
    "NotStableError",
    "NumericalRangeError",
    "ParameterError",
    "QuadratureError",
    "SequenceError",
    "ShapeError",
    "StepsWarning",
    "SupportLostError",
    "SupportWarning",
    "UnreachableMeasurementError",
]


class FuzzykfError(Exception):
    """Base class of all errors raised on purpose by fuzzykf.

    Examples
    --------
    >>> from fuzzykf import FuzzykfError, KalmanFilter
    >>> try:
    ...     KalmanFilter(dim_x=2, dim_z=1, F=[[1.0]])
    ... except FuzzykfError as error:
    ...     print(type(error).__name__)
    ShapeError
    """


class ParameterError(FuzzykfError, ValueError):
    """An argument has an inadmissible value; the message says what is admissible.

    Examples
    --------
    >>> from fuzzykf import KalmanFilter
    >>> try:
    ...     KalmanFilter(dim_x=0, dim_z=1)
    ... except ValueError as error:  # a ParameterError is a ValueError
    ...     print(error)
    dim_x: got 0, expected an integer of at least 1
    """


class ShapeError(ParameterError):
    """An array has the wrong shape; the message names the expected shape."""


class NotPositiveDefiniteError(ParameterError):
    """A matrix is not positive (semi-)definite, as it must be.

    The message names the matrix, its place (a pair of nodes or a step) and the eigenvalue.
    """


class NotStableError(ParameterError):
    """Second moments diverge where a stationary law is needed; the message names the spectral radius."""


class ClosenessWarning(UserWarning):
    """A converted model is a poor approximation; the message says how far it is from the optimum."""


class EmptyIntersectionError(FuzzykfError, ValueError):
    """Prediction and measurement exclude each other, so no state is possible."""


class UnreachableMeasurementError(EmptyIntersectionError):
    """No state at all is consistent with the measurement: it is outside the range of hx."""


class SupportLostError(FuzzykfError, ValueError):
    """All possible states have left the fixed domain of a grid."""


class HindsightWarning(UserWarning):
    """Later observations move states by more than the model admits; smoothing may be harmful."""


class StepsWarning(UserWarning):
    """A dated series has missing rows or unequal steps; a model counts each row as one step."""


class SupportWarning(UserWarning):
    """Possible states have left a grid, or the grid is too coarse for a measurement."""


class SequenceError(FuzzykfError, RuntimeError):
    """Methods were called in an invalid order, such as update without predict.

    Examples
    --------
    >>> from fuzzykf import FadeLaw, SwitchingStateSpace
    >>> f = SwitchingStateSpace(FadeLaw.between(60, 20), F=0.5, H=1.0, Q=0.1, R=0.1).filter()
    >>> _ = f.step(1.0)
    >>> try:
    ...     f.update(2.0)
    ... except RuntimeError as error:  # a SequenceError is a RuntimeError
    ...     print(type(error).__name__)
    SequenceError
    """


class QuadratureError(FuzzykfError, ArithmeticError):
    """A quadrature rule is too coarse for the law or the data."""


class NumericalRangeError(FuzzykfError, ArithmeticError):
    """A result exceeds the range of double precision, such as the density of an extreme observation."""


class FileFormatError(FuzzykfError, ValueError):
    """A file is damaged, not from fuzzykf, or of a version that cannot be read."""


class MissingDependencyError(FuzzykfError, ImportError):
    """An optional package is missing; the message names the extra that installs it."""
