"""IMM and GPB2 on pairwise models: exact where they should be, as on state-space models, and refusals."""

from __future__ import annotations

import copy
import pickle
from itertools import pairwise, product

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel, SwitchingKalmanFilter, SwitchingStateSpace, io
from fuzzykf.errors import ParameterError
from fuzzykf.switching.dynamics.nodes import joint_moments
from fuzzykf.switching.inference.series import SHOWN
from fuzzykf.testing import check_filter

METHODS = ["imm", "gpb2"]
NAN = np.nan
SIZES = [(1, 1, 2), (2, 1, 3), (2, 2, 2), (3, 2, 3)]  # m, q, K


def definite(rng, *shape):
    root = 0.5 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def given_of(m, q, K, seed=0):
    """Parameters of a model that has no exact filter."""
    rng, d = np.random.default_rng(seed), m + q
    return {
        "transition": 0.6 * np.eye(K) + 0.4 / K,
        "A": 0.5 * rng.normal(size=(K, d, d)),
        "noise": definite(rng, K, d, d),
        "offset": rng.normal(size=(K, d)),
        "means": rng.normal(size=(K, d)),
        "covariances": definite(rng, K, d, d),
        "dim_x": m,
        "initial": rng.dirichlet(np.ones(K)),
    }


def made(m=2, q=2, K=2, **change):
    return CGOMSModel.from_pairwise(**(given_of(m, q, K) | change))


def data(q, n=15, gaps=True, seed=1):
    zs = 2.0 * np.random.default_rng(seed).normal(size=(n, q))
    if gaps:
        zs[[0, 4, 5]], zs[8, 0], zs[9, -1], zs[-1] = NAN, NAN, NAN, NAN
    return zs


def both_forms(m, q, K):
    """A state-space model, and the same as a pairwise model."""
    rng = np.random.default_rng(3)
    F, H, b, d = (rng.normal(size=s) for s in ((K, m, m), (K, q, m), (K, m), (K, q)))
    F, Q, R, x0 = 0.5 * F, definite(rng, K, m, m), definite(rng, K, q, q), rng.normal(size=(K, m))
    P0, T, start = definite(rng, K, m, m), 0.5 * np.eye(K) + 0.5 / K, rng.dirichlet(np.ones(K))
    space = SwitchingStateSpace(T, F, H, Q, R, initial=start, b=b, d=d, x0=x0, P0=P0)
    A = np.zeros((K, m + q, m + q))
    A[:, :m, :m], A[:, m:, :m] = F, H @ F
    offset, noise = joint_moments(b, Q, H, d, R)  # Y' = H X' + d + N(0, R), of the moved zero
    means, covariances = joint_moments(x0, P0, H, d, R)
    pairs = CGOMSModel.from_pairwise(
        T, A, noise=noise, offset=offset, means=means, covariances=covariances, dim_x=m, initial=start
    )
    return space, pairs


# --------------------------------------------------------------------------- what they equal


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("m", "q", "K"), SIZES)
@pytest.mark.parametrize("gaps", [False, True])
def test_a_state_space_model_is_one_case(m, q, K, method, gaps):
    space, pairs = both_forms(m, q, K)
    f, g = (SwitchingKalmanFilter(one, method=method, n_nodes=0) for one in (space, pairs))
    zs = data(q, gaps=gaps)
    one, other = f.filter(zs), g.filter(zs)
    for name in SHOWN:
        wanted, found = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10, err_msg=name)
    for name in ("x", "P", "z_prior", "S", "mu"):
        wanted, found = getattr(f.forecast(4), name), getattr(g.forecast(4), name)
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10, err_msg=name)
    np.testing.assert_allclose(g.S, f.S, rtol=1e-10)
    np.testing.assert_allclose(g.nis, f.nis, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("m", "q", "K"), SIZES)
def test_without_feedback_both_are_the_exact_filter(m, q, K, method):
    given = given_of(m, q, K)
    given["A"][:, m:, :m] = 0.0
    model = CGOMSModel.from_pairwise(**given)
    zs = model.simulate(40, np.random.default_rng(2)).y
    zs[-3:] = NAN  # a gap at the end is exact, too
    exact, found = CGOMSMFilter(model).filter(zs), SwitchingKalmanFilter(model, method=method).filter(zs)
    for name in SHOWN:
        wanted = getattr(exact, name)
        np.testing.assert_allclose(getattr(found, name), wanted, rtol=1e-12, atol=1e-12, err_msg=name)
    exact, found = CGOMSMFilter(model).smooth(zs), SwitchingKalmanFilter(model, method=method).smooth(zs)
    for name in ("x", "P", "mu", "switch_path"):
        np.testing.assert_allclose(getattr(found, name), getattr(exact, name), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("gaps", [False, True])
def test_verbs_series_and_many_series_agree_in_every_field(method, gaps):
    model, zs = made(), data(2, gaps=gaps)
    f, g = (SwitchingKalmanFilter(model, method=method) for _ in range(2))
    one = f.filter(zs, keep_nodes=True)
    many = f.filter_many(np.stack([zs, zs[::-1]]), SHOWN)
    for n, z in enumerate(zs):
        g.step(z)
        for name in SHOWN:
            value, expected = np.array(getattr(g, name)), getattr(one, name)[n]
            np.testing.assert_allclose(value.reshape(np.shape(expected)), expected, atol=1e-11, err_msg=name)
    for name in SHOWN:
        np.testing.assert_array_equal(getattr(many, name)[0], getattr(one, name), err_msg=name)
    assert (one.node_x.shape, one.node_P.shape) == ((15, 2, 2), (15, 2, 2, 2))
    assert one.interval(0.9)[0].shape == (15, 2)


def test_where_nothing_is_exact_gpb2_is_the_nearer():
    # log-likelihood of six observations, of 20 systems: GPB2 off by .010 in the mean, IMM by .118
    off = {method: [] for method in METHODS}
    for seed in range(20):
        given = given_of(1, 1, 2, seed)
        model = CGOMSModel.from_pairwise(**given)
        ys = model.simulate(6, np.random.default_rng(seed)).y
        bank = []  # each path of the regimes is a model whose one regime is the time
        for path in product(range(2), repeat=6):
            p = given["initial"][path[0]] * np.prod([given["transition"][a] for a in pairwise(path)])
            bank.append(np.log(p) + _along(given, path, ys))
        truth = np.logaddexp.reduce(bank)
        for method in METHODS:
            found = SwitchingKalmanFilter(model, method=method).filter(ys).log_likelihood
            off[method].append(abs(found.sum() - truth))
            two = SwitchingKalmanFilter(model, method="gpb2").filter(ys[:2]).log_likelihood.sum()
        pairs = [[np.log(given["initial"][i] * given["transition"][i, j]) + _along(given, (i, j), ys[:2])
                  for j in range(2)] for i in range(2)]  # fmt: skip
        np.testing.assert_allclose(two, np.logaddexp.reduce(np.ravel(pairs)), rtol=1e-12)
    imm, gpb2 = (np.mean(off[method]) for method in METHODS)
    assert 1e-4 < gpb2 < 0.02
    assert gpb2 < imm < 0.24


def _along(given, path, ys):
    """Log-density of observations along a path, from the joint Gaussian of all times."""
    n, d, m = len(path), given["means"].shape[1], given["dim_x"]
    L, D, b = np.eye(n * d), np.zeros((n * d, n * d)), np.zeros(n * d)
    for k, j in enumerate(path):
        here = slice(k * d, (k + 1) * d)
        b[here] = given["offset"][j] if k else given["means"][j]
        D[here, here] = given["noise"][j] if k else given["covariances"][j]
        if k:
            L[here, (k - 1) * d : k * d] = -given["A"][j]
    at = np.arange(n * d).reshape(n, d)[:, m:].ravel()
    inverse = np.linalg.inv(L)
    S, off = (inverse @ D @ inverse.T)[np.ix_(at, at)], ys.ravel() - (inverse @ b)[at]
    return -0.5 * (off @ np.linalg.solve(S, off) + np.linalg.slogdet(2 * np.pi * S)[1])


# --------------------------------------------------------------------------- promises of filters


@pytest.mark.parametrize(("method", "m", "q"), [("imm", 2, 2), ("gpb2", 1, 1)])
def test_it_keeps_the_contract_of_filters(method, m, q):
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None] + 0.7 * np.arange(q))
    report = check_filter(lambda: SwitchingKalmanFilter(made(m, q), method=method), zs)
    assert {"saver", "save", "resume", "filter_many", "outlier"} <= set(report.passed)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [0, 1, 2, 5, 8, 9])
@pytest.mark.parametrize("again", ["file", "pickle", "copy"])
def test_it_comes_back_in_its_state_and_goes_on_to_the_bit(method, n, again, tmp_path):
    f, zs = SwitchingKalmanFilter(made(), method=method), data(2)
    f.filter(zs[:n])
    if again == "file":
        f.save(tmp_path / "filter.json")
        g = io.load_filter(tmp_path / "filter.json")
    else:
        g = pickle.loads(pickle.dumps(f)) if again == "pickle" else copy.deepcopy(f)
    for name in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood", "y", "S"):
        np.testing.assert_array_equal(getattr(g, name), getattr(f, name), err_msg=name)
    for name in ("x", "P", "mu", "log_likelihood"):
        whole, tail = f.filter(zs[n:], resume=True), g.filter(zs[n:], resume=True)
        np.testing.assert_array_equal(getattr(tail, name), getattr(whole, name))
        f.reset()
        g.reset()


@pytest.mark.parametrize(
    "call",
    [
        lambda f: f.update(np.ones(2), R=1.0),
        lambda f: f.update(np.ones(2), H=np.eye(2)),
        lambda f: f.step(np.ones(2), R=1.0),
        lambda f: f.predict(u=1.0),
        lambda f: f.filter(data(2), us=np.ones(15)),
        lambda f: f.filter(data(2), Rs=[None] * 14 + [1.0]),
        lambda f: f.filter_many([data(2)], Hs=[np.eye(2)] * 15),
        lambda f: f.forecast(2, us=np.ones(2)),
    ],
)
def test_what_a_pairwise_model_does_not_have_cannot_be_told(call):
    f = SwitchingKalmanFilter(made())
    f.filter(data(2)[:3])
    before = f.to_dict()
    with pytest.raises(
        ParameterError, match=r"^(R|H|u|us|Rs|Hs): got .*, but .* has no [RHB].*; expected None"
    ):
        call(f)
    assert f.to_dict() == before


def test_a_pairwise_model_is_smoothed_by_the_density_alone():
    f = SwitchingKalmanFilter(made())
    assert f.smooth(data(2), weights="density").x.shape == (len(data(2)), f.dim_x)
    with pytest.raises(ParameterError, match="weights: got 'kim', expected 'density'"):
        f.smooth(data(2), weights="kim")


def test_models_of_other_forms_are_refused(hard_model, fuzzy_model):
    with pytest.raises(
        ParameterError, match="model: got a CGOMSModel of the form 'transition', expected a Sw"
    ):
        SwitchingKalmanFilter(hard_model)
    for wrong in (fuzzy_model, None, "model"):
        with pytest.raises(
            ParameterError, match=r"model: got \w+, expected a SwitchingStateSpace .*or a CGOMSM"
        ):
            SwitchingKalmanFilter(wrong)


@pytest.mark.parametrize("method", METHODS)
def test_an_outlier_leaves_a_sound_state(method):
    f, zs = SwitchingKalmanFilter(made(), method=method), data(2)
    zs[6] = 1e9
    result = f.filter(zs)
    assert np.isfinite(result.log_likelihood).all()
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-12)
    for P in result.P:
        assert np.linalg.eigvalsh(P).min() > 0.0
    assert np.isfinite(f.smooth(zs).x).all()


def test_an_outlier_does_not_round_the_weights_away():
    # the observation tells nothing of the regimes, which only the state has, however far off it is
    given = given_of(1, 1, 2)
    for name in ("A", "noise", "offset", "covariances", "means"):
        given[name][1, ..., 1:] = given[name][0, ..., 1:]
    given["noise"] = np.array([np.eye(2), np.diag([3.0, 1.0])])
    given["A"][:, 1, 0], given["A"][1, 1, 1] = 0.0, given["A"][0, 1, 1]
    given["covariances"] = np.array([np.eye(2)] * 2)
    given["transition"], given["initial"] = np.array([[0.9, 0.1], [0.4, 0.6]]), np.array([0.3, 0.7])
    model, zs = CGOMSModel.from_pairwise(**given), data(1, gaps=False)
    zs[6] = 1e9
    expected = given["initial"] @ np.linalg.matrix_power(given["transition"], 5)
    for f in (SwitchingKalmanFilter(model, method="gpb2"), CGOMSMFilter(model)):
        np.testing.assert_allclose(f.smooth(zs).mu[5], expected, rtol=1e-9)


@pytest.mark.parametrize("unit", [1e3, 1e-3])
def test_units_count_for_nothing_where_predicted_covariances_differ_in_rank(unit):
    # a state that moves in one regime alone, from a start that is known; observed with a gap
    def smoothed(s):
        noise = np.array([np.diag([0.0, 1.0]), np.diag([1.0, 1.0])]) * s * s
        A, start = np.array([[0.9, 0.0], [0.9, 0.0]]), np.array([np.diag([0.0, 1.0]), np.eye(2)])
        model = CGOMSModel.from_pairwise(
            [[0.9, 0.1], [0.2, 0.8]],
            [A, A],
            noise=noise,
            means=np.zeros((2, 2)),
            covariances=start * s * s,
            dim_x=1,
        )
        zs = np.array([1.0, 0.5, np.nan, 1.0, 1.0, 0.5, 2.0, 1.0])
        result = SwitchingKalmanFilter(model).smooth(s * zs)
        return result.x / s, result.P / s**2, result.mu

    for got, wanted in zip(smoothed(unit), smoothed(1.0), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-10)
