"""Update on a lattice: combine the costs with those of the measurement.

    mu+(x) = T(mu(x), mu_V(z - h(x))) / peak

A lattice that follows the live region is refined until the posterior fills it, and
extended where a measurement draws the state beyond the level at which the prediction
was cut off.  Where the measurement is finer than the cells, nodes that happen to lie
near h(x) = z would win by accident; there a node counts as its whole cell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter

from fuzzykf.engine.selected import CUT, QUIET, continue_tails, subgrid_minimum
from fuzzykf.errors import NumericalRangeError
from fuzzykf.possibility.grid.lattice import Lattice
from fuzzykf.possibility.grid.resolution import are_too_few, needed_nodes

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership

__all__ = ["Conditioned", "condition", "restart"]

#: An axis is refined if the posterior occupies less than this part of it.
OCCUPIED = 0.7

#: Costs are told from one another to at least this.
DIGITS = 1e-4

#: Rounds of refinement or extension.  An extension doubles an axis.
ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What `condition` finds.

    Attributes
    ----------
    lattice : Lattice or None
        The posterior; None if it is empty.
    possibility : float
        Possibility of the measurement.
    reachable : bool
        Whether any node of the lattice, possible or not, could explain the measurement.
    notes : list of str
        What the user has to be warned of.
    prior : Lattice or None
        The prediction on the axes of the posterior.
    """

    lattice: Lattice | None
    possibility: float
    reachable: bool
    notes: list[str]
    prior: Lattice | None = None


@QUIET
def condition(
    prior: Lattice, measure: Mapping, noise: Membership, z: FloatArray, universe: Universe
) -> Conditioned:
    """Update with a measurement.

    Parameters
    ----------
    prior : Lattice
    measure : Mapping
        The map h to the observed components.
    noise : Membership
        Of the observed components.
    z : ndarray, shape (q,)
    universe : Universe
        With a domain, the lattice stays as it is.

    Raises
    ------
    ParameterError
        If the map returns something inadmissible at a possible state.
    NumericalRangeError
        If the measurement is so far off that costs lose their digits.
    """
    notes: list[str] = []
    if universe.domain is None:
        prior = _fitted(prior, measure, noise, z, universe, notes)
    is_prolonged = bool(notes)
    t_norm = prior.t_norm
    residual = _residual(prior, measure, z)
    surprise = noise.cost(residual, t_norm)
    cost = t_norm.combine(prior.cost, surprise)
    if not _resolves(prior, residual, cost, noise):
        if is_prolonged:  # and nevertheless too coarse
            raise _too_far(z, "no grid of these points reaches it")
        notes.append(
            "the measurement is finer than the cells of the grid; every node was judged by the best of its "
            "cell (ask for more points)"
        )
        surprise = noise.cost(_nearest(residual, noise), t_norm)
        cost = t_norm.combine(prior.cost, surprise)
    best = float(cost.min())
    if best >= t_norm.impossible:
        return Conditioned(None, 0.0, _reaches(prior, measure, noise, z, universe), notes)
    if not best * np.finfo(np.float64).eps < DIGITS:
        raise _too_far(z, "costs of double precision cannot tell one state from another")
    best = subgrid_minimum(cost)[0] if t_norm.additive else _meeting(prior.cost, surprise)
    best = max(0.0, best)
    posterior = Lattice(prior.axes, t_norm.renormalise(cost, best), t_norm)
    if is_prolonged:
        notes += posterior.notes(follows=universe.domain is None)
    return Conditioned(posterior, float(t_norm.membership(best)), True, notes, prior)


def _too_far(z: FloatArray, why: str) -> NumericalRangeError:
    return NumericalRangeError(
        f"z: got {z.tolist()}, so far from every state that was expected that {why}; expected a value "
        "within a thousand standard deviations, or NaN if the measurement is missing"
    )


def _meeting(prior: FloatArray, surprise: FloatArray) -> float:
    """Least maximum of two costs, at the best node or where they meet next to it along an axis."""
    cost = np.maximum(prior, surprise)
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    least = float(cost[best])
    for k, b in enumerate(best):
        line = tuple(slice(max(int(b) - 1, 0), int(b) + 2) if m == k else int(i) for m, i in enumerate(best))
        first, second = prior[line], surprise[line]
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = first - second
            part = ahead[:-1] / (ahead[:-1] - ahead[1:])
            value = (first[:-1] + part * np.diff(first))[ahead[:-1] * ahead[1:] < 0.0]
        least = min(least, float(value[np.isfinite(value)].min(initial=np.inf)))
    return least


def _residual(prior: Lattice, measure: Mapping, z: FloatArray) -> FloatArray:
    """Return z - h at the nodes (..., q), infinite where h is no number."""
    value = measure.on_grid(prior.axes, prior.live(np.inf))
    return np.where(np.isfinite(value), z - value, np.inf)


def _reach(residual: FloatArray) -> FloatArray:
    """By how much h differs within the cell around each node (..., q): half-way to the neighbours."""
    reach = np.zeros(residual.shape)
    for k in range(residual.ndim - 1):
        if residual.shape[k] > 1:
            with np.errstate(invalid="ignore"):
                change = np.moveaxis(np.abs(np.diff(residual, axis=k)), k, 0)
            change = np.where(np.isfinite(change), change, 0.0)
            padded = np.concatenate([change[:1], change, change[-1:]])
            reach += 0.5 * np.moveaxis(np.maximum(padded[1:], padded[:-1]), 0, k)
    return reach


def _nearest(residual: FloatArray, noise: Membership) -> FloatArray:
    """Return the likeliest residual within the cell of each node."""
    reach = _reach(residual)
    return residual - np.clip(residual - noise.peak, -reach, reach)


def _resolves(prior: Lattice, residual: FloatArray, cost: FloatArray, noise: Membership) -> bool:
    """Whether the cell around the best node is finer than the measurement noise."""
    t_norm = prior.t_norm
    if not (cost < t_norm.impossible).any():
        cost = t_norm.combine(prior.cost, noise.cost(_nearest(residual, noise), t_norm))
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    window = tuple(slice(max(int(b) - 1, 0), int(b) + 2) for b in best)
    reach = _reach(residual[window])[tuple(int(b) - part.start for b, part in zip(best, window, strict=True))]
    lower, upper = noise.support(0.5)
    return bool((reach <= 0.5 * (upper - lower)).all())


def _fitted(
    prior: Lattice, measure: Mapping, noise: Membership, z: FloatArray, universe: Universe, notes: list[str]
) -> Lattice:
    """Return the prediction on a lattice that fits the posterior."""
    t_norm, base, extended = prior.t_norm, prior, False
    for _ in range(ROUNDS):
        residual = _residual(prior, measure, z)
        cost = t_norm.combine(prior.cost, noise.cost(residual, t_norm))
        # The best that anything in the cell of a node could do, so that nothing is overlooked.
        around = minimum_filter(prior.cost, size=3, mode="nearest")
        in_cell = t_norm.combine(around, noise.cost(_nearest(residual, noise), t_norm))
        best = float(cost.min())
        sides = _touched(prior, base, cost, best, universe.limit)
        if sides:
            base = prior = _extended(prior, sides, universe)
            extended = True
            continue
        axes = _refined(prior, in_cell, best, universe)
        if axes is None and not extended:  # what is extrapolated does not get better by more nodes
            axes = _finer(prior, in_cell, universe)
        if axes is None:
            break
        prior = base.resampled(axes)
    if extended:
        notes.append(
            "the measurement lies beyond the states that the grid kept; the prediction was extrapolated "
            f"below the membership {float(t_norm.membership(universe.limit)):.3g} (see floor)"
        )
    return prior


def _touched(
    prior: Lattice, base: Lattice, cost: FloatArray, best: float, limit: float
) -> list[tuple[int, int]]:
    """Sides (axis, end) at which the prediction was cut off and the posterior is not small."""
    t_norm = prior.t_norm
    if best >= t_norm.impossible:
        return []
    level = np.sqrt(t_norm.membership(limit))
    sides = []
    for k in prior.free:
        for end in (0, -1):
            edge, before = np.asarray(cost.take(end, axis=k)), prior.cost.take(end, axis=k)
            possible = np.asarray(t_norm.membership(t_norm.renormalise(edge, best)) > level)
            outermost = prior.axes[k][end] == base.axes[k][end]
            if outermost and (possible & (before >= CUT * limit)).any():
                sides.append((k, end))
    return sides


def _extended(prior: Lattice, sides: list[tuple[int, int]], universe: Universe) -> Lattice:
    """Return the prediction continued over as much again on some sides, at a lower resolution."""
    axes, padding = list(prior.axes), [(0, 0)] * len(prior.axes)
    for k, end in sides:
        (before, after), n = padding[k], axes[k].size - 1
        padding[k] = (n, after) if end == 0 else (before, n)
    for k, (before, after) in enumerate(padding):
        if before or after:
            low, high = axes[k][0] - before * prior.step[k], axes[k][-1] + after * prior.step[k]
            axes[k] = np.linspace(low, high, before + axes[k].size + after)
    cost = continue_tails(np.pad(prior.cost, padding, constant_values=np.inf), universe.limit)
    wide = Lattice(tuple(axes), cost, prior.t_norm)
    return wide.resampled(_spanning(prior, [axis[0] for axis in axes], [axis[-1] for axis in axes], universe))


def _reaches(prior: Lattice, measure: Mapping, noise: Membership, z: FloatArray, universe: Universe) -> bool:
    """Whether any state within the domain, or within a box grown very far, explains the measurement.

    Judged component by component: h is continuous, so that it takes all values between
    the least and the largest that it takes at the nodes.
    """
    lower, upper = noise.support()
    axes, least, most = prior.axes, np.full(z.size, np.inf), np.full(z.size, -np.inf)
    for _ in range(ROUNDS):
        blank = Lattice(axes, np.full([axis.size for axis in axes], np.inf), prior.t_norm)
        residual = _residual(blank, measure, z).reshape(-1, z.size)
        least = np.minimum(least, residual.min(axis=0))
        most = np.maximum(most, np.where(np.isfinite(residual), residual, -np.inf).max(axis=0))
        if ((least <= upper) & (most >= lower)).all():
            return True
        if universe.domain is not None:
            return False
        width = [axis[-1] - axis[0] for axis in axes]
        low = [float(axis[0] - w) for axis, w in zip(axes, width, strict=True)]
        high = [float(axis[-1] + w) for axis, w in zip(axes, width, strict=True)]
        axes = _spanning(prior, low, high, universe)
    return False


def _refined(
    prior: Lattice, in_cell: FloatArray, best: float, universe: Universe
) -> tuple[FloatArray, ...] | None:
    """Axes over the part that matters of the posterior, if that is clearly smaller."""
    t_norm = prior.t_norm
    if best < t_norm.impossible:
        in_cell = t_norm.renormalise(in_cell, best)
        kept = (in_cell <= universe.limit) & (in_cell < t_norm.impossible)
    else:
        kept = in_cell < t_norm.impossible
    if not kept.any():
        return None
    low, high, smaller = [], [], False
    for k, axis in enumerate(prior.axes):
        there = np.flatnonzero(kept.any(axis=tuple(m for m in range(kept.ndim) if m != k)))
        first, last = max(int(there[0]) - 1, 0), min(int(there[-1]) + 1, axis.size - 1)
        low.append(float(axis[first]))
        high.append(float(axis[last]))
        fine = axis.size > 1 and axis[1] - axis[0] <= 1e-12 * np.abs(axis).max()
        smaller |= last - first < OCCUPIED * (axis.size - 1) and not fine
    return _spanning(prior, low, high, universe) if smaller else None


def _finer(prior: Lattice, in_cell: FloatArray, universe: Universe) -> tuple[FloatArray, ...] | None:
    """Axes with the same bounds and more nodes, if the likely part of the posterior has too few."""
    needed = needed_nodes(prior.axes, in_cell, prior.t_norm, universe)
    counts = tuple(axis.size for axis in prior.axes)
    if not are_too_few(counts, needed, prior.axes):
        return None
    counts = tuple(max(both) for both in zip(counts, needed, strict=True))
    bounds = [axis[0] for axis in prior.axes], [axis[-1] for axis in prior.axes]
    return _spanning(prior, *bounds, replace(universe, points=counts))


def _spanning(
    prior: Lattice, low: list[float], high: list[float], universe: Universe
) -> tuple[FloatArray, ...]:
    """Axes with the given bounds; known components stay known."""
    return tuple(
        axis if axis.size == 1 else np.linspace(low[k], high[k], universe.points[k])
        for k, axis in enumerate(prior.axes)
    )


def restart(
    prior: Lattice, measure: Mapping, noise: Membership, z: FloatArray, universe: Universe
) -> Lattice | None:
    """Forget the prediction and take what the measurement says.

    Components that the measurement does not depend on keep the bounds of the
    prediction, within which all their values become equally possible.

    Returns
    -------
    Lattice or None
        None if no state explains the measurement, or if it does not bound those
        components that it depends on.
    """
    t_norm = prior.t_norm
    for _ in range(ROUNDS):
        blank = Lattice(prior.axes, np.zeros(prior.cost.shape), t_norm)
        residual = _residual(blank, measure, z)
        cost = noise.cost(_nearest(residual, noise), t_norm)
        if universe.domain is not None:
            break
        explained = (cost <= universe.limit) & (cost < t_norm.impossible)
        low, high = [], []
        for k, axis in enumerate(prior.axes):
            ends = [bool(explained.take(end, axis=k).any()) for end in (0, -1)]
            depends = axis.size > 1 and bool((np.diff(residual, axis=k) != 0.0).any())
            grow = (axis[-1] - axis[0]) * depends * np.array(ends if explained.any() else [True, True])
            low.append(float(axis[0] - grow[0]))
            high.append(float(axis[-1] + grow[1]))
        bounds = [axis[0] for axis in prior.axes], [axis[-1] for axis in prior.axes]
        if (low, high) == bounds:
            break
        axes = _spanning(prior, low, high, universe)
        prior = Lattice(axes, np.zeros([axis.size for axis in axes]), t_norm)
    else:
        return None
    blank = Lattice(prior.axes, np.zeros(prior.cost.shape), t_norm)
    return condition(blank, measure, noise, z, universe).lattice
