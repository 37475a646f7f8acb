"""The contract of every filter.

A filter is an object with a few verbs: `Filter.predict`, `Filter.update`,
`Filter.step` (predict, then update), and for whole series `Filter.filter` and
filterpy's `Filter.batch_filter`.  What it knows is read from attributes:
``x`` of shape (dim_x, 1) and ``P`` of shape (dim_x, dim_x), as in filterpy.
Whole-series results are `FilterResult` objects with arrays of shape
(n, dim_x) and (n, dim_x, dim_x).
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import prod
from threading import RLock
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.arrays import FloatArray
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_flag, brief
from fuzzykf.many import read_many, stacked
from fuzzykf.observations import as_many, as_observation, as_observations, index_of
from fuzzykf.overrides import attributes_of, follows_copies
from fuzzykf.results import FIELDS, FilterResult, field_shapes
from fuzzykf.sequel import sequel_of, warn_of_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence

    from fuzzykf.arrays import IntArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.many import ManySeries
    from fuzzykf.sequel import Sequel

__all__ = [
    "Filter",
    "FilterResult",
    "FloatArray",
    "as_many",
    "as_observation",
    "as_observations",
    "check_keep",
    "index_of",
    "set_aside",
]


def check_keep(keep: Iterable[str], admissible: tuple[str, ...]) -> tuple[str, ...]:
    """Check the names of result fields to store, and return them.

    Parameters
    ----------
    keep : str or iterable of str
    admissible : tuple of str

    Returns
    -------
    tuple of str

    Raises
    ------
    ParameterError
        If a name is not admissible.

    Examples
    --------
    >>> from fuzzykf.base import check_keep
    >>> check_keep(["x", "P"], ("x", "P", "mu"))
    ('x', 'P')
    """
    try:
        names = (keep,) if isinstance(keep, str) else tuple(keep)
    except TypeError as error:
        raise ParameterError(
            f"keep: got {brief(keep)}, expected names among {', '.join(admissible)}"
        ) from error
    given: tuple[Any, ...] = names
    for name in given:
        if not isinstance(name, str) or name not in admissible:
            raise ParameterError(f"keep: got {brief(name)}, expected names among {', '.join(admissible)}")
    return names


# --------------------------------------------------------------------------- the contract

#: Most threads that may share series: more than any machine has processors for.
MOST_THREADS = 1024

#: What `Filter.filter_many` keeps unless told otherwise.
USUAL_FIELDS = ("x", "P", "log_likelihood")


#: Shapes of the fields that filters show after each step.
_shapes = partial(field_shapes, [name for name, known in FIELDS.items() if known.streamed])


def _shows(filter_: Filter, name: str, shape: tuple[int, ...]) -> bool:
    """Whether a filter has a field as an attribute: an attribute of its own may have that name, too."""
    value: Any = getattr(filter_, name, None)
    if name in ("x", "P", "x_prior", "P_prior"):  # of the contract, so a wrong one is an error
        return value is not None
    return np.asarray(value).dtype.kind in "fiu" and np.size(value) == prod(shape)


#: Held while a filter that cannot be copied lends itself.
_LENT = RLock()


def set_aside(filter_: Any, *shared: Any) -> Callable[[], None]:
    """Let a filter go on with copies of its attributes.

    Parameters
    ----------
    filter_ : object
    *shared : object
        What its attributes hold that is not to be copied.

    Returns
    -------
    callable
        Puts the attributes of now back, which nobody has touched meanwhile.
    """
    before = filter_.__dict__.copy()
    filter_.__dict__.update(copy.deepcopy(before, {id(one): one for one in (filter_, *shared)}))

    def put_back() -> None:
        filter_.__dict__.clear()
        filter_.__dict__.update(before)

    return put_back


class Filter(ABC):
    """Base class of all filters; subclass it to write your own.

    A subclass implements `predict` and `update`, keeps its estimate in ``x``
    (dim_x, 1) and ``P`` (dim_x, dim_x), the estimate before the latest
    observation in ``x_prior`` and ``P_prior``, and calls `remember_origin` at the
    start of each method that changes its state.  A probabilistic filter also has
    the ``log_likelihood`` of the latest observation.  Everything else is inherited.
    `fuzzykf.testing.check_filter` tests a subclass against this contract.

    Attributes
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.

    Examples
    --------
    A filter that averages all observations so far:

    >>> import numpy as np
    >>> from fuzzykf import Filter
    >>> class RunningMean(Filter):
    ...     dim_x = dim_z = 1
    ...
    ...     def __init__(self):
    ...         self.n, self.x, self.P = 0, np.zeros((1, 1)), np.eye(1)
    ...         self.x_prior, self.P_prior = self.x, self.P
    ...
    ...     def predict(self):
    ...         self.remember_origin()
    ...         self.x_prior, self.P_prior = self.x, self.P
    ...
    ...     def update(self, z):
    ...         self.remember_origin()
    ...         self.n += 1
    ...         self.x = self.x + (z - self.x) / self.n
    ...         self.P = np.eye(1) / self.n
    >>> RunningMean().filter([1.0, 3.0, 5.0]).x.ravel()
    array([1., 2., 3.])
    """

    dim_x: int
    dim_z: int
    x: Any
    P: Any
    x_prior: Any
    P_prior: Any

    @abstractmethod
    def predict(self, *args: Any, **kwargs: Any) -> None:
        """Move the estimate to the time of the next observation.

        Parameters
        ----------
        *args, **kwargs
            Arguments of the subclass, a control for instance.
        """

    @abstractmethod
    def update(self, z: Numbers, *args: Any, **kwargs: Any) -> None:
        """Take the observation ``z`` into account; None or NaN means missing.

        Parameters
        ----------
        z : array_like or None
            Scalar (if ``dim_z`` is 1) or shape (dim_z,), (dim_z, 1) or (1, dim_z).
        *args, **kwargs
            Further arguments of the subclass.
        """

    def step(self, z: Numbers) -> FloatArray:
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray of shape (dim_x, 1)
            The new estimate ``x``.

        Raises
        ------
        ShapeError, ParameterError
            As from `update`; the filter is then as it was.
        """
        as_observation(z, self.dim_z)  # before anything moves
        return self._step_or_stay(z)

    def _step_or_stay(
        self, z: Numbers, move: Mapping[str, Any] | None = None, look: Mapping[str, Any] | None = None
    ) -> FloatArray:
        """Do a step by the verbs, with keyword arguments; an error leaves the attributes as they were."""
        before = attributes_of(self)
        try:
            self.predict(**(move or {}))
            self.update(z, **(look or {}))
        except BaseException:
            self.__dict__.clear()
            self.__dict__.update(before)
            raise
        estimate: FloatArray = self.x
        return estimate

    def filter(self, zs: ManyNumbers, *, resume: bool = False) -> FilterResult:
        """Filter a series, starting from the current state of the filter.

        The filter ends at the last observation, so `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        resume : bool
            Continue from the current state.  A filter without an initial law of its own always does so.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior`` and, from a probabilistic filter,
            ``log_likelihood``; from a possibilistic one, ``possibility``, ``lower`` and ``upper``; with a
            switch, ``mu`` and ``switch``.  In general: the streamed fields (see
            `fuzzykf.results.ResultField`) that the filter has as attributes.
        """
        return self._filter_noting(zs, resume=resume)

    def _filter_noting(
        self,
        zs: ManyNumbers,
        note: Callable[[], None] | None = None,
        *,
        resume: bool = False,
        told: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]] | None = None,
        uneven: bool = False,
        fields: Collection[str] | None = None,
    ) -> FilterResult:
        """Filter a series, and call ``note`` after each step: what a way back has to know is kept there.

        ``told`` has the keyword arguments of each prediction and update; ``uneven`` says that they tell how
        long the steps are; ``fields`` are those to collect, by default all.
        """
        index = index_of(zs)
        if as_flag("resume", resume):
            self._check_next(index, uneven)
        series = as_observations(zs, self.dim_z)
        sizes = {"state": self.dim_x, "observation": self.dim_z, "node": np.size(getattr(self, "mu", ()))}
        sizes["class"] = np.size(getattr(self, "class_weights", ()))
        wanted = {name: shape for name, shape in _shapes(**sizes).items() if fields is None or name in fields}
        shapes = {name: shape for name, shape in wanted.items() if _shows(self, name, shape)}
        collected = {name: np.empty((len(series), *shape)) for name, shape in shapes.items()}
        before = attributes_of(self)
        try:
            for n, z in enumerate(series):
                if told is None:
                    self.step(z)
                else:
                    self._step_or_stay(z, *told[n])
                for name, values in collected.items():
                    values[n] = np.reshape(getattr(self, name), shapes[name])
                if note is not None:
                    note()
        except BaseException:  # half a series is of no use to anybody
            self.__dict__.clear()
            self.__dict__.update(before)
            raise
        nodes = getattr(self, "nodes", None) if "mu" in collected else None
        if index is not None:
            self._follow(index)
            if not uneven:
                warn_of_steps(index)
        return FilterResult(**collected, nodes=nodes, index=index).with_coords(zs)

    def batch_filter(self, zs: ManyNumbers, *args: Any, **kwargs: Any) -> tuple[FloatArray, ...]:
        """Filter a series and return filterpy's four arrays.

        Parameters
        ----------
        zs, *args, **kwargs
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            Shapes (n, dim_x, 1) and (n, dim_x, dim_x), after and before each
            observation.
        """
        result = self.filter(zs, *args, **kwargs)
        x, P, x_prior, P_prior = result.x, result.P, result.x_prior, result.P_prior
        if x is None or P is None or x_prior is None or P_prior is None:
            raise NotImplementedError(f"{type(self).__name__} keeps no x, P, x_prior and P_prior")
        return x[..., None], P, x_prior[..., None], P_prior

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = USUAL_FIELDS,
        *,
        by: Hashable | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each as `filter` does; the filter itself does not change.

        Parameters
        ----------
        zs : array_like, DataFrame, DataArray, list, tuple or mapping
            Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1; NaN where missing.  Or a frame with a
            column for each series (pairs (series, component) if ``dim_z`` is not 1), or a list or mapping of
            series of any lengths, each as `filter` takes it.
        keep : sequence of str, optional
            The fields of `FilterResult` to store: by default ``x``, ``P`` and, from a
            probabilistic filter, ``log_likelihood``.
        by : hashable, optional
            Column (or index level) that names the series of each row, if the frame holds all series one after
            another.
        resume : bool
            Start every series from the current state, see `filter`.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.  Names and index are kept, see `FilterResult.to_dataframe`.

        Raises
        ------
        ShapeError, ParameterError
            If shapes are wrong, or the filter does not have a field in ``keep``.
        """
        given = {"resume": True} if as_flag("resume", resume) else {}
        return self._filter_all(self._read_many(zs, by), keep, lambda rows, n: [given] * len(rows))

    def _filter_all(
        self,
        many: ManySeries,
        keep: Iterable[str],
        arguments: Callable[[IntArray, int], Sequence[Mapping[str, Any]]],
    ) -> FilterResult:
        """Do `filter_many`; ``arguments`` tells those of `filter` for some of the series, of n steps."""

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            which = np.arange(len(many.values))[rows]
            results = self._filter_each(series, arguments(which, series.shape[1]))
            filled = tuple(name for name in FIELDS if any(getattr(one, name) is not None for one in results))
            if keep is USUAL_FIELDS:  # nobody asked for what this kind of filter does not have
                return stacked(results, [name for name in USUAL_FIELDS if name in filled])
            return stacked(results, check_keep(keep, filled))

        return many.filtered(several)

    def _read_many(self, zs: Any, by: Any) -> ManySeries:
        """Read many series, in any of the forms in which they come."""
        return read_many(zs, self.dim_z, by)

    def _follow(self, index: Any) -> None:
        """Remember how the index of a series goes on that the filter has just come to the end of."""
        sequel = sequel_of(index)
        if sequel is not None:
            self._sequel: tuple[Sequel, Any] = sequel, self._position()

    def _check_next(self, index: Any, uneven: bool = False) -> None:
        """Raise unless a dated series goes on where the latest one ended, as far as the filter knows.

        ``uneven`` says that it is told how long the steps are: then any later time will do.
        """
        sequel, position = self.__dict__.get("_sequel", (None, None))
        passed = None if sequel is None else self._passed_since(position)
        if passed is not None:
            (replace(sequel, step=None) if uneven else sequel).check_next(index, passed)

    def _index_ahead(self, steps: int) -> Any:
        """Return the index of the steps to come; None if nobody knows it."""
        sequel, position = self.__dict__.get("_sequel", (None, None))
        passed = None if sequel is None else self._passed_since(position)
        return None if passed is None else sequel.ahead(steps, passed)

    def _position(self) -> Any:
        """Return by what `_passed_since` tells whether the filter has moved."""
        return self.P  # no verb writes into an array that is there

    def _passed_since(self, position: Any) -> int | None:
        """Return how many observations were taken since; None if nobody has counted."""
        return 0 if self.P is position else None

    def _filter_each(
        self, series: FloatArray, arguments: Sequence[Mapping[str, Any]] | None = None
    ) -> list[FilterResult]:
        """Filter series one after another, with the arguments of each; the filter stays as it is."""
        results = []
        for k, one in enumerate(series):
            with self._lent() as spare:
                results.append(spare.filter(one, **(arguments[k] if arguments else {})))
        return results

    @contextmanager
    def _lent(self) -> Iterator[Self]:
        """Lend a filter that stands where this one does; what happens to it leaves this one as it is."""
        if self._follows_copies():
            yield self.copy()
            return
        with _LENT:  # itself, as a function in place of a verb may know this object alone
            put_back = self._set_aside()
            try:
                yield self
            finally:
                put_back()

    def _follows_copies(self) -> bool:
        """Whether the verbs of a copy act on the copy."""
        return follows_copies(self)

    def _set_aside(self) -> Callable[[], None]:
        """Keep all that the verbs change, and return what puts it back."""
        return set_aside(self)

    def copy(self) -> Self:
        """Return an independent copy; immutable parts (models, laws) are shared.

        Returns
        -------
        Filter
            Of the same class, in the same state.

        Raises
        ------
        ParameterError
            If a method was replaced, on this object, by a function that may be bound to it.
        """
        if not self._follows_copies():
            raise ParameterError(
                f"copy: this {type(self).__name__} has a function in place of its predict or update, "
                "which need not act on a copy; expected a method of the filter: types.MethodType(f, filter)"
            )
        return copy.deepcopy(self)

    # ------------------------------------------------------------------ reset

    def remember_origin(self) -> None:
        """Keep the current state, to which `reset` returns.

        Call it at the start of each method that changes the state of your own filter; only the first call
        since construction or the last `reset` has an effect.
        """
        if "_origin" not in self.__dict__:
            self._origin: dict[str, Any] = copy.deepcopy(self.__dict__, {id(self): self})

    def _remember(self) -> None:
        self.remember_origin()  # under the name that filters of yesterday call

    def reset(self) -> None:
        """Return to the state before the first step since construction or the last reset."""
        if "_origin" in self.__dict__:
            origin = self._origin
            self.__dict__.clear()
            self.__dict__.update(origin)
