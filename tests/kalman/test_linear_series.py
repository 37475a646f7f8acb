"""filter, smooth, filter_many, batch_filter and the check of shapes, of the linear filter."""

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.kalman import KalmanFilter

FIELDS = ("x", "P", "x_prior", "P_prior", "log_likelihood")


def make(system, flat=False):
    matrices = {name: system[name] for name in ("P", "F", "Q", "H", "R")}
    return KalmanFilter(3, 2, x=system["x"] if flat else system["x"][:, None], **matrices)


def oracle(system, joint_gaussian, controls=None):
    parts = (system[name] for name in ("x", "P", "F", "Q", "H", "R"))
    return joint_gaussian(*parts, len(system["zs"]), controls)


# ------------------------------------------------------------------ filter


@pytest.mark.parametrize("flat", [False, True])
def test_filter_is_the_conditional_law_and_ends_at_the_last_observation(system, joint_gaussian, flat):
    f, zs = make(system, flat), system["zs"]
    result = f.filter(zs)
    x, P, log_likelihood = oracle(system, joint_gaussian).filtered(zs)
    np.testing.assert_allclose(result.x, x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.P, P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-9, atol=1e-12)
    assert np.array_equal(f.x.ravel(), result.x[-1])
    g = make(system, flat)
    for z in zs:
        g.step(z)
    assert np.array_equal(f.step([1.0, 2.0]), g.step([1.0, 2.0]))


def test_controls_of_a_series_reach_predict_one_by_one(system, joint_gaussian):
    f, zs = make(system), system["zs"]
    f.B = np.arange(6.0).reshape(3, 2)
    us = np.random.default_rng(3).normal(size=(len(zs), 2, 1))
    x, _, log_likelihood = oracle(system, joint_gaussian, us[..., 0] @ f.B.T).filtered(zs)
    result = f.copy().filter(zs, us=us)
    np.testing.assert_allclose(result.x, x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-9, atol=1e-12)


def test_a_pandas_series_keeps_its_index():
    pandas = pytest.importorskip("pandas")
    index = pandas.date_range("2024-01-01", periods=3)
    zs = pandas.Series([1.0, None, 2.0], index=index)
    f = KalmanFilter(1, 1, H=[[1.0]])
    for method in (f.copy().filter, f.copy().smooth):
        assert method(zs).to_dataframe().index.equals(index)
    assert f.batch_filter(zs)[0].shape == (3, 1, 1)


def test_a_series_that_fails_half_way_leaves_the_filter_as_it_was(system):
    f = make(system)
    f.step([1.0, 2.0])
    x, P = f.x.copy(), f.P.copy()
    f.B = np.ones((3, 1))
    with pytest.raises(ShapeError, match="u: "):
        f.filter(system["zs"], us=[0.0, 1.0, np.ones(4), *([0.0] * 6)])
    with pytest.raises(NotPositiveDefiniteError, match="R"):
        f.batch_filter([[1.0, 2.0]] * 3, Rs=[1.0, 1.0, -1.0])
    assert np.array_equal(f.x, x)
    assert np.array_equal(f.P, P)
    with pytest.raises(ShapeError, match="us: got 1 values, expected one for each of the 9 observations"):
        f.filter(system["zs"], us=[0.0])


# ------------------------------------------------------------------ smooth


@pytest.mark.parametrize("flat", [False, True])
def test_smooth_is_the_conditional_law_given_everything(system, joint_gaussian, flat):
    # an independent oracle, with gaps and controls: filterpy's smoother does not know controls
    f, zs = make(system, flat), system["zs"]
    f.B = np.ones((3, 1))
    us = np.linspace(-1.0, 1.0, len(zs))
    joint = oracle(system, joint_gaussian, us[:, None] * np.ones(3))
    controls = us[:, None] if flat else us[:, None, None]
    result = f.smooth(zs, us=controls)
    x, P = joint.smoothed(zs)
    np.testing.assert_allclose(result.x, x, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(result.P, P, rtol=1e-8, atol=1e-11)
    assert result.log_likelihood.sum() == pytest.approx(joint.log_likelihood(zs, len(zs)))


def test_smooth_knows_singular_predictions():
    # a constant that is known exactly beside a random walk: P_prior is singular
    f = KalmanFilter(2, 1, H=[[1.0, 1.0]], P=np.diag([1.0, 0.0]), Q=np.diag([0.5, 0.0]))
    g = KalmanFilter(1, 1, H=[[1.0]], Q=0.5)
    zs = [1.0, 3.0, None, 2.0]
    got, expected = f.smooth(zs), g.smooth(zs)
    np.testing.assert_allclose(got.x[:, 0], expected.x[:, 0], rtol=1e-12)
    np.testing.assert_allclose(got.P[:, 0, 0], expected.P[:, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(got.x[:, 1], 0.0, atol=1e-14)


def test_fading_memory_is_process_noise_to_the_smoother():
    # alpha^2 F P F' + Q: with F = 1 and P known, alpha acts as a Q that varies; one step back by hand
    f = KalmanFilter(1, 1, H=[[1.0]], Q=0.3)
    f.alpha = 1.2
    forward, smoothed = f.copy().filter([1.0, 2.0]), f.copy().smooth([1.0, 2.0])
    gain = forward.P[0] / forward.P_prior[1]
    expected = forward.P[0] + gain**2 * (forward.P[1] - forward.P_prior[1])
    assert smoothed.P[0] == pytest.approx(expected)
    assert smoothed.x[0] == pytest.approx(forward.x[0] + gain[0] * (forward.x[1] - forward.x_prior[1]))


# ------------------------------------------------------------------ filter_many


@pytest.mark.parametrize("share", [0.0, 0.1, 0.6])
def test_many_series_are_as_one_after_another(system, share):
    # whatever is missing: groups of series with a common covariance part and stay apart
    rng = np.random.default_rng(int(10 * share))
    zs = rng.normal(size=(12, 15, 2))
    zs[rng.random(zs.shape) < share] = np.nan
    zs[3, 8:] = np.nan  # a padded series
    f = make(system)
    f.step([1.0, 2.0])
    before = f.x.copy()
    result = f.filter_many(zs, keep=FIELDS)
    assert np.array_equal(f.x, before)
    for k, series in enumerate(zs):
        single = f.copy().filter(series)
        for name in FIELDS:
            np.testing.assert_allclose(
                getattr(result, name)[k], getattr(single, name), rtol=1e-9, atol=1e-11, err_msg=name
            )


def test_many_series_of_one_component_may_be_a_matrix_and_have_controls():
    f = KalmanFilter(1, 1, H=[[1.0]], B=[[2.0]])
    f.alpha = 1.1
    zs = np.array([[1.0, np.nan, 2.0], [0.5, 1.0, 1.5]])
    shared, own = np.array([[1.0], [0.0], [3.0]]), np.arange(6.0).reshape(2, 3, 1)
    for us in (shared, own):
        result = f.filter_many(zs, us=us)
        for k in range(2):
            controls = us if us.ndim == 2 else us[k]
            single = f.copy().filter(zs[k], us=controls[..., None])
            np.testing.assert_allclose(result.x[k], single.x, rtol=1e-12)


def test_only_what_is_kept_is_stored(system):
    zs = np.zeros((2, 4, 2))
    result = make(system).filter_many(zs, keep="x_prior")
    assert result.x_prior.shape == (2, 4, 3)
    assert all(getattr(result, name) is None for name in FIELDS if name != "x_prior")
    assert make(system).filter_many(np.empty((0, 4, 2))).x.shape == (0, 4, 3)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"zs": np.zeros((2, 4, 3))}, ShapeError, r"zs: got shape \(2, 4, 3\), expected \(series, n, 2\)"),
        ({"zs": np.zeros((4, 2))}, ShapeError, "zs: got shape"),
        (
            {"zs": [[[1.0, 2.0]], [[1.0, 2.0], [3.0]]]},
            ShapeError,
            "zs: series 1, observation 1, z: got shape",
        ),
        ({"zs": np.full((2, 4, 2), np.inf)}, ParameterError, "zs: observation 0 of series 0"),
        (
            {"zs": np.zeros((2, 4, 2)), "keep": ("x", "mu")},
            ParameterError,
            "keep: got 'mu', expected names among x",
        ),
        ({"zs": np.zeros((2, 4, 2)), "us": np.zeros((4, 1))}, ShapeError, "B: got None"),
    ],
)
def test_many_series_of_a_wrong_kind_are_named(system, arguments, error, message):
    with pytest.raises(error, match=message):
        make(system).filter_many(**arguments)


def test_a_singular_innovation_in_many_series_is_an_error(system):
    f = make(system)
    f.H, f.R = np.zeros((2, 3)), np.zeros((2, 2))
    with pytest.raises(NotPositiveDefiniteError, match="S = H P H'"):
        f.filter_many(np.zeros((2, 3, 2)))
    f.B = np.ones((3, 1))
    with pytest.raises(ShapeError, match=r"us: got shape \(5, 1\), expected \(2, 3, 1\) or \(3, 1\)"):
        f.filter_many(np.zeros((2, 3, 2)), us=np.zeros((5, 1)))


# ------------------------------------------------------------------ batch_filter


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("update_first", [False, True])
def test_batch_filter_takes_everything_step_by_step(system, flat, update_first):
    rng = np.random.default_rng(1)
    f, n = make(system, flat), 6
    f.B = np.ones((3, 1))
    zs = [None, [1.0, 2.0], [np.nan, 1.0], np.array([[1.0], [0.5]]), [0.0, 1.0], [1.0, 1.0]]
    Fs, Hs = [f.F * (1 + 0.1 * k) for k in range(n)], [f.H * (1 + k) for k in range(n)]
    Qs, Rs = [f.Q * (1 + k) for k in range(n)], [None, *(float(k) for k in range(1, n))]
    Bs = [None, *(rng.normal(size=(3, 1)) for _ in range(n - 1))]
    us = [rng.normal(size=1 if flat else (1, 1)) for _ in range(n)]
    g, calls = f.copy(), []
    saver = type("Saver", (), {"save": lambda self: calls.append(f.x.copy())})()
    out = f.batch_filter(zs, Fs, Qs, Hs, Rs, Bs, us, update_first=update_first, saver=saver)
    assert out[0].shape == ((n, 3) if flat else (n, 3, 1))
    assert len(calls) == n
    for k in range(n):
        verbs = [
            (lambda k=k: g.predict(us[k], Bs[k], Fs[k], Qs[k]), out[2:]),
            (lambda k=k: g.update(zs[k], Rs[k], Hs[k]), out[:2]),
        ]
        for verb, (means, covariances) in verbs[::-1] if update_first else verbs:
            verb()
            assert np.array_equal(means[k], g.x)
            assert np.array_equal(covariances[k], g.P)
        assert np.array_equal(calls[k], g.x)


def test_a_subclass_may_have_shorter_verbs(system):
    # what was not given is not passed on
    class Short(KalmanFilter):
        def predict(self):
            super().predict()

        def update(self, z):
            super().update(z)

    f, g = Short(2, 1, H=[[1.0, 0.0]]), KalmanFilter(2, 1, H=[[1.0, 0.0]])
    assert np.array_equal(f.copy().filter([1.0, 2.0]).x, g.copy().filter([1.0, 2.0]).x)
    assert np.array_equal(f.batch_filter([1.0, 2.0])[0], g.batch_filter([1.0, 2.0])[0])


def test_batch_filter_names_a_list_that_is_too_short(system):
    with pytest.raises(ShapeError, match="Fs: got 1 values"):
        make(system).batch_filter([[1.0, 2.0]] * 2, Fs=[np.eye(3)])


# ------------------------------------------------------------------ the check of shapes


def test_matrix_dimensions():
    f = KalmanFilter(2, 2, H=np.eye(2))
    f.test_matrix_dimensions()
    f.test_matrix_dimensions(z=[[1.0], [2.0]], H=np.ones((2, 2)), R=np.eye(2))
    f.test_matrix_dimensions(z=1.0, H=np.ones((1, 2)), R=3.0)
    for wrong in ({"z": [1.0, 2.0]}, {"z": 1.0}, {"R": 3.0}, {"H": 3.0}, {"F": np.eye(3)}, {"Q": 1.0}):
        name = next(iter(wrong))
        with pytest.raises(ShapeError, match=f"^{name}: got shape") as error:
            f.test_matrix_dimensions(**wrong)
        assert isinstance(error.value, AssertionError)  # what filterpy raises
    f.x = np.zeros(2)
    f.test_matrix_dimensions(z=[1.0, 2.0])
    f.P = 1.0
    with pytest.raises(ShapeError, match=r"^P: got shape"):
        f.test_matrix_dimensions()


def test_batch_filter_may_begin_with_an_update_and_nothing_else_given(system):
    f, g = make(system), make(system)
    zs = np.random.default_rng(9).normal(size=(4, 2))
    means, covariances, means_p, covariances_p = f.batch_filter(zs, update_first=True)
    for k, z in enumerate(zs):
        g.update(z)
        np.testing.assert_allclose(means[k], g.x, rtol=1e-12)
        np.testing.assert_allclose(covariances[k], g.P, rtol=1e-12)
        g.predict()
        np.testing.assert_allclose(means_p[k], g.x, rtol=1e-12)
        np.testing.assert_allclose(covariances_p[k], g.P, rtol=1e-12)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("far", [1e160, 1e300])
def test_an_absurd_observation_has_a_density_of_zero_among_many_series_too(far):
    # the terms of its squared distance are infinite, of either sign
    f = KalmanFilter(2, 2, H=np.eye(2), P=1e-3 * np.eye(2), R=[[1.0, 0.5], [0.5, 1.0]])
    zs = np.array([[0.1, 0.2], [far, 0.4 * far], [0.3, 0.1]])
    many, one = f.filter_many(zs[None]), f.copy().filter(zs)
    np.testing.assert_array_equal(one.log_likelihood[1:], -np.inf)
    np.testing.assert_allclose(many.log_likelihood[0], one.log_likelihood, rtol=1e-12)
    np.testing.assert_allclose(many.x[0], one.x, rtol=1e-12)


@pytest.mark.parametrize("make", [iter, lambda zs: (z for z in zs)])
def test_batch_filter_takes_what_can_be_gone_through_once(make):
    zs = [1.0, None, 2.0]
    expected = KalmanFilter(1, 1, H=[[1.0]]).batch_filter(zs)
    for one, other in zip(KalmanFilter(1, 1, H=[[1.0]]).batch_filter(make(zs)), expected, strict=True):
        np.testing.assert_array_equal(one, other)
