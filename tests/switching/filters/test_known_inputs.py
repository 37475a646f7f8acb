"""R and H that the filter of a known switch is told, against the Kalman filter written out."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSModel, FadeLaw, KnownSwitchFilter, SwitchingKalmanFilter, SwitchingStateSpace
from fuzzykf.errors import FuzzykfError, NotPositiveDefiniteError, ParameterError, ShapeError

M, Q, N = 2, 2, 6
RNG = np.random.default_rng(5)
RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})
HARD = [[0.9, 0.1], [0.2, 0.8]]


def space(law, mix="linear"):
    """A model with everything that may follow the switch."""
    rng = np.random.default_rng(1)
    K = len(law) if isinstance(law, list) else law.n_classes
    spread = rng.normal(size=(3, K, M, M))
    Q_, R_, P0 = (a @ np.swapaxes(a, -1, -2) + 0.3 * np.eye(M) for a in spread)
    return SwitchingStateSpace(
        law, F=0.5 * rng.normal(size=(K, M, M)), H=rng.normal(size=(K, Q, M)), Q=Q_, R=R_,
        b=rng.normal(size=M), d=rng.normal(size=(K, Q)), B=rng.normal(size=(K, M, 1)),
        x0=rng.normal(size=(K, M)), P0=P0, mix=mix,
    )  # fmt: skip


#: Models, values of the switch, and the same as class weights.
SWITCHES = {
    "fades": (space(FadeLaw.between(30, 10)), np.array([0.0, 0.25, 0.5, 1.0, 1.0, 0.7])),
    "fades, log": (space(FadeLaw.between(30, 10), "log"), np.array([0.1, 0.25, 0.5, 1.0, 0.0, 0.7])),
    "hard": (space(HARD), np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0])),
    "ring": (space(RING), RNG.dirichlet(np.ones(3), N)),
}

SHARED_R, SHARED_H = np.array([[0.5, 0.1], [0.1, 0.7]]), np.array([[1.0, 0.2], [0.0, -1.0]])


def each_R(K):
    return np.array([(1.0 + k) * SHARED_R for k in range(K)])


def each_H(K):
    return np.array([SHARED_H + k for k in range(K)])


#: Rs and Hs of a series, for K classes.
TOLD = {
    "numbers": lambda K: {"Rs": [0.5, 1.0, 2.0, 0.1, 0.3, 4.0]},
    "matrices": lambda K: {"Rs": [SHARED_R * k for k in range(1, N + 1)], "Hs": [SHARED_H] * N},
    "an array": lambda K: {"Rs": np.array([SHARED_R * k for k in range(1, N + 1)])},
    "for each class": lambda K: {"Rs": [each_R(K)] * N, "Hs": [each_H(K)] * N},
    "functions": lambda K: {
        "Rs": [lambda w: (1.0 + w[0]) * np.eye(Q)] * N,
        "Hs": [lambda w: SHARED_H * (1.0 + w[-1] ** 2)] * N,
    },
    "some": lambda K: {"Rs": [None, 2.0, None, each_R(K), None, None], "Hs": [SHARED_H, *[None] * (N - 1)]},
}


def told_at(name, given, model, weights):
    """What is told of a step, as one matrix; that of the model where nothing is."""
    if given is None:
        return model.form.at(name, weights)
    if callable(given):
        return given(weights)
    if np.ndim(given) == 0:
        return given * np.eye(Q)
    if np.ndim(given) == 2:
        return given
    if name == "R" and model.form.mix == "log":  # between classes that are multiples of one another
        scale = np.exp(weights @ np.log([one[0, 0] for one in given]))
        return scale / given[0][0, 0] * given[0]
    return np.einsum("k,kab->ab", weights, given)


def kalman(model, ys, weights, us, Rs, Hs):
    """The Kalman filter along the switch: x, P and the log-likelihoods."""
    at, rows = model.form.at, []
    for n, (y, w) in enumerate(zip(ys, weights, strict=True)):
        if n == 0:
            x, P = at("x0", w), at("P0", w)
        else:
            F = at("F", w)
            x, P = F @ x + at("b", w) + at("B", w) @ us[n], F @ P @ F.T + at("Q", w)
        R, H = told_at("R", Rs[n], model, w), told_at("H", Hs[n], model, w)
        seen, value = ~np.isnan(y), 0.0
        if seen.any():
            H, R, e = H[seen], R[np.ix_(seen, seen)], (y - H @ x - at("d", w))[seen]
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            value = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2.0 * np.pi * S)[1])
            x, P = x + K @ e, P - K @ S @ K.T
        rows.append((x, P, value))
    return [np.array(one) for one in zip(*rows, strict=True)]


def agree(found, expected):
    for name, value in zip(("x", "P", "log_likelihood"), expected, strict=True):
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-9, atol=1e-11, err_msg=name)


class Passing(KnownSwitchFilter):
    """Its verbs are those of fuzzykf, but nobody can know that: series go by them."""

    def update(self, z, *args, **options):
        super().update(z, *args, **options)


def observations():
    ys = np.random.default_rng(2).normal(size=(N, Q))
    ys[2], ys[4, 0] = np.nan, np.nan
    return ys


@pytest.mark.parametrize("told", TOLD)
@pytest.mark.parametrize("switch", SWITCHES)
def test_R_and_H_count_at_the_value_of_the_switch_however_they_are_told(switch, told):
    model, r = SWITCHES[switch]
    ys, us = observations(), np.linspace(-1.0, 1.0, N)[:, None]
    given = TOLD[told](model.n_classes)
    looks = {name: given.get(name, [None] * N) for name in ("Rs", "Hs")}
    expected = kalman(model, ys, model.class_weights(r), us, **looks)
    f = KnownSwitchFilter(model)
    agree(f.filter(ys, r, us, **given), expected)
    agree(Passing(model).filter(ys, r, us, **given), expected)
    many = f.filter_many(np.stack([ys, -ys]), r=np.stack([r, r]), us=us, **given)
    agree(many.one(0), expected)
    agree(many.one(1), kalman(model, -ys, model.class_weights(r), us, **looks))
    # by the verbs, the switch told at predict or at update; in two parts, the first of which ends in a skip
    early, late, rest = KnownSwitchFilter(model), KnownSwitchFilter(model), KnownSwitchFilter(model)
    for n, y in enumerate(ys):
        look = {name: looks[f"{name}s"][n] for name in ("R", "H")}
        early.step(y, r[n], us[n], **look)
        late.predict(None, us[n])
        late.update(y, r[n], **look)
        for g in (early, late):
            np.testing.assert_allclose(g.x[:, 0], expected[0][n], rtol=1e-9, atol=1e-11)
            assert g.log_likelihood == pytest.approx(expected[2][n], rel=1e-9)
        np.testing.assert_allclose(early.nis, late.nis, rtol=1e-9)
    parts = {name: (one[:2], one[3:]) for name, one in given.items()}
    rest.filter(ys[:2], r[:2], us[:2], **{name: one[0] for name, one in parts.items()})
    rest.predict(r[2], us[2])  # and y_2 is missing
    after = {name: one[1] for name, one in parts.items()}
    both = rest.filter_many(ys[None, 3:], r=r[None, 3:], us=us[3:], resume=True, **after).one(0)
    np.testing.assert_allclose(both.x, expected[0][3:], rtol=1e-9, atol=1e-11)
    resumed = rest.filter(ys[3:], r[3:], us[3:], resume=True, **after)
    np.testing.assert_allclose(resumed.x, expected[0][3:], rtol=1e-9, atol=1e-11)


def test_innovation_of_the_first_observation_is_that_of_the_R_it_was_told():
    model, r = SWITCHES["fades"]
    f = KnownSwitchFilter(model)
    f.step([1.0, 0.0], r[0], None, 5.0, SHARED_H)
    w = model.class_weights(r[:1])[0]
    S = SHARED_H @ model.form.at("P0", w) @ SHARED_H.T + 5.0 * np.eye(Q)
    np.testing.assert_allclose(f.S, S, rtol=1e-12)
    f.filter(np.ones((1, Q)), r[:1], Rs=[5.0], Hs=[SHARED_H])
    np.testing.assert_allclose(f.S, S, rtol=1e-12)
    f.reset()
    f.step([1.0, 0.0], r[0])
    np.testing.assert_allclose(
        f.S, model.form.at("H", w) @ model.form.at("P0", w) @ model.form.at("H", w).T + model.form.at("R", w)
    )


def test_a_switch_of_one_class_is_told_as_the_filter_that_finds_the_switch_is():
    one = SwitchingStateSpace([[1.0]], F=0.9, H=1.0, Q=0.2, R=0.4, B=1.0)
    ys, given = np.array([0.1, 0.5, np.nan, 2.0]), {"Rs": [None, 1.0, 2.0, 3.0], "Hs": [[[2.0]]] * 4}
    us = np.arange(4.0)
    found = KnownSwitchFilter(one).filter(ys, np.zeros(4), us, **given)
    expected = SwitchingKalmanFilter(one).filter(ys, us, **given)
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


# --------------------------------------------------------------------------- what is refused

PAIR = np.kron([[1.0, 0.5], [0.5, 1.0]], np.array([[1.0, 0.4, 0.2], [0.4, 1.0, 0.1], [0.2, 0.1, 1.0]]))
PAIRWISE = CGOMSModel([[0.9, 0.1], [0.2, 0.8]], np.zeros((2, 3)), np.broadcast_to(PAIR, (2, 2, 6, 6)), 1)

ZS, RS = np.zeros((2, Q)), [0.0, 1.0]
CALLS = {
    "update": lambda f, R, H: f.update([0.0, 0.0], 0.0, R, H),
    "step": lambda f, R, H: f.step([0.0, 0.0], 0.0, None, R, H),
    "filter": lambda f, R, H: f.filter(ZS, RS, Rs=R and [None, R], Hs=H and [None, H]),
    "filter_many": lambda f, R, H: f.filter_many(ZS[None], r=[RS], Rs=R and [None, R], Hs=H and [None, H]),
}
WRONG = {
    "no model": (PAIRWISE, 1.0, None, ParameterError, r"Rs?: got .*, but the model has no R; expected None"),
    "no H": (PAIRWISE, None, [[1.0]], ParameterError, r"Hs?: got .*, but the model has no H; expected None"),
    "shape of R": (
        None, [1.0, 2.0, 3.0], None, ShapeError, r"R(s\[1\])?: got shape \(3,\), expected \(2, 2\)",
    ),
    "shape of H": (None, None, [[1.0]], ShapeError, r"H(s\[1\])?: got shape \(1, 1\), expected \(2, 2\)"),
    "indefinite": (
        None, [[1.0, 2.0], [2.0, 1.0]], None, NotPositiveDefiniteError, r"R(s\[1\])?: .*eigenvalue -1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_R_or_H_is_refused_by_name_and_leaves_the_filter_as_it_was(what, call):
    model, R, H, error, message = WRONG[what]
    f = KnownSwitchFilter(model or SWITCHES["fades"][0])
    f.step([0.3, 0.1], 1.0)
    if call == "update":
        f.predict()
    before = f.x, f.P, f.nodes, f._n
    with pytest.raises(error, match=message):
        CALLS[call](f, R, H)
    for now, was in zip((f.x, f.P, f.nodes, f._n), before, strict=True):
        np.testing.assert_array_equal(now, was)
    f.update([0.3, 0.1], 0.0) if call == "update" else f.step([0.3, 0.1], 0.0)


@pytest.mark.parametrize("name", ["Rs", "Hs"])
@pytest.mark.parametrize("given", [1.0, [1.0], "ab", [None] * 3])
def test_one_is_told_for_each_observation(name, given):
    f = KnownSwitchFilter(SWITCHES["fades"][0])
    for call in (
        lambda: f.filter(ZS, RS, **{name: given}),
        lambda: f.filter_many(ZS[None], r=[RS], **{name: given}),
    ):
        with pytest.raises(FuzzykfError, match=f"{name}.*: "):
            call()
