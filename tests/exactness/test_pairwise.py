"""Pairwise models, in which the state acts on the next observation, against the enumeration of all paths.

Exact where the condition of exactness holds: complete observations, gaps at the end; of one history alone
whatever is missing.
"""

from __future__ import annotations

import json
from itertools import pairwise, product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fuzzykf import CGOMSMFilter, CGOMSModel, KnownSwitchFilter
from fuzzykf.switching.dynamics.exactness import corrected

CASES = json.loads((Path(__file__).parents[1] / "data" / "enumeration.json").read_text())["cases"]
CASES = {case["id"]: case for case in CASES if case["kind"] == "pairwise"}
SEEDS = st.integers(0, 10**6)


def definite(rng, *shape):
    root = 0.5 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def parameters(rng, K, m, q):
    """Parameters of a model that has no exact filter, and a chain some arrows of which are missing."""
    d = m + q
    T = rng.dirichlet(np.ones(K), K) * (rng.random((K, K)) < 0.7) + 0.1 * np.eye(K)
    return {
        "transition": T / T.sum(axis=1, keepdims=True),
        "A": 0.6 * rng.normal(size=(K, d, d)),
        "noise": definite(rng, K, d, d),
        "offset": rng.normal(size=(K, d)),
        "means": rng.normal(size=(K, d)),
        "covariances": definite(rng, K, d, d),
        "dim_x": m,
        "initial": rng.dirichlet(np.ones(K)),
    }


def exact_parameters(rng, K, m, q, kind):
    """The same on the condition of exactness, for any of the families."""
    found = parameters(rng, K, m, q)
    A, noise = found["A"], found["noise"]
    if kind == "no feedback":
        A[:, m:, :m] = 0.0
    elif kind == "slaved":  # nothing stays of the state
        A[:, :m, :m] = corrected(A, noise, m)[0] @ A[:, m:, :m]
    else:  # in part, in directions that no axis has
        A[:, m:, 1:m] = 0.0
        A[:, 0, :m] -= corrected(A, noise, m)[1][:, 0]
        turn = np.eye(m + q)
        turn[:m, :m] = rng.normal(size=(m, m)) + 2.0 * np.eye(m)
        back = np.linalg.inv(turn)
        found["A"], found["noise"] = turn @ A @ back, turn @ noise @ turn.T
    return found


def enumerated(given, ys, upto=None, paths=None):
    """Posterior of states and regimes given y_1..upto, NaN where missing; no recursion over time."""
    n, (K, d), m = len(ys), given["means"].shape, given["dim_x"]
    seen = ys.copy()
    seen[n if upto is None else upto :] = np.nan
    at = np.arange(n * d).reshape(n, d)[:, m:][~np.isnan(seen)]
    found = []
    for path in product(range(K), repeat=n) if paths is None else paths:
        p = given["initial"][path[0]] * np.prod([given["transition"][i, j] for i, j in pairwise(path)])
        if p == 0.0 and paths is None:
            continue
        L, D, b = np.eye(n * d), np.zeros((n * d, n * d)), np.zeros(n * d)
        for k, j in enumerate(path):
            here = slice(k * d, (k + 1) * d)
            b[here] = given["offset"][j] if k else given["means"][j]
            D[here, here] = given["noise"][j] if k else given["covariances"][j]
            if k:
                L[here, (k - 1) * d : k * d] = -given["A"][j]
        inverse = np.linalg.inv(L)
        mean, P = inverse @ b, inverse @ D @ inverse.T
        value = 0.0 if paths is not None else np.log(p)
        if at.size:
            S, off = P[np.ix_(at, at)], seen[~np.isnan(seen)] - mean[at]
            value -= 0.5 * (off @ np.linalg.solve(S, off) + np.linalg.slogdet(2 * np.pi * S)[1])
            gain = np.linalg.solve(S, P[at]).T
            mean, P = mean + gain @ off, P - gain @ P[at]
        blocks = [P[k * d : k * d + m, k * d : k * d + m] for k in range(n)]
        found.append((value, path, mean.reshape(n, d)[:, :m], np.array(blocks)))
    log_w = np.array([one[0] for one in found])
    total = np.logaddexp.reduce(log_w)
    w, x, P = np.exp(log_w - total), np.array([f[2] for f in found]), np.array([f[3] for f in found])
    off = x - np.einsum("p,pnk->nk", w, x)
    return SimpleNamespace(
        x=np.einsum("p,pnk->nk", w, x),
        P=np.einsum("p,pnkl->nkl", w, P + off[..., :, None] * off[..., None, :]),
        mu=np.einsum("p,pnj->nj", w, np.eye(K)[[list(f[1]) for f in found]]),
        total=total,
        path=found[int(log_w.argmax())][1],
    )


def check(f, given, ys, *args, paths=None, smoother=True):
    """Compare filter and smoother with the enumeration."""
    result = f.filter(ys, *args)
    truth = [enumerated(given, ys, n + 1, paths) for n in range(len(ys))]
    for name in ("x", "P") if paths else ("x", "P", "mu"):
        expected = [getattr(one, name)[n] for n, one in enumerate(truth)]
        np.testing.assert_allclose(getattr(result, name), expected, rtol=1e-8, atol=1e-9, err_msg=name)
    expected = np.diff([0.0] + [one.total for one in truth])
    np.testing.assert_allclose(result.log_likelihood, expected, rtol=1e-8, atol=1e-9)
    if smoother:
        smoothed, whole = f.smooth(ys, *args), truth[-1]
        for name in ("x", "P") if paths else ("x", "P", "mu"):
            found, wanted = getattr(smoothed, name), getattr(whole, name)
            np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-9, err_msg=name)
        if not paths:
            np.testing.assert_array_equal(smoothed.switch_path, whole.path)


# --------------------------------------------------------------------------- the reference cases


def of_case(case):
    blocks = zip(*(np.array(case[name]) for name in "ABCD"), strict=True)
    return CGOMSModel.from_pairwise(
        case["T"],
        [np.block([[A, B], [C, D]]) for A, B, C, D in blocks],
        noise=case["noise"],
        offset=np.concatenate([case["b"], case["d"]], axis=1),
        means=case["means"],
        covariances=case["covariances"],
        dim_x=case["dim_x"],
        initial=case["p0"],
    )


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_the_reference_cases(case):
    f, ys = CGOMSMFilter(of_case(case)), np.array(case["y"])
    result, many = f.filter(ys), f.filter_many([ys, ys], ("x", "P", "mu", "log_likelihood"))
    f.reset()
    steps = []
    for y in ys:
        f.step(y)
        steps.append((f.x[:, 0], f.P, f.mu, f.log_likelihood))
    for name, stepped in zip(("x", "P", "mu", "log_likelihood"), zip(*steps, strict=True), strict=True):
        for found in (getattr(result, name), getattr(many, name)[1], stepped):
            np.testing.assert_allclose(found, case["filter"][name], rtol=1e-9, atol=1e-10, err_msg=name)
    smoothed = f.smooth(ys)
    for name in ("x", "P", "mu"):
        np.testing.assert_allclose(getattr(smoothed, name), case["smooth"][name], rtol=1e-9, atol=1e-10)


# --------------------------------------------------------------------------- any exact model


@settings(max_examples=20, deadline=None)
@given(
    seed=SEEDS,
    K=st.integers(2, 3),
    m=st.integers(1, 3),
    q=st.integers(1, 2),
    kind=st.sampled_from(["no feedback", "slaved", "in part"]),
)
def test_filter_and_smoother_are_exact_on_the_condition(seed, K, m, q, kind):
    rng = np.random.default_rng(seed)
    given = exact_parameters(rng, K, m, q, kind)
    assume(np.linalg.cond(given["noise"]).max() < 1e6)  # of 16 digits, ten are left
    model = CGOMSModel.from_pairwise(**given)
    assert model.exactness.startswith("exact: ")
    check(CGOMSMFilter(model), given, model.simulate(5, rng).y)


@pytest.mark.parametrize("kind", ["no feedback", "slaved", "in part"])
def test_a_gap_at_the_end_is_exact(kind):
    rng = np.random.default_rng(3)
    given = exact_parameters(rng, 2, 2, 2, kind)
    model = CGOMSModel.from_pairwise(**given)
    ys = model.simulate(6, rng).y
    ys[4:] = np.nan
    check(CGOMSMFilter(model), given, ys)


@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 1), (2, 2)])
def test_one_regime_is_exact_whatever_is_missing(m, q):
    rng = np.random.default_rng(10 * m + q)
    given = parameters(rng, 1, m, q)
    model = CGOMSModel.from_pairwise(**given)
    ys = model.simulate(8, rng).y
    for holes in ([], [0], [0, 1], [3, 4], [7], [(2, 0), (5, q - 1)], [0, 3, (5, 0), 7]):
        pierced = ys.copy()
        for hole in holes:
            pierced[hole] = np.nan
        check(CGOMSMFilter(model), given, pierced)


@pytest.mark.parametrize("transition", [np.eye(3), [[0, 1, 0], [0, 0, 1], [1, 0, 0]]])
def test_regimes_in_which_no_histories_meet_are_exact_whatever_is_missing(transition):
    # a bank of Kalman filters, whose weights alone are in doubt
    rng = np.random.default_rng(5)
    given = parameters(rng, 3, 2, 2) | {"transition": np.array(transition, dtype=float)}
    model = CGOMSModel.from_pairwise(**given)
    ys = model.simulate(7, rng).y
    ys[[0, 3]], ys[5, 1] = np.nan, np.nan
    check(CGOMSMFilter(model), given, ys)


def test_what_follows_a_single_history_may_be_anything():
    # 0 -> 0 or 1 -> 1: 1 is reached at any time, so the condition is asked behind it, and not behind 0
    rng = np.random.default_rng(8)
    given = parameters(rng, 2, 2, 1)
    M, _ = corrected(given["A"], given["noise"], 2)
    given["A"][1, :2, :2] = M[1] @ given["A"][1, 2:, :2]
    given |= {"transition": np.array([[0.6, 0.4], [0.0, 1.0]]), "initial": np.array([1.0, 0.0])}
    model = CGOMSModel.from_pairwise(**given)
    check(CGOMSMFilter(model), given, model.simulate(6, rng).y)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, K=st.integers(1, 3), m=st.integers(1, 2), q=st.integers(1, 2), holes=st.booleans())
def test_a_known_switch_is_exact_in_any_model(seed, K, m, q, holes):
    rng = np.random.default_rng(seed)
    given = parameters(rng, K, m, q)
    model = CGOMSModel.from_pairwise(**given)
    data = model.simulate(6, rng)
    ys = data.y.copy()
    if holes:
        ys[rng.random(ys.shape) < 0.3] = np.nan
    check(KnownSwitchFilter(model), given, ys, data.r, paths=[tuple(data.r.astype(int))])


def test_singular_noise_of_the_state_is_exact():
    rng = np.random.default_rng(2)
    given = exact_parameters(rng, 2, 2, 1, "no feedback")
    given["noise"][:, :2] = given["noise"][:, :, :2] = 0.0
    given["covariances"][:, 0] = given["covariances"][:, :, 0] = 0.0
    given["A"][:, 2, 0], given["A"][:, 0, :2] = 0.5, 0.0  # X_1 follows the observation, and acts on the next
    model = CGOMSModel.from_pairwise(**given)
    assert model.form.has_feedback
    check(CGOMSMFilter(model), given, model.simulate(6, rng).y)


def test_a_gap_between_regimes_is_an_approximation_of_which_the_size_is_known():
    # the worst of these series: .20 of a standard deviation of the state, .12 in a probability
    worst = np.zeros(2)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        given = exact_parameters(rng, 2, 1, 1, "slaved")
        model = CGOMSModel.from_pairwise(**given)
        ys = model.simulate(6, rng).y
        ys[3] = np.nan
        result, truth = CGOMSMFilter(model).smooth(ys), enumerated(given, ys)
        sd = np.sqrt(np.diagonal(truth.P, axis1=1, axis2=2))
        found = (np.abs(result.x - truth.x) / sd).max(), np.abs(result.mu - truth.mu).max()
        worst = np.maximum(worst, found)
    assert (worst > 1e-6).all()
    assert (worst < [0.4, 0.24]).all()


def test_simulations_have_no_units():
    given = parameters(np.random.default_rng(3), 2, 2, 1)
    units = np.array([1e-8, 1.0, 1e8])
    scaled = given | {
        "A": units[:, None] * given["A"] / units,
        "noise": units[:, None] * given["noise"] * units,
        "covariances": units[:, None] * given["covariances"] * units,
        "offset": given["offset"] * units,
        "means": given["means"] * units,
    }
    one, other = (
        CGOMSModel.from_pairwise(**a).simulate(200, np.random.default_rng(0)) for a in (given, scaled)
    )
    np.testing.assert_allclose(other.x, one.x * units[:2], rtol=1e-9)
    np.testing.assert_allclose(other.y, one.y * units[2:], rtol=1e-9)
