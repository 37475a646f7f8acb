"""The objective that serves the filter is what the filter says of the states, and its gradient is exact."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, OFSRFilter
from fuzzykf.switching.laws.law_numbers import ChainNumbers
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.em import pair_shares
from fuzzykf.switching.learning.filter_objective import ALPHA, RIDGE, FilterObjective, Whitened, stretches
from fuzzykf.switching.learning.gaussians import (
    MemorylessEstimate,
    RegressionEstimate,
    pair_cells,
    single_cells,
    transition_vectors,
)
from fuzzykf.switching.learning.regression import Evidence, Regression

NODES = 2
KINDS = ("hard", "fmc1", "fmc2", "free", "graph", "fade")


def series(m, q, n=24):
    """Two series of random walks that are pulled to one level or the other."""
    rng = np.random.default_rng(10 * m + q)
    found = []
    for length in (n, n // 2):
        r = (np.arange(length) // 5) % 2
        y = np.cumsum(rng.normal(size=(length, q)), axis=0) * 0.3 + r[:, None]
        x = 0.8 * y[:, :1] * (1 - 2 * r[:, None]) + rng.normal(size=(length, m))
        found.append((x, y, r))
    return found


def case(kind, m, q, estimate=RegressionEstimate, missing=False):
    """A model that is near some data, and the parts of the objective."""
    parts = series(m, q)
    data = gather([x for x, _, _ in parts], [y for _, y, _ in parts], [r for _, _, r in parts])
    shares = np.clip(np.stack([1.0 - data.r, data.r], axis=1), 0.1, 0.9)
    v = transition_vectors(data)
    cells = pair_cells(shares[data.before], shares[data.after], v)
    single = single_cells(shares, np.eye(2), data)
    gaussian = estimate.start(Evidence(cells, cells), single, m, q, pair_shares(np.eye(2)))
    form = gaussian.form(single, data.scale)
    if kind == "hard":
        model = CGOMSModel._from_form([[0.8, 0.2], [0.3, 0.7]], form)
        law, n_nodes = ChainNumbers(model.placed().chain), 0
    else:
        start = FadeLaw.between(dwell=15, length=4) if kind == "fade" else LAWS[kind].by_name(NODES)
        model, n_nodes = CGOFMSModel._from_form(start, form), NODES
        law = start.free_numbers(NODES)
    if missing:
        data.z[[0, 5, 6, 30], :m] = np.nan
    system = model.placed(n_nodes)
    learned = stretches(data, system)
    return FilterObjective(gaussian, law, system.chain, learned), model, data, learned


def moved(objective, seed=0):
    """Numbers near the start, at which nothing is at its maximum."""
    rng = np.random.default_rng(seed)
    return objective.start + 0.1 * rng.normal(size=objective.start.size)


@pytest.mark.parametrize("kind", ["hard", "fmc1", "fade"])
@pytest.mark.parametrize("m", [1, 2])
def test_it_is_what_the_filter_of_the_model_says(kind, m) -> None:
    objective, model, data, learned = case(kind, m, 2)
    filtered = CGOMSMFilter(model) if kind == "hard" else OFSRFilter(model, n_nodes=NODES)
    total, n = 0.0, 0
    for scores, one in zip(objective.scores(objective.start, learned), learned, strict=True):
        y = one.y * data.scale.std[m:] + data.scale.mean[m:]
        likelihoods = filtered.filter(y).log_likelihood + np.log(data.scale.std[m:]).sum()
        total += scores.sum() + ALPHA * likelihoods.sum()
        n += len(scores)
    ridge = 0.0
    for k, whitened in enumerate((objective._of_observation, objective._of_state)):
        numbers = np.split(objective.start, objective._cuts)[k]
        ridge += RIDGE * whitened.ridge(numbers)[0] + whitened.seen_before(numbers)[0]
    assert ridge > 0.1
    assert objective.value(objective.start)[0] == pytest.approx((total - ridge) / n, rel=1e-10)


def test_one_regime_scores_the_normal_law_of_its_filter() -> None:
    x, y, _ = series(1, 1)[0]
    fit = CGOMSModel.fit(x, y, n_regimes=1, form="regression")
    data = gather(x, y)
    one = np.ones((len(x), 1))
    cells = pair_cells(one[1:], one[1:], transition_vectors(data))
    gaussian = RegressionEstimate.start(
        Evidence(cells, cells),
        single_cells(one, np.eye(1), data),
        1,
        1,
        np.ones((1, 1)),
    )
    system = fit.model.placed()
    learned = stretches(data, system)
    found = FilterObjective(gaussian, None, system.chain, learned)
    filtered = CGOMSMFilter(fit.model).filter(y)
    std = np.sqrt(filtered.P[:, 0, 0])
    expected = -0.5 * ((x - filtered.x)[:, 0] / std) ** 2 - np.log(std) - 0.5 * np.log(2.0 * np.pi)
    scores = found.scores(found.start, learned)[0] - np.log(data.scale.std[0])
    np.testing.assert_allclose(scores, expected, rtol=1e-6)


CASES = [(kind, 1, 1, RegressionEstimate, False) for kind in KINDS]
CASES += [
    ("hard", 2, 2, RegressionEstimate, False),
    ("hard", 2, 1, MemorylessEstimate, False),
    ("fmc1", 1, 2, MemorylessEstimate, True),
    ("fade", 2, 1, RegressionEstimate, True),
]


@pytest.mark.parametrize(("kind", "m", "q", "estimate", "missing"), CASES)
def test_the_gradient_is_the_limit_of_differences(kind, m, q, estimate, missing) -> None:
    objective, *_ = case(kind, m, q, estimate, missing)
    numbers = moved(objective)
    value, slope = objective.value(numbers)
    assert np.isfinite(value)
    kinds = np.split(np.arange(numbers.size), objective._cuts)  # observation, state, law
    rng = np.random.default_rng(1)
    for one in kinds * 3:
        direction = np.zeros(numbers.size)
        direction[one] = rng.normal(size=len(one))

        def at(h, direction=direction):
            return objective.value(numbers + h * direction)[0]

        h = 1e-4
        expected = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
        assert slope @ direction == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("kind", ["hard", "fmc1"])
def test_a_stretch_of_one_row_counts(kind) -> None:
    objective, model, data, learned = case(kind, 2, 1)
    alone = learned[0]._replace(
        x=learned[0].x[:1], y=learned[0].y[:1], before=learned[0].before[:0], after=learned[0].after[:0]
    )
    chain = model.placed(0 if kind == "hard" else NODES).chain
    longer = FilterObjective(objective.estimate, objective._law, chain, [*learned, alone])
    n = [sum(len(one.x) for one in part) for part in (learned, [*learned, alone])]
    first = objective.scores(objective.start, learned[:1])[0][0]
    likelihood = [n[1] * longer.value(longer.start)[0], n[0] * objective.value(objective.start)[0]]
    filtered = CGOMSMFilter(model) if kind == "hard" else OFSRFilter(model, n_nodes=NODES)
    filtered.step(alone.y[0] * data.scale.std[2:] + data.scale.mean[2:])
    expected = first + ALPHA * (filtered.log_likelihood + np.log(data.scale.std[2:]).sum())
    assert likelihood[0] - likelihood[1] == pytest.approx(expected, rel=1e-8)
    numbers = moved(longer)
    direction = np.random.default_rng(2).normal(size=numbers.size)
    ends = [longer.value(numbers + h * direction)[0] for h in (1e-5, -1e-5)]
    assert longer.value(numbers)[1] @ direction == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)


def test_numbers_and_regressions_are_one_another() -> None:
    rng = np.random.default_rng(0)
    B, t, p = 4, 2, 3
    T = np.tile(np.eye(t), (B, 1, 1))
    T[:, 1, 0] = rng.normal(size=B)
    fit = Regression(rng.normal(size=(B, t, p)), T, rng.normal(size=(B, t)))
    regressors = rng.normal(size=(200, p)) @ rng.normal(size=(p, p))
    whitened = Whitened(fit, regressors, n_bare=1)
    for one, other in zip(whitened.unpack(whitened.pack(fit)), fit, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)


def test_the_ridge_draws_to_the_mean_and_leaves_the_state_before_alone() -> None:
    beta = np.array([[[5.0, 1.0]], [[-5.0, 3.0]]])
    fit = Regression(beta, np.ones((2, 1, 1)), np.array([[0.0], [9.0]]))
    whitened = Whitened(fit, np.ones((10, 2)), n_bare=1)
    value, slope = whitened.ridge(whitened.pack(fit))
    assert value == pytest.approx(0.5 * (1.0 + 1.0), rel=1e-6)
    np.testing.assert_allclose(slope, [0.0, -1.0, 0.0, 1.0, 0.0, 0.0], atol=1e-6)


def test_a_wider_noise_is_that_of_the_model() -> None:
    objective, _, _, learned = case("hard", 2, 1)
    estimate, *_ = objective.at(objective.start, 2.0)
    wider = FilterObjective(estimate, objective._law, case("hard", 2, 1)[1].placed().chain, learned)
    for one, other in zip(
        objective.scores(objective.start, learned, 2.0), wider.scores(wider.start, learned), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-10)


def test_each_regime_has_seen_a_residual_of_the_common_size() -> None:
    fit = Regression(np.zeros((2, 1, 1)), np.ones((2, 1, 1)), np.array([[1.0], [3.0]]))
    whitened = Whitened(fit, np.ones((10, 1)))
    numbers = whitened.pack(fit)
    value, slope = whitened.seen_before(numbers)
    size = (np.exp(1.0) + np.exp(3.0)) / 2.0
    assert value == pytest.approx(0.5 * (4.0 + size * (np.exp(-1.0) + np.exp(-3.0))))
    by = 0.5 * (1.0 - size * np.exp([-1.0, -3.0]))
    np.testing.assert_allclose(slope, [0.0, 0.0, *by])
    common = np.concatenate([numbers[:2], [np.log(size)] * 2])  # where each has that size, nothing pulls
    np.testing.assert_allclose(whitened.seen_before(common)[1], 0.0, atol=1e-15)


def test_where_a_covariance_is_singular_there_is_no_score() -> None:
    objective, *_, learned = case("hard", 2, 1, MemorylessEstimate, missing=True)
    scores = np.concatenate(objective.scores(objective.start, learned))
    assert objective.mean_score(objective.start) == pytest.approx(np.nanmean(scores), rel=1e-12)
    numbers = objective.start.copy()
    numbers[objective._cuts[1] - 8 : objective._cuts[1]] = -1e4  # log-variances of the state
    assert objective.mean_score(numbers) == -np.inf
