"""Chains with negative weights and vectors of which a part is missing, against the enumeration of all paths.

The sums over paths hold with signs as they do without.  Where an answer is exact it agrees to rounding; else
the error is that of moment matching, as for other chains (`test_gaps`), and not of the signs.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter, SwitchChain
from fuzzykf.errors import QuadratureError
from fuzzykf.switching import SwitchingFilter

N = 5
TOLERANCE = {"rtol": 1e-8, "atol": 1e-9}


def model(m, law=(0.15, 0.16, 0.45)):
    """Two classes that differ in mean and spread, of m states and two observations that are coupled."""
    rng = np.random.default_rng(5)
    d = m + 2
    root = np.eye(d) + 0.15 * rng.normal(size=(2, d, d))
    z = root @ np.swapaxes(root, 1, 2)
    A = 0.4 * np.eye(d) + 0.15 * rng.normal(size=(d, d))
    pairs = [[np.block([[z[i], z[i] @ A.T], [A @ z[i], z[j]]]) for j in range(2)] for i in range(2)]
    return CGOFMSModel(FuzzyMarkovLaw.fmc2(*law), 2.0 * rng.normal(size=(2, d)), pairs, m)


def on_chain(m, nodes, initial, transition):
    chain = SwitchChain(nodes, np.ones(len(nodes)), initial, transition)
    return SwitchingFilter(model(m).form.placed(chain))


def three_nodes(negative):
    """A filter of one state; from one class to the other leads a weight below zero by so much."""
    to_other = [[0.75, 0.25 + negative, -negative], [0.3, 0.35, 0.35], [-negative, 0.2, 0.8 + negative]]
    return on_chain(1, [0.0, 0.5, 1.0], [0.5, 0.1, 0.4], to_other)


#: Filters on chains with negative weights, and how long a series can be enumerated.
FILTERS = {
    "three nodes": lambda: (three_nodes(0.01), N),
    "two states": lambda: (
        on_chain(
            2, [0.0, 0.3, 1.0], [0.5, 0.1, 0.4], [[0.7, 0.3, 0.0], [0.3, 0.7, 0.0], [-0.002, 0.2, 0.802]]
        ),
        N,
    ),
    "the rule product": lambda: (OFSRFilter(model(1), 7, "product"), 4),
}

#: Holes, as times or times and components; whether all that the smoother says is exact then.
HOLES = {
    "nothing": ([], True),
    "a part of the first": ([(0, 0)], True),
    "a part of the last": ([(-1, 1)], True),
    "the last": ([-1], True),
    "one part": ([(2, 0)], True),
    "all of one": ([2], True),
    "one part, then another": ([(0, 0), (2, 1)], True),
    "parts in a row": ([(1, 0), (2, 1), (3, 1)], False),
    "one component": ([(k, 1) for k in range(-1, 3)], False),
    "a part, then all": ([(1, 1), 2], False),
    "all, then a part": ([1, (2, 0)], False),
}

#: Twice the largest errors over all chains, holes and series, rounded up; they are of order one where what is
#: known of a window has the rounding of a root in place of zeros.
BOUNDS = {"x": 7e-5, "P": 7e-5, "mu": 5e-5}


def observations(f, n, seed, holes):
    ys = model(f.dim_x).simulate(n, np.random.default_rng(seed)).y
    for hole in holes:
        ys[hole] = np.nan
    return ys


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("holes", HOLES)
def test_the_smoother_of_a_signed_chain_in_gaps(name, holes, enumerate_paths):
    f, n = FILTERS[name]()
    assert f._system.chain.is_signed
    where, is_exact = HOLES[holes]
    worst = dict.fromkeys(BOUNDS, 0.0)
    for seed in range(2):
        ys = observations(f, n, seed, where)
        truth = enumerate_paths(f._system, ys)
        result = f.smooth(ys, keep_nodes=True)
        if is_exact:
            for field, expected in (("x", truth.mean), ("P", truth.covariance), ("mu", truth.probability)):
                np.testing.assert_allclose(getattr(result, field), expected, err_msg=field, **TOLERANCE)
            continue
        variance = np.einsum("nkk->nk", truth.covariance)
        scale = np.sqrt(variance[:, :, None] * variance[:, None])
        errors = {
            "x": np.abs(result.x - truth.mean) / np.sqrt(variance),
            "P": np.abs(result.P - truth.covariance) / scale,
            "mu": np.abs(result.mu - truth.probability),
        }
        worst = {field: max(value, errors[field].max()) for field, value in worst.items()}
        assert (np.linalg.eigvalsh(result.P) > 0.0).all()
        np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-9)
    for field, bound in BOUNDS.items():
        assert worst[field] < bound, worst


@pytest.mark.parametrize("holes", ["parts in turn", "one component and more"])
def test_a_long_series_is_what_a_rule_without_signs_makes_of_it(holes):
    # 25 cells are off by 1 %, as much as they are where nothing is missing
    law = model(1)
    ys = law.simulate(20, np.random.default_rng(3)).y
    if holes == "parts in turn":
        ys[::2, 0], ys[1::2, 1] = np.nan, np.nan
    else:
        ys[:, 0], ys[4:18:5] = np.nan, np.nan
    signed, cells = OFSRFilter(law, 9, "product").smooth(ys), OFSRFilter(law, 25).smooth(ys)
    np.testing.assert_allclose(signed.P, cells.P, rtol=0.01)
    np.testing.assert_allclose(signed.x, cells.x, atol=0.01)


# --------------------------------------------------------------------------- what is no law

NONE = np.nan
#: Series after which a weight of -.002 leaves no law: where it shows, and what is said.
REFUSED = {
    "filter": (
        [[-2.6, 1.6], [NONE, NONE], [-6.7, -4.9], [NONE, -1.9], [-2.8, NONE], [NONE, 2.2]],
        "a pair of nodes that gives the observation no density",
    ),
    "smooth": (
        [[-0.5, NONE], [-10.1, -2.7], [NONE, -2.3], [-4.2, 1.0], [-0.1, -2.7], [NONE, -0.1]],
        r"a negative mass of 0\.0\d+ \(at most 0\.01 is tolerated\)",
    ),
}


@pytest.mark.parametrize("where", REFUSED)
def test_what_negative_weights_have_made_no_law_is_refused_and_the_filter_as_it_was(where):
    ys, what = REFUSED[where]
    f = three_nodes(0.002)
    f.filter([[0.1, 0.2], [0.3, NONE]])
    before = f.x, f.P, f.mu, f.log_likelihood
    calls = [f.smooth, f.filter, lambda ys: f.filter_many([ys])] if where == "filter" else [f.smooth]
    for call in calls:
        with pytest.raises(QuadratureError, match=f"the rule 'product'.* {what}; use more nodes or the rule"):
            call(ys)
        for now, was in zip((f.x, f.P, f.mu, f.log_likelihood), before, strict=True):
            np.testing.assert_array_equal(now, was)
    if where == "smooth":
        f.filter(ys)  # which is a law all the time


def test_a_step_that_is_refused_leaves_the_filter_as_it_was():
    ys, what = REFUSED["filter"]
    f = three_nodes(0.002)
    f.filter(ys[:-1])
    before = f.x, f.P, f.mu
    with pytest.raises(QuadratureError, match=what):
        f.step(ys[-1])
    for now, was in zip((f.x, f.P, f.mu), before, strict=True):
        np.testing.assert_array_equal(now, was)
    f.step(None)
