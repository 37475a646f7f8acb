"""What the members of a pool are told: inputs go to those that have some."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.switching.filters.driven_filter import DrivenFilter
from fuzzykf.switching.filters.driver import refuse

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

__all__ = ["told_of_members"]


def told_of_members(members: Sequence[Any], told: Mapping[str, Any]) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield each member with what it is told beside observations.

    A switching filter whose model has no inputs is told none, where another member has some.

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
    plain = [isinstance(one, DrivenFilter) and not one.has_inputs for one in members]
    for name in ("u", "us"):
        if all(plain):
            refuse(name, told.get(name))
    for one, is_plain in zip(members, plain, strict=True):
        left_out = ("u", "us") if is_plain else ()
        yield one, {name: value for name, value in told.items() if name not in left_out}
