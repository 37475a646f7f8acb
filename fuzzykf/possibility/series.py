"""What an estimator is told of each step of a series, or of many series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from fuzzykf.errors import ParameterError
from fuzzykf.observations import (
    as_observations,
    check_aligned,
    index_of,
    is_uneven,
    named_per_step,
    one_per_step,
    per_step,
)

if TYPE_CHECKING:
    from fuzzykf.many import ManySeries

__all__ = ["ToldSeries", "of_each", "read_steps"]

#: Arguments of single predictions and of single updates, by the names of those of the verbs.
MOVES = {"us": "u", "Fs": "F", "Qs": "Q"}
LOOKS = {"Hs": "H", "Rs": "R"}


class ToldSeries(NamedTuple):
    """A series, and what is told of its steps.

    Attributes
    ----------
    zs : array_like or list
        As it was given, or a list of what can be gone through once only.
    steps : list of (dict, dict), or None
        Keyword arguments of each prediction and update; None if nothing is told.
    uneven : bool
        Whether they tell how each step moves the state, so that steps may differ in length.
    """

    zs: Any
    steps: list[tuple[dict[str, Any], dict[str, Any]]] | None
    uneven: bool


def read_steps(zs: Any, dim_z: int, told: Mapping[str, Any]) -> ToldSeries:
    """Read the keyword arguments of each prediction and update of a series.

    Parameters
    ----------
    zs : array_like or iterable
    dim_z : int
    told : mapping
        By the names of the arguments of `FuzzyRelationEstimator.filter`; None where one was not given.

    Raises
    ------
    ShapeError, ParameterError
        If something has not one value for each observation, or the rows of another index.
    """
    given = {name: one for name, one in told.items() if one is not None}
    if not given:
        return ToldSeries(zs, None, False)
    check_aligned(zs=zs, **given)
    if not hasattr(zs, "__len__") and hasattr(zs, "__iter__"):
        zs = list(zs)
    n = len(as_observations(zs, dim_z))
    rows = {name: _rows(name, one, n) for name, one in given.items() if not name.endswith("_args")}
    steps = []
    fx_args, hx_args = (named_per_step(name, given.get(name), n) for name in ("fx_args", "hx_args"))
    for k in range(n):
        pair = tuple(
            {
                verb: rows[name][k]
                for name, verb in kinds.items()
                if name in rows and rows[name][k] is not None
            }
            for kinds in (MOVES, LOOKS)
        )
        steps.append((pair[0] | fx_args[k], pair[1] | hx_args[k]))
    return ToldSeries(zs, steps, is_uneven(told))


def _rows(name: str, values: Any, n: int) -> Sequence[Any]:
    """Return one value for each of n steps; of controls there may be more."""
    if name == "us":
        return per_step(name, values, n)
    return one_per_step(name, values, n)


def of_each(many: ManySeries, us: Any, dim_u: int, told: Mapping[str, Any]) -> Any:
    """Return a function that tells what `filter` is told of some of many series, of n steps.

    Parameters
    ----------
    many : ManySeries
    us : array_like, mapping or None
        Those of one series count for all; each has its own in an array (series, n, dim_u) or a mapping.
    dim_u : int
        How many components a control has, if it is known.
    told : mapping
        What all series are told, up to the end of each.

    Raises
    ------
    ShapeError, ParameterError
        If something has not one value for each row, or the rows of another index.
    """
    longest = many.values.shape[1]
    given = {name: one for name, one in told.items() if one is not None}
    own = None
    if isinstance(us, Mapping) or getattr(us, "ndim", 0) == 3:
        own = many.beside("us", us, dim_u or (1 if isinstance(us, Mapping) else us.shape[2]))
    elif us is not None:
        given["us"] = us
    for name, one in given.items():
        index = None if isinstance(many.index, list) else many.index
        if not (index is None or index_of(one) is None or index.equals(index_of(one))):
            raise ParameterError(f"zs, {name}: rows of different indexes; expected the same")
    shared = {
        name: one if name.endswith("_args") else _rows(name, one, longest) for name, one in given.items()
    }

    def arguments(rows: Any, n: int) -> list[dict[str, Any]]:
        cut = {name: one[:n] for name, one in shared.items()}
        if own is None:
            return [cut] * len(rows)
        return [{**cut, "us": own[row, :n]} for row in rows]

    return arguments
