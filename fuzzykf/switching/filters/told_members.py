"""What the members of a pool are told: inputs go to those that have some."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.errors import ShapeError
from fuzzykf.switching.filters.driven_filter import DrivenFilter
from fuzzykf.switching.filters.driver import refuse

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["inputs_of", "told_of_members"]


def told_of_members(members: Sequence[Any], told: Mapping[str, Any]) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield each member with what it is told beside observations.

    A switching filter whose model has no inputs, or a pool of such, is told none where others have some.

    Parameters
    ----------
    members : sequence of Filter
    told : mapping
        Keyword arguments of a verb.

    Raises
    ------
    ParameterError
        If there are inputs, and no member has any.
    """
    plain = [_has_none(one) for one in members]
    for name in ("u", "us"):
        if all(plain):
            refuse(name, told.get(name))
    for one, is_plain in zip(members, plain, strict=True):
        left_out = ("u", "us") if is_plain else ()
        yield one, {name: value for name, value in told.items() if name not in left_out}


def _has_none(member: Any) -> bool:
    """Whether a member is a filter that may have inputs, and has none."""
    if hasattr(member, "members"):
        return all(_has_none(one) for one in member.members)
    return isinstance(member, DrivenFilter) and not member.has_inputs


def inputs_of(inputs: FloatArray | None, rows: Any, n: int) -> dict[str, FloatArray]:
    """Return inputs (n, k) or (series, n, k) of some of the series, up to row ``n``, as arguments.

    Raises
    ------
    ShapeError
        If they are of another shape.
    """
    if inputs is None:
        return {}
    if inputs.ndim not in (2, 3):
        raise ShapeError(f"us: got shape {inputs.shape}, expected (n, k) or (series, n, k)")
    return {"us": inputs[:n] if inputs.ndim == 2 else inputs[rows, :n]}
