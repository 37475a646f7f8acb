"""Parameters that depend on the switch: shared by all classes, one for each, or a function of their weights.

A value of the switch is described by its shares in the K classes, (..., K).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, check_covariance
from fuzzykf.immutable import Immutable
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.interpolation import LogCovariance
from fuzzykf.switching.laws.chain import value_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray

__all__ = ["Parameter", "columns_of", "rows_of", "text_of"]


@reprs("name", "shape")
class Parameter(Immutable):
    """One parameter of a model at any value of the switch.

    Parameters
    ----------
    name : str
        Of the argument, for error messages.
    given : array_like or callable
        One for all classes, one for each with a leading axis (K, ...), or a function of the class weights
        (K,).  A number is a matrix of one row and column; a vector may be a column.
    n_classes : int
        Number K of classes.
    shape : tuple of int
        Of one value.
    mix : {"linear", "log"}, optional
        How covariances are mixed where they are not given by a function; None for what is no covariance.
    """

    def __init__(
        self, name: str, given: Any, n_classes: int, shape: tuple[int, ...], mix: str | None = None
    ) -> None:
        self.name, self.n_classes, self.shape = name, n_classes, shape
        self._is_covariance = mix is not None
        is_called = callable(given)
        self.function: Callable[[FloatArray], Any] | None = given if is_called else None
        self.values = np.empty((0, *shape)) if is_called else self._read(given)
        each_in_logarithm = mix == "log" and len(self.values) > 1
        self._between = LogCovariance(name, self.values) if each_in_logarithm else None

    def _read(self, given: Any) -> FloatArray:
        """Return what was given for each class, (K, ...), or for all, (1, ...)."""
        name, shape, K = self.name, self.shape, self.n_classes
        array = as_numbers(name, given)
        if array.shape in self._forms_of_one() or array.ndim == len(shape):
            if array.shape == (K, *shape):  # a vector for each class; of one component and class, the same
                return as_array(name, array, (K, *shape))
            return self._checked(array)[None]
        if array.ndim == len(shape) + 1:
            if array.shape[1:] == shape and len(array) != K:
                raise ShapeError(
                    f"{name}: got {len(array)} of shape {shape}, one for each class, expected {K}, as many "
                    "as the law has"
                )
            if array.shape == (K, *shape):
                if self._is_covariance:
                    return check_covariance(name, array, (K, *shape))
                return as_array(name, array, (K, *shape))
        raise ShapeError(f"{name}: got shape {array.shape}, expected {self._admissible()}")

    def _forms_of_one(self) -> set[tuple[int, ...]]:
        """Shapes in which the value of one class may come."""
        forms = {self.shape}
        if len(self.shape) == 1:
            forms.add((*self.shape, 1))
        if set(self.shape) == {1}:
            forms.add(())
        return forms

    def _admissible(self) -> str:
        each = f"({', '.join(map(str, (self.n_classes, *self.shape)))}) with one for each class"
        return f"{text_of(self.shape)}, {each}, or a function of the class weights"

    def _checked(self, array: FloatArray, where: str = "") -> FloatArray:
        """Return the value of one class, or that of a function, in its shape."""
        name = f"{self.name}{where}"
        if array.shape not in self._forms_of_one():
            expected = text_of(self.shape) if where else self._admissible()
            raise ShapeError(f"{name}: got shape {array.shape}, expected {expected}")
        value = array.reshape(self.shape)
        if self._is_covariance:
            return check_covariance(name, value, self.shape)
        return as_array(name, value, self.shape)

    def at(self, shares: FloatArray) -> FloatArray:
        """Return the parameter at values of the switch with these shares (..., K): (..., *shape).

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If a function returns something else; the message names the class weights.
        """
        if self.function is not None:
            rows, which = np.unique(shares.reshape(-1, self.n_classes), axis=0, return_inverse=True)
            found = np.array([self._called(row) for row in rows]).reshape(-1, *self.shape)
            return found[which.reshape(-1)].reshape(*shares.shape[:-1], *self.shape)
        if len(self.values) == 1:
            return np.broadcast_to(self.values[0], (*shares.shape[:-1], *self.shape)).copy()
        if self._between is not None:
            return self._between(shares)
        flat = shares @ self.values.reshape(self.n_classes, -1)
        return flat.reshape(*shares.shape[:-1], *self.shape)

    def pull_back(self, shares: FloatArray, by_value: FloatArray) -> FloatArray:
        """Return the gradient by what was given, one or one for each class, of what has one by the values.

        Parameters
        ----------
        shares : ndarray, shape (N, K)
        by_value : ndarray, shape (N, *shape)
            That of a covariance is symmetric.

        Returns
        -------
        ndarray, shape (1, *shape) or (K, *shape)

        Raises
        ------
        ParameterError
            If it is a function.
        """
        if self.function is not None:
            raise ParameterError(f"{self.name}: a function of the class weights has no gradient")
        if len(self.values) == 1:
            total: FloatArray = by_value.sum(axis=0, keepdims=True)
            return total
        if self._between is not None:
            return self._between.pull_back(shares, by_value)
        by_class: FloatArray = np.tensordot(shares.T, by_value, 1)
        return by_class

    def _called(self, weights: FloatArray) -> FloatArray:
        """Return what the function says of class weights (K,), and prove that nothing else matters to it."""
        assert self.function is not None
        where = f" at the class weights {text_of(weights)}"
        try:
            first, again = (
                as_numbers(self.name, self.function(weights.copy())).copy() for _ in range(2)
            )  # each with weights of its own, so that it may write into them
        except Exception as error:  # such as a function of two arguments
            if isinstance(error, FuzzykfError):
                raise
            raise ParameterError(
                f"{self.name}{where}: the function raised a {type(error).__name__} ({error}); expected one "
                f"that takes the class weights ({self.n_classes},) and returns {text_of(self.shape)}"
            ) from error
        value = self._checked(first, where)
        if not np.array_equal(first, again):
            raise ParameterError(
                f"{self.name}{where}: the function returned {first.tolist()}, and {again.tolist()} when it "
                "was called again; expected one that depends on the class weights alone"
            )
        return value

    def to_list(self) -> Any:
        """Return what was given as plain lists.

        Raises
        ------
        ParameterError
            If it is a function.
        """
        if self.function is not None:
            raise ParameterError(f"{self.name}: a function cannot be written to a file")
        return (self.values if len(self.values) > 1 else self.values[0]).tolist()


def text_of(numbers: Any) -> str:
    """Return a shape, or class weights, as a message shows it."""
    if isinstance(numbers, tuple):
        return str(numbers)
    return value_of(numbers) if len(numbers) > 2 else f"({', '.join(f'{u:.6g}' for u in numbers)})"


def columns_of(name: str, given: Any, weights: FloatArray) -> int:
    """Return how many columns a parameter has: the last number of its shape."""
    return _shape_of(name, given, weights)[-1]


def rows_of(name: str, given: Any, weights: FloatArray) -> int:
    """Return how many rows a parameter has: the last number of its shape but one."""
    return _shape_of(name, given, weights)[-2]


def _shape_of(name: str, given: Any, weights: FloatArray) -> tuple[int, ...]:
    if callable(given):
        try:
            given = given(weights.copy())
        except Exception as error:
            raise ParameterError(
                f"{name} at the class weights {text_of(weights)}: the function raised a "
                f"{type(error).__name__} ({error}); expected one that takes class weights ({len(weights)},)"
            ) from error
    shape = as_numbers(name, given).shape
    if shape == ():
        return 1, 1
    if len(shape) < 2 or 0 in shape:
        raise ShapeError(
            f"{name}: got shape {shape}, expected a matrix, or one for each class with a leading axis"
        )
    return shape
