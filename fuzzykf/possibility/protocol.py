"""What the estimator asks of a belief, and what a belief answers; each representation has one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.closed_form import Posterior
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership

__all__ = ["Belief", "Outcome"]


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
    prior : Belief or None
        Of an update on a grid, the prediction on the lattice of the result.
    """

    belief: Belief | None
    possibility: float = 1.0
    reachable: bool = True
    notes: list[str] = field(default_factory=list)
    posterior: Posterior | None = None
    prior: Belief | None = None


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

    def constrain(self, constraint: Membership) -> Outcome:
        """Combine with a constraint of the state; the outcome is this belief if it says nothing new."""

    def restart(self, measure: Mapping, noise: Membership, z: FloatArray) -> Belief | None:
        """Return what the measurement alone says; None if that is not enough."""
