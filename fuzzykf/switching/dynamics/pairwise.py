"""Pairwise dynamics with the parameters of the regime of arrival; the state may act on what is seen next."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ShapeError
from fuzzykf.gaussian import as_array, check_covariance, covariance_root
from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.base import Dynamics
from fuzzykf.switching.dynamics.exactness import judged
from fuzzykf.switching.dynamics.form_checks import checked_classes, dimensions, prove_observable
from fuzzykf.switching.dynamics.joint import JointPath, JointSystem
from fuzzykf.switching.dynamics.pairs import regress
from fuzzykf.switching.dynamics.placed import GaussianPath, StationarySystem

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.exactness import Exactness
    from fuzzykf.switching.dynamics.pairs import Describe, PairCoefficients, SwitchingSystem
    from fuzzykf.switching.dynamics.placed import KnownPath
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["PairwiseForm"]


class PairwiseForm(Dynamics):
    """Z' = A_k Z + offset_k + N(0, noise_k) with k the regime of arrival, Z = (X, Y).

    Parameters
    ----------
    A : array_like, shape (K, d, d)
        In blocks [[Axx, Axy], [Ayx, Ayy]].
    noise : array_like, shape (K, d, d)
    offset : array_like, shape (K, d), optional
        By default zero.
    means, covariances : array_like, shapes (K, d) and (K, d, d)
        Of the first Z.
    dim_x : int
    """

    kind = "pairwise"

    def __init__(
        self,
        A: ArrayLike,
        *,
        noise: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        offset: ArrayLike | None = None,
    ) -> None:
        self.A = as_array("A", A, (None, None, None))
        K, d = self.A.shape[:2]
        if self.A.shape[2] != d:
            raise ShapeError(f"A: got shape {self.A.shape}, expected (K, d, d), square for each of K regimes")
        self.n_classes = checked_classes(K)
        self.means = as_array("means", means, (K, d))
        self.dim_x, self.dim_z = dimensions(dim_x, d)
        self.offset = as_array("offset", np.zeros((K, d)) if offset is None else offset, (K, d))
        self.noise = check_covariance("noise", noise, (K, d, d))
        self.covariances = check_covariance("covariances", covariances, (K, d, d))
        prove_observable("covariances", self.covariances, self.dim_x)
        #: Whether the state acts on the next observation.
        self.has_feedback = bool(self.A[:, self.dim_x :, : self.dim_x].any())
        self.exact_method = "joint_gpb2" if self.has_feedback else "exact"
        # of one node, which is the Kalman filter
        self.known_method = "joint_imm" if self.has_feedback else "exact"

    def exactness(self, chain: SwitchChain) -> Exactness:
        """Say whether filtering is exact on a chain of the regimes."""
        return judged(self.A, self._noise_on(chain), self.dim_x, chain)

    def _noise_on(self, chain: SwitchChain) -> FloatArray:
        """Return the noise, and something harmless of regimes that are never arrived at."""
        return self.jointly(chain).tables.Q

    def jointly(self, chain: SwitchChain) -> JointSystem:
        """Return the dynamics on a chain of the regimes with all of Z for a state: any have that."""
        return JointSystem(chain, *self._moves, *self._first, self.dim_x)

    @property
    def _moves(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.A, self.offset, self.noise

    @property
    def _first(self) -> tuple[FloatArray, FloatArray]:
        return self.means, self.covariances

    def placed(self, chain: SwitchChain) -> SwitchingSystem:
        """Return the dynamics on a chain of the regimes, as `exact_method` takes them."""
        system: Any = self.jointly(chain)  # which proves the noise
        return system if self.has_feedback else StationarySystem(chain, _WithoutFeedback(self))

    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> KnownPath:
        """Return the dynamics along known regimes ``r``, the same wherever they start."""
        if self.has_feedback:
            return JointPath(*self._moves, *self._first, self.dim_x, r)
        return GaussianPath(_WithoutFeedback(self), shares, r)

    def simulate(self, shares: FloatArray, r: FloatArray, rng: np.random.Generator) -> Simulation:
        """Draw states and observations along regimes ``r``."""
        n, d = len(r), self.means.shape[1]
        z, shocks = np.empty((n, d)), rng.standard_normal((n, d))
        if n:
            k = r.astype(np.intp)
            root, first = covariance_root(self.noise), covariance_root(self.covariances[k[0]])
            moved = self.offset[k] + (root[k] @ shocks[..., None])[..., 0]
            z[0] = self.means[k[0]] + first @ shocks[0]
            for now in range(1, n):
                z[now] = self.A[k[now]] @ z[now - 1] + moved[now]
        return Simulation(z[:, : self.dim_x].copy(), z[:, self.dim_x :].copy(), r)

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the regime of r_1, one-hot in ``u``."""
        regime = u.argmax(axis=-1)
        return self.means[regime], self.covariances[regime]

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists."""
        names = ("A", "noise", "offset", "means", "covariances")
        return {name: getattr(self, name).tolist() for name in names} | {"dim_x": self.dim_x}


class _WithoutFeedback:
    """The regressions of a step where the state does not act on the next observation.

    Parameters
    ----------
    form : PairwiseForm
    """

    def __init__(self, form: PairwiseForm) -> None:
        self._form, self.dim_x, self.dim_z = form, form.dim_x, form.dim_z

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._form.marginal(u)

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Return the regressions, which are those of the regime of arrival, one-hot in ``u2``."""
        lead = np.broadcast_shapes(u1.shape, u2.shape)[:-1]
        k = np.broadcast_to(u2.argmax(axis=-1), lead)
        A, offset, noise = (one[k] for one in self._form._moves)
        return regress(A, offset, noise, self.dim_x, describe, where)
