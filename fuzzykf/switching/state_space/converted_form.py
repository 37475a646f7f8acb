"""The dynamics of a converted state-space model: what a model holds and a file keeps of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import semidefinite_root
from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.base import Dynamics
from fuzzykf.switching.state_space.cglssm import CGLSSM
from fuzzykf.switching.state_space.closeness import error_ratio, warn_if_far
from fuzzykf.switching.state_space.converted import ConvertedPath, ConvertedSystem
from fuzzykf.switching.state_space.space_on_nodes import SpaceOnNodes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain
    from fuzzykf.switching.state_space.converted import Construction, Mode, Noise
    from fuzzykf.switching.state_space.space_system import SpaceSystem

__all__ = ["ConvertedForm", "ConvertedNodesForm"]


class ConvertedForm(Dynamics):
    """A state-space model turned into dynamics that have an exact filter.

    What a step does depends on how likely the regimes are before it, so these dynamics
    can be placed on the chain of their state-space model alone.

    Parameters
    ----------
    cglssm, construction, noise, order, mode
        As in `ConvertedSystem`.
    """

    kind = "cglssm"

    def __init__(
        self,
        cglssm: CGLSSM | SpaceOnNodes,
        construction: Construction,
        noise: Noise,
        order: int,
        mode: Mode,
    ) -> None:
        self.system = ConvertedSystem(cglssm, construction, noise, order, mode)
        self.n_classes, self.dim_x, self.dim_z = cglssm.n_classes, cglssm.dim_x, cglssm.dim_z
        self.order = self.system.order

    @property
    def cglssm(self) -> CGLSSM | None:
        """The state-space model, if it was a CGLSSM."""
        given = self.system.cglssm
        return given if isinstance(given, CGLSSM) else None

    def placed(self, chain: SwitchChain) -> ConvertedSystem:
        """Return the converted system.

        Raises
        ------
        ParameterError
            If the chain is not that of the state-space model.
        """
        own = self.system.chain
        same = np.array_equal(chain.transition, own.transition) and np.array_equal(chain.initial, own.initial)
        if not same:
            raise ParameterError(
                "transition, initial: a converted model goes with the chain of its state-space model alone"
            )
        return self.system

    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> ConvertedPath:
        """Return the dynamics along known regimes ``r``."""
        return ConvertedPath(self.system, r, start)

    def simulate(self, shares: FloatArray, r: FloatArray, rng: np.random.Generator) -> Simulation:
        """Draw states and observations of the converted model along regimes ``r``."""
        n, m, q = len(r), self.dim_x, self.dim_z
        x, y = np.empty((n, m)), np.empty((n, q))
        noise = rng.standard_normal((n, q + m))
        for k in range(n):
            j = int(r[k])
            if k == 0:
                law = self.system.law(0)
                first = law.factor[j] @ noise[0] + (0.0 if law.mean is None else law.mean[j])
                y[0], x[0] = first[:q], first[q:]
                continue
            step = [value[int(r[k - 1]), j] for value in self.system.pair_tables(k - 1).pairs]
            Axx, H, G, c, C, Ayy, Ny, Qyy = step
            window = y[max(0, k - self.order) : k][::-1].reshape(-1)
            y[k] = Ayy @ window + Ny + np.linalg.cholesky(Qyy) @ noise[k, :q]
            x[k] = Axx @ x[k - 1] + H @ window + G @ y[k] + c + semidefinite_root(C) @ noise[k, q:]
        return Simulation(x, y, r)

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the regime of r_1, one-hot in ``u``."""
        regime, law = u.argmax(axis=-1), self.system.initial()
        return law.mean[regime], law.covariance[regime]

    def closeness(self, weights: ArrayLike) -> float:
        """Compare the filter with the optimal one of the state-space model."""
        return error_ratio(self.system, weights)

    def to_dict(self) -> dict[str, Any]:
        """Return state-space model and options as plain values."""
        return self.system.cglssm.to_dict() | self.system.options

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Make the dynamics from what `to_dict` returned."""
        options = {name: values[name] for name in ("construction", "noise", "order", "mode")}
        return cls(CGLSSM.from_dict(values), **options)


class ConvertedNodesForm(ConvertedForm):
    """A switching state-space model of any law, turned into dynamics on its nodes that have an exact filter.

    Parameters are those of `ConvertedForm`.
    """

    kind = "space_on_nodes"

    @classmethod
    def of(cls, system: SpaceSystem, order: int) -> Self:
        """Convert a placed system by the construction 'gain'.

        Tables do not depend on time, but for the growing window, if the system starts in its stationary law.
        """
        space = SpaceOnNodes.of(system)
        return cls(space, "gain", "pair", order, "stationary" if space.starts_stationary else "time_varying")

    def warn_if_far(self, stacklevel: int) -> None:
        """Warn of a filter that is far from the optimal one, at the line that calls this (1) or above."""
        warn_if_far(self.system, stacklevel + 2)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Make the dynamics from what `to_dict` returned."""
        options = {name: values[name] for name in ("construction", "noise", "order", "mode")}
        return cls(SpaceOnNodes.from_dict(values), **options)
