"""Training data: shapes, missing stretches, several series, standard units."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.labels import NO_LABELS, Labels, match_series, ordered, read_labels
from fuzzykf.missing import as_floats
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.steps import step_note
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.learning.further import (
    DEPENDENT,
    SIZES,
    Further,
    check_unknown,
    further_of,
    read_inputs,
)
from fuzzykf.texts import counted
from fuzzykf.times import as_spans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = ["MIN_TRANSITIONS", "Earlier", "Scale", "TrainingData", "component", "gather", "irregular"]

#: Standard deviations of no more than so many gaps between the doubles around the values are rounding errors:
#: at 1e7 the gap is 1.9e-9.  Of noise that is larger, rounding takes less than a thousandth of the variance.
ROUNDING = 8.0

#: A model has a dozen parameters per pair of regimes; less data than this cannot support it.
MIN_TRANSITIONS = 20

#: Standard deviations of earlier data beyond which numbers are in other units: next to their squares those of
#: the earlier data are lost.
FARTHEST = 1e8


@dataclass(frozen=True)
class Scale:
    """Units in which the data have mean zero and variance one, per component.

    Attributes
    ----------
    mean, std : ndarray, shape (d,)
    """

    mean: FloatArray
    std: FloatArray


class Earlier(NamedTuple):
    """What data that were learned from before settled for those that follow.

    Attributes
    ----------
    scale : Scale
        The units that stay.
    labels : Labels
    dim_x : int
    further : Further or None
        Likewise: the map of the window and its units.
    """

    scale: Scale
    labels: Labels
    dim_x: int
    further: Further | None = None


@dataclass(frozen=True)
class TrainingData:
    """All transitions of all series, in standard units.

    Attributes
    ----------
    z : ndarray, shape (N, d)
        (X, Y) of all rows in which Y is complete, standardised, series after series; X is NaN where a
        component of it is missing.
    before, after : ndarray of int, shape (T,)
        Rows of `z` that follow one another.
    starts : ndarray of int
        Rows of `z` at which a stretch without gaps in Y begins.
    r : ndarray, shape (N,) or (N, K), or None
        The switch, where it is known.
    scale : Scale
        Of X in the rows in which it is known.
    dim_x : int
    known : ndarray of bool, shape (N,)
        Rows in which X is known.
    has_state : ndarray of bool, shape (T,)
        Transitions that say something of the regression of the state: X is known after them and, if the
        state depends on the one before, before them.
    kept : ndarray of int
        Positions of the rows of `z` in the data as given, series after series.
    n_rows : int
        Number of rows given.
    labels : Labels
        What the data say of themselves: names, units, the length of a step.
    further : Further or None
        Inputs and features of each transition.
    us : ndarray, shape (N, k), or None
        Inputs of the rows of `z`, as they were given.
    """

    z: FloatArray
    before: np.ndarray
    after: np.ndarray
    starts: np.ndarray
    r: FloatArray | None
    scale: Scale
    dim_x: int
    known: BoolArray
    has_state: BoolArray
    kept: np.ndarray
    n_rows: int
    labels: Labels = NO_LABELS
    further: Further | None = None
    us: FloatArray | None = None

    @property
    def window(self) -> tuple[int, int]:
        """How many further numbers both equations have, and each of its own; see `Further`."""
        return (0, 0) if self.further is None else self.further.sizes

    @property
    def is_complete(self) -> bool:
        """Whether X is known in every row."""
        return bool(self.known.all())

    @property
    def n_measured(self) -> int:
        """How many numbers were measured."""
        N, d = len(self.z), int(self.z.shape[1])
        states = int(np.count_nonzero(self.known))
        return states * self.dim_x + N * (d - self.dim_x)


def gather(
    x: Any,
    y: Any,
    r: Any = None,
    n_fuzzy: int = 2,
    *,
    state_feedback: bool = True,
    complete: bool = False,
    earlier: Earlier | None = None,
    inputs: Any = None,
    features: WindowFeatures | None = None,
) -> TrainingData:
    """Bring one series or several to a common form.

    Parameters
    ----------
    x, y : array_like, or sequence of these
        Shapes (n, m) and (n, q), or (n,) for one component; NaN where missing.  Several
        series are given as lists of arrays, or of tables whose columns have the same names.
    r : array_like, or sequence, optional
        The switch, shape (n,).
    n_fuzzy : int
        Number K of classes between which a fuzzy switch moves: between more than two, ``r`` may be class
        weights (n, K).
    state_feedback : bool
        Whether the state is to depend on the one before it.
    complete : bool
        Whether only rows in which x is known count, as if y were missing elsewhere.
    earlier : Earlier, optional
        Of data that these follow: they go by the same names into the same units.  Then a single step will do,
        and x may be missing everywhere.
    inputs : array_like, shape (n, k) or (n,), or sequence of these, optional
        Known at all times.
    features : WindowFeatures, optional

    Raises
    ------
    ShapeError, ParameterError
        If shapes, names or the lengths of steps do not agree, a value is infinite, too little is observed,
        a component is constant, or components determine one another.
    """
    if x is None or y is None:
        missing = "x" if x is None else "y"
        raise ParameterError(
            f"{missing}: missing; the parameters of the state are not identifiable from y alone, so a "
            "stretch of data is needed in which x was measured as well"
        )
    states, observations = _parts(x), _parts(y)
    told = _series_of_inputs(inputs, y, len(observations))
    for one, other, switch, u in zip_longest(states, observations, _parts(r), told):
        check_aligned(x=one, y=other, r=switch, inputs=u)
    if earlier is not None:
        names = earlier.labels
        of_x = Labels(observations=names.states, step=names.step)
        d, m = earlier.scale.mean.size, earlier.dim_x
        states = [match_series(one, of_x, m, "x") for one in states]
        observations = [match_series(one, names, d - m, "y") for one in observations]
    labels = read_labels(states, observations)
    xs = _series("x", ordered(states, labels.states, "x"))
    ys = _series("y", ordered(observations, labels.observations, "y"))
    rs: Sequence[Any] = [None] * len(xs) if r is None else _series("r", _parts(r))
    if not len(xs) == len(ys) == len(rs):
        raise ShapeError(f"x, y, r: got {len(xs)}, {len(ys)} and {len(rs)} series, expected as many of each")
    rows, measured, switches, starts, before, positions = [], [], [], [], [], []
    n_rows = n_given = 0
    n_past = 1 if features is None else features.n_past
    for k, (a, b, c) in enumerate(zip(xs, ys, rs, strict=True)):
        if len(a) != len(b) or (c is not None and len(c) != len(a)):
            raise ShapeError(
                f"x, y, r: series {k} has {counted(len(a), 'state')}, {counted(len(b), 'observation')}"
                + ("" if c is None else f" and {len(c):,} switch{'' if len(c) == 1 else 'es'}")
            )
        z = np.concatenate([a, b], axis=1)
        if c is not None and c.shape[1] != 1 and (n_fuzzy == 2 or c.shape[1] != n_fuzzy):
            ways = "one" if n_fuzzy == 2 else f"one of regimes, or the weights of {n_fuzzy} classes"
            raise ShapeError(f"r: series {k} has {c.shape[1]} columns, expected {ways}")
        whole = np.isfinite(z).all(axis=1)
        counts = whole if complete else np.isfinite(b).all(axis=1)
        if c is not None:
            counts = counts & np.isfinite(c).all(axis=1)
        kept = np.flatnonzero(_after_enough(counts, n_past))
        follows = np.diff(kept) == 1
        at = n_rows + np.arange(kept.size)
        if kept.size:
            starts.append(at[np.concatenate([[True], ~follows])])
            before.append(at[:-1][follows])
        positions.append(n_given + kept)
        n_given += len(z)
        rows.append(z[kept])
        measured.append(whole[kept])
        if c is not None:
            switches.append(c[kept, 0] if c.shape[1] == 1 else c[kept])
        n_rows += kept.size
    for name, series in (("x", xs), ("y", ys), *([] if r is None else [("r", rs)])):
        widths = sorted({block.shape[1] for block in series})
        if len(widths) != 1:
            raise ShapeError(f"{name}: got series of {widths} components, expected as many in each")
    m = xs[0].shape[1]
    if earlier is not None:
        _check_widths(earlier, m, ys[0].shape[1])
    z, known = np.concatenate(rows), np.concatenate(measured)
    first = np.concatenate(before) if before else np.empty(0, dtype=int)
    has_state = known[first + 1] & known[first] if state_feedback else known[first + 1]
    if earlier is None:
        _check_number(known, first, has_state, n_past, state_feedback=state_feedback)
        z, scale = _standardised(z, known, m)
        _check_noise(z, first, has_state, m, state_feedback=state_feedback)
    else:
        z, scale, labels = _in_scale(z, known, first, earlier), earlier.scale, earlier.labels
    kept = np.concatenate(positions)
    further: Further | None = None
    us: list[FloatArray] | None = None
    if inputs is not None or features is not None:
        before_these = None if earlier is None else earlier.further
        called: tuple[str, ...] = ()
        if inputs is not None:
            names_before = None if before_these is None else before_these.inputs
            us, called = read_inputs(told, [len(one) for one in ys], names_before)
        given = features or WindowFeatures()
        further = further_of(ys, us, kept[first + 1], given, called, labels.observations, before_these)
        if earlier is None:
            check_unknown(further, z[first], z[first + 1], m, feedback=state_feedback)
    return TrainingData(
        z=z,
        before=first,
        after=first + 1,
        starts=np.concatenate(starts),
        r=np.concatenate(switches) if r is not None else None,
        scale=scale,
        dim_x=m,
        known=known,
        has_state=has_state,
        kept=kept,
        n_rows=n_given,
        labels=labels,
        further=further,
        us=None if us is None else np.concatenate(us)[kept],
    )


def _after_enough(counts: Any, n: int) -> BoolArray:
    """Return which rows end ``n`` rows in a row that count: those whose window was wholly observed.

    What would stand for the others is made up, and would be learned from as if it had been measured.
    """
    found: BoolArray = counts.copy()
    for lag in range(1, n):
        found[lag:] &= counts[:-lag]
        found[:lag] = False
    return found


def irregular(x: Any, y: Any) -> list[str]:
    """Say of which series rows are missing in an index of times or durations, or have unequal steps."""
    several = _are_several(x) or _are_several(y)
    notes = []
    for k, tables in enumerate(zip_longest(_parts(x), _parts(y))):
        indexed = ((name, index_of(table)) for name, table in zip("xy", tables, strict=True))
        name, index = next(((name, index) for name, index in indexed if index is not None), ("", None))
        times = as_spans(index)
        note = None if times is None else step_note(times, name, index, is_index=True)
        if note is not None:
            notes.append(f"series {k}: {note}" if several else note)
    return notes


def _check_number(
    known: BoolArray, first: IntArray, has_state: BoolArray, n_past: int, *, state_feedback: bool
) -> None:
    """Raise if there are too few transitions from which the state can be learned."""
    n = int(has_state.sum())
    if n >= MIN_TRANSITIONS:
        return
    alone = int(known[first + 1].sum())
    if state_feedback and alone >= MIN_TRANSITIONS:
        raise ParameterError(
            f"x, y: hold {counted(n, 'step')} in which x and y are both measured before and after, expected "
            f"at least {MIN_TRANSITIONS} for a state that depends on the one before; x is measured in "
            f"{alone:,} rows that follow one with y, from which state_feedback=False learns a state that "
            "does not"
        )
    what = "x and y are both measured" if state_feedback else "y is measured, and x after them"
    what += f", and y in the {n_past} rows before" if n_past > 1 else ""
    raise ParameterError(
        f"x, y: hold {counted(n, 'step')} in which {what}, expected at least {MIN_TRANSITIONS}; the "
        "parameters of the state are not identifiable from y alone"
    )


def _standardised(z: FloatArray, known: BoolArray, m: int) -> tuple[FloatArray, Scale]:
    """Bring (x, y) to standard units, x by the rows in which it is known; elsewhere it becomes NaN.

    Raises
    ------
    ParameterError
        See `_in_units`.
    """
    names = [component(column, m) for column in range(z.shape[1])]
    if known.all():
        standard, mean, std = _in_units(z, names)
        return standard, Scale(mean, std)
    states, mean_x, std_x = _in_units(z[known, :m], names[:m])
    observations, mean_y, std_y = _in_units(z[:, m:], names[m:])
    standard = np.full(z.shape, np.nan)
    standard[known, :m], standard[:, m:] = states, observations
    return standard, Scale(np.concatenate([mean_x, mean_y]), np.concatenate([std_x, std_y]))


def _check_widths(earlier: Earlier, m: int, q: int) -> None:
    """Raise unless there are as many columns as before."""
    before = earlier.dim_x, earlier.scale.mean.size - earlier.dim_x
    for name, now, then in (("x", m, before[0]), ("y", q, before[1])):
        if now != then:
            raise ShapeError(f"{name}: got {counted(now, 'column')}, expected {then}, as was learned from")


def _in_scale(z: FloatArray, known: BoolArray, first: IntArray, earlier: Earlier) -> FloatArray:
    """Bring (x, y) to the units of earlier data; x that is not known in whole becomes NaN."""
    if not first.size:
        raise ParameterError(
            "x, y: hold no step in which y is measured before and after, expected at least one: two rows in "
            "a row"
        )
    scale, m = earlier.scale, earlier.dim_x
    standard: FloatArray = (z - scale.mean) / scale.std
    standard[~known, :m] = np.nan
    far = np.abs(np.nan_to_num(standard, nan=0.0))
    if not far.max() <= FARTHEST:
        row, column = (int(k) for k in np.unravel_index(int(np.argmax(far)), far.shape))
        raise ParameterError(
            f"{component(column, m)}: got {z[row, column]:.6g}, {far[row, column]:.2g} standard deviations "
            f"away from the mean of the first fit; expected at most {FARTHEST:g}, and the same units"
        )
    return standard


def _in_units(z: FloatArray, names: list[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bring columns to standard units, which are returned with their means and standard deviations.

    They are centred twice: the mean of numbers far from zero misses the true one by a rounding of their size,
    the mean of what is left by a rounding of the noise.

    Raises
    ------
    ParameterError
        If a column is constant, or what varies in it is within rounding of its size.
    """
    gap = np.spacing(np.abs(z).max(axis=0))
    mean = z.mean(axis=0)
    centred = z - mean
    rest = centred.mean(axis=0)
    centred -= rest
    largest = np.maximum(np.abs(centred).max(axis=0), gap)
    std = largest * (centred / largest).std(axis=0)  # squares of the values themselves may leave the range
    column = int(np.argmin(std / gap))
    name, least = names[column], ROUNDING * gap[column]
    if np.ptp(z[:, column]) == 0.0:
        raise ParameterError(f"{name}: is constant ({z[0, column]:.6g}), which no model can be learned from")
    if std[column] <= least:
        raise ParameterError(
            f"{name}: is constant ({mean[column]:.6g}) but for rounding: doubles of this size are "
            f"{gap[column]:.2g} apart; expected a standard deviation of more than {least:.2g}, got "
            f"{std[column]:.2g}; take the offset away before the numbers are rounded"
        )
    low, high = SIZES
    if not ((std > low) & (std < high)).all():
        column = int(np.argmax(np.abs(np.log(std))))
        raise ParameterError(
            f"{names[column]}: got a standard deviation of {std[column]:.2g}, expected one between "
            f"{low:g} and {high:g}, whose square double precision can hold; use other units"
        )
    return centred / std, mean + rest, std


def component(column: int, m: int) -> str:
    """Return what a column of the data is called in messages; x has ``m`` components."""
    return f"x[{column}]" if column < m else f"y[{column - m}]"


def _check_noise(
    z: FloatArray, first: IntArray, has_state: BoolArray, m: int, *, state_feedback: bool
) -> None:
    """Raise if the components of two consecutive times determine one another."""
    d = z.shape[1]
    names = [component(k % d, m) + ("" if k < d else " of the next time") for k in range(2 * d)]
    both = np.concatenate([z[first], z[first + 1]], axis=1)
    if has_state.all() and np.isfinite(both).all():
        _check_relations(both, names)
        return
    y = [*range(m, d), *range(d + m, 2 * d)]
    _check_relations(both[:, y], [names[k] for k in y])
    used = list(range(2 * d)) if state_feedback else list(range(m, 2 * d))
    _check_relations(both[has_state][:, used], [names[k] for k in used])


def _check_relations(values: FloatArray, names: list[str]) -> None:
    eigenvalues, vectors = np.linalg.eigh(np.cov(values.T))
    if eigenvalues[0] < DEPENDENT:
        involved = [names[k] for k in np.flatnonzero(np.abs(vectors[:, 0]) > 1e-3)]
        raise ParameterError(
            f"x, y: an exact linear relation holds between {', '.join(involved)}; expected noise in every "
            "component"
        )


def _series(name: str, parts: Sequence[Any]) -> list[FloatArray]:
    """Return a list of arrays (n, k)."""
    result = []
    for k, part in enumerate(parts):
        try:
            array = as_numbers(name, part.to_numpy() if hasattr(part, "to_numpy") else part).copy()
        except ShapeError as error:
            raise ShapeError(f"{name}: expected numbers, (n, k) or (n,), or a list of such arrays") from error
        if array.ndim == 3 and array.shape[2] == 1:
            array = array[..., 0]
        if array.ndim not in (1, 2) or (array.ndim == 2 and array.shape[1] == 0):
            raise ShapeError(f"{name}: got shape {array.shape}, expected (n, k) or (n,)")
        array = array[:, None] if array.ndim == 1 else array
        if np.isinf(array).any():
            row = int(np.flatnonzero(np.isinf(array).any(axis=1))[0])
            raise ParameterError(
                f"{name}: series {k} has {array[row].tolist()} at {row}, expected finite numbers (NaN "
                "where missing)"
            )
        result.append(array)
    return result


def _parts(value: Any) -> list[Any]:
    return list(value) if _are_several(value) else [value]


def _series_of_inputs(inputs: Any, y: Any, n: int) -> list[Any]:
    """Return the inputs of each of n series: those of a single one are rows, unless y is a list of one."""
    if n > 1 and isinstance(inputs, list | tuple):
        return list(inputs)
    return _parts(inputs) if _are_several(y) else [inputs]


def _are_several(value: Any) -> bool:
    """Tell several series, a list of arrays or tables, from one given as nested lists."""
    if not isinstance(value, (list, tuple)) or len(value) == 0:
        return False
    if all(isinstance(v, np.ndarray) or hasattr(v, "to_numpy") for v in value):
        return any(np.size(v) > 1 for v in value)
    try:
        return as_floats(value).ndim == 3
    except (TypeError, ValueError):  # series of different lengths
        return True
