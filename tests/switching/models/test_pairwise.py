"""Models in which the state may act on the next observation: made, judged, simulated, refused, saved."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf import (
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    KnownSwitchFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.testing import check_filter

T = [[0.9, 0.1], [0.3, 0.7]]
GIVEN = {
    "transition": T,
    "A": np.array([[[0.5, 0.1], [1.0, 0.2]], [[0.4, 0.0], [0.8, 0.3]]]),
    "noise": np.array([[[1.0, 0.5], [0.5, 1.0]]] * 2),
    "offset": np.array([[0.1, 0.2], [0.3, -1.0]]),
    "means": np.array([[0.0, 0.0], [0.0, 3.0]]),
    "covariances": np.array([np.eye(2)] * 2),
    "dim_x": 1,
}
FAR = GIVEN["A"] + [[[0.3, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.0]]]
PLAIN = GIVEN["A"] * [[1.0, 1.0], [0.0, 1.0]]

ONE = {name: GIVEN[name][:1] for name in ("noise", "offset", "means", "covariances")}

#: The kinds of pairwise models, by the change that makes them.
KINDS = {
    "feedback": {},
    "no feedback": {"A": PLAIN},
    "one regime": ONE | {"transition": [[1.0]], "A": FAR[:1]},
}


def made(**change):
    return CGOMSModel.from_pairwise(**(GIVEN | change))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "exact: A_yx[k] Abar[j] = 0 for every regime k that may follow a regime j"),
        ({"A": PLAIN}, "exact: the state does not act on the next observation (A_yx = 0)"),
        (KINDS["one regime"], "exact: a single regime, which the Kalman filter serves"),
        ({"A": FAR, "transition": np.eye(2), "initial": [0.5, 0.5]},
         "exact: regimes in which no two histories meet, which the Kalman filter serves"),
        ({"A": FAR},
         "not exact: A_yx[k] Abar[j] has to be zero for every regime k that may follow a regime j, and is "
         "off by 0.231 of |A_yx| |Abar| for j = 0 and k = 0"),
    ],
)  # fmt: skip
def test_a_model_says_whether_it_is_exact(change, words):
    assert made(**change).exactness == words


def test_any_model_says_whether_it_is_exact(hard_model, fuzzy_model):
    given = {"F": 0.5, "H": 1.0, "Q": 1.0, "R": 1.0}
    space = SwitchingStateSpace(T, **given)
    apart = SwitchingStateSpace(np.eye(2), **given, initial=[0.5, 0.5], x0=[0.0], P0=1.0)
    for model in (hard_model, fuzzy_model, space.to_exact(3)):
        assert model.exactness == "exact: Y alone is Markov given the switch"
    for one in (SwitchingStateSpace([[1.0]], **given), apart):
        assert one.exactness == "exact: no two histories of the switch meet; it is the Kalman filter"
    for one in (space, SwitchingStateSpace(FadeLaw.between(20, 6), **given)):
        assert one.exactness.startswith("not exact in general: histories of the switch meet")


def test_what_has_no_exact_filter_is_refused_with_the_way_on():
    model = made(A=FAR)
    for make in (CGOMSMFilter, CGOMSModel.filter):
        with pytest.raises(ParameterError, match="model: not exact: A_yx") as raised:
            make(model)
        way_on = "expected an exact one, or SwitchingKalmanFilter, which takes any such model"
        assert str(raised.value).endswith(f"for j = 0 and k = 0; {way_on}")
    data = model.simulate(20, np.random.default_rng(0))
    assert SwitchingKalmanFilter(model).filter(data.y).x.shape == (20, 1)
    assert KnownSwitchFilter(model).filter(data.y, data.r).x.shape == (20, 1)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"A": GIVEN["A"][0]}, ShapeError, r"A: got shape \(2, 2\), expected \(n, n, n\)"),
        ({"A": np.zeros((2, 2, 3))}, ShapeError, r"A: got shape \(2, 2, 3\), expected \(K, d, d\), square"),
        ({"A": np.zeros((2, 3, 3))}, ShapeError, r"means: got shape \(2, 2\), expected \(2, 3\)"),
        ({"A": np.empty((0, 2, 2))}, ParameterError, "means: got no regime, expected at least one"),
        ({"A": np.full((2, 2, 2), np.nan)}, ParameterError, r"A: entry \(0, 0, 0\) is nan"),
        ({"noise": np.eye(2)}, ShapeError, r"noise: got shape \(2, 2\), expected \(2, 2, 2\)"),
        ({"noise": [np.eye(2), [[1.0, 2.0], [2.0, 1.0]]]}, NotPositiveDefiniteError,
         r"noise\[1\]: expected a positive semi-definite matrix, got the eigenvalue -1"),
        ({"noise": [np.eye(2), [[1.0, 0.0], [0.0, 0.0]]]}, NotPositiveDefiniteError,
         r"noise\[1\], its block of the observation: expected a positive definite .* the eigenvalue 0"),
        ({"noise": [np.eye(2), [[1.0, 0.2], [0.1, 1.0]]]}, ParameterError, "noise: expected symmetric"),
        ({"offset": [0.0, 0.0]}, ShapeError, r"offset: got shape \(2,\), expected \(2, 2\)"),
        ({"means": [[0.0, 0.0]]}, ShapeError, r"means: got shape \(1, 2\), expected \(2, 2\)"),
        ({"covariances": [np.eye(2), -np.eye(2)]}, NotPositiveDefiniteError,
         r"covariances\[1\]: .* eigenvalue -1"),
        ({"covariances": [np.eye(2), np.diag([1.0, 0.0])]}, NotPositiveDefiniteError,
         r"covariances\[1\], its block of the observation: .* eigenvalue 0"),
        ({"dim_x": 2}, ParameterError, "dim_x: got 2, expected a whole number from 1 to 1"),
        ({"dim_x": 0.5}, ParameterError, "dim_x: got 0.5"),
        ({"transition": np.full((3, 3), 1 / 3)}, ParameterError, "transition: got 3 regimes, expected 2"),
        ({"transition": [[0.9, 0.2], [0.3, 0.7]]}, ParameterError, r"transition\[0\]: sums to 1\.1"),
        ({"initial": [0.5, 0.4]}, ParameterError, r"initial: sums to 0\.9"),
    ],
)  # fmt: skip
def test_bad_arguments(change, error, message):
    with pytest.raises(error, match=message):
        made(**change)


def test_a_regime_that_no_path_arrives_at_is_not_asked_for_a_density():
    singular = [GIVEN["noise"][0], np.zeros((2, 2))]
    never = [[1.0, 0.0], [1.0, 0.0]]
    assert made(noise=singular, transition=never, initial=[0.5, 0.5]).exactness.startswith("exact")
    with pytest.raises(NotPositiveDefiniteError, match=r"noise\[1\], its block"):
        made(noise=singular)


@pytest.mark.parametrize("change", KINDS.values(), ids=KINDS)
def test_simulated_steps_follow_the_equation(change):
    model = made(**change)
    data = model.simulate(6000, np.random.default_rng(2))
    z, k = np.concatenate([data.x, data.y], axis=1), data.r[1:].astype(int)
    A, offset, noise = model.form.A[k], model.form.offset[k], model.form.noise[k]
    rest = z[1:] - (A @ z[:-1, :, None])[..., 0] - offset
    white = np.linalg.solve(np.linalg.cholesky(noise), rest[..., None])[..., 0]
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=4 / np.sqrt(6000))
    np.testing.assert_allclose(white.T @ white / 6000, np.eye(2), atol=4 * np.sqrt(2 / 6000))
    first = np.array([model.simulate(1, np.random.default_rng(s)).y[0, 0] for s in range(400)])
    regime = model.initial @ model.form.means[:, 1]
    assert abs(first.mean() - regime) < 4 * first.std() / 20
    assert model.simulate(0, np.random.default_rng(0)).x.shape == (0, 1)


@pytest.mark.parametrize("change", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("again", ["file", "pickle", "dict"])
def test_models_come_back(change, again, tmp_path):
    model = made(**change)
    if again == "file":
        model.save(tmp_path / "model.json")
        found = io.load_model(tmp_path / "model.json")
    elif again == "pickle":
        found = pickle.loads(pickle.dumps(model))
    else:
        found = CGOMSModel.from_dict(model.to_dict())
    assert found.to_dict() == model.to_dict()
    assert found.exactness == model.exactness
    assert repr(found).endswith("form='pairwise')")


@pytest.mark.parametrize("change", KINDS.values(), ids=KINDS)
def test_the_exact_filter_keeps_the_contract_of_filters(change):
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None])
    report = check_filter(lambda: CGOMSMFilter(made(**change)), zs)
    assert {"saver", "save", "resume", "filter_many", "outlier"} <= set(report.passed)


@pytest.mark.parametrize("change", [*KINDS.values(), {"A": FAR}], ids=[*KINDS, "not exact"])
@pytest.mark.parametrize("gaps", [False, True])
def test_verbs_and_series_of_a_known_switch_agree(change, gaps):
    model = made(**change)
    data, f = model.simulate(12, np.random.default_rng(3)), KnownSwitchFilter(model)
    ys = data.y.copy()
    ys[[0, 4, 5] if gaps else []] = np.nan
    whole = f.filter(ys, data.r)
    f.reset()
    head = f.filter(ys[:5], data.r[:5])
    tail = f.filter(ys[5:], data.r[5:], resume=True)
    f.reset()
    for k, y in enumerate(ys):
        f.step(y, data.r[k])
        for found in (f, *([tail] if k >= 5 else [head])):
            at = () if found is f else (k - 5 * (k >= 5),)
            for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
                value, expected = np.array(getattr(found, name))[at], getattr(whole, name)[k]
                np.testing.assert_allclose(value.reshape(expected.shape), expected, atol=1e-12, err_msg=name)
