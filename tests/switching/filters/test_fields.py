"""Verbs, steps, series and many series of a switching filter agree in every field, the switch included."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
)
from fuzzykf.switching.inference.series import SHOWN

CGLSSM = {
    "A": [[[0.8, 0.3], [0.0, 0.5]], [[0.2, -0.4], [0.1, 0.6]]],
    "B": [[[1.0, 0.0]], [[1.0, 1.0]]],
    "C": [[[0.5, 0.0], [1.0, 0.3]], [[1.0, 0.0], [0.0, 1.0]]],
    "D": [[[0.5, 0.1]], [[1.0, 0.0]]],
}
MOVING = {
    "mode": "time_varying",
    "order": 2,
    "initial_probability": [0.2, 0.8],
    "initial_covariance": [np.eye(2), 3.0 * np.eye(2)],
}


def fuzzy_vector(m, q):
    """A fuzzy system of any size whose corners differ in mean and in noise."""
    rng = np.random.default_rng(10 * m + q)
    d = m + q
    z = rng.normal(size=(d, d)) * 0.4 + np.eye(d)
    z = z @ z.T
    cross = 0.4 * z + 0.05 * rng.normal(size=(d, d))
    cross[m:, :m] = cross[m:, m:] @ np.linalg.solve(z[m:, m:], z[m:, :m])  # Y' and X are independent given Y
    pair = np.block([[z, cross.T], [cross, z]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(d), np.full(d, 1.5)], np.broadcast_to(pair, (2, 2, 2 * d, 2 * d)), m)


@pytest.fixture(
    params=[
        "scalar",
        "vector 2 1",
        "vector 1 2",
        "vector 5 3",
        "hard",
        "one hard regime",
        "fades",
        "turning fades of a vector",
        "moving",
        "order 3",
    ]
)
def make(request, fuzzy_model, hard_model, make_transitions):
    """A factory of filters and the model they are of."""
    if request.param == "scalar":
        return lambda: OFSRFilter(fuzzy_model, 4), fuzzy_model
    if request.param == "hard":
        return lambda: CGOMSMFilter(hard_model), hard_model
    if "fades" in request.param:  # several nodes of one value
        plain = request.param == "fades"
        form = fuzzy_model.form if plain else fuzzy_vector(2, 1).form
        law = FadeLaw.between(5, 6) if plain else FadeLaw.between(4, 7, jump=0.05, turn_back=0.2)
        model = CGOFMSModel._from_form(law, form)
        return lambda: OFSRFilter(model, 4), model
    if request.param == "one hard regime":
        model = CGOMSModel.from_transitions([[1.0]], *make_transitions(1, 2, 2, seed=3), dim_x=2)
        return lambda: CGOMSMFilter(model), model
    if request.param in ("moving", "order 3"):  # tables that change from step to step, or a longer window
        parts = {name: np.array(value) for name, value in CGLSSM.items()}
        options = MOVING if request.param == "moving" else {"order": 3}
        model = CGOMSModel.from_cglssm([[0.9, 0.1], [0.3, 0.7]], **parts, **options)
        return lambda: CGOMSMFilter(model), model
    model = fuzzy_vector(*map(int, request.param.split()[1:]))
    return lambda: OFSRFilter(model, 3), model


#: Observations of each series.
LENGTH = 18


def observe(model, gaps):
    y = model.simulate(LENGTH, np.random.default_rng(3)).y
    if gaps:
        y[3], y[7:9], y[14, 0] = np.nan, np.nan, np.nan
    return y


def shown(f):
    return {name: np.squeeze(getattr(f, name)) for name in SHOWN}


def by_verbs(f, y):
    """What the verbs show after each observation, and what they show of it before."""
    rows, ahead = [], []
    for z in y:
        f.predict()
        ahead.append((np.squeeze(f.x), np.squeeze(f.P)))
        f.update(z)
        rows.append(shown(f))
    return {name: np.array([row[name] for row in rows]) for name in SHOWN}, ahead


@pytest.mark.parametrize("gaps", [False, True])
def test_four_ways_agree_in_every_field(make, gaps) -> None:
    filter_, model = make
    y = observe(model, gaps)
    verbs, ahead = by_verbs(filter_(), y)
    f = filter_()
    steps = []
    for z in y:
        np.testing.assert_array_equal(f.step(z), f.x)
        steps.append(shown(f))
    whole = filter_().filter(y)
    shifted = y[::-1].copy()
    many = filter_().filter_many(np.stack([y, shifted, y]), keep=SHOWN)
    other = filter_().filter(shifted)
    for name in SHOWN:
        expected = verbs[name]
        near = {"rtol": 1e-8, "atol": 1e-10, "err_msg": name}
        np.testing.assert_allclose([step[name] for step in steps], expected, **near)
        np.testing.assert_allclose(np.reshape(getattr(whole, name), expected.shape), expected, **near)
        for row in (0, 2):
            np.testing.assert_allclose(np.reshape(getattr(many, name)[row], expected.shape), expected, **near)
        np.testing.assert_allclose(getattr(many, name)[1], getattr(other, name), **near)
    for k, (x, P) in enumerate(ahead):
        np.testing.assert_allclose(verbs["x_prior"][k], x, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(verbs["P_prior"][k], P, rtol=1e-12, atol=1e-12)


def test_every_field_alone_is_the_one_among_all(make) -> None:
    # which fields are asked for decides what the engine computes, not what comes out
    filter_, model = make
    zs = np.stack([observe(model, False), observe(model, True)])
    f = filter_()
    all_of_them = f.filter_many(zs, keep=SHOWN)
    for name in SHOWN:
        alone = f.filter_many(zs, keep=[name])
        np.testing.assert_allclose(
            getattr(alone, name), getattr(all_of_them, name), rtol=1e-9, atol=1e-12, err_msg=name
        )
        assert all(getattr(alone, other) is None for other in SHOWN if other != name)


def test_the_mean_and_the_mode_of_the_switch_are_those_of_its_probabilities(make) -> None:
    filter_, model = make
    result = filter_().filter(observe(model, True))
    chain = filter_()._system.chain
    np.testing.assert_allclose(result.switch_mean, result.mu @ result.nodes, rtol=1e-12, atol=1e-14)
    nodes, hard = chain.nodes, chain.nodes[chain.atoms]
    between = np.unique(nodes[~chain.atoms])
    for p, switch in zip(result.mu, result.switch, strict=True):
        if not between.size or p[chain.atoms].sum() > 0.5:
            expected = max(hard, key=lambda r: (p[nodes == r].sum(), r))
        else:  # nodes of one value add up
            expected = max(between, key=lambda r: (p / chain.weights)[nodes == r].sum())
        assert switch == expected


@pytest.mark.parametrize("gaps", [False, True])
def test_a_known_switch_has_the_same_fields_by_verbs_and_by_series(gaps, fuzzy_model) -> None:
    data = fuzzy_model.simulate(LENGTH, np.random.default_rng(3))
    y = observe(fuzzy_model, gaps)
    whole = KnownSwitchFilter(fuzzy_model).filter(y, data.r)
    f, g = KnownSwitchFilter(fuzzy_model), KnownSwitchFilter(fuzzy_model)
    for k, (z, r) in enumerate(zip(y, data.r, strict=True)):
        f.predict(r)
        f.update(z)
        g.step(z, r)
        for name in SHOWN:
            for one in (f, g):
                np.testing.assert_allclose(
                    np.squeeze(getattr(one, name)),
                    np.squeeze(getattr(whole, name)[k]),
                    rtol=1e-9,
                    atol=1e-11,
                    err_msg=name,
                )


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_threads_share_all_series_among_them(threads, make) -> None:
    # also where there are more threads than series, and where series do not divide evenly
    filter_, model = make
    y = np.stack([model.simulate(6, np.random.default_rng(seed)).y for seed in range(5)])
    alone, shared = (
        filter_().filter_many(y, keep=SHOWN),
        filter_().filter_many(y, keep=SHOWN, threads=threads),
    )
    for name in SHOWN:
        np.testing.assert_allclose(
            getattr(shared, name), getattr(alone, name), rtol=1e-9, atol=1e-12, err_msg=name
        )


def test_a_forecast_is_the_filter_of_nothing(make) -> None:
    # step by step with the tables of that step, which may not be those of the next one
    filter_, model = make
    y = observe(model, False)[:4]
    for n in (1, 2, 4):
        f = filter_()
        f.filter(y[:n])
        ahead = f.forecast(5)
        padded = np.concatenate([y[:n], np.full((5, f.dim_z), np.nan)])
        empty = filter_().filter(padded)
        for name in ("x", "P", "mu", "switch", "switch_mean"):
            np.testing.assert_allclose(
                getattr(ahead, name), getattr(empty, name)[n:], rtol=1e-9, atol=1e-11, err_msg=name
            )
        for k in range(5):
            f.predict()  # after the first, each stands for an observation that is missing
            np.testing.assert_allclose(ahead.x[k], f.x_prior[:, 0], rtol=1e-9, atol=1e-11)
            np.testing.assert_allclose(ahead.P[k], f.P_prior, rtol=1e-9, atol=1e-11)
