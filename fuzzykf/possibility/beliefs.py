"""What an estimator knows of the state: a quadratic form, a box or a grid; immutable values.

That on a grid stands with its prediction in `fuzzykf.possibility.grid.belief`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import EmptyIntersectionError, UnreachableMeasurementError
from fuzzykf.possibility import closed_form
from fuzzykf.possibility.constraint import as_measurement
from fuzzykf.possibility.grid.belief import GridBelief
from fuzzykf.possibility.intervals import boxes
from fuzzykf.possibility.intervals.box import Box
from fuzzykf.possibility.mapping import matrix_of
from fuzzykf.possibility.memberships import IntervalMembership
from fuzzykf.possibility.protocol import Belief, Outcome
from fuzzykf.possibility.representation import FAMILIES, required_box, required_quadratic
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import EllipticalMembership, Membership
    from fuzzykf.possibility.norms import TNorm
    from fuzzykf.possibility.representation import Representation

__all__ = ["Belief", "BoxBelief", "GridBelief", "Outcome", "QuadraticBelief", "believe", "nothing_explains"]


@reprs()
@dataclass(frozen=True, eq=False)
class QuadraticBelief:
    """A membership of one of the closed families.

    Attributes
    ----------
    family : {"gaussian", "cauchy", "parabolic"}
    x : ndarray, shape (d, 1) or (d,)
        Center.
    P : ndarray, shape (d, d)
        Matrix of the quadratic form.
    """

    family: str
    x: FloatArray
    P: FloatArray

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Center and matrix themselves."""
        return self.x, self.P

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the possible states, infinite but for the parabola."""
        return self.as_membership().support()

    def as_membership(self) -> EllipticalMembership:
        """Return the membership of the family."""
        return FAMILIES[self.family](self.x.ravel(), self.P)

    def mean_of_maximum(self) -> FloatArray:
        """Center (d,)."""
        return self.x.ravel()

    def peak(self) -> FloatArray:
        """Center (d,)."""
        return self.x.ravel()

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Linear prediction."""
        center, Q = required_quadratic("noise", noise, self.family)
        x, P = closed_form.predict(self.x.ravel(), self.P, matrix_of(move), Q, move.shift + center)
        return Outcome(self._with(x, P))

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Linear update."""
        center, R = required_quadratic("noise", noise, self.family)
        H = matrix_of(measure)
        found = closed_form.condition(self.x.ravel(), self.P, z - center, H, R, self.family)
        belief = None if found.x is None or found.P is None else self._with(found.x, found.P)
        possible = closed_form.possibility(found.surprise, self.family)
        return Outcome(belief, possible, posterior=found)

    def constrain(self, constraint: Membership) -> Outcome:
        """Combine with a constraint of the same family."""
        return self.update(*as_measurement(constraint))

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> QuadraticBelief | None:
        """Return what the measurement says of H x, and the prediction of the rest."""
        center, R = required_quadratic("noise", noise, self.family)
        found = closed_form.restart(self.x.ravel(), self.P, z - center, matrix_of(measure), R)
        return None if found is None else self._with(*found)

    def _with(self, x: FloatArray, P: FloatArray) -> QuadraticBelief:
        return QuadraticBelief(self.family, x.reshape(self.x.shape), P)


@reprs()
@dataclass(frozen=True, eq=False)
class BoxBelief:
    """A crisp interval or box."""

    box: IntervalMembership

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Center, and the variances width^2 / 12 of a uniform density."""
        x, P = boxes.moments(self.box.lower, self.box.upper)
        return x.reshape(-1, 1), P

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds (d,)."""
        return self.box.lower, self.box.upper

    def as_membership(self) -> IntervalMembership:
        """Return the box itself."""
        return self.box

    def mean_of_maximum(self) -> FloatArray:
        """Center (d,)."""
        return self.box.peak

    def peak(self) -> FloatArray:
        """Center (d,)."""
        return self.box.peak

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Image of the box, enlarged by the noise."""
        found = boxes.predict(self._bounds, move, required_box("noise", noise))
        return Outcome(BoxBelief(found.as_membership()))

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Part of the box that explains a measurement."""
        error = required_box("noise", noise)
        found = boxes.update(self._bounds, measure, error, z)
        if found is None:
            return Outcome(None, 0.0, boxes.is_reachable(self._bounds, measure, error, z))
        return Outcome(BoxBelief(found.as_membership()))

    def constrain(self, constraint: Membership) -> Outcome:
        """Part of the box within another one, which may be open."""
        lower, upper = constraint.support()
        lower, upper = np.maximum(self.box.lower, lower), np.minimum(self.box.upper, upper)
        if (lower > upper).any():
            return Outcome(None, 0.0)
        if np.array_equal(lower, self.box.lower) and np.array_equal(upper, self.box.upper):
            return Outcome(self)
        return Outcome(BoxBelief(IntervalMembership(lower, upper)))

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> BoxBelief | None:
        """All states that explain the measurement."""
        found = boxes.restart(self._bounds, measure, required_box("noise", noise), z)
        return None if found is None else BoxBelief(found.as_membership())

    @property
    def _bounds(self) -> Box:
        return Box(self.box.lower, self.box.upper)


def believe(
    name: str,
    membership: Membership,
    representation: Representation,
    t_norm: TNorm,
    universe: Universe | None,
) -> Belief:
    """Bring a membership of the state into a representation.

    Parameters
    ----------
    name : str
        Of the argument, for messages.
    membership : Membership
    representation : str
    t_norm : TNorm
    universe : Universe or None
        Of a grid.

    Raises
    ------
    ParameterError
        If the membership has no such representation.
    """
    if universe is not None:
        return GridBelief.of(name, membership, t_norm, universe)
    if representation == "interval":
        return BoxBelief(required_box(name, membership))
    center, matrix = required_quadratic(name, membership, representation)
    return QuadraticBelief(representation, center.reshape(-1, 1).copy(), matrix.copy())


def nothing_explains(
    z: FloatArray, measure: Mapping, belief: Belief, outcome: Outcome, note: str
) -> EmptyIntersectionError:
    """Return the error for a measurement that no possible state explains."""
    if not outcome.reachable:
        return UnreachableMeasurementError(
            f"z: got {z.tolist()}, which {measure.name} does not reach from any state, whatever the "
            f"admissible noise{note}"
        )
    lower, upper = belief.bounds()
    return EmptyIntersectionError(
        f"z: got {z.tolist()}, which no possible state explains; these are within {lower.tolist()} and "
        f"{upper.tolist()}{note}"
    )
