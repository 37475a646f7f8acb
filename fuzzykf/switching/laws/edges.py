"""What laws on graphs share: arguments that are given for edges, cells along them, and pictures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_real, brief, is_whole
from fuzzykf.switching.laws.base import Law
from fuzzykf.switching.laws.quadrature import MOST_NODES

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray

__all__ = [
    "MOST_CLASSES",
    "GraphicLaw",
    "Link",
    "as_edge",
    "as_edges",
    "as_probability",
    "check_cells",
    "class_weights",
    "entries",
]

#: Most classes of a law.
MOST_CLASSES = 1000


class Link(NamedTuple):
    """A way from class to class, as pictures show it."""

    ends: tuple[int, int]
    text: str
    gradual: bool
    directed: bool = True


class GraphicLaw(Law):
    """A law that a graph of its classes shows."""

    @abstractmethod
    def links(self) -> list[Link]:
        """Return the ways between classes, with what a picture says of each."""

    def plot(
        self,
        ax: Axes | None = None,
        *,
        rng: np.random.Generator | None = None,
        n: int = 300,
        n_nodes: int | None = None,
    ) -> Axes:
        """Draw the graph of the classes and the ways between them; or a path of the switch.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            By default those of a new figure.
        rng : numpy.random.Generator, optional
            If given, a path is sampled and drawn instead, by `fuzzykf.plotting.plot_path`.
        n : int
            Length of the path.
        n_nodes : int, optional
            As in `sample`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.laws import plot_graph, plot_path

        return plot_graph(self, ax) if rng is None else plot_path(self.sample(n, rng, n_nodes), ax)


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
    """Return edges as they are given, none of them twice in whatever direction.

    Raises
    ------
    ParameterError
        If they are no pairs of different classes, or one stands twice.
    """
    found: list[tuple[int, int]] = []
    for pair in pairs:
        a, b = as_edge(name, pair, n_classes)
        if (a, b) in found or (b, a) in found:
            raise ParameterError(f"{name}: got the edge between {a} and {b} twice, expected each edge once")
        found.append((a, b))
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


def check_cells(F: int, rule: Any, n_classes: int, parts: int) -> None:
    """Refuse a rule of discretisation but "cell", and cells that make tables too large.

    Parameters
    ----------
    F : int
        Number of cells of each part.
    rule : str
    n_classes, parts : int
        Of the graph; parts are edges or fades.
    """
    if not (isinstance(rule, str) and rule == "cell"):
        raise ParameterError(f"rule: got {brief(rule)}, expected 'cell', the one rule of laws on graphs")
    M, most = n_classes + parts * F, MOST_NODES + 2
    if most < M:
        raise ParameterError(
            f"n_nodes: got {F} for each of {parts} edges or fades, expected at most "
            f"{(most - n_classes) // parts}; tables have {M}^2 entries"
        )


def class_weights(edges: Iterable[tuple[int, int]], F: int, K: int) -> FloatArray:
    """Class weights of the classes, and of the cells edge by edge: (K + F E, K).

    Those of (b, a) are the same numbers as those of (a, b), to the bit: nodes of equal values count as one.
    """
    t = (np.arange(F) + 0.5) / max(F, 1)
    parts = [np.eye(K)]
    for a, b in edges:
        cells = np.zeros((F, K))
        cells[:, a], cells[:, b] = t[::-1], t
        parts.append(cells)
    return np.concatenate(parts)
