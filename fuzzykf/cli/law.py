"""The law of a fuzzy switch from words of the command line: which classes fade into which, how long."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from fuzzykf.switching.laws.base import Law

__all__ = ["law_of_words", "notes_of_fades"]

_WAY = re.compile(r"\s*(\d+)\s*-\s*(\d+)\s*")

#: Steps from which a search for fades begins unless told otherwise.
STAY, LENGTH = 50.0, 10.0

#: Where a search for the masses of classes and edges begins: a class is this much likelier than an edge.
CLASS_TO_EDGE = 2.0

#: Steps for each cell of a fade beyond which its length is called irregular, and with how many it is less so.
COARSE, FINE = 3.0, 5.0 / 3.0


def notes_of_fades(law: Any, n_nodes: int) -> list[str]:
    """Say that the longest fade has few cells for its length, and what more of them would do.

    Parameters
    ----------
    law : object
        Of a switch; any but a `FadeLaw` is passed over.
    n_nodes : int
        Cells of each fade.

    Examples
    --------
    >>> from fuzzykf import FadeLaw
    >>> notes_of_fades(FadeLaw.between(40, 20), 5)[0][-62:]
    '5 cells: its length varies by 39 %; --nodes 12 makes that 18 %'
    >>> notes_of_fades(FadeLaw.between(40, 20), 12)
    []
    """
    from fuzzykf.switching.laws.fades import FadeLaw

    if not isinstance(law, FadeLaw) or not n_nodes or not law.fades:
        return []
    pair, (_, steps) = max(law.fades.items(), key=lambda fade: fade[1][1])
    if steps <= COARSE * n_nodes:
        return []

    def varies(cells: int) -> str:
        length = law.fade_lengths(cells)[pair]
        return f"{100.0 * length.std / length.mean:.0f} %"

    cells = "cell" if n_nodes == 1 else "cells"
    told = f"a fade takes {steps:.3g} steps on average and has {n_nodes} {cells}: its length varies by "
    told += varies(n_nodes)
    more = law.nodes_up_to(round(steps / FINE))
    return [f"{told}; --nodes {more} makes that {varies(more)}" if more > n_nodes else told]


def law_of_words(
    name: str | None,
    fades: str | None,
    jumps: str | None,
    edges: str | None,
    stay: float | None,
    length: float | None,
) -> str | Law:
    """Return the law to learn: the name of a family, or a law of any number of classes to begin with.

    Parameters
    ----------
    name : str, optional
        Of a family; "fmc1" if nothing is said at all.
    fades, jumps, edges : str, optional
        Pairs of classes, such as ``0-1,1-2,2-0``.
    stay : float, optional
        Steps that the switch stays at a class to begin with, by whatever way it leaves; 50 unless said
        otherwise.
    length : float, optional
        Steps of a fade to begin with; 10.

    Raises
    ------
    ParameterError
        Names the option.

    Examples
    --------
    >>> law_of_words(None, "0-1,1-2,2-0", None, None, 50.0, None)
    FadeLaw(3, {(0, 1): (0.02, 10.0), (1, 2): (0.02, 10.0), (2, 0): (0.02, 10.0)})
    >>> law_of_words(None, None, None, None, None, None)
    'fmc1'
    """
    if fades is None and name != "fade":
        for option, value in (("--stay", stay), ("--length", length)):
            if value is not None:
                raise ParameterError(
                    f"{option}: got {value:g}, but no fades; it goes with --fades or --law fade"
                )
    dwell, steps = (STAY if stay is None else stay), (LENGTH if length is None else length)
    if edges is not None:
        _refuse("--edges", "graph", name, {"--fades": fades})
        return _graph(_ways("--edges", edges), _ways("--jumps", jumps))
    if fades is not None:
        _refuse("--fades", "fade", name, {})
        return _fade(_ways("--fades", fades), _ways("--jumps", jumps), dwell, steps)
    if jumps is not None:
        raise ParameterError("--jumps: got some without --fades or --edges, expected one of these with it")
    if name == "fade" and not stay is length is None:
        return _between(dwell, steps)
    return "fmc1" if name is None else name


def _refuse(option: str, kind: str, name: str | None, others: dict[str, str | None]) -> None:
    if name not in (None, kind):
        raise ParameterError(f"{option}: are of the law {kind}, got --law {name}; give one of them")
    for other, value in others.items():
        if value is not None:
            raise ParameterError(f"{option}, {other}: got both, expected one of them")


def _ways(option: str, text: str | None) -> list[tuple[int, int]]:
    if text is None:
        return []
    found = []
    for part in text.split(","):
        match = _WAY.fullmatch(part)
        if match is None:
            raise ParameterError(
                f"{option}: got {part.strip()!r}, expected pairs of classes such as 0-1,1-2,2-0"
            )
        pair = (int(match[1]), int(match[2]))
        if pair[0] == pair[1]:
            raise ParameterError(f"{option}: got {part.strip()!r}, expected two different classes")
        if pair in found or (option == "--edges" and pair[::-1] in found):
            raise ParameterError(f"{option}: got {part.strip()!r} twice, expected each pair once")
        found.append(pair)
    return found


def _classes(ways: list[tuple[int, int]]) -> int:
    """Return how many classes there are; each has to be named."""
    K = max(max(pair) for pair in ways) + 1
    for k in range(K):
        if not any(k in pair for pair in ways):
            raise ParameterError(
                f"--fades, --edges, --jumps: none of them leads to or from class {k}; expected the classes "
                f"0 to {K - 1}, or other numbers"
            )
    return K


def _check_steps(stay: float, length: float) -> None:
    for option, value in (("--stay", stay), ("--length", length)):
        if not 1.0 <= value < float("inf"):
            raise ParameterError(f"{option}: got {value:g}, expected a finite number of steps, at least 1")


def _between(stay: float, length: float) -> Law:
    """Return the law of two classes that "fade" stands for, with other durations."""
    from fuzzykf import FadeLaw

    _check_steps(stay, length)
    usual = FadeLaw.by_name(1)
    share = usual.jumps[0, 1] * float(usual.mean_dwell()[0])
    return FadeLaw.between(stay, length, jump=share / stay, turn_back=usual.turn_back)


def _fade(fades: list[tuple[int, int]], jumps: list[tuple[int, int]], stay: float, length: float) -> Law:
    from fuzzykf import FadeLaw

    K = _classes(fades + jumps)
    _check_steps(stay, length)
    ways = [a for a, _ in fades + jumps]
    rates = {a: 1.0 / (stay * ways.count(a)) for a in ways}
    numbers: Any = {pair: (rates[pair[0]], length) for pair in fades}
    return FadeLaw(K, numbers, jumps={pair: rates[pair[0]] for pair in jumps})


def _graph(edges: list[tuple[int, int]], jumps: list[tuple[int, int]]) -> Law:
    from fuzzykf import GraphLaw

    K = _classes(edges + jumps)
    masses = dict.fromkeys(edges, 1.0)
    return GraphLaw.from_masses([CLASS_TO_EDGE] * K, masses, jumps=dict.fromkeys(jumps, 0.05))
