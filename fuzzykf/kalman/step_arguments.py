"""What a linear filter is told of each step of a series: its matrices, or the time that passes."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_numbers, brief, check_covariance
from fuzzykf.kalman.arguments import TIMED, as_covariance, as_matrix, as_square, given_matrix
from fuzzykf.kalman.controls import control_rows
from fuzzykf.kalman.series import begin
from fuzzykf.observations import as_observations, check_aligned, is_uneven, one_per_step

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = [
    "StepArguments",
    "given_motion",
    "motion_over",
    "own_matrix",
    "read_series",
    "read_spans",
    "read_steps",
]


@dataclass(frozen=True, eq=False)
class StepArguments:
    """What a linear filter is told of each of n steps, checked.

    Attributes
    ----------
    n : int
    us : sequence or None
        Controls, one at least for each step.
    rows : mapping of str to ndarray or list
        By the name of the attribute in whose place they are: matrices (n, ...), or a list in which None
        stands for the attribute.
    uneven : bool
        Whether the steps need not be of one length.
    """

    n: int
    us: Sequence[Any] | None
    rows: Mapping[str, FloatArray | list[FloatArray | None]]
    uneven: bool

    def moves(self) -> list[dict[str, Any]]:
        """Return the arguments of each prediction."""
        found = self._of("F", "Q")
        if self.us is not None:
            for one, u in zip(found, self.us, strict=False):  # there may be more of them
                one["u"] = u
        return found

    def looks(self) -> list[dict[str, Any]]:
        """Return the arguments of each update."""
        return self._of("H", "R")

    def _of(self, *names: str) -> list[dict[str, Any]]:
        told = [(name, self.rows[name]) for name in names if name in self.rows]
        return [{name: rows[k] for name, rows in told if rows[k] is not None} for k in range(self.n)]

    def matrices(self, f: Any, name: str) -> FloatArray:
        """Return the matrix of each step, (n, ...), or the attribute of a filter if nothing was told."""
        rows = self.rows.get(name)
        if rows is None:
            return own_matrix(f, name)
        if isinstance(rows, np.ndarray):
            return rows
        own = own_matrix(f, name)
        return np.array([own if row is None else row for row in rows])


def own_matrix(f: Any, name: str) -> FloatArray:
    """Return F, Q, H or R of a linear filter as an array of the right shape."""
    value, (rows, columns) = getattr(f, name), _shape(f, name)
    return as_matrix(name, value, (rows, columns)) if name in "FH" else as_square(name, value, rows)


def _shape(f: Any, name: str) -> tuple[int, int]:
    n, m = f.dim_x, f.dim_z
    return (n if name in "FQ" else m), (m if name == "R" else n)


def read_series(
    f: Any, zs: Any, told: Mapping[str, Any], resume: bool = False
) -> tuple[FloatArray, StepArguments]:
    """Return a series (n, dim_z), and what is told of its steps, by the names of the arguments."""
    begin(f, zs, resume, is_uneven(told))
    check_aligned(zs=zs, **told)
    series = as_observations(zs, f.dim_z)
    return series, read_steps(f, len(series), **told)


def read_steps(
    f: Any,
    n: int,
    *,
    us: Any = None,
    Rs: Any = None,
    Qs: Any = None,
    Fs: Any = None,
    Hs: Any = None,
    dt: Any = None,
    spans_name: str = "dt",
) -> StepArguments:
    """Read what a filter is told of each of n steps.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        Names what has not one value for each step, and the step whose matrix is inadmissible; if there is a
        ``dt`` and neither F nor Q of the filter is a function of it.
    """
    given = {"F": Fs, "Q": Qs, "H": Hs, "R": Rs}
    rows = {
        name: _read_rows(f"{name}s", values, n, _shape(f, name))
        for name, values in given.items()
        if values is not None
    }
    if dt is not None:
        functions = _functions(f, dt)
        spans, which = np.unique(read_spans(dt, n, spans_name), return_inverse=True)
        for name, function in functions.items():
            rows[name] = _over_spans(name, function, spans, which, rows.get(name), f.dim_x)
    uneven = is_uneven({"Fs": Fs, "Qs": Qs, "dt": dt})
    return StepArguments(n, control_rows(us, n, [f]), rows, uneven)


def _read_rows(
    name: str, values: Any, n: int, shape: tuple[int, int]
) -> FloatArray | list[FloatArray | None]:
    """Read the matrices of n steps; a list where None is among them."""
    each: Any = one_per_step(name, values, n)
    is_covariance = name[0] in "QR"
    if isinstance(each, np.ndarray) and each.shape == (n, *shape) and each.dtype != object:
        return (check_covariance if is_covariance else as_array)(name, each, each.shape)

    def read(k: int, value: Any) -> FloatArray | None:
        if value is None:
            return None
        label = f"{name}[{k}]"
        return as_covariance(label, value, shape[0]) if is_covariance else given_matrix(label, value, shape)

    rows = [read(k, value) for k, value in enumerate(each)]
    return rows if any(row is None for row in rows) else np.array(rows, dtype=np.float64).reshape(n, *shape)


# --------------------------------------------------------------------------- functions of dt


def given_motion(F: Any, Q: Any, n: int) -> tuple[Any, Any]:
    """Return F and Q as they are given at construction, checked unless they are functions; None: identity."""
    return (
        np.eye(n) if F is None else F if callable(F) else given_matrix("F", F, (n, n)),
        np.eye(n) if Q is None else Q if callable(Q) else as_covariance("Q", Q, n).copy(),
    )


def read_spans(dt: Any, n: int, name: str = "dt") -> FloatArray:
    """Return the time that passes before each of n observations.

    Raises
    ------
    ShapeError, ParameterError
        If it is neither one number nor n of them, or one is negative, infinite or missing.
    """
    if getattr(getattr(dt, "dtype", None), "kind", "") == "m" or isinstance(dt, timedelta):
        raise ParameterError(
            f"{name}: got {brief(dt)}, expected numbers in the unit of time of the functions, which "
            "durations are once they are divided by one (by a second, a day)"
        )
    values = as_numbers(name, dt.to_numpy() if hasattr(dt, "to_numpy") else dt)
    if values.shape not in {(), (n,)}:
        raise ShapeError(
            f"{name}: got shape {values.shape}, expected a number, or one for each of the {n} observations"
        )
    wrong = np.argwhere(~((values >= 0.0) & (values < np.inf)))
    if len(wrong):
        where = tuple(wrong[0].tolist())
        got = f"got {values}" if not where else f"step {where[0]} is {values[where]}"
        first = "; dt[0] leads from where the filter stands to the first observation" if where == (0,) else ""
        raise ParameterError(f"{name}: {got}, expected a finite number of at least 0{first}")
    return np.broadcast_to(values, (n,))


def motion_over(f: Any, dt: Any, F: Any, Q: Any) -> tuple[Any, Any]:
    """Return F and Q of a prediction over the time ``dt``; what is given goes before a function.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        As from `read_steps`.
    """
    functions = _functions(f, dt)
    if np.ndim(dt):
        raise ShapeError(f"dt: got shape {np.shape(dt)}, expected a number")
    span = float(read_spans(dt, 1)[0])
    return (  # one by one, as a function may be dear
        _over("F", functions["F"], span, f.dim_x) if F is None and "F" in functions else F,
        _over("Q", functions["Q"], span, f.dim_x) if Q is None and "Q" in functions else Q,
    )


def _functions(f: Any, dt: Any) -> dict[str, Callable[[float], Any]]:
    """Return which attributes of a filter are functions of ``dt``, by name: one at least."""
    found = {name: getattr(f, name) for name in TIMED if callable(getattr(f, name))}
    if not found:
        raise ParameterError(
            f"dt: got {brief(dt)}, but neither F nor Q of this {type(f).__name__} is a function of it; "
            "expected None, or one of them to be such a function"
        )
    return found


def _over(name: str, function: Callable[[float], Any], span: float, n: int) -> FloatArray:
    """Return what a function says of one span, copied: it may use its array again."""
    label, value = f"{name}(dt={span})", function(span)
    return given_matrix(label, value, (n, n)) if name == "F" else as_covariance(label, value, n).copy()


def _over_spans(
    name: str,
    function: Callable[[float], Any],
    spans: FloatArray,
    which: Any,
    rows: FloatArray | list[FloatArray | None] | None,
    n: int,
) -> FloatArray:
    """Return the matrices of all steps, of which those of ``rows`` are given; each span is asked for once."""
    if isinstance(rows, np.ndarray):
        return rows
    wanted = which if rows is None else which[[row is None for row in rows]]
    found = {k: _over(name, function, float(spans[k]), n) for k in np.unique(wanted).tolist()}
    given = [None] * len(which) if rows is None else rows
    matrices = [found[k] if row is None else row for k, row in zip(which.tolist(), given, strict=True)]
    return np.array(matrices, dtype=np.float64).reshape(len(which), n, n)
