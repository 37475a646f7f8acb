"""Looking back with a fixed lag: `smooth_lag` of every filter that has it, and `FixedLag`.

The smoother of the series up to n + lag says what row n is.
"""

from __future__ import annotations

import copy
import pickle
from functools import cache

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    ExtendedKalmanFilter,
    FadeLaw,
    FixedLag,
    FuzzyMarkovLaw,
    FuzzyRelationEstimator,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.errors import FuzzykfError, HindsightWarning, NumericalRangeError, ParameterError, SequenceError
from fuzzykf.switching import EXACT, Method, SwitchingFilter

N = 10
NAN = np.nan
RNG = np.random.default_rng(0)
US, RS = RNG.normal(size=(N, 1)), RNG.uniform(0.2, 2.0, N)
HS = RNG.normal(size=(N, 1, 2))
R_KNOWN = np.where(np.arange(N) % 5 < 2, 1.0, 0.0)


def linear(cls=KalmanFilter, k=0, alpha=1.0):
    f = cls(2, 1, dim_u=1, F=[[1.0, 1.0 - 0.3 * k], [0.0, 0.9]], H=[[1.0, 0.2 * k]], R=0.5 + k)
    f.Q, f.B, f.alpha = np.diag([0.0, 0.3 + k]), np.array([[0.5], [1.0 - k]]), alpha  # a singular Q
    return f


def bank(method="imm", cls=IMMEstimator, member=KalmanFilter):
    return cls([linear(member), linear(k=1)], [0.3, 0.7], [[0.9, 0.1], [0.2, 0.8]], method=method)


class OwnKalman(KalmanFilter):
    def update(self, z, *more, **named):
        super().update(z, *more, **named)


class OwnBank(IMMEstimator):
    def update(self, z):
        super().update(z)


class OwnSwitching(SwitchingKalmanFilter):
    def update(self, z, *more, **named):
        super().update(z, *more, **named)


@cache
def space():
    F = [[[1.0, 0.5], [0.0, 0.9]], [[0.7, 0.0], [0.2, 0.5]]]
    parts = {
        "H": [[[1.0, 0.0]], [[0.3, 0.2]]],
        "Q": np.diag([0.0, 0.4]),
        "R": 0.4,
        "b": [[0.0, 0.0], [0.5, 1.0]],
    }
    law = FadeLaw.between(20, 6, jump=0.02)
    return SwitchingStateSpace(law, F=F, **parts, B=[[0.5], [1.0]], x0=[0.0, 1.0], P0=np.eye(2))


@cache
def pairwise(coupled=True):
    rng, K, d = np.random.default_rng(5), 2, 3
    A = 0.4 * rng.normal(size=(K, d, d))
    if not coupled:
        A[:, 2:, :2] = 0.0
    root = 0.3 * rng.normal(size=(2, K, d, d)) + np.eye(d)
    noise, covariances = root @ np.swapaxes(root, -1, -2)
    given = {"noise": noise, "covariances": covariances, "means": rng.normal(size=(K, d)), "dim_x": 2}
    return CGOMSModel.from_pairwise([[0.9, 0.1], [0.2, 0.8]], A, **given, initial=[0.5, 0.5])


@cache
def fuzzy(K=2, law=None):
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    blocks = [[0.8 if i == j else 0.3 + 0.1 * i for j in range(K)] for i in range(K)]
    covariances = np.array([[np.block([[z, c * z], [c * z, z]]) for c in row] for row in blocks])
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2) if law is None else law
    return CGOFMSModel(law, [[0.0, 3.0], [1.0, 0.0], [2.0, -2.0]][:K], covariances, dim_x=1)


@cache
def three_classes():
    return fuzzy(3, FadeLaw(3, {(0, 1): (0.1, 3.0), (1, 2): (0.1, 3.0), (2, 0): (0.1, 3.0)}))


@cache
def close(order, mode="stationary"):
    """With a window of several observations, whose first steps have tables of their own."""
    A, C = [[[0.9]], [[0.4]]], [[[0.3]], [[1.0]]]
    given = {"A": A, "B": [[[1.0]], [[0.8]]], "C": C, "D": [[[0.5]], [[0.6]]]}
    if mode != "stationary":
        given |= {"initial_probability": [0.5, 0.5], "initial_covariance": [[[1.0]], [[2.0]]]}
    return CGOMSModel.from_cglssm([[0.9, 0.1], [0.2, 0.8]], **given, order=order, mode=mode)


KALMAN = {"us": US[..., None]}
TOLD = {"us": US, "Rs": list(RS), "Hs": HS}

#: Name: what makes the filter, and what it is told along a series.
FILTERS = {
    "KalmanFilter": (linear, {}),
    "KalmanFilter, controls": (linear, KALMAN),
    "KalmanFilter, fading": (lambda: linear(alpha=1.05), {}),
    "KalmanFilter, verbs": (lambda: linear(OwnKalman, alpha=1.05), KALMAN),
    "IMMEstimator": (bank, {}),
    "IMMEstimator, controls": (bank, KALMAN),
    "IMMEstimator, gpb2": (lambda: bank("gpb2"), {}),
    "IMMEstimator, verbs": (lambda: bank("gpb2", OwnBank), KALMAN),
    "SwitchingKalmanFilter": (lambda: SwitchingKalmanFilter(space()), {}),
    "SwitchingKalmanFilter, told": (lambda: SwitchingKalmanFilter(space()), TOLD),
    "SwitchingKalmanFilter, gpb2": (lambda: SwitchingKalmanFilter(space(), method="gpb2", n_nodes=2), TOLD),
    "SwitchingKalmanFilter, verbs": (lambda: OwnSwitching(space()), TOLD),
    "SwitchingKalmanFilter, pairwise": (lambda: SwitchingKalmanFilter(pairwise(), method="gpb2"), {}),
    "OFSRFilter": (lambda: OFSRFilter(fuzzy(), 3), {}),
    "OFSRFilter, three classes": (lambda: OFSRFilter(three_classes(), 2), {}),
    "OFSRFilter, signed": (
        lambda: OFSRFilter(fuzzy(), 8, rule="product"),
        {},
    ),
    "CGOMSMFilter": (lambda: CGOMSMFilter(pairwise(coupled=False)), {}),
    "CGOMSMFilter, order 3": (lambda: CGOMSMFilter(close(3)), {}),
    "CGOMSMFilter, time-varying": (lambda: CGOMSMFilter(close(2, "time_varying")), {}),
    "KnownSwitchFilter": (lambda: KnownSwitchFilter(fuzzy()), {"r": R_KNOWN}),
    "KnownSwitchFilter, space": (lambda: KnownSwitchFilter(space()), {"r": R_KNOWN, **TOLD}),
    "KnownSwitchFilter, pairwise": (lambda: KnownSwitchFilter(pairwise()), {"r": R_KNOWN}),
}


def series(kind):
    zs = 1.5 * np.random.default_rng(1).normal(size=(N, 1))
    if kind == "gaps":
        zs[[3, 4, 8]] = NAN
    elif kind == "ends":
        zs[[0, 1, N - 2, N - 1]] = NAN
    return zs


def part(told, n):
    return {name: values[:n] for name, values in told.items()}


def fields_of(f):
    return ("x", "P", "mu") if hasattr(f, "mu") else ("x", "P")


def test_the_table_has_what_it_says() -> None:
    assert FILTERS["OFSRFilter, signed"][0]()._system.chain.is_signed
    assert FILTERS["CGOMSMFilter, order 3"][0]()._system.order == 3
    assert FILTERS["CGOMSMFilter, time-varying"][0]()._system.steady_from != 0


@pytest.mark.parametrize("kind", ["complete", "gaps", "ends"])
@pytest.mark.parametrize("name", FILTERS)
def test_each_row_is_that_of_the_smoother_up_to_the_lag(name, kind):
    make, told = FILTERS[name]
    zs = series(kind)
    whole = [make().smooth(zs[:n], **part(told, n)) for n in range(1, N + 1)]
    for lag in (1, 4):
        f, other = make(), make()
        got, forward = f.smooth_lag(zs, lag, **told), other.filter(zs, **told)
        for field in fields_of(f):
            expected = [getattr(whole[min(n + lag, N - 1)], field)[n] for n in range(N)]
            np.testing.assert_allclose(getattr(got, field), expected, rtol=1e-10, atol=1e-12, err_msg=field)
        np.testing.assert_allclose(got.log_likelihood, forward.log_likelihood, rtol=1e-12, atol=1e-13)
        assert got.switch_path is None
        assert got.x_prior is None
        np.testing.assert_allclose(f.x, other.x, rtol=1e-12, atol=1e-13)  # it ends there


@pytest.mark.parametrize("kind", ["complete", "gaps"])
@pytest.mark.parametrize("name", FILTERS)
def test_no_lag_is_the_filter_and_that_of_the_series_the_smoother(name, kind):
    make, told = FILTERS[name]
    zs = series(kind)
    for lag, verb in ((0, "filter"), (N - 1, "smooth"), (10**6, "smooth")):
        got, expected = make().smooth_lag(zs, lag, **told), getattr(make(), verb)(zs, **told)
        for field in fields_of(make()):
            np.testing.assert_allclose(
                getattr(got, field), getattr(expected, field), rtol=1e-12, atol=1e-13, err_msg=field
            )
    for empty in (make().smooth_lag(zs[:0], 2, **part(told, 0)), make().smooth(zs[:0], **part(told, 0))):
        assert empty.x.shape[0] == len(empty.log_likelihood) == 0


@pytest.mark.parametrize("kind", ["complete", "gaps"])
@pytest.mark.parametrize("lag", [0, 3])
@pytest.mark.parametrize("name", FILTERS)
def test_step_by_step_it_is_the_same(name, lag, kind):
    make, told = FILTERS[name]
    zs = series(kind)
    expected, lagged, plain = make().smooth_lag(zs, lag, **told), FixedLag(make(), lag), make()
    plain.filter(zs, **told)
    for n, z in enumerate(zs):
        x = lagged.step(z, **{name.removesuffix("s"): values[n] for name, values in told.items()})
        if n < lag:
            assert x is lagged.x is lagged.P is lagged.n is None
            continue
        assert lagged.n == n - lag
        assert x is lagged.x
        np.testing.assert_allclose(x[:, 0], expected.x[n - lag], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(lagged.P, expected.P[n - lag], rtol=1e-10, atol=1e-12)
        if expected.mu is not None:
            np.testing.assert_allclose(lagged.mu, expected.mu[n - lag], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(lagged.filter.x, plain.x, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", [name for name in FILTERS if not FILTERS[name][1]])
def test_it_begins_where_the_filter_stands(name):
    make, zs, start, lag = FILTERS[name][0], series("gaps"), 5, 2  # behind a gap, which is in the windows
    expected, f = make().smooth_lag(zs, lag), make()
    for z in zs[:start]:
        f.step(z)
    lagged = FixedLag(f, lag)
    for n, z in enumerate(zs[start:]):
        if lagged.step(z) is not None:
            np.testing.assert_allclose(lagged.x[:, 0], expected.x[start + n - lag], rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(lagged.P, expected.P[start + n - lag], rtol=1e-10, atol=1e-12)
    assert lagged.n == N - 1 - start - lag


@pytest.mark.parametrize("name", FILTERS)
def test_a_copy_goes_its_own_way(name):
    make, told = FILTERS[name]
    lagged, zs = FixedLag(make(), 2), series("gaps")

    def step(one, n):
        return one.step(zs[n], **{name.removesuffix("s"): values[n] for name, values in told.items()})

    for n in range(4):
        step(lagged, n)
    twin = pickle.loads(pickle.dumps(lagged)) if "verbs" not in name else copy.deepcopy(lagged)
    expected = [step(lagged, n) for n in range(4, N)]
    np.testing.assert_array_equal([step(twin, n) for n in range(4, N)], expected)


# --------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize("lag", [-1, 1.5, "2", None, NAN, 10**12])
@pytest.mark.parametrize("name", FILTERS)
def test_a_lag_is_a_whole_number(name, lag):
    make, told = FILTERS[name]
    f = make()
    before = f.x.copy()
    with pytest.raises(ParameterError, match=r"lag: got .*, expected (a whole number of at least 0|at most)"):
        f.smooth_lag(series("complete"), lag, **told)
    with pytest.raises(ParameterError, match=r"lag: got .*, expected (a whole number of at least 0|at most)"):
        FixedLag(f, lag)
    np.testing.assert_array_equal(f.x, before)


class Plain(Method):
    """A method that cannot look back."""

    first, advance, ahead = EXACT.first, EXACT.advance, EXACT.ahead


def faded():
    imm = bank()
    imm.filters[1].alpha = 1.1
    return imm


def extended():
    return ExtendedKalmanFilter(1, 1, fx=np.sin, hx=np.sin)


#: What makes it, what `FixedLag` says of it, and what its own `smooth_lag` says.
UNABLE = {
    "no filter": (lambda: 3.0, "f: got float, which cannot look back", None),
    "extended": (extended, "f: got ExtendedKalmanFilter, which cannot look back", None),
    "possibilistic": (lambda: FuzzyRelationEstimator(1, 1), "f: got FuzzyRelationEstimator, which", None),
    "fading member": (
        faded,
        r"FixedLag: filters\[1\].alpha is 1.1",
        r"smooth_lag: filters\[1\].alpha is 1.1",
    ),
    "member": (
        lambda: bank(member=OwnKalman),
        r"FixedLag: filters\[0\] is a .*OwnKalman",
        r"smooth_lag: filters\[0\] is a .*OwnKalman",
    ),
    "method": (
        lambda: SwitchingFilter(fuzzy().placed(2), Plain()),
        "f: got a SwitchingFilter by the method .*, which cannot look back",
        "smooth_lag: the method Plain cannot look back",
    ),
}


@pytest.mark.parametrize("case", UNABLE)
def test_who_cannot_look_back_is_refused(case):
    make, by_step, by_series = UNABLE[case]
    f = make()
    with pytest.raises(ParameterError, match=by_step):
        FixedLag(f, 2)
    assert hasattr(f, "smooth_lag") == (by_series is not None)
    if by_series is not None:
        with pytest.raises(ParameterError, match=by_series):
            f.smooth_lag(series("complete"), 2)


@pytest.mark.parametrize("name", FILTERS)
def test_a_refused_step_leaves_everything_as_it_was(name):
    make, told = FILTERS[name]
    lagged, other, zs = FixedLag(make(), 2), FixedLag(make(), 2), series("gaps")
    for n, z in enumerate(zs):
        given = {name.removesuffix("s"): values[n] for name, values in told.items()}
        before = lagged.x, lagged.P, lagged.n
        with pytest.raises(FuzzykfError, match=r"^z|observation"):
            lagged.step([1.0, 2.0, 3.0], **given)
        with pytest.raises(TypeError, match="unheard_of"):
            lagged.step(z, **given, unheard_of=1.0)
        assert all(one is kept for one, kept in zip((lagged.x, lagged.P, lagged.n), before, strict=True))
        got, expected = lagged.step(z, **given), other.step(z, **given)
        assert (got is None) == (expected is None)
        if got is not None:
            np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", FILTERS)
def test_a_way_back_that_fails_undoes_the_step(name, monkeypatch):
    make, told = FILTERS[name]
    lagged, other, zs = FixedLag(make(), 1), FixedLag(make(), 1), series("gaps")

    def failing(states):
        raise NumericalRangeError("no numbers")

    for n, z in enumerate(zs[:6]):
        given = {name.removesuffix("s"): values[n] for name, values in told.items()}
        if n:
            before = lagged.filter.x.copy(), lagged.filter.P.copy(), lagged.n
            with monkeypatch.context() as patch:
                patch.setattr(lagged._back, "look_back", failing)
                with pytest.raises(NumericalRangeError, match="no numbers"):
                    lagged.step(z, **given)
            for got, kept in zip((lagged.filter.x, lagged.filter.P, lagged.n), before, strict=True):
                np.testing.assert_array_equal(got, kept)
        got, expected = lagged.step(z, **given), other.step(z, **given)
        if n:
            np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("verb", ["step", "predict", "reset"])
@pytest.mark.parametrize("name", FILTERS)
def test_steps_that_others_do_are_no_secret(name, verb):
    make, told = FILTERS[name]
    lagged, zs = FixedLag(make(), 2), series("complete")
    given = {name.removesuffix("s"): values[0] for name, values in told.items()}
    lagged.step(zs[0], **given)
    own = {"r": given["r"]} if "r" in given and verb != "reset" else {}
    getattr(lagged.filter, verb)(*(zs[1],) if verb == "step" else (), **own)
    with pytest.raises(SequenceError, match="has moved since the latest step of FixedLag"):
        lagged.step(zs[2], **given)


def twice(cls):
    class Twice(cls):
        def predict(self, *more, **named):
            super().predict(*more, **named)
            super().predict(*more, **named)

    return Twice


MOVING = {
    "KalmanFilter": lambda: linear(twice(KalmanFilter)),
    "IMMEstimator": lambda: bank(cls=twice(IMMEstimator)),
    "IMMEstimator, gpb2": lambda: bank("gpb2", cls=twice(IMMEstimator)),
    "SwitchingKalmanFilter": lambda: twice(SwitchingKalmanFilter)(space()),
    "OFSRFilter": lambda: twice(OFSRFilter)(fuzzy(), 3),
    "CGOMSMFilter": lambda: twice(CGOMSMFilter)(close(3)),
}


@pytest.mark.parametrize("name", MOVING)
def test_motions_that_the_way_back_does_not_know_are_refused(name):
    f, zs = MOVING[name](), series("complete")
    before = f.x.copy(), f.P.copy()
    with pytest.raises(ParameterError, match="smooth: after"):
        f.smooth_lag(zs, 2)
    np.testing.assert_array_equal(f.x, before[0])
    lagged, kept = FixedLag(f, 2), []

    def to_the_end():
        for z in zs:
            kept.append((f.x.copy(), f.P.copy()))
            lagged.step(z)

    with pytest.raises(ParameterError, match="the way back knows"):
        to_the_end()
    assert len(kept) <= 2  # of a switching filter nothing leads to the first observation
    for got, expected in zip((f.x, f.P), kept[-1], strict=True):
        np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("name", ["IMMEstimator", "SwitchingKalmanFilter"])
def test_it_warns_of_a_model_that_is_wrong(name):
    t = np.arange(300)
    offset = 5.0 * np.clip(np.abs((t % 160) - 80) / 20.0 - 1.5, 0.0, 1.0)
    rng = np.random.default_rng(2)
    zs = np.cumsum(0.2 * rng.normal(size=300)) + offset + 0.7 * rng.normal(size=300)
    F, H, M = np.diag([0.98, 1.0]), [[[1.0, 0.0]], [[1.0, 5.0]]], [[0.98, 0.02], [0.02, 0.98]]
    Q, P = np.diag([0.04, 0.0]), np.diag([1.0, 0.0])
    if name == "IMMEstimator":
        filters = [KalmanFilter(2, 1, x=[0.0, 1.0], P=P, F=F, H=one, Q=Q, R=0.49) for one in H]
        f = IMMEstimator(filters, [0.5, 0.5], M)
    else:
        f = SwitchingKalmanFilter(SwitchingStateSpace(M, F, H, Q, 0.49, x0=[0.0, 1.0], P0=P))
    with pytest.warns(HindsightWarning, match="worse than filtering") as said:
        f.smooth_lag(zs, 30)
    assert said[0].filename == __file__
    f.smooth_lag(zs, 0)  # nothing moves


def test_a_class_is_no_filter():
    with pytest.raises(ParameterError, match="f: got the class KalmanFilter, expected a filter"):
        FixedLag(KalmanFilter, 2)
