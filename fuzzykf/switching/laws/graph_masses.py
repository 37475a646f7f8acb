"""From how often a switch is where to the parameters of a law on a graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_choice, as_count, as_real
from fuzzykf.switching.laws.crossings import crossing_pairs
from fuzzykf.switching.laws.edge_families import FAMILIES, as_width
from fuzzykf.switching.laws.edges import MOST_CLASSES, as_edge, as_edges, entries
from fuzzykf.switching.laws.shares import ROUNDING

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

    Edges = tuple[tuple[int, int], ...]

__all__ = ["masses_of"]

#: What densities are shaped like unless told otherwise: delta / eta of linear ones, the half width of bands.
RATIO, WIDTH = 0.5, 0.2


def masses_of(
    vertices: Any, edges: Any, jumps: Any, family: str, shape: float | None, crossings: Any
) -> dict[str, Any]:
    """Return the arguments of a `GraphLaw` with these masses; see `GraphLaw.from_masses`."""
    p = as_array("vertices", vertices, (None,))
    K = as_count("vertices, their number", p.size, 2, MOST_CLASSES)
    if (p < 0.0).any():
        raise ParameterError(f"vertices: got {p.min():.6g}, expected masses, which are not negative")
    given = dict(entries("edges", edges, "{(a, b): mass}"))
    pairs = as_edges("edges", given, K)
    masses = np.array([_as_mass(f"edges[{pair}]", mass) for pair, mass in given.items()])
    total = float(p.sum() + masses.sum())
    if not total > 0.0:
        raise ParameterError(f"vertices, edges: got masses that sum to {total:.6g}, expected a positive sum")
    crossed, ways = _crossed(crossings, pairs, K)
    own = masses - crossed
    if (own < -ROUNDING * total).any():
        e = int(own.argmin())
        raise ParameterError(
            f"edges[{pairs[e]}]: got a mass of {masses[e]:.6g}, expected at least {crossed[e]:.6g}, which "
            "crosses from it to other edges in a step"
        )
    made = [_shaped(family, shape, max(mass, 0.0) / total) for mass in own.tolist()]
    corners = np.zeros((K, K))
    for pair, mass in entries("jumps", {} if jumps is None else jumps, "{(a, b): mass}"):
        a, b = as_edge("jumps", pair, K)
        if corners[a, b]:
            raise ParameterError(
                f"jumps: got those between {a} and {b} twice, expected them once, there and back"
            )
        corners[a, b] = corners[b, a] = _as_mass(f"jumps[{pair}]", mass) / total
    leave = corners.sum(axis=1)
    for edge, parameters in zip(pairs, made, strict=True):
        leave[list(edge)] += FAMILIES[family][0]("edges", *parameters).flow
    stay = p / total - leave
    if (stay < -ROUNDING).any():
        k = int(stay.argmin())
        raise ParameterError(
            f"vertices: got a mass of {p[k]:.6g} for class {k}, expected at least {leave[k] * total:.6g}, "
            "which leaves it in a step for its edges and by jumps"
        )
    corners[np.diag_indices(K)] = np.maximum(stay, 0.0)
    return {
        "n_classes": K,
        "edges": pairs,
        "corners": corners,
        "family": family,
        "parameters": np.reshape(made, (-1, 2)),
        "crossings": {key: (kappa / total, width) for key, (kappa, width) in ways.items()},
    }


def _crossed(crossings: Any, pairs: Edges, K: int) -> tuple[FloatArray, dict[Any, tuple[float, float]]]:
    """Return the mass of each edge that crosses to others, and density and width of each crossing."""
    crossed, ways = np.zeros(len(pairs)), {}
    for first, second, name, value in crossing_pairs({} if crossings is None else crossings, pairs, K):
        mass = _as_mass(f"{name}, mass", value[0])
        width = as_width(name, as_real(f"{name}, width", value[1]))
        crossed[[first, second]] += mass
        ways[pairs[first], pairs[second]] = (2.0 * mass / width**2, width)
    return crossed, ways


def _as_mass(name: str, value: Any) -> float:
    mass = as_real(name, value, "a mass")
    if not (mass >= 0.0 and np.isfinite(mass)):
        raise ParameterError(f"{name}: got {mass:.6g}, expected a mass, which is not negative")
    return mass


def _shaped(family: str, shape: float | None, mass: float) -> tuple[float, float]:
    """Return the parameters of an edge of this mass."""
    as_choice("family", family, FAMILIES)
    if family == "linear":
        ratio = RATIO if shape is None else as_real("shape", shape)
        if not (ratio >= 0.0 and np.isfinite(ratio)):
            raise ParameterError(f"shape: got {ratio:.6g}, expected delta / eta, which is not negative")
        eta = 3.0 * mass / (5.0 + 4.0 * ratio)
        return eta, ratio * eta
    width = as_width("shape", WIDTH if shape is None else as_real("shape", shape))
    return mass / (width * (4.0 - width)), width
