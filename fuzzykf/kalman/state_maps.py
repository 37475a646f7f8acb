"""Banks of filters whose states differ: where the state of each lies in a space that all have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief, check_covariance, symmetrize
from fuzzykf.immutable import Immutable
from fuzzykf.kalman.arguments import as_square, as_state
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["CommonSpace", "StateMap"]

#: What is to be zero may be this much of what it is made of.
_ROUNDING = 1e-9


@reprs("matrix", "mean", "covariance")
class StateMap(Immutable):
    """Map between the state of a filter and the common state of a bank.

    The common state is ``T x + mean`` with covariance ``T P T' + covariance``; the inverse map is the
    left inverse ``(T'T)^-1 T'``.

    Parameters
    ----------
    matrix : array_like, shape (n, n_member)
        T, of full column rank: one column for each component of the filter, in the common space.
    mean : array_like, shape (n,), optional
        Mean of the components that the filter does not have (T' mean = 0); zero by default.
    covariance : array_like, shape (n, n), optional
        Covariance of these components (T' covariance = 0).  Zero by default, as acceleration is zero under
        constant velocity.

    Attributes
    ----------
    matrix, mean, covariance : ndarray
        As given; read-only.
    inverse : ndarray, shape (n_member, n)
        The left inverse of T.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes do not agree, T does not have full column rank, ``covariance`` is not a covariance, or
        ``mean`` or ``covariance`` is not orthogonal to T.

    Examples
    --------
    A filter of position and velocity, in a bank with filters of acceleration:

    >>> from fuzzykf.kalman import StateMap
    >>> place = StateMap([[1, 0], [0, 1], [0, 0]])
    >>> x, P = place.to_common([5.0, 2.0], [[1.0, 0.0], [0.0, 1.0]])
    >>> x
    array([5., 2., 0.])
    >>> place.to_member(x, P)[0]
    array([5., 2.])
    """

    matrix: FloatArray
    mean: FloatArray
    covariance: FloatArray
    inverse: FloatArray

    def __init__(
        self, matrix: ArrayLike, *, mean: ArrayLike | None = None, covariance: ArrayLike | None = None
    ) -> None:
        T = as_array("matrix", matrix, (None, None))
        n, n_member = T.shape
        if not 0 < n_member <= n:
            raise ShapeError(
                f"matrix: got shape {T.shape}, expected at least one column, and no more columns than rows"
            )
        rank = int(np.linalg.matrix_rank(T))
        if rank < n_member:
            raise ParameterError(
                f"matrix: got {brief(T.tolist())} of rank {rank}, expected full column rank, {n_member}"
            )
        Q, R = np.linalg.qr(T)  # T = Q R, so that (T'T)^-1 T' = R^-1 Q' without a square of T
        self.matrix, self.inverse = T, np.linalg.solve(R, Q.T)
        self.mean = np.zeros(n) if mean is None else as_array("mean", mean, (n,))
        self.covariance = (
            np.zeros((n, n)) if covariance is None else check_covariance("covariance", covariance, (n, n))
        )
        for name, value in (("mean", self.mean), ("covariance", self.covariance)):
            known = np.abs(Q.T @ value).max()
            if known > _ROUNDING * np.abs(value).max():
                raise ParameterError(
                    f"{name}: got {brief(value.tolist())}, expected what the filter lacks alone: "
                    f"matrix' {name} = 0"
                )

    def to_common(self, x: ArrayLike, P: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Convert an estimate of the filter to the common space.

        Parameters
        ----------
        x, P : array_like, shapes (n_member,) and (n_member, n_member)

        Returns
        -------
        x, P : ndarray, shapes (n,) and (n, n)

        Raises
        ------
        ShapeError, ParameterError
            If a shape does not fit, or a number is not finite.

        Examples
        --------
        >>> StateMap([[0.0], [1.0]], covariance=[[4.0, 0.0], [0.0, 0.0]]).to_common(
        ...     [3.0], [[1.0]]
        ... )
        (array([0., 3.]), array([[4., 0.],
               [0., 1.]]))
        """
        n = self.matrix.shape[1]
        return self._to_common(as_array("x", x, (n,)), as_array("P", P, (n, n)))

    def to_member(self, x: ArrayLike, P: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Convert an estimate in the common space to the state of the filter.

        Parameters
        ----------
        x, P : array_like, shapes (n,) and (n, n)

        Returns
        -------
        x, P : ndarray, shapes (n_member,) and (n_member, n_member)

        Raises
        ------
        ShapeError, ParameterError
            If a shape does not fit, or a number is not finite.

        Examples
        --------
        >>> StateMap([[0.0], [2.0]]).to_member([7.0, 3.0], [[1.0, 0.0], [0.0, 4.0]])
        (array([1.5]), array([[1.]]))
        """
        n = self.matrix.shape[0]
        return self._to_member(as_array("x", x, (n,)), as_array("P", P, (n, n)))

    # whoever calls these tells of numbers beyond the range

    def _to_common(self, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        T = self.matrix
        with np.errstate(over="ignore", invalid="ignore"):
            return T @ x + self.mean, symmetrize(T @ P @ T.T) + self.covariance

    def _to_member(self, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        with np.errstate(over="ignore", invalid="ignore"):
            return self.inverse @ x, symmetrize(self.inverse @ P @ self.inverse.T)


class CommonSpace(Immutable):
    """The space in which the members of a bank are mixed and merged.

    Parameters
    ----------
    filters : sequence of filters
    state_maps : sequence of StateMap, array_like or None
        One for each; None where the state is the common one.

    Attributes
    ----------
    dim : int
        Number of components.
    maps : tuple of StateMap or None
    sizes : tuple of int
        Numbers of components of the members.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        Names the member of which the map is not admissible.
    """

    def __init__(self, filters: Sequence[Any], state_maps: Sequence[StateMap | ArrayLike | None]) -> None:
        given: Any = state_maps
        is_listed = isinstance(given, Sequence) or (isinstance(given, np.ndarray) and given.ndim > 0)
        if not is_listed or isinstance(given, str | bytes):
            raise ParameterError(
                f"state_maps: got {brief(given)}, expected a list with a matrix, a StateMap or None for each "
                "filter"
            )
        if len(state_maps) != len(filters):
            raise ParameterError(
                f"state_maps: got {len(state_maps)}, expected one for each of the {len(filters)} filters"
            )
        self.sizes = tuple(int(np.size(f.x)) for f in filters)
        self.maps = tuple(_as_map(k, one) for k, one in enumerate(state_maps))
        dims = [n if T is None else len(T.matrix) for T, n in zip(self.maps, self.sizes, strict=True)]
        self.dim = max(dims)
        for k, (T, n, dim) in enumerate(zip(self.maps, self.sizes, dims, strict=True)):
            if T is None and dim != self.dim:
                raise ShapeError(
                    f"state_maps[{k}]: got None for a filter of {n} states, expected a matrix of shape "
                    f"({self.dim}, {n})"
                )
            if T is not None and T.matrix.shape != (self.dim, n):
                raise ShapeError(
                    f"state_maps[{k}]: got a matrix of shape {T.matrix.shape}, expected ({self.dim}, {n}): a "
                    "row for each common component, a column for each of the filter"
                )

    def states(self, filters: Sequence[Any]) -> tuple[FloatArray, FloatArray]:
        """Stack the estimates of the members, (K, dim) and (K, dim, dim)."""
        shapes = [np.shape(f.x) for f in filters]
        if len({len(shape) == 1 for shape in shapes}) > 1:
            raise ShapeError(f"filters: x has shapes {shapes}, expected all flat or all columns")
        moments = []
        for k, (f, n) in enumerate(zip(filters, self.sizes, strict=True)):
            if as_numbers(f"filters[{k}].x", f.x).size != n:
                raise ShapeError(f"filters[{k}].x: got shape {shapes[k]}, expected ({n}, 1) or ({n},)")
            moments.append(
                self._to_common(k, as_state(f.x, n).reshape(n), as_square(f"filters[{k}].P", f.P, n))
            )
        xs, Ps = zip(*moments, strict=True)
        return np.array(xs), np.array(Ps)

    def _to_common(self, k: int, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        T = self.maps[k]
        return (x, P) if T is None else T._to_common(x, P)

    def to_member(self, k: int, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return of an estimate what concerns member k."""
        T = self.maps[k]
        return (x, P) if T is None else T._to_member(x, P)


def _as_map(k: int, given: StateMap | ArrayLike | None) -> StateMap | None:
    if given is None or isinstance(given, StateMap):
        return given
    try:
        return StateMap(given)
    except ParameterError as error:
        raise type(error)(f"state_maps[{k}]: {error}") from error
