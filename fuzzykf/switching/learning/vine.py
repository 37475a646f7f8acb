"""The covariance form of a scalar state and observation, as the learning sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from fuzzykf.switching.dynamics.forms import CovarianceForm
from fuzzykf.switching.learning.gaussians import GaussianEstimate
from fuzzykf.switching.learning.regression import Cells, Evidence, join, prior_cells

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.learning.data import Scale

__all__ = ["VineEstimate", "vine_moments"]

#: Where a search may go: log standard deviations in standard units, and Fisher transforms of correlations.
_LOG_STD, _FISHER = 12.0, 9.0

#: Steps of the quasi-Newton method in each maximisation of a search.
_EACH = 8

#: Options of the one maximisation that has to arrive by itself, along flat ridges too: there L-BFGS
#: of ten corrections still creeps after hundreds of steps, .1 below the maximum and wherever units
#: and the names of the regimes have sent it.
_FIRST = {"maxiter": 2000, "maxfun": 10_000, "maxcor": 30, "ftol": 1e-14, "gtol": 1e-9}

#: Positions in v = (1, y, y', x, x') of (X1, Y1, X2, Y2).
_ORDER = [3, 1, 4, 2]


class VineEstimate(GaussianEstimate):
    """The covariance form of scalar X and Y, by a D-vine X1 - Y1 - Y2 - X2 per pair of regimes.

    Free numbers: means and log standard deviations of X and Y and the Fisher
    transform of their correlation per regime; the Fisher transforms of rho(Y1, Y2),
    rho(X2, Y1 | Y2) and rho(X1, X2 | Y1, Y2) per pair.  rho(X1, Y2 | Y1) is zero, which
    is the constraint of the model, and every covariance is positive definite.

    Between regimes covariances are interpolated, and the noise need not stay positive
    definite.  Estimates at which it does not, at one of the pairs ``proof``, are not taken;
    ``bounded`` says that this stopped the latest maximisation.

    Correlations of all four are moved together, so this form is learned from complete transitions alone:
    of `Evidence` it reads the cells of the state.
    """

    dim_x = dim_z = 1

    def __init__(
        self, theta: FloatArray, n_classes: int, prior: Evidence, proof: FloatArray, *, bounded: bool = False
    ) -> None:
        self.theta, self.n_classes, self.prior, self.proof = theta, n_classes, prior, proof
        self.bounded = bounded

    @classmethod
    def start(
        cls,
        cells: Evidence,
        single: Evidence,
        m: int,
        q: int,
        proof: FloatArray,
        window: tuple[int, int] = (0, 0),
    ) -> Self:
        """Estimate from moments, then by maximum likelihood; this form has no features of the window."""
        K = single.state.shares.shape[1]
        prior = cells.each(prior_cells)
        seen = single.joined(single.each(prior_cells)).state, cells.joined(prior).state
        alone = cls(_from_moments(*seen), K, prior, proof)
        # one regime for all is valid everywhere, so some mixture with it is
        whole = [c._replace(shares=np.ones((len(c.weight), 1))) for c in (single.state, cells.state)]
        counts = (K, K, K, K * K, K * K, K * K)
        shared = [np.tile(part, n) for part, n in zip(_parts(_from_moments(*whole), 1), counts, strict=True)]
        return alone._towards(np.concatenate(shared)).maximise(cells, _FIRST)

    def _with(self, theta: FloatArray, *, bounded: bool = False) -> Self:
        return type(self)(theta, self.n_classes, self.prior, self.proof, bounded=bounded)

    def _towards(self, theta: FloatArray) -> Self:
        """Move towards a valid estimate until this one is valid, by halving the distance."""
        share = 1.0
        while share > 1e-9:
            mixed = self._with(theta + share * (self.theta - theta))
            if mixed.is_valid:
                return mixed
            share *= 0.5
        return self._with(theta)

    @property
    def is_valid(self) -> bool:
        """Whether the noise is positive definite at all pairs that have to be proved."""
        return bool((self.noise_share(self.proof) > 0.0).all())

    def noise_share(self, shares: FloatArray) -> FloatArray:
        """Var(X2 | X1, Y1, Y2) / Var(X2) of pairs; negative where there is no model.

        It tends to zero where a partial correlation tends to one, which bounds the parameters.
        """
        _, S = self._pairs(self.theta, shares)
        three = S[:, [0, 1, 3]][:, :, [0, 1, 3]]
        share: FloatArray = np.linalg.det(S) / (np.linalg.det(three) * S[:, 2, 2])
        return share

    def _pairs(self, theta: FloatArray, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Moments (p, 4) and (p, 4, 4) of (X1, Y1, X2, Y2) for pairs, the constraint imposed."""
        K = self.n_classes
        mean, gamma = vine_moments(theta, K)
        square = shares.reshape(-1, K, K)
        mu = np.concatenate([square.sum(axis=2) @ mean, square.sum(axis=1) @ mean], axis=1)
        S = (shares @ gamma.reshape(K * K, 16)).reshape(-1, 4, 4)
        S[:, 0, 3] = S[:, 3, 0] = S[:, 1, 3] * S[:, 0, 1] / S[:, 1, 1]
        return mu, S

    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whiten y' given y, and x' given (x, y, y')."""
        mu, S = self._pairs(self.theta, shares)
        ayy = S[:, 1, 3] / S[:, 1, 1]
        Qyy = S[:, 3, 3] - ayy * S[:, 1, 3]
        given = [0, 1, 3]
        beta = np.linalg.solve(S[:, given][:, :, given], S[:, given, 2, None])[..., 0]
        left = S[:, 2, 2] - (beta * S[:, given, 2]).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):  # an indefinite pair has density zero
            sd_y, sd_x = np.sqrt(Qyy), np.sqrt(left)
            W = np.zeros((len(shares), 2, 5))  # v = (1, y, y', x, x')
            W[:, 0, 0], W[:, 0, 1], W[:, 0, 2] = ayy * mu[:, 1] - mu[:, 3], -ayy, 1.0
            W[:, 1, 0] = (beta * mu[:, given]).sum(axis=1) - mu[:, 2]
            W[:, 1, 3], W[:, 1, 1], W[:, 1, 2], W[:, 1, 4] = *-beta.T, 1.0
            W /= np.stack([sd_y, sd_x], axis=1)[..., None]
            return W, -np.log(2.0 * np.pi) - np.log(sd_y) - np.log(sd_x)

    def observation_constant(self, shares: FloatArray) -> FloatArray:
        """Return k, (p,), of the observation alone."""
        _, S = self._pairs(self.theta, shares)
        constant: FloatArray = -0.5 * np.log(2.0 * np.pi * (S[:, 3, 3] - S[:, 1, 3] ** 2 / S[:, 1, 1]))
        return constant

    @property
    def vector(self) -> FloatArray:
        """The free numbers."""
        return self.theta

    def at(self, vector: FloatArray) -> Self | None:
        """Return the estimate with these free numbers, or None if the noise is not positive definite."""
        K = self.n_classes
        if (np.abs(vector[2 * K : 4 * K]) > _LOG_STD).any() or (np.abs(vector[4 * K :]) > _FISHER).any():
            return None
        moved = self._with(vector, bounded=self.bounded)
        return moved if moved.is_valid else None

    def maximise(self, cells: Evidence, options: Mapping[str, float] | None = None) -> Self:
        """Take quasi-Newton steps up the expected likelihood.

        Where they lead out of the models, they are taken again with a wall: each pair of the
        proof has seen as little as each pair of regimes, which keeps the noise there positive.
        """
        seen = Cells(*(part[cells.state.weight > 1e-12] for part in cells.state))
        every = join(seen, self.prior.state)
        now = self.loss(self.theta, every)[0]
        free = self._with(self._searched(every, options))
        if free.is_valid:
            return free if self.loss(free.theta, every)[0] < now else self._with(self.theta)
        n = len(self.proof)
        moment = np.repeat(self.prior.state.moment[:1], n, axis=0)
        wall = Cells(self.proof, np.full(n, self.prior.state.weight[0]), moment)
        walled = self._with(self._searched(join(every, wall), options))
        candidates = [free._towards(self.theta), walled._towards(self.theta)]
        best = min(candidates, key=lambda c: self.loss(c.theta, every)[0])
        theta = best.theta if self.loss(best.theta, every)[0] < now else self.theta
        return self._with(theta, bounded=True)

    def _searched(self, cells: Cells, options: Mapping[str, float] | None) -> FloatArray:
        from scipy.optimize import minimize

        K = self.n_classes
        bounds = [(None, None)] * (2 * K) + [(-_LOG_STD, _LOG_STD)] * (2 * K)
        bounds += [(-_FISHER, _FISHER)] * (self.theta.size - 4 * K)
        found = minimize(
            self.loss,
            self.theta,
            (cells,),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": _EACH} if options is None else dict(options),
        )
        theta: FloatArray = found.x
        return theta

    def loss(self, theta: FloatArray, cells: Cells) -> tuple[float, FloatArray]:
        """Minus the mean log-likelihood of cells, and its gradient.

        With E the second moment of (X1, Y1, X2, Y2) about its mean in the model and S its
        covariance, log p(z' | z) = -(log det S + tr S^-1 E)/2 + the same of (X1, Y1) alone.
        """
        K, total = self.n_classes, cells.weight.sum()
        mu, S = self._pairs(theta, cells.shares)
        if not (np.linalg.det(S) > 0.0).all():  # the other minors are positive by construction
            return 1e10, np.zeros(theta.size)
        centre = cells.moment[:, 0, _ORDER]
        off = centre - mu
        E = cells.moment[:, _ORDER][:, :, _ORDER] - centre[:, :, None] * centre[:, None]
        E += off[:, :, None] * off[:, None]
        value = np.full(len(S), -np.log(2.0 * np.pi))
        by_mu, by_S = np.zeros(mu.shape), np.zeros(S.shape)
        for d, sign in ((4, 1.0), (2, -1.0)):
            inverse = np.linalg.inv(S[:, :d, :d])
            scaled = inverse @ E[:, :d, :d]
            trace = np.trace(scaled, axis1=1, axis2=2)
            value -= 0.5 * sign * (np.log(np.linalg.det(S[:, :d, :d])) + trace)
            by_S[:, :d, :d] += 0.5 * sign * (scaled @ inverse - inverse)
            by_mu[:, :d] += sign * (inverse @ off[:, :d, None])[..., 0]
        # Cov(X1, Y2) = Cov(Y1, Y2) Cov(X1, Y1) / Var(Y1) is not free
        bound = (by_S[:, 0, 3] + by_S[:, 3, 0]) / S[:, 1, 1]
        by_S[:, 0, 3] = by_S[:, 3, 0] = 0.0
        by_S[:, 1, 3] += bound * S[:, 0, 1]
        by_S[:, 0, 1] += bound * S[:, 1, 3]
        by_S[:, 1, 1] -= bound * S[:, 0, 3]
        weight = cells.weight / total
        by_gamma = (cells.shares.T * weight) @ by_S.reshape(-1, 16)
        square = cells.shares.reshape(-1, K, K) * weight[:, None, None]
        by_mean = square.sum(axis=2).T @ by_mu[:, :2] + square.sum(axis=1).T @ by_mu[:, 2:]
        # derivatives of the moments by a complex step, exact to rounding
        h = 1e-30
        mean, gamma = vine_moments(theta + 1j * h * np.eye(theta.size), K)
        slope = mean.imag.reshape(theta.size, -1) @ by_mean.reshape(-1)
        slope += gamma.imag.reshape(theta.size, -1) @ by_gamma.reshape(-1)
        return -float(weight @ value), -slope / h

    def form(self, single: Evidence, scale: Scale) -> CovarianceForm:
        """Return the form in the units of the data."""
        mean, gamma = vine_moments(self.theta, self.n_classes)
        both = np.concatenate([scale.std, scale.std])
        return CovarianceForm(
            mean * scale.std + scale.mean, gamma * both[:, None] * both, self.dim_x, "project"
        )

    @property
    def n_parameters(self) -> int:
        """Number of free parameters."""
        return self.theta.size


def _parts(theta: FloatArray, K: int) -> list[FloatArray]:
    """Means, log standard deviations, rho(X, Y) of regimes; three correlations of pairs."""
    return np.split(theta, np.cumsum([2 * K, 2 * K, K, K * K, K * K]), axis=-1)


def vine_moments(theta: FloatArray, K: int) -> tuple[FloatArray, FloatArray]:
    """Means (..., K, 2) and covariances (..., K, K, 4, 4) of (X1, Y1, X2, Y2).

    Parameters
    ----------
    theta : ndarray, shape (..., 5 K + 3 K^2)
        Real, or complex with imaginary parts that carry derivatives.
    K : int
    """
    lead = theta.shape[:-1]
    mean, log_std, rho, *pairs = _parts(theta, K)
    std = np.exp(log_std).reshape(*lead, K, 2)
    rho = np.tanh(rho)
    yy, partial, both = (np.tanh(part).reshape(*lead, K, K) for part in pairs)
    first, second = rho[..., :, None], rho[..., None, :]
    x1y2 = first * yy
    free2 = np.sqrt(1.0 - second**2)  # what Y2 leaves of X2, and Y1 of X1
    free1 = np.sqrt(1.0 - first**2)
    x2y1 = second * yy + partial * free2 * np.sqrt(1.0 - yy**2)
    # what (Y1, Y2) explains of Cov(X1, X2), and the partial correlation of the rest
    xx = first * x2y1 + both * free1 * free2 * np.sqrt(1.0 - partial**2)
    correlation = np.empty((*lead, K, K, 4, 4), dtype=theta.dtype)
    rows = ((1.0, first, xx, x1y2), (first, 1.0, x2y1, yy), (xx, x2y1, 1.0, second), (x1y2, yy, second, 1.0))
    for a, row in enumerate(rows):
        for b, value in enumerate(row):
            correlation[..., a, b] = value
    scale = np.empty((*lead, K, K, 4), dtype=theta.dtype)
    scale[..., :2], scale[..., 2:] = std[..., :, None, :], std[..., None, :, :]
    return mean.reshape(*lead, K, 2), correlation * scale[..., :, None] * scale[..., None, :]


def _from_moments(single: Cells, cells: Cells) -> FloatArray:
    """Read the free numbers off the weighted moments of regimes and pairs."""
    _, covariance, mean = _weighted(single)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    rho = covariance[:, 0, 1] / (std[:, 0] * std[:, 1])
    r, *_ = _weighted(cells)  # of y, y', x, x'
    inverse = np.linalg.inv(r)
    both = -inverse[:, 2, 3] / np.sqrt(inverse[:, 2, 2] * inverse[:, 3, 3])
    yy = r[:, 0, 1]
    partial = (r[:, 3, 0] - r[:, 3, 1] * yy) / np.sqrt((1.0 - r[:, 3, 1] ** 2) * (1.0 - yy**2))
    correlations = np.concatenate([rho, yy, partial, both])
    return np.concatenate(
        [mean.reshape(-1), np.log(std).reshape(-1), np.arctanh(np.clip(correlations, -0.95, 0.95))]
    )


def _weighted(cells: Cells) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correlations, covariances and means of all but the first component of v, per regime."""
    moment = np.einsum("c,cb,cfg->bfg", cells.weight, cells.shares, cells.moment, optimize=True)
    moment = moment / moment[:, :1, :1]
    mean = moment[:, 0, 1:]
    covariance = moment[:, 1:, 1:] - mean[:, :, None] * mean[:, None, :]
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return covariance / (std[:, :, None] * std[:, None]), covariance, mean
