"""What a directed fade buys, and where it buys nothing: the same series filtered under several laws.

The Gaussian part is that of the 2020 paper, and known.  A fade law is told how long the switch stays and
fades; all other laws are learned, on series of their own.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
)
from fuzzykf.errors import ParameterError
from fuzzykf.switching.dynamics.simulation import simulate_path
from fuzzykf.switching.laws.cells import CellLaw
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.learning.law import count_transitions

#: Series to filter, series to learn a law from, and steps of each.
RUNS, LESSONS, STEPS = 200, 40, 600

#: Mean number of steps at 0 or 1, and steps from one to the other.
DWELL, LENGTH = 40, 10

NODES = 5

#: Rate with which half of the fades turn back: each of the cells is left with NODES / LENGTH a step.
TURN_BACK = NODES / LENGTH * (2.0 ** (1.0 / NODES) - 1.0)

PAPER = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)


# --------------------------------------------------------------------------- the switch, and the series


def ramps(n, rng, length=LENGTH, turning=0.0):
    """Geometric stays; between them even steps to the other end, or half-way and back."""
    up, pieces, k = (np.arange(length) + 0.5) / length, [], int(rng.integers(2))
    forgotten = 10 * (DWELL + LENGTH)  # so that a series begins anywhere in a stay or a ramp
    while sum(map(len, pieces)) < forgotten + n:
        way = up if k == 0 else 1.0 - up
        back = rng.random() < turning
        if back:
            there = way[: rng.integers(1, length)]
            way = np.concatenate([there, there[::-1]])
        pieces += [np.full(rng.geometric(1.0 / DWELL), float(k)), way]
        k = k if back else 1 - k
    return np.concatenate(pieces)[forgotten : forgotten + n]


SWITCHES = {
    "ramps": ramps,
    "half of the ramps turn back": lambda n, rng: ramps(n, rng, turning=0.5),
    "jumps": lambda n, rng: ramps(n, rng, length=0),
    "FMC1 (.07, .05, .16)": PAPER.sample,
}


class Series(NamedTuple):
    """Series side by side, (runs, n)."""

    x: np.ndarray
    y: np.ndarray
    r: np.ndarray


def draw(model, switch, runs, *seed):
    rng = np.random.default_rng([list(SWITCHES).index(switch), *seed])
    paths = [SWITCHES[switch](STEPS, rng) for _ in range(runs)]
    drawn = [simulate_path(model.form, r, model.class_weights(r), rng) for r in paths]
    return Series(np.stack([d.x[:, 0] for d in drawn]), np.stack([d.y[:, 0] for d in drawn]), np.stack(paths))


# --------------------------------------------------------------------------- the laws


def told(switch):
    """Fade laws for the switch; where nothing fades, for what was expected in vain."""
    if switch.startswith("FMC1"):  # its durations, which have room for one cell; its jumps; nearly half turn
        dwell, length = PAPER.mean_dwell()[0], PAPER.mean_fade()
        jump, turn_back = PAPER.beta / PAPER.marginal_density(0.0), 1.0 / 3.0
    else:
        dwell, length, jump, turn_back = DWELL, LENGTH, 0.3 / DWELL, TURN_BACK
    return {
        "fades": FadeLaw.between(dwell, length),
        "fades, some jumps": FadeLaw.between(dwell, length, jump=jump),
        "fades, half turn back": FadeLaw.between(dwell, length, turn_back=turn_back),
    }


def with_law(model, law):
    return CGOFMSModel(law, model.form.means, model.form.covariances, 1)


def fuzzy(model, law):
    return OFSRFilter(with_law(model, law), law.nodes_up_to(NODES))


def likeliest(model, kind, y, start):
    """Law of largest likelihood of the observations, which needs no switch."""
    family = LAWS[kind]

    def law(logits):
        return family.from_logits(np.clip(logits, -12.0, 12.0))

    def loss(logits):
        return -fuzzy(model, law(logits)).filter_many(y, keep=("log_likelihood",)).log_likelihood.sum()

    starts = [np.clip(one.logits(), -8.0, 8.0) for one in (*start, family.start())]
    found = [minimize(loss, logits, method="Nelder-Mead", options={"maxfev": 250}) for logits in starts]
    return law(min(found, key=lambda one: one.fun).x)


def on_cells(r):
    """Number of the node nearest to a value: 0, the cells, 1."""
    return np.where(r < 1.0, np.ceil(np.nextafter(r * NODES, 0.0)), NODES + 1)


def learned_from_switch(kind, lesson):
    return LAWS[kind].by_name(5).likeliest([np.stack([1.0 - r, r], axis=1) for r in lesson.r], 5)


def hard(model, lesson):
    """Filter of the hard chain that is learned from the switch cut at 1/2."""
    cut = lesson.r > 0.5
    counts = count_transitions(cut[:, :-1].ravel(), cut[:, 1:].ravel(), 2)
    transition = counts / counts.sum(axis=1, keepdims=True)
    return CGOMSMFilter(CGOMSModel(transition, model.form.means, model.form.covariances, 1))


def all_filters(model, switch, lesson):
    filters = {name: fuzzy(model, law) for name, law in told(switch).items()}
    for kind in ("fmc1", "fmc2"):
        try:
            known = [learned_from_switch(kind, lesson)]
        except ParameterError:  # FMC2 has no steps of 1/2
            known = []
        filters |= {f"{kind.upper()}, learned from the switch": fuzzy(model, law) for law in known}
        filters[f"{kind.upper()}, likeliest for y"] = fuzzy(model, likeliest(model, kind, lesson.y, known))
    cells = on_cells(lesson.r)
    joint = count_transitions(cells[:, :-1].ravel(), cells[:, 1:].ravel(), NODES + 2)
    filters["any chain on the nodes"] = fuzzy(model, CellLaw(joint))
    return filters | {"hard": hard(model, lesson)}


# --------------------------------------------------------------------------- what they find


class Errors(NamedTuple):
    """Squared errors, one a series."""

    state: np.ndarray
    switch: np.ndarray
    smoothed: np.ndarray | None = None


def errors(f, data, *, smooth=False):
    found = f.filter_many(data.y, keep=("x", "class_weights"))
    state = np.mean((found.x[..., 0] - data.x) ** 2, axis=1)
    switch = np.mean((found.class_weights[..., 1] - data.r) ** 2, axis=1)
    if not smooth:
        return Errors(state, switch)
    smoothed = np.stack([f.smooth(y).x[:, 0] for y in data.y])
    return Errors(state, switch, np.mean((smoothed - data.x) ** 2, axis=1))


def bounds(model, data):
    """What knows nothing but the mean, and what knows the switch.

    Beyond Y_n and the switch, later observations tell nothing of X_n: then the smoother is the filter.
    """
    told_x = KnownSwitchFilter(model).filter_many(data.y, keep=("x",), r=data.r).x[..., 0]
    found = [(0.0, 0.5), (told_x, data.r)]  # the means of X are zero
    return {
        name: Errors(*(np.mean(e**2, axis=1) for e in (x - data.x, r - data.r, x - data.x)))
        for name, (x, r) in zip(("no filter", "known switch"), found, strict=True)
    }


def standard_error(values):
    return values.std(ddof=1) / np.sqrt(len(values))


@pytest.mark.parametrize(
    ("switch", "runs", "order"),
    [
        ("ramps", 20, ["fades", "fmc1", "hard"]),
        ("half of the ramps turn back", 40, ["fades, half turn back", "fades"]),
        ("jumps", 10, ["hard", "fades, some jumps", "fades"]),
        ("FMC1 (.07, .05, .16)", 10, ["fmc1", "fades, some jumps", "fades"]),
    ],
)
def test_the_law_that_is_true_or_nearer_has_the_smaller_error(paper_model, switch, runs, order):
    # from a fixed seed, and the same series for all, so that their differences count
    model = paper_model(0.16)
    data, lesson = draw(model, switch, runs, 0), draw(model, switch, 5, 1)
    filters = {name: fuzzy(model, law) for name, law in told(switch).items() if name in order}
    filters["hard"] = hard(model, lesson)
    if "fmc1" in order:
        filters["fmc1"] = fuzzy(model, learned_from_switch("fmc1", lesson))
    found = [errors(filters[name], data).state for name in order]
    for better, worse in pairwise(found):
        assert np.mean(worse - better) > 2.0 * standard_error(worse - better)


@pytest.mark.study
def test_what_a_directed_fade_buys(paper_model, write_table):
    model = paper_model(0.16)
    found = {}
    for switch in SWITCHES:
        data, lesson = draw(model, switch, RUNS, 2), draw(model, switch, LESSONS, 3)
        filters = all_filters(model, switch, lesson)
        found[switch] = {n: errors(f, data, smooth=switch == "ramps") for n, f in filters.items()}
        found[switch] |= bounds(model, data)

    def mean(values):
        return f"{values.mean():.3f} ({standard_error(values):.3f})"

    def more(values, than):
        if values is than:
            return ""
        difference = round(float(np.mean(values - than)), 4) + 0.0  # no minus before zero
        return f"{difference:+.4f} ({standard_error(values - than):.4f})"

    on_ramps = found["ramps"]
    base = on_ramps["fades"]
    rows = [
        [
            name,
            mean(e.state),
            more(e.state, base.state),
            mean(e.smoothed),
            more(e.smoothed, base.smoothed),
            f"{np.sqrt(e.switch.mean()):.3f}" if name != "known switch" else "",
        ]
        for name, e in on_ramps.items()
    ]
    write_table("fades", ["law", "filter", "beyond fades", "smoother", "beyond fades", "switch"], rows)

    others = [switch for switch in SWITCHES if switch != "ramps"]
    rows = []
    for name in on_ramps:
        cells = []
        for states in ({n: e.state for n, e in found[switch].items()} for switch in others):
            there = name in states
            cells += [mean(states[name]), more(states[name], states["hard"])] if there else ["", ""]
        rows.append([name, *cells])
    header = [text for switch in others for text in (switch, "beyond hard")]
    write_table("fades_elsewhere", ["law", *header], rows)

    def loses(switch, name, to):
        difference = found[switch][name].state - found[switch][to].state
        return difference.mean() > 3.0 * standard_error(difference)

    fmc1, fmc2 = "FMC1, learned from the switch", "FMC2, likeliest for y"
    assert all(loses("ramps", n, "fades") for n in on_ramps if n not in ("fades", "known switch"))
    assert loses("ramps", "hard", fmc1)
    assert base.state.mean() <= 0.470
    assert np.mean(base.smoothed) < np.mean(on_ramps[fmc2].smoothed) < np.mean(on_ramps["hard"].smoothed)
    assert loses("half of the ramps turn back", "fades", "fades, half turn back")
    assert loses("jumps", "fades", "hard")
    assert loses("jumps", "fades, some jumps", "hard")
    for name in told("FMC1"):
        assert loses("FMC1 (.07, .05, .16)", name, fmc1)
