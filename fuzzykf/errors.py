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
    """Base class of all errors raised on purpose by fuzzykf."""


class ParameterError(FuzzykfError, ValueError):
    """An argument has an inadmissible value; the message names the admissible range."""


class ShapeError(ParameterError):
    """An array has the wrong shape; the message names the expected one."""


class NotPositiveDefiniteError(ParameterError):
    """A matrix that has to be positive (semi-)definite is not.

    The message names the matrix, where it belongs (a pair of nodes, a step),
    and the offending eigenvalue.
    """


class NotStableError(ParameterError):
    """Second moments that have to settle grow without bound; the message names the spectral radius."""


class ClosenessWarning(UserWarning):
    """A converted model is far from the one it stands for; the message says how far."""


class EmptyIntersectionError(FuzzykfError, ValueError):
    """Prediction and measurement exclude each other: no state is possible."""


class UnreachableMeasurementError(EmptyIntersectionError):
    """No state whatever can explain the measurement: it lies outside what hx can reach."""


class SupportLostError(FuzzykfError, ValueError):
    """All possible states have left the fixed universe of a grid."""


class HindsightWarning(UserWarning):
    """Later observations move the states by more than the model admits; what is smoothed may be worse."""


class StepsWarning(UserWarning):
    """A dated series lacks rows, or its steps are unequal; a model takes each row for one step."""


class SupportWarning(UserWarning):
    """Possible states have left a grid at its edge, or a grid is too coarse for a measurement."""


class SequenceError(FuzzykfError, RuntimeError):
    """The verbs of a filter were called in an order that has no meaning."""


class QuadratureError(FuzzykfError, ArithmeticError):
    """A quadrature rule is too coarse for the law or for the data it meets."""


class NumericalRangeError(FuzzykfError, ArithmeticError):
    """A number is needed that double precision cannot hold, such as the density of an absurd observation."""


class FileFormatError(FuzzykfError, ValueError):
    """A file is damaged, foreign, or of a version that cannot be read."""


class MissingDependencyError(FuzzykfError, ImportError):
    """An optional package is needed; the message names the extra that brings it."""
