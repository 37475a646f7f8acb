"""The dynamics and measurement functions of a model: a matrix or a user's function, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers
from fuzzykf.immutable import cached_property

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray, Numbers

__all__ = ["Mapping", "as_map", "control", "grid_points", "matrix_of", "motion", "sight"]


class Mapping:
    """A map of points (..., dim_in) to points (..., dim_out).

    Parameters
    ----------
    name : str
        "fx" or "hx", for messages.
    dim_in, dim_out : int
    function : callable, optional
        The user's function of points, with keyword arguments.
    inverse : callable, optional
        Its inverse, with the same keyword arguments; NaN where there is none.
    arguments : dict, optional
        The keyword arguments.
    matrix : ndarray, shape (dim_out, dim_in), optional
        In place of the function: the map is linear, x -> matrix x + shift.
    shift : ndarray, shape (dim_out,), optional
        Added to the value.
    interval : callable, optional
        Interval extension: maps bounds (lower, upper) to bounds of the image.
    components : sequence of int, optional
        The components of the value that count; by default all of them.
    """

    def __init__(
        self,
        name: str,
        dim_in: int,
        dim_out: int,
        *,
        function: Callable[..., Any] | None = None,
        inverse: Callable[..., Any] | None = None,
        arguments: dict[str, Any] | None = None,
        matrix: FloatArray | None = None,
        shift: FloatArray | None = None,
        interval: Callable[..., Any] | None = None,
        components: ArrayLike | None = None,
    ) -> None:
        self.name = name
        self.dim_in = dim_in
        self.dim_out = dim_out
        self.components = np.arange(dim_out) if components is None else np.array(components, dtype=np.intp)
        self.matrix = None if matrix is None else matrix[self.components]
        self.shift = (np.zeros(dim_out) if shift is None else shift)[self.components]
        self._function = function
        self._inverse = inverse
        self._interval = interval
        self._arguments = arguments or {}

    def __call__(self, x: FloatArray) -> FloatArray:
        """Map points; the user's function may return NaN, which callers judge."""
        if self.matrix is not None:
            return self._shifted(_apply(self.matrix, x))
        if self._function is None:
            raise ParameterError(f"{self.name}: neither a function nor a matrix")
        value = self._checked(self.name, self._function(x, **self._arguments), x, self.dim_out)
        if self.components.size < self.dim_out:
            value = value[..., self.components]
        return self._shifted(value)

    def on_grid(self, axes: tuple[FloatArray, ...], where: BoolArray) -> FloatArray:
        """Map the nodes of a lattice, (n_1, ..., n_d, dim_out).

        Parameters
        ----------
        axes : tuple of ndarray
        where : ndarray of bool, shape (n_1, ..., n_d)
            The nodes that matter.

        Raises
        ------
        ParameterError
            The value at such a node is not finite: names the function, the first node and the value.
        """
        with np.errstate(all="ignore"):
            if self.matrix is None:
                value = self(grid_points(axes))
            else:
                value = _apply_to_grid(self.matrix, axes, self.shift)
        if self.matrix is not None:
            # No term is larger than that of the outermost nodes.
            largest = np.abs(self.matrix) @ [float(np.abs(axis).max()) for axis in axes] + np.abs(self.shift)
            if np.isfinite(largest).all():
                return value
        if not np.isfinite(value).all():
            bad = where & ~np.isfinite(value).all(axis=-1)
            if bad.any():
                first = tuple(np.argwhere(bad)[0])
                x = [float(axis[k]) for axis, k in zip(axes, first, strict=True)]
                raise ParameterError(
                    f"{self.name}: returned {value[first].tolist()} at x = {x}, "
                    "which is possible; expected finite numbers"
                )
        return value

    def _shifted(self, value: FloatArray) -> FloatArray:
        return value + self.shift if self.shift.any() else value

    def _checked(self, name: str, value: Any, x: FloatArray, dim: int) -> FloatArray:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ShapeError(f"{name}: returned {value!r}, expected an array of numbers") from error
        expected = (*x.shape[:-1], dim)
        if array.shape != expected:
            raise ShapeError(
                f"{name}: returned shape {array.shape} for points of shape {x.shape}, expected {expected}"
            )
        return array

    @property
    def has_interval(self) -> bool:
        """Whether `interval` can be called."""
        return self._interval is not None

    def interval(self, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds (dim_out,) of the image of a box, by the interval extension.

        Raises
        ------
        ShapeError, ParameterError
            If the extension returns anything but two vectors, lower <= upper.
        """
        name = f"{self.name}_interval"
        if self._interval is None:
            raise ParameterError(f"{name}: is not given")
        bounds = self._interval(lower, upper, **self._arguments)
        try:
            low, high = (np.asarray(b, dtype=np.float64).reshape(-1) for b in bounds)
        except (TypeError, ValueError) as error:
            raise ShapeError(f"{name}: returned {bounds!r}, expected bounds (lower, upper)") from error
        if low.shape != (self.dim_out,) or high.shape != (self.dim_out,):
            raise ShapeError(
                f"{name}: returned shapes {low.shape} and {high.shape}, expected ({self.dim_out},) twice"
            )
        if not (low <= high).all():
            raise ParameterError(
                f"{name}: returned {low.tolist()} and {high.tolist()}, expected lower <= upper"
            )
        return low[self.components] + self.shift, high[self.components] + self.shift

    @cached_property
    def is_invertible(self) -> bool:
        """Whether `inverse` can be called."""
        if self.matrix is None:
            return self._inverse is not None
        return bool(self.dim_in == self.dim_out and np.linalg.cond(self.matrix) < 1e12)

    def inverse(self, x: FloatArray) -> FloatArray:
        """Pre-images of points (..., dim_out); NaN where there is none."""
        if self.matrix is not None:
            return _apply(np.asarray(np.linalg.inv(self.matrix)), x - self.shift if self.shift.any() else x)
        if self._inverse is None:
            raise ParameterError(f"{self.name}_inverse: is not given")
        value = self._inverse(x - self.shift, **self._arguments)
        return self._checked(f"{self.name}_inverse", value, x, self.dim_in)

    def require_inverse(self, x: FloatArray, tolerance: FloatArray) -> None:
        """Check that the inverse given by the user leads back to the points ``x``.

        Raises
        ------
        ParameterError
            Names the first point that it does not lead back to.
        """
        back = self.inverse(self(x))
        bad = ~(np.abs(back - x) <= tolerance).all(axis=-1)
        if bad.any():
            k = int(np.argmax(bad))
            raise ParameterError(
                f"{self.name}_inverse: leads from {self.name}({x[k].tolist()}) to {back[k].tolist()}, "
                f"expected {x[k].tolist()}"
            )

    def then(self, matrix: FloatArray, shift: FloatArray) -> Mapping:
        """Return the map x -> matrix (self(x) + shift), for an invertible matrix."""
        if self.matrix is not None:
            return Mapping(
                self.name,
                self.dim_in,
                self.dim_out,
                matrix=matrix @ self.matrix,
                shift=matrix @ (self.shift + shift),
            )
        back = np.linalg.inv(matrix)
        inverse = None if self._inverse is None else lambda x: self.inverse(x @ back.T - shift)
        return Mapping(
            self.name,
            self.dim_in,
            self.dim_out,
            function=lambda x: (self(x) + shift) @ matrix.T,
            inverse=inverse,
        )


def _apply(matrix: FloatArray, x: FloatArray) -> FloatArray:
    """Apply a matrix to points (..., d); for many points and few components this is fastest."""
    value = np.zeros((*x.shape[:-1], matrix.shape[0]))
    for i, k in np.argwhere(matrix != 0.0):
        value[..., i] += matrix[i, k] * x[..., k]
    return value


def _apply_to_grid(matrix: FloatArray, axes: tuple[FloatArray, ...], shift: FloatArray) -> FloatArray:
    """Apply a matrix, and a shift, to the nodes of a lattice: sums along its axes, without the nodes."""
    shape = tuple(axis.size for axis in axes)
    value = np.empty((*shape, matrix.shape[0]))
    for i, row in enumerate(matrix):
        total = np.full((1,) * len(axes), shift[i])
        *first, last = np.flatnonzero(row) if row.any() else (0,)
        for k in first:
            total = total + row[k] * axes[k].reshape([-1 if m == k else 1 for m in range(len(axes))])
        along = axes[last].reshape([-1 if m == last else 1 for m in range(len(axes))])
        np.add(total, row[last] * along, out=value[..., i])
    return value


def as_map(name: str, value: Any, shape: tuple[int, int]) -> FloatArray:
    """Check the matrix of a linear map; a number will do for a 1 x 1 matrix.

    Raises
    ------
    ShapeError, ParameterError
        Wrong shape; not finite.
    """
    array = as_numbers(name, value)
    return as_array(name, array.reshape(1, 1) if array.ndim == 0 and shape == (1, 1) else array, shape)


def control(u: Numbers, B: Numbers, dim: int) -> FloatArray:
    """Return B u (dim,), or zero without one of them.

    Raises
    ------
    ParameterError, ShapeError
        If there is a control that is not zero, and no matrix for it; bad shapes.
    """
    if u is None:
        return np.zeros(dim)
    vector = as_numbers("u", u).ravel()
    if B is None:
        if vector.any():
            raise ParameterError(
                f"B: got no matrix, so u would do nothing; expected one of shape ({dim}, {vector.size}), "
                "by B=... or est.B = ..."
            )
        return np.zeros(dim)
    matrix = as_numbers("B", B)
    matrix = matrix * np.eye(dim) if matrix.ndim == 0 else matrix
    return as_array("B", matrix, (dim, vector.size)) @ as_array("u", vector, (None,))


def motion(est: Any, u: Any, B: Any, F: Any, Q: Any, fx_arguments: dict[str, Any]) -> Mapping:
    """Return the map f of one prediction of an estimator (the parameters are those of `predict`)."""
    d = est.dim_x
    if est.fx is None:
        _refuse("predict", fx_arguments, "fx")
        matrix = as_map("F", est.F if F is None else F, (d, d))
        return Mapping("F", d, d, matrix=matrix, shift=control(u, est.B if B is None else B, d))
    given = {k: v for k, v in (("u", u), ("B", B), ("F", F), ("Q", Q)) if v is not None} | fx_arguments
    inverse, interval = est.fx_inverse, est.fx_interval
    return Mapping("fx", d, d, function=est.fx, inverse=inverse, interval=interval, arguments=given)


def sight(est: Any, seen: IntArray, R: Any, H: Any, hx_arguments: dict[str, Any]) -> Mapping:
    """Return the map h to the components seen by an estimator (the parameters are those of `update`).

    Raises
    ------
    ParameterError
        If neither a matrix nor a function was ever given.
    """
    d, q = est.dim_x, est.dim_z
    if est.hx is None:
        _refuse("update", hx_arguments, "hx")
        if H is None and est.H is est._blank_H and not np.any(est.H):
            raise ParameterError(
                "H: got no matrix, so that z would say nothing of the state; expected one of shape "
                f"({q}, {d}), by H=... or est.H = ..., or a function hx"
            )
        return Mapping("H", d, q, matrix=as_map("H", est.H if H is None else H, (q, d)), components=seen)
    given = {k: v for k, v in (("R", R), ("H", H)) if v is not None} | hx_arguments
    interval = est.hx_interval
    return Mapping("hx", d, q, function=est.hx, interval=interval, arguments=given, components=seen)


def _refuse(verb: str, arguments: dict[str, Any], function: str) -> None:
    if arguments:
        raise TypeError(
            f"{verb}() got an unexpected keyword argument {next(iter(arguments))!r}; "
            f"only {function} could use it"
        )


def matrix_of(mapping: Mapping) -> FloatArray:
    """Return the matrix of a linear map.

    Raises
    ------
    ParameterError
        If the map is not linear.
    """
    if mapping.matrix is None:
        raise ParameterError(f"{mapping.name}: expected a linear map, got a function")
    return mapping.matrix


def grid_points(axes: tuple[FloatArray, ...]) -> FloatArray:
    """All nodes (n_1, ..., n_d, d) of the lattice with these axes."""
    points = np.empty((*(axis.size for axis in axes), len(axes)))
    for k, axis in enumerate(axes):
        points[..., k] = axis.reshape([-1 if m == k else 1 for m in range(len(axes))])
    return points
