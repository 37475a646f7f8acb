"""Whole series through a linear filter: in the engine where its verbs are its own, else by them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf import engine
from fuzzykf.base import MOST_THREADS, check_keep
from fuzzykf.engine.selected import filter_linear, filter_linear_many
from fuzzykf.gaussian import as_count
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError, check_in_range, control_term
from fuzzykf.kalman.controls import check_rows, linear_controls
from fuzzykf.kalman.series import FIELDS, as_listed, collect, empty_fields, field_shapes
from fuzzykf.kalman.smoothing import LinearMotions
from fuzzykf.kalman.step_arguments import StepArguments, own_matrix, read_spans, read_steps
from fuzzykf.many import as_output_type, as_stored, over_threads, read_many, stacked
from fuzzykf.observations import is_uneven

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FilterResult

__all__ = [
    "MOMENTS",
    "LinearModel",
    "filter_at_once",
    "filter_many",
    "filter_one",
    "forward",
    "forward_and_motions",
    "model_of",
]


#: The `FIELDS` without the likelihood.
MOMENTS = FIELDS[:4]


class LinearModel(NamedTuple):
    """The attributes of a linear filter as arrays of the right shapes.

    Matrices that are told of each step have a leading axis for the steps.
    """

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray
    H: FloatArray
    R: FloatArray
    alpha_sq: float


def model_of(f: Any, steps: StepArguments | None = None) -> LinearModel:
    """Return the arrays of a filter, with what it is told of the steps of a series."""
    x, P = f._state()
    F, Q, H, R = (own_matrix(f, one) if steps is None else steps.matrices(f, one) for one in "FQHR")
    return LinearModel(x, P, F, Q, H, R, f._alpha_sq)


# --------------------------------------------------------------------------- one series


def forward(f: Any, series: FloatArray, steps: StepArguments) -> dict[str, FloatArray]:
    """Filter a series (n, m), and return the `FIELDS`; the filter stays at its end."""
    if len(series) and f._is_plain():
        return filter_at_once(f, series, steps)
    return collect(f, series, field_shapes(f.dim_x), steps.moves(), steps.looks())


def forward_and_motions(
    f: Any, series: FloatArray, steps: StepArguments
) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
    """Filter a series; return the `FIELDS`, the transition to each step, and what covariance came with it."""
    if not (len(series) and f._is_plain()):
        motions = LinearMotions(f, steps.moves())
        shapes = field_shapes(f.dim_x)
        stored = collect(f, series, shapes, motions.moves, steps.looks(), moved=motions)
        return stored, motions.F, motions.noise
    begin = f._state()[1]
    stored = filter_at_once(f, series, steps)
    before = np.concatenate([begin[None], stored["P"][:-1]])
    F, noise = (np.broadcast_to(steps.matrices(f, name), before.shape) for name in "FQ")
    if f._alpha_sq != 1.0:
        noise = noise + (f._alpha_sq - 1.0) * (F @ before @ np.swapaxes(F, -1, -2))
    return stored, F, noise


def filter_at_once(
    f: Any, series: FloatArray, steps: StepArguments, names: tuple[str, ...] = FIELDS
) -> dict[str, FloatArray]:
    """Do predict and update for a whole series, one row at least, and stay at its last observation."""
    model = model_of(f, steps)
    terms = None if steps.us is None else _control_terms(f.B, steps, model.x)
    stored, innovation = filter_one(model, series, names, terms)
    x, P, x_prior, P_prior = (stored[name][-1] for name in MOMENTS)
    check_in_range(x=x, P=P)  # what is no number stays none
    f._end_series((x_prior, P_prior), (x, P), series[-1], innovation)
    return stored


def _control_terms(B: Any, steps: StepArguments, x: FloatArray) -> FloatArray:
    """Return B u of each step, (n, d)."""
    given: Any = steps.us
    terms = [np.ravel(control_term(B, given[k], x)) for k in range(steps.n)]
    return np.array([np.broadcast_to(one, (len(x),)) for one in terms])


def filter_one(
    model: LinearModel, series: FloatArray, names: Iterable[str], terms: FloatArray | None = None
) -> tuple[dict[str, FloatArray], tuple[FloatArray, ...] | None]:
    """Do predict and update for a series (n, m).

    Parameters
    ----------
    model : LinearModel
    series : ndarray, shape (n, m)
    names : iterable of str
        Fields to be stored, x and P among them.
    terms : ndarray, shape (n, d), optional
        The terms B u.

    Returns
    -------
    stored : dict of ndarray
        The fields named.
    innovation : tuple of ndarray, or None
        y, S, SI and K of the latest step of which something was observed.
    """
    x, P, *matrices, alpha_sq = model
    stored = empty_fields(names, field_shapes(len(P)), len(series))
    innovation = None
    try:
        for begin, end in pairwise(_changes(matrices, len(series))):
            part = {name: one[begin:end] for name, one in stored.items()}
            F, Q, H, R = (one if one.ndim == 2 else one[begin] for one in matrices)
            controls = None if terms is None else terms[begin:end]
            found = filter_linear(x, P, series[begin:end], F, Q, H, R, alpha_sq, controls, part)
            innovation = innovation if found is None else found
            x, P = stored["x"][end - 1], stored["P"][end - 1]
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    return stored, innovation


def _changes(matrices: Iterable[FloatArray], n: int) -> list[int]:
    """Return where runs of steps with the same matrices begin, each a call of the engine, and their end."""
    new = np.zeros(n, dtype=np.bool_)
    for one in matrices:
        if one.ndim == 3:
            new[1:] |= (one[1:] != one[:-1]).any(axis=(1, 2))
    return [0, *np.flatnonzero(new).tolist(), n]


# --------------------------------------------------------------------------- many series


def filter_many(
    f: Any,
    zs: Any,
    by: Any,
    keep: Iterable[str],
    us: Any,
    told: Mapping[str, Any],
    threads: int = 1,
    dtype: Any = np.float64,
) -> FilterResult:
    """Do `KalmanFilter.filter_many`, whose parameters these are; ``told`` are those for the steps."""
    names, dtype = check_keep(keep, FIELDS), as_output_type(dtype)
    threads = as_count("threads", threads, 1, MOST_THREADS)
    many = read_many(zs, f.dim_z, by, uneven=is_uneven(told))
    n, shared = many.values.shape[1], {name: one for name, one in told.items() if one is not None}
    spans = None
    if _is_of_each(shared.get("dt")):
        spans = many.beside("dt", shared.pop("dt"), uneven=True)[..., 0]
    check_rows(many, **shared)
    if "dt" in shared:
        shared["dt"] = read_spans(shared["dt"], n)
    shared = {name: as_listed(name, rows, n) for name, rows in shared.items()}
    steps = read_steps(f, n, **shared)
    controls, terms = (None, None) if us is None else linear_controls(us, many, f.B, f.dim_x)
    model = model_of(f, steps) if spans is None else None

    def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
        length = series.shape[1]
        of_each: list[dict[str, Any]] = [{name: one[:length] for name, one in shared.items()}] * len(series)
        if spans is not None:
            of_each = [{**one, "dt": span[:length]} for one, span in zip(of_each, spans[rows], strict=True)]
        if not f._is_plain():
            is_column = np.ndim(f.x) == 2
            if controls is not None:
                own = controls.of(rows, series.shape[:2], is_column)
                of_each = [{**one, **more} for one, more in zip(of_each, own, strict=True)]
            found = stacked(f._filter_each(series, of_each), names)
            return as_stored(found, dtype)
        shifts = None if terms is None else (terms if len(terms) == 1 else terms[rows])[:, :length]
        if model is not None:
            stored = empty_fields(names, field_shapes(f.dim_x), *series.shape[:2], dtype=dtype)
            _side_by_side(model, series, shifts, stored, threads)
            if dtype != np.float64:
                _check_stored(model, series, shifts, stored, threads, dtype)
        else:
            called = range(len(many.values)) if many.names is None else many.names
            each = np.array(called, dtype=object)[rows]
            stored = _one_by_one(f, series, names, shifts, of_each, each, dtype)
        check_in_range(**{name: stored[name][:, -1:] for name in MOMENTS if name in stored})
        return stored

    return many.filtered(several)


def _side_by_side(
    model: LinearModel,
    series: FloatArray,
    terms: FloatArray | None,
    out: dict[str, FloatArray],
    threads: int,
) -> None:
    """Fill the fields of many series (series, n, m) of one model.

    ``terms`` are the terms B u, (series or 1, n, d), see `fuzzykf.kalman.controls.linear_controls`.
    """
    x, P, F, Q, H, R, alpha_sq = model

    def several(rows: slice) -> None:
        own = terms if terms is None or len(terms) == 1 else terms[rows]
        part = {name: values[rows] for name, values in out.items()}
        filter_linear_many(x.ravel(), P, series[rows], F, Q, H, R, alpha_sq, own, part)

    try:  # NumPy keeps its lock, so that threads would but wait for one another
        over_threads(several, len(series), threads if engine.info().name == "compiled" else 1)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error


def _check_stored(
    model: LinearModel,
    series: FloatArray,
    terms: FloatArray | None,
    stored: Mapping[str, FloatArray],
    threads: int,
    dtype: Any,
) -> None:
    """Refuse fields that the engine has stored as infinite where in double precision they are not."""
    lost = np.zeros(len(series), dtype=np.bool_)
    for values in stored.values():
        lost |= np.isinf(values).any(axis=tuple(range(1, values.ndim)))
    rows = np.flatnonzero(lost)
    if len(rows):
        doubles = empty_fields(stored, field_shapes(len(model.P)), len(rows), series.shape[1])
        own = terms if terms is None or len(terms) == 1 else terms[rows]
        _side_by_side(model, series[rows], own, doubles, threads)
        as_stored(doubles, dtype)


def _one_by_one(
    f: Any,
    series: FloatArray,
    names: Iterable[str],
    terms: FloatArray | None,
    told: Sequence[Mapping[str, Any]],
    called: Sequence[Any],
    dtype: Any,
) -> dict[str, FloatArray]:
    """Return the fields named for many series, each of which moves over spans of its own.

    ``told`` are the arguments of each for its steps, and ``called`` what an error calls it.
    """
    shapes = field_shapes(f.dim_x)
    out, n = empty_fields(names, shapes, *series.shape[:2], dtype=dtype), series.shape[1]
    for k, zs in enumerate(series):
        steps = read_steps(f, n, **told[k], spans_name=f"dt of series {called[k]!r}")
        shifts = None if terms is None else terms[0 if len(terms) == 1 else k]
        stored, _ = filter_one(model_of(f, steps), zs, shapes, shifts)
        for name, values in as_stored({name: stored[name] for name in out}, dtype).items():
            out[name][k] = values
    return out


def _is_of_each(dt: Any) -> bool:
    """Whether each of many series has spans of its own."""
    if isinstance(dt, Mapping) or hasattr(dt, "columns"):
        return True
    try:
        return np.ndim(dt) > 1
    except ValueError:  # of lists of unequal lengths
        return True
