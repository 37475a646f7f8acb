"""The two fits, from data to a `FitResult`: with the switch given, and with it hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.chain import stationary_distribution
from fuzzykf.switching.fuzzy_model import N_PROOF, CGOFMSModel
from fuzzykf.switching.hard_model import CGOMSModel
from fuzzykf.switching.learning.chains import ChainFamily, FreeChain, family_of
from fuzzykf.switching.learning.em import Estimate, Posterior, pair_shares, run_em
from fuzzykf.switching.learning.gaussians import (
    GaussianEstimate,
    RegressionEstimate,
    pair_cells,
    single_cells,
    transition_vectors,
)
from fuzzykf.switching.learning.law import count_transitions, fit_law
from fuzzykf.switching.learning.likelihood import log_likelihood
from fuzzykf.switching.learning.regression import Cells
from fuzzykf.switching.learning.starts import classes, guesses, spread
from fuzzykf.switching.learning.vine import VineEstimate

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.tables import SwitchingSystem

__all__ = ["Fitted", "Options", "fit_fuzzy", "fit_hard"]

#: A regime, or a pair, with less than this many observations is reported.
SCARCE = 5.0

#: Iterations that every start gets before the best ones go on.
TRIAL = 12

#: How many starts go on to convergence.
FINALISTS = 2

#: Where the noise of the state has less than this share of that elsewhere, it is reported.
VANISHING = 1e-3


@dataclass(frozen=True)
class Options:
    """How to learn.

    Attributes
    ----------
    form : {"regression", "covariance"}
    n_starts : int
    max_iter : int
    tolerance : float
        Gain in log-likelihood per observation at which to stop.
    rng : numpy.random.Generator or None
    tick : callable or None
        Called after each iteration.
    """

    form: str = "regression"
    n_starts: int = 4
    max_iter: int = 200
    tolerance: float = 1e-6
    rng: np.random.Generator | None = None
    tick: Callable[[], None] | None = None


@dataclass(frozen=True)
class Fitted:
    """What a fit found, before it is presented."""

    model: Any
    log_likelihood: float
    n_parameters: int
    trace: list[float]
    converged: bool
    warnings: list[str]
    switch_mean: FloatArray  # at the rows of the data


def _estimator(form: str, data: TrainingData) -> type[GaussianEstimate]:
    if form == "regression":
        return RegressionEstimate
    if data.z.shape[1] != 2:
        raise ParameterError(
            "form: 'covariance' can be learned for one state and one observation only, got "
            f"{data.dim_x} and {data.z.shape[1] - data.dim_x}; use 'regression'"
        )
    return VineEstimate


def _proof_values(K: int, *, fuzzy: bool) -> FloatArray:
    """Return the values of the switch at pairs of which a model has to be valid."""
    if not fuzzy:
        return np.arange(K, dtype=np.float64)
    return np.concatenate([[0.0], (np.arange(N_PROOF) + 0.5) / N_PROOF, [1.0]])


def _proof(K: int, *, fuzzy: bool) -> FloatArray:
    """Return the shares of the regimes in those pairs."""
    r = _proof_values(K, fuzzy=fuzzy)
    return pair_shares(np.stack([1.0 - r, r], axis=1) if fuzzy else np.eye(K))


def _from_shares(
    kind: type[GaussianEstimate], shares: FloatArray, data: TrainingData, *, fuzzy: bool
) -> GaussianEstimate:
    """Estimate a Gaussian part from shares (N, K) of the regimes in each row of the data."""
    v = transition_vectors(data)
    w = np.concatenate([np.ones((len(data.z), 1)), data.z], axis=1)
    single = Cells(shares, np.ones(len(w)), w[:, :, None] * w[:, None, :])
    pairs = pair_cells(shares[data.before], shares[data.after], v)
    proof = _proof(shares.shape[1], fuzzy=fuzzy)
    return kind.start(pairs, single, data.dim_x, data.z.shape[1] - data.dim_x, proof)


# --------------------------------------------------------------------------- the switch is known


def fit_fuzzy(data: TrainingData, law: str, n_nodes: int, options: Options) -> Fitted:
    """Learn a fuzzy model."""
    if data.r is None:
        return _fit_hidden_fuzzy(data, law, n_nodes, options)
    if not ((data.r >= 0.0) & (data.r <= 1.0)).all():
        raise ParameterError(f"r: got values from {data.r.min()} to {data.r.max()}, expected [0, 1]")
    shares = np.stack([1.0 - data.r, data.r], axis=1)
    fitted = fit_law(law, data.r[data.before], data.r[data.after])
    estimate = _from_shares(_estimator(options.form, data), shares, data, fuzzy=True)
    w = np.concatenate([np.ones((len(data.z), 1)), data.z], axis=1)
    single = Cells(shares, np.ones(len(w)), w[:, :, None] * w[:, None, :])
    model = CGOFMSModel._from_form(fitted, estimate.form(single, data.scale))
    notes = _known_scarcity(shares, data) + _active_constraint(estimate, 2)
    hard = float(np.isin(data.r, (0.0, 1.0)).mean())
    if law == "fmc1" and hard < 0.375:
        notes.append(
            f"the switch is hard in {hard:.3g} of the data, but FMC1 cannot go below 3/8; consider 'fmc2'"
        )
    system = model.on_nodes(n_nodes)
    value = log_likelihood(system, data)
    notes += _instability(system)
    return Fitted(model, value, estimate.n_parameters + 3, [value], True, notes, data.r)


def fit_hard(data: TrainingData, K: int, options: Options) -> Fitted:
    """Learn a model of K hard regimes."""
    if data.r is None:
        return _fit_hidden_hard(data, K, options)
    if not np.isin(data.r, np.arange(K)).all():
        raise ParameterError(
            f"r: expected regimes 0 to {K - 1} (n_switches = {K}), got {np.unique(data.r)[:5].tolist()}"
        )
    shares = np.eye(K)[data.r.astype(int)]
    counts = count_transitions(data.r[data.before], data.r[data.after], K)
    notes = _known_scarcity(shares, data)
    left = counts.sum(axis=1)
    for k in np.flatnonzero(left == 0.0):
        notes.append(
            f"the regime {k} is followed by nothing; every regime is taken as equally likely after it"
        )
    transition = np.where(left[:, None] > 0.0, counts / np.maximum(left, 1.0)[:, None], 1.0 / K)
    visits = shares.sum(axis=0)
    estimate = _from_shares(_estimator(options.form, data), shares, data, fuzzy=False)
    single = single_cells(shares, np.eye(K), data.z)
    model = CGOMSModel._from_form(transition, estimate.form(single, data.scale), visits / visits.sum())
    value = log_likelihood(model.on_nodes(), data)
    notes += _active_constraint(estimate, K) + _instability(model.on_nodes())
    return Fitted(model, value, estimate.n_parameters + K * (K - 1), [value], True, notes, data.r)


# --------------------------------------------------------------------------- the switch is hidden


def _fit_hidden_fuzzy(data: TrainingData, law: str, n_nodes: int, options: Options) -> Fitted:
    kind = _estimator(options.form, data)
    base = family_of(law, n_nodes, None)
    shares = np.stack([1.0 - base.nodes, base.nodes], axis=1)

    guessed = [spread(rank) for rank in guesses(data, options.n_starts, options.rng)]
    # the posterior of two hard regimes is one more guess
    _, posterior, *_ = _best(_hard_starts(kind, data, 2, options), np.eye(2), data, options, final=False)
    guessed.append(posterior.gamma[:, 1])
    starts = []
    for r in guessed:
        gaussian = _from_shares(kind, np.stack([1.0 - r, r], axis=1), data, fuzzy=True)
        starts.append(Estimate(family_of(law, n_nodes, None), gaussian))
    estimate, posterior, trace, converged = _best(starts, shares, data, options, final=True)
    single = single_cells(posterior.gamma, shares, data.z)
    form = estimate.gaussian.form(single, data.scale)
    model = CGOFMSModel._from_form(estimate.chain.law(), form)
    system = model.on_nodes(n_nodes)
    notes = _hidden_scarcity(posterior, shares) + _active_constraint(estimate.gaussian, 2)
    notes += _instability(system) + _unfinished(converged, options)
    if law == "fmc1" and model.law.p_hard < 0.375 + 0.02:
        notes.append(
            f"p_hard is {model.law.p_hard:.3g}, at the bound 3/8 of FMC1: the switch seems to be more "
            "gradual than FMC1 can be; consider 'fmc2' or 'free'"
        )
    return Fitted(
        model,
        log_likelihood(system, data),
        estimate.gaussian.n_parameters + estimate.chain.n_parameters,
        trace,
        converged,
        notes,
        posterior.gamma @ base.nodes,
    )


def _hard_starts(
    kind: type[GaussianEstimate], data: TrainingData, K: int, options: Options
) -> list[Estimate]:
    starts = []
    for rank in guesses(data, options.n_starts if K > 1 else 1, options.rng):
        shares = classes(rank, K)
        joint = (0.8 * np.eye(K) + 0.2 / K) / K
        chain: ChainFamily = FreeChain(np.arange(K, dtype=np.float64), joint)
        starts.append(Estimate(chain, _from_shares(kind, shares, data, fuzzy=False)))
    return starts


def _fit_hidden_hard(data: TrainingData, K: int, options: Options) -> Fitted:
    kind = _estimator(options.form, data)
    shares = np.eye(K)
    estimate, posterior, trace, converged = _best(
        _hard_starts(kind, data, K, options), shares, data, options, final=True
    )
    form = estimate.gaussian.form(single_cells(posterior.gamma, shares, data.z), data.scale)
    transition = estimate.chain.transition
    try:
        initial = stationary_distribution(transition)
    except ParameterError:  # a regime that is never left: how often it was seen is all there is to say
        initial = posterior.gamma.mean(axis=0) / posterior.gamma.mean(axis=0).sum()
    model = CGOMSModel._from_form(transition, form, initial)
    notes = _hidden_scarcity(posterior, shares) + _active_constraint(estimate.gaussian, K)
    notes += _instability(model.on_nodes()) + _unfinished(converged, options)
    return Fitted(
        model,
        log_likelihood(model.on_nodes(), data),
        estimate.gaussian.n_parameters + K * (K - 1),
        trace,
        converged,
        notes,
        posterior.gamma @ estimate.chain.nodes,
    )


def _best(
    starts: list[Estimate], shares: FloatArray, data: TrainingData, options: Options, *, final: bool
) -> tuple[Estimate, Posterior, list[float], bool]:
    """Give every start a few iterations, and the best ones all they need."""

    def run(start: Estimate, max_iter: int) -> tuple[Estimate, Posterior, list[float], bool]:
        return run_em(start, shares, data, max_iter=max_iter, tolerance=options.tolerance, tick=options.tick)

    trial = min(TRIAL, options.max_iter)
    trials = [run(start, trial) for start in starts]
    leader = max(trials, key=lambda t: t[2][-1])[0]
    trials += [run(Estimate(chain, leader.gaussian), trial) for chain in leader.chain.variants()]
    trials.sort(key=lambda t: -t[2][-1])
    if not final:
        return trials[0]
    finished = []
    for estimate, posterior, trace, converged in trials[:FINALISTS]:
        if not converged and options.max_iter > trial:
            estimate, posterior, more, converged = run(estimate, options.max_iter - trial)
            trace = trace + more[1:]
        finished.append((estimate, posterior, trace, converged))
    return max(finished, key=lambda t: t[2][-1])


# --------------------------------------------------------------------------- warnings


def _scarcity(visits: FloatArray, pairs: FloatArray) -> list[str]:
    """Say which regimes and pairs of regimes the data hardly visit.

    Parameters
    ----------
    visits, pairs : ndarray, shapes (K,) and (K, K)
        Total shares of the regimes in the data, and of pairs of regimes in the steps.
    """
    found = []
    K = len(visits)
    for k in range(K):
        if visits[k] < SCARCE:
            found.append(f"the regime {k} is hardly visited (a total share of {visits[k]:.3g} observations)")
    for i in range(K):
        for j in range(K):
            if min(visits[i], visits[j]) >= SCARCE and pairs[i, j] < SCARCE:
                found.append(
                    f"the pair of regimes ({i}, {j}) hardly occurs (a total share of {pairs[i, j]:.3g} "
                    "steps); its parameters follow the others"
                )
    return found


def _known_scarcity(shares: FloatArray, data: TrainingData) -> list[str]:
    return _scarcity(shares.sum(axis=0), shares[data.before].T @ shares[data.after])


def _hidden_scarcity(posterior: Posterior, shares: FloatArray) -> list[str]:
    return _scarcity(posterior.gamma.sum(axis=0) @ shares, shares.T @ posterior.pairs @ shares)


def _active_constraint(estimate: GaussianEstimate, K: int) -> list[str]:
    """Say where the noise of the covariance form is about to vanish."""
    if not isinstance(estimate, VineEstimate):
        return []
    share = estimate.noise_share(estimate.proof)
    if share.min() >= VANISHING * share.max():
        return []
    first, second = np.unravel_index(int(np.argmin(share)), (round(len(share) ** 0.5),) * 2)
    values = _proof_values(K, fuzzy=len(share) > K * K)
    return [
        f"the constraint is active: at the values ({values[first]:.3g}, {values[second]:.3g}) of the switch "
        f"the noise of the state has {share.min() / share.max():.3g} of its variance elsewhere, and positive "
        "definiteness bounds the parameters; consider form='regression', which has no such bound"
    ]


def stability_radius(system: SwitchingSystem) -> float:
    """Spectral radius of the transition-weighted Axx: the error of the state filter grows from 1 on."""
    Axx, P = system.pair_tables(0).pairs.Axx, system.chain.transition
    M, m = len(P), Axx.shape[-1]
    twice = np.einsum("ij,ijkl,ijrs->jkrils", P, Axx, Axx).reshape(M * m * m, M * m * m)
    return float(np.abs(np.linalg.eigvals(twice)).max())


def _instability(system: SwitchingSystem) -> list[str]:
    radius = stability_radius(system)
    if radius < 1.0:
        return []
    return [
        f"the state filter is unstable: its error variance grows by the factor {radius:.4g} a step, since "
        "the model has no feedback from observations to the state"
    ]


def _unfinished(converged: bool, options: Options) -> list[str]:
    if converged:
        return []
    return [f"not converged after {options.max_iter} iterations; raise max_iter or tolerance"]
