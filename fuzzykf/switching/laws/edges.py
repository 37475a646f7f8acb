"""Arguments that are given for pairs of classes: the edges of a graph."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_real, brief, is_whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

__all__ = ["as_edge", "as_edges", "as_probability", "check_rule", "entries"]


def as_edge(name: str, pair: Any, n_classes: int) -> tuple[int, int]:
    """Return a pair (a, b) of different classes.

    Raises
    ------
    ParameterError
        If it is none.

    Examples
    --------
    >>> as_edge("fades", (0, 2), 3)
    (0, 2)
    """
    ends = tuple(pair) if isinstance(pair, tuple | list) else ()
    if (
        len(ends) == 2
        and all(is_whole(end) and 0 <= end < n_classes for end in ends)
        and int(ends[0]) != int(ends[1])
    ):
        return int(ends[0]), int(ends[1])
    raise ParameterError(
        f"{name}: got {brief(pair)}, expected a pair (a, b) of different classes among 0 to {n_classes - 1}"
    )


def as_edges(name: str, pairs: Iterable[Any], n_classes: int) -> tuple[tuple[int, int], ...]:
    """Return pairs without direction, each smaller class first, none of them twice.

    Raises
    ------
    ParameterError
        If they are no pairs of different classes, or one stands twice.
    """
    found: list[tuple[int, int]] = []
    for pair in pairs:
        a, b = as_edge(name, pair, n_classes)
        edge = (min(a, b), max(a, b))
        if edge in found:
            raise ParameterError(f"{name}: got {edge} twice, expected each edge once")
        found.append(edge)
    return tuple(found)


def as_probability(name: str, value: Any) -> float:
    """Return a number in [0, 1].

    Raises
    ------
    ParameterError
        If it is none.
    """
    p = as_real(name, value, "a probability in [0, 1]")
    if not 0.0 <= p <= 1.0:
        raise ParameterError(f"{name}: got {p:.6g}, expected a probability in [0, 1]")
    return p


def entries(name: str, given: Any, form: str) -> Iterator[tuple[Any, Any]]:
    """Yield what a mapping holds, by its keys.

    Raises
    ------
    ParameterError
        If it is no mapping; ``form`` says what it should be.
    """
    if not isinstance(given, Mapping):
        raise ParameterError(f"{name}: got {brief(given)}, expected a mapping {form}")
    yield from given.items()


def check_rule(rule: Any) -> None:
    """Refuse a rule of discretisation but "cell": the laws of graphs are known on their cells."""
    if not (isinstance(rule, str) and rule == "cell"):
        raise ParameterError(f"rule: got {brief(rule)}, expected 'cell', the one rule of laws on graphs")
