"""The two Gaussian parts that can be learned, as the expectation-maximisation sees them.

An estimate answers three questions: the densities of transitions (as whitened rows),
the maximisation given weighted second moments, and the form in the units of the data.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Self

import numpy as np

from fuzzykf.switching.forms import CovarianceForm, GaussianForm, RegressionForm
from fuzzykf.switching.learning.regression import Cells, Regression, fit_regression

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning.data import Scale, TrainingData

__all__ = ["GaussianEstimate", "RegressionEstimate", "pair_cells", "positions", "transition_vectors"]


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
    """A Gaussian part on the way, in standard units."""

    dim_x: int
    dim_z: int
    n_classes: int

    @classmethod
    @abstractmethod
    def start(cls, cells: Cells, single: Cells, m: int, q: int) -> Self:
        """Estimate from cells of pairs of regimes and of single regimes."""

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

    @abstractmethod
    def maximise(self, cells: Cells) -> Self:
        """Return an estimate of larger expected likelihood, given the moments of pairs."""

    @abstractmethod
    def form(self, single: Cells, scale: Scale) -> GaussianForm:
        """Return the form in the units of the data; ``single`` holds the moments of regimes."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of free parameters."""


class RegressionEstimate(GaussianEstimate):
    """The regression form: y' on (y, 1), then x' on (x, y, y', 1)."""

    def __init__(self, observation: Regression, state: Regression) -> None:
        self.observation, self.state = observation, state
        self.dim_z, self.dim_x = observation.beta.shape[1], state.beta.shape[1]
        self.n_classes = round(len(observation.beta) ** 0.5)

    @classmethod
    def start(cls, cells: Cells, single: Cells, m: int, q: int) -> Self:
        """Estimate from cells, by maximum likelihood."""
        return cls(*_two_regressions(cells, m, q, (None, None), 100))

    def maximise(self, cells: Cells) -> Self:
        """Take a few rounds of the maximisation."""
        return type(self)(*_two_regressions(cells, self.dim_x, self.dim_z, (self.observation, self.state), 3))

    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whiten the residuals of both regressions."""
        m, q = self.dim_x, self.dim_z
        f = 1 + 2 * q + 2 * m
        blocks = []
        constant = np.full(len(shares), -0.5 * (m + q) * np.log(2.0 * np.pi))
        at = positions(m, q)
        for fit, target, regressors in (
            (self.observation, at["y'"], at["y"] + at["one"]),
            (self.state, at["x'"], at["x"] + at["y"] + at["y'"] + at["one"]),
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
        first = fit_regression(single, list(range(1, 1 + m + q)), [0])
        mx, my, sx, sy = scale.mean[:m], scale.mean[m:], scale.std[:m], scale.std[m:]

        def table(a: FloatArray) -> FloatArray:
            return a.reshape(K, K, *a.shape[1:])

        observation, state = self.observation, self.state
        Ayy = table(observation.beta[..., :q]) * sy[:, None] / sy
        Ny = table(observation.beta[..., q]) * sy + my - Ayy @ my
        Axx = table(state.beta[..., :m]) * sx[:, None] / sx
        H = table(state.beta[..., m : m + q]) * sx[:, None] / sy
        G = table(state.beta[..., m + q : m + 2 * q]) * sx[:, None] / sy
        c = table(state.beta[..., m + 2 * q]) * sx + mx - Axx @ mx - (H + G) @ my
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
        pair = q * (q + 1) + q * (q + 1) // 2 + m * (m + 2 * q + 1) + m * (m + 1) // 2
        return K * K * pair + K * (d + d * (d + 1) // 2)


def _two_regressions(
    cells: Cells, m: int, q: int, start: tuple[Regression | None, Regression | None], n_rounds: int
) -> tuple[Regression, Regression]:
    at = positions(m, q)
    return (
        fit_regression(cells, at["y'"], at["y"] + at["one"], start[0], n_rounds=n_rounds),
        fit_regression(
            cells, at["x'"], at["x"] + at["y"] + at["y'"] + at["one"], start[1], n_rounds=n_rounds
        ),
    )


class VineEstimate(GaussianEstimate):
    """The covariance form of scalar X and Y, by a D-vine X1 - Y1 - Y2 - X2 per pair of regimes.

    Free numbers: means and log standard deviations of X and Y and the Fisher
    transform of their correlation per regime; the Fisher transforms of rho(Y1, Y2),
    rho(X2, Y1 | Y2) and rho(X1, X2 | Y1, Y2) per pair.  rho(X1, Y2 | Y1) is zero, which
    is the constraint of the model, and every covariance is positive definite.
    """

    dim_x = dim_z = 1

    def __init__(self, theta: FloatArray, n_classes: int) -> None:
        self.theta, self.n_classes = theta, n_classes

    @classmethod
    def start(cls, cells: Cells, single: Cells, m: int, q: int) -> Self:
        """Estimate from moments, then by maximum likelihood."""
        K = single.shares.shape[1]
        weight = single.weight[:, None] * single.shares
        moment = np.einsum("ck,cab->kab", weight, single.moment) / weight.sum(axis=0)[:, None, None]
        mean = moment[:, 0, 1:]
        covariance = moment[:, 1:, 1:] - mean[:, :, None] * mean[:, None, :]
        std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        rho = covariance[:, 0, 1] / (std[:, 0] * std[:, 1])
        pairs = np.einsum("c,cb,cfg->bfg", cells.weight, cells.shares, cells.moment)
        total = pairs[:, :1, :1]
        pairs = pairs / total
        centre = pairs[:, 0, 1:]
        S = pairs[:, 1:, 1:] - centre[:, :, None] * centre[:, None, :]  # y, y', x, x'
        r = S / np.sqrt(np.diagonal(S, axis1=1, axis2=2))[:, :, None]
        r = r / np.sqrt(np.diagonal(S, axis1=1, axis2=2))[:, None, :]
        inverse = np.linalg.inv(r)
        both = -inverse[:, 2, 3] / np.sqrt(inverse[:, 2, 2] * inverse[:, 3, 3])
        yy = r[:, 0, 1]
        partial = (r[:, 3, 0] - r[:, 3, 1] * yy) / np.sqrt((1 - r[:, 3, 1] ** 2) * (1 - yy**2))
        theta = np.concatenate(
            [
                mean.reshape(-1),
                np.log(std).reshape(-1),
                _fisher(rho),
                _fisher(yy),
                _fisher(partial),
                _fisher(both),
            ]
        )
        return cls(theta, K).maximise(cells, max_iter=200)

    def moments(self, theta: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Means (K, 2) and covariances (K, K, 4, 4) of (X1, Y1, X2, Y2)."""
        K = self.n_classes
        t = self.theta if theta is None else theta
        mean, std = t[: 2 * K].reshape(K, 2), np.exp(t[2 * K : 4 * K]).reshape(K, 2)
        rho = np.tanh(t[4 * K : 5 * K])
        yy, partial, both = np.tanh(t[5 * K :]).reshape(3, K, K)
        first, second = rho[:, None], rho[None, :]
        one = np.ones((K, K))
        x1y2 = first * yy
        x2y1 = second * yy + partial * np.sqrt((1.0 - second**2) * (1.0 - yy**2))
        # Cov(X1, X2) = what (Y1, Y2) explains + the partial correlation
        det = 1.0 - yy**2
        explained = (first * (x2y1 - yy * second) + x1y2 * (second - yy * x2y1)) / det
        left1 = 1.0 - (first * (first - yy * x1y2) + x1y2 * (x1y2 - yy * first)) / det
        left2 = 1.0 - (x2y1 * (x2y1 - yy * second) + second * (second - yy * x2y1)) / det
        xx = explained + both * np.sqrt(np.maximum(left1 * left2, 0.0))
        rows = [
            [one, first * one, xx, x1y2],
            [first * one, one, x2y1, yy],
            [xx, x2y1, one, second * one],
            [x1y2, yy, second * one, one],
        ]
        correlation = np.moveaxis(np.array(rows), (0, 1), (2, 3))
        scale = np.concatenate(
            [np.broadcast_to(std[:, None], (K, K, 2)), np.broadcast_to(std[None], (K, K, 2))], axis=-1
        )
        return mean, correlation * scale[..., :, None] * scale[..., None, :]

    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whiten Z' - A Z - N."""
        return self._rows(self.theta, shares)

    def _rows(self, theta: FloatArray, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        K = self.n_classes
        mean, gamma = self.moments(theta)
        square = shares.reshape(-1, K, K)
        u1, u2 = square.sum(axis=2), square.sum(axis=1)
        G = shares @ gamma.reshape(K * K, -1)
        G = G.reshape(-1, 4, 4)
        sx, sxy, sy = G[:, 0, 0], G[:, 0, 1], G[:, 1, 1]
        a, e, c = G[:, 2, 0], G[:, 2, 1], G[:, 3, 1]
        d = c * sxy / sy  # the projection of the model
        det = sx * sy - sxy * sxy
        axx, axy, ayy = (a * sy - e * sxy) / det, (e * sx - a * sxy) / det, c / sy
        qxx = G[:, 2, 2] - axx * a - axy * e
        qxy = G[:, 2, 3] - ayy * e
        qyy = G[:, 3, 3] - ayy * c
        m1, m2 = u1 @ mean, u2 @ mean
        nx = m2[:, 0] - axx * m1[:, 0] - axy * m1[:, 1]
        ny = m2[:, 1] - ayy * m1[:, 1]
        del d
        left = qxx - qxy * qxy / qyy
        with np.errstate(invalid="ignore", divide="ignore"):  # an indefinite pair has density zero
            sd_y, sd_x = np.sqrt(qyy), np.sqrt(left)
            gain = qxy / qyy
            W = np.zeros((len(shares), 2, 5))  # v = (1, y, y', x, x')
            W[:, 0, 0], W[:, 0, 1], W[:, 0, 2] = -ny / sd_y, -ayy / sd_y, 1.0 / sd_y
            W[:, 1, 0] = -(nx - gain * ny) / sd_x
            W[:, 1, 1] = -(axy - gain * ayy) / sd_x
            W[:, 1, 2], W[:, 1, 3], W[:, 1, 4] = -gain / sd_x, -axx / sd_x, 1.0 / sd_x
            constant = -np.log(2.0 * np.pi) - np.log(sd_y) - np.log(sd_x)
        return W, constant

    def maximise(self, cells: Cells, max_iter: int = 8) -> Self:
        """Take quasi-Newton steps up the expected likelihood."""
        from scipy.optimize import minimize

        used = cells.weight > 1e-12
        shares, weight, moment = cells.shares[used], cells.weight[used], cells.moment[used]
        total = float(weight.sum())

        def loss(theta: FloatArray) -> float:
            W, constant = self._rows(theta, shares)
            quadratic = np.einsum("pij,pjk,pik->p", W, moment, W, optimize=True)
            value = float(weight @ (constant - 0.5 * quadratic)) / total
            return -value if np.isfinite(value) else 1e10

        found = minimize(loss, self.theta, method="L-BFGS-B", options={"maxiter": max_iter})
        better = found.fun < loss(self.theta)
        return type(self)(found.x if better else self.theta, self.n_classes)

    def form(self, single: Cells, scale: Scale) -> CovarianceForm:
        """Return the form in the units of the data."""
        mean, gamma = self.moments()
        both = np.concatenate([scale.std, scale.std])
        return CovarianceForm(
            mean * scale.std + scale.mean, gamma * both[:, None] * both, self.dim_x, "project"
        )

    @property
    def n_parameters(self) -> int:
        """Number of free parameters."""
        return self.theta.size


def _fisher(rho: FloatArray) -> FloatArray:
    return np.arctanh(np.clip(rho, -0.95, 0.95))
