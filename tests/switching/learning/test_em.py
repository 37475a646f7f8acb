"""Pieces of the search: steps that are extrapolated, cells that are merged, forms that are chosen."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.learners import FreeChain
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.learning.choice import forms_to_try, learn_forms
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.em import Estimate, extrapolated, pair_shares, run_em
from fuzzykf.switching.learning.fit import Fitted
from fuzzykf.switching.learning.gaussians import RegressionEstimate, pair_cells, transition_vectors
from fuzzykf.switching.learning.regression import Cells, Evidence, merged
from fuzzykf.switching.learning.vine import VineEstimate


class Numbers:
    """Stands for a part of an estimate: a plain vector, of which those above a limit are no model."""

    def __init__(self, vector, limit=np.inf):
        self.vector, self.limit = np.asarray(vector, dtype=float), limit

    def at(self, vector):
        return None if np.abs(vector).max() > self.limit else Numbers(vector, self.limit)


def path(target, rate, limit=np.inf):
    """Three estimates that approach a target by a constant factor."""
    start = np.array([4.0, -3.0, 2.0])
    points = [target + rate**k * (start - target) for k in range(3)]
    return [Estimate(Numbers(p[:1], limit), Numbers(p[1:], limit)) for p in points]


@pytest.mark.parametrize("rate", [0.5, 0.9, 0.99])
def test_steps_that_shrink_by_a_constant_factor_end_where_they_are_sent(rate):
    target = np.array([1.0, 2.0, -1.0])
    found, length = extrapolated(*path(target, rate), 1e6)
    np.testing.assert_allclose(found.vector, target, atol=1e-9)
    assert length == pytest.approx(1.0 / (1.0 - rate))


def test_extrapolation_has_limits():
    target = np.array([1.0, 2.0, -1.0])
    three = path(target, 0.99)
    # a = 1 is the third point, so the way from there is as long as it is allowed to be
    found, length = extrapolated(*three, 2.0)
    assert length == 2.0
    step, change = three[1].vector - three[0].vector, -0.01 * (three[1].vector - three[0].vector)
    np.testing.assert_allclose(found.vector, three[0].vector + 4.0 * step + 4.0 * change, rtol=1e-12)
    # steps that do not shrink, that stand still, or that lead to no model
    assert extrapolated(*path(target, -0.5), 10.0)[0] is None
    assert extrapolated(three[0], three[0], three[0], 10.0)[0] is None
    assert extrapolated(*path(np.array([9.0, 2.0, -1.0]), 0.9, limit=8.0), 1e6)[0] is None


WEIGHTS = np.stack([1.0 - np.linspace(0, 1, 5), np.linspace(0, 1, 5)], axis=1)


def chains():
    joint = np.random.default_rng(0).uniform(0.1, 1.0, (5, 5))
    joint[1, 2] = 0.0
    return [*(LAWS[kind].by_name(3).learner(3) for kind in ("fmc1", "fmc2")), FreeChain(WEIGHTS, joint)]


@pytest.mark.parametrize("chain", chains(), ids=["fmc1", "fmc2", "free"])
def test_a_chain_is_its_vector(chain):
    same = chain.at(chain.vector)
    np.testing.assert_allclose(same.transition, chain.transition, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(same.initial, chain.initial, rtol=1e-12)
    before = chain.transition.copy()
    moved = chain.at(chain.vector + 0.1)
    np.testing.assert_allclose(moved.transition.sum(axis=1), 1.0)
    assert (moved.transition >= 0.0).all()
    assert np.abs(moved.transition - before).max() > 1e-3
    np.testing.assert_array_equal(chain.transition, before)  # the first one is as it was


def test_vectors_that_are_no_chain():
    fmc1, _, free = chains()
    assert fmc1.at(np.full(3, 16.0)) is None
    empty = free.vector.copy()
    empty[:5] = 0.0
    assert free.at(empty) is None


@pytest.fixture(scope="module")
def data(fuzzy_model):
    sim = fuzzy_model.simulate(300, np.random.default_rng(0))
    return gather(sim.x, sim.y, sim.r)


def estimate(kind, data):
    shares = np.stack([1.0 - data.r, data.r], axis=1)
    w = np.concatenate([np.ones((len(data.z), 1)), data.z], axis=1)
    single = Cells(shares, np.ones(len(w)), w[:, :, None] * w[:, None, :])
    cells = pair_cells(shares[data.before], shares[data.after], transition_vectors(data))
    return kind.start(Evidence(cells, cells), Evidence(single, single), 1, 1, np.eye(4))


@pytest.mark.parametrize("kind", [RegressionEstimate, VineEstimate])
def test_a_gaussian_part_is_its_vector(kind, data):
    one = estimate(kind, data)
    shares = np.array([[0.1, 0.2, 0.3, 0.4], [1.0, 0.0, 0.0, 0.0]])
    for a, b in zip(one.rows(shares), one.at(one.vector).rows(shares), strict=True):
        np.testing.assert_array_equal(a, b)
    moved = one.at(one.vector + 1e-3)
    assert np.abs(moved.rows(shares)[0] - one.rows(shares)[0]).max() > 1e-5
    if kind is VineEstimate:
        assert one.at(one.vector + 20.0) is None


@pytest.mark.parametrize("kind", [RegressionEstimate, VineEstimate])
def test_acceleration_is_monotone_and_arrives_earlier(kind, data):
    chain = LAWS["fmc1"].by_name(3).learner(3)
    shares = chain.class_weights
    gaussian = estimate(kind, data)
    found = {}
    for accelerate in (False, True):
        start = Estimate(LAWS["fmc1"].by_name(3).learner(3), gaussian)
        *_, trace, converged = run_em(
            start, shares, data, max_iter=400, tolerance=1e-5, accelerate=accelerate
        )
        assert converged
        assert (np.diff(trace) > -1e-8).all()
        found[accelerate] = trace
    assert len(found[True]) < len(found[False])
    assert found[True][-1] > found[False][-1] - 0.05


def test_a_search_leaves_its_start_as_it_was(data):
    chain = LAWS["fmc1"].by_name(3).learner(3)
    before = chain.logits.copy()
    shares = chain.class_weights
    run_em(Estimate(chain, estimate(RegressionEstimate, data)), shares, data, max_iter=2, tolerance=1e-6)
    np.testing.assert_array_equal(chain.logits, before)


def test_merged_cells_have_the_same_likelihood(data):
    r = np.round(data.r * 4) / 4
    shares = np.stack([1.0 - r, r], axis=1)
    cells = pair_cells(shares[data.before], shares[data.after], transition_vectors(data))
    less = merged(cells)
    assert len(less.weight) <= 25 < len(cells.weight)
    assert less.weight.sum() == pytest.approx(cells.weight.sum())
    one = estimate(RegressionEstimate, data)
    few, many = (one.log_likelihood(Evidence(c, c)) for c in (less, cells))
    assert few == pytest.approx(many, rel=1e-12)
    different = Cells(pair_shares(np.eye(2)), np.ones(4), cells.moment[:4])
    assert merged(different) is different


# --------------------------------------------------------------------------- which form


def fitted(log_likelihood, n_parameters, bounded=False):
    none = np.empty((0, 2))
    return Fitted(None, log_likelihood, n_parameters, [], True, [], none[:, 0], none, bounded)


def test_the_form_of_least_bic_is_taken(data):
    both = ("regression", "covariance")
    rich, spare = fitted(-500.0, 45), fitted(-510.0, 25)
    found = {"regression": rich, "covariance": spare}
    best, values = learn_forms(found.__getitem__, both, data)
    assert best is spare
    assert values == pytest.approx(
        {"regression": 45 * np.log(300) + 1000.0, "covariance": 25 * np.log(300) + 1020.0}
    )
    found["covariance"] = fitted(-600.0, 25)
    assert learn_forms(found.__getitem__, both, data)[0] is rich
    # at its bound a maximum is none
    found["covariance"] = fitted(-400.0, 25, bounded=True)
    best, _ = learn_forms(found.__getitem__, both, data)
    assert best.log_likelihood == rich.log_likelihood
    assert "form 'covariance' has the smaller BIC" in best.warnings[-1]
    assert learn_forms(found.__getitem__, ("covariance",), data)[0] is found["covariance"]


def test_a_form_that_cannot_be_learned_leaves_the_other(data):
    def learn(form):
        if form == "covariance":
            raise np.linalg.LinAlgError("singular")
        return fitted(-500.0, 45)

    _, values = learn_forms(learn, ("regression", "covariance"), data)
    assert list(values) == ["regression"]

    def refuse(form):
        raise ParameterError(f"no {form}")

    with pytest.raises(ParameterError, match="no regression"):
        learn_forms(refuse, ("regression", "covariance"), data)


def test_the_forms_that_a_name_stands_for(data):
    assert forms_to_try("covariance", data) == ("covariance",)
    assert forms_to_try("auto", data) == ("regression", "covariance")
    rng = np.random.default_rng(0)
    vectors = gather(rng.normal(size=(100, 2)), rng.normal(size=100))
    assert forms_to_try("auto", vectors) == ("regression",)
    x, y = rng.normal(size=(2, 100))
    x[50] = np.nan
    assert forms_to_try("auto", gather(x, y)) == ("regression",)
    assert forms_to_try("auto", gather(x, y, complete=True)) == ("regression", "covariance")


@pytest.mark.parametrize("offset", [20.0, -20.0])
def test_a_search_ends_where_it_gains_little_and_not_before(offset, data, monkeypatch):
    # whatever the sign of the density: the gain counts
    chain = LAWS["fmc1"].by_name(2).learner(2)
    shares = chain.class_weights
    start = Estimate(chain, estimate(RegressionEstimate, data))
    usual = RegressionEstimate.log_prior.fget
    moved = property(lambda self: usual(self) + offset * len(data.z))
    monkeypatch.setattr(RegressionEstimate, "log_prior", moved)
    tolerance = 1e-3
    *_, trace, converged = run_em(start, shares, data, max_iter=2, tolerance=tolerance)
    gains = np.diff(trace)
    assert (gains[:-1] > tolerance * len(data.before)).all()
    assert converged == (gains[-1] < tolerance * len(data.before))
    assert len(trace) == 3 or converged
