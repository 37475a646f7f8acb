"""Maximum likelihood from observations alone: right values, against statsmodels and closed forms."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pandas as pd
import pytest

from fuzzykf import ExtendedKalmanFilter, KalmanFilter
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.estimation import LikelihoodFit
from fuzzykf.kalman.learning.problem import LinearProblem
from fuzzykf.results import FitResult


def values(of):
    return np.array(list(of.values()))


def simulated(kf, n, seed, us=None):
    """Draw a series from a filter whose x and P stand before it."""
    rng = np.random.default_rng(seed)

    def noise(V, *shape):
        return rng.multivariate_normal(np.zeros(len(V)), V, shape, method="eigh")

    x, zs = kf.x.ravel() + noise(kf.P), np.empty((n, kf.dim_z))
    w, v = noise(kf.Q, n), noise(kf.R, n)
    for k in range(n):
        x = kf.F @ x + w[k] + (0.0 if us is None else kf.B @ us[k])
        zs[k] = kf.H @ x + v[k]
    return zs


def level(n=300, seed=0, **attributes):
    kf = KalmanFilter(1, 1, H=[[1.0]], P=4.0, R=4.0, **attributes)
    return kf, simulated(kf, n, seed)


# --------------------------------------------------------------------------- statsmodels

BLOCK = np.array([[0.25, 0.5], [0.5, 1.0]])
VELOCITY = {"F": [[1.0, 1.0], [0.0, 1.0]], "H": [[1.0, 0.0]], "P": 10.0 * np.eye(2)}


def level_case():
    kf = KalmanFilter(1, 1, H=[[1.0]], P=100.0, R=4.0)
    return kf, simulated(kf, 300, 0), None, lambda p, F, H, Q, R: (F, H, p[:1, None], p[1:, None])


def ar_case():
    kf = KalmanFilter(1, 1, H=[[1.0]], F=[[0.8]], P=2.0)
    free = {"F": "full", "Q": "full", "R": "full"}
    return (
        kf,
        simulated(kf, 400, 1),
        free,
        lambda p, F, H, Q, R: (p[:1, None], H, p[1:2, None], p[2:, None]),
    )


def velocity_case():
    kf = KalmanFilter(2, 1, Q=0.1 * BLOCK, R=4.0, **VELOCITY)
    zs = simulated(kf, 400, 2)
    zs[50:80] = np.nan  # a gap
    free = {"Q": ("scale", BLOCK), "R": "full"}
    return kf, zs, free, lambda p, F, H, Q, R: (F, H, p[0] * BLOCK, p[1:, None])


def full_velocity_case():
    known = {**VELOCITY, "H": np.eye(2)}  # from positions alone Q and R could not be told apart
    kf = KalmanFilter(2, 2, Q=[[0.5, 0.1], [0.1, 0.3]], R=np.diag([1.0, 2.0]), **known)

    def put(p, F, H, Q, R):
        return F, H, np.array([[p[0], p[1]], [p[1], p[2]]]), np.diag(p[3:])

    return kf, simulated(kf, 300, 3), None, put


def eight_case():
    kf = KalmanFilter(
        2,
        2,
        F=[[0.8, 0.3], [-0.2, 0.6]],
        H=np.eye(2),
        Q=np.diag([1.0, 0.5]),
        R=np.diag([0.5, 1.0]),
        P=np.eye(2),
    )
    zs = simulated(kf, 500, 4)
    zs[::7, 1] = np.nan
    free = {"F": "full", "Q": "diagonal", "R": "diagonal"}

    def put(p, F, H, Q, R):
        return p[:4].reshape(2, 2), H, np.diag(p[4:6]), np.diag(p[6:])

    return kf, zs, free, put


CASES = {
    "local level": level_case,
    "AR(1) and noise": ar_case,
    "constant velocity": velocity_case,
    "constant velocity, full Q": full_velocity_case,
    "eight numbers": eight_case,
}


def by_statsmodels(kf, zs, put, start):
    """Fit the same model, begun where kf begins: the first prediction comes from its x and P."""
    from statsmodels.tsa.statespace.mlemodel import MLEModel

    class Same(MLEModel):
        start_params = start
        param_names = tuple(map(str, range(len(start))))

        def update(self, params, **options):
            params = super().update(params, **options)
            own = [np.asarray(getattr(kf, name)).astype(params.dtype) for name in "FHQR"]
            F, H, Q, R = put(params, *own)
            self["transition"], self["design"], self["state_cov"], self["obs_cov"] = F, H, Q, R
            self.ssm.initialize_known(F @ kf.x.ravel(), F @ kf.P @ F.T + Q)

    model = Same(zs, k_states=kf.dim_x, k_posdef=kf.dim_x)
    model["selection"] = np.eye(kf.dim_x)
    # "approx": standard errors from the second derivatives of the log-likelihood, as here; statsmodels' "oim"
    # is the formula of Harvey, which differs from them in finite samples
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # next to the top scipy's search may miss the last digits, and say so
        return model.fit(method="bfgs", gtol=1e-8, maxiter=300, disp=0, cov_type="approx")


@pytest.mark.parametrize("name", CASES)
def test_estimates_and_standard_errors_are_those_of_statsmodels(name) -> None:
    kf, zs, free, put = CASES[name]()
    fit = kf.fit(zs, free=free)
    assert fit.converged
    assert fit.warnings == ()
    estimates = values(fit.estimates)
    other = by_statsmodels(kf, zs, put, 1.05 * estimates)
    assert fit.log_likelihood == pytest.approx(other.llf, abs=1e-6)
    np.testing.assert_allclose(estimates, other.params, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(values(fit.standard_errors), other.bse, rtol=1e-4)
    assert fit.aic == pytest.approx(other.aic)
    # zs of a whole row missing are no observations here
    assert fit.n_observations == (~np.isnan(zs)).any(axis=1).sum()


def test_the_local_level_is_that_of_unobserved_components() -> None:
    from statsmodels.tsa.statespace.structural import UnobservedComponents

    kf, zs = level()
    kf.P = 1e6  # next to this the noise of the first step is nothing
    model = UnobservedComponents(zs[:, 0], "llevel")
    model.ssm.initialize_known(np.zeros(1), 1e6 * np.eye(1))
    model.ssm.loglikelihood_burn = 0
    other = model.fit(method="bfgs", gtol=1e-8, disp=0, cov_type="approx")
    fit = kf.fit(zs)
    np.testing.assert_allclose([fit.estimates[k] for k in ("R[0, 0]", "Q[0, 0]")], other.params, rtol=1e-4)
    errors = [fit.standard_errors[k] for k in ("R[0, 0]", "Q[0, 0]")]
    np.testing.assert_allclose(errors, other.bse, rtol=1e-4)


# --------------------------------------------------------------------------- closed forms


def noise_only(dim_z, R):
    """A filter that sees nothing but the noise of its observations."""
    return KalmanFilter(1, dim_z, H=np.zeros((dim_z, 1)), R=R, Q=0.0, P=0.0)


WHITE = np.random.default_rng(5).normal(size=(200, 2)) @ np.array([[2.0, 0.0], [0.5, 1.0]])
S = WHITE.T @ WHITE / 200


@pytest.mark.parametrize(
    ("free", "expected", "errors"),
    [
        (
            "full",
            [S[0, 0], S[1, 0], S[1, 1]],
            [S[0, 0], np.sqrt((S[0, 0] * S[1, 1] + S[0, 1] ** 2) / 2), S[1, 1]],
        ),
        ("diagonal", [S[0, 0], S[1, 1]], [S[0, 0], S[1, 1]]),
        (
            ("scale", np.diag([4.0, 1.0])),
            [(S[0, 0] / 4.0 + S[1, 1]) / 2.0],
            [(S[0, 0] / 4.0 + S[1, 1]) / 2**1.5],
        ),
        ([[False, False], [False, True]], [S[1, 1]], [S[1, 1]]),
    ],
    ids=["full", "diagonal", "scale", "mask"],
)
def test_the_covariance_of_white_noise_is_its_second_moments(free, expected, errors) -> None:
    fit = noise_only(2, np.eye(2)).fit(WHITE, free={"R": free})
    np.testing.assert_allclose(values(fit.estimates), expected, rtol=1e-6)
    np.testing.assert_allclose(values(fit.standard_errors), np.array(errors) / 10.0, rtol=1e-5)


def test_the_start_of_many_series_is_their_mean_and_variance() -> None:
    # without noise of the motion, one observation each is N(x, P + R)
    z = np.random.default_rng(6).normal(3.0, 2.0, (50, 1, 1))
    kf = KalmanFilter(1, 1, H=[[1.0]], Q=0.0, R=0.5, P=1.0)
    fit = kf.fit(dict(enumerate(z)), free={"x": "full", "P": "full"})
    assert fit.estimates["x[0]"] == pytest.approx(z.mean(), rel=1e-5)
    assert fit.estimates["P[0, 0]"] == pytest.approx(z.var() - 0.5, rel=1e-5)
    assert fit.standard_errors["x[0]"] == pytest.approx(np.sqrt(z.var() / 50), rel=1e-4)
    assert fit.model.x.shape == kf.x.shape
    assert fit.n_observations == 50


def test_the_gain_of_a_control_is_a_regression() -> None:
    rng = np.random.default_rng(7)
    us, zs = rng.normal(size=(80, 2)), np.empty((80, 1))
    zs[:, 0] = np.cumsum(us @ [1.5, -0.5] + 0.3 * rng.normal(size=80))
    kf = KalmanFilter(1, 1, 2, H=[[1.0]], B=[[1.0, 1.0]], R=0.0, Q=0.09, P=0.0)
    fit = kf.fit(zs, free={"B": "full"}, us=us)
    expected = np.linalg.lstsq(us, np.diff(zs[:, 0], prepend=0.0))[0]
    np.testing.assert_allclose(fit.model.B[0], expected, rtol=1e-5)
    errors = 0.3 * np.sqrt(np.diagonal(np.linalg.inv(us.T @ us)))
    np.testing.assert_allclose(values(fit.standard_errors), errors, rtol=1e-4)


def test_an_entry_of_the_observation_matrix_is_a_regression() -> None:
    rng = np.random.default_rng(8)
    x = np.cumsum(rng.normal(size=60))
    zs = np.column_stack([x, 0.7 * x + 0.5 * rng.normal(size=60)])
    kf = KalmanFilter(1, 2, H=[[1.0], [1.0]], R=np.diag([0.0, 0.25]), P=0.0)
    fit = kf.fit(zs, free={"H": [[False], [True]]})
    assert list(fit.estimates) == ["H[1, 0]"]
    assert fit.estimates["H[1, 0]"] == pytest.approx((x @ zs[:, 1]) / (x @ x), rel=1e-5)
    assert fit.standard_errors["H[1, 0]"] == pytest.approx(0.5 / np.sqrt(x @ x), rel=1e-4)


# --------------------------------------------------------------------------- what a fit is


def test_a_fit_is_of_the_model_that_it_returns_and_leaves_the_filter_alone() -> None:
    kf, zs = level(x=[0.5])
    kf.step(1.0)
    before = {name: np.copy(value) for name, value in kf.__dict__.items() if isinstance(value, np.ndarray)}
    fit = kf.fit(zs)
    assert isinstance(fit, LikelihoodFit)
    assert isinstance(fit, FitResult)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(kf, name), value, err_msg=name)
    model = fit.model
    assert type(model) is KalmanFilter
    assert model is not kf
    np.testing.assert_array_equal(model.x, kf.x)
    np.testing.assert_array_equal(model.P, kf.P)
    assert [model.Q[0, 0], model.R[0, 0]] == list(fit.estimates.values())
    assert model.filter(zs).log_likelihood.sum() == pytest.approx(fit.log_likelihood, rel=1e-12)
    model.reset()
    assert model.Q[0, 0] == fit.estimates["Q[0, 0]"]  # its origin is where it was made
    assert (np.diff(fit.trace) >= -1e-9).all()


def test_a_filter_that_has_moved_begins_where_it_stands() -> None:
    kf, zs = level()
    kf.filter(zs[:100])
    fit = kf.fit(zs[100:])
    assert fit.model.filter(zs[100:]).log_likelihood.sum() == pytest.approx(fit.log_likelihood)
    fresh = KalmanFilter(1, 1, H=[[1.0]], x=kf.x, P=kf.P, R=4.0)
    assert fresh.fit(zs[100:]).estimates == pytest.approx(fit.estimates, rel=1e-6)


def test_steps_of_expectation_and_maximisation_never_lose() -> None:
    kf, zs = level()
    kf.Q, kf.R = 1e-3, 100.0
    problem = kf.fit(zs, max_iter=1).replicate.problem
    assert isinstance(problem, LinearProblem)
    numbers = problem.free.start
    heights = [problem.log_likelihood(numbers)[0]]
    for _ in range(4):
        numbers = problem.prepared(numbers)
        heights.append(problem.log_likelihood(numbers)[0])
    assert (np.diff(heights) > 0.0).all()
    assert heights[1] - heights[0] > 50.0


def test_any_start_leads_to_the_maximum() -> None:
    kf, zs = level()
    best = kf.fit(zs).estimates
    for q, r in [(1e-6, 1e4), (1e4, 1e-6), (1e-8, 1e-8)]:
        kf.Q, kf.R = q, r
        assert kf.fit(zs).estimates == pytest.approx(best, rel=1e-3)


@pytest.fixture(scope="module")
def with_its_start():
    """A fit of the level, of its noise and its start."""
    kf, zs = level()
    return kf.fit(zs, free={"x": "full", "R": "full"})


@pytest.mark.parametrize("x", [0.7, [0.7], [[0.7]]])
def test_attributes_may_be_numbers_and_x_keeps_its_form(x, with_its_start) -> None:
    (kf, zs), expected = level(), with_its_start
    kf.x, kf.P, kf.Q, kf.R, kf.F, kf.H = x, 4.0, 1.0, 4.0, 1.0, 1.0
    fit = kf.fit(zs, free={"x": "full", "R": "full"})
    assert fit.estimates == pytest.approx(expected.estimates, rel=1e-3)
    assert np.ndim(fit.model.x) == (np.ndim(x) or 2)


#: The same series in other forms.
FORMS = {
    "flat": lambda zs: zs[:, 0],
    "list": lambda zs: zs[:, 0].tolist(),
    "None where missing": lambda zs: [None if np.isnan(z[0]) else z for z in zs],
    "generator": lambda zs: (z for z in zs),
    "Series": lambda zs: pd.Series(zs[:, 0], index=pd.date_range("2020", periods=len(zs))),
    "frame": lambda zs: pd.DataFrame({"z": zs[:, 0]}),
    "one series in a list": lambda zs: [zs],
    "one series by its name": lambda zs: {"a": zs},
    "array of series": lambda zs: zs[None],
    "with an end that is missing": lambda zs: np.concatenate([zs, np.full((9, 1), np.nan)]),
}


@pytest.fixture(scope="module")
def of_one_with_a_gap():
    """A filter, a series, and what is learned from it."""
    kf, zs = level()
    zs[20:30] = np.nan
    return kf, zs, kf.fit(zs)


@pytest.mark.parametrize("form", FORMS)
def test_a_series_may_come_in_any_form(form, of_one_with_a_gap) -> None:
    kf, zs, expected = of_one_with_a_gap
    fit = kf.fit(FORMS[form](zs.copy()))
    assert fit.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-9)
    assert fit.estimates == pytest.approx(expected.estimates, rel=1e-4)
    assert fit.n_observations == 290


MANY = {
    "list": lambda a, b: [a, b],
    "tuple of flat ones": lambda a, b: (a[:, 0], b[:, 0]),
    "mapping": lambda a, b: {"a": a, "b": b[:, 0].tolist()},
    "array": lambda a, b: np.stack([a, np.concatenate([b, np.full((len(a) - len(b), 1), np.nan)])]),
    "frame": lambda a, b: pd.DataFrame({"a": pd.Series(a[:, 0]), "b": pd.Series(b[:, 0])}),
}


@pytest.fixture(scope="module")
def of_two():
    """A filter, two series, and what is learned from both and from the first alone."""
    kf, a = level()
    b = simulated(kf, 120, 1)
    return kf, a, b, kf.fit([a, b]).estimates, kf.fit(a).estimates


@pytest.mark.parametrize("form", MANY)
def test_several_series_count_together(form, of_two) -> None:
    kf, a, b, expected, of_the_first = of_two
    fit = kf.fit(MANY[form](a.copy(), b.copy()))
    total = sum(fit.model.copy().filter(one).log_likelihood.sum() for one in (a, b))
    assert fit.log_likelihood == pytest.approx(total, rel=1e-10)
    assert fit.n_observations == 420
    assert fit.estimates == pytest.approx(expected, rel=1e-4)
    assert abs(fit.estimates["R[0, 0]"] - of_the_first["R[0, 0]"]) > 1e-3


@pytest.mark.parametrize("shared", [True, False])
def test_several_series_have_controls(shared) -> None:
    kf = KalmanFilter(1, 1, 1, H=[[1.0]], B=[[2.0]], P=1.0)
    us = np.random.default_rng(0).normal(size=(2, 150, 1))
    us[1] = us[0] if shared else us[1]
    zs = [simulated(kf, n, n, us[k]) for k, n in enumerate((150, 90))]
    controls = us[0] if shared else {"a": us[0], "b": us[1][:90]}
    fit = kf.fit(dict(zip("ab", zs, strict=True)), free={"B": "full", "R": "full"}, us=controls)
    total = sum(
        fit.model.copy().filter(one, u[:, :, None]).log_likelihood.sum()
        for one, u in zip(zs, us, strict=True)
    )
    assert fit.log_likelihood == pytest.approx(total, rel=1e-10)
    lower, upper = fit.intervals(0.999)["B[0, 0]"]
    assert lower < 2.0 < upper


def test_components_in_another_order_have_the_same_estimates() -> None:
    kf = KalmanFilter(
        3,
        2,
        F=[[0.9, 0.1, 0.0], [0.0, 0.8, 0.3], [0.0, 0.0, 0.7]],
        H=[[1.0, 0.5, 0.0], [0.0, 0.4, 1.0]],
        Q=[[1.0, 0.2, 0.0], [0.2, 0.6, 0.0], [0.0, 0.0, 0.5]],
        R=np.diag([0.5, 1.0]),
    )
    zs = simulated(kf, 120, 9)
    mask = kf.Q != 0.0
    fit = kf.fit(zs, free={"Q": mask, "R": "diagonal"})
    p, q = [2, 0, 1], [1, 0]
    other = KalmanFilter(
        3, 2, F=kf.F[np.ix_(p, p)], H=kf.H[np.ix_(q, p)], Q=kf.Q[np.ix_(p, p)], R=kf.R[np.ix_(q, q)]
    )
    turned = other.fit(zs[:, q], free={"Q": mask[np.ix_(p, p)], "R": "diagonal"})
    assert turned.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-6)
    np.testing.assert_allclose(turned.model.Q, fit.model.Q[np.ix_(p, p)], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(turned.model.R, fit.model.R[np.ix_(q, q)], rtol=1e-3)
    for name, error in fit.standard_errors.items():
        i, j = (int(k) for k in name[2:-1].split(", "))
        order = q if name[0] == "R" else p
        i, j = sorted((order.index(i), order.index(j)), reverse=True)
        assert turned.standard_errors[f"{name[0]}[{i}, {j}]"] == pytest.approx(error, rel=2e-3)


def test_in_other_units_there_are_other_numbers_and_the_same_fit() -> None:
    kf, zs = level()
    fit = kf.fit(zs)
    small = KalmanFilter(1, 1, H=[[1.0]], P=4e-12, R=4e-12, Q=1e-12)
    other = small.fit(1e-6 * zs)
    assert values(other.estimates) == pytest.approx(1e-12 * values(fit.estimates), rel=1e-4)
    assert values(other.standard_errors) == pytest.approx(1e-12 * values(fit.standard_errors), rel=1e-4)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_start_and_a_gain_may_be_in_any_unit(unit) -> None:
    kf = KalmanFilter(1, 1, 1, H=[[1.0]], B=[[0.0]], Q=unit**2, R=unit**2, P=unit**2)
    us = np.random.default_rng(19).normal(size=(80, 1))
    zs = unit * (np.cumsum(2.0 * us) + np.random.default_rng(20).normal(size=80))
    fit = kf.fit(zs, free={"x": "full", "B": "full"}, us=us)
    assert fit.converged
    assert fit.warnings == ()
    one = KalmanFilter(1, 1, 1, H=[[1.0]], B=[[1.0]]).fit(zs / unit, free={"x": "full", "B": "full"}, us=us)
    assert values(fit.estimates) / unit == pytest.approx(values(one.estimates), rel=1e-4)
    assert values(fit.standard_errors) / unit == pytest.approx(values(one.standard_errors), rel=1e-4)


# --------------------------------------------------------------------------- what the data do not tell


def test_a_variance_that_goes_to_zero_is_said_to() -> None:
    zs = 5.0 + np.random.default_rng(10).normal(size=200)  # of a level that stands still
    fit = KalmanFilter(1, 1, H=[[1.0]], P=100.0).fit(zs)
    assert fit.estimates["Q[0, 0]"] == 0.0
    assert fit.model.Q == 0.0
    assert np.isnan(fit.standard_errors["Q[0, 0]"])
    assert fit.warnings == ("Q[0, 0]: at its bound; the estimate is 0, and there is no standard error",)
    assert fit.converged
    assert fit.estimates["R[0, 0]"] == pytest.approx(zs.var(ddof=1), rel=0.01)
    assert fit.standard_errors["R[0, 0]"] == pytest.approx(zs.var() * np.sqrt(2 / 200), rel=0.02)


def test_a_variance_without_which_all_is_explained_goes_to_zero_from_far_away() -> None:
    # the smallest noise of a motion that grows is felt, so that the search passes many powers of ten
    zs = 1.05 ** np.arange(200) + np.random.default_rng(21).normal(size=200)
    fit = KalmanFilter(1, 1, H=[[1.0]]).fit(zs, free={"F": "full", "Q": "full", "R": "full"})
    assert fit.estimates["Q[0, 0]"] == 0.0
    assert fit.estimates["F[0, 0]"] == pytest.approx(1.05, rel=1e-5)
    assert fit.warnings == ("Q[0, 0]: at its bound; the estimate is 0, and there is no standard error",)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_constant_observations_have_no_maximum(value) -> None:
    fit = KalmanFilter(1, 1, H=[[1.0]]).fit(np.full(50, value))
    assert not fit.converged
    assert any("the log-likelihood grows without bound towards zero" in note for note in fit.warnings)


def test_noises_that_nothing_tells_apart_are_named() -> None:
    # a state without memory: Q and R are one noise
    kf = KalmanFilter(1, 1, H=[[1.0]], F=[[0.0]])
    fit = kf.fit(2.0 * np.random.default_rng(11).normal(size=200))
    assert fit.warnings == (
        "Q[0, 0], R[0, 0]: weakly identified, the log-likelihood does not change along them together",
    )
    assert np.isnan(values(fit.standard_errors)).all()
    assert sum(fit.estimates.values()) == pytest.approx(4.0, rel=0.3)


def test_what_hardly_makes_a_covariance_singular_is_named_as_such() -> None:
    # white noise of an acceleration has a covariance of rank one: the second variance is known, but no rest
    push = np.array([0.5, 1.0])
    truth = KalmanFilter(
        2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]], Q=0.09 * np.outer(push, push), R=4.0
    )
    fit = KalmanFilter(2, 1, F=truth.F, H=truth.H, Q=np.eye(2), R=1.0, P=100.0).fit(simulated(truth, 150, 3))
    assert not any(note.startswith("Q[1, 1]: weakly") for note in fit.warnings)
    assert any("Q[1, 1]" in note for note in fit.warnings)


def test_several_starts_find_several_maxima() -> None:
    # the sign of a gain that is squared in all that is observed
    kf = KalmanFilter(1, 1, H=[[0.5]], F=[[0.9]])
    zs = simulated(kf, 150, 12)
    fit = kf.fit(zs, free={"H": "full"}, n_starts=12, rng=np.random.default_rng(1))
    assert fit.n_starts == 12
    assert sorted(np.sign(one.estimates["H[0, 0]"]) for one in fit.maxima) == [-1.0, 1.0]
    assert fit.maxima[0].log_likelihood == pytest.approx(fit.maxima[1].log_likelihood, abs=1e-5)
    assert "another maximum" in fit.warnings[0]


def test_a_bootstrap_has_the_gaps_and_the_inputs_of_what_was_learned_from() -> None:
    kf = KalmanFilter(1, 1, 1, H=[[1.0]], B=[[5.0]], P=1.0, R=4.0)
    us = np.random.default_rng(13).normal(size=(120, 1))
    a, b = simulated(kf, 120, 14, us), simulated(kf, 60, 15, us)
    a[30:60] = np.nan
    fit = kf.fit([a, b], free={"Q": "full", "R": "full", "B": "full"}, us=us)
    again = fit.bootstrap(8, np.random.default_rng(16))
    assert {one.n_observations for one in again} == {150}
    spread = np.std([values(one.estimates) for one in again], axis=0)
    ratio = spread / values(fit.standard_errors)
    assert ((ratio > 0.4) & (ratio < 2.5)).all()  # a standard deviation of eight is known to a quarter
    gain = [one.estimates["B[0, 0]"] for one in again]
    assert abs(np.mean(gain) - fit.estimates["B[0, 0]"]) < 1.0
    assert len(fit.bootstrap(1, np.random.default_rng(0))[0].bootstrap(1, np.random.default_rng(0))) == 1
    same = pickle.loads(pickle.dumps(fit)).bootstrap(1, np.random.default_rng(16))[0]
    assert same.estimates == again[0].estimates


# --------------------------------------------------------------------------- other filters


class Restless(KalmanFilter):
    """A filter with a verb of its own: it never believes that P is small."""

    def predict(self, *args, **kwargs):
        super().predict(*args, **kwargs)
        self.P = self.P + 0.5 * np.eye(self.dim_x)


def test_a_verb_of_a_subclass_counts() -> None:
    kf, zs = level(n=60)
    own = Restless(1, 1, H=[[1.0]], P=4.0, R=4.0)
    fit, plain = own.fit(zs), kf.fit(zs)
    assert type(fit.model) is Restless
    assert fit.model.copy().filter(zs).log_likelihood.sum() == pytest.approx(fit.log_likelihood, rel=1e-12)
    # it adds to P what the noise of the motion adds, but for the start
    assert fit.estimates["Q[0, 0]"] == pytest.approx(plain.estimates["Q[0, 0]"] - 0.5, rel=1e-3)
    assert fit.standard_errors == pytest.approx(plain.standard_errors, rel=1e-3)
    with pytest.raises(ParameterError, match="bootstrap: a Restless with verbs of its own"):
        fit.bootstrap(1, np.random.default_rng(0))


def test_a_filter_that_cannot_be_copied_is_refused_before_the_work() -> None:
    kf, zs = level(n=60)
    predict, calls = kf.predict, []

    def counting(*args, **kwargs):  # acts on this filter alone
        calls.append(1)
        predict(*args, **kwargs)

    kf.predict = counting
    with pytest.raises(ParameterError, match="copy: this KalmanFilter has a function in place"):
        kf.fit(zs)
    assert not calls


def extended(kf, **options):
    return ExtendedKalmanFilter(
        kf.dim_x,
        kf.dim_z,
        fx=lambda x, u=0.0: kf.F @ x + u,
        FJacobian=lambda x, u=0.0: kf.F,
        hx=lambda x, bias=0.0: kf.H @ x + bias,
        HJacobian=lambda x, bias=0.0: kf.H,
        x=kf.x,
        P=kf.P,
        Q=kf.Q,
        R=kf.R,
        **options,
    )


def test_an_extended_filter_of_linear_functions_learns_as_a_linear_one() -> None:
    kf, zs = level(n=35)
    zs[10:20] = np.nan
    fit, expected = extended(kf).fit(zs), kf.fit(zs)
    assert fit.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-9)
    assert fit.estimates == pytest.approx(expected.estimates, rel=1e-3)
    assert fit.standard_errors == pytest.approx(expected.standard_errors, rel=1e-3)
    assert type(fit.model) is ExtendedKalmanFilter


def test_an_extended_filter_has_a_bootstrap() -> None:
    kf, zs = level(n=30)
    zs[10:20] = np.nan
    fit = extended(kf).fit(zs, free={"R": "full"})
    (again,) = fit.bootstrap(1, np.random.default_rng(0))
    assert again.n_observations == 20
    assert 0.2 < again.estimates["R[0, 0]"] / fit.estimates["R[0, 0]"] < 3.0


def test_an_extended_filter_is_told_controls_and_arguments() -> None:
    kf, zs = level(n=20)
    us = np.random.default_rng(17).normal(size=20)
    bias = np.arange(20.0)
    moved = zs + np.cumsum(us)[:, None] + bias[:, None]
    ekf = extended(kf)
    given = {"us": us, "hx_args": [{"bias": b} for b in bias]}
    free = {"R": "full"}
    fit = ekf.fit(moved, free=free, **given)
    assert fit.estimates == pytest.approx(kf.fit(zs, free=free).estimates, rel=1e-4)
    many = ekf.fit({"a": moved, "b": moved[:12]}, free=free, **given)
    assert many.estimates == pytest.approx(kf.fit([zs, zs[:12]], free=free).estimates, rel=1e-4)


def test_a_nonlinear_observation_is_learned_from() -> None:
    rng = np.random.default_rng(18)
    x = np.cumsum(0.1 * rng.normal(size=60))
    ekf = ExtendedKalmanFilter(1, 1, hx=np.exp, HJacobian=lambda x: np.exp(x)[None], Q=0.01, P=0.01)
    fit = ekf.fit(np.exp(x) + 0.2 * rng.normal(size=60), free={"R": "full"})
    lower, upper = fit.intervals(0.999)["R[0, 0]"]
    assert lower < 0.04 < upper
    with pytest.raises(ParameterError, match="free: got 'H', expected one of Q, R, x, P, F"):
        ekf.fit(x, free={"H": "full"})


# --------------------------------------------------------------------------- bad input

#: Keyword arguments, the error, and what its message has to name.
REFUSED = [
    ({"free": {}}, ParameterError, ["free"]),
    ({"free": {"B": "full"}}, ParameterError, ["free", "'B'", "us"]),
    ({"free": {"P0": "full"}}, ParameterError, ["free", "'P0'", "Q, R, x, P, F, H"]),
    ({"free": {"R": "some"}}, ShapeError, ["free['R']", "'some'"]),
    ({"zs": []}, ParameterError, ["zs", "observation"]),
    ({"zs": [np.nan, None]}, ParameterError, ["zs", "2 rows", "observation"]),
    ({"zs": [1.0, np.inf]}, ParameterError, ["zs", "inf"]),
    ({"zs": [[1.0, 2.0], [3.0, np.inf]]}, ParameterError, ["zs", "observation 1 of series 1", "inf"]),
    ({"zs": np.zeros((4, 3, 2))}, ShapeError, ["zs", "(4, 3, 2)"]),
    ({"zs": 3.0}, ShapeError, ["zs"]),
    ({"zs": "series"}, ParameterError, ["zs", "'series'"]),
    ({"us": [1.0, 2.0, 3.0]}, ShapeError, ["B"]),
    ({"n_starts": 0}, ParameterError, ["n_starts"]),
    ({"n_starts": 2}, ParameterError, ["rng"]),
    ({"rng": 1}, ParameterError, ["rng", "Generator"]),
    ({"max_iter": 0}, ParameterError, ["max_iter"]),
    ({"tolerance": -1.0}, ParameterError, ["tolerance"]),
    ({"progress": "yes"}, ParameterError, ["progress"]),
]


@pytest.mark.parametrize(("given", "error", "named"), REFUSED)
def test_what_cannot_be_learned_is_refused(given, error, named) -> None:
    kf = KalmanFilter(1, 1, H=[[1.0]])
    with pytest.raises(error) as caught:
        kf.fit(**{"zs": [1.0, 2.0, 0.5], **given})
    for word in named:
        assert word in str(caught.value)


#: Attributes from which no search can begin, and what the message has to name.
ATTRIBUTES = [
    ({"Q": 0.0}, NotPositiveDefiniteError, "free['Q']"),
    ({"R": -1.0}, NotPositiveDefiniteError, "R"),
    ({"R": np.nan}, ParameterError, "R"),
    ({"P": -1.0}, NotPositiveDefiniteError, "P"),
    ({"F": np.eye(2)}, ShapeError, "F"),
    ({"alpha": 1.02}, ParameterError, "alpha"),
]


@pytest.mark.parametrize(("attributes", "error", "name"), ATTRIBUTES)
def test_a_filter_from_which_no_search_can_begin_is_refused(attributes, error, name) -> None:
    kf = KalmanFilter(1, 1, H=[[1.0]])
    for key, value in attributes.items():
        setattr(kf, key, value)
    with pytest.raises(error) as caught:
        kf.fit([1.0, 2.0, 0.5])
    assert str(caught.value).startswith(name)


def test_unequal_steps_are_warned_of_once() -> None:
    index = pd.to_datetime(["2020-01-01", "2020-01-02", "2020-01-05", "2020-01-06", "2020-01-07"])
    for kf in (KalmanFilter(1, 1, H=[[1.0]]), Restless(1, 1, H=[[1.0]])):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            kf.fit(pd.Series([1.0, 2.0, 0.5, 0.7, 0.9], index=index), free={"R": "full"})
        assert len(caught) == 1


def test_controls_of_other_rows_are_refused() -> None:
    kf = KalmanFilter(1, 1, 1, H=[[1.0]], B=[[1.0]])
    zs = pd.Series([1.0, 2.0, 3.0], index=[0, 1, 2])
    with pytest.raises(ParameterError, match="zs, us: rows of different indexes"):
        kf.fit(zs, us=pd.Series([1.0, 2.0, 3.0], index=[1, 2, 3]))
