"""Symmetric laws of a switch among K classes that may fade along the edges of a graph.

The switch is at a class (a vertex), or on an edge between two, at the class weights
(1 - t) e_a + t e_b with t in ]0, 1[.  The measure is a Dirac mass on each class and the length along
each edge; a law is a symmetric joint density of two consecutive values: the masses ``corners`` of two
classes, one density for an edge and itself and for an edge and its classes, and perhaps one for two
edges with a common class.  For K = 2 these are FMC1 and FMC2, with corners that need not be equal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_choice, as_count, as_numbers, brief, check_generator
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import shown, value_text
from fuzzykf.switching.laws.chain import MOST_DRAWS, SwitchChain, hardened
from fuzzykf.switching.laws.crossings import as_crossings
from fuzzykf.switching.laws.edge_families import FAMILIES, EdgeFamily
from fuzzykf.switching.laws.edges import MOST_CLASSES, GraphicLaw, Link, as_edges, check_cells, class_weights
from fuzzykf.switching.laws.graph_masses import masses_of
from fuzzykf.switching.laws.graph_numbers import (
    law_numbers,
    logits_of_law,
    other_widths,
    width_logit,
    widths_of,
)
from fuzzykf.switching.laws.graph_walk import GraphWalk
from fuzzykf.switching.laws.law_numbers import LogitNumbers
from fuzzykf.switching.laws.learners import LawChain
from fuzzykf.switching.laws.quadrature import chain_of_joint
from fuzzykf.switching.laws.shares import ROUNDING, softmax

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

    Edge = tuple[int, int]

__all__ = ["GraphLaw"]

#: For parts of which no mass depends on a width.
DEFAULT_WIDTH = 0.25

#: Quasi-Newton steps of each maximisation: there are many numbers, and the next one goes on.
STEPS = 5

#: By how much the total mass may miss one.
MASS_TOLERANCE = 1e-9


class GraphLaw(GraphicLaw):
    """Symmetric law of a switch among K classes, gradual along the edges of a graph.

    Parameters
    ----------
    n_classes : int
        Number K of classes (hard regimes).
    edges : sequence of (int, int)
        Pairs of classes between which the switch moves gradually; nodes are ordered edge by edge, from the
        first class to the second.
    corners : array_like, shape (K, K)
        Joint probabilities of two consecutive classes, symmetric.
    family : {"linear", "band"}
        Density as a function of the distance on an edge: linear from eta at 0 to delta at 1, or gamma on a
        band and zero elsewhere.
    parameters : sequence of (float, float)
        For each edge, (eta, delta), or (gamma, width) with a half width in ]0, 1/2].
    crossings : mapping of (edge, edge) to (float, float), optional
        ``{((0, 1), (1, 2)): (kappa, width)}``: for bands, the density kappa of a step from one edge to
        another through their common class, if its length is at most ``width``, in ]0, 1/2].

    Raises
    ------
    ParameterError
        If a mass or a density is negative, or the total mass is not 1; the message names the sum.

    See Also
    --------
    GraphLaw.from_masses : Create a law from masses that need not sum to one.
    fuzzykf.FadeLaw : For fades with a direction.

    Notes
    -----
    The total mass is the sum of the corners, of 8 eta/3 + 7 delta/3 or gamma w (6 - w) per edge, and of
    kappa w^2 per crossing.

    Examples
    --------
    >>> import numpy as np
    >>> corners = [[0.26, 0.02, 0.0], [0.02, 0.2, 0.01], [0.0, 0.01, 0.1]]
    >>> law = GraphLaw(
    ...     3, [(0, 1), (1, 2)], corners, parameters=[(0.06, 0.03), (0.03, 0.03)]
    ... )
    >>> law.class_masses.round(4), law.edge_masses.round(4)
    (array([0.325, 0.305, 0.14 ]), array([0.14, 0.09]))
    >>> law = GraphLaw.from_masses([0.3, 0.3, 0.2], {(0, 1): 0.15, (1, 2): 0.05})
    >>> round(law.p_hard, 6), len(law.discretize(5))
    (0.8, 13)
    """

    kind = "graph"
    learned = True

    def __init__(
        self,
        n_classes: int,
        edges: Iterable[Edge],
        corners: ArrayLike,
        *,
        family: str = "linear",
        parameters: Sequence[tuple[float, float]] | ArrayLike,
        crossings: Mapping[tuple[Edge, Edge], tuple[float, float]] | None = None,
    ) -> None:
        self.n_classes = K = as_count("n_classes", n_classes, 2, MOST_CLASSES)
        self.edges = as_edges("edges", _listed("edges", edges), K)
        self.family = as_choice("family", family, FAMILIES)
        self.corners = _as_corners("corners", corners, K)
        make, form = FAMILIES[family]
        pairs = _as_pairs(parameters, len(self.edges), form)
        self._densities: tuple[EdgeFamily, ...] = tuple(
            make(f"parameters, edge {edge}", float(first), float(second))
            for edge, (first, second) in zip(self.edges, pairs, strict=True)
        )
        self._pairs = pairs
        self._crossings = as_crossings({} if crossings is None else crossings, self.edges, K, family)
        self._check_total()

    def _check_total(self) -> None:
        corners = float(self.corners.sum())
        along = [density.mass + 2.0 * density.flow for density in self._densities]
        across = [2.0 * crossing.mass for crossing in self._crossings]
        total = corners + sum(along) + sum(across)
        if not abs(total - 1.0) <= MASS_TOLERANCE:
            crossing = f", crossings {sum(across):.6g}" if across else ""
            raise ParameterError(
                f"corners, parameters: got masses that sum to {total:.9g} (corners {corners:.6g}, edges "
                f"{sum(along):.6g}{crossing}), expected 1; GraphLaw.from_masses normalises"
            )

    @classmethod
    def from_masses(
        cls,
        vertices: ArrayLike,
        edges: Mapping[Edge, float],
        *,
        jumps: Mapping[Edge, float] | None = None,
        family: str = "linear",
        shape: float | None = None,
        crossings: Mapping[tuple[Edge, Edge], tuple[float, float]] | None = None,
    ) -> Self:
        """Create a law from relative masses of classes and edges.

        Parameters
        ----------
        vertices : array_like, shape (K,)
            Mass of each class.
        edges : mapping of (int, int) to float
            Mass of each edge.
        jumps : mapping of (int, int) to float, optional
            Joint mass of class a followed by b, and the same of b followed by a.
        family : {"linear", "band"}
        shape : float, optional
            Shape of the densities: delta / eta if linear (by default 0.5), the half width of bands (by
            default 0.2).
        crossings : mapping of (edge, edge) to (float, float), optional
            ``{((0, 1), (1, 2)): (mass, width)}``: the joint mass of the first edge followed by the second,
            and the same in the other order; it is part of the masses of both edges.

        Returns
        -------
        GraphLaw
            The law in which classes persist as far as the masses allow.

        Raises
        ------
        ParameterError
            If the mass of a class is less than the mass that leaves it in a step, or that of an edge less
            than the mass that crosses from it; the message names both.

        Examples
        --------
        >>> law = GraphLaw.from_masses(
        ...     [3, 3, 2], {(0, 1): 1.5, (1, 2): 0.5}, jumps={(0, 2): 0.1}
        ... )
        >>> round(law.p_hard, 6), law.harden().sum(axis=1).round(6)
        (0.8, array([0.375, 0.4  , 0.225]))
        """
        return cls(**masses_of(vertices, edges, jumps, family, shape, crossings))

    # ------------------------------------------------------------------ what it was made from

    @property
    def crossings(self) -> dict[tuple[Edge, Edge], tuple[float, float]]:
        """Density and width of each crossing."""
        return {(self.edges[c.first], self.edges[c.second]): (c.kappa, c.width) for c in self._crossings}

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters of the law by name."""
        return {
            "n_classes": self.n_classes,
            "edges": self.edges,
            "corners": self.corners,
            "family": self.family,
            "parameters": [tuple(pair) for pair in self._pairs.tolist()],
            "crossings": self.crossings,
        }

    def numbers(self) -> dict[str, float]:
        """Return the masses of the classes and of the edges.

        Returns
        -------
        dict of str to float
        """
        named = {f"mass of {k}": float(mass) for k, mass in enumerate(self.class_masses)}
        for (a, b), mass in zip(self.edges, self.edge_masses, strict=True):
            named[f"mass of {a} to {b}"] = float(mass)
        return named

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments as plain values; crossings as [edge, edge, kappa, width].

        Returns
        -------
        dict
        """
        return {
            "n_classes": self.n_classes,
            "edges": [list(edge) for edge in self.edges],
            "corners": self.corners.tolist(),
            "family": self.family,
            "parameters": self._pairs.tolist(),
            "crossings": [[*map(list, key), *value] for key, value in self.crossings.items()],
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Create a law from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        GraphLaw
        """
        ways = {(tuple(e), tuple(f)): (kappa, width) for e, f, kappa, width in values["crossings"]}
        return cls(**{**values, "crossings": ways})

    # ------------------------------------------------------------------ masses

    @cached_property
    def class_masses(self) -> FloatArray:
        """Probability of each class, (K,)."""
        masses: FloatArray = self.corners.sum(axis=1)
        for edge, density in zip(self.edges, self._densities, strict=True):
            masses[list(edge)] += density.flow
        masses.flags.writeable = False
        return masses

    @cached_property
    def edge_masses(self) -> FloatArray:
        """Probability of each edge, (E,)."""
        masses = np.array([density.mass for density in self._densities])
        for crossing in self._crossings:
            masses[[crossing.first, crossing.second]] += crossing.mass
        masses.flags.writeable = False
        return masses

    @property
    def p_hard(self) -> float:
        """Probability that the switch is at a class; at least 3/8 for linear densities, 1/3 for bands."""
        return float(self.class_masses.sum())

    def size(self, n_nodes: int) -> int:
        """Return the total number of nodes, for ``n_nodes`` cells per edge.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        int
        """
        return self.n_classes + n_nodes * len(self.edges)

    def discretize(self, n_nodes: int, rule: str = "cell") -> SwitchChain:
        """Approximate the law by a chain on the classes and on equal cells of the edges.

        Parameters
        ----------
        n_nodes : int
            Number F of cells of each edge.  With 0, the chain consists of the classes only.
        rule : {"cell"}
            Joint masses are exact integrals of the density over pairs of cells.

        Returns
        -------
        SwitchChain
            Its nodes are the K classes, then F cells of each edge.
        """
        F, K = as_count("n_nodes", n_nodes, 0), self.n_classes
        check_cells(F, rule, K, len(self.edges))
        F = F if self.edges else 0  # what has no cells has none of any number
        weights = class_weights(self.edges, F, K)
        measure = np.concatenate([np.ones(K), np.full(len(weights) - K, 1.0 / max(F, 1))])
        nodes = weights[:, 1] if K == 2 else weights
        return chain_of_joint(nodes, measure, self._cell_masses(F), weights)

    def _cell_masses(self, F: int) -> FloatArray:
        K = self.n_classes
        joint = np.zeros((K + F * len(self.edges),) * 2)
        joint[:K, :K] = self.corners
        cells = [K + F * e + np.arange(F) for e in range(len(self.edges))]
        for at, (a, b), density in zip(cells, self.edges, self._densities, strict=True):
            if not F:
                break
            joint[np.ix_(at, at)] = density.between(F)
            joint[a, at] = joint[at, a] = density.from_class(F)
            joint[b, at] = joint[at, b] = density.from_class(F)[::-1]
        for c in self._crossings if F else ():
            # both edges counted from the common class
            first, second = (
                cells[e][:: 1 - 2 * end] for e, end in zip((c.first, c.second), c.ends, strict=True)
            )
            masses = c.cells(F)
            joint[np.ix_(first, second)] = masses
            joint[np.ix_(second, first)] = masses.T
        return joint

    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of two consecutive hard regimes, with edges cut in the middle.

        Parameters
        ----------
        n_nodes : int, optional
            Harden the chain on this many cells per edge instead; the middle one of an odd number counts half
            for each class.  Even numbers do not change the result.

        Returns
        -------
        ndarray, shape (K, K)

        Examples
        --------
        >>> GraphLaw.from_masses([4, 4], {(0, 1): 2}).harden().round(4)
        array([[0.4304, 0.0696],
               [0.0696, 0.4304]])
        """
        return hardened(self.discretize(2 if n_nodes is None else n_nodes))

    # ------------------------------------------------------------------ drawing

    def sample(self, n: int, rng: np.random.Generator, n_nodes: int | None = None) -> FloatArray:
        """Draw ``n`` consecutive values of the stationary chain, exactly.

        Parameters
        ----------
        n : int
            Number of values.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Draw from the chain on this many cells per edge instead.

        Returns
        -------
        ndarray, shape (n,) or (n, K)
            For two classes, the weight of class 1; otherwise all class weights.

        Examples
        --------
        >>> import numpy as np
        >>> law = GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.5, (1, 2): 0.5})
        >>> law.sample(100, np.random.default_rng(0)).shape
        (100, 3)
        """
        if n_nodes is not None:
            return self.discretize(n_nodes).sample(n, rng)
        check_generator(rng)
        n = as_count("n", n, most=MOST_DRAWS)
        weights = self._walk.path(rng.random((n, 2)))
        return weights[:, 1].copy() if self.n_classes == 2 else weights

    @cached_property
    def _walk(self) -> GraphWalk:
        masses = np.concatenate([self.class_masses, self.edge_masses])
        return GraphWalk(masses, self.corners, self.edges, self._densities, self._crossings)

    # ------------------------------------------------------------------ learning

    @classmethod
    def by_name(cls, n_nodes: int) -> Self:
        """Return the initial law of a search, for two classes.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        GraphLaw
        """
        return cls.from_masses([0.3, 0.3], {(0, 1): 0.4}, jumps={(0, 1): 0.02})

    @property
    def _ways(self) -> FloatArray:
        return np.array([(c.kappa, c.width) for c in self._crossings]).reshape(-1, 2)

    def logits(self) -> FloatArray:
        """Return the parameters of the law as unconstrained logits.

        Returns
        -------
        ndarray, shape (n_free,)
        """
        return logits_of_law(self.corners, self._pairs, self.family, self._ways)

    def from_logits(self, logits: FloatArray) -> Self:
        """Return the law of the same structure with the given logits.

        Parameters
        ----------
        logits : ndarray, shape (n_free,)

        Returns
        -------
        GraphLaw
        """
        sizes = (len(self.edges), self.family, len(self._crossings))
        found = law_numbers(logits, self.corners, *sizes)
        ways = dict(zip(self.crossings, map(tuple, found.pop("ways").tolist()), strict=True))
        return type(self)(self.n_classes, self.edges, **found, family=self.family, crossings=ways)

    def on_cells(self, n_nodes: int) -> Callable[[FloatArray], FloatArray]:
        """Return the map from logits to joint probabilities (M, M) of two consecutive nodes.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        callable
        """
        n_widths = self.n_widths
        parts = self.logits().size + 1 - n_widths

        @lru_cache(maxsize=4 * parts)
        def unit(part: int, width: float) -> FloatArray:
            """Return the masses of a law that has all of its mass in one part."""
            alone = np.where(np.arange(parts) == part, 0.0, -np.inf)
            of_widths = np.full(n_widths, width_logit(width))
            law = self.from_logits(np.concatenate([_as_logits(alone), of_widths]))
            return law._cell_masses(n_nodes)

        def joint(logits: FloatArray) -> FloatArray:
            shares, widths = softmax(logits[: parts - 1]), widths_of(logits[parts - 1 :])
            own = [DEFAULT_WIDTH] * (parts - n_widths) + widths.tolist()
            units = np.array([unit(part, width) for part, width in enumerate(own)])
            return _normalised(np.tensordot(shares, units, axes=1))

        return joint

    @property
    def n_shares(self) -> int:
        """Number of logits of masses; they come first."""
        return self.logits().size - self.n_widths

    @property
    def n_widths(self) -> int:
        """Number of logits of widths; they come last."""
        return len(self._crossings) + (len(self.edges) if self.family == "band" else 0)

    def elsewhere(self, logits: FloatArray, n_nodes: int) -> list[FloatArray]:
        """Return logits with other widths, which a search on the nodes cannot reach.

        Parameters
        ----------
        logits : ndarray, shape (n_free,)
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        list of ndarray
        """
        return other_widths(logits, self.n_widths, n_nodes)

    def learner(self, n_nodes: int) -> LawChain:
        """Return the discretised law as expectation-maximisation updates it.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        LawChain
        """
        return LawChain(self, n_nodes, STEPS)

    def estimates_of(self, law: GraphLaw) -> dict[str, float]:
        """Return the parameters that belong to the logits of a law of this structure, by name.

        Parameters
        ----------
        law : GraphLaw

        Returns
        -------
        dict of str to float
        """
        corners = {f"corner {k}": float(law.corners[k, k]) for k in range(1, self.n_classes)}
        for a, b in np.argwhere(np.triu(self.corners, 1) > 0.0).tolist():
            corners[f"corner {a} to {b}"] = float(law.corners[a, b])
        names = [f"{a} to {b}" for a, b in self.edges]
        first, second = ("eta", "delta") if self.family == "linear" else ("gamma", "width")
        firsts = {f"{first} {name}": pair[0] for name, pair in zip(names, law._pairs.tolist(), strict=True)}
        seconds = {f"{second} {name}": pair[1] for name, pair in zip(names, law._pairs.tolist(), strict=True)}
        if self.family == "linear":  # both of an edge are shares
            pairs = zip(firsts.items(), seconds.items(), strict=True)
            return corners | dict(item for pair in pairs for item in pair)
        kappas = {f"kappa {one} to {other}": pair[0] for (one, other), pair in law.crossings.items()}
        widths = {f"width {one} to {other}": pair[1] for (one, other), pair in law.crossings.items()}
        return corners | firsts | kappas | seconds | widths

    def free_numbers(self, n_nodes: int) -> LogitNumbers:
        """Return the logits, as free parameters for gradient ascent.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each edge.

        Returns
        -------
        LogitNumbers
        """
        return LogitNumbers(self, n_nodes)

    # ------------------------------------------------------------------ pictures

    def links(self) -> list[Link]:
        """Return edges and jumps with their masses, for plots.

        Returns
        -------
        list of Link
        """
        found = [
            Link(edge, f"{mass:.3g}", gradual=True, directed=False)
            for edge, mass in zip(self.edges, self.edge_masses, strict=True)
        ]
        for a, b in np.argwhere(np.triu(self.corners, 1) > 0.0).tolist():
            found.append(Link((a, b), f"{2 * self.corners[a, b]:.3g}", gradual=False, directed=False))
        return found

    @shown
    def __repr__(self) -> str:
        listed = ", ".join(map(str, self.edges[:4])) + (", ..." if len(self.edges) > 4 else "")
        parameters = f"parameters={value_text(self.parameters['parameters'])}"
        crossings = f", crossings of {len(self._crossings)} pairs" if self._crossings else ""
        return f"GraphLaw({self.n_classes}, [{listed}], family={self.family!r}, {parameters}{crossings})"


def _normalised(masses: FloatArray) -> FloatArray:
    joint: FloatArray = masses / masses.sum()
    return joint


def _as_logits(log_shares: FloatArray) -> FloatArray:
    """Return free numbers of which these are the logarithms but for a constant; 1000 is infinity."""
    finite: FloatArray = np.where(np.isfinite(log_shares), log_shares, -1000.0)
    return finite[1:] - finite[:1]


def _listed(name: str, edges: Any) -> list[Any]:
    try:
        return list(edges)
    except TypeError as error:
        raise ParameterError(f"{name}: got {brief(edges)}, expected a list of pairs (a, b)") from error


def _as_corners(name: str, corners: ArrayLike, K: int) -> FloatArray:
    masses = as_array(name, corners, (K, K))
    if (masses < 0.0).any():
        raise ParameterError(f"{name}: got {masses.min():.6g}, expected masses, which are not negative")
    off = np.abs(masses - masses.T)
    if off.max() > ROUNDING:
        a, b = (int(k) for k in np.unravel_index(off.argmax(), off.shape))
        raise ParameterError(
            f"{name}: got {masses[a, b]:.6g} at {(a, b)} and {masses[b, a]:.6g} at {(b, a)}, expected a "
            "symmetric matrix"
        )
    return 0.5 * (masses + masses.T)


def _as_pairs(parameters: Any, E: int, form: str) -> FloatArray:
    values = as_numbers("parameters", parameters)
    values = as_array("parameters", values, (None,) * values.ndim)
    if values.size == E == 0:
        values = np.empty((0, 2))
    if values.shape != (E, 2):
        raise ParameterError(
            f"parameters: got an array of shape {values.shape}, expected a pair {form} for each of {E} edges"
        )
    return values
