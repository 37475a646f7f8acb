"""Discretisation: from a fuzzy law to a Markov chain on F + 2 nodes.

The nodes are 0, F points in between, and 1.  Four rules are offered:

``midpoint``, ``gauss``
    Joint masses J_ij = W_i W_j p(r_i, r_j) / Z, with the midpoints of F equal cells or
    the Gauss-Legendre nodes.  They must be as close as the band of the law is wide (FMC2:
    delta): no point value tells of a step between nodes that lie further apart.
``cell``
    Joint masses are exact integrals of the density over pairs of cells.  It keeps
    the probability of the hard values exactly and is safe for densities that jump.
``product``
    Product integration (Nystrom): Gauss nodes on the panels between the break points of
    the law; the density is integrated exactly against the Lagrange interpolant of the
    filtered density.  Of spectral accuracy, but transition weights may be negative.
"""

from __future__ import annotations

import warnings
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice, is_whole
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.integration import cell_masses, gauss_nodes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.integration import JointLaw

__all__ = ["RULES", "chain_of_joint", "discretize", "from_file", "panel_bounds"]

#: Names of the rules.
RULES = ("cell", "midpoint", "gauss", "product")

_FROM_FILE = ContextVar("from_file", default=False)

#: Most nodes between the hard values: tables of a filter on so many take gigabytes.
MOST_NODES = 1000


def discretize(law: JointLaw, n_nodes: int, rule: str) -> SwitchChain:
    """Approximate a law by a Markov chain; see `FuzzyMarkovLaw.discretize`."""
    as_choice("rule", rule, RULES)
    if not is_whole(n_nodes) or n_nodes < 0:
        raise ParameterError(f"n_nodes: got {n_nodes!r}, expected a whole number of at least 0")
    if n_nodes > MOST_NODES:
        raise ParameterError(
            f"n_nodes: got {n_nodes}, expected at most {MOST_NODES}; tables have (n_nodes + 2)^2 entries"
        )
    F = int(n_nodes)
    if rule == "product" and F:
        return _product_chain(law, F)
    if rule == "gauss" and F:
        x, w = gauss_nodes(F)
    else:
        x, w = (np.arange(F) + 0.5) / max(F, 1), np.full(F, 1.0 / max(F, 1))
    nodes, weights = _with_atoms(x, w)
    if rule == "cell":
        joint = cell_masses(law, np.linspace(0.0, 1.0, F + 1) if F else np.array([0.0]))
    else:
        joint = weights[:, None] * weights * law.joint_density(nodes[:, None], nodes)
        if F:  # without nodes between it is the chain of the hard values, whatever lies between them
            _check_neighbours(law, nodes, joint, rule)
    return chain_of_joint(nodes, weights, joint)


def _check_neighbours(law: JointLaw, nodes: FloatArray, joint: FloatArray, rule: str) -> None:
    """Check that the chain can go from node to node wherever the switch can go between them."""
    mass = joint.sum(axis=1) > 0.0
    for i in np.flatnonzero(mass[:-1] & mass[1:] & (np.diagonal(joint, 1) == 0.0)):
        low, high = float(nodes[i]), float(nodes[i + 1])
        width = _reach(law, low, high)
        if not width:
            continue
        least = np.ceil((1.0 / width if rule == "midpoint" else np.pi / (2.0 * width) - 0.5) - 1e-6)
        message = (
            f"n_nodes: got {nodes.size - 2} with rule={rule!r}, whose nodes {low:.4g} and {high:.4g} are "
            f"{high - low:.4g} apart, but the band of the law is only {width:.4g} wide, so that the chain "
            f"falls into pieces; use rule='cell', or at least {least:.0f} nodes"
        )
        if _FROM_FILE.get():
            warnings.warn(message, stacklevel=2)
            return
        raise ParameterError(message)


def _reach(law: JointLaw, low: float, high: float) -> float:
    """Return the longest step between two nodes that has a density; 0 if none or nearly all have one.

    Either is no matter of a band: the switch does not cross there, or a node is on a rim.
    """
    distance = high - low

    def has_density(step: float) -> bool:
        start = (low + high - step) / 2.0
        if low == 0.0 or high == 1.0:  # from or to the atom, whose density is another
            start = low if low == 0.0 else high - step
        return bool(step < distance and float(law.joint_density(start, start + step)) > 0.0)

    within, beyond = 1e-6 * distance, distance
    if not has_density(within):
        return 0.0
    for _ in range(40):
        middle = (within + beyond) / 2.0
        within, beyond = (middle, beyond) if has_density(middle) else (within, middle)
    return within if within < (1.0 - 1e-9) * distance else 0.0


@contextmanager
def from_file() -> Iterator[None]:
    """Warn of nodes too far apart instead of refusing them: filters of older files may have such."""
    before = _FROM_FILE.set(True)
    try:
        yield
    finally:
        _FROM_FILE.reset(before)


def _with_atoms(x: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.concatenate([[0.0], x, [1.0]]), np.concatenate([[1.0], w, [1.0]])


def chain_of_joint(
    nodes: FloatArray, weights: FloatArray, joint: FloatArray, class_weights: FloatArray | None = None
) -> SwitchChain:
    """Return the chain whose consecutive nodes have these joint masses, (M, M)."""
    K = 2 if class_weights is None else class_weights.shape[1]
    total = joint.sum()
    if not total > 0.0:
        raise ParameterError(
            f"n_nodes: the law has no mass on the {len(nodes) - K} nodes and the {K} hard values; use more"
        )
    initial = joint.sum(axis=1) / total
    transition = _rows(joint / total, initial)
    return SwitchChain(nodes, weights, initial / initial.sum(), transition, class_weights)


def _rows(joint: FloatArray, initial: FloatArray) -> FloatArray:
    """Rows of probabilities; a node without mass, which no path reaches, gets the initial law."""
    massless = ~(initial > 0.0)
    rows = np.where(massless[:, None], initial, joint)
    normalised: FloatArray = rows / rows.sum(axis=1, keepdims=True)
    return normalised


def panel_bounds(law: JointLaw) -> FloatArray:
    """Return the points at which the filtered density of a law may fail to be smooth.

    These are 0 and 1 and everything the kinks of the density carry them to: for FMC2
    the multiples of delta, counted from either end (math of the 2020 paper, eq. 31).
    """
    kinks = law.lines.kinks
    bounds = {0.0, 1.0}
    frontier = set(bounds)
    while frontier:
        moved = {round(b + k, 12) for b in frontier for k in kinks}
        frontier = {b for b in moved if 1e-9 < b < 1.0 - 1e-9} - bounds
        bounds |= frontier
        if len(bounds) > 1000:
            raise ParameterError("rule: 'product' needs a law whose kinks divide [0, 1] into a few panels")
    ordered = np.array(sorted(bounds))
    keep = np.concatenate([[True], np.diff(ordered) > 1e-9])
    bounds_kept: FloatArray = ordered[keep]
    return bounds_kept


def _product_chain(law: JointLaw, F: int) -> SwitchChain:
    bounds = panel_bounds(law)
    lengths = np.diff(bounds)
    if lengths.size > F:
        raise ParameterError(
            f"n_nodes: got {F}, expected at least {lengths.size} for the rule 'product', one for each panel "
            "between the break points of the law"
        )
    counts = np.ones(lengths.size, dtype=int)
    for _ in range(F - lengths.size):
        counts[np.argmax(lengths / counts)] += 1
    parts = [gauss_nodes(int(k)) for k in counts]
    x = np.concatenate([b + h * p[0] for b, h, p in zip(bounds, lengths, parts, strict=False)])
    w = np.concatenate([h * p[1] for h, p in zip(lengths, parts, strict=True)])
    nodes, weights = _with_atoms(x, w)
    marginal = law.marginal_density(nodes)
    moments = np.empty((nodes.size, nodes.size))
    moments[[0, -1]] = law.joint_density(nodes[[0, -1], None], nodes)
    start = 1
    for left, length, (local, _), count in zip(bounds, lengths, parts, counts, strict=False):
        block = slice(start, start + int(count))
        moments[block] = _interpolant_moments(law, nodes, left, length, local)
        start += int(count)
    # T_ij = (W_j / W_i) int p(r, r_j) l_i(r) dr / p(r_i), and W_j p(r_i, r_j) / p(r_i) from the atoms
    flow = weights * moments
    mass = weights * marginal
    transition = _rows(flow, np.where(mass > 0.0, mass, 0.0))
    return SwitchChain(nodes, weights, mass / mass.sum(), transition)


def _interpolant_moments(
    law: JointLaw, nodes: FloatArray, left: float, length: float, local: FloatArray
) -> FloatArray:
    """Integrals of p(r, r_j) l_i(r) over a panel, for its Lagrange polynomials l_i and all nodes j."""
    n = local.size
    x, w = gauss_nodes(max(law.lines.order, (n + 3) // 2 + 1))
    moments = np.empty((n, nodes.size))
    for j, node in enumerate(nodes):
        cuts = np.clip(np.concatenate([[left, left + length], node + law.lines.kinks]), left, left + length)
        cuts = np.unique(cuts)
        widths = np.diff(cuts)
        r = cuts[:-1, None] + widths[:, None] * x
        values = law.joint_density(np.clip(r, 1e-300, np.nextafter(1.0, 0.0)), node) * widths[:, None] * w
        moments[:, j] = (_lagrange(local, (r - left) / length) * values).sum(axis=(1, 2))
    return moments


def _lagrange(nodes: FloatArray, t: FloatArray) -> FloatArray:
    """Lagrange polynomials of ``nodes`` at the points ``t``: shape (n, *t.shape)."""
    difference = nodes[:, None] - nodes + np.eye(nodes.size)
    factors = (t[None, None] - nodes[None, :, None, None]) / difference[:, :, None, None]
    diagonal = np.arange(nodes.size)
    factors[diagonal, diagonal] = 1.0
    product: FloatArray = factors.prod(axis=1)
    return product
