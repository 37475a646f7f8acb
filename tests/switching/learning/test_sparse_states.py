"""Learning where the state is measured in some rows only: what is missing is left out, the rest is used."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from fuzzykf import CGOFMSModel, CGOMSModel
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.learners import FreeChain
from fuzzykf.switching.learning import em, gaussians
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.likelihood import log_likelihood
from fuzzykf.switching.learning.notes import known_scarcity, scant_data
from fuzzykf.switching.learning.regression import Cells, Evidence

#: Two series of so many rows each, short enough for all paths.
SHORT = (5, 3)


def two_regimes(Axx=0.0, *, means=((0.0, 0.0), (1.0, 2.0))):
    """Two hard regimes of one state and one observation, which differ by the one arrived at."""

    def by_arrival(a, b):
        return np.broadcast_to(np.reshape([a, b], (1, 2, 1, 1)), (2, 2, 1, 1))

    return CGOMSModel.from_regressions(
        [[0.95, 0.05], [0.1, 0.9]],
        Ayy=by_arrival(0.6, 0.2),
        Ny=by_arrival(0.0, 2.0)[..., 0],
        Qyy=by_arrival(0.4, 0.8),
        Axx=by_arrival(Axx, 0.5 * Axx),
        H=by_arrival(0.5, -0.3),
        G=by_arrival(1.0, -1.0),
        c=by_arrival(0.3, -0.4)[..., 0],
        C=by_arrival(0.2, 0.1),
        means=means,
        covariances=[[[1.0, 0.4], [0.4, 0.8]], [[0.7, -0.3], [-0.3, 1.0]]],
    )


def simulated(model, n, seed, known):
    """A series in which x is known at the given rows."""
    sim = model.simulate(n, np.random.default_rng(seed))
    x = np.full_like(sim.x, np.nan)
    x[known] = sim.x[known]
    return x, sim.y, sim.r


# --------------------------------------------------------------------------- against all paths


def known_factors(system, x, y, *, feedback):
    """The logarithms of the factors that are known: of the first row (M,), and of each step (n - 1, M, M)."""
    pairs, law = system.pair_tables(0).pairs, system.initial()
    m, M = x.shape[1], len(law.mean)
    there = np.isfinite(x).all(axis=1)
    first, steps = np.empty(M), np.empty((len(y) - 1, M, M))
    for k, (mean, S) in enumerate(zip(law.mean, law.covariance, strict=True)):
        whole, of_y = multivariate_normal(mean, S), multivariate_normal(mean[m:], S[m:, m:])
        first[k] = whole.logpdf(np.r_[x[0], y[0]]) if there[0] else of_y.logpdf(y[0])
    for n, i, j in np.ndindex(steps.shape):
        Axx, H, G, c, C, Ayy, Ny, Qyy = (table[i, j] for table in pairs)
        steps[n, i, j] = multivariate_normal(Ayy @ y[n] + Ny, Qyy).logpdf(y[n + 1])
        if there[n + 1] and (there[n] or not feedback):
            before = Axx @ x[n] if feedback else 0.0
            mean = before + H @ y[n] + G @ y[n + 1] + c
            steps[n, i, j] += multivariate_normal(mean, C).logpdf(x[n + 1])
    return first, steps


def by_all_paths(system, x, y, initial, *, feedback, with_first):
    """The log-likelihood of a series, and how likely it goes through each node: (n, M)."""
    P, M = system.chain.transition, len(system.chain.transition)
    first, steps = known_factors(system, x, y, feedback=feedback)
    paths = list(itertools.product(range(M), repeat=len(y)))
    logs = [
        np.log(initial[path[0]])
        + with_first * first[path[0]]
        + sum(np.log(P[i, j]) + steps[n, i, j] for n, (i, j) in enumerate(itertools.pairwise(path)))
        for path in paths
    ]
    total = logsumexp(logs)
    return total, np.tensordot(np.exp(np.array(logs) - total), np.eye(M)[np.array(paths)], 1)


def few(model, pattern, feedback, *, seed=0):
    """Training data of two short series with a pattern of known states; MIN_TRANSITIONS notwithstanding."""
    sims = [model.simulate(n, np.random.default_rng(seed + n)) for n in SHORT]
    masks = np.split(np.array(pattern), [SHORT[0]])
    xs = [np.where(mask[:, None], sim.x, np.nan) for sim, mask in zip(sims, masks, strict=True)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fuzzykf.switching.learning.data.MIN_TRANSITIONS", 0)
        # eight rows of a few numbers are collinear
        patch.setattr("fuzzykf.switching.learning.data._check_relations", lambda values, names: None)
        data = gather(xs, [sim.y for sim in sims], state_feedback=feedback)
    return data, xs, [sim.y for sim in sims]


PATTERNS = st.lists(st.booleans(), min_size=8, max_size=8).filter(lambda p: sum(p) >= 3)


@settings(max_examples=10, deadline=None)
@given(pattern=PATTERNS, feedback=st.booleans())
def test_the_likelihood_is_the_sum_over_paths_of_the_known_factors(pattern, feedback):
    system = two_regimes(0.5 if feedback else 0.0).placed()
    data, xs, ys = few(two_regimes(), pattern, feedback)
    initial = system.initial().probability
    series = zip(xs, ys, strict=True)
    wanted = sum(by_all_paths(system, *s, initial, feedback=feedback, with_first=True)[0] for s in series)
    assert log_likelihood(system, data) == pytest.approx(wanted, rel=1e-10)


def test_a_state_of_two_components_and_three_regimes(hard_model):
    system = hard_model.placed()
    data, xs, ys = few(hard_model, [True, True, False, True, True, False, True, True], True)
    initial = system.initial().probability
    series = zip(xs, ys, strict=True)
    wanted = sum(by_all_paths(system, *s, initial, feedback=True, with_first=True)[0] for s in series)
    assert log_likelihood(system, data) == pytest.approx(wanted, rel=1e-10)


@settings(max_examples=8, deadline=None)
@given(pattern=PATTERNS, feedback=st.booleans())
def test_the_expectation_is_that_of_the_known_factors(pattern, feedback):
    # EM takes the first row as given; densities in standard units
    model = two_regimes(0.5 if feedback else 0.0)
    data, xs, ys = few(model, pattern, feedback)
    kind = gaussians.RegressionEstimate if feedback else gaussians.MemorylessEstimate
    long, scale = model.simulate(200, np.random.default_rng(9)), data.scale
    learned = gather((long.x - scale.mean[0]) / scale.std[0], (long.y - scale.mean[1]) / scale.std[1])
    shares = np.eye(2)[long.r.astype(int)]
    v = gaussians.transition_vectors(learned)
    cells = gaussians.pair_cells(shares[:-1], shares[1:], v)
    start = kind.start(Evidence(cells, cells), gaussians.row_cells(shares, learned), 1, 1, np.eye(4))
    chain = FreeChain(np.eye(2), np.array([[0.5, 0.1], [0.1, 0.3]]))
    found = em.expectation(em.Estimate(chain, start), np.eye(2), data, gaussians.transition_vectors(data))
    form = start.form(gaussians.row_cells(shares, learned), data.scale)
    system = CGOMSModel._from_form(chain.transition, form).placed()
    total, gamma = 0.0, []
    for x, y in zip(xs, ys, strict=True):
        one, visits = by_all_paths(system, x, y, chain.initial, feedback=feedback, with_first=False)
        total += one
        gamma.append(visits)
    units = len(data.after) * np.log(scale.std[1]) + data.has_state.sum() * np.log(scale.std[0])
    assert found.log_likelihood == pytest.approx(total + units, rel=1e-9)
    np.testing.assert_allclose(found.gamma, np.concatenate(gamma), atol=1e-9)
    # each regression gets the transitions that it can use
    assert found.pairs.sum() == pytest.approx(len(data.after))
    assert found.state_pairs.sum() == pytest.approx(data.has_state.sum())
    v = gaussians.transition_vectors(data)
    seen = found.moment.sum(axis=(0, 1))[:3, :3]
    np.testing.assert_allclose(seen, v[:, :3].T @ v[:, :3], atol=1e-10)
    used = v[data.has_state]
    np.testing.assert_allclose(found.state_moment.sum(axis=(0, 1)), used.T @ used, atol=1e-10)


# --------------------------------------------------------------------------- the maximisation


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 1000), share=st.floats(0.4, 0.95), feedback=st.booleans())
def test_no_step_lowers_the_likelihood(seed, share, feedback):
    x, y, _ = simulated(two_regimes(0.5), 300, seed, np.random.default_rng(seed).random(300) < share)
    fit = CGOMSModel.fit(x, y, state_feedback=feedback, n_starts=1, max_iter=15)
    assert len(fit.trace) > 3
    assert (np.diff(fit.trace) > -1e-8).all()
    assert np.isfinite(fit.log_likelihood)


@pytest.mark.parametrize("feedback", [True, False])
def test_with_a_known_switch_each_regression_has_its_own_rows(feedback):
    x, y, r = simulated(two_regimes(0.5), 600, 1, np.random.default_rng(1).random(600) < 0.7)
    fit = CGOMSModel.fit(x, y, r, state_feedback=feedback)
    pairs = fit.model.placed().pair_tables(0).pairs
    x, y = x[:, 0], y[:, 0]
    there = np.isfinite(x)
    for i in range(2):
        at = np.flatnonzero((r[:-1] == i) & (r[1:] == i))
        wanted = np.linalg.lstsq(np.c_[y[at], np.ones(at.size)], y[at + 1], rcond=None)[0]
        np.testing.assert_allclose([pairs.Ayy[i, i].item(), pairs.Ny[i, i].item()], wanted, atol=1e-4)
        at = at[there[at + 1] & (there[at] | (not feedback))]
        design = np.c_[x[at], y[at], y[at + 1], np.ones(at.size)][:, 0 if feedback else 1 :]
        wanted, residual, *_ = np.linalg.lstsq(design, x[at + 1], rcond=None)
        names = ("Axx", "H", "G", "c")[0 if feedback else 1 :]
        np.testing.assert_allclose([getattr(pairs, k)[i, i].item() for k in names], wanted, atol=1e-4)
        assert pairs.C[i, i].item() == pytest.approx(residual.item() / at.size, rel=1e-3)
    assert fit.n_observations == 600
    np.testing.assert_array_equal(fit.switch_mean, r)


def test_two_equal_collections_of_cells_are_one():
    # the way of sparse states, on data without a gap, leads to the same numbers
    sim = two_regimes(0.5).simulate(300, np.random.default_rng(2))
    data = gather(sim.x, sim.y, sim.r)
    shares = 0.9 * np.eye(2)[sim.r.astype(int)] + 0.05
    v = gaussians.transition_vectors(data)
    cells, single = gaussians.pair_cells(shares[:-1], shares[1:], v), gaussians.row_cells(shares, data)
    assert single.is_complete
    copy = Cells(*(part.copy() for part in cells))
    one, two = (
        gaussians.RegressionEstimate.start(Evidence(cells, state), single, 1, 1, np.eye(4))
        for state in (cells, copy)
    )
    np.testing.assert_allclose(one.vector, two.vector, rtol=1e-12)
    assert not two.prior.is_complete
    assert two.log_prior == pytest.approx(one.log_prior, rel=1e-12)
    values = one.log_likelihood(Evidence(cells, cells)), two.log_likelihood(Evidence(cells, copy))
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    # in hard regimes the law of the first row as well: its factors are another way to the same maximum
    hard = gaussians.row_cells(np.eye(2)[sim.r.astype(int)], data).state
    split = Evidence(hard, Cells(*(part.copy() for part in hard)))
    for a, b in zip(*(gaussians.regime_moments(e, 1, 1) for e in (Evidence(hard, hard), split)), strict=True):
        np.testing.assert_allclose(a, b, rtol=2e-4)  # but for the prior, which joins each factor


def test_a_first_law_is_not_biased_by_which_states_are_known():
    # x is measured where y is large: its mean there is not its mean
    rng = np.random.default_rng(3)
    y = rng.normal(size=(4000, 2)) @ [[1.0, 0.0], [0.5, 0.8]]
    x = 2.0 * y[:, :1] - y[:, 1:] + 1.0 + 0.5 * rng.normal(size=(4000, 1))
    x[y[:, 0] < 0.5] = np.nan
    data = gather(x, y)
    mean, S = gaussians.regime_moments(gaussians.row_cells(np.ones((4000, 1)), data), 1, 2)
    mean = mean[0] * data.scale.std + data.scale.mean
    S = S[0] * data.scale.std[:, None] * data.scale.std
    S_yy = np.array([[1.25, 0.4], [0.4, 0.64]])
    cross = S_yy @ [2.0, -1.0]
    wanted = np.block([[np.array([[np.r_[2.0, -1.0] @ cross + 0.25]]), cross[None]], [cross[:, None], S_yy]])
    np.testing.assert_allclose(mean, [1.0, 0.0, 0.0], atol=0.08)
    np.testing.assert_allclose(S, wanted, atol=0.25)
    assert np.nanmean(x) > 2.5


# --------------------------------------------------------------------------- what can be learned


def test_every_second_row_is_enough_for_a_state_without_memory():
    truth = two_regimes()
    x, y, r = simulated(truth, 4000, 4, slice(None, None, 2))
    fit = CGOMSModel.fit(x, y, state_feedback=False, n_starts=1, tolerance=1e-5)
    assert fit.converged
    same = np.mean((fit.switch_mean > 0.5) == r)
    order = [0, 1] if same > 0.5 else [1, 0]
    assert max(same, 1.0 - same) > 0.95
    at = np.ix_(order, order)
    np.testing.assert_allclose(fit.model.transition[at], truth.transition, atol=0.02)
    found, true = (model.placed().pair_tables(0).pairs for model in (fit.model, truth))
    for name in ("Ayy", "Ny", "Qyy", "H", "G", "c", "C"):
        for k in range(2):
            a, b = getattr(found, name)[at][k, k].item(), getattr(true, name)[k, k].item()
            assert a == pytest.approx(b, abs=0.15), (name, k)
    assert not found.Axx.any()
    # what is known of the switch, is known in every row
    assert np.isfinite(fit.class_weights).all()
    assert fit.n_observations == 4000


def test_a_campaign_uses_the_rest_of_the_observations():
    truth = two_regimes(0.5)
    errors = {"campaign": [], "all": []}
    for seed in range(3):
        x, y, _ = simulated(truth, 400, seed, slice(120))
        for name, rows in (("campaign", slice(120)), ("all", slice(None))):
            fit = CGOMSModel.fit(x[rows], y[rows], form="regression", n_starts=1, tolerance=1e-3)
            order = np.argsort(fit.model.form.means[:, 1])
            errors[name].append(fit.model.transition[np.ix_(order, order)] - truth.transition)
    assert np.abs(errors["all"]).max() < 0.06
    assert np.square(errors["all"]).mean() < 0.1 * np.square(errors["campaign"]).mean()


def test_fuzzy_switches_are_learned_from_some_states(fuzzy_model):
    sim = fuzzy_model.simulate(300, np.random.default_rng(5))
    x, y = sim.x.copy(), sim.y.copy()
    x[150:], y[200] = np.nan, np.nan
    hidden = CGOFMSModel.fit(x, y, n_nodes=1, n_starts=1, max_iter=5)
    known = CGOFMSModel.fit(x, y, sim.r)
    for fit in (hidden, known):
        assert list(fit.bic_of_forms) == ["regression"]
        assert fit.n_observations == 299
        assert np.flatnonzero(np.isnan(fit.switch_mean)).tolist() == [200]
        assert np.isfinite(fit.log_likelihood)
    # the law of a known switch, and the observation, do not need the state at all
    whole = CGOFMSModel.fit(sim.x, y, sim.r, form="regression")
    assert known.model.law.parameters == whole.model.law.parameters
    np.testing.assert_allclose(known.model.form.table.Ayy, whole.model.form.table.Ayy, rtol=1e-9)
    assert np.abs(known.model.form.table.Axx - whole.model.form.table.Axx).max() > 1e-3


# --------------------------------------------------------------------------- what is said


def test_the_covariance_form_learns_from_complete_rows(fuzzy_model):
    sim = fuzzy_model.simulate(300, np.random.default_rng(6))
    x, y = sim.x.copy(), sim.y.copy()
    x[100:120] = y[100:120] = np.nan
    some = CGOFMSModel.fit(x, sim.y, sim.r, form="covariance")
    cut = CGOFMSModel.fit(x, y, sim.r, form="covariance")
    assert some.n_observations == cut.n_observations == 280
    assert some.log_likelihood == cut.log_likelihood
    np.testing.assert_array_equal(some.model.form.covariances, cut.model.form.covariances)
    assert np.isnan(some.switch_mean[100:120]).all()


def test_a_memory_needs_two_states_in_a_row():
    x, y, _ = simulated(two_regimes(), 200, 7, slice(None, None, 2))
    for fit in (CGOMSModel.fit, CGOFMSModel.fit):
        with pytest.raises(ParameterError, match=r"hold 0 steps .* state_feedback=False learns a state"):
            fit(x, y)


def test_regimes_that_the_state_was_never_measured_in_are_named():
    sim = two_regimes().simulate(400, np.random.default_rng(8))
    x = np.where(sim.r[:, None] == 1, np.nan, sim.x)
    fit = CGOMSModel.fit(x, sim.y, sim.r)
    notes = [note for note in fit.warnings if "the state is rarely measured in the pair" in note]
    assert [note[note.index("(") :][:6] for note in notes] == ["(0, 1)", "(1, 0)", "(1, 1)"]
    assert all(np.isfinite(part).all() for part in fit.model.placed().pair_tables(0).pairs)
    data = gather(sim.x, sim.y, sim.r)
    assert known_scarcity(np.eye(2)[sim.r.astype(int)], data) == []


def test_numbers_that_were_not_measured_do_not_count():
    rng = np.random.default_rng(9)
    x, y = rng.normal(size=(100, 3)), rng.normal(size=(100, 2))
    x[60:] = np.nan
    data = gather(x, y)
    assert data.n_measured == 380
    assert scant_data(63, data) == []
    (note,) = scant_data(64, data)
    assert "100 rows, in 60 of which the state is measured, hold 380 numbers" in note
    assert "expected at least 384 numbers" in note


def test_a_stuck_state_is_named_though_it_is_seldom_measured():
    rng = np.random.default_rng(10)
    r = (np.arange(600) // 50) % 2
    y = rng.normal(size=600)
    x = y + rng.normal(size=600)
    x[50:100] = 7.0  # the second regime is measured here, and nowhere else
    x[100:] = np.where(r[100:] == 1, np.nan, x[100:])
    fit = CGOMSModel.fit(x, y, r, form="regression")
    assert any("regime 1 has collapsed onto the rows 50 to 99, in which x[0]" in n for n in fit.warnings)


def test_the_bootstrap_leaves_out_the_same_states():
    x, y, r = simulated(two_regimes(), 200, 11, np.arange(200) % 3 > 0)
    fit = CGOMSModel.fit(x, y, r, state_feedback=False)
    sample = fit.model.simulate(200, np.random.default_rng(12))
    again = fit.refit(sample)
    masked = np.where(np.isnan(x), np.nan, sample.x)
    wanted = CGOMSModel.fit(masked, sample.y, sample.r, state_feedback=False)
    assert again.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-12)
    for a, b in zip(*(one.model.placed().pair_tables(0).pairs for one in (again, wanted)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10)
