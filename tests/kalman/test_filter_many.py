"""Many series through one linear filter: what each finds alone, side by side."""

import numpy as np
import pytest

from fuzzykf import engine
from fuzzykf.engine import selected
from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError
from fuzzykf.kalman import ExtendedKalmanFilter, KalmanFilter

FIELDS = ("x", "P", "x_prior", "P_prior", "log_likelihood")

#: Sizes with code of their own, and others, up to the largest compiled one and beyond.
SIZES = [(1, 1), (2, 1), (4, 2), (3, 2), (2, 3), (16, 1), (17, 1)]


def make(n, m, seed=0):
    """Return a stable filter with correlated noises, controls and a fading memory."""
    rng = np.random.default_rng([n, m, seed])
    F = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    root, noise = rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=(m, m))
    f = KalmanFilter(n, m, F=F, H=rng.normal(size=(m, n)), Q=root @ root.T, R=noise @ noise.T + np.eye(m))
    f.B, f.alpha = rng.normal(size=(n, 1)), 1.02
    return f


def observations(m, series=11, n=140, seed=1):
    """Return series (11, n, m): complete, with single gaps, with their end missing, with nothing at all.

    They are longer than the blocks of steps that go at once, and more than a vector has lanes.
    """
    rng = np.random.default_rng(seed)
    zs = rng.normal(size=(series, n, m))
    zs[3, n // 2 :] = np.nan
    zs[4] = np.nan
    zs[5, -5, 0] = np.nan
    zs[6][rng.random((n, m)) < 0.3] = np.nan
    zs[7, 0] = np.nan
    return zs


def same(many, f, zs, **told):
    """Assert that the fields are those of `filter` for each series."""
    for k, series in enumerate(zs):
        single = f.copy().filter(series, **{name: one[k] for name, one in told.items()})
        for name in FIELDS:
            found, expected = getattr(many, name)[k], getattr(single, name)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12, err_msg=f"{name} of {k}")


# ------------------------------------------------------------------ the same numbers


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_series_with_and_without_gaps_find_what_each_finds_alone(n, m):
    f, zs = make(n, m), observations(m, n={1: 140, 2: 140}.get(n, 60))
    us = np.random.default_rng(2).normal(size=(*zs.shape[:2], 1))
    same(f.filter_many(zs, keep=FIELDS, us=us), f, zs, us=us[..., None])


@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 2)])
def test_every_instruction_set_finds_them(instructions, n, m):
    f, zs = make(n, m), observations(m)
    same(f.filter_many(zs, keep=FIELDS), f, zs)


def test_matrices_of_the_steps_reach_series_with_gaps():
    f, zs = make(3, 2), observations(2, n=20)
    Rs, Fs = [f.R * (1.0 + 0.1 * k) for k in range(20)], [f.F * (1.0 - 0.01 * k) for k in range(20)]
    many = f.filter_many(zs, keep=FIELDS, Rs=Rs, Fs=Fs)
    same(many, f, zs, Rs=[Rs] * len(zs), Fs=[Fs] * len(zs))


def test_an_asymmetric_covariance_is_taken_as_filter_takes_it():
    # the verbs do not look whether P is symmetric, so neither may the lanes that have one each
    f, zs = KalmanFilter(2, 1, H=[[1.0, 0.5]], P=[[1.0, 0.3], [0.3 + 1e-9, 1.0]]), observations(1, n=5)
    same(f.filter_many(zs, keep=FIELDS), f, zs)


# ------------------------------------------------------------------ bits


@pytest.mark.parametrize("threads", [2, 3, 50])
def test_threads_change_no_bit(threads):
    f, zs = make(2, 1), observations(1)
    one, several = f.filter_many(zs, keep=FIELDS), f.filter_many(zs, keep=FIELDS, threads=threads)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(several, name), getattr(one, name))


@pytest.mark.skipif(engine.info().name == "numpy", reason="the order of sums depends on the shape")
def test_neighbours_change_no_bit():
    # so that blocks of a data set are its parts
    f, zs = make(4, 2), observations(2)
    together = f.filter_many(zs, keep=FIELDS)
    for k in range(len(zs)):
        alone = f.filter_many(zs[k : k + 1], keep=FIELDS)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(together, name)[k])


# ------------------------------------------------------------------ what is stored


def test_single_precision_is_the_double_rounded():
    f, zs = make(2, 1), observations(1)
    single, double = f.filter_many(zs, keep=FIELDS, dtype="float32"), f.filter_many(zs, keep=FIELDS)
    for name in FIELDS:
        assert getattr(single, name).dtype == np.float32
        np.testing.assert_array_equal(getattr(single, name), getattr(double, name).astype(np.float32))


def test_single_precision_is_kept_by_whatever_runs_the_series():
    class Halved(KalmanFilter):
        def update(self, z):
            super().update(0.5 * np.asarray(z))

    ekf = ExtendedKalmanFilter(1, 1, hx=np.exp, HJacobian=lambda x: np.exp(x)[None])
    for f in (Halved(1, 1, H=[[1.0]]), KalmanFilter(1, 1, H=[[1.0]]), ekf):
        found = f.filter_many([[1.0, 2.0], [0.5]], dtype=np.float32)
        assert found.x.dtype == found.P.dtype == np.float32
        np.testing.assert_array_equal(found.x[0], f.copy().filter([1.0, 2.0]).x.astype(np.float32))
        assert np.isnan(found.x[1, 1])


def test_what_single_precision_cannot_hold_is_an_error():
    # anywhere in a series, of whatever is kept, and only where double precision holds it
    f = KalmanFilter(1, 1, H=[[1.0]], Q=lambda dt: dt)
    complete, gappy, beyond = [[1.0] * 4, [1e60, 0.0, 0.0, 0.0]], [[1e60, None, 0.0, 0.0]], [[1e200, 0.0]]
    for dt in (1.0, [[1.0] * 4] * 2):  # side by side, and one by one
        for kept in ("x", "x_prior", "log_likelihood"):
            with pytest.raises(NumericalRangeError, match=f"^{kept}: got numbers up to .*float32"):
                f.filter_many(complete, [kept], dt=dt, dtype=np.float32)
    assert f.filter_many(complete, ["P"], dt=1.0, dtype=np.float32).P.max() < 1.0
    f.Q = 1.0
    with pytest.raises(NumericalRangeError, match=r"^x: .*float32"):
        f.filter_many(gappy, dtype=np.float32)
    found = f.filter_many(beyond, ["log_likelihood"], dtype=np.float32)
    assert (
        found.log_likelihood[0, 0]
        == f.filter_many(beyond, ["log_likelihood"]).log_likelihood[0, 0]
        == -np.inf
    )


@pytest.mark.parametrize("kept", FIELDS)
def test_what_is_not_kept_changes_nothing(kept):
    f, zs = make(3, 2), observations(2)
    alone, all_of_them = f.filter_many(zs, keep=[kept]), f.filter_many(zs, keep=FIELDS)
    np.testing.assert_array_equal(getattr(alone, kept), getattr(all_of_them, kept))


@pytest.mark.parametrize("dtype", ["int64", np.float16, "number", None, ">f8", object()])
def test_other_types_of_numbers_are_refused(dtype):
    with pytest.raises(ParameterError, match=r"dtype: got .*, expected float64 or float32"):
        KalmanFilter(1, 1).filter_many(np.zeros((1, 2)), dtype=dtype)


@pytest.mark.parametrize("threads", [0, 1.5, "2"])
def test_threads_are_counted(threads):
    with pytest.raises(ParameterError, match="threads: got"):
        KalmanFilter(1, 1).filter_many(np.zeros((1, 2)), threads=threads)


# ------------------------------------------------------------------ the end of what there is


def test_no_steps_and_no_series_are_empty():
    f = make(2, 1)
    assert f.filter_many(np.empty((3, 0)), keep=FIELDS).P.shape == (3, 0, 2, 2)
    assert f.filter_many(np.empty((0, 3)), keep=FIELDS, threads=4).P.shape == (0, 3, 2, 2)


@pytest.mark.parametrize("gap", [False, True])
def test_a_singular_step_matters_where_something_was_seen(gap):
    f = KalmanFilter(1, 1, H=[[1.0]], P=0.0, Q=0.0, R=0.0)
    zs = np.zeros((3, 4))
    zs[1] = np.nan
    if gap:
        zs[:, 0] = np.nan
    with pytest.raises(NotPositiveDefiniteError, match="S = H P H'"):
        f.filter_many(zs, threads=2)
    np.testing.assert_array_equal(f.filter_many(zs[1:2], keep=FIELDS).log_likelihood, 0.0)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_an_absurd_observation_beside_a_gap_has_a_density_of_zero():
    f = KalmanFilter(2, 2, H=np.eye(2), P=1e-3 * np.eye(2), R=[[1.0, 0.5], [0.5, 1.0]])
    zs = np.array([[[np.nan, 0.2], [1e300, 0.4e300], [0.3, 0.1]]])
    many, one = f.filter_many(zs), f.copy().filter(zs[0])
    np.testing.assert_array_equal(one.log_likelihood[1:], -np.inf)
    np.testing.assert_array_equal(many.log_likelihood[0, 1:], -np.inf)
    np.testing.assert_allclose(many.x[0], one.x, rtol=1e-12)


def test_controls_of_a_wrong_number_of_series_are_refused_by_the_engine():
    if engine.info().name == "numpy":
        pytest.skip("the NumPy kernels trust their callers")
    eye, out = np.eye(1), {"x": np.empty((3, 2, 1))}
    with pytest.raises(ValueError, match="controls: got those of 2 series, expected 3 or 1"):
        selected.filter_linear_many(
            np.zeros(1), eye, np.zeros((3, 2, 1)), eye, eye, eye, eye, 1.0, np.zeros((2, 2, 1)), out
        )
    with pytest.raises(ValueError, match="F: got 1 matrices, expected one for each of the 2 steps"):
        selected.filter_linear_many(
            np.zeros(1), eye, np.zeros((3, 2, 1)), eye[None], eye, eye, eye, 1.0, None, out
        )
    with pytest.raises(ValueError, match="x: expected a contiguous array of float64"):
        selected.filter_linear_many(np.zeros(1), eye, np.zeros((4, 2, 1)), eye, eye, eye, eye, 1.0, None, out)
