"""Controls of many series and of a forecast, and the indexes of whatever goes with observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.kalman.series import as_listed, given_per_step
from fuzzykf.observations import check_aligned, index_of, per_step

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries

__all__ = [
    "Controls",
    "check_rows",
    "control_matrix",
    "control_moves",
    "control_rows",
    "control_width",
    "linear_controls",
    "read_controls",
    "takes_columns",
]


# --------------------------------------------------------------------------- indexes


def check_rows(many: ManySeries, **tables: Any) -> None:
    """Raise unless the tables that all series share, row by row, have the index of each, up to its end.

    Raises
    ------
    ParameterError
        As from `fuzzykf.observations.check_aligned`.
    """
    own = many.index if isinstance(many.index, list) else [many.index]
    known = [one for one in own if hasattr(one, "equals")]
    for name, table in tables.items():
        index = index_of(table)
        if not known or not hasattr(index, "equals"):
            check_aligned(**{name: table})
            continue
        for one in known:
            part = index[: len(one)] if len(index) == many.values.shape[1] else index
            check_aligned(zs=one.to_series(), **{name: part.to_series()})


# --------------------------------------------------------------------------- controls of many series


@dataclass(frozen=True, eq=False)
class Controls:
    """Controls of many series.

    Attributes
    ----------
    values : sequence
        Those of one series as its filter takes them, one for each row; or those of all series, an array
        (series, n) or (series, n, dim_u) with NaN beyond the end of a series.
    is_shared : bool
        Whether they are those of one series, which count for all.
    """

    values: Any
    is_shared: bool

    def of(self, rows: Any, shape: tuple[int, int], is_column: bool) -> list[dict[str, Any]]:
        """Return what the filters of some series are given.

        Parameters
        ----------
        rows : slice or ndarray of int
            Which series.
        shape : tuple of int
            How many these are, and their length.
        is_column : bool
            Whether a control of several components has to be a column.
        """
        series, n = shape
        values = self.values[:n] if self.is_shared else self.values[rows][:, :n]
        if is_column and len(_shape(values)) == (2 if self.is_shared else 3):
            values = as_numbers("us", values)[..., None]
        return [{"us": one} for one in ([values] * series if self.is_shared else values)]

    def numbers(self, shape: tuple[int, int], width: int) -> Controls:
        """Return them as arrays, (n, width) or (series, n, width), where all are finite.

        Raises
        ------
        ShapeError, ParameterError
            If their shape is another one, or something is infinite or missing.
        """
        values = self.values
        if not self.is_shared:
            return Controls(values[..., None] if values.ndim == 2 else values, False)
        if not (isinstance(values, np.ndarray) and values.dtype != object):
            values = _without_none(values, width)
        found, n = as_numbers("us", values), shape[1]
        if found.shape not in {(n, width), (n, width, 1), (1, n, width)} | ({(n,)} if width == 1 else set()):
            raise ShapeError(f"us: got shape {found.shape}, expected {(*shape, width)} or {(n, width)}")
        _check_finite(found, "us")
        return Controls(found.reshape(n, width), True)


def linear_controls(us: Any, many: ManySeries, B: Any, dim_x: int) -> tuple[Controls, FloatArray]:
    """Return the controls of many series as arrays, and their terms B u, (series or 1, n, dim_x).

    Raises
    ------
    ShapeError, ParameterError
        As from `read_controls`; if ``B`` is no matrix that goes with them, or something is not finite.
    """
    matrix = control_matrix(B, dim_x)
    width = matrix.shape[1]
    controls = read_controls(us, many, width).numbers(many.values.shape[:2], width)
    terms: FloatArray = controls.values @ matrix.T
    return controls, terms[None] if controls.is_shared else terms


def control_matrix(B: Any, dim_x: int) -> FloatArray:
    """Return the control matrix of a linear filter; a number is one of one row and column."""
    matrix = None if B is None else as_numbers("B", B)
    if matrix is not None and dim_x == 1 and matrix.shape in {(), (1,)}:
        matrix = matrix.reshape(1, 1)
    if matrix is None:
        raise ShapeError(
            f"B: got None, expected a matrix ({dim_x}, dim_u) to go with us; where it is to be learned, that "
            "from which the search begins, zeros for instance"
        )
    if matrix.ndim != 2:
        raise ShapeError(f"B: got shape {np.shape(B)}, expected ({dim_x}, dim_u) to go with us")
    _check_finite(matrix, "B")
    return matrix


def control_width(filters: Iterable[Any]) -> int:
    """How many components a control of these filters has; 0 if they do not say, or not the same."""
    widths = {width for width in map(_width, filters) if width}
    return widths.pop() if len(widths) == 1 else 0


def _width(f: Any) -> int:
    B = getattr(f, "B", None)
    if getattr(f, "fx", None) is None and B is not None:
        if np.ndim(B) == 2:
            return int(np.shape(B)[1])
        if np.size(B) == np.size(f.x) == 1:
            return 1
    return int(getattr(f, "dim_u", 0))


def takes_columns(filters: Iterable[Any]) -> bool:
    """Whether all of these filters move by F x + B u, with columns for vectors."""
    return all(map(_takes_columns, filters))


def _takes_columns(f: Any) -> bool:
    B: Any = getattr(f, "B", None)
    return getattr(f, "fx", None) is None and np.ndim(f.x) == np.ndim(B) == 2


def control_moves(us: Any, n: int, filters: Iterable[Any]) -> list[dict[str, Any]]:
    """Return the keyword arguments of n predictions: ``u`` of each, as in `control_rows`, or none."""
    return given_per_step(n, us=control_rows(us, n, filters))


def control_rows(us: Any, n: int, filters: Iterable[Any]) -> Any:
    """Return the controls of n steps of one series as `predict` takes them, or None if there are none.

    A row of a table is flat, and becomes a column where the state is one and moves by F x + B u.

    Raises
    ------
    ShapeError
        If there are fewer than n, or a filter that moves by F x + B u has no ``B``.
    """
    if us is None:
        return None
    filters = list(filters)
    rows: Any = per_step("us", us, n)
    for f in filters:
        has_own = getattr(type(f), "_overrides", lambda: True)()  # it knows what it does with them
        if not has_own and getattr(f, "fx", None) is None and getattr(f, "B", 0.0) is None:
            raise ShapeError(f"B: got None, expected a matrix ({f.dim_x}, dim_u) to go with us")
    if not takes_columns(filters):
        return rows
    if isinstance(rows, np.ndarray) and rows.dtype != object:
        return rows[..., None] if rows.ndim == 2 else rows
    return [np.reshape(as_numbers("us", u), (-1, 1)) if len(_shape(u)) == 1 else u for u in rows]


def read_controls(us: Any, many: ManySeries, width: int) -> Controls:
    """Return the controls of many series, in whatever form they come.

    Parameters
    ----------
    us : array_like, DataFrame, DataArray, list, tuple or mapping
        Those of one series, as its filter takes them, count for all: (n, dim_u), or (n,) if ``dim_u`` is 1.
        Each has its own in an array (series, n, dim_u), or in any form that series come in: a mapping, a list
        of tables, a frame with a column for each series (a pair (series, component) if ``dim_u`` is not 1).
    many : ManySeries
        What they go with.
    width : int
        How many components a control has; 0 if nobody knows.

    Raises
    ------
    ShapeError, ParameterError
        If they are of other series or other rows, or it cannot be told what they are.
    """
    if not _is_of_each(us, many, width):
        check_rows(many, us=us)
        return Controls(as_listed("us", us, many.values.shape[1]), True)
    values = as_numbers("us", us) if _is_plain(us) else _beside(us, many, width)
    series, n = many.values.shape[:2]
    lengths = np.full(series, n) if many.lengths is None else many.lengths
    inside, known = np.arange(n) < lengths[:, None], np.isfinite(values)
    wrong = np.argwhere(inside & ~(known if known.ndim == 2 else known.all(axis=2)))
    if len(wrong):
        one, step = wrong[0].tolist()
        raise ParameterError(
            f"us: step {step} of series {one if many.names is None else many.names[one]!r} is "
            f"{values[one, step].tolist()}, expected finite numbers"
        )
    return Controls(values, False)


def _is_of_each(us: Any, many: ManySeries, width: int) -> bool:
    """Whether each series has controls of its own."""
    series, n = many.values.shape[:2]
    if isinstance(us, Mapping):
        return True
    columns = getattr(us, "columns", None)
    if columns is not None:
        if getattr(columns, "nlevels", 1) > 1:
            return True
        if width == 1:
            return len(columns) > 1
        return width == 0 and _names_series(columns, many)
    shape = _shape(us)
    if not shape:  # lists of unequal lengths, or what is no list
        return isinstance(us, list | tuple) and len(us) == series and all(map(_is_table, us))
    of_each = shape[:2] == (series, n) and (
        (len(shape) == 2 and width < 2) or (len(shape) == 3 and width in (0, shape[2]))
    )
    if width:
        return of_each and shape not in {(n,), (n, width), (n, width, 1)}
    if of_each and series == n > 1:
        raise ParameterError(
            f"us: got shape {shape}, and there are {n} series of {n} rows; expected a mapping with the "
            "controls of each, or a filter with a dim_u, which says how many components one has"
        )
    return of_each and shape[0] != n


def _names_series(columns: Any, many: ManySeries) -> bool:
    return many.names is not None and list(columns) == list(many.names)


def _is_table(value: Any) -> bool:
    return hasattr(value, "__len__") and not isinstance(value, str | bytes | bytearray)


def _shape(values: Any) -> tuple[int, ...]:
    """Return the shape of an array or a list; () where lists are of unequal lengths."""
    try:
        return np.shape(values)
    except ValueError:
        return ()


def _is_plain(us: Any) -> bool:
    """Whether it is an array, or a list that is one, without an index."""
    if isinstance(us, list | tuple):
        return bool(_shape(us)) and all(index_of(one) is None for one in us)
    return isinstance(us, np.ndarray)


def _beside(us: Any, many: ManySeries, width: int) -> FloatArray:
    """Read what has one control, or a row of them, for each row of each series."""
    count = _components(us, many, width)
    if width and count != width:
        raise ShapeError(f"us: got controls of {count} components, expected {width}")
    if count == 1:
        return many.beside("us", us)[..., 0]
    return np.stack([many.beside("us", _component(us, k))[..., 0] for k in range(count)], axis=-1)


def _components(us: Any, many: ManySeries, width: int) -> int:
    """How many components the controls have of which each series has its own."""
    if isinstance(us, Mapping):
        return _columns_of(next(iter(us.values()), ()))
    if hasattr(us, "columns"):
        # names of two levels may be those of the series themselves
        is_series = us.columns.nlevels == 1 or width == 1 or _names_series(us.columns, many)
        return 1 if is_series else sum(name[0] == us.columns[0][0] for name in us.columns)
    return _columns_of(us[0])


def _columns_of(table: Any) -> int:
    shape = _shape(table)
    return shape[1] if len(shape) == 2 else 1


def _component(us: Any, k: int) -> Any:
    """Return one component of these controls, in the form in which they come."""
    if isinstance(us, Mapping):
        return {name: _column(table, k) for name, table in us.items()}
    if hasattr(us, "columns"):
        return {name: _column(us[name], k) for name in us.columns.get_level_values(0).unique()}
    if isinstance(us, list | tuple):
        return [_column(table, k) for table in us]
    return us[..., k]


def _column(table: Any, k: int) -> Any:
    """Return a column of a table, with its index."""
    if hasattr(table, "iloc"):
        return table.iloc[:, k]
    return table[:, k] if hasattr(table, "dims") else as_numbers("us", table)[:, k]


def _without_none(values: Sequence[Any], width: int) -> list[Any]:
    """Return controls with zeros where there is none."""
    shape = next((_shape(one) for one in values if one is not None), (width,))
    return [np.zeros(shape) if one is None else one for one in values]


def _check_finite(values: FloatArray, name: str) -> None:
    if not np.isfinite(values).all():
        raise ParameterError(f"{name}: got NaN or infinity, expected finite numbers")
