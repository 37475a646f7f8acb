"""IMMEstimator.smooth: the smoother of the same state-space model, and of one filter where all are alike."""

from __future__ import annotations

from types import MethodType

import numpy as np
import pytest

from fuzzykf import SwitchingKalmanFilter, SwitchingStateSpace
from fuzzykf.errors import HindsightWarning, NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter

MU = np.array([0.2, 0.3, 0.5])
M = np.array([[0.9, 0.08, 0.02], [0.2, 0.7, 0.1], [0.05, 0.15, 0.8]])
METHODS = ("imm", "gpb2")
FIELDS = ("x", "P", "mu", "log_likelihood", "switch_path", "switch")


class Own(IMMEstimator):
    """A bank with a verb of its own, which does nothing more."""

    def update(self, z):
        super().update(z)


def member(k, n, m, rank):
    """One of three filters that differ in everything; the noise of the state has this rank."""
    rng = np.random.default_rng(10 + k)
    F = 0.4 * rng.normal(size=(n, n)) + 0.5 * np.eye(n)
    G, C = rng.normal(size=(n, rank)), rng.normal(size=(n, n))
    f = KalmanFilter(n, m, dim_u=1, F=F, H=rng.normal(size=(m, n)), Q=(0.3 + k) * G @ G.T)
    f.R, f.B = (0.5 + 0.3 * k) * np.eye(m), rng.normal(size=(n, 1))
    f.x, f.P = rng.normal(size=(n, 1)), C @ C.T
    return f


def bank(method="imm", cls=IMMEstimator, n=2, m=2, rank=1):
    return cls([member(k, n, m, rank) for k in range(3)], MU, M, method=method)


def placed(imm):
    """The same as a state-space model, whose first law is that after the first predict."""
    F, Q, H, R, B = (np.array([getattr(f, name) for f in imm.filters]) for name in "FQHRB")
    xs, Ps = np.array([f.x.ravel() for f in imm.filters]), np.array([f.P for f in imm.filters])
    x0, P0 = np.empty_like(xs), np.empty_like(Ps)
    for j in range(3):  # mixed, then moved
        w = MU * M[:, j] / (MU @ M[:, j])
        mean = w @ xs
        spread = sum(p * (P + np.outer(x - mean, x - mean)) for p, x, P in zip(w, xs, Ps, strict=True))
        x0[j], P0[j] = F[j] @ mean, F[j] @ spread @ F[j].T + Q[j]
    model = SwitchingStateSpace(M, F, H, Q, R, B=B, initial=MU @ M, x0=x0, P0=P0)
    return SwitchingKalmanFilter(model, method=imm.method)


def data(kind, m=2, n=40):
    zs = 2.0 * np.random.default_rng(3).normal(size=(n, m))
    if kind == "gaps":
        zs[[4, 5, 20]] = np.nan
    elif kind == "parts":
        zs[[3, 9, 30], 0] = np.nan
        zs[n - 1, m - 1] = zs[17] = np.nan
    elif kind == "ends":
        zs[:2] = zs[-3:] = np.nan
    return zs


@pytest.mark.parametrize("kind", ["complete", "gaps", "parts", "ends"])
@pytest.mark.parametrize("cls", [IMMEstimator, Own])
@pytest.mark.parametrize("weights", ["density", "kim"])
@pytest.mark.parametrize("method", METHODS)
def test_it_is_the_smoother_of_the_state_space_model(method, weights, cls, kind):
    # pairs of GPB2 differ at the first observation unless all modes start in one point
    imm, zs = bank(method, cls), data(kind)
    if method == "gpb2":
        for f in imm.filters:
            f.x, f.P = imm.filters[0].x.copy(), imm.filters[0].P.copy()
    expected = placed(imm).smooth(zs, weights=weights)
    got = imm.smooth(zs, weights=weights)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-10, atol=1e-10)
    assert got.x_prior is None
    np.testing.assert_array_equal(got.nodes, np.arange(3.0))


@pytest.mark.parametrize("cls", [IMMEstimator, Own])
@pytest.mark.parametrize("method", METHODS)
def test_controls_move_the_modes_on_the_way_back_too(method, cls):
    zs, us = data("gaps"), np.linspace(-2.0, 2.0, 40)[:, None]
    us[0] = 0.0  # which leads to the first observation, where the state-space model begins
    imm = bank(method, cls)
    for f in imm.filters:
        f.x, f.P = imm.filters[0].x.copy(), imm.filters[0].P.copy()
    expected = placed(imm).smooth(zs, us)
    got = imm.smooth(zs, us[..., None])
    for name in FIELDS:
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("predicted", [False, True])
@pytest.mark.parametrize("weights", ["density", "kim"])
@pytest.mark.parametrize("method", METHODS)
def test_modes_that_are_alike_are_one_filter(method, weights, predicted):
    zs = data("parts")
    one, imm = member(0, 2, 2, 1), IMMEstimator([member(0, 2, 2, 1) for _ in range(3)], MU, M, method=method)
    if predicted:  # a series may begin after a prediction: then the first observation is two steps away
        one.predict()
        imm.predict()
    expected, got = one.smooth(zs), imm.smooth(zs, weights=weights)
    for name in ("x", "P", "log_likelihood"):
        np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-9, atol=1e-10)
    if weights == "kim":  # nothing is learned of the modes
        np.testing.assert_allclose(got.mu[-1], MU @ np.linalg.matrix_power(M, 40 + predicted), rtol=1e-9)


@pytest.mark.parametrize("n", [0, 1, 2, 40])
@pytest.mark.parametrize("cls", [IMMEstimator, Own])
@pytest.mark.parametrize("method", METHODS)
def test_it_ends_where_the_filter_ends(method, cls, n):
    zs, imm, other = data("gaps")[:n], bank(method, cls), bank(method, cls)
    got, forward = imm.smooth(zs), other.filter(zs)
    assert got.x.shape == (n, 2)
    assert got.switch_path.shape == (n,)
    for name in ("x", "P", "mu"):
        np.testing.assert_allclose(
            getattr(got, name)[-1:], getattr(forward, name)[-1:], rtol=1e-12, atol=1e-13
        )
    np.testing.assert_array_equal(imm.mu, other.mu)
    np.testing.assert_array_equal(imm.step([1.0, -1.0]), other.step([1.0, -1.0]))
    imm.reset()
    np.testing.assert_array_equal(imm.x, bank(method, cls).x)


def test_the_index_of_a_series_comes_back():
    pd = pytest.importorskip("pandas")
    hours = pd.date_range("2026-01-01", periods=40, freq="h")
    zs = pd.DataFrame(data("gaps"), index=hours, columns=["a", "b"])
    imm = bank()
    assert imm.smooth(zs).index.equals(hours)
    assert imm.forecast(1).index[0] == pd.Timestamp("2026-01-02 16:00")


@pytest.mark.parametrize("method", METHODS)
def test_it_warns_of_a_bank_that_is_wrong(method):
    # a sensor whose offset fades, for which the bank knows an abrupt change alone
    t = np.arange(300)
    truth = np.cumsum(0.2 * np.random.default_rng(2).normal(size=300))
    offset = 5.0 * np.clip(np.abs((t % 160) - 80) / 20.0 - 1.5, 0.0, 1.0)
    zs = truth + offset + 0.7 * np.random.default_rng(3).normal(size=300)
    F, Q = np.diag([0.98, 1.0]), np.diag([0.04, 0.0])
    filters = [KalmanFilter(2, 1, F=F, H=[[1.0, d]], Q=Q, R=0.49) for d in (0.0, 5.0)]
    for f in filters:
        f.x, f.P = np.array([[0.0], [1.0]]), np.diag([1.0, 0.0])
    imm = IMMEstimator(filters, [0.5, 0.5], [[0.98, 0.02], [0.02, 0.98]], method=method)
    with pytest.warns(HindsightWarning, match="worse than filtering") as said:
        imm.smooth(zs)
    assert said[0].filename == __file__


def changed(**attributes):
    imm = bank()
    for name, value in attributes.items():
        setattr(imm.filters[1], name, value)
    return imm


def patched():
    imm = bank()
    imm.filters[1].update = MethodType(lambda self, z: KalmanFilter.update(self, z), imm.filters[1])
    return imm


def mapped():
    filters = [member(0, 3, 2, 3), member(1, 2, 2, 2), member(2, 3, 2, 3)]
    return IMMEstimator(filters, MU, M, state_maps=[None, [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], None])


def mixed(other):
    return IMMEstimator([member(0, 2, 2, 1), other, member(2, 2, 2, 1)], MU, M)


class OwnMember(KalmanFilter):
    def predict(self, *arguments, **named):
        super().predict(*arguments, **named)


class Twice(IMMEstimator):
    def predict(self, u=None):
        super().predict(u)
        super().predict(u)


class Stirring(IMMEstimator):
    def predict(self, u=None):
        super().predict(u)
        self.filters[2].x = self.filters[2].x + 1.0


ZS = data("complete")

REFUSED = {
    "fading memory": (lambda: changed(alpha=1.02), ZS, {}, ParameterError, r"filters\[1\].alpha is 1.02"),
    "patched": (patched, ZS, {}, ParameterError, r"filters\[1\] has a predict, update or inv of its own"),
    "inverse": (lambda: changed(inv=np.linalg.pinv), ZS, {}, ParameterError, r"filters\[1\] has .* inv"),
    "subclass": (lambda: mixed(OwnMember(2, 2)), ZS, {}, ParameterError, r"filters\[1\] is a .*OwnMember"),
    "extended": (
        lambda: mixed(ExtendedKalmanFilter(2, 2, fx=np.sin, hx=np.sin)),
        *(
            ZS,
            {},
            ParameterError,
            r"filters\[1\] is a .*ExtendedKalmanFilter, expected a fuzzykf.KalmanFilter",
        ),
    ),
    "state map": (mapped, ZS, {}, ParameterError, r"filters\[1\] has a map in state_maps"),
    "weights": (
        bank,
        ZS,
        {"weights": "Kim"},
        ParameterError,
        "weights: got 'Kim', expected 'density' or 'kim'",
    ),
    "series": (bank, ZS[:, :1], {}, ShapeError, "z"),
    "controls": (bank, ZS, {"us": [1.0]}, ShapeError, "us: got 1 values, expected one for each of the 40"),
    "noise": (lambda: changed(R=-9.0 * np.eye(2)), ZS, {}, NotPositiveDefiniteError, "S = H P H'"),
    "matrix": (lambda: changed(F=np.eye(3)), ZS, {}, ShapeError, r"filters\[1\].F: got shape"),
    "two predictions": (lambda: bank(cls=Twice), ZS, {}, ParameterError, "smooth: after predict of step 0"),
    "other moves": (lambda: bank(cls=Stirring), ZS, {}, ParameterError, "smooth: after predict of step 0"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_it_cannot_look_back_on_is_named_and_left_as_it_was(case):
    make, zs, given, error, message = REFUSED[case]
    imm = make()
    assert imm.has_smoother == ("filters" not in message or "got shape" in message)
    before = [{k: np.copy(v) for k, v in vars(f).items()} for f in (imm, *imm.filters)]
    with pytest.raises(error, match=message):
        imm.smooth(zs, **given)
    for f, known in zip((imm, *imm.filters), before, strict=True):
        assert vars(f).keys() == known.keys()
        for name, value in known.items():
            if name != "filters" and value.dtype != object:
                np.testing.assert_array_equal(getattr(f, name), value)


class Gated(IMMEstimator):
    """Leaves out what is far from anything it expects."""

    def update(self, z):
        super().update(None if z is not None and np.abs(z).max() > 50.0 else z)


class Doubting(IMMEstimator):
    """Takes every observation for twice as noisy as its filters say, by their own R."""

    def update(self, z):
        noise = [f.R for f in self.filters]
        for f in self.filters:
            f.R = 4.0 * f.R
        super().update(z)
        for f, R in zip(self.filters, noise, strict=True):
            f.R = R


class Adapting(IMMEstimator):
    """Sets R of its filters as it goes."""

    def update(self, z):
        for f in self.filters:
            f.R = 1.01 * f.R
        super().update(z)


@pytest.mark.parametrize("method", METHODS)
def test_what_an_update_leaves_out_is_missing_on_the_way_back(method):
    zs = data("complete")
    pierced = zs.copy()
    zs[7], pierced[7] = 1e3, np.nan
    found, wanted = bank(method, Gated).smooth(zs), bank(method).smooth(pierced)
    for name in ("x", "P", "mu", "log_likelihood"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-11)


def test_noise_that_an_update_sets_counts_on_the_way_back():
    zs, imm = data("complete", n=12), bank()
    found = bank(cls=Adapting).smooth(zs)
    f = placed(imm)
    R = np.array([member.R for member in imm.filters])
    wanted = f.smooth(zs, Rs=[1.01 ** (n + 1) * R for n in range(12)])
    np.testing.assert_allclose(found.x, wanted.x, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.P, wanted.P, rtol=1e-8, atol=1e-9)


def test_an_update_that_the_filters_do_not_explain_is_refused():
    imm = bank(cls=Doubting)
    before = [f.x.copy() for f in imm.filters]
    with pytest.raises(ParameterError, match="update of this Doubting has neither taken observation 0"):
        imm.smooth(data("complete"))
    for f, x in zip(imm.filters, before, strict=True):
        np.testing.assert_array_equal(f.x, x)
