"""Regressions whose coefficients and log-variances are linear in known shares.

The maximisation step of all learning in the regression form.  Data enter as cells:
a cell has shares b (of regimes, or of pairs of regimes), a count and a mean second
moment S of the vector v that holds regressors and targets.  A transition whose
switch is known is a cell of its own; a pair of nodes with its posterior weight is
one too.

    t = beta(b) p + e,   T(b) e ~ N(0, diag exp g(b)),

with beta, g and the unit lower triangular T linear in b, as in
`fuzzykf.switching.dynamics.interpolation.LogCovariance`.

The likelihood alone is unbounded: a pair of regimes that occurs less often than it has
coefficients can be fitted without error.  So a weak prior joins the data, as cells of
its own: each regime has seen a small fraction of one average observation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.gaussian import symmetrize
from fuzzykf.switching.dynamics.interpolation import compose, decompose

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray

__all__ = ["Cells", "Evidence", "Regression", "fit_regression", "join", "merged", "prior_cells", "ridge"]

#: Weight of the prior of each regime, or pair of regimes, in average observations.  It decides
#: only where the data say next to nothing.
PRIOR_COUNT = 1e-4

#: Weights of the ridge on coefficients of inputs and features, in observations of unit noise: on their mean
#: over the regimes, and on what sets them apart from it.
RIDGE_MEAN, RIDGE_APART = 1.0, 100.0

_LOG_2PI = float(np.log(2.0 * np.pi))


class Cells(NamedTuple):
    """Weighted second moments of v = (regressors and targets) per cell."""

    shares: FloatArray  # (c, B), rows sum to one
    weight: FloatArray  # (c,): number of observations
    moment: FloatArray  # (c, f, f): mean of v v'


class Evidence(NamedTuple):
    """What data say of observation and state, each of which has a regression of its own.

    Where a state is not known, it stands in ``v`` as zero: nothing but the entries of 1 and of observations
    counts in the cells of the observation.
    """

    observation: Cells
    state: Cells  # the same object if the state is known everywhere

    @classmethod
    def of(cls, cells: Cells, has_state: BoolArray) -> Evidence:
        """Take cells, some of which say something of the state as well."""
        return cls(cells, cells if has_state.all() else Cells(*(part[has_state] for part in cells)))

    @property
    def is_complete(self) -> bool:
        """Whether both regressions have the same cells."""
        return self.observation is self.state

    def each(self, change: Callable[[Cells], Cells]) -> Evidence:
        """Apply a function to both collections of cells."""
        first = change(self.observation)
        return Evidence(first, first if self.is_complete else change(self.state))

    def joined(self, other: Evidence) -> Evidence:
        """Put the evidence together with other evidence."""
        first = join(self.observation, other.observation)
        same = self.is_complete and other.is_complete
        return Evidence(first, first if same else join(self.state, other.state))


def prior_cells(cells: Cells) -> Cells:
    """Return `PRIOR_COUNT` average observations of each regime (or pair of regimes)."""
    B = cells.shares.shape[1]
    average = np.tensordot(cells.weight / cells.weight.sum(), cells.moment, axes=1)
    return Cells(np.eye(B), np.full(B, PRIOR_COUNT), np.repeat(average[None], B, axis=0))


def join(first: Cells, second: Cells) -> Cells:
    """Put two collections of cells together."""
    return Cells(*(np.concatenate(both) for both in zip(first, second, strict=True)))


def merged(cells: Cells) -> Cells:
    """Take cells of equal shares together, which changes no likelihood."""
    shares, which = np.unique(cells.shares, axis=0, return_inverse=True)
    if len(shares) == len(cells.shares):
        return cells
    which = which.reshape(-1)
    weight = np.bincount(which, cells.weight, minlength=len(shares)).astype(np.float64)
    f = cells.moment.shape[-1]
    total = np.zeros((len(shares), f * f))
    np.add.at(total, which, (cells.weight[:, None, None] * cells.moment).reshape(-1, f * f))
    mean = total / np.where(weight > 0.0, weight, 1.0)[:, None]
    return Cells(shares, weight, mean.reshape(-1, f, f))


class Regression(NamedTuple):
    """Coefficients and covariance factors of each of B regimes (or pairs of regimes)."""

    beta: FloatArray  # (B, t, p)
    T: FloatArray  # (B, t, t), unit lower triangular
    g: FloatArray  # (B, t)

    @property
    def covariance(self) -> FloatArray:
        """Residual covariances, (B, t, t)."""
        return compose(self.T, self.g)


def ridge(beta: FloatArray, n_drawn: int) -> float:
    """Log-density of a ridge on the last ``n_drawn`` coefficients of each target, but for a constant."""
    drawn = beta[..., beta.shape[-1] - n_drawn :]
    return -0.5 * float(np.einsum("btp,bc,ctp->", drawn, _ridge_weights(len(beta)), drawn))


def _ridge_weights(B: int) -> FloatArray:
    """Weights (B, B) of products of coefficients of two regimes."""
    common = np.full((B, B), 1.0 / B)
    weights: FloatArray = RIDGE_MEAN * common + RIDGE_APART * (np.eye(B) - common)
    return weights


def fit_regression(
    cells: Cells,
    targets: list[int],
    regressors: list[int],
    start: Regression | None = None,
    *,
    n_drawn: int = 0,
    n_rounds: int = 100,
    tolerance: float = 1e-9,
) -> Regression:
    """Maximise the likelihood of the targets given the regressors.

    Blocks of parameters are maximised in turn: coefficients by generalised least
    squares, covariance factors by regressions of residuals on earlier residuals,
    log-variances by Newton steps.  Each round raises the likelihood.

    Parameters
    ----------
    cells : Cells
        With those of the prior, so that every regime has been seen.
    targets, regressors : list of int
        Positions in v.
    start : Regression, optional
        Where to begin; by default the regression that all regimes share.
    n_drawn : int
        So many regressors, the last ones, have a `ridge`.
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
    current = _pooled(cells, S_pp, S_tp, S_tt, n_drawn) if start is None else start
    value = -np.inf
    for _ in range(n_rounds):
        beta = _coefficients(cells, S_pp, S_tp, current, n_drawn)
        residual = _residual_moments(cells.shares, beta, S_pp, S_tp, S_tt)
        current = Regression(beta, *_factors(cells, residual, current))
        gained = _likelihood(cells, residual, current) + ridge(beta, n_drawn)
        if gained - value <= tolerance * max(1.0, abs(gained)):
            break
        value = gained
    return current


def _pooled(cells: Cells, S_pp: FloatArray, S_tp: FloatArray, S_tt: FloatArray, n_drawn: int) -> Regression:
    """Return the regression that all regimes share, once for each, with the ridge at unit noise."""
    total = cells.weight.sum()
    share = cells.weight / total
    pp, tp, tt = (np.tensordot(share, S, axes=1) for S in (S_pp, S_tp, S_tt))
    drawn = range(len(pp) - n_drawn, len(pp))
    pp[drawn, drawn] += RIDGE_MEAN * cells.shares.shape[1] / total  # regressors may follow from one another
    beta = _solve(pp, tp.T).T
    residual = tt - beta @ tp.T - tp @ beta.T + beta @ pp @ beta.T
    T, g = decompose(symmetrize(residual))
    B = cells.shares.shape[1]
    return Regression(*(np.repeat(a[None], B, axis=0) for a in (beta, T, g)))


def _solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """Solve a positive definite system whose unknowns may have very different sizes."""
    scale = 1.0 / np.sqrt(np.diagonal(A))
    solution = np.linalg.solve(A * scale[:, None] * scale, (b.T * scale).T)
    unscaled: FloatArray = (solution.T * scale).T
    return unscaled


def _precision(shares: FloatArray, fit: Regression) -> FloatArray:
    """Inverse residual covariance of each cell, (c, t, t)."""
    B, t = fit.g.shape
    T = (shares @ fit.T.reshape(B, -1)).reshape(-1, t, t)
    precision: FloatArray = np.swapaxes(T, -1, -2) @ (T * np.exp(-(shares @ fit.g))[..., None])
    return precision


def _coefficients(
    cells: Cells, S_pp: FloatArray, S_tp: FloatArray, current: Regression, n_drawn: int
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
    for k in range(p - n_drawn, p) if n_drawn else ():
        for target_row in range(t):
            system[:, target_row, k, :, target_row, k] += _ridge_weights(B)
    target = np.einsum("cb,cst,ctp->bsp", shares, W, S_tp, optimize=True)
    return _solve(system.reshape(B * t * p, B * t * p), target.reshape(-1)).reshape(B, t, p)


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


def _factors(cells: Cells, residual: FloatArray, current: Regression) -> tuple[FloatArray, FloatArray]:
    """Covariance factors from residual moments, one component after the other."""
    shares, count = cells.shares, cells.weight
    B, t = current.g.shape
    T, g = current.T.copy(), current.g.copy()
    for k in range(t):
        if k:
            weight = count * np.exp(-(shares @ g[:, k]))
            outer = np.einsum("c,cb,cd,cij->bidj", weight, shares, shares, residual[:, :k, :k], optimize=True)
            right = np.einsum("c,cb,ci->bi", weight, shares, residual[:, k, :k], optimize=True)
            T[:, k, :k] = -_solve(outer.reshape(B * k, B * k), right.reshape(-1)).reshape(B, k)
        row = shares @ T[:, k, : k + 1]
        square = np.einsum("ci,cij,cj->c", row, residual[:, : k + 1, : k + 1], row)
        g[:, k] = _log_variances(shares, count, np.maximum(square, 0.0), g[:, k])
    return T, g


def _log_variances(shares: FloatArray, count: FloatArray, square: FloatArray, g: FloatArray) -> FloatArray:
    """Newton's method for the convex function sum n (b.g + s exp(-b.g)) / 2."""

    def value(h: FloatArray) -> float:
        level = shares @ h
        return 0.5 * float(count @ (level + square * np.exp(-level)))

    with np.errstate(over="ignore"):  # a step too far is taken back
        now = value(g)
        for _ in range(50):
            scaled = square * np.exp(-(shares @ g))
            gradient = 0.5 * shares.T @ (count * (1.0 - scaled))
            curvature = 0.5 * (shares.T * (count * scaled)) @ shares
            move = _solve(curvature, gradient)
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
