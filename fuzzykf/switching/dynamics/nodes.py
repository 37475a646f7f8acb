"""What one step needs where its parameters are those of the value of the switch it arrives at.

X is the state and Y what is observed of it, j a node of the switch at the new time.  Given it,

    X' = F X + b + N(0, Q)
    Y' = H X' + d + N(0, R).

Unlike in `fuzzykf.switching.dynamics.pairs`, the past of Y says nothing beside X.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import symmetrize
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs
from fuzzykf.switching.dynamics.pairs import InitialLaw, log_probability

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["NodeLaw", "NodeSystem", "NodeTables", "joint_moments"]


@reprs()
@dataclass(frozen=True, eq=False)
class NodeTables:
    """Everything the recursion needs for one step n -> n + 1.

    Attributes
    ----------
    transition : ndarray, shape (M1, M2)
        Probability of node j at n + 1 given node i at n.
    F, b, Q : ndarray, shapes (M2, m, m), (M2, m), (M2, m, m)
        How the state moves to node j; a control is a part of b.
    H, d, R : ndarray, shapes (M2, q, m), (M2, q), (M2, q, q)
        What is seen of it there.
    """

    transition: FloatArray
    F: FloatArray
    b: FloatArray
    Q: FloatArray
    H: FloatArray
    d: FloatArray
    R: FloatArray

    @cached_property
    def log_transition(self) -> FloatArray:
        """Logarithm of the transition probabilities, minus infinity of zero; made once."""
        with np.errstate(divide="ignore"):
            return np.log(self.transition)

    @property
    def space(self) -> tuple[FloatArray, ...]:
        """F, b, Q, H, d and R with axes for series and steps: (1, 1, M2, ...)."""
        return tuple(one[None, None] for one in (self.F, self.b, self.Q, self.H, self.d, self.R))

    @cached_property
    def kernel(self) -> Any:
        """All of it as the engine takes it; made once."""
        return engine.pack_nodes(engine.NodeSpace(*self.space), self.log_transition)

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        # what is cached belongs to one engine
        return type(self), (self.transition, self.F, self.b, self.Q, self.H, self.d, self.R)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


@reprs()
@dataclass(frozen=True, eq=False)
class NodeLaw(InitialLaw):
    """The law of the first node and of Z_1 = (X_1, Y_1) given it, and how Y_1 comes from X_1.

    Attributes
    ----------
    probability : ndarray, shape (M,)
    mean, covariance : ndarray, shapes (M, m + q) and (M, m + q, m + q)
    H, d, R : ndarray, shapes (M, q, m), (M, q), (M, q, q)
    """

    H: FloatArray
    d: FloatArray
    R: FloatArray

    @cached_property
    def table(self) -> FloatArray:
        """The law of (r_1, X_1) as engines take it, (1 + m + m*m, M); made once."""
        m = self.H.shape[-1]
        rows = self.mean[:, :m].T, self.covariance[:, :m, :m].reshape(len(self.mean), m * m).T
        return np.concatenate([log_probability(self.probability)[None], *rows])

    @cached_property
    def kernel(self) -> Any:
        """How Y_1 comes from X_1 as the engine takes it; made once."""
        M, m = self.H.shape[0], self.H.shape[-1]
        still = np.zeros((M, m, m)), np.zeros((M, m)), np.zeros((M, m, m))  # nothing moves before it
        space = (one[None, None] for one in (*still, self.H, self.d, self.R))
        return engine.pack_nodes(engine.NodeSpace(*space), np.full((M, M), -np.inf))

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        # what is cached belongs to one engine
        return type(self), (self.probability, self.mean, self.covariance, self.H, self.d, self.R)

    def seen_by(self, H: FloatArray | None, R: FloatArray | None) -> NodeLaw:
        """Return the law where something else is seen of X_1, as far as it is told."""
        m = self.H.shape[-1]
        state = self.mean[:, :m], self.covariance[:, :m, :m]
        H, R = self.H if H is None else H, self.R if R is None else R
        return NodeLaw.of_state(self.probability, *state, H, self.d, R)

    @classmethod
    def of_state(
        cls,
        probability: FloatArray,
        mean: FloatArray,
        covariance: FloatArray,
        H: FloatArray,
        d: FloatArray,
        R: FloatArray,
    ) -> Self:
        """Make it from mean (M, m) and covariance (M, m, m) of X_1 alone."""
        return cls(probability, *joint_moments(mean, covariance, H, d, R), H, d, R)


class NodeSystem(Protocol):
    """A state-space model placed on the nodes of a chain: what the recursions on nodes ask.

    Attributes
    ----------
    chain : SwitchChain
    dim_x, dim_z : int
    order : int
        How many past observations a step conditions on: none.
    steady_from : int or None
        From which n on `pair_tables` is always the same; None if it never is.
    """

    chain: SwitchChain
    dim_x: int
    dim_z: int
    order: int
    steady_from: int | None

    def initial(self) -> NodeLaw:
        """Return the law of (r_1, Z_1)."""

    def pair_tables(self, n: int) -> NodeTables:
        """Return the tables of the step from observation ``n`` to ``n + 1`` (n = 0, 1, ...)."""

    def steps(self, start: int, n: int) -> tuple[FloatArray, ...]:
        """Return F, b, Q, H, d and R of the steps to observations start, ..., start + n - 1.

        Arrays (s, n, M, ...) with an axis for series and one for steps, each of length 1 where it is shared.
        Nothing moves to observation 0, of which H, d and R count.
        """


def joint_moments(
    mean: FloatArray, covariance: FloatArray, H: FloatArray, d: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean (..., m + q) and covariance of (X, Y), Y = H X + d + N(0, R), from those of X."""
    across = H @ covariance
    seen = symmetrize(across @ np.swapaxes(H, -1, -2) + R)
    upper = np.concatenate([covariance, np.swapaxes(across, -1, -2)], axis=-1)
    rows = np.concatenate([upper, np.concatenate([across, seen], axis=-1)], axis=-2)
    return np.concatenate([mean, (H @ mean[..., None])[..., 0] + d], axis=-1), rows
