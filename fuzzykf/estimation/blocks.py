"""Free numbers of one parameter: entries of an array, variances and covariances, a factor of a matrix.

A parameter is searched through numbers that may be anything, so that no step of a search leaves what is
admissible.  A block maps numbers to the parameter and back, with exact derivatives.  Arrays may have a
leading axis of classes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

    #: A group of components of a covariance: the class (nothing where there are none), and the components.
    Group = tuple[tuple[int, ...], Sequence[int]]

__all__ = ["Block", "CovarianceBlock", "EntriesBlock", "ScaleBlock", "entry_name"]

#: How far a search is sent from a start, in units that the block chooses: of a log-variance, of an entry of a
#: factor in parts of a standard deviation, of another entry in parts of its size.
FAR_VARIANCE, FAR_FACTOR, FAR_ENTRY = 1.5, 0.5, 1.0


class Block(Protocol):
    """The free numbers of one parameter, and the estimates that they stand for.

    There are as many estimates, on the scale of the parameter, as numbers.

    Attributes
    ----------
    names : tuple of str
        Of the estimates, (p,).
    start : ndarray, shape (p,)
    spread : ndarray, shape (p,)
        A large change of each number: how far starts are drawn from one another.
    is_variance : ndarray of bool, shape (p,)
        Numbers that are logarithms of variances, so that minus infinity is the bound of zero.
    is_positive : ndarray of bool, shape (p,)
        Estimates that are variances, whose intervals are those of their logarithms.
    is_share : ndarray of bool, shape (p,)
        Those that cannot be above one either: of these they are those of their logits.
    """

    names: tuple[str, ...]
    start: FloatArray
    spread: FloatArray
    is_variance: BoolArray
    is_positive: BoolArray
    is_share: BoolArray

    def value(self, numbers: FloatArray) -> Any:
        """Return the parameter."""
        ...

    def gradient(self, numbers: FloatArray, by_value: Any) -> FloatArray:
        """Return the gradient with respect to the numbers (p,) of what has a gradient by the parameter.

        That of an array has its shape, each entry for itself: of a symmetric matrix it is symmetric.
        """
        ...

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the estimates (p,)."""
        ...

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """Return the derivatives of the estimates by the numbers, (p, p), a row for each estimate."""
        ...


def entry_name(key: str, group: tuple[int, ...], entry: Sequence[int]) -> str:
    """Return the name of an entry of an array, or of one class of it.

    Examples
    --------
    >>> (
    ...     entry_name("Q", (), (0, 1)),
    ...     entry_name("R", (2,), (0, 0)),
    ...     entry_name("R", (2,), ()),
    ... )
    ('Q[0, 1]', 'R[2][0, 0]', 'R[2]')
    """
    inside = f"[{', '.join(str(int(k)) for k in entry)}]" if len(entry) else ""
    return f"{key}{''.join(f'[{k}]' for k in group)}{inside}"


class EntriesBlock:
    """Entries of an array, as they are.

    Parameters
    ----------
    key : str
        The parameter, for names.
    held : ndarray
        The whole array, with the start of what is free.
    mask : ndarray of bool, of its shape
        What is free.
    n_group : int
        Number of leading axes that count classes, 0 or 1.
    size : ndarray, of its shape, optional
        How large entries may be that are small at the start; by default as the largest one, or 1.
    """

    def __init__(
        self, key: str, held: FloatArray, mask: BoolArray, n_group: int, size: FloatArray | None = None
    ) -> None:
        self._held, self._mask = held.copy(), mask
        where = [tuple(map(int, index)) for index in np.argwhere(mask)]
        self.names = tuple(entry_name(key, index[:n_group], index[n_group:]) for index in where)
        self.start = self._held[mask]
        largest = float(np.abs(held).max(initial=0.0)) or 1.0
        spread = FAR_ENTRY * np.where(self.start != 0.0, np.abs(self.start), largest)
        self.spread = spread if size is None else np.where(size[mask] > 0.0, size[mask], spread)
        self.is_variance = self.is_positive = self.is_share = np.zeros(len(where), dtype=np.bool_)

    def value(self, numbers: FloatArray) -> FloatArray:
        """Return the array."""
        array = self._held.copy()
        array[self._mask] = numbers
        return array

    def gradient(self, numbers: FloatArray, by_value: FloatArray) -> FloatArray:
        """See `Block`."""
        return by_value[self._mask]

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the entries."""
        return numbers.copy()

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """See `Block`."""
        return np.eye(len(numbers))


class CovarianceBlock:
    """Groups of components of a covariance, within each of which all variances and covariances are free.

    Each group is L L' with L lower triangular.  The numbers, row by row, are log L_ii^2, and L_ij in parts of
    the standard deviation of component i at the start.  Of a group of one component that is the logarithm of
    its variance.  Between groups the covariance has to be zero; then it is positive semi-definite for any
    numbers.

    Parameters
    ----------
    key : str
        The parameter, for names.
    held : ndarray, shape (..., d, d)
        The whole covariance, with the start of what is free.
    groups : sequence of (tuple of int, sequence of int)
        Class and components of each.

    Raises
    ------
    NotPositiveDefiniteError
        If a group is singular at the start.
    """

    def __init__(self, key: str, held: FloatArray, groups: Sequence[Group]) -> None:
        self._held = held.copy()
        names: list[str] = []
        #: Of each group, its place in the array and its numbers.
        self._places: list[tuple[Any, slice]] = []
        #: Rows and columns of the entries of its factor.
        self._entries: list[tuple[IntArray, IntArray]] = []
        is_variance: list[bool] = []
        for group, rows in groups:
            i, j = np.tril_indices(len(rows))
            self._entries.append((i, j))
            first = len(names)
            names += [
                entry_name(key, group, (rows[a], rows[b]))
                for a, b in zip(i.tolist(), j.tolist(), strict=True)
            ]
            is_variance += (i == j).tolist()
            self._places.append(((*group, *np.ix_(rows, rows)), slice(first, len(names))))
        self.names = tuple(names)
        self.is_variance = self.is_positive = np.array(is_variance, dtype=np.bool_)
        self.is_share = np.zeros(len(is_variance), dtype=np.bool_)
        self.spread = np.where(self.is_variance, FAR_VARIANCE, FAR_FACTOR)
        self._unit = [np.sqrt(np.diagonal(held[place])) for place, _ in self._places]
        self.start = self.of_moment(held)

    def of_moment(self, moment: FloatArray) -> FloatArray:
        """Return the numbers of what is likeliest where the noise has these second moments.

        Parameters
        ----------
        moment : ndarray, shape (..., d, d)

        Raises
        ------
        NotPositiveDefiniteError
            If a group of it is singular.
        """
        numbers = np.empty(len(self.names))
        for (place, part), unit, (i, j) in zip(self._places, self._unit, self._entries, strict=True):
            try:
                L = np.linalg.cholesky(moment[place])
            except np.linalg.LinAlgError as error:
                least = np.linalg.eigvalsh(moment[place])[0]
                raise NotPositiveDefiniteError(
                    f"{self.names[part.start]}: expected a positive definite matrix, "
                    f"got the eigenvalue {least:.6g}"
                ) from error
            with np.errstate(divide="ignore"):
                numbers[part] = np.where(i == j, 2.0 * np.log(np.abs(L[i, j])), L[i, j] / unit[i])
        return numbers

    def _factors(self, numbers: FloatArray) -> list[FloatArray]:
        factors = []
        for (_, part), unit, (i, j) in zip(self._places, self._unit, self._entries, strict=True):
            L = np.zeros((len(unit), len(unit)))
            own, diagonal = numbers[part], i == j
            L[i, j] = np.exp(np.where(diagonal, 0.5 * own, 0.0))
            L[i[~diagonal], j[~diagonal]] = own[~diagonal] * unit[i[~diagonal]]
            factors.append(L)
        return factors

    def value(self, numbers: FloatArray) -> FloatArray:
        """Return the covariance."""
        covariance = self._held.copy()
        for (place, _), L in zip(self._places, self._factors(numbers), strict=True):
            covariance[place] = L @ L.T
        return covariance

    def gradient(self, numbers: FloatArray, by_value: FloatArray) -> FloatArray:
        """See `Block`: d tr(G L L') = 2 tr(L' G dL) for symmetric G."""
        found = np.empty(len(self.names))
        factors = self._factors(numbers)
        for (place, part), unit, (i, j), L in zip(
            self._places, self._unit, self._entries, factors, strict=True
        ):
            G = by_value[place]
            slope = ((G + G.T) @ L)[i, j]
            found[part] = slope * np.where(i == j, 0.5 * L[i, j], unit[i])
        return found

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return variances and covariances."""
        parts = []
        for L, entries in zip(self._factors(numbers), self._entries, strict=True):
            parts.append((L @ L.T)[entries])
        return np.concatenate(parts)

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """See `Block`."""
        found = np.zeros((len(self.names),) * 2)
        factors = self._factors(numbers)
        for (_, part), unit, (i, j), L in zip(self._places, self._unit, self._entries, factors, strict=True):
            for k, (a, b) in enumerate(zip(i, j, strict=True)):
                dL = np.zeros_like(L)
                dL[a, b] = 0.5 * L[a, b] if a == b else unit[a]
                found[part, part.start + k] = (dL @ L.T + L @ dL.T)[i, j]
        return found


class ScaleBlock:
    """A factor of a given covariance, one for each class; its logarithm is the number.

    Parameters
    ----------
    key : str
        The parameter, for names.
    pattern : ndarray, shape (..., d, d)
        What the factor stands before: a covariance, which may be singular.
    held : ndarray, shape (..., d, d)
        The start; of it the factor that is likeliest if these were second moments of the noise.
    """

    def __init__(self, key: str, pattern: FloatArray, held: FloatArray) -> None:
        self._pattern, self._inverse = pattern, np.linalg.pinv(pattern, hermitian=True)
        self._rank = np.linalg.matrix_rank(pattern, hermitian=True)
        groups = [tuple(map(int, one)) for one in np.ndindex(pattern.shape[:-2])]
        self.names = tuple(entry_name(key, group, ()) for group in groups)
        self.is_variance = self.is_positive = np.ones(len(groups), dtype=np.bool_)
        self.is_share = ~self.is_positive
        self.spread = np.full(len(groups), FAR_VARIANCE)
        self.start = self.of_moment(held)

    def of_moment(self, moment: FloatArray) -> FloatArray:
        """Return the numbers of what is likeliest where the noise has these second moments.

        Raises
        ------
        NotPositiveDefiniteError
            If nothing of it lies in the range of the pattern.
        """
        factor = np.atleast_1d((self._inverse * moment).sum(axis=(-2, -1)) / self._rank)
        for name, one in zip(self.names, factor, strict=True):
            if not 0.0 < one < np.inf:
                raise NotPositiveDefiniteError(f"{name}: got the factor {one:.6g}, expected one above 0")
        numbers: FloatArray = np.log(factor)
        return numbers

    def value(self, numbers: FloatArray) -> FloatArray:
        """Return the covariance."""
        factor = np.exp(numbers).reshape(self._pattern.shape[:-2])
        covariance: FloatArray = factor[..., None, None] * self._pattern
        return covariance

    def gradient(self, numbers: FloatArray, by_value: FloatArray) -> FloatArray:
        """See `Block`."""
        slope: FloatArray = np.exp(numbers) * np.ravel((by_value * self._pattern).sum(axis=(-2, -1)))
        return slope

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the factors."""
        factors: FloatArray = np.exp(numbers)
        return factors

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """See `Block`."""
        return np.diag(np.exp(numbers))
