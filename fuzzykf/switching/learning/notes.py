"""What the data cannot support, in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.switching.laws.learners import FreeChain
from fuzzykf.switching.learning.data import component
from fuzzykf.switching.learning.em import Estimate, Posterior, run_em
from fuzzykf.switching.learning.vine import VineEstimate
from fuzzykf.switching.models.fuzzy import N_PROOF
from fuzzykf.texts import counted, listed

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.labels import Labels
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.laws.base import Law
    from fuzzykf.switching.laws.chain import SwitchChain
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.gaussians import GaussianEstimate

__all__ = [
    "active_constraint",
    "hidden_scarcity",
    "instability",
    "known_scarcity",
    "left_for_good",
    "no_shorter",
    "one_name",
    "proof_values",
    "scant_data",
    "scant_statistics",
    "scarcity",
    "stability_radius",
    "stuck",
    "too_gradual",
    "unfinished",
    "unlike",
    "ways",
]

#: A regime, or a pair, with less than this many observations is reported.
SCARCE = 5.0

#: A known switch that turns back in more of its steps between classes is said to.
RESTLESS = 0.2

#: A regime that has less than this share, in the long run, of what it has in the data is said to be left.
RARELY = 0.05

#: A learned length is at its bound if it is above by no more than this share.
AT_BOUND = 0.05

#: Where the noise of the state has less than this share of that elsewhere, it is reported.
VANISHING = 1e-3

#: Fewer measured numbers a free parameter than these, and a model may have learned noise: see `scant_data`.
NUMBERS = 6.0

#: So many equal values one after the other are a stretch in which nothing moves.
STRETCH = 5

#: Values are equal if they differ by no more than so many gaps between doubles of the size of the column
#: (1.5e-11 of it), and no more than this share of its standard deviation: far from zero that may be noise.
GAPS, STILL = 65_536.0, 1e-6

#: A regime whose noise has less than this share of the variance of the data has collapsed, if this share of
#: the steps in which it stays is in such stretches.
COLLAPSED, WITHIN = 1e-3, 0.5

#: Least share of hard values under FMC1.
LEAST_HARD = 0.375

#: Where FMC1 is learned to be hard in less than this share of the data, a chain without a law is tried.
SUSPECT = 0.6

#: Iterations of this trial.
PROBE = 60

#: Probability that FMC1 is suspected though it is true.
LEVEL = 0.01


def proof_values(K: int, *, fuzzy: bool) -> FloatArray:
    """Return the values of the switch at pairs of which a model has to be valid."""
    if not fuzzy:
        return np.arange(K, dtype=np.float64)
    return np.concatenate([[0.0], (np.arange(N_PROOF) + 0.5) / N_PROOF, [1.0]])


def ways(chain: SwitchChain) -> BoolArray:
    """Return which pairs of regimes have a part in a step that is possible, (K, K)."""
    shares = chain.class_weights
    found: BoolArray = shares.T @ (chain.transition != 0.0) @ shares > 0.0
    return found


def unlike(start: Law, learned: Law, shares: FloatArray) -> list[str]:
    """Say what a known switch never did that its law of fades has, or did as fades do not.

    Laws of other families have no such numbers.
    """
    numbers, before = learned.numbers(), start.numbers()
    notes = []
    for name, length in numbers.items():
        way = name.removeprefix("length ")
        a = int(way.split(" ")[0]) if name.startswith("length ") else 0
        often = before.get(f"rate {way}", 0.0) and (shares[:, a] == 1.0).any()
        if name.startswith("length ") and length == before[name] and often:
            notes.append(f"r has no fade from {way}; its length is that of the given law")
    if numbers.get("turn_back", 0.0) > RESTLESS:
        notes.append(
            f"r turns back in {numbers['turn_back']:.2g} of its steps between classes, which may be noise: "
            "FadeLaw counts each change of direction as a turn; smooth r, or omit it"
        )
    return notes


def left_for_good(chain: SwitchChain, weights: FloatArray) -> list[str]:
    """Say of which regimes there is much in the data, but next to nothing in the long run of the law.

    Parameters
    ----------
    chain : SwitchChain
        Stationary.
    weights : ndarray, shape (N, K)
        Shares of the regimes in the rows.
    """
    long_run, seen = chain.initial @ chain.class_weights, weights.mean(axis=0)
    return [
        f"the switch hardly ever returns to regime {k}, which has a share of {seen[k]:.2g} of the rows, but "
        f"{long_run[k]:.1g} in the stationary law: filters start from the stationary law, so they do not "
        "expect this regime; use data in which it recurs"
        for k in np.flatnonzero((seen * len(weights) >= SCARCE) & (long_run < RARELY * seen))
    ]


def no_shorter(law: Law, n_nodes: int) -> list[str]:
    """Say which fades are learned to be as short as their nodes allow."""
    bound = [
        name.removeprefix("length ")
        for name, value in law.numbers().items()
        if name.startswith("length ") and value < n_nodes * (1.0 + AT_BOUND)
    ]
    if not bound:
        return []
    return [
        f"the fade{'s' if len(bound) > 1 else ''} from {listed(bound)} cannot be shorter than "
        f"n_nodes = {n_nodes} steps; use fewer nodes, or jumps"
    ]


def scarcity(
    visits: FloatArray, pairs: FloatArray, state_pairs: FloatArray, possible: BoolArray | None = None
) -> list[str]:
    """Say which regimes and pairs of regimes the data hardly visit, or hardly with the state measured.

    Parameters
    ----------
    visits, pairs : ndarray, shapes (K,) and (K, K)
        Total shares of the regimes in the data, and of pairs of regimes in the steps.
    state_pairs : ndarray, shape (K, K)
        The latter in the steps from which the state can be learned.
    possible : ndarray of bool, shape (K, K), optional
        Pairs that the law has; of others nothing is said.
    """
    found = []
    K = len(visits)
    for k in range(K):
        if visits[k] < SCARCE:
            found.append(f"regime {k} is rarely visited (total weight {visits[k]:.3g} observations)")
    for i in range(K):
        for j in range(K):
            there = (possible is None or possible[i, j]) and min(visits[i], visits[j]) >= SCARCE
            if there and pairs[i, j] >= SCARCE > state_pairs[i, j]:
                found.append(
                    f"the state is rarely measured in the pair of regimes ({i}, {j}) (total weight "
                    f"{state_pairs[i, j]:.3g} steps); its parameters there are those of the other pairs"
                )
            if there and pairs[i, j] < SCARCE:
                found.append(
                    f"the pair of regimes ({i}, {j}) rarely occurs (total weight {pairs[i, j]:.3g} "
                    f"steps); its "
                    "parameters are those of the other pairs"
                )
    return found


def known_scarcity(shares: FloatArray, data: TrainingData, possible: BoolArray | None = None) -> list[str]:
    """Say what the data hardly visit, the shares of the regimes being known."""
    before, after = shares[data.before], shares[data.after]
    with_state = before[data.has_state].T @ after[data.has_state]
    return scarcity(shares.sum(axis=0), before.T @ after, with_state, possible)


def hidden_scarcity(posterior: Posterior, shares: FloatArray, possible: BoolArray | None = None) -> list[str]:
    """Say what the data hardly visit, as far as the posterior knows."""
    visits = posterior.gamma.sum(axis=0) @ shares
    with_state = shares.T @ posterior.state_pairs @ shares
    return scarcity(visits, shares.T @ posterior.pairs @ shares, with_state, possible)


def active_constraint(estimate: GaussianEstimate, K: int) -> list[str]:
    """Say where positive definiteness stopped the covariance form, or its noise is about to vanish."""
    if not isinstance(estimate, VineEstimate):
        return []
    share = estimate.noise_share(estimate.proof)
    if not estimate.bounded and share.min() >= VANISHING * share.max():
        return []
    first, second = np.unravel_index(int(np.argmin(share)), (round(len(share) ** 0.5),) * 2)
    values = proof_values(K, fuzzy=len(share) > K * K)
    return [
        "the constraint is active: positive definiteness bounds the parameters; at the values "
        f"({values[first]:.3g}, {values[second]:.3g}) of the switch, the variance of the state noise is "
        f"{share.min() / share.max():.2g} of that elsewhere; consider form='regression', which has no such "
        "bound"
    ]


def scant_data(n_parameters: int, data: TrainingData) -> list[str]:
    """Say that there are too few rows for so many parameters.

    That is, less than `NUMBERS` measured numbers (rows times components, but for missing states) a
    parameter.  Two hidden regimes
    were learned from two regimes, one state and one observation, 44 parameters: learned from 120 rows, 5.5
    numbers a parameter, they described later rows worse than one regime in 11 of 12 series; from 200 rows in
    3 of 12; from 300 in none.

    The rule counts, so there is no chance in it: from 300 rows on, one state and one observation with up
    to three regimes, or a free law, are never named.
    """
    rows, d = data.z.shape
    if data.n_measured >= NUMBERS * n_parameters:
        return []
    enough = int(np.ceil(NUMBERS * n_parameters / d))
    if not data.is_complete:
        return [
            f"{rows} rows, in {int(data.known.sum())} of which the state is measured, hold {data.n_measured} "
            f"numbers: few for {n_parameters} parameters, which may overfit; expected at least "
            f"{int(np.ceil(NUMBERS * n_parameters))} numbers, or fewer regimes"
        ]
    return [
        f"{rows} rows of {d} numbers are few for {n_parameters} parameters, which may overfit; expected at "
        f"least {enough} rows, or fewer regimes"
    ]


def scant_statistics(n_parameters: int, n_numbers: float) -> list[str]:
    """Say that the rows which count, each by its weight, hold too few numbers; see `scant_data`."""
    if n_numbers >= NUMBERS * n_parameters:
        return []
    return [
        f"new rows and discounted earlier rows count as {n_numbers:.0f} measured numbers, few for "
        f"{n_parameters} parameters, which may overfit; expected at least "
        f"{int(np.ceil(NUMBERS * n_parameters))}: more rows, or forget closer to 1"
    ]


def stuck(weights: FloatArray, system: SwitchingSystem, data: TrainingData) -> list[str]:
    """Say which regimes have collapsed onto a stretch of data in which a component is constant.

    The likelihood of a constant grows without bound as the noise vanishes, so a stuck sensor draws a regime
    to itself.  Such a regime has next to no noise in a component, and it is mostly in stretches of at least
    `STRETCH` equal values of this component that it stays.  Values are equal if they are so but for the last
    digits of double precision, as those of a stuck sensor are after a change of units.

    Data without such stretches are never named, and rounded ones seldom have any: of 500 fits to healthy
    series of 300 rows, half of them rounded to a tenth, none was (two or three hard regimes 400, fuzzy
    switches 100).

    Parameters
    ----------
    weights : ndarray, shape (N, M)
        Probability of each node at each row of the data.
    system : SwitchingSystem
    data : TrainingData
    """
    notes = []
    pairs, chain = system.pair_tables(0).pairs, system.chain
    for k in range(chain.class_weights.shape[1]):
        node = int(np.argmax(chain.class_weights[:, k]))
        noise = np.concatenate([np.diagonal(pairs.C[node, node]), np.diagonal(pairs.Qyy[node, node])])
        share = noise / data.scale.std**2
        stays = np.zeros(len(data.z) + 1)  # how likely it stays from the row before to this one
        stays[data.after] = weights[data.before, node] * weights[data.after, node]
        found: dict[str, list[str]] = {}
        for column in np.flatnonzero(share < COLLAPSED).tolist():
            stretches = _constant_stretches(data, column)
            inside = [float(stays[first + 1 : last + 1].sum()) for first, last in stretches]
            seen = (
                data.after[data.has_state] if column < data.dim_x else data.after
            )  # what it is learned from
            if sum(inside) < max(WITHIN * float(stays[seen].sum()), 1.0):
                continue
            first, last = stretches[int(np.argmax(inside))]
            others = sum(one >= 1.0 for one in inside) - 1
            rows = f"{data.kept[first]} to {data.kept[last]}"
            rows += f" and {others} other stretch{'es' if others > 1 else ''}" if others > 0 else ""
            value = data.z[first, column] * data.scale.std[column] + data.scale.mean[column]
            apart = float(np.ptp(data.z[first : last + 1, column])) * data.scale.std[column]
            but = f", up to {apart:.1g}" if apart else ""
            told = f"{component(column, data.dim_x)} is constant ({value:.6g}{but})"
            found.setdefault(rows, []).append(
                f"{told} and its noise {share[column]:.1g} of the variance of the data"
            )
        notes += [
            f"regime {k} has collapsed onto the rows {rows}, in which {', '.join(told)}; if a sensor was "
            "stuck there, make its values missing (NaN)"
            for rows, told in found.items()
        ]
    return notes


def _constant_stretches(data: TrainingData, column: int) -> list[tuple[int, int]]:
    """Return the first and last rows of the stretches of equal values of a column."""
    mean, std = data.scale.mean[column], data.scale.std[column]
    gap = np.spacing(abs(mean) + std * np.nan_to_num(np.abs(data.z[:, column]), nan=0.0).max())
    near = min(GAPS * gap / std, STILL)
    equal = np.zeros(len(data.z) + 1, dtype=bool)  # whether a row equals the one before it
    equal[data.after] = np.abs(data.z[data.after, column] - data.z[data.before, column]) <= near
    edges = np.flatnonzero(np.diff(np.concatenate([[False], equal]).astype(int)))
    runs = [(int(begin) - 1, int(end) - 1) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
    return [(first, last) for first, last in runs if last - first + 1 >= STRETCH]


def stability_radius(system: SwitchingSystem) -> float:
    """Spectral radius of the transition-weighted Axx: the error of the state filter grows from 1 on."""
    Axx, P = system.pair_tables(0).pairs.Axx, system.chain.transition
    M, m = len(P), Axx.shape[-1]
    twice = np.einsum("ij,ijkl,ijrs->jkrils", P, Axx, Axx).reshape(M * m * m, M * m * m)
    return float(np.abs(np.linalg.eigvals(twice)).max())


def instability(system: SwitchingSystem) -> list[str]:
    """Say whether the error of the state filter grows."""
    radius = stability_radius(system)
    if radius < 1.0:
        return []
    return [
        f"the state filter is unstable: its error variance grows by the factor {radius:.4g} per step, "
        f"because "
        "observations do not correct earlier states; state_feedback=False learns a state that does not "
        "depend "
        "on the previous one and cannot drift"
    ]


def one_name(labels: Labels) -> list[str]:
    """Say that a state and an observation are called alike, so that their names tell nothing apart.

    Examples
    --------
    >>> from fuzzykf.labels import Labels
    >>> one_name(Labels(["load"], ["t"]))
    []
    >>> one_name(Labels(["Nord"], ["Nord"]))[0][:53]
    "a state and an observation are both called 'Nord': a "
    """
    both = [name for name in labels.states or () if name in (labels.observations or ())]
    if not both:
        return []
    return [
        f"a state and an observation are both called {listed([repr(name) for name in both])}: a filter "
        f"cannot "
        "detect that the state is passed as the observation; rename one of them, in the data or by "
        "model.labelled(states=...)"
    ]


def unfinished(converged: bool, max_iter: int) -> list[str]:
    """Say that the search was cut short."""
    if converged:
        return []
    return [f"not converged after {counted(max_iter, 'iteration')}; raise max_iter or tolerance"]


def too_gradual(estimate: Estimate, shares: FloatArray, data: TrainingData) -> list[str]:
    """Say whether a hidden switch is less often hard than FMC1 allows.

    It is, if FMC1 itself was learned at its bound.  Short of that the Gaussian part can make
    up for a wrong law; so, where FMC1 is hard in less than `SUSPECT` of the data, learning goes
    on a little with any chain in its place.  That chain is believed if the likelihood rises
    by more than chance explains (a likelihood-ratio test).

    Parameters
    ----------
    estimate : Estimate
        What was learned with FMC1.
    shares : ndarray, shape (M, 2)
    data : TrainingData
    """
    from scipy.special import gammainccinv

    law = estimate.chain.law()
    if law.p_hard < LEAST_HARD + 0.02:
        return [
            f"p_hard is {law.p_hard:.3g}, at the bound 3/8 of FMC1: the switch seems to be more gradual than "
            "FMC1 can be; consider 'fmc2' or 'free'"
        ]
    if law.p_hard >= SUSPECT:
        return []
    start = Estimate(
        FreeChain(shares, estimate.chain.initial[:, None] * estimate.chain.transition), estimate.gaussian
    )
    found, posterior, trace, _ = run_em(start, shares, data, max_iter=PROBE, tolerance=1e-5, accelerate=True)
    hard = float(posterior.gamma[:, [0, -1]].sum() / posterior.gamma.sum())
    more = found.chain.n_parameters - estimate.chain.n_parameters
    chance = 2.0 * float(gammainccinv(0.5 * more, LEVEL))  # of a chi-squared variable
    if hard >= LEAST_HARD or 2.0 * (trace[-1] - trace[0]) <= chance:
        return []
    return [
        f"the switch seems to be hard in {hard:.2g} of the data, but at least in 3/8 under FMC1: a free "
        f"chain "
        "fits significantly better; consider 'fmc2' or 'free'"
    ]
