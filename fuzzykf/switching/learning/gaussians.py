"""The two Gaussian parts that can be learned, as the expectation-maximisation sees them.

An estimate answers three questions: the densities of transitions (as whitened rows),
the maximisation given weighted second moments, and the form in the units of the data.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from fuzzykf.switching.dynamics.forms import GaussianForm, RegressionForm
from fuzzykf.switching.learning.regression import Cells, Regression, fit_regression, join, prior_cells

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.learning.data import Scale, TrainingData

__all__ = [
    "GaussianEstimate",
    "MemorylessEstimate",
    "RegressionEstimate",
    "pair_cells",
    "positions",
    "transition_vectors",
]


def transition_vectors(data: TrainingData) -> FloatArray:
    """Rows v = (1, y, y', x, x') of all transitions."""
    m = data.dim_x
    now, then = data.z[data.before], data.z[data.after]
    one = np.ones((len(now), 1))
    return np.concatenate([one, now[:, m:], then[:, m:], now[:, :m], then[:, :m]], axis=1)


def positions(m: int, q: int) -> dict[str, list[int]]:
    """Positions of the parts of v."""
    return {
        "one": [0],
        "y": list(range(1, 1 + q)),
        "y'": list(range(1 + q, 1 + 2 * q)),
        "x": list(range(1 + 2 * q, 1 + 2 * q + m)),
        "x'": list(range(1 + 2 * q + m, 1 + 2 * q + 2 * m)),
    }


def pair_cells(before: FloatArray, after: FloatArray, v: FloatArray) -> Cells:
    """One cell per transition, from the shares (n, K) of the switch before and after it."""
    shares = (before[:, :, None] * after[:, None, :]).reshape(len(v), -1)
    return Cells(shares, np.ones(len(v)), v[:, :, None] * v[:, None, :])


def single_cells(weights: FloatArray, shares: FloatArray, z: FloatArray) -> Cells:
    """Cells of the law of Z given the switch: weights (n, M) of nodes with shares (M, K)."""
    w = np.concatenate([np.ones((len(z), 1)), z], axis=1)
    total = weights.sum(axis=0)
    moment = (weights.T @ (w[:, :, None] * w[:, None, :]).reshape(len(w), -1)).reshape(
        -1, w.shape[1], w.shape[1]
    )
    return Cells(shares, total, moment / np.where(total > 0.0, total, 1.0)[:, None, None])


class GaussianEstimate(ABC):
    """A Gaussian part on the way, in standard units.

    Attributes
    ----------
    prior : Cells
        What each pair of regimes is taken to have seen before the data.
    """

    dim_x: int
    dim_z: int
    n_classes: int
    prior: Cells

    @classmethod
    @abstractmethod
    def start(cls, cells: Cells, single: Cells, m: int, q: int, proof: FloatArray) -> Self:
        """Estimate from cells of pairs of regimes and of single regimes.

        ``proof`` (p, K * K) holds the shares of pairs at which the model has to be valid.
        """

    @abstractmethod
    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened rows of pairs: log p(z' | z, pair) = k - |W v|^2 / 2.

        Parameters
        ----------
        shares : ndarray, shape (p, K * K)
            Shares of the pairs of regimes in p pairs.

        Returns
        -------
        W : ndarray, shape (p, q + m, f)
        k : ndarray, shape (p,)
        """

    def log_likelihood(self, cells: Cells) -> float:
        """Sum of log p(z' | z, pair) over cells."""
        W, constant = self.rows(cells.shares)
        quadratic = np.einsum("pij,pjk,pik->p", W, cells.moment, W, optimize=True)
        return float(cells.weight @ (constant - 0.5 * quadratic))

    @property
    def log_prior(self) -> float:
        """Log-density of the prior, but for a constant."""
        return self.log_likelihood(self.prior)

    @abstractmethod
    def maximise(self, cells: Cells) -> Self:
        """Return an estimate of larger expected likelihood, prior included, given the moments of pairs."""

    @property
    @abstractmethod
    def vector(self) -> FloatArray:
        """All parameters, as one vector in which straight lines make sense."""

    @abstractmethod
    def at(self, vector: FloatArray) -> Self | None:
        """Return the estimate with these parameters, or None where there is no model."""

    @abstractmethod
    def form(self, single: Cells, scale: Scale) -> GaussianForm:
        """Return the form in the units of the data; ``single`` holds the moments of regimes."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of free parameters."""


class RegressionEstimate(GaussianEstimate):
    """The regression form: y' on (y, 1), then x' on (x, y, y', 1)."""

    #: Whether x' depends on x.
    state_feedback: ClassVar[bool] = True

    def __init__(self, observation: Regression, state: Regression, prior: Cells) -> None:
        self.observation, self.state, self.prior = observation, state, prior
        self.dim_z, self.dim_x = observation.beta.shape[1], state.beta.shape[1]
        self.n_classes = round(len(observation.beta) ** 0.5)

    @classmethod
    def start(cls, cells: Cells, single: Cells, m: int, q: int, proof: FloatArray) -> Self:
        """Estimate from cells, by maximum likelihood; valid everywhere by construction."""
        prior = prior_cells(cells)
        return cls(*cls._both(join(cells, prior), m, q, (None, None), 100), prior)

    def maximise(self, cells: Cells) -> Self:
        """Take a few rounds of the maximisation."""
        before = (self.observation, self.state)
        both = self._both(join(cells, self.prior), self.dim_x, self.dim_z, before, 3)
        return type(self)(*both, self.prior)

    @property
    def vector(self) -> FloatArray:
        """Coefficients, factors and log-variances of both regressions."""
        return np.concatenate([part.ravel() for part in (*self.observation, *self.state)])

    def at(self, vector: FloatArray) -> Self:
        """Return the estimate with these parameters; any are valid."""
        parts = (*self.observation, *self.state)
        pieces = np.split(vector, np.cumsum([part.size for part in parts])[:-1])
        new = [piece.reshape(part.shape) for piece, part in zip(pieces, parts, strict=True)]
        return type(self)(Regression(*new[:3]), Regression(*new[3:]), self.prior)

    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whiten the residuals of both regressions."""
        m, q = self.dim_x, self.dim_z
        f = 1 + 2 * q + 2 * m
        blocks = []
        constant = np.full(len(shares), -0.5 * (m + q) * np.log(2.0 * np.pi))
        at = positions(m, q)
        for fit, target, regressors in (
            (self.observation, at["y'"], at["y"] + at["one"]),
            (self.state, at["x'"], self._regressors(m, q)),
        ):
            B, t, p = fit.beta.shape
            beta = (shares @ fit.beta.reshape(B, -1)).reshape(-1, t, p)
            T, g = (shares @ fit.T.reshape(B, -1)).reshape(-1, t, t), shares @ fit.g
            residual = np.zeros((len(shares), t, f))
            residual[:, range(t), target] = 1.0
            residual[:, :, regressors] -= beta
            blocks.append((T @ residual) * np.exp(-0.5 * g)[..., None])
            constant -= 0.5 * g.sum(axis=1)
        return np.concatenate(blocks, axis=1), constant

    def form(self, single: Cells, scale: Scale) -> RegressionForm:
        """Return the form in the units of the data."""
        m, q, K = self.dim_x, self.dim_z, self.n_classes
        first = fit_regression(join(single, prior_cells(single)), list(range(1, 1 + m + q)), [0])
        mx, my, sx, sy = scale.mean[:m], scale.mean[m:], scale.std[:m], scale.std[m:]

        def table(a: FloatArray) -> FloatArray:
            return a.reshape(K, K, *a.shape[1:])

        observation, state = self.observation, self.state
        Ayy = table(observation.beta[..., :q]) * sy[:, None] / sy
        Ny = table(observation.beta[..., q]) * sy + my - Ayy @ my
        p = m if self.state_feedback else 0
        Axx = np.zeros((K, K, m, m))
        Axx[..., :p] = table(state.beta[..., :p])
        Axx *= sx[:, None] / sx
        H = table(state.beta[..., p : p + q]) * sx[:, None] / sy
        G = table(state.beta[..., p + q : p + 2 * q]) * sx[:, None] / sy
        c = table(state.beta[..., p + 2 * q]) * sx + mx - Axx @ mx - (H + G) @ my
        return RegressionForm(
            Ayy=Ayy,
            Ny=Ny,
            Qyy=table(observation.covariance) * sy[:, None] * sy,
            Axx=Axx,
            H=H,
            G=G,
            c=c,
            C=table(state.covariance) * sx[:, None] * sx,
            means=first.beta[..., 0] * scale.std + scale.mean,
            covariances=first.covariance * scale.std[:, None] * scale.std,
        )

    @property
    def n_parameters(self) -> int:
        """Number of free parameters."""
        m, q, K = self.dim_x, self.dim_z, self.n_classes
        d = m + q
        state = m * len(self._regressors(m, q)) + m * (m + 1) // 2
        pair = q * (q + 1) + q * (q + 1) // 2 + state
        return K * K * pair + K * (d + d * (d + 1) // 2)

    @classmethod
    def _regressors(cls, m: int, q: int) -> list[int]:
        """Positions in v of what x' depends on."""
        at = positions(m, q)
        return (at["x"] if cls.state_feedback else []) + at["y"] + at["y'"] + at["one"]

    @classmethod
    def _both(
        cls,
        cells: Cells,
        m: int,
        q: int,
        start: tuple[Regression | None, Regression | None],
        n_rounds: int,
    ) -> tuple[Regression, Regression]:
        """Regressions of the observation and of the state."""
        at = positions(m, q)
        return (
            fit_regression(cells, at["y'"], at["y"] + at["one"], start[0], n_rounds=n_rounds),
            fit_regression(cells, at["x'"], cls._regressors(m, q), start[1], n_rounds=n_rounds),
        )


class MemorylessEstimate(RegressionEstimate):
    """The regression form with Axx = 0: x' on (y, y', 1).

    Given the switch the state then depends on observations alone, and the law of it that a filter finds, a
    mixture over the latest two nodes, is exact.
    """

    state_feedback = False
