"""What happens along a known switch, as a law of fades counts it: leaving, jumping, advancing, turning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.chain import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["FadeEvents", "count_events"]

Edge = tuple[int, int]


@dataclass
class FadeEvents:
    """Numbers of events.

    Attributes
    ----------
    visits : ndarray, shape (K,)
        Steps that begin at each class.
    begun, jumped : dict
        How often each fade began at its class, and each jump was made.
    steps, way : dict
        For each fade, how many steps began in it, and how far they went: 1 from end to end.
    turned : int
        Steps from a fade to the fade back.
    """

    visits: FloatArray
    begun: dict[Edge, float] = field(default_factory=dict)
    jumped: dict[Edge, float] = field(default_factory=dict)
    steps: dict[Edge, float] = field(default_factory=dict)
    way: dict[Edge, float] = field(default_factory=dict)
    turned: int = 0


def count_events(paths: Sequence[FloatArray], n_classes: int) -> FadeEvents:
    """Count what a switch does along its paths.

    A switch goes in a direction from one value between two classes to the next; while it stands still it
    goes on in the direction that it had, or that it takes next.

    Parameters
    ----------
    paths : sequence of ndarray, shape (n, K)
        Class weights.
    n_classes : int

    Raises
    ------
    ParameterError
        If a value is between more than two classes, or a step leads from between two classes to between
        others, past a class.
    """
    events = FadeEvents(np.zeros(n_classes))
    for path in paths:
        for ends, t in _stretches(path):
            _count_stretch(events, ends, t)
        hard = path.max(axis=1) == 1.0
        at = path.argmax(axis=1)
        np.add.at(events.visits, at[:-1][hard[:-1]], 1.0)
        for n in np.flatnonzero(hard[:-1] & hard[1:] & (at[:-1] != at[1:])).tolist():
            _add(events.jumped, (int(at[n]), int(at[n + 1])), 1)
    return events


def _stretches(path: FloatArray) -> list[tuple[Edge, FloatArray]]:
    """Return the stretches between classes a and b: (a, b), and the shares of b, with the ends at classes."""
    between = path > 0.0
    many = between.sum(axis=1) > 2
    if many.any():
        raise ParameterError(
            f"r: got {value_of(path[many][0])}, between {int(between[many][0].sum())} classes; expected "
            "values at a class, or between two"
        )
    soft = between.sum(axis=1) == 2
    edges = np.flatnonzero(np.diff(np.concatenate([[False], soft, [False]]).astype(int)))
    found = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        a, b = np.flatnonzero(between[begin]).tolist()
        low, high = max(begin - 1, 0), min(end + 1, len(path))  # with the classes before and after it
        part = path[low:high]
        off = part[:, a] + part[:, b] < 1.0 - 1e-9
        if off.any():
            n = int(off.argmax())
            raise ParameterError(
                f"r: goes from {value_of(part[max(n - 1, 0)])} to {value_of(part[max(n, 1)])} in a step, "
                "past a class; expected a switch that stops at a class before it fades into another"
            )
        found.append(((a, b), part[:, b]))
    return found


def _count_stretch(events: FadeEvents, ends: Edge, t: FloatArray) -> None:
    """Count along shares t of the second class; those at either end may be 0 or 1."""
    a, b = ends
    move = np.diff(t)
    direction = np.sign(move)
    known = np.flatnonzero(direction)
    if known.size == 0:
        return  # it does not move at all: nothing says in which fade it is
    # a step without a move goes on as the one before it, the first ones as the first that moves
    last = np.maximum.accumulate(np.where(direction != 0.0, np.arange(len(direction)), -1))
    direction = direction[np.where(last >= 0, last, known[0])]
    fades = {1.0: (a, b), -1.0: (b, a)}
    inside = (t[:-1] > 0.0) & (t[:-1] < 1.0)
    if not inside[0]:
        _add(events.begun, fades[float(direction[0])], 1)
        if 0.0 < t[-1] < 1.0:  # of a fade that is cut off the step from its class is no part of its way
            move[0] = 0.0
    for way in np.unique(direction).tolist():
        on = direction == way
        _add(events.steps, fades[way], float((inside & on).sum()))
        _add(events.way, fades[way], float(np.abs(move[on]).sum()))
    events.turned += int((direction[1:] != direction[:-1]).sum())


def _add(counts: dict[Edge, float], key: Edge, more: float) -> None:
    counts[key] = counts.get(key, 0.0) + more
