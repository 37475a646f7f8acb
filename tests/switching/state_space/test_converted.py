"""Models made by CGOMSModel.from_cglssm: options, errors, tables on demand, files, known regimes, gaps."""

from __future__ import annotations

import json
import pickle
import warnings

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel, KnownSwitchFilter
from fuzzykf.errors import (
    ClosenessWarning,
    FileFormatError,
    NotPositiveDefiniteError,
    NotStableError,
    ParameterError,
)
from fuzzykf.switching.state_space import converted

T = [[0.9, 0.1], [0.3, 0.7]]
MATRICES = {
    "A": [[[0.8, 0.3], [0.0, 0.5]], [[0.2, -0.4], [0.1, 0.6]]],
    "B": [[[1.0, 0.0]], [[1.0, 1.0]]],
    "C": [[[0.5, 0.0], [1.0, 0.3]], [[1.0, 0.0], [0.0, 1.0]]],
    "D": [[[0.5, 0.1]], [[1.0, 0.0]]],
}
START = {"initial_probability": [0.2, 0.8], "initial_covariance": [np.eye(2), 3.0 * np.eye(2)]}


def stationary(**options):
    return CGOMSModel.from_cglssm(T, **MATRICES, **options)


def moving(**options):
    return CGOMSModel.from_cglssm(T, **MATRICES, **START, mode="time_varying", **options)


def scalar(A, B=1.0, C=1.0, D=1.0, transition=T, **options):
    parts = (
        np.reshape(np.broadcast_to(np.asarray(a, dtype=float), len(transition)), (-1, 1, 1))
        for a in (A, B, C, D)
    )
    return CGOMSModel.from_cglssm(transition, *parts, **options)


# --------------------------------------------------------------------------- options and errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"construction": "paper"}, "construction: got 'paper', expected one of 'gain', 'markov_x', 'clip'"),
        ({"noise": "mean"}, "noise: got 'mean', expected one of 'pair', 'averaged'"),
        ({"mode": "moving"}, "mode: got 'moving', expected one of 'stationary', 'time_varying'"),
        ({"order": 0}, "order: got 0, expected a whole number"),
        ({"order": 1.5}, "order: got 1.5, expected a whole number"),
        ({"order": "2"}, "order: got '2', expected a whole number"),
        ({"order": True}, "order: got True, expected a whole number"),
        ({"order": 2, "construction": "clip"}, "order: got 2, expected 1 with construction='clip'"),
        ({"order": 2, "construction": "markov_x"}, "order: got 2, expected 1 with construction='markov_x'"),
        ({"initial_probability": [0.5, 0.5]}, "initial_probability: .* expected the stationary one"),
        ({"initial_covariance": [np.eye(2)] * 2}, r"initial_covariance\[\d\]: differs from the stationary"),
    ],
)
def test_what_is_refused(options, message):
    with pytest.raises(ParameterError, match=message):
        stationary(**options)


def test_what_is_stationary_may_be_given():
    plain = stationary()
    again = stationary(
        initial_probability=plain.cglssm.initial_probability,
        initial_covariance=plain.cglssm.initial_covariance,
    )
    for a, b in zip(
        again.on_nodes().pair_tables(0).pairs, plain.on_nodes().pair_tables(0).pairs, strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_an_unstable_model_is_no_stationary_one():
    # the radius is that of [[p(i | j) a_j^2]]
    with pytest.raises(NotStableError, match=r"spectral radius .* is 1\.0201"):
        scalar(1.01)
    start = {"initial_covariance": np.ones((2, 1, 1))}
    with pytest.raises(NotStableError, match=r"1\.0201"):
        scalar(1.01, **start)
    scalar(1.01, **start, mode="time_varying")


def test_each_failure_names_regimes_step_and_eigenvalue():
    # a slow state: Var(X' | Y, Y') < A^2 Var(X | Y) in the regime 1
    with pytest.raises(
        NotPositiveDefiniteError,
        match=r"construction='markov_x' at step 0, regimes \(\d, 1\): .* got the eigenvalue -0\.\d+",
    ):
        scalar([0.3, 0.95], C=[1.0, 0.3], construction="markov_x")
    with pytest.raises(
        NotPositiveDefiniteError,
        match=r"construction='markov_x' at step 0, averaged for the regime 1: .* got the eigenvalue -0\.\d+",
    ):
        scalar([0.3, 0.95], C=[1.0, 0.3], construction="markov_x", noise="averaged")
    # an observation that its predecessors determine
    with pytest.raises(
        NotPositiveDefiniteError,
        match=r"covariance of the observation after step 0, regimes \(\d, 1\): .* got the eigenvalue 0",
    ):
        scalar(0.5, B=[1.0, 0.0], D=[1.0, 0.0], mode="time_varying", initial_probability=[1.0, 0.0])
    with pytest.raises(
        NotPositiveDefiniteError,
        match=r"covariance of the first observation in the regime 1: .* eigenvalue 0",
    ):
        scalar(0.5, B=[1.0, 0.0], D=[1.0, 0.0])
    # the window of two, not that of one, determines the state and so the next observation
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    with pytest.raises(NotPositiveDefiniteError, match="covariance of the observation after step 1"):
        CGOMSModel.from_cglssm(
            [[1.0]],
            [turn],
            [[[1.0, 0.3]]],
            np.zeros((1, 2, 1)),
            np.zeros((1, 1, 1)),
            initial_covariance=[np.eye(2)],
            mode="time_varying",
            order=2,
        )


def test_a_failure_far_ahead_is_warned_of_and_raised_when_it_is_reached():
    # a random walk known at first: the paper's construction needs Var(X_n | Y_n) < c d, until n = d / c
    start = {"initial_covariance": np.zeros((1, 1, 1)), "mode": "time_varying"}
    with pytest.warns(
        ClosenessWarning, match=r"in the long run this model does not exist: .* at step \d\d\d,"
    ):
        model = scalar(1.0, C=0.005, transition=[[1.0]], construction="markov_x", **start)
    f = CGOMSMFilter(model)
    f.filter(np.zeros(150))
    state = f.x.copy(), f.P.copy(), f.mu.copy()
    with pytest.raises(NotPositiveDefiniteError, match=r"at step (19|20|21)\d, regimes \(0, 0\)"):
        f.filter(np.zeros(300))
    for before, now in zip(state, (f.x, f.P, f.mu), strict=True):  # and the filter stays as it was
        np.testing.assert_array_equal(before, now)


def test_a_state_that_outgrows_floating_point_is_refused():
    start = {"initial_covariance": np.ones((1, 1, 1)), "mode": "time_varying"}
    model = scalar(50.0, transition=[[1.0]], **start)
    with pytest.raises(NotStableError, match=r"grown beyond 1e\+300 at step 8\d"):
        CGOMSMFilter(model).filter(np.zeros(200))


# --------------------------------------------------------------------------- tables on demand


def test_a_stationary_model_has_as_many_tables_as_windows():
    system = stationary(order=3).on_nodes()
    assert (system.order, system.steady_from) == (3, 2)
    assert [system.pair_tables(n).pairs.Ayy.shape[-1] for n in range(4)] == [1, 2, 3, 3]
    assert system.pair_tables(1000) is system.pair_tables(2)


def test_tables_do_not_depend_on_the_order_in_which_they_are_asked_for(monkeypatch):
    monkeypatch.setattr(converted, "_KEPT_TABLES", 2)
    there, back, once = (moving(order=2).on_nodes() for _ in range(3))
    assert there.steady_from is None
    N = 150  # every 64th law is kept
    forward = [there.pair_tables(n).pairs for n in range(N)]
    backward = [back.pair_tables(n).pairs for n in reversed(range(N))][::-1]
    for n in range(N):
        for a, b in zip(forward[n], backward[n], strict=True):
            np.testing.assert_array_equal(a, b)
    for a, b in zip(forward[140], once.pair_tables(140).pairs, strict=True):
        np.testing.assert_array_equal(a, b)


def test_memory_does_not_grow_with_the_series():
    system = moving(order=2).on_nodes()
    for n in range(600):
        system.pair_tables(n)
    assert len(system._laws) < 600 // 64 + 2 * 64
    assert system._tables.cache_info().currsize <= 256


def test_large_models_keep_fewer_tables():
    K, m = 6, 8
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(K, m, m)) * 0.1, rng.normal(size=(K, m, m))
    C = D = np.broadcast_to(np.eye(m), (K, m, m))
    model = CGOMSModel.from_cglssm(
        np.full((K, K), 1 / K), A, B, C, D, initial_covariance=C, order=3, mode="time_varying"
    )
    assert 2 <= model.on_nodes()._tables.cache_info().maxsize < 30


# --------------------------------------------------------------------------- the model


def test_a_converted_model_tells_what_it_is():
    model = stationary(order=2)
    assert (model.n_classes, model.dim_x, model.dim_z) == (2, 2, 1)
    assert repr(model) == "CGOMSModel(n_classes=2, dim_x=2, dim_z=1, form='cglssm')"
    np.testing.assert_allclose(model.initial, [0.75, 0.25])
    np.testing.assert_array_equal(model.transition, T)
    np.testing.assert_array_equal(model.cglssm.A, MATRICES["A"])


def test_other_models_stand_for_nothing_else():
    pair = np.eye(4)
    model = CGOMSModel(T, np.zeros((2, 2)), np.broadcast_to(pair, (2, 2, 4, 4)), 1)
    assert model.cglssm is None
    with pytest.raises(ParameterError, match="closeness: got a model that stands for itself"):
        model.closeness()


@pytest.mark.parametrize("make", [stationary, moving])
@pytest.mark.parametrize("options", [{"order": 3}, {"construction": "clip"}, {"noise": "averaged"}])
def test_simulated_series_have_the_likelihood_of_the_model(make, options):
    # E[(y - prediction)^2 / S] = 1 and uncorrelated, if the series are those of the model: regimes known
    model = make(**options)
    rng = np.random.default_rng(4)
    truths = [model.simulate(40, rng) for _ in range(40)]
    x, y, r = (np.stack([getattr(truth, name) for truth in truths]) for name in "xyr")
    result = KnownSwitchFilter(model).filter_many(y, keep=("x", "P", "log_likelihood"), r=r)
    e = x - result.x
    errors = np.einsum("sni,snij,snj->sn", e, np.linalg.inv(result.P), e)
    # the normalised squared error of the state has mean m = 2: its covariance is that claimed
    assert np.mean(errors) == pytest.approx(2.0, abs=0.15)
    assert np.isfinite(result.log_likelihood).all()


def test_simulated_observations_have_the_covariance_of_the_model():
    model = stationary(order=2)
    rng = np.random.default_rng(5)
    truth = model.simulate(10_000, rng)  # the standard error of a variance is 5 % at most, of 12 allowed
    for j in range(2):
        z = np.concatenate([truth.x, truth.y], axis=1)[truth.r == j]
        law = model.on_nodes().initial()
        np.testing.assert_allclose(z.T @ z / len(z), law.covariance[j], atol=0.12 * law.covariance[j].max())


@pytest.mark.parametrize("options", [{"order": 3}, {"construction": "clip", "noise": "averaged"}])
@pytest.mark.parametrize("make", [stationary, moving])
def test_a_saved_filter_resumes_bit_for_bit(tmp_path, make, options):
    model = make(**options)
    ys = np.random.default_rng(6).normal(size=(30, 1))
    f = CGOMSMFilter(model)
    for y in ys[:15]:
        f.step(y)
    f.save(tmp_path / "filter.json")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        g = CGOMSMFilter.load(tmp_path / "filter.json")
    for y in ys[15:]:
        np.testing.assert_array_equal(f.step(y), g.step(y))
        np.testing.assert_array_equal(f.P, g.P)
        assert f.log_likelihood == g.log_likelihood


def test_a_saved_model_is_the_model(tmp_path):
    model = moving(order=2)
    model.save(tmp_path / "model.json")
    again = CGOMSModel.load(tmp_path / "model.json")
    copied = pickle.loads(pickle.dumps(model))
    for other in (again, copied):
        assert other.closeness() == model.closeness()
        for n in (0, 5):
            for a, b in zip(
                other.on_nodes().pair_tables(n).pairs, model.on_nodes().pair_tables(n).pairs, strict=True
            ):
                np.testing.assert_array_equal(a, b)
    document = json.loads((tmp_path / "model.json").read_text())
    document["form"]["order"] = 0
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match="order: got 0"):
        CGOMSModel.load(tmp_path / "model.json")


# --------------------------------------------------------------------------- known regimes


@pytest.mark.parametrize("make", [stationary, moving])
def test_known_regimes_step_by_step_and_at_once(make):
    model = make(order=3)
    truth = model.simulate(25, np.random.default_rng(7))
    result = KnownSwitchFilter(model).filter(truth.y, truth.r)
    f = KnownSwitchFilter(model)
    for k in range(25):
        f.predict(truth.r[k])
        np.testing.assert_allclose(f.x_prior[:, 0], result.x_prior[k], rtol=1e-12, atol=1e-14)
        f.update(truth.y[k])
        np.testing.assert_allclose(f.x[:, 0], result.x[k], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(f.P, result.P[k], rtol=1e-12)


def test_known_regimes_that_cannot_occur_are_refused():
    start = {"initial_probability": [1.0, 0.0], "initial_covariance": np.ones((2, 1, 1))}
    model = scalar(0.5, transition=[[0.5, 0.5], [0.0, 1.0]], **start, mode="time_varying")
    with pytest.raises(ParameterError, match="r: got regime 1 at first, which has probability zero"):
        KnownSwitchFilter(model).filter(np.zeros(3), [1, 1, 1])
    with pytest.raises(ParameterError, match=r"r: got the regimes \(1, 0\) at observations 2 and 3"):
        KnownSwitchFilter(model).filter(np.zeros(4), [0, 1, 1, 0])
    f = KnownSwitchFilter(model)
    f.step(0.0, 0)
    f.step(0.0, 1)
    with pytest.raises(ParameterError, match=r"r: got the regimes \(1, 0\) at observations 1 and 2"):
        f.step(0.0, 0)


# --------------------------------------------------------------------------- gaps


@pytest.mark.parametrize("order", [1, 3])
def test_gaps_are_exact_for_one_class(order):
    # against conditioning the joint Gaussian of the converted model, written down from its tables
    model = CGOMSModel.from_cglssm([[1.0]], *([MATRICES[name][0]] for name in "ABC"), [[[0.8]]], order=order)
    N, m = 9, 2
    system = model.on_nodes()
    first = system.initial()
    L, noise = np.eye(3 * N), np.zeros((3 * N, 3 * N))
    noise[:3, :3] = first.covariance[0]
    for n in range(N - 1):
        Axx, H, G, _, C, Ayy, _, V = (value[0, 0] for value in system.pair_tables(n).pairs)
        x, y = np.arange(3 * n + 3, 3 * n + 5), np.array([3 * n + 5])
        window = np.array([3 * k + 2 for k in range(n, max(-1, n - order), -1)])
        L[np.ix_(x, np.arange(3 * n, 3 * n + 2))] = -Axx
        L[np.ix_(x, window)], L[np.ix_(y, window)] = -(H + G @ Ayy), -Ayy
        noise[np.ix_(x, x)], noise[np.ix_(y, y)] = C + G @ V @ G.T, V
        noise[np.ix_(x, y)] = G @ V
        noise[np.ix_(y, x)] = (G @ V).T
    S = np.linalg.inv(L) @ noise @ np.linalg.inv(L).T
    ys = np.random.default_rng(8).normal(size=(N, 1))
    ys[[2, 5, 6]] = np.nan
    result = CGOMSMFilter(model).filter(ys)
    for n in range(N):
        seen = np.array([3 * k + 2 for k in range(n + 1) if not np.isnan(ys[k, 0])])
        gain = np.linalg.solve(S[np.ix_(seen, seen)], S[np.ix_(seen, np.arange(3 * n, 3 * n + m))]).T
        np.testing.assert_allclose(result.x[n], gain @ ys[(seen - 2) // 3, 0], rtol=1e-9, atol=1e-11)
