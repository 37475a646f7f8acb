"""Regressions whose coefficients and log-variances are linear in known shares.

The maximisation step of all learning in the regression form.  Data enter as cells:
a cell has shares b (of regimes, or of pairs of regimes), a count and a mean second
moment S of the vector v that holds regressors and targets.  A transition whose
switch is known is a cell of its own; a pair of nodes with its posterior weight is
one too.

    t = beta(b) p + e,   T(b) e ~ N(0, diag exp g(b)),

with beta, g and the unit lower triangular T linear in b, as in
`fuzzykf.switching.interpolation.LogCovariance`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.switching.interpolation import compose

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray

__all__ = ["Cells", "Regression", "fit_regression", "regression_log_likelihood"]

#: Weight, in observations of unit variance, of the prior that pulls the regimes together.
#: It decides only where data say nothing: a pair of regimes that never occurs.
PRIOR_COUNT = 1e-4

_LOG_2PI = float(np.log(2.0 * np.pi))


class Cells(NamedTuple):
    """Weighted second moments of v = (regressors and targets) per cell."""

    shares: FloatArray  # (c, B), rows sum to one
    weight: FloatArray  # (c,): number of observations
    moment: FloatArray  # (c, f, f): mean of v v'


class Regression(NamedTuple):
    """Coefficients and covariance factors of each of B regimes (or pairs of regimes)."""

    beta: FloatArray  # (B, t, p)
    T: FloatArray  # (B, t, t), unit lower triangular
    g: FloatArray  # (B, t)

    @property
    def covariance(self) -> FloatArray:
        """Residual covariances, (B, t, t)."""
        return compose(self.T, self.g)


def fit_regression(
    cells: Cells,
    targets: list[int],
    regressors: list[int],
    start: Regression | None = None,
    *,
    n_rounds: int = 100,
    tolerance: float = 1e-9,
) -> Regression:
    """Maximise the likelihood of the targets given the regressors.

    Blocks of parameters are maximised in turn: coefficients by generalised least
    squares, covariance factors by regressions of residuals on earlier residuals,
    log-variances by Newton steps.  Each round raises the (penalised) likelihood.

    Parameters
    ----------
    cells : Cells
    targets, regressors : list of int
        Positions in v.
    start : Regression, optional
        Where to begin; by default the regression that all regimes share.
    n_rounds : int
        Largest number of rounds.
    tolerance : float
        Relative gain at which to stop.

    Returns
    -------
    Regression
    """
    S_pp = cells.moment[:, regressors][:, :, regressors]
    S_tp = cells.moment[:, targets][:, :, regressors]
    S_tt = cells.moment[:, targets][:, :, targets]
    pooled, scatter = _pooled(cells.weight, S_pp, S_tp, S_tt)
    B = cells.shares.shape[1]
    current = start if start is not None else Regression(*(np.repeat(a[None], B, axis=0) for a in pooled))
    value = -np.inf
    for _ in range(n_rounds):
        beta = _coefficients(cells, S_pp, S_tp, current, pooled, scatter)
        residual = _residual_moments(cells.shares, beta, S_pp, S_tp, S_tt)
        T, g = _factors(cells, residual, current, pooled)
        current = Regression(beta, T, g)
        gained = _objective(cells, residual, current, pooled, scatter)
        if gained - value <= tolerance * max(1.0, abs(gained)):
            break
        value = gained
    return current


def regression_log_likelihood(
    cells: Cells, targets: list[int], regressors: list[int], fit: Regression
) -> float:
    """Log-likelihood of the targets given the regressors."""
    S_pp = cells.moment[:, regressors][:, :, regressors]
    S_tp = cells.moment[:, targets][:, :, regressors]
    S_tt = cells.moment[:, targets][:, :, targets]
    return _likelihood(cells, _residual_moments(cells.shares, fit.beta, S_pp, S_tp, S_tt), fit)


def _pooled(
    count: FloatArray, S_pp: FloatArray, S_tp: FloatArray, S_tt: FloatArray
) -> tuple[Regression, FloatArray]:
    """One regression for all, towards which the prior pulls; and the scatter of the regressors."""
    share = count / count.sum()
    pp, tp, tt = (np.tensordot(share, S, axes=1) for S in (S_pp, S_tp, S_tt))
    scale = np.trace(pp) / len(pp)
    scatter = pp + 1e-9 * scale * np.eye(len(pp))  # constant regressors may be collinear
    beta = np.linalg.solve(scatter, tp.T).T
    residual = tt - beta @ tp.T - tp @ beta.T + beta @ pp @ beta.T
    variance = np.maximum(np.diagonal(residual), 1e-12 * np.diagonal(tt) + 1e-300)
    return Regression(beta, np.eye(len(tt)), np.log(variance)), scatter


def _precision(shares: FloatArray, fit: Regression) -> FloatArray:
    """Inverse residual covariance of each cell, (c, t, t)."""
    B, t = fit.g.shape
    T = (shares @ fit.T.reshape(B, -1)).reshape(-1, t, t)
    precision: FloatArray = np.swapaxes(T, -1, -2) @ (T * np.exp(-(shares @ fit.g))[..., None])
    return precision


def _coefficients(
    cells: Cells,
    S_pp: FloatArray,
    S_tp: FloatArray,
    current: Regression,
    pooled: Regression,
    scatter: FloatArray,
) -> FloatArray:
    """Generalised least squares for beta (B, t, p)."""
    shares, count = cells.shares, cells.weight
    c, B = shares.shape
    t, p = S_tp.shape[1:]
    W = _precision(shares, current) * count[:, None, None]
    # sum over cells of (b b') x W x S_pp, as one product of flattened outer products
    left = (shares[:, :, None] * shares[:, None, :]).reshape(c, B * B)
    right = (W[:, :, :, None, None] * S_pp[:, None, None]).reshape(c, -1)
    system = (left.T @ right).reshape(B, B, t, t, p, p).transpose(0, 2, 4, 1, 3, 5)
    target = np.einsum("cb,cst,ctp->bsp", shares, W, S_tp)
    prior = PRIOR_COUNT * np.exp(-pooled.g)
    system = system.reshape(B * t * p, B * t * p) + np.kron(np.eye(B), np.kron(np.diag(prior), scatter))
    target = target + prior[:, None] * (pooled.beta @ scatter)
    solution: FloatArray = np.linalg.solve(system, target.reshape(-1)).reshape(B, t, p)
    return solution


def _residual_moments(
    shares: FloatArray, beta: FloatArray, S_pp: FloatArray, S_tp: FloatArray, S_tt: FloatArray
) -> FloatArray:
    """Mean second moments of t - beta(b) p per cell, (c, t, t)."""
    B, t, p = beta.shape
    coefficient = (shares @ beta.reshape(B, -1)).reshape(-1, t, p)
    cross = coefficient @ np.swapaxes(S_tp, -1, -2)
    moment: FloatArray = (
        S_tt - cross - np.swapaxes(cross, -1, -2) + coefficient @ S_pp @ np.swapaxes(coefficient, -1, -2)
    )
    return moment


def _factors(
    cells: Cells, residual: FloatArray, current: Regression, pooled: Regression
) -> tuple[FloatArray, FloatArray]:
    """Covariance factors from residual moments, one component after the other."""
    shares, count = cells.shares, cells.weight
    B, t = current.g.shape
    T, g = current.T.copy(), current.g.copy()
    for k in range(t):
        if k:
            weight = count * np.exp(-(shares @ g[:, k]))
            outer = np.einsum("c,cb,cd,cij->bidj", weight, shares, shares, residual[:, :k, :k], optimize=True)
            right = np.einsum("c,cb,ci->bi", weight, shares, residual[:, k, :k], optimize=True)
            system = outer.reshape(B * k, B * k) + PRIOR_COUNT * np.eye(B * k)
            T[:, k, :k] = -np.linalg.solve(system, right.reshape(-1)).reshape(B, k)
        row = shares @ T[:, k, : k + 1]
        square = np.einsum("ci,cij,cj->c", row, residual[:, : k + 1, : k + 1], row)
        g[:, k] = _log_variances(shares, count, np.maximum(square, 0.0), g[:, k], pooled.g[k])
    return T, g


def _log_variances(
    shares: FloatArray, count: FloatArray, square: FloatArray, g: FloatArray, centre: float
) -> FloatArray:
    """Newton's method for the convex function sum n (b.g + s exp(-b.g)) / 2 + prior."""

    def value(h: FloatArray) -> float:
        level = shares @ h
        data = 0.5 * float(count @ (level + square * np.exp(-level)))
        return data + 0.5 * PRIOR_COUNT * float((h - centre) @ (h - centre))

    with np.errstate(over="ignore"):  # a step too far is taken back
        now = value(g)
        for _ in range(50):
            scaled = square * np.exp(-(shares @ g))
            gradient = 0.5 * shares.T @ (count * (1.0 - scaled)) + PRIOR_COUNT * (g - centre)
            curvature = 0.5 * (shares.T * (count * scaled)) @ shares + PRIOR_COUNT * np.eye(len(g))
            move = np.linalg.solve(curvature, gradient)
            size = min(1.0, 5.0 / max(float(np.abs(move).max()), 1e-300))
            while True:
                trial = g - size * move
                then = value(trial)
                if then <= now or size < 1e-12:
                    break
                size *= 0.5
            if not then < now - 1e-12 * max(1.0, abs(now)):
                break
            g, now = trial, then
    return g


def _likelihood(cells: Cells, residual: FloatArray, fit: Regression) -> float:
    W = _precision(cells.shares, fit)
    t = fit.g.shape[1]
    quadratic = np.einsum("cij,cij->c", W, residual)
    log_det = (cells.shares @ fit.g).sum(axis=1)
    return -0.5 * float(cells.weight @ (quadratic + log_det + t * _LOG_2PI))


def _objective(
    cells: Cells, residual: FloatArray, fit: Regression, pooled: Regression, scatter: FloatArray
) -> float:
    off = fit.beta - pooled.beta
    penalty = np.einsum("btp,pr,btr,t->", off, scatter, off, np.exp(-pooled.g))
    penalty += ((fit.g - pooled.g) ** 2).sum() + (np.tril(fit.T, -1) ** 2).sum()
    return _likelihood(cells, residual, fit) - 0.5 * PRIOR_COUNT * float(penalty)
