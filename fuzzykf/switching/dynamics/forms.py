"""The Gaussian part of a switching model, at any pair of values of the switch.

A form holds parameters for the K hard regimes and interpolates them.  A value of
the switch is described by its shares in the regimes: shape (..., K), for two
regimes (1 - r, r).  All forms answer the same two questions: the law of Z_1 given
r_1, and the regressions of a step given (r_n, r_{n+1}).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array, as_choice, check_covariance, semidefinite_root, symmetrize
from fuzzykf.switching.dynamics.base import Dynamics
from fuzzykf.switching.dynamics.form_checks import (
    CONSISTENCY_TOLERANCE,
    checked_classes,
    consistent_blocks,
    dimensions,
    prove_observable,
    symmetric,
)
from fuzzykf.switching.dynamics.interpolation import LogCovariance
from fuzzykf.switching.dynamics.pairs import PairCoefficients, regress
from fuzzykf.switching.dynamics.placed import GaussianPath, GaussianPaths, StationarySystem
from fuzzykf.switching.dynamics.simulation import simulate_path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.dynamics.pairs import Describe
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["CovarianceForm", "GaussianForm", "RegressionForm", "TransitionForm"]


def bilinear(values: FloatArray, u1: FloatArray, u2: FloatArray) -> FloatArray:
    """Interpolate values (K, K, ...) given for pairs of regimes at shares u1, u2 (..., K)."""
    K = u1.shape[-1]
    rest = values.shape[2:]
    shares = u1[..., :, None] * u2[..., None, :]
    flat = shares.reshape(*shares.shape[:-2], K * K) @ values.reshape(K * K, -1)
    return flat.reshape(*shares.shape[:-2], *rest)


def linear(values: FloatArray, u: FloatArray) -> FloatArray:
    """Interpolate values (K, ...) given for regimes at shares u (..., K)."""
    return (u @ values.reshape(len(values), -1)).reshape(*u.shape[:-1], *values.shape[1:])


class GaussianForm(Dynamics):
    """Parameters of K hard regimes and their interpolation."""

    @abstractmethod
    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step given the shares u1, u2 (..., K) of r_n and r_{n+1}.

        Raises
        ------
        NotPositiveDefiniteError
            If the noise is indefinite at a pair that can occur (``where``).
        """

    def placed(self, chain: SwitchChain) -> StationarySystem:
        """Return the form on the nodes of a chain."""
        return StationarySystem(chain, self)

    def along(self, shares: FloatArray, r: FloatArray, start: int = 0) -> GaussianPath:
        """Return the form along a known path of the switch, the same wherever it starts."""
        return GaussianPath(self, shares, r)

    def along_many(self, shares: FloatArray, r: FloatArray) -> GaussianPaths:
        """Return the form along known paths of the switch, side by side."""
        return GaussianPaths(self, shares, r)

    def simulate(self, shares: FloatArray, r: FloatArray, rng: np.random.Generator) -> Simulation:
        """Draw states and observations along a path of the switch."""
        return simulate_path(self, r, shares, rng)


class _MeanAndCovariance(GaussianForm):
    """What the two stationary forms share: moments of Z that interpolate linearly."""

    means: FloatArray  # (K, d)
    stationary: FloatArray  # (K, d, d)

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the shares of r_1."""
        return linear(self.means, u), linear(self.stationary, u)

    def _offset(self, A: FloatArray, u1: FloatArray, u2: FloatArray) -> FloatArray:
        """N = M(r_{n+1}) - A M(r_n)."""
        before, after = linear(self.means, u1), linear(self.means, u2)
        offset: FloatArray = after - (A @ before[..., None])[..., 0]
        return offset


class CovarianceForm(_MeanAndCovariance):
    """Covariances of (Z_1, Z_2) for pairs of regimes, interpolated bilinearly (section V-B).

    Parameters
    ----------
    means : array_like, shape (K, d)
    covariances : array_like, shape (K, K, 2d, 2d)
        Rows X1, Y1, X2, Y2.
    dim_x : int
    constraint : {"project", "check"}
        What to do with the entries Cov(Y_2, X_1), which a CGOMSM does not leave free.

    Notes
    -----
    With K = Cov(Z_2, Z_1) = [[a, e], [dd, c]] the model needs
    dd = c Syy(r_1)^-1 Syx(r_1), so that Y_2 and X_1 are independent given Y_1.  Bilinear
    interpolation does not keep this; so dd is set at every pair, after interpolation.
    """

    kind = "covariance"

    def __init__(self, means: ArrayLike, covariances: ArrayLike, dim_x: int, constraint: str) -> None:
        as_choice("constraint", constraint, ("project", "check"))
        self.means = as_array("means", means, (None, None))
        K, d = self.means.shape
        self.n_classes = checked_classes(K)
        self.dim_x, self.dim_z = dimensions(dim_x, d)
        gamma = symmetric("covariances", as_array("covariances", covariances, (K, K, 2 * d, 2 * d)))
        self.stationary = consistent_blocks(gamma, d)
        self.covariances = gamma
        self.constraint = constraint
        if constraint == "check":
            self._check_constraint()

    def _check_constraint(self) -> None:
        m, d = self.dim_x, self.means.shape[1]
        given = self.covariances[:, :, d + m :, :m]
        S = self.stationary[:, None]
        c = self.covariances[:, :, d + m :, m:d]
        needed = c @ np.linalg.solve(S[..., m:, m:], S[..., m:, :m])
        sd = np.sqrt(np.diagonal(self.stationary, axis1=-2, axis2=-1))
        error = np.abs(given - needed)
        relative = error / (sd[None, :, m:, None] * sd[:, None, None, :m])  # whatever the units
        if (relative > CONSISTENCY_TOLERANCE).any():
            i, j, k, el = (int(v) for v in np.unravel_index(np.argmax(relative), error.shape))
            raise ParameterError(
                f"covariances[{i}, {j}]: Cov(Y2[{k}], X1[{el}]) (row {d + m + k}, column {el}) is "
                f"{given[i, j, k, el]:.6g}, but the model needs c Syy^-1 Syx = {needed[i, j, k, el]:.6g}, "
                f"off by {error[i, j, k, el]:.3g}; constraint='project' sets it"
            )

    def transition(self, u1: FloatArray, u2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return A = K Sigma(r_n)^-1 and Q = Sigma(r_{n+1}) - A K' (eqs. 44 and 45, corrected)."""
        m, d = self.dim_x, self.means.shape[1]
        before, after = linear(self.stationary, u1), linear(self.stationary, u2)
        cross = bilinear(self.covariances[:, :, d:, :d], u1, u2)
        before = np.broadcast_to(before, cross.shape)
        after = np.broadcast_to(after, cross.shape)
        Ayy = _right_divide(cross[..., m:, m:], before[..., m:, m:])
        cross[..., m:, :m] = Ayy @ before[..., m:, :m]
        A = np.zeros_like(cross)
        A[..., :m, :] = _right_divide(cross[..., :m, :], before)
        A[..., m:, m:] = Ayy
        return A, symmetrize(after - A @ np.swapaxes(cross, -1, -2))

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step given the shares of r_n and r_{n+1}."""
        A, Q = self.transition(u1, u2)
        scale = np.sqrt(np.diagonal(linear(self.stationary, u2), axis1=-2, axis2=-1))
        scale = np.broadcast_to(scale, Q.shape[:-1])
        return regress(A, self._offset(A, u1, u2), Q, self.dim_x, describe, where, scale)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists."""
        return {
            "means": self.means.tolist(),
            "covariances": self.covariances.tolist(),
            "dim_x": self.dim_x,
            "constraint": self.constraint,
        }


class TransitionForm(_MeanAndCovariance):
    """Transition matrices and symmetric noise roots of pairs of regimes, interpolated bilinearly.

    Parameters
    ----------
    A : array_like, shape (K, K, d, d)
        Its lower left blocks, which carry X_n to Y_{n+1}, are zero.
    Q : array_like, shape (K, K, d, d)
        Noise covariances.
    means : array_like, shape (K, d)
    stationary : array_like, shape (K, d, d)
        Covariance of Z_1 given the regime.
    dim_x : int
    """

    kind = "transition"

    def __init__(
        self, A: ArrayLike, Q: ArrayLike, means: ArrayLike, stationary: ArrayLike, dim_x: int
    ) -> None:
        self.means = as_array("means", means, (None, None))
        K, d = self.means.shape
        self.n_classes = checked_classes(K)
        self.dim_x, self.dim_z = dimensions(dim_x, d)
        self.A = as_array("A", A, (K, K, d, d))
        lower = self.A[..., self.dim_x :, : self.dim_x]
        if (lower != 0.0).any():
            i, j, k, el = (int(v) for v in np.argwhere(lower)[0])
            raise ParameterError(
                f"A[{i}, {j}]: the entry ({self.dim_x + k}, {el}), from X_n to Y_n+1, is "
                f"{lower[i, j, k, el]:.6g}, expected 0"
            )
        self.Q = check_covariance("Q", Q, (K, K, d, d))
        self.root = semidefinite_root(self.Q)
        self.stationary = check_covariance("stationary", stationary, (K, d, d))
        prove_observable("stationary", self.stationary, self.dim_x)

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step given the shares of r_n and r_{n+1}."""
        A = bilinear(self.A, u1, u2)
        B = bilinear(self.root, u1, u2)
        return regress(A, self._offset(A, u1, u2), symmetrize(B @ B), self.dim_x, describe, where)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists."""
        return {
            "A": self.A.tolist(),
            "Q": self.Q.tolist(),
            "means": self.means.tolist(),
            "stationary": self.stationary.tolist(),
            "dim_x": self.dim_x,
        }


class RegressionForm(GaussianForm):
    """Regressions of pairs of regimes, interpolated so that they stay valid everywhere.

    Y' = Ayy Y + Ny + N(0, Qyy) and X' = Axx X + H Y + G Y' + c + N(0, C).  Coefficients
    are bilinear in the shares, covariances are interpolated in their logarithm
    (`fuzzykf.switching.dynamics.interpolation.LogCovariance`).  Nothing is assumed stationary.

    Parameters
    ----------
    Ayy, Ny, Qyy : array_like, shapes (K, K, q, q), (K, K, q), (K, K, q, q)
    Axx, H, G, c, C : array_like, shapes (K, K, m, m), (K, K, m, q), (K, K, m, q), (K, K, m), (K, K, m, m)
    means, covariances : array_like, shapes (K, d) and (K, d, d)
        Law of Z_1 given r_1.
    """

    kind = "regression"

    def __init__(
        self,
        *,
        Ayy: ArrayLike,
        Ny: ArrayLike,
        Qyy: ArrayLike,
        Axx: ArrayLike,
        H: ArrayLike,
        G: ArrayLike,
        c: ArrayLike,
        C: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
    ) -> None:
        state = as_array("Axx", Axx, (None, None, None, None))
        K, m = state.shape[0], state.shape[-1]
        state = as_array("Axx", state, (K, K, m, m))
        gain = as_array("G", G, (K, K, m, None))
        q = gain.shape[-1]
        self.n_classes, self.dim_x, self.dim_z = checked_classes(K), m, q
        self.table = PairCoefficients(
            Axx=state,
            H=as_array("H", H, (K, K, m, q)),
            G=gain,
            c=as_array("c", c, (K, K, m)),
            C=check_covariance("C", C, (K, K, m, m)),
            Ayy=as_array("Ayy", Ayy, (K, K, q, q)),
            Ny=as_array("Ny", Ny, (K, K, q)),
            Qyy=check_covariance("Qyy", Qyy, (K, K, q, q), strict=True),
        )
        self.means = as_array("means", means, (K, m + q))
        self.covariances = check_covariance("covariances", covariances, (K, m + q, m + q))
        prove_observable("covariances", self.covariances, m)
        self._noise_x = LogCovariance("C", self.table.C.reshape(K * K, m, m))
        self._noise_y = LogCovariance("Qyy", self.table.Qyy.reshape(K * K, q, q))
        self._initial = LogCovariance("covariances", self.covariances)

    def marginal(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of Z_1 given the shares of r_1."""
        return linear(self.means, u), self._initial(u)

    def pairs(
        self, u1: FloatArray, u2: FloatArray, describe: Describe, where: np.ndarray | None = None
    ) -> PairCoefficients:
        """Regressions of a step given the shares of r_n and r_{n+1}."""
        shares = u1[..., :, None] * u2[..., None, :]
        shares = shares.reshape(*shares.shape[:-2], self.n_classes**2)
        mixed = {
            name: bilinear(getattr(self.table, name), u1, u2) for name in ("Axx", "H", "G", "c", "Ayy", "Ny")
        }
        reached = np.ones(shares.shape[:-1], dtype=bool) if where is None else where
        noise = {"C": self._noise_x, "Qyy": self._noise_y}
        for name, interpolate in noise.items():  # harmless at pairs that do not occur
            d = interpolate.values.shape[-1]
            mixed[name] = np.broadcast_to(np.eye(d), (*reached.shape, d, d)).copy()
            mixed[name][reached] = interpolate(shares[reached])
        return PairCoefficients(**mixed)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters as plain lists."""
        parameters = {name: value.tolist() for name, value in self.table._asdict().items()}
        return parameters | {"means": self.means.tolist(), "covariances": self.covariances.tolist()}


def _right_divide(B: FloatArray, S: FloatArray) -> FloatArray:
    """B S^-1 for symmetric S."""
    return np.swapaxes(np.linalg.solve(S, np.swapaxes(B, -1, -2)), -1, -2)
