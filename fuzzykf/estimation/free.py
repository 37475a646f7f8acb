"""Which entries of which parameters are free, and the vector of numbers that a search moves."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.estimation.blocks import CovarianceBlock, EntriesBlock, ScaleBlock, entry_name
from fuzzykf.gaussian import brief, check_covariance
from fuzzykf.immutable import cached_property
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.estimation.blocks import Block, Group

__all__ = ["FreeNumbers", "read_free"]


@dataclass(frozen=True, eq=False)
class FreeNumbers:
    """The free numbers of all parameters, one after the other.

    Those of arrays come from `read_free`; others, such as a law, are blocks of their own beside these.

    Attributes
    ----------
    blocks : mapping of str to Block
        Of each parameter that has free numbers.

    Examples
    --------
    >>> import numpy as np
    >>> free = read_free(
    ...     {"R": "diagonal"},
    ...     {"Q": np.eye(2), "R": 4.0 * np.eye(2)},
    ...     covariances=("Q", "R"),
    ... )
    >>> free.names
    ('R[0, 0]', 'R[1, 1]')
    >>> free.values(free.start)["R"].round(12)
    array([[4., 0.],
           [0., 4.]])
    >>> free.gradient(free.start, {"R": np.ones((2, 2))}).round(12)
    array([4., 4.])
    """

    blocks: Mapping[str, Block]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the estimates, (p,)."""
        return tuple(name for block in self.blocks.values() for name in block.names)

    @cached_property
    def start(self) -> FloatArray:
        """Numbers of the parameters as they were given, (p,)."""
        return self._joined("start")

    @cached_property
    def spread(self) -> FloatArray:
        """A large change of each number, (p,)."""
        return self._joined("spread")

    @cached_property
    def is_variance(self) -> BoolArray:
        """Which numbers are logarithms of variances, (p,)."""
        return self._joined("is_variance").astype(np.bool_)

    @cached_property
    def is_positive(self) -> BoolArray:
        """Which estimates are variances, (p,)."""
        return self._joined("is_positive").astype(np.bool_)

    @cached_property
    def is_share(self) -> BoolArray:
        """Which estimates are at most one, (p,)."""
        return self._joined("is_share").astype(np.bool_)

    def _joined(self, name: str) -> FloatArray:
        return np.concatenate([getattr(block, name) for block in self.blocks.values()])

    @cached_property
    def places(self) -> dict[str, slice]:
        """The numbers of each parameter among all."""
        ends = np.cumsum([len(block.names) for block in self.blocks.values()]).tolist()
        begins = [0, *ends[:-1]]
        return {key: slice(a, b) for key, a, b in zip(self.blocks, begins, ends, strict=True)}

    def values(self, numbers: FloatArray) -> dict[str, Any]:
        """Return the parameters, by their names, with what is held in them.

        Parameters
        ----------
        numbers : ndarray, shape (p,)
        """
        return {key: block.value(numbers[self.places[key]]) for key, block in self.blocks.items()}

    def gradient(self, numbers: FloatArray, by_values: Mapping[str, Any]) -> FloatArray:
        """Return the gradient (p,) of what has these gradients with respect to the parameters.

        Parameters
        ----------
        numbers : ndarray, shape (p,)
        by_values : mapping of str to ndarray
            Of each parameter an array of its shape, in which each entry counts for itself; that of a
            covariance is symmetric.
        """
        parts = [b.gradient(numbers[self.places[key]], by_values[key]) for key, b in self.blocks.items()]
        return np.concatenate(parts)

    def estimates(self, numbers: FloatArray) -> FloatArray:
        """Return the estimates (p,) on the scale of the parameters: entries, variances, factors."""
        parts = [block.estimates(numbers[self.places[key]]) for key, block in self.blocks.items()]
        return np.concatenate(parts)

    def jacobian(self, numbers: FloatArray) -> FloatArray:
        """Return the derivatives of the estimates by the numbers, (p, p), a row for each estimate."""
        found = np.zeros((len(self.names),) * 2)
        for key, block in self.blocks.items():
            place = self.places[key]
            found[place, place] = block.jacobian(numbers[place])
        return found

    def scale(self, numbers: FloatArray) -> FloatArray:
        """Return a large change of each number (p,) from here: of large ones their size."""
        found: FloatArray = np.where(self.is_variance, self.spread, np.maximum(self.spread, np.abs(numbers)))
        return found

    def draw(self, rng: np.random.Generator) -> FloatArray:
        """Return numbers (p,) somewhere around the start."""
        drawn: FloatArray = self.start + self.spread * rng.standard_normal(len(self.names))
        return drawn


def read_free(
    free: Any,
    values: Mapping[str, FloatArray],
    *,
    covariances: Collection[str],
    vectors: Collection[str] = (),
    sizes: Mapping[str, FloatArray] | None = None,
) -> FreeNumbers:
    """Return the free numbers of arrays.

    Parameters
    ----------
    free : mapping of str to object
        Of each parameter that is to be learned what of it is free.  Of a covariance: "full", all of it;
        "diagonal", its variances; ("scale", M), a factor of the covariance M; or a mask.  Of any other
        array: "full" or a mask.  A mask is an array of bool of its shape; of an array with a leading axis of
        classes it may be that of one class, for all of them.  The mask of a covariance has to be symmetric,
        and to consist of groups of components within which all is free, while there is no covariance
        between a group and other components: so every search stays within covariances.
    values : mapping of str to ndarray
        The arrays, by whose values the search begins.
    covariances : collection of str
        Which of them are covariances.
    vectors : collection of str
        Which of them have one axis, and not two; one axis more counts classes.
    sizes : mapping of str to ndarray, optional
        Of arrays that are no covariances, how large entries may be: how far starts are drawn from one
        another, and beside what a standard error is large.  By default that is the size at the start.

    Returns
    -------
    FreeNumbers

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        If a name is unknown, nothing is free, a word is another one, a mask has another shape or could lead
        to what is no covariance, or a variance that is free is zero at the start.

    Examples
    --------
    >>> import numpy as np
    >>> F, Q = np.eye(2), np.diag([1.0, 2.0])
    >>> mask = [[False, True], [False, False]]
    >>> read_free({"F": mask, "Q": "full"}, {"F": F, "Q": Q}, covariances=["Q"]).names
    ('F[0, 1]', 'Q[0, 0]', 'Q[1, 0]', 'Q[1, 1]')
    """
    if not isinstance(free, Mapping) or not free:
        raise ParameterError(
            f"free: got {brief(free)}, expected a dict of what is to be learned, of {listed(list(values))}"
        )
    blocks: dict[str, Block] = {}
    for key, what in free.items():
        if key not in values:
            raise ParameterError(f"free: got {brief(key)}, expected one of {listed(list(values))}")
        held = values[key]
        n_group = held.ndim - (1 if key in vectors else 2)
        if key in covariances:
            blocks[key] = _covariance(key, what, held, n_group)
        else:
            blocks[key] = _entries(key, what, held, n_group, (sizes or {}).get(key))
    return FreeNumbers(blocks)


def _entries(key: str, what: Any, held: FloatArray, n_group: int, size: FloatArray | None) -> Block:
    if _is_word(what, "full"):
        mask = np.ones(held.shape, dtype=np.bool_)
    else:
        mask = _mask(key, what, held.shape, n_group, "'full' or")
    return EntriesBlock(key, held, mask, n_group, size)


def _covariance(key: str, what: Any, held: FloatArray, n_group: int) -> Block:
    d = held.shape[-1]
    if isinstance(what, tuple | list) and len(what) == 2 and _is_word(what[0], "scale"):
        name = f"free[{key!r}]: M of ('scale', M)"
        numbers = np.asarray(what[1])
        shape = held.shape if numbers.ndim == held.ndim else (d, d)
        pattern = check_covariance(name, what[1], shape)
        if (np.abs(pattern).max(axis=(-2, -1)) == 0.0).any():
            raise ParameterError(f"{name}: got zeros, expected a covariance")
        return _begun(key, "scale", partial(ScaleBlock, key, np.broadcast_to(pattern, held.shape), held))
    if _is_word(what, "full"):
        mask = np.ones(held.shape, dtype=np.bool_)
    elif _is_word(what, "diagonal"):
        mask = np.broadcast_to(np.eye(d, dtype=np.bool_), held.shape)
    else:
        mask = _mask(key, what, held.shape, n_group, "'full', 'diagonal', ('scale', M) or")
    groups: list[Group] = []
    for group in np.ndindex(held.shape[:n_group]):
        groups += [(group, rows) for rows in _groups(key, what, mask[group], held[group], group)]
    return _begun(key, what, partial(CovarianceBlock, key, held, groups))


def _begun(key: str, what: Any, build: Callable[[], Block]) -> Block:
    """Return a block, or say which of its variances is zero at the start."""
    try:
        return build()
    except NotPositiveDefiniteError as error:
        raise NotPositiveDefiniteError(
            f"free[{key!r}]: got {brief(what)}, but the search has to begin inside of what is admissible, "
            f"and {error}; set {key} to a start, or free a multiple of it with ('scale', M)"
        ) from error


def _is_word(what: Any, word: str) -> bool:
    return isinstance(what, str) and what == word


def _mask(key: str, what: Any, shape: tuple[int, ...], n_group: int, words: str) -> BoolArray:
    """Return a mask of a whole array; that of one class counts for all."""
    try:
        mask = np.asarray(what)
    except ValueError:  # lists of unequal lengths
        mask = np.empty(0)
    if mask.dtype != np.bool_ or mask.shape not in {shape, shape[n_group:]}:
        of_one = f" or {shape[n_group:]}" if n_group else ""
        raise ShapeError(
            f"free[{key!r}]: got {brief(what)}, expected {words} an array of bool of shape {shape}{of_one}"
        )
    if not mask.any():
        raise ParameterError(f"free[{key!r}]: got a mask in which nothing is free; leave {key} out")
    return np.broadcast_to(mask, shape)


def _groups(
    key: str, what: Any, mask: BoolArray, held: FloatArray, group: tuple[int, ...]
) -> list[tuple[int, ...]]:
    """Return the groups of components of a covariance that a mask frees."""

    def refuse(i: int, j: int, reason: str) -> ParameterError:
        return ParameterError(
            f"free[{key!r}]: got {brief(what)}, but {entry_name(key, group, (i, j))} {reason}; expected "
            "groups of components, all of whose variances and covariances are free, and which have no "
            "covariances with others"
        )

    if (mask != mask.T).any():
        i, j = np.argwhere(mask & ~mask.T)[0].tolist()
        raise refuse(i, j, "is free, and the same entry beyond the diagonal is not")
    free = np.flatnonzero(mask.any(axis=0)).tolist()
    found: dict[tuple[int, ...], None] = {}
    for i in free:
        rows = np.flatnonzero(mask[i]).tolist()
        if i not in rows:
            raise refuse(i, rows[0], "is free, and the variances beside it are not")
        for j in rows:
            if (mask[i] != mask[j]).any():
                k = int(np.flatnonzero(mask[i] != mask[j])[0])
                raise refuse(j if mask[i, k] else i, k, "is held between components of one group")
        for j in np.flatnonzero(~mask[i] & (held[i] != 0.0)).tolist():
            raise refuse(i, j, f"is held at {held[i, j]:.6g}")
        found[tuple(rows)] = None
    return list(found)
