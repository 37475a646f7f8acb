"""Whole series: what `filter`, `smooth`, `batch_filter` and `filter_many` have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf import results
from fuzzykf.base import FilterResult, index_of
from fuzzykf.errors import ShapeError
from fuzzykf.gaussian import as_flag, brief
from fuzzykf.observations import PerStep, as_listed, named_per_step, per_step
from fuzzykf.overrides import attributes_of
from fuzzykf.sequel import warn_of_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = [
    "BANK_FIELDS",
    "FIELDS",
    "PerStep",
    "as_batch",
    "as_listed",
    "as_result",
    "begin",
    "collect",
    "come_to_the_end",
    "empty_fields",
    "field_shapes",
    "given_per_step",
    "named_per_step",
    "one_by_one",
    "per_step",
    "run_batch",
    "run_verbs",
    "unchanged_on_error",
    "whole_verb",
]


#: What a filter with one mean and one covariance can tell about a series, and what a bank can.
FIELDS = ("x", "P", "x_prior", "P_prior", "log_likelihood")
BANK_FIELDS = (*FIELDS, "mu")


def field_shapes(dim_x: int, modes: int = 0) -> dict[str, tuple[int, ...]]:
    """Shapes of `FIELDS` at one step, or of `BANK_FIELDS`."""
    return results.field_shapes(BANK_FIELDS if modes else FIELDS, state=dim_x, node=modes)


def empty_fields(
    names: Iterable[str], shapes: Mapping[str, tuple[int, ...]], *steps: int, dtype: Any = np.float64
) -> dict[str, FloatArray]:
    """Arrays for the fields named, with the leading axes ``steps``."""
    return {name: np.empty((*steps, *shapes[name]), dtype) for name in names}


class unchanged_on_error:
    """Put filters back into the state they came with when the block raises.

    The verbs of this package write into no array that anybody else holds, so that a copy of the
    attribute dictionary keeps the old state.  Other filters (filterpy's unscented one) may write into theirs.
    """

    def __init__(self, *filters: Any) -> None:
        self._before = [(each, attributes_of(each)) for each in filters]

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            for each, state in self._before:
                each.__dict__.clear()
                each.__dict__.update(state)


class whole_verb(unchanged_on_error):
    """A verb of the first of these filters, which remembers where it began: all of it, or no trace of it."""

    def __enter__(self) -> None:
        self._before[0][0].remember_origin()


def one_by_one(zs: Any) -> Sequence[Any]:
    """Return the observations of a series, which may be gone through once, to be taken by their number."""
    if not (hasattr(zs, "to_numpy") or hasattr(zs, "__len__")):
        if not hasattr(zs, "__iter__"):
            raise ShapeError(f"zs: got {brief(zs)}, expected a series of observations")
        zs = list(zs)
    return as_listed("zs", zs, 0)


def given_per_step(n: int, **given: PerStep | None) -> list[dict[str, Any]]:
    """Return keyword arguments for each step, of the lists that were given; "us" becomes u."""
    lists = {name[:-1]: per_step(name, values, n) for name, values in given.items() if values is not None}
    return [{name: values[k] for name, values in lists.items()} for k in range(n)]


def collect(
    filter_: Any,
    series: FloatArray,
    shapes: Mapping[str, tuple[int, ...]],
    moves: Sequence[Mapping[str, Any]],
    looks: Sequence[Mapping[str, Any]] | None = None,
    members: Iterable[Any] = (),
    moved: Callable[[int, FloatArray, FloatArray], None] | None = None,
) -> dict[str, FloatArray]:
    """Run a filter along a series and store the attributes named in ``shapes``.

    Its verbs are given the keyword arguments ``moves`` and ``looks`` of each step; ``moved`` is called
    between them, with the number of the step and copies of x and P before it.  An error
    leaves the filter and its ``members`` as they were.
    """
    stored = empty_fields(shapes, shapes, len(series))
    with unchanged_on_error(filter_, *members):
        for k, z in enumerate(series):
            if moved is None:
                filter_.predict(**moves[k])
            else:
                x, P = (value.copy() for value in filter_._state())
                filter_.predict(**moves[k])
                moved(k, x, P)
            filter_.update(z, **(looks[k] if looks else {}))
            for name, values in stored.items():
                values[k] = np.reshape(getattr(filter_, name), shapes[name])
    return stored


def begin(f: Any, zs: Any, resume: bool, uneven: bool = False) -> None:
    """Raise if a series is to go on where a filter stands, and its times do not.

    ``uneven`` is that of `as_result`.
    """
    if as_flag("resume", resume):
        f._check_next(index_of(zs), uneven)


def come_to_the_end(f: Any, zs: Any) -> Any:
    """Return the index of a series, None if it has none; the filter, which is at its end, remembers it."""
    index = index_of(zs)
    if index is not None:
        f._follow(index)
    return index


def as_result(
    f: Any, stored: dict[str, FloatArray], zs: Any, uneven: bool = False, **more: Any
) -> FilterResult:
    """Return what a filter found that has come to the end of a series, with the index of that.

    ``uneven`` says that the steps were told to the filter, so that they need not be of one length.
    """
    index = come_to_the_end(f, zs)
    if not uneven:
        warn_of_steps(index)
    return FilterResult(**stored, **more, index=index).with_coords(zs)


def as_batch(
    f: Any, stored: dict[str, FloatArray], zs: Any, flat: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return filterpy's four arrays of what a filter found that has come to the end of a series.

    The means are columns unless x is flat.
    """
    come_to_the_end(f, zs)
    x, x_prior = stored["x"], stored["x_prior"]
    if not flat:
        x, x_prior = x[..., None], x_prior[..., None]
    return x, stored["P"], x_prior, stored["P_prior"]


def run_verbs(
    f: Any,
    zs: Any,
    observations: Sequence[Any],
    moves: Sequence[Mapping[str, Any]],
    looks: Sequence[Mapping[str, Any]],
    update_first: bool,
    saver: Any,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return filterpy's four arrays of what the verbs of a filter find along a series.

    Those of step k are given the keyword arguments ``moves[k]`` and ``looks[k]``.  An error leaves the filter
    as it was.
    """

    def predict(k: int) -> tuple[Any, Any]:
        f.predict(**moves[k])
        return f.x, f.P

    def update(k: int) -> tuple[Any, Any]:
        f.update(observations[k], **looks[k])
        return f.x, f.P

    form = f._state()[0].shape
    with unchanged_on_error(f):
        found = run_batch(len(observations), form, predict, update, update_first, saver)
    if not update_first:  # else it has gone on from there
        come_to_the_end(f, zs)
    return found


def run_batch(
    n: int,
    form: tuple[int, ...],
    predict: Callable[[int], tuple[Any, Any]],
    update: Callable[[int], tuple[Any, Any]],
    update_first: bool,
    saver: Any,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return filterpy's four arrays of what two verbs, called with the number of a step, return.

    ``form`` is the shape of x; ``saver`` saves after each step.
    """
    square = (n, form[0], form[0])
    means, covariances, means_p, covariances_p = (np.empty(s) for s in ((n, *form), square) * 2)
    verbs = [(predict, means_p, covariances_p), (update, means, covariances)]
    for k in range(n):
        for verb, xs, Ps in reversed(verbs) if update_first else verbs:
            xs[k], Ps[k] = verb(k)
        if saver is not None:
            saver.save()
    return means, covariances, means_p, covariances_p
