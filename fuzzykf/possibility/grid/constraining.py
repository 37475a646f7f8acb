"""A constraint on the states of a lattice.

It is a measurement of the state, for which the lattice is refined or extended as for any other.  A box ends
between nodes; a lattice that follows the live region is then laid out anew, to end where the box does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import subgrid_minimum
from fuzzykf.possibility.constraint import as_measurement, is_crisp
from fuzzykf.possibility.grid.conditioning import Conditioned, condition
from fuzzykf.possibility.grid.lattice import Lattice

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.memberships import Membership

__all__ = ["constrain"]


def constrain(prior: Lattice, constraint: Membership, universe: Universe) -> Conditioned:
    """Combine a lattice with a constraint.

    Parameters
    ----------
    prior : Lattice
    constraint : Membership
        Of the state.
    universe : Universe
        With a domain, the lattice stays as it is, and ends at the last nodes within the constraint.

    Returns
    -------
    Conditioned
        Its lattice is that of ``prior``, the same object, if all of it is within a box.
    """
    crisp = is_crisp(constraint)
    if crisp and _holds(prior, constraint):
        return Conditioned(prior, 1.0, True, [], prior)
    found = condition(prior, *as_measurement(constraint), universe)
    notes = [f"constraint: {note.replace('the measurement', 'it')}" for note in found.notes]
    if found.lattice is None or found.prior is None:
        return Conditioned(None, 0.0, found.reachable, notes)
    if not crisp or universe.domain is not None:
        return Conditioned(found.lattice, found.possibility, True, notes, found.prior)
    clipped = found.prior.resampled(_clipped(found.prior, *constraint.support()))
    t_norm = prior.t_norm
    best = subgrid_minimum(clipped.cost)[0] if t_norm.additive else float(clipped.cost.min())
    if not best < t_norm.impossible:
        return Conditioned(None, 0.0, True, notes)
    best = max(0.0, best)
    lattice = Lattice(clipped.axes, t_norm.renormalise(clipped.cost, best), t_norm)
    return Conditioned(lattice, float(t_norm.membership(best)), True, notes, clipped)


def _holds(lattice: Lattice, box: Membership) -> bool:
    """Whether all nodes that are possible lie within a box."""
    lower, upper = box.support()
    if all(low <= a[0] and a[-1] <= high for a, low, high in zip(lattice.axes, lower, upper, strict=True)):
        return True
    points = lattice.points[lattice.live(np.inf)]
    return bool(((points >= lower) & (points <= upper)).all())


def _clipped(lattice: Lattice, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, ...]:
    """Return the axes of a lattice within bounds, with as many nodes."""
    axes = []
    for axis, low, high in zip(lattice.axes, lower, upper, strict=True):
        first, last = max(float(axis[0]), float(low)), min(float(axis[-1]), float(high))
        axes.append(np.linspace(first, last, axis.size) if first < last else np.array([first]))
    return tuple(axes)
