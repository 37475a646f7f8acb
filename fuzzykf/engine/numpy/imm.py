"""Kernels of banks of linear filters that switch: IMM and GPB2.

``K`` is the number of modes; index i is the mode at the previous time, j the one
now.  ``xs`` (..., K, n) and ``Ps`` (..., K, n, n) hold the modes' moments.  All
mode weights are logarithms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.numpy import kalman
from fuzzykf.engine.numpy.outliers import QUIET

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = [
    "correct_bank",
    "filter_bank",
    "filter_bank_many",
    "given_mode",
    "log_mixing",
    "merge_modes",
    "merge_pairs",
    "mix_modes",
    "move_bank",
    "weigh_modes",
    "weigh_pairs",
]


def log_mixing(log_mu: FloatArray, log_M: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint law of the modes before and now, what it says about now, and the mixing weights.

    Parameters
    ----------
    log_mu : ndarray, shape (..., K)
        Logs of the probabilities of the modes before.
    log_M : ndarray, shape (K, K)
        Logs of the transition probabilities, from row i to column j.

    Returns
    -------
    log_joint : ndarray, shape (..., K, K)
        log P(i, j).
    log_cbar : ndarray, shape (..., K)
        log P(j).
    omega : ndarray, shape (..., K, K)
        P(i | j).  A mode that cannot be reached keeps to itself.
    """
    log_joint: FloatArray = log_mu[..., :, None] + log_M
    log_cbar: FloatArray = np.logaddexp.reduce(log_joint, axis=-2)
    if -np.inf not in log_cbar.ravel().tolist():
        return log_joint, log_cbar, np.exp(log_joint - log_cbar[..., None, :])
    lost = np.isneginf(log_cbar)[..., None, :]
    omega = np.exp(log_joint - np.where(lost, 0.0, log_cbar[..., None, :]))
    return log_joint, log_cbar, np.where(lost, np.eye(len(log_M)), omega)


def weigh_modes(log_prior: FloatArray, log_likelihood: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bayes' rule along the last axis: log posterior weights, and the log of their normaliser.

    The weights are NaN where no hypothesis has a positive density.
    """
    # differences of log-likelihoods first: those of an outlier would round the prior away
    possible = np.where(np.isneginf(log_prior), -np.inf, log_likelihood)
    best = possible.max(axis=-1)
    best = np.where(np.isneginf(best), 0.0, best)
    log_joint = log_prior + (log_likelihood - best[..., None])
    total: FloatArray = np.logaddexp.reduce(log_joint, axis=-1)
    return log_joint - total[..., None], total + best


def weigh_pairs(
    log_joint: FloatArray, log_likelihood: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Bayes' rule for pairs of modes (..., K, K), each with its own log-likelihood.

    Returns
    -------
    omega : ndarray, shape (..., K, K)
        P(i | j).  A mode that cannot be reached keeps to itself.
    log_mu, total : ndarray, shapes (..., K) and (...)
        As from `weigh_modes`, of the modes j.
    log_joint_mode : ndarray, shape (..., K)
        Log of the joint density of mode j and the observation.
    """
    best = np.where(np.isneginf(log_joint), -np.inf, log_likelihood).max(axis=-2)
    best = np.where(np.isneginf(best), 0.0, best)
    within = log_joint + (log_likelihood - best[..., None, :])  # each column by its own best pair
    column: FloatArray = np.logaddexp.reduce(within, axis=-2)
    lost = np.isneginf(column)[..., None, :]
    omega = np.exp(within - np.where(lost, 0.0, column[..., None, :]))
    log_mu, total = weigh_modes(column, best)
    return np.where(lost, np.eye(log_joint.shape[-1]), omega), log_mu, total, column + best


@QUIET
def merge_modes(weights: FloatArray, xs: FloatArray, Ps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of mixtures along the last axis of modes, by central moments.

    Parameters
    ----------
    weights : ndarray, shape (..., K)
    xs, Ps : ndarray, shapes (..., K, n) and (..., K, n, n)

    Returns
    -------
    x, P : ndarray, shapes (..., n) and (..., n, n)
    """
    # from the likeliest on: what all have in common then cancels to the last bit, however large
    if weights.ndim == 1:
        top = weights.argmax()
        deviation = xs - xs[top]
        beyond = weights.dot(deviation)
        deviation = deviation - beyond
        within = weights.dot((Ps - Ps[top]).reshape(len(Ps), -1)).reshape(Ps.shape[1:])
        return xs[top] + beyond, Ps[top] + within + (deviation.T * weights).dot(deviation)
    top = np.argmax(weights, axis=-1)[..., None, None]
    row = weights[..., None, :]
    first, first_P = np.take_along_axis(xs, top, axis=-2), np.take_along_axis(Ps, top[..., None], axis=-3)
    deviation = xs - first
    off = row @ deviation
    deviation = deviation - off
    P = row @ (Ps - first_P).reshape(*Ps.shape[:-2], -1)
    P = first_P[..., 0, :, :] + P.reshape(*Ps.shape[:-3], *Ps.shape[-2:])
    return (first + off)[..., 0, :], P + (deviation.mT * row) @ deviation


def given_mode(log_joint_mode: FloatArray, log_prior: FloatArray) -> FloatArray:
    """Log-density of the observation in each mode, (..., K), of that of mode and observation.

    Minus infinity where a mode cannot be.
    """
    reached: np.ndarray = log_joint_mode > -np.inf
    apart: FloatArray = np.where(reached, log_joint_mode, 0.0) - np.where(reached, log_prior, 0.0)
    return np.where(reached, apart, -np.inf)


def merge_pairs(weights: FloatArray, xs: FloatArray, Ps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Merge moments of pairs, (..., K, K, n) and (..., K, K, n, n), over i with the weights (i, j)."""
    return merge_modes(weights.mT, np.swapaxes(xs, -3, -2), np.swapaxes(Ps, -4, -3))


@QUIET
def mix_modes(omega: FloatArray, xs: FloatArray, Ps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Moments with which each mode j starts the interaction: mixtures over i with weights omega[i, j]."""
    weights = omega.mT
    top = np.argmax(weights, axis=-1)  # from the likeliest on, as in `merge_modes`
    first = np.take_along_axis(xs, top[..., None], axis=-2)
    first_P = np.take_along_axis(Ps, top[..., None, None], axis=-3)
    deviation = xs[..., None, :, :] - first[..., :, None, :]
    beyond = weights[..., None, :] @ deviation
    deviation = deviation - beyond
    off_P = Ps[..., None, :, :, :] - first_P[..., :, None, :, :]
    P = (weights[..., None, :] @ off_P.reshape(*off_P.shape[:-2], -1)).reshape(Ps.shape)
    spread = (deviation.mT * weights[..., None, :]) @ deviation
    return first + beyond[..., 0, :], first_P + P + spread


@QUIET
def move_bank(
    xs: FloatArray, Ps: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Prediction of every mode with its own F and Q, (K, n, n)."""
    return (F @ xs[..., None])[..., 0], kalman.predict_stack(Ps, F, Q, alpha_sq)


@QUIET
def correct_bank(
    xs: FloatArray,
    Ps: FloatArray,
    z: FloatArray,
    H: FloatArray,
    R: FloatArray,
    seen: np.ndarray | None,
) -> tuple[FloatArray, ...]:
    """Update of every mode with its own H (K, m, n) and R (K, m, m).

    Parameters
    ----------
    z : ndarray, shape (..., m)
    seen : ndarray of bool, shape (..., m), or None
        Which components were observed.

    Returns
    -------
    y, S, SI, K, xs, Ps, log_likelihood
    """
    y = z - (H @ xs[..., None])[..., 0]
    if seen is not None:
        y = np.where(seen, y, 0.0)
    S, SI, K, log_det = kalman.gain_stack(Ps, H, R, seen)
    xs = xs + (K @ y[..., None])[..., 0]
    Ps = kalman.correct_stack(Ps, K, H, R)
    return y, S, SI, K, xs, Ps, kalman.log_normal_stack(y, SI, log_det, seen)


@QUIET
def filter_bank(
    xs: FloatArray,
    Ps: FloatArray,
    log_mu: FloatArray,
    log_M: FloatArray,
    zs: FloatArray,
    model: dict[str, FloatArray],
    every_pair: bool,
    out: dict[str, FloatArray],
) -> dict[str, FloatArray] | None:
    """Run one bank along one series.

    Parameters
    ----------
    xs, Ps, log_mu : ndarray, shapes (K, n), (K, n, n) and (K,)
        Where the series starts.
    log_M : ndarray, shape (K, K)
    zs : ndarray, shape (steps, m)
        NaN where missing.
    model : dict of ndarray
        ``F``, ``Q``, ``H``, ``R`` with a leading axis for the modes, and ``alpha_sq``.
    every_pair : bool
        As in `filter_bank_many`.
    out : dict of ndarray
        Filled: ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``log_likelihood``, as far
        as they are there, each of shape (steps, ...).

    Returns
    -------
    dict of ndarray, or None
        After the last step: ``xs``, ``Ps``, ``xs_prior``, ``Ps_prior``, ``log_mu``, the predicted
        ``log_cbar``, the log-likelihoods ``modes`` of the modes and ``own`` of the filters; of the latest
        step of which something was observed, if there is one, ``y``, ``S``, ``SI``, ``K``.  With every
        pair, a filter's own are those of the likeliest pair that ends in its mode.  None if some
        observation was refused, because S is not positive definite or no mode gives it a density.
    """
    F, Q, H, R, alpha_sq = (model[name] for name in ("F", "Q", "H", "R", "alpha_sq"))
    innovation: dict[str, FloatArray] = {}
    state: dict[str, FloatArray] = {}
    for t, z in enumerate(zs):
        log_joint, log_cbar, omega = log_mixing(log_mu, log_M)
        if every_pair:
            before = move_bank(xs[:, None], Ps[:, None], F, Q, alpha_sq)
            xs, Ps = merge_pairs(omega, *before)
        else:
            before = xs, Ps = move_bank(*mix_modes(omega, xs, Ps), F, Q, alpha_sq)
        state = {"xs_prior": xs, "Ps_prior": Ps, "log_cbar": log_cbar}
        _put(out, ("x_prior", "P_prior"), t, merge_modes(np.exp(log_cbar), xs, Ps))
        seen: np.ndarray = np.logical_not(np.isnan(z))
        log_mu, total, modes, own = log_cbar, np.zeros(()), np.zeros(len(log_mu)), np.zeros(len(log_mu))
        if seen.any():
            try:
                *found, xs, Ps, own = correct_bank(*before, z, H, R, None if seen.all() else seen)
            except np.linalg.LinAlgError:
                return None
            if not ((log_joint if every_pair else log_cbar) + own).max() > -np.inf:
                return None
            if every_pair:
                weights, log_mu, total, log_joint_mode = weigh_pairs(log_joint, own)
                modes = given_mode(log_joint_mode, log_cbar)
                xs, Ps = merge_pairs(weights, xs, Ps)
                likeliest = weights.argmax(axis=0), np.arange(len(weights))
                found, own = [value[likeliest] for value in found], own[likeliest]
            else:
                modes = own
                log_mu, total = weigh_modes(log_cbar, modes)
            innovation = dict(zip(("y", "S", "SI", "K"), found, strict=True))
        mu = np.exp(log_mu)
        _put(out, ("x", "P"), t, merge_modes(mu, xs, Ps))
        _put(out, ("mu", "log_likelihood"), t, (mu, total))
        state |= {"xs": xs, "Ps": Ps, "log_mu": log_mu, "modes": modes, "own": own}
    return state | innovation


def _put(
    out: dict[str, FloatArray], names: tuple[str, str], t: int, values: tuple[FloatArray, FloatArray]
) -> None:
    for name, value in zip(names, values, strict=True):
        if name in out:
            out[name][t] = value


@QUIET
def filter_bank_many(
    xs: FloatArray,
    Ps: FloatArray,
    log_mu: FloatArray,
    log_M: FloatArray,
    zs: FloatArray,
    model: dict[str, FloatArray],
    every_pair: bool,
    out: dict[str, FloatArray],
) -> np.ndarray:
    """Run one bank along many series at once.

    Parameters
    ----------
    xs, Ps, log_mu : ndarray, shapes (K, n), (K, n, n) and (K,)
        Where every series starts.
    zs : ndarray, shape (series, steps, m)
        NaN where missing.
    model : dict of ndarray
        ``F``, ``Q``, ``H``, ``R`` with a leading axis for the modes, and ``alpha_sq``.
    every_pair : bool
        Filter once per pair of modes and merge afterwards (GPB2), instead of mixing
        before filtering once per mode (IMM).
    out : dict of ndarray
        Filled: ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``log_likelihood``, as far
        as they are there, each of shape (series, steps, ...).

    Returns
    -------
    ndarray of bool, shape (series,)
        Where no mode gave some observation a positive density; the series is NaN from there on.
    """
    n_series, n_steps, _ = zs.shape
    F, Q, H, R, alpha_sq = (model[name] for name in ("F", "Q", "H", "R", "alpha_sq"))
    xs, Ps, log_mu = (np.broadcast_to(a, (n_series, *a.shape)) for a in (xs, Ps, log_mu))
    all_seen: np.ndarray = np.asarray(~np.isnan(zs))
    zs = np.where(all_seen, zs, 0.0)
    axes = (slice(None), None, None) if every_pair else (slice(None), None)
    for t in range(n_steps):
        log_joint, log_cbar, omega = log_mixing(log_mu, log_M)
        if every_pair:
            xs, Ps = (np.repeat(a[:, :, None], len(log_M), axis=2) for a in (xs, Ps))
        else:
            xs, Ps = mix_modes(omega, xs, Ps)
        xs, Ps = move_bank(xs, Ps, F, Q, alpha_sq)
        if "x_prior" in out or "P_prior" in out:
            log_weights = log_joint.reshape(n_series, -1) if every_pair else log_cbar
            _store(
                out, ("x_prior", "P_prior"), t, merge_modes(np.exp(log_weights), *_modes(xs, Ps, n_series))
            )
        seen = all_seen[:, t]
        y_seen = None if seen.all() else seen[axes]
        *_, xs, Ps, log_likelihood = correct_bank(xs, Ps, zs[:, t][axes], H, R, y_seen)
        if every_pair:
            omega, log_mu, total, _ = weigh_pairs(log_joint, log_likelihood)
            xs, Ps = merge_pairs(omega, xs, Ps)
        else:
            log_mu, total = weigh_modes(log_cbar, log_likelihood)
        mu = np.exp(log_mu)
        if "x" in out or "P" in out:
            _store(out, ("x", "P"), t, merge_modes(mu, xs, Ps))
        _store(out, ("mu", "log_likelihood"), t, (mu, total))
    return np.asarray(np.isnan(log_mu).any(axis=-1))


def _store(
    out: dict[str, FloatArray], names: tuple[str, str], t: int, values: tuple[FloatArray, FloatArray]
) -> None:
    for name, value in zip(names, values, strict=True):
        if name in out:
            out[name][:, t] = value


def _modes(xs: FloatArray, Ps: FloatArray, n_series: int) -> tuple[FloatArray, FloatArray]:
    """Moments with all modes, or pairs of modes, along one axis."""
    n = xs.shape[-1]
    return xs.reshape(n_series, -1, n), Ps.reshape(n_series, -1, n, n)
