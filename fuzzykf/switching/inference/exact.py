"""The exact recursion of every switching filter (2020 paper, section IV), and what it does in gaps.

With the tables of a step (`fuzzykf.switching.dynamics.pairs`), the window w of the latest
observations and the new observation y':

    log w_ij = log p_i + log P_ij + log N(y'; Ayy w + Ny, Qyy)                  (10)
    log p(y' | y_1..n) = logsumexp of all log w_ij                              (11)
    p'_j = sum_i w_ij / sum of all w                                            (13)
    o_ij = w_ij / sum_k w_kj                                                    (14)
    x_ij = Axx x_i + H w + G y' + c,    P_ij = Axx P_i Axx' + C            (15)-(18)
    x'_j = sum_i o_ij x_ij                                                      (19)
    P'_j = sum_i o_ij (P_ij + (x_ij - x'_j)(x_ij - x'_j)')                      (20)

Second moments are central, unlike in the paper, where they cancel.  Complete observations go
through the engine.

The next observation is predicted from the latest ones, so a gap leaves not only X but also a
part of the window unknown.  Then the general pair formulas apply to s = (X, w),

    s'_ij = F_ij s + b_ij + noise,   s' = (X', Y', w without its oldest),

conditioned on what is there of Y', and collapsed over i by moment matching.  The result is
exact for a single class and for gaps at the end of a series (hence for forecasts of means and
covariances); with several classes an observation after a gap makes it an approximation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import QuadratureError
from fuzzykf.gaussian import cholesky, log_density, logsumexp, mixture_moments, symmetrize
from fuzzykf.switching.dynamics.pairs import Ahead
from fuzzykf.switching.inference.mixture import Mixture

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables, SwitchingSystem
    from fuzzykf.switching.inference.method import Smoothed
    from fuzzykf.switching.inference.series import Trajectory

__all__ = ["EXACT", "Exact", "PairPrediction", "collapse_weights", "condition_pairs", "pair_prediction"]

#: Largest total of negative masses that a rule with negative weights may produce.
NEGATIVE_MASS = 1e-2


class Exact:
    """Exact filtering of systems in which Y alone is Markov given the switch; see `Method`."""

    def first(self, law: InitialLaw, y: FloatArray) -> tuple[Mixture, float]:
        """Condition the law of (r_1, Z_1) on y_1, (q,), NaN where missing; no dynamics come before it."""
        if is_complete(y):
            table, log_likelihood = engine.first_step(*law.start(y.size), y[None])
            return Mixture(table[0], y), float(log_likelihood[0])
        # one imaginary predecessor
        prediction = PairPrediction(law.start(y.size)[0][None], None, law.mean[None], law.covariance[None])
        return _condition(prediction, y, y, law.mean.shape[1] - y.size)

    def advance(
        self, tables: PairTables, mixture: Mixture, y: FloatArray, width: int
    ) -> tuple[Mixture, float]:
        """Take the next observation, (q,), NaN where missing, into account.

        Parameters
        ----------
        tables : PairTables
        mixture : Mixture
        y : ndarray, shape (q,)
        width : int
            Length of the window after it.

        Returns
        -------
        mixture, log_likelihood
            The log-likelihood is that of the parts that are there; 0 if none is.
        """
        window = y if width == y.size else np.concatenate([y, mixture.window])[:width]
        if not mixture.unknown and is_complete(y):
            table, sign, log_likelihood = engine.step(
                tables.kernel, mixture.table, mixture.sign, mixture.window, y
            )
            if sign is not None:
                check_masses(engine.probabilities(table, sign))
            return Mixture(table, window, sign), log_likelihood
        m = tables.pairs.Axx.shape[-1]
        log_w, signs, mean, covariance = pair_prediction(tables, mixture)
        keep = slice(0, m + width)
        shorter = PairPrediction(log_w, signs, mean[..., keep], covariance[..., keep, keep])
        return _condition(shorter, y, window, m)

    def ahead(self, tables: PairTables, mixture: Mixture) -> Ahead:
        """Moments of (X', Y') and the probabilities of the nodes before Y' is seen."""
        m = tables.pairs.Axx.shape[-1]
        d = m + tables.pairs.Qyy.shape[-1]
        p = mixture.probabilities
        _, _, means, covariances = pair_prediction(tables, mixture)
        weights = (p[:, None] * tables.transition).ravel()
        mean, covariance = mixture_moments(
            weights, means[..., :d].reshape(-1, d), covariances[..., :d, :d].reshape(-1, d, d)
        )
        return Ahead(p @ tables.transition, mean[:m], covariance[:m, :m], mean[m:], covariance[m:, m:])

    def series(
        self,
        system: SwitchingSystem,
        tables: PairTables,
        begin: tuple[FloatArray | None, ...],
        ys: FloatArray,
        start: int,
        stop: int,
        out: dict[str, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Filter complete observations start, ..., stop - 1 of series (s, n, q) under constant tables."""
        summary = tables.summary(system.chain)
        found = engine.filter_series(tables.kernel, summary, begin, ys, start, stop, out)
        if "sign" in out:
            part = slice(start, stop)
            check_masses(engine.probabilities(out["table"][:, part], out["sign"][:, part]))
        return found

    def smooth(self, system: SwitchingSystem, trajectory: Trajectory, ys: FloatArray) -> Smoothed:
        """Estimate every state of a filtered series from all of it, see `smooth_back`."""
        from fuzzykf.switching.inference.smoother import smooth_back

        return smooth_back(system, trajectory, ys)

    def __reduce__(self) -> str | tuple[Any, ...]:
        if type(self) is Exact:
            return "EXACT"  # there is one alone, whoever copies or pickles it
        return type(self).__new__, (type(self),), self.__dict__


#: The method of `OFSRFilter`, `CGOMSMFilter` and `KnownSwitchFilter`.
EXACT = Exact()


def is_complete(y: FloatArray) -> bool:
    """Whether nothing of an observation is missing."""
    if y.size == 1:  # asked at every step of a scalar filter, so asked quickly
        value = y.item()
        return bool(value == value)
    return not np.isnan(y).any()


def check_masses(p: FloatArray) -> None:
    """Refuse probabilities (..., M) of which more than rounding is negative."""
    negative = np.maximum(-p, 0.0).sum(axis=-1)
    if not (negative <= NEGATIVE_MASS).all():  # NaN where the total is not positive
        worst = f"a negative mass of {np.max(negative):.3g} (at most {NEGATIVE_MASS} is tolerated)"
        if np.isnan(negative).any():
            worst = "no positive mass"
        raise QuadratureError(
            "the rule 'product' is too coarse for this law and these observations: its interpolant has "
            f"{worst}; use more nodes or the rule 'cell', whose weights are never negative"
        )


# --------------------------------------------------------------------------- pairs of nodes, in a gap


class PairPrediction(NamedTuple):
    """Moments of s' = (X', Y', w) given the pair of nodes, before Y' is seen."""

    log_w: FloatArray  # (M1, M2): log p_i + log |P_ij|
    sign: FloatArray | None  # (M1, M2)
    mean: FloatArray  # (M1, M2, e)
    covariance: FloatArray  # (M1, M2, e, e)


def pair_prediction(tables: PairTables, mixture: Mixture) -> PairPrediction:
    """Move s = (X, w) through every pair of nodes.

    The new window is (Y', w), as long as the tables of the next step may want it; the
    caller drops its oldest part.
    """
    Axx, H, G, c, C, Ayy, Ny, Qyy = tables.pairs
    m, q = Axx.shape[-1], Qyy.shape[-1]
    x, P, known = mixture.spread(m)
    w = known.size
    F = np.zeros((*tables.transition.shape, m + q + w, m + w))
    F[..., :m, :m] = Axx
    F[..., :m, m:] = H + G @ Ayy
    F[..., m : m + q, m:] = Ayy
    F[..., m + q :, m:] = np.eye(w)
    b = np.zeros(F.shape[:-1])
    b[..., :m] = c + (G @ Ny[..., None])[..., 0]
    b[..., m : m + q] = Ny
    mean = (F @ x[:, None, :, None])[..., 0] + b
    covariance = F @ P[:, None] @ np.swapaxes(F, -1, -2)
    cross = G @ Qyy
    covariance[..., :m, :m] += C + cross @ np.swapaxes(G, -1, -2)
    covariance[..., :m, m : m + q] += cross
    covariance[..., m : m + q, :m] += np.swapaxes(cross, -1, -2)
    covariance[..., m : m + q, m : m + q] += Qyy
    with np.errstate(divide="ignore"):
        log_w = np.maximum(np.log(np.abs(tables.transition)), engine.LOG_ZERO) + mixture.table[0][:, None]
    sign = np.sign(tables.transition) if (tables.transition < 0.0).any() else None
    if sign is not None and mixture.sign is not None:
        sign = sign * mixture.sign[:, None]
    return PairPrediction(log_w, sign, mean, symmetrize(covariance))


def _condition(
    prediction: PairPrediction, y: FloatArray, window: FloatArray, m: int
) -> tuple[Mixture, float]:
    """Condition every pair on the observed parts of y, and collapse pairs into nodes."""
    log_w, _, mean, covariance = condition_pairs(prediction, y, m)
    log_p, sign, o = collapse_weights(log_w, prediction.sign)
    node_mean = np.einsum("ij,ijk->jk", o, mean)
    off = mean - node_mean
    between = np.transpose(o[..., None] * off, (1, 2, 0)) @ np.swapaxes(off, 0, 1)  # of the means, per j
    node_covariance = np.einsum("ij,ijkl->jkl", o, covariance) + between
    dead = log_p < engine.DEAD  # no path reaches these nodes: their moments must not grow without bound
    node_mean[dead], node_covariance[dead] = 0.0, 0.0
    total = log_p.max()
    masses = np.exp(log_p - total) if sign is None else sign * np.exp(log_p - total)
    log_total = float(total + np.log(masses.sum()))
    mixture = Mixture.gather(log_p - log_total, sign, node_mean, symmetrize(node_covariance), window)
    return mixture, 0.0 if np.isnan(y).all() else log_total


def condition_pairs(prediction: PairPrediction, y: FloatArray, m: int) -> PairPrediction:
    """Condition every pair on the observed parts of y, whose density joins the weights."""
    there = ~np.isnan(y)
    if not there.any():
        return prediction
    at = m + np.flatnonzero(there)
    log_w, sign, mean, covariance = prediction
    factor = observed_factor(covariance, at)
    residual = y[there] - mean[..., at]
    root = np.linalg.solve(factor, covariance[..., at, :])  # L^-1 Cov(Y', s')
    white = np.linalg.solve(factor, residual[..., None])
    mean = mean + (np.swapaxes(root, -1, -2) @ white)[..., 0]
    covariance = symmetrize(covariance - np.swapaxes(root, -1, -2) @ root)
    mean[..., at] = y[there]
    covariance[..., at, :] = 0.0
    covariance[..., :, at] = 0.0
    return PairPrediction(log_w + log_density(residual, factor), sign, mean, covariance)


def observed_factor(covariance: FloatArray, at: IntArray) -> FloatArray:
    """Cholesky factor of the covariance of the observed parts, (M1, M2, k, k)."""
    return cholesky(
        covariance[..., at[:, None], at], lambda k: f"covariance of the predicted observation, pair {k}"
    )


def observed_log_density(prediction: PairPrediction, y: FloatArray, m: int) -> FloatArray:
    """Log-density of the observed parts of y per pair, (M1, M2); 0 if nothing is observed."""
    at = m + np.flatnonzero(~np.isnan(y))
    if at.size == 0:
        return np.zeros(prediction.log_w.shape)
    return log_density(y[at - m] - prediction.mean[..., at], observed_factor(prediction.covariance, at))


def collapse_weights(
    log_w: FloatArray, sign: FloatArray | None
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """Column sums in the log domain, their signs, and o_ij = w_ij / sum_k w_kj."""
    if sign is None:
        log_p = logsumexp(log_w, axis=0)
        return log_p, None, np.exp(log_w - log_p)
    top = log_w.max(axis=0)
    w = sign * np.exp(log_w - top)
    column = w.sum(axis=0)
    column = np.where(column == 0.0, np.finfo(np.float64).tiny, column)
    return np.log(np.abs(column)) + top, np.where(column < 0.0, -1.0, 1.0), w / column
