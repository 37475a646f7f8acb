"""What an estimator knows of the state: a quadratic form, a box or a grid; immutable values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fuzzykf.errors import EmptyIntersectionError, UnreachableMeasurementError
from fuzzykf.possibility import closed_form
from fuzzykf.possibility.grid import conditioning
from fuzzykf.possibility.grid.lattice import Lattice
from fuzzykf.possibility.grid.noise import decompose
from fuzzykf.possibility.grid.propagation import propagate
from fuzzykf.possibility.intervals import boxes
from fuzzykf.possibility.mapping import matrix_of
from fuzzykf.possibility.representation import FAMILIES, required_box, required_quadratic

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Universe
    from fuzzykf.possibility.grid.noise import Noise
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import (
        EllipticalMembership,
        GridMembership,
        IntervalMembership,
        Membership,
    )
    from fuzzykf.possibility.norms import TNorm
    from fuzzykf.possibility.representation import Representation

__all__ = ["Belief", "BoxBelief", "GridBelief", "Outcome", "QuadraticBelief", "believe", "nothing_explains"]

#: The loss of states at an edge is reported from this membership on: of unbounded
#: memberships, which every domain cuts somewhere, and of bounded ones.
LOSS_UNBOUNDED, LOSS_BOUNDED = 0.5, 0.01


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a prediction or an update.

    Attributes
    ----------
    belief : Belief or None
        None if prediction and measurement exclude each other.
    possibility : float
        Of the measurement.
    reachable : bool
        Whether any state, possible or not, could explain the measurement.
    notes : list of str
        What the user has to be warned of.
    posterior : Posterior or None
        Residual and gain of an update in closed form.
    """

    belief: Belief | None
    possibility: float = 1.0
    reachable: bool = True
    notes: list[str] = field(default_factory=list)
    posterior: closed_form.Posterior | None = None


class Belief(Protocol):
    """What `FuzzyRelationEstimator` asks of a belief."""

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Centroid (d, 1) (or as the user gave it) and spread (d, d)."""

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds (d,) of the possible states."""

    def as_membership(self) -> Membership:
        """Membership of the state."""

    def mean_of_maximum(self) -> FloatArray:
        """Mean (d,) of the likeliest states."""

    def peak(self) -> FloatArray:
        """Likeliest state (d,)."""

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Image under the map, spread by the noise."""

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Combine with a measurement."""

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> Belief | None:
        """Return what the measurement alone says; None if that is not enough."""


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

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> QuadraticBelief | None:
        """Return what the measurement says of H x, and the prediction of the rest."""
        center, R = required_quadratic("noise", noise, self.family)
        found = closed_form.restart(self.x.ravel(), self.P, z - center, matrix_of(measure), R)
        return None if found is None else self._with(*found)

    def _with(self, x: FloatArray, P: FloatArray) -> QuadraticBelief:
        return QuadraticBelief(self.family, x.reshape(self.x.shape), P)


@dataclass(frozen=True, eq=False)
class BoxBelief:
    """A crisp interval or box."""

    box: IntervalMembership

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Center, and the variances width^2 / 12 of a uniform density."""
        return self.box.peak.reshape(-1, 1), np.diag((self.box.upper - self.box.lower) ** 2 / 12.0)

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
        return Outcome(BoxBelief(boxes.predict(self.box, move, required_box("noise", noise))))

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Part of the box that explains a measurement."""
        found = boxes.update(self.box, measure, required_box("noise", noise), z)
        if found is None:
            return Outcome(None, 0.0, boxes.is_reachable(self.box, measure, required_box("noise", noise), z))
        return Outcome(BoxBelief(found))

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> BoxBelief | None:
        """All states that explain the measurement."""
        found = boxes.restart(self.box, measure, required_box("noise", noise), z)
        return None if found is None else BoxBelief(found)


@dataclass(frozen=True, eq=False)
class GridBelief:
    """Costs on a lattice that is fixed or follows the live region."""

    lattice: Lattice
    universe: Universe
    noise: Noise | None = None  # of the latest prediction: it is mostly the same at the next one

    @classmethod
    def of(cls, name: str, membership: Membership, t_norm: TNorm, universe: Universe) -> GridBelief:
        """Sample a membership; components of zero width are kept as known exactly."""
        floor = 0.0 if membership.is_bounded else float(t_norm.membership(universe.limit))
        lower, upper = membership.support(floor)
        axes = tuple(
            np.array([low]) if low == high else universe.axis(k, float(low), float(high))
            for k, (low, high) in enumerate(zip(lower, upper, strict=True))
        )
        return cls(Lattice.of(name, membership, axes, t_norm), universe)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Centroid and second central moments, by the trapezoidal rule."""
        mean, P = self.lattice.moments
        return mean.reshape(-1, 1), P

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the live nodes."""
        return self.lattice.bounds(self.universe.limit)

    def as_membership(self) -> GridMembership:
        """Return the values on the nodes."""
        return self.lattice.as_membership()

    def mean_of_maximum(self) -> FloatArray:
        """Mean of the nodes of largest membership."""
        return self.lattice.mean_of_maximum()

    def peak(self) -> FloatArray:
        """Likeliest point, between the nodes."""
        return self.lattice.peak()

    def predict(self, move: Mapping, noise: Membership) -> Outcome:
        """Warp by the map, and convolution with the noise."""
        t_norm, universe, parts = self.lattice.t_norm, self.universe, self.noise
        if parts is None or parts.membership is not noise:
            parts = decompose(noise, t_norm)
        lattice, lost = propagate(self.lattice, move, parts, universe)
        notes = lattice.notes(follows=universe.domain is None)
        level = 0.0 if np.isinf(lost) else float(t_norm.membership(lost))
        if level > (LOSS_BOUNDED if universe.bounded else LOSS_UNBOUNDED):
            notes.append(
                f"domain: states of membership up to {level:.3g} leave it at this prediction and count as "
                "impossible from now on; widen the domain, or leave it out so that the grid follows the state"
            )
        return Outcome(GridBelief(lattice, universe, parts), notes=notes)

    def update(self, measure: Mapping, noise: Membership, z: FloatArray) -> Outcome:
        """Combine with a measurement, on a lattice that fits the result."""
        found = conditioning.condition(self.lattice, measure, noise, z, self.universe)
        if found.lattice is None:
            return Outcome(None, found.possibility, found.reachable, found.notes)
        notes = found.notes or found.lattice.notes(follows=self.universe.domain is None)
        return Outcome(self._with(found.lattice), found.possibility, found.reachable, notes)

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> GridBelief | None:
        """Return what the measurement alone says."""
        lattice = conditioning.restart(self.lattice, measure, noise, z, self.universe)
        return None if lattice is None else self._with(lattice)

    def _with(self, lattice: Lattice) -> GridBelief:
        return GridBelief(lattice, self.universe, self.noise)


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
