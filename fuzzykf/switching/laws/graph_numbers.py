"""Laws on a graph as free numbers: how their mass is shared out among its parts, and the widths of bands.

The parts are the masses of the classes, the jumps between those classes between which there are any (there
and back), and for each edge 8 eta/3 and 7 delta/3 (linear) or gamma w (6 - w) (band), for each crossing
kappa w^2; they sum to one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.switching.laws.shares import logits_of, softmax

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["law_numbers", "logits_of_law", "other_widths", "parts_of", "width_logit", "widths_of"]


def logits_of_law(corners: FloatArray, pairs: FloatArray, family: str, ways: FloatArray) -> FloatArray:
    """Return the free numbers of a law.

    Parameters
    ----------
    corners : ndarray, shape (K, K)
    pairs : ndarray, shape (E, 2)
        (eta, delta) or (gamma, width) of each edge.
    family : {"linear", "band"}
    ways : ndarray, shape (C, 2)
        (kappa, width) of each crossing.

    Returns
    -------
    ndarray
        Of the parts, then of the widths.
    """
    logits = logits_of(*parts_of(corners, pairs, family, ways).tolist())
    widths = np.concatenate([pairs[:, 1] if family == "band" else [], ways[:, 1]])
    return np.concatenate([logits, width_logit(widths)])


def width_logit(width: Any) -> Any:
    """Return the free number of a half width in ]0, 1/2]; that of 1/2 is finite.

    Examples
    --------
    >>> round(float(width_logit(0.25)), 9), round(float(width_logit(0.5)))
    (-0.0, 36)
    """
    return np.log(width / (np.nextafter(0.5, 1.0) - width))


def widths_of(logits: FloatArray) -> FloatArray:
    """Return the half widths of free numbers."""
    widths: FloatArray = 0.5 / (1.0 + np.exp(-logits))
    return widths


def parts_of(corners: FloatArray, pairs: FloatArray, family: str, ways: FloatArray) -> FloatArray:
    """Return the masses of the parts, in the order of the text above."""
    a, b = _jumps(corners)
    if family == "linear":
        edges = (pairs * [8.0 / 3.0, 7.0 / 3.0]).ravel()
    else:
        gamma, width = pairs.T
        edges = gamma * width * (6.0 - width)
    return np.concatenate([np.diagonal(corners), 2.0 * corners[a, b], edges, ways[:, 0] * ways[:, 1] ** 2])


def law_numbers(
    logits: FloatArray, corners: FloatArray, n_edges: int, family: str, n_crossings: int
) -> dict[str, Any]:
    """Return corners, parameters of the edges, and of the crossings, from free numbers.

    Parameters
    ----------
    logits : ndarray
        See `logits_of_law`.
    corners : ndarray, shape (K, K)
        Of the law from which the search began: where there are jumps.
    n_edges : int
    family : {"linear", "band"}
    n_crossings : int
    """
    K = len(corners)
    a, b = _jumps(corners)
    n_widths = n_crossings + (n_edges if family == "band" else 0)
    shares = softmax(logits[: logits.size - n_widths])
    widths = widths_of(logits[logits.size - n_widths :])
    found = np.diag(shares[:K])
    found[a, b] = found[b, a] = 0.5 * shares[K : K + a.size]
    rest = shares[K + a.size :]
    if family == "linear":
        pairs = rest.reshape(-1, 2) * [3.0 / 8.0, 3.0 / 7.0]
    else:
        width = widths[:n_edges]
        pairs = np.stack([rest[:n_edges] / (width * (6.0 - width)), width], axis=1)
        rest = rest[n_edges:]
    across = widths[widths.size - n_crossings :]
    ways = np.stack([rest / across**2, across], axis=1) if n_crossings else np.empty((0, 2))
    return {"corners": found, "parameters": pairs, "ways": ways}


def other_widths(logits: FloatArray, n_widths: int, n_nodes: int) -> list[FloatArray]:
    """Return free numbers with all widths in another interval between multiples of that of a cell.

    A pair of nodes off a band has probability zero, and keeps it, see `FMC2.elsewhere`.
    """
    if not (n_widths and n_nodes):
        return []
    edges = np.append(np.arange(0.0, 0.5, 1.0 / n_nodes), 0.5)
    now = widths_of(logits[logits.size - n_widths :])
    found = []
    for low, high in pairwise(edges.tolist()):
        if ((low < now) & (now <= high)).all():
            continue
        moved = logits.copy()
        moved[logits.size - n_widths :] = width_logit(0.5 * (low + high))
        found.append(moved)
    return found


def _jumps(corners: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of classes, the smaller one first, between which there are jumps."""
    a, b = np.nonzero(np.triu(corners, 1))
    return a, b
