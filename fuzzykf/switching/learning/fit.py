"""The two fits, from data to a `FitResult`: with the switch given, and with it hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.base import NODES
from fuzzykf.switching.laws.chain import SwitchChain, shares_of, stationary_distribution
from fuzzykf.switching.learning.em import Estimate, Posterior, Settled, pair_shares, run_em
from fuzzykf.switching.learning.gaussians import (
    GaussianEstimate,
    MemorylessEstimate,
    RegressionEstimate,
    pair_cells,
    row_cells,
    single_cells,
    transition_vectors,
)
from fuzzykf.switching.learning.law import count_transitions
from fuzzykf.switching.learning.likelihood import log_likelihood
from fuzzykf.switching.learning.notes import (
    LEAST_HARD,
    active_constraint,
    hidden_scarcity,
    instability,
    known_scarcity,
    left_for_good,
    no_shorter,
    proof_values,
    scant_data,
    stuck,
    too_gradual,
    unfinished,
    unlike,
    ways,
)
from fuzzykf.switching.learning.regression import Evidence, merged
from fuzzykf.switching.learning.served import searched, served
from fuzzykf.switching.learning.starts import classes, guesses, named_guesses, soften, spread
from fuzzykf.switching.learning.statistics import Learned, hard_start
from fuzzykf.switching.learning.tilt import n_free, no_tilt, of_known
from fuzzykf.switching.learning.vine import VineEstimate
from fuzzykf.switching.models.fuzzy import CGOFMSModel
from fuzzykf.switching.models.hard import CGOMSModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FilterTraining
    from fuzzykf.switching.dynamics.forms import GaussianForm
    from fuzzykf.switching.laws.base import Law
    from fuzzykf.switching.learning.data import Scale, TrainingData
    from fuzzykf.switching.learning.further import Further

__all__ = ["CREEP", "Fitted", "Options", "fit_fuzzy", "fit_hard", "fuzzy_model", "hard_model"]

#: An estimate, its posterior, the trace, and whether it converged; see `run_em`.
Found = tuple[Estimate, Posterior, list[float], bool]

#: Iterations that every start gets before the best ones go on.
TRIAL = 12

#: How many starts go on to convergence.
FINALISTS = 2

#: Below this tolerance steps are extrapolated; a search that is to stop early does not creep long.
CREEP = 1e-5

#: In the covariance form, whose start is slow, a guess of a fuzzy switch has so many steps from 0 to 1, so
#: that equal pairs of values go together.
GUESS_STEPS = 20


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
    guess : ndarray or None
        The switch along the data from which alone to begin, where it is hidden.
    state_feedback : bool
        Whether the state depends on the one before it.
    objective : {"joint", "filter"}
        What is raised: the likelihood of (x, y), or what the filter says of x.
    memo : dict or None
        Joint searches without inputs and features by the number of their rows, for fits of the same data.
    """

    form: str
    n_starts: int = 4
    max_iter: int = 500
    tolerance: float = 1e-6
    rng: np.random.Generator | None = None
    tick: Callable[[], None] | None = None
    guess: FloatArray | None = None
    state_feedback: bool = True
    objective: str = "joint"
    memo: dict[int, Any] | None = None


@dataclass(frozen=True)
class Fitted:
    """What a fit found, before it is presented."""

    model: Any
    log_likelihood: float
    n_parameters: int
    trace: list[float]
    converged: bool
    warnings: list[str]
    switch_mean: FloatArray | None  # (N,): at the rows of the data, where regimes have numbers
    class_weights: FloatArray  # (N, K)
    bounded: bool = False  # whether positive definiteness bounds the parameters
    training: FilterTraining | None = None  # how it was learned for its filter
    learned: Learned | None = None  # what learning can go on from


def _estimator(options: Options, data: TrainingData, n_fuzzy: int = 2) -> type[GaussianEstimate]:
    if options.form == "regression":
        return RegressionEstimate if options.state_feedback else MemorylessEstimate
    if n_fuzzy > 2:
        raise ParameterError(
            "form: 'covariance' can be learned for a fuzzy switch between two classes only, got "
            f"{n_fuzzy}; use 'regression'"
        )
    if data.z.shape[1] != 2:
        raise ParameterError(
            "form: 'covariance' can be learned for one state and one observation only, got "
            f"{data.dim_x} and {data.z.shape[1] - data.dim_x}; use 'regression'"
        )
    return VineEstimate


def _proof(K: int, *, fuzzy: bool) -> FloatArray:
    """Return the shares of the regimes in those pairs."""
    r = proof_values(K, fuzzy=fuzzy)
    return pair_shares(np.stack([1.0 - r, r], axis=1) if fuzzy and K == 2 else np.eye(K))


def _from_shares(
    kind: type[GaussianEstimate], shares: FloatArray, data: TrainingData, *, fuzzy: bool
) -> GaussianEstimate:
    """Estimate a Gaussian part from shares (N, K) of the regimes in each row of the data."""
    v = transition_vectors(data)
    single = row_cells(shares, data).each(merged)
    pairs = Evidence.of(pair_cells(shares[data.before], shares[data.after], v), data.has_state).each(merged)
    proof = _proof(shares.shape[1], fuzzy=fuzzy)
    return kind.start(pairs, single, data.dim_x, data.z.shape[1] - data.dim_x, proof, data.window)


# --------------------------------------------------------------------------- the switch is known


def fit_fuzzy(data: TrainingData, law: Law, n_nodes: int | None, options: Options) -> Fitted:
    """Learn a fuzzy model, with a law of the structure of ``law``, at which a hidden switch begins.

    Without a number of nodes there are `NODES`, or as many as the law has room for.
    """
    nodes = law.nodes_up_to(NODES) if n_nodes is None else n_nodes
    if data.r is None:
        return _fit_hidden_fuzzy(data, law, nodes, options)
    K = law.n_classes
    shares = _shares(data.r, K)
    fitted = law.likeliest(np.split(shares, data.starts[1:]), nodes)
    nodes = fitted.nodes_up_to(nodes)  # on which the likelihood is told
    estimate = _from_shares(_estimator(options, data, K), shares, data, fuzzy=True)
    one = Settled(fitted, fitted.discretize(nodes), estimate)
    model = fuzzy_model(one, row_cells(shares, data), data.scale, data.further)
    bounds = active_constraint(estimate, K)
    system = model.placed(nodes)
    notes = known_scarcity(shares, data, ways(system.chain)) + bounds + unlike(law, fitted, shares)
    notes += left_for_good(system.chain, shares)
    hard = float((shares.max(axis=1) == 1.0).mean())
    if law.kind == "fmc1" and hard < LEAST_HARD:
        notes.append(
            f"the switch is hard in {hard:.3g} of the data, but at least in 3/8 under FMC1; consider 'fmc2'"
        )
    value = log_likelihood(system, data)
    n_parameters = estimate.n_parameters + law.learner(law.nodes_up_to(max(nodes, 1))).n_parameters
    at_nodes = (shares[:, None] == system.chain.class_weights).all(axis=-1).astype(np.float64)
    notes += instability(system) + stuck(at_nodes, system, data) + scant_data(n_parameters, data)
    switch_mean = shares[:, 1] if K == 2 else None
    return Fitted(model, value, n_parameters, [value], True, notes, switch_mean, shares, bool(bounds))


def _shares(r: FloatArray, K: int) -> FloatArray:
    """Return the class weights (N, K) of a fuzzy switch that is known."""
    if K > 2:
        return shares_of(r, K)
    if not ((r >= 0.0) & (r <= 1.0)).all():
        raise ParameterError(
            f"r: got values from {r.min()} to {r.max()}, expected [0, 1]; between more classes than two give "
            "a law of them"
        )
    return np.stack([1.0 - r, r], axis=1)


def fit_hard(data: TrainingData, K: int, options: Options) -> Fitted:
    """Learn a model of K hard regimes."""
    if data.r is None:
        return _fit_hidden_hard(data, K, options)
    if not np.isin(data.r, np.arange(K)).all():
        raise ParameterError(
            f"r: expected regimes 0 to {K - 1} (n_regimes = {K}), got {np.unique(data.r)[:5].tolist()}"
        )
    shares = np.eye(K)[data.r.astype(int)]
    counts = count_transitions(data.r[data.before], data.r[data.after], K)
    notes = known_scarcity(shares, data)
    left = counts.sum(axis=1)
    for k in np.flatnonzero(left == 0.0):
        notes.append(
            f"the regime {k} is followed by nothing; every regime is taken as equally likely after it"
        )
    transition = np.where(left[:, None] > 0.0, counts / np.maximum(left, 1.0)[:, None], 1.0 / K)
    transition, tilt = of_known(counts, transition, shares, data)
    visits = shares.sum(axis=0)
    estimate = _from_shares(_estimator(options, data), shares, data, fuzzy=False)
    single = single_cells(shares, np.eye(K), data)
    chain = SwitchChain.from_classes(transition, visits / visits.sum())
    form = _form(Settled(chain, chain, estimate, tilt), single, data.scale, data.further)
    model = CGOMSModel._from_form(transition, form, visits / visits.sum())
    system = model.placed()
    value = log_likelihood(system, data)
    bounds = active_constraint(estimate, K)
    n_parameters = estimate.n_parameters + K * (K - 1) + n_free(tilt)
    notes += bounds + instability(system) + stuck(shares, system, data) + scant_data(n_parameters, data)
    return Fitted(model, value, n_parameters, [value], True, notes, data.r, shares, bool(bounds))


# --------------------------------------------------------------------------- the switch is hidden


def _fit_hidden_fuzzy(data: TrainingData, law: Law, n_nodes: int, options: Options) -> Fitted:
    K = law.n_classes
    kind = _estimator(options, data, K)
    shares = law.learner(n_nodes).class_weights

    def search(rows: TrainingData, options: Options) -> Found:
        def joint(plain: TrainingData) -> Found:
            starts = [
                Estimate(law.learner(n_nodes), _from_shares(kind, guess, plain, fuzzy=True))
                for guess in _fuzzy_guesses(kind, plain, law, options)
            ]
            return _best(starts, shares, plain, options)

        return searched(joint, rows, options)

    def make(one: Estimate | Settled, seen: Posterior, rows: TrainingData) -> CGOFMSModel:
        return fuzzy_model(one, single_cells(seen.gamma, shares, rows), rows.scale, rows.further)

    found, posterior, trace, converged = search(data, options)
    estimate, posterior, training = served(found, posterior, search, make, shares, n_nodes, data, options)
    model = make(estimate, posterior, data)
    system = model.placed(n_nodes)
    bounds = active_constraint(estimate.gaussian, K)
    n_parameters = estimate.gaussian.n_parameters + found.chain.n_parameters + n_free(estimate.tilt)
    notes = hidden_scarcity(posterior, shares, ways(system.chain)) + bounds + instability(system)
    notes += stuck(posterior.gamma, system, data) + scant_data(n_parameters, data)
    notes += unfinished(converged, options.max_iter) + no_shorter(model.law, n_nodes)
    notes += left_for_good(system.chain, posterior.gamma @ shares)
    if law.kind == "fmc1" and isinstance(estimate, Estimate):
        notes += too_gradual(estimate, shares, data)
    weights = posterior.gamma @ shares
    return Fitted(
        model,
        log_likelihood(system, data),
        n_parameters,
        trace,
        converged,
        notes,
        posterior.gamma @ shares[:, 1] if K == 2 else None,
        weights,
        bool(bounds),
        training,
        Learned.of(law, n_nodes, found, posterior, shares, data) if training is None else None,
    )


def _fuzzy_guesses(
    kind: type[GaussianEstimate], data: TrainingData, law: Law, options: Options
) -> list[FloatArray]:
    """Return guesses (N, K) of the shares of the classes along the data."""
    K = law.n_classes
    if options.guess is not None:
        found = [_shares(options.guess, K)]
    else:
        ranks = guesses(data, options.n_starts, options.rng) if K == 2 else []
        found = [_shares(spread(rank), K) for rank in ranks]
        # posteriors of as many hard regimes are guesses too
        hard = _trials(_hard_starts(kind, data, K, options), np.eye(K), data, options)
        found += named_guesses([posterior for _, posterior, *_ in hard], law, data)
    if options.form != "covariance":
        return found
    return [_shares(np.round(one[:, 1] * GUESS_STEPS) / GUESS_STEPS, K) for one in found]


def _hard_starts(
    kind: type[GaussianEstimate], data: TrainingData, K: int, options: Options
) -> list[Estimate]:
    starts = []
    if options.guess is not None:
        guessed = [soften(np.eye(K)[options.guess.astype(int)])]
    else:
        guessed = [classes(rank, K) for rank in guesses(data, options.n_starts if K > 1 else 1, options.rng)]
    for shares in guessed:
        starts.append(Estimate(hard_start(K), _from_shares(kind, shares, data, fuzzy=False)))
    return starts


def _fit_hidden_hard(data: TrainingData, K: int, options: Options) -> Fitted:
    kind = _estimator(options, data)
    shares = np.eye(K)

    def search(rows: TrainingData, options: Options) -> Found:
        def joint(plain: TrainingData) -> Found:
            return _best(_hard_starts(kind, plain, K, options), shares, plain, options)

        return searched(joint, rows, options)

    def make(one: Estimate | Settled, seen: Posterior, rows: TrainingData) -> CGOMSModel:
        return hard_model(one, single_cells(seen.gamma, shares, rows), rows.scale, rows.further)

    found, posterior, trace, converged = search(data, options)
    estimate, posterior, training = served(found, posterior, search, make, shares, 0, data, options)
    model = make(estimate, posterior, data)
    bounds = active_constraint(estimate.gaussian, K)
    n_parameters = estimate.gaussian.n_parameters + K * (K - 1) + n_free(estimate.tilt)
    system = model.placed()
    notes = hidden_scarcity(posterior, shares) + bounds + instability(system)
    notes += stuck(posterior.gamma, system, data) + scant_data(n_parameters, data)
    notes += unfinished(converged, options.max_iter)
    return Fitted(
        model,
        log_likelihood(system, data),
        n_parameters,
        trace,
        converged,
        notes,
        posterior.gamma @ np.arange(K, dtype=np.float64),
        posterior.gamma,
        bool(bounds),
        training,
        Learned.of(None, 0, found, posterior, shares, data) if training is None else None,
    )


def _form(one: Estimate | Settled, rows: Evidence, scale: Scale, further: Further | None) -> GaussianForm:
    """Return the Gaussian part in the units of the data; ``rows`` holds the moments of nodes or regimes."""
    if further is None:
        return one.gaussian.form(rows, scale)
    assert isinstance(one.gaussian, RegressionEstimate)  # no other form has inputs or features
    return one.gaussian.driven_form(rows, scale, further, one.tilt)


def fuzzy_model(
    one: Estimate | Settled, rows: Evidence, scale: Scale, further: Further | None = None
) -> CGOFMSModel:
    """Return a fuzzy model in the units of the data; ``rows`` holds the moments of the nodes."""
    form = _form(one, rows, scale, further)
    return CGOFMSModel._from_form(one.law if isinstance(one, Settled) else one.chain.law(), form)


def hard_model(
    one: Estimate | Settled, rows: Evidence, scale: Scale, further: Further | None = None
) -> CGOMSModel:
    """Return a model of hard regimes in the units of the data; ``rows`` holds the moments of the regimes."""
    form = _form(one, rows, scale, further)
    transition = one.chain.transition
    try:
        initial = stationary_distribution(transition)
    except ParameterError:  # a regime that is never left: how often it was seen is all there is to say
        seen = rows.observation.weight @ rows.observation.shares
        initial = seen / seen.sum()
    return CGOMSModel._from_form(transition, form, initial)


def _best(starts: list[Estimate], shares: FloatArray, data: TrainingData, options: Options) -> Found:
    """Give every start a few iterations, and the best ones all they need."""
    trials = _trials(starts, shares, data, options)
    finished = []
    for estimate, posterior, trace, converged in trials[:FINALISTS]:
        if not converged and options.max_iter > TRIAL:
            far = options.tolerance < CREEP
            rest = options.max_iter - TRIAL
            estimate, posterior, more, converged = _run(estimate, shares, data, options, rest, accelerate=far)
            trace = trace + more[1:]
        finished.append((estimate, posterior, trace, converged))
    return _pushed(max(finished, key=lambda t: t[2][-1]), shares, data, options)


def _pushed(found: Found, shares: FloatArray, data: TrainingData, options: Options) -> Found:
    """Go on with inputs that act on the transitions, where there are some.

    Not from the start on: as long as nobody knows where the switch is, inputs explain its errors.
    """
    estimate, _, trace, _ = found
    tilt = no_tilt(data, shares.shape[1])
    if tilt is None:
        return found
    start = Estimate(estimate.chain, estimate.gaussian, tilt)
    far = options.tolerance < CREEP
    estimate, posterior, more, converged = _run(
        start, shares, data, options, options.max_iter, accelerate=far
    )
    return estimate, posterior, trace + more[1:], converged


def _trials(starts: list[Estimate], shares: FloatArray, data: TrainingData, options: Options) -> list[Found]:
    """Give every start, and the chains that the best one may have missed, a few iterations; best first."""
    trial = min(TRIAL, options.max_iter)
    trials = [_run(start, shares, data, options, trial) for start in starts]
    leader = max(trials, key=lambda t: t[2][-1])[0]
    trials += [
        _run(Estimate(chain, leader.gaussian), shares, data, options, trial)
        for chain in leader.chain.variants()
    ]
    return sorted(trials, key=lambda t: -t[2][-1])


def _run(
    start: Estimate,
    shares: FloatArray,
    data: TrainingData,
    options: Options,
    max_iter: int,
    *,
    accelerate: bool = False,
) -> Found:
    return run_em(
        start,
        shares,
        data,
        max_iter=max_iter,
        tolerance=options.tolerance,
        accelerate=accelerate,
        tick=options.tick,
    )
