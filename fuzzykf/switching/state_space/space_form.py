"""The dynamics of a switching state-space model, at any value of the switch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import NotStableError, NumericalRangeError, ParameterError
from fuzzykf.gaussian import as_choice, mixture_moments, semidefinite_root
from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.base import Dynamics
from fuzzykf.switching.dynamics.exactness import Exactness, mixed_regimes
from fuzzykf.switching.dynamics.nodes import joint_moments
from fuzzykf.switching.laws.chain import (
    SAME_VALUE,
    starts_stationary,
    stationary_back,
    stationary_distribution,
)
from fuzzykf.switching.state_space.parameters import Parameter, columns_of, rows_of
from fuzzykf.switching.state_space.space_system import SpacePath, SpacePaths, SpaceSystem
from fuzzykf.switching.state_space.stationary import LongRun

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["FirstGradient", "StateSpaceForm"]

#: Growth by less than this is none: rounding.
STATIONARY = 1e-9


class FirstGradient(NamedTuple):
    """Derivatives by what the first moments of the state depend on."""

    values: dict[str, FloatArray]  # by names of parameters, at each node (M, ...)
    initial: FloatArray  # (M,)
    transition: FloatArray  # (M, M)


class StateSpaceForm(Dynamics):
    """X' = F X + b + B u' + N(0, Q), Y = H X + d + N(0, R), all by the value of the switch at that time.

    Parameters
    ----------
    chain : SwitchChain
        The switch, on the nodes on which the form is proved; where X starts in its stationary law, this is
        that of the nearest of these nodes.
    F, H, Q, R, b, d, B, x0, P0 : array_like or callable
        As in `SwitchingStateSpace`; of the last five None where not given.
    mix : {"linear", "log"}
    """

    kind = "state_space"
    known_method = "imm"  # of one node, which is the Kalman filter

    def __init__(
        self,
        chain: SwitchChain,
        F: Any,
        H: Any,
        Q: Any,
        R: Any,
        *,
        b: Any = None,
        d: Any = None,
        B: Any = None,
        x0: Any = None,
        P0: Any = None,
        mix: str = "linear",
    ) -> None:
        self.mix = as_choice("mix", mix, ("linear", "log"))
        self.chain = chain
        there = chain.class_weights[chain.reachable]
        self.n_classes = K = chain.n_classes
        m = self.dim_x = columns_of("F", F, there[0])
        q = self.dim_z = rows_of("H", H, there[0])
        #: Number of controls, None if there are none.
        self.dim_u = None if B is None else columns_of("B", B, there[0])
        shapes: dict[str, tuple[Any, tuple[int, ...], str | None]] = {
            "F": (F, (m, m), None),
            "b": (np.zeros(m) if b is None else b, (m,), None),
            "Q": (Q, (m, m), mix),
            "H": (H, (q, m), None),
            "d": (np.zeros(q) if d is None else d, (q,), None),
            "R": (R, (q, q), mix),
        }
        if B is not None:
            shapes["B"] = B, (m, self.dim_u or 0), None
        start = {"x0": (x0, (m,), None), "P0": (P0, (m, m), mix)}
        shapes |= {name: one for name, one in start.items() if one[0] is not None}
        #: The parameters by name; x0 and P0 are missing where they are stationary.
        self.parameters = {name: Parameter(name, one[0], K, *one[1:]) for name, one in shapes.items()}
        for parameter in self.parameters.values():  # a form that exists is valid
            parameter.at(there)
        #: The state in the long run on its own nodes, where the first one has to do with it.
        self._run = self._long_run(chain)
        self._first = self._moments(chain, self._run)

    def at(self, name: str, shares: FloatArray) -> FloatArray:
        """Return a parameter at values of the switch with these shares (..., K)."""
        return self.parameters[name].at(shares)

    # ------------------------------------------------------------------ the first state

    def first_moments(self, chain: SwitchChain) -> tuple[FloatArray, FloatArray]:
        """Mean (M, m) and covariance (M, m, m) of the first state given each node of a chain.

        Raises
        ------
        NotStableError, ParameterError
            If they are to be stationary, and there is no such law.
        """
        return self._first if chain is self.chain else self._moments(chain, self._long_run(chain))

    def _moments(self, chain: SwitchChain, run: LongRun | None) -> tuple[FloatArray, FloatArray]:
        M, m = len(chain), self.dim_x
        there = chain.initial > 0.0
        mean, covariance = np.zeros((M, m)), np.broadcast_to(np.eye(m), (M, m, m)).copy()
        for name, moment in (("x0", mean), ("P0", covariance)):
            if name in self.parameters:
                moment[there] = self.at(name, chain.class_weights[there])
            else:
                assert run is not None
                moment[:] = run.mean if name == "x0" else run.covariance
        return mean, covariance

    def pull_back(self, chain: SwitchChain, by_mean: FloatArray, by_covariance: FloatArray) -> FirstGradient:
        """Return derivatives of what has these by the `first_moments`.

        Parameters
        ----------
        chain : SwitchChain
        by_mean, by_covariance : ndarray, shapes (M, m) and (M, m, m)
            Zero at nodes that nothing begins in.
        """
        found = {"x0": by_mean, "P0": by_covariance}
        values = {name: one for name, one in found.items() if name in self.parameters}
        by_initial, by_transition = np.zeros(len(chain)), np.zeros((len(chain),) * 2)
        run = self._run if chain is self.chain else self._long_run(chain)
        if run is not None:
            by_mean = np.zeros_like(by_mean) if "x0" in values else by_mean
            by_p, by_transition, *rest = run.pull_back(by_mean, None if "P0" in values else by_covariance)
            values |= dict(zip(("F", "b", "Q"), rest, strict=True))
            if starts_stationary(chain):
                by_initial = by_p
            else:
                p = stationary_distribution(chain.transition)
                by_transition = by_transition + stationary_back(p, chain.transition, by_p)
        return FirstGradient(values, by_initial, by_transition)

    def _long_run(self, chain: SwitchChain) -> LongRun | None:
        """Return the state in the long run; None where x0 and P0 are given."""
        missing = [name for name in ("x0", "P0") if name not in self.parameters]
        if not missing:
            return None
        name, settles = " and ".join(missing), "P0" in missing
        p = chain.initial
        if not starts_stationary(chain):
            try:
                p = stationary_distribution(chain.transition)
            except ParameterError as error:
                raise ParameterError(
                    f"{name}: has to be given, since the switch has several closed classes and no unique "
                    "stationary law"
                ) from error
        passing = np.flatnonzero((chain.initial > 0.0) & (p == 0.0))
        if passing.size:
            raise ParameterError(
                f"{name}: has to be given, since the switch starts at {chain.describe(int(passing[0]))}, "
                "which does not occur in the long run, so that the state has no stationary law there"
            )
        u, there = chain.class_weights, p > 0.0
        matrices = []
        for one in ("F", "b", "Q"):
            values = np.zeros((len(chain), *self.parameters[one].shape))
            values[there] = self.at(one, u[there])
            matrices.append(values)
        found = LongRun(p, chain.transition, *matrices)
        radius = found.radius if settles else found.mean_radius
        if not radius < 1.0 - STATIONARY:
            what = "second moments of the state" if settles else "means of the state"
            raise NotStableError(
                f"{name}: has to be given, since F is not stable: {what} grow by {radius:.6g} a step, "
                "expected less than 1"
            )
        return found

    def state_at(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (..., m) and covariance (..., m, m) of the first state at values of the switch."""
        given = self.parameters.keys() >= {"x0", "P0"}
        mean, covariance = (None, None) if given else self._nearest(shares)
        mean = self.at("x0", shares) if mean is None or "x0" in self.parameters else mean
        covariance = self.at("P0", shares) if covariance is None or "P0" in self.parameters else covariance
        return mean, covariance

    def _nearest(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Moments of the first state at the nearest value of the chain, over all nodes that have it."""
        nodes = np.flatnonzero(self.chain.initial > 0.0)
        off = shares[..., None, :] - self.chain.class_weights[nodes]
        distance = (off * off).sum(axis=-1)
        near = distance <= distance.min(axis=-1, keepdims=True) + SAME_VALUE
        weights = near * self.chain.initial[nodes]
        weights /= weights.sum(axis=-1, keepdims=True)
        mean, covariance = (moment[nodes] for moment in self._first)
        lead = weights.shape[:-1]
        mean = np.broadcast_to(mean, (*lead, *mean.shape))
        return mixture_moments(weights, mean, np.broadcast_to(covariance, (*lead, *covariance.shape)))

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the shares of r_1."""
        return joint_moments(*self.state_at(u), *(self.at(name, u) for name in ("H", "d", "R")))

    # ------------------------------------------------------------------ placed

    def exactness(self, chain: SwitchChain) -> Exactness:
        """Say whether filtering is exact on a chain: where no two histories of the switch meet."""
        if mixed_regimes(chain).any():
            words = "not exact in general: histories of the switch meet, and every observation asks the state"
            return Exactness(False, words)
        return Exactness(True, "exact: no two histories of the switch meet; it is the Kalman filter")

    def placed(self, chain: SwitchChain) -> SpaceSystem:  # type: ignore[override]
        """Return the form on the nodes of a chain."""
        return SpaceSystem(chain, self)

    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> SpacePath:
        """Return the form along a known path of the switch, the same wherever it starts."""
        return SpacePath(self, shares, r)

    def along_many(self, shares: FloatArray, r: FloatArray) -> SpacePaths:
        """Return the form along known paths of the switch, side by side."""
        return SpacePaths(self, shares)

    def simulate(
        self, shares: FloatArray, r: FloatArray, rng: np.random.Generator, us: FloatArray | None = None
    ) -> Simulation:
        """Draw states and observations along a path of the switch; controls (n, k) lead to each of them."""
        n, m, q = len(r), self.dim_x, self.dim_z
        noise = rng.standard_normal((n, m + q))
        x, y = np.empty((n, m)), np.empty((n, q))
        if not n:
            return Simulation(x, y, r)
        values, which = np.unique(shares, axis=0, return_inverse=True)
        which = which.reshape(-1)
        F, b, Q, H, d, R = (self.at(name, values) for name in ("F", "b", "Q", "H", "d", "R"))
        moved = b[which] + (semidefinite_root(Q)[which] @ noise[:, :m, None])[..., 0]
        if us is not None:
            moved += (self.at("B", values)[which] @ us[..., None])[..., 0]
        mean, covariance = self.state_at(shares[0])
        x[0] = mean + semidefinite_root(covariance) @ noise[0, :m]
        with np.errstate(over="ignore", invalid="ignore"):  # what comes of it is looked at
            for k in range(1, n):
                x[k] = F[which[k]] @ x[k - 1] + moved[k]
            seen = H[which] @ x[..., None] + semidefinite_root(R)[which] @ noise[:, m:, None]
        y[:] = seen[..., 0] + d[which]
        lost = ~np.isfinite(np.concatenate([x, y], axis=1)).all(axis=1)
        if lost.any():
            raise NumericalRangeError(
                f"simulate: observation {int(lost.argmax())} of {n} is beyond the range of numbers; expected "
                "a model that grows less, or fewer observations"
            )
        return Simulation(x, y, r)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters that were given as plain lists, without the switch."""
        optional: dict[str, Any] = dict.fromkeys(("x0", "P0", "B"))
        values = {name: one.to_list() for name, one in self.parameters.items()}
        return optional | values | {"mix": self.mix}
