"""The log-likelihood of switching state-space models as a function of free numbers, and its gradient."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fuzzykf import (
    FadeLaw,
    FuzzyMarkovLaw,
    GraphLaw,
    SwitchChain,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.errors import FuzzykfError
from fuzzykf.switching.learning.state_space.data import read_data
from fuzzykf.switching.learning.state_space.problem import SpaceProblem, read_free_numbers

LAW = FadeLaw.between(20, 6, jump=0.01)

#: Two classes, in which everything has a part.
EACH = {
    "F": [[[0.7]], [[0.5]]],
    "H": [[[1.0]], [[0.4]]],
    "Q": 0.09,
    "R": [[[0.04]], [[0.36]]],
    "b": [0.1],
    "d": [[0.0], [2.0]],
    "B": [[[1.0, 0.5]], [[0.3, 0.2]]],
}

#: Two states, two observations; correlated noise.
PLANE = {
    "F": [[0.8, 0.3], [-0.2, 0.6]],
    "H": [[[1.0, 0.0], [0.0, 1.0]], [[0.5, 0.1], [0.0, 1.5]]],
    "Q": [[[0.3, 0.1], [0.1, 0.2]], [[0.1, -0.05], [-0.05, 0.4]]],
    "R": [[[0.4, 0.2], [0.2, 0.5]], [[1.4, -0.2], [-0.2, 0.3]]],
}

ALL = dict.fromkeys(("F", "H", "Q", "R", "b", "d"), "full")

CASES = {
    "stationary": (dict(EACH, law=LAW, mix="log"), ALL | {"B": "full", "law": True}),
    "stationary covariance": (dict(EACH, law=LAW, x0=[1.0]), ALL | {"x0": "full", "law": True}),
    "stationary mean": (dict(EACH, law=LAW, P0=[[[0.5]], [[1.0]]]), ALL | {"P0": "full", "law": True}),
    "given, linear": (
        dict(EACH, law=LAW, x0=[[1.0], [2.0]], P0=[[[0.5]], [[1.0]]]),
        ALL | {"x0": "full", "P0": "full", "law": True},
    ),
    "begun in a class": (dict(EACH, law=LAW, initial=[0.2, 0.8]), ALL | {"law": True}),
    "a plane": (dict(PLANE, law=LAW, mix="log"), ALL | {"law": True}),
    "a plane, linear": (
        dict(PLANE, law=LAW),
        {"Q": ("scale", PLANE["Q"]), "R": "full", "F": np.eye(2, dtype=bool)},
    ),
    "hard": (dict(EACH, law=[[0.9, 0.1], [0.2, 0.8]]), {"R": "full", "law": True}),
    "hard, begun anywhere": (
        dict(EACH, law=SwitchChain.from_classes([[0.9, 0.1], [0.2, 0.8]], [0.3, 0.7])),
        {"d": "full", "law": True},
    ),
    "fmc1": (dict(EACH, law=FuzzyMarkovLaw.fmc1(0.25, 0.05, 0.08)), {"R": "full", "law": True}),
    "three classes": (
        {
            "F": 0.5,
            "H": 1.0,
            "Q": 0.1,
            "R": np.array([0.1, 0.5, 2.0])[:, None, None],
            "law": GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.5, (1, 2): 0.5}, jumps={(0, 2): 0.1}),
        },
        {"R": "full", "law": True},
    ),
    "one class": (dict(PLANE, law=[[1.0]], H=np.eye(2), Q=0.3 * np.eye(2), R=np.eye(2)), ALL),
    "functions are held": (dict(EACH, law=LAW, H=lambda w: [[1.0 - 0.6 * w[1]]]), {"R": "full", "law": True}),
}


def problem(case, *, xs=None, n=25):
    """Two series, with gaps, of which the second one is shorter."""
    arguments, free = CASES[case]
    arguments = dict(arguments)
    model = SwitchingStateSpace(arguments.pop("law"), **arguments)
    rng = np.random.default_rng(5)
    us = None if model.dim_u is None else rng.normal(size=(n, 2))
    truth = model.simulate(n, rng, us=us)
    zs = truth.y.copy()
    zs[5:8] = np.nan
    zs[9, 0] = np.nan
    if xs is not None:
        xs = np.where(rng.random(truth.x.shape) < xs, truth.x, np.nan)
        xs = [xs, xs[:10]]
    data = read_data(model, [zs, zs[:10]], xs, None if us is None else [us, us[:10]])
    return SpaceProblem(model, 2, data, read_free_numbers(model, free, 2, data))


def somewhere(one):
    spread = np.where(one.free.is_variance, 0.3, 0.05)
    return one.free.start + spread * np.random.default_rng(2).normal(size=len(one.free.names))


@pytest.mark.parametrize("xs", [None, 0.5], ids=["hidden", "half measured"])
@pytest.mark.parametrize("case", CASES)
def test_the_gradient_is_that_of_differences(case, xs):
    one = problem(case, xs=xs)
    numbers = somewhere(one)
    value, gradient = one.log_likelihood(numbers)
    assert np.isfinite(value)
    ways = np.random.default_rng(1).normal(size=(4, len(numbers)))
    for way in ways:
        ahead, behind = (one.log_likelihood(numbers + step * way)[0] for step in (1e-5, -1e-5))
        assert gradient @ way == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_the_value_is_that_of_the_filter(case):
    one = problem(case)
    numbers = somewhere(one)
    f = SwitchingKalmanFilter(one.model_of(one.free.values(numbers)), n_nodes=2)
    total = sum(float(f.filter(ys, us=us).log_likelihood.sum()) for ys, us in one.data.series)
    assert one.log_likelihood(numbers)[0] == pytest.approx(total, rel=1e-11)


# --------------------------------------------------------------------------- measured states


def test_measured_states_and_one_class_are_jointly_gaussian():
    """All states and observations of a short series have one normal law, of which parts are seen."""
    n = 10
    one = problem("one class", xs=0.5, n=n)
    system = one.model.placed(0)
    F, b, Q, H, d, R = (getattr(system.tables, name)[0] for name in "FbQHdR")
    means, covariance = [system.first.mean[0, :2]], np.zeros((2 * n, 2 * n))
    covariance[:2, :2] = system.first.covariance[0, :2, :2]
    for k in range(1, n):
        means.append(F @ means[-1] + b)
        old, new = slice(2 * k - 2, 2 * k), slice(2 * k, 2 * k + 2)
        covariance[new, : 2 * k] = F @ covariance[old, : 2 * k]
        covariance[: 2 * k, new] = covariance[new, : 2 * k].T
        covariance[new, new] = F @ covariance[old, old] @ F.T + Q
    look = np.kron(np.eye(n), np.concatenate([np.eye(2), H]))
    noise = np.kron(np.eye(n), np.block([[np.zeros((2, 4))], [np.zeros((2, 2)), R]]))
    mean = look @ np.ravel(means) + np.tile([0.0, 0.0, *d], n)
    S = look @ covariance @ look.T + noise
    expected = 0.0
    for ys, _ in one.data.series:
        seen = np.flatnonzero(~np.isnan(ys.ravel()))
        law = multivariate_normal(mean[seen], S[np.ix_(seen, seen)])
        expected += float(law.logpdf(ys.ravel()[seen]))
    assert one.scored(one.free.start)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("case", ["hard", "stationary", "fmc1"])
def test_a_state_that_is_measured_leaves_a_hidden_markov_model(case):
    """Given the states, what is seen depends on the switch alone: the forward algorithm, without merging."""
    one = problem(case, xs=1.0)
    system = one.model.placed(2)
    F, b, Q, H, d, R = (getattr(system.tables, name).ravel() for name in "FbQHdR")

    def density(value, mean, variance):
        return np.exp(-0.5 * (value - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)

    expected = 0.0
    for ys, us in one.data.series:
        p = system.chain.initial * density(
            ys[0, 0], system.first.mean[:, 0], system.first.covariance[:, 0, 0]
        )
        for k, (x, z) in enumerate(ys):
            if k > 0:
                mean = F * ys[k - 1, 0] + b + system.B[:, 0] @ us[k]
                p = (p @ system.chain.transition) * density(x, mean, Q)
            if not np.isnan(z):
                p = p * density(z, H * x + d, R)
            expected += np.log(p.sum())
            p = p / p.sum()
    assert one.scored(one.free.start)[0] == pytest.approx(expected, rel=1e-9)


# --------------------------------------------------------------------------- what may be free

MODEL = SwitchingStateSpace(LAW, **(EACH | {"H": lambda w: [[1.0 + w[1]]]}))
PLAIN = SwitchingStateSpace([[1.0]], F=0.5, H=1.0, Q=1.0, R=1.0)


@pytest.mark.parametrize(
    ("model", "free", "message"),
    [
        (MODEL, None, "free: got None, expected a dict"),
        (MODEL, {}, "free: got {}, expected a dict"),
        (MODEL, {"S": "full"}, "free: got 'S', expected one of F, H, Q, R, b, d, B, x0, P0, law"),
        (MODEL, {"H": "full"}, "free: got 'H', which is a function of the class weights"),
        (
            MODEL,
            {"x0": "full"},
            "free: got 'x0', but the model has no x0: the first state has its stationary",
        ),
        (PLAIN, {"B": "full"}, "free: got 'B', but the model has no B: there are no controls"),
        (MODEL, {"law": "full"}, r"free\['law'\]: got 'full', expected True"),
        (MODEL, {"law": False}, r"free\['law'\]: got False, expected True"),
        (PLAIN, {"law": True}, r"free\['law'\]: got True, but the law has nothing that could be free"),
        (MODEL, {"R": "lower"}, r"free\['R'\]: got 'lower', expected 'full', 'diagonal'"),
        (MODEL, {"R": [[True, False]]}, r"free\['R'\]: .* of shape \(2, 1, 1\) or \(1, 1\)"),
    ],
)
def test_what_cannot_be_free_is_refused(model, free, message):
    with pytest.raises(FuzzykfError, match=message):
        read_free_numbers(model, free, 2, read_data(model, np.ones((3, model.dim_z)), None, None))


def test_names_say_the_class():
    given = {"law": True, "R": "full", "d": [[False], [True]], "Q": "full"}
    free = read_free_numbers(MODEL, given, 2, read_data(MODEL, np.ones((3, MODEL.dim_z)), None, None))
    assert free.names[-4:] == ("R[0][0, 0]", "R[1][0, 0]", "d[1][0]", "Q[0, 0]")
    assert free.names[:2] == ("rate 0 to 1", "rate 1 to 0")


def test_a_fit_ends_at_a_closed_form_on_either_engine():
    # noise about a state that is known: its likeliest variance is the mean of the squares
    zs = 2.0 * np.random.default_rng(5).normal(size=30)
    known = SwitchingStateSpace([[1.0]], F=0.0, H=1.0, Q=0.0, R=1.0, x0=[0.0], P0=0.0)
    fit = known.fit(zs, free={"R": "full"})
    assert fit.estimates["R[0, 0]"] == pytest.approx(np.mean(zs**2), rel=1e-6)
    assert fit.standard_errors["R[0, 0]"] == pytest.approx(np.mean(zs**2) * np.sqrt(2.0 / 30), rel=1e-4)
