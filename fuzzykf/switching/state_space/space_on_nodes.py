"""A switching state-space model on the nodes of its switch, in factors: what is converted, node by node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, check_covariance, covariance_root, mixture_moments, square
from fuzzykf.immutable import Immutable
from fuzzykf.reprs import reprs
from fuzzykf.switching.laws.chain import SUM_TOLERANCE, SwitchChain
from fuzzykf.switching.state_space.conversion import StateSpace, backward_kernel
from fuzzykf.switching.state_space.offsets import Offsets

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.state_space.space_system import SpaceSystem

__all__ = ["SpaceOnNodes"]

#: A law that changes by less in a step, as a part of its own size, is stationary.
STATIONARY = 1e-9

_CHAIN = ("nodes", "weights", "initial", "transition", "class_weights")


@reprs("n_classes", "dim_x", "dim_z")
class SpaceOnNodes(Immutable):
    """X' = A_j X + b_j + C_j U and Y' = B_j X' + d_j + D_j V, with j the node of arrival.

    As `CGLSSM`, with offsets and on a chain whose nodes have class weights.

    Parameters
    ----------
    chain : SwitchChain
        Of M nodes.
    A, B, C, D : ndarray, shapes (M, m, m), (M, q, m), (M, m, s), (M, q, t)
    b, d : ndarray, shapes (M, m) and (M, q)
    initial_mean, initial_covariance : ndarray, shapes (M, m) and (M, m, m)
        Of X given the node, at the first observation.

    Attributes
    ----------
    space : StateSpace
    offsets : Offsets
    n_classes : int
        Number M of nodes.
    """

    def __init__(
        self,
        chain: SwitchChain,
        A: Any,
        B: Any,
        C: Any,
        D: Any,
        b: Any,
        d: Any,
        initial_mean: Any,
        initial_covariance: Any,
    ) -> None:
        self.chain, self.n_classes = chain, len(chain)
        M = len(chain)
        self.initial_mean = as_array("initial_mean", initial_mean, (M, None))
        m = self.dim_x = self.initial_mean.shape[1]
        seen = as_array("B", B, (M, None, m))
        q = self.dim_z = seen.shape[1]
        self.space = StateSpace(
            as_array("A", A, (M, m, m)), seen, as_array("C", C, (M, m, None)), as_array("D", D, (M, q, None))
        )
        self.offsets = Offsets(as_array("b", b, (M, m)), as_array("d", d, (M, q)))
        self.initial_covariance = check_covariance("initial_covariance", initial_covariance, (M, m, m))

    @classmethod
    def of(cls, system: SpaceSystem) -> Self:
        """Make it from a placed system without controls."""
        if system.dim_u is not None:
            raise ParameterError(
                f"B: got a model with {system.dim_u} controls, expected one without: a model with an exact "
                "filter conditions on observations alone"
            )
        tables, first, m = system.tables, system.first, system.dim_x
        return cls(
            system.chain,
            tables.F,
            tables.H,
            covariance_root(tables.Q),
            covariance_root(tables.R),
            tables.b,
            tables.d,
            first.mean[:, :m],
            first.covariance[:, :m, :m],
        )

    @property
    def transition(self) -> FloatArray:
        """Transition probabilities of the nodes, (M, M)."""
        return self.chain.transition

    @property
    def initial_probability(self) -> FloatArray:
        """Probabilities of the nodes at the first observation, (M,)."""
        return self.chain.initial

    @property
    def starts_stationary(self) -> bool:
        """Whether the laws of switch and state at the first observation stay as they are."""
        p = self.chain.initial
        if not np.allclose(p @ self.chain.transition, p, rtol=0.0, atol=SUM_TOLERANCE):
            return False
        with np.errstate(divide="ignore"):
            kernel, _ = backward_kernel(np.log(p), self.chain.transition)
        there = p > 0.0
        weights = kernel.T[there]
        given = (
            np.broadcast_to(one, (len(weights), *one.shape))
            for one in (self.initial_mean, self.initial_covariance)
        )
        mean, P = mixture_moments(weights, *given)
        A, _, C, _ = (one[there] for one in self.space)
        mean = (A @ mean[..., None])[..., 0] + self.offsets.b[there]
        P = A @ P @ np.swapaxes(A, -1, -2) + square(C)
        old, now = self.initial_covariance[there], np.abs(self.initial_mean[there] - mean)
        sd = np.sqrt(np.diagonal(old, axis1=-2, axis2=-1))
        fits = now <= STATIONARY * (np.abs(mean) + sd)
        return bool(fits.all() and (np.abs(old - P) <= STATIONARY * sd[:, :, None] * sd[:, None]).all())

    def check_stationary(self) -> None:
        """Raise an error unless switch and state start in their stationary law."""
        if not self.starts_stationary:
            raise ParameterError(
                "initial_mean, initial_covariance: expected the stationary ones, or mode='time_varying'"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments of the constructor as plain values."""
        chain = {name: getattr(self.chain, name).tolist() for name in _CHAIN}
        own = dict(zip("ABCDbd", (*self.space, *self.offsets), strict=True))
        own |= {name: getattr(self, name) for name in ("initial_mean", "initial_covariance")}
        return {"chain": chain} | {name: value.tolist() for name, value in own.items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make it from what `to_dict` returned."""
        chain = SwitchChain(**{name: values["chain"][name] for name in _CHAIN})
        return cls(
            chain, **{name: values[name] for name in (*"ABCDbd", "initial_mean", "initial_covariance")}
        )
