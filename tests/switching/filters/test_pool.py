"""The pool of filters: its laws are the mixture of those of its members, whatever these are."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from fuzzykf import CGOMSModel, Filter, FilterPool, IMMEstimator, KalmanFilter, OFSRFilter, io, pool_models
from fuzzykf.errors import FileFormatError, ParameterError, SequenceError, ShapeError
from fuzzykf.testing import check_filter

ZS = np.array([0.4, 1.0, np.nan, 2.0, -0.7])


def kalman(F=0.9, m=1):
    return KalmanFilter(m, m, F=F * np.eye(m), H=np.eye(m), Q=0.1, R=0.5)


@pytest.fixture
def hard(fuzzy_model):
    return fuzzy_model.harden()


@pytest.fixture
def pool(fuzzy_model, hard):
    return FilterPool([OFSRFilter(fuzzy_model, 1), hard.filter(), kalman()], [0.5, 0.3, 0.2])


def test_a_pool_of_kalman_filters_keeps_the_contract():
    mixed = check_filter(lambda: FilterPool([kalman(m=2), kalman(0.5, m=2)]))
    assert {"missing_component", "filter_many", "leading_predict"} <= set(mixed.passed)
    assert "save" in mixed.not_applicable


def test_its_laws_are_the_mixtures_of_those_of_its_members(pool):
    result = pool.filter(ZS)
    members = [one.copy() for one in pool.members]
    for one in members:
        one.reset()
    w, found = pool.weights, [one.filter(ZS) for one in members]
    t, step = np.linspace(-40.0, 40.0, 200_001, retstep=True)
    for n in range(len(ZS)):
        stds = [np.sqrt(one.P[n, 0, 0]) for one in found]
        density = sum(wk * norm.pdf(t, one.x[n, 0], s) for wk, one, s in zip(w, found, stds, strict=True))
        mean = (t * density).sum() * step
        variance = ((t - mean) ** 2 * density).sum() * step
        np.testing.assert_allclose([result.x[n, 0], result.P[n, 0, 0]], [mean, variance], rtol=1e-9)
        low, high = (ends[n, 0] for ends in result.interval(0.8))
        inside = np.cumsum(density) * step
        np.testing.assert_allclose(np.interp([low, high], t, inside), [0.1, 0.9], atol=1e-3)
    likelihood = sum(wk * np.exp(one.log_likelihood) for wk, one in zip(w, found, strict=True))
    np.testing.assert_allclose(result.log_likelihood, np.log(likelihood), rtol=1e-12, atol=1e-15)
    prior = sum(wk * one.x_prior for wk, one in zip(w, found, strict=True))
    np.testing.assert_allclose(result.x_prior, prior, rtol=1e-12)


def test_likelihoods_that_are_no_numbers_any_more_are_added_as_logarithms(hard):
    pool = FilterPool([hard.filter(), kalman()])
    pool.step(0.0)
    pool.step(1e4)
    logs = [one.log_likelihood for one in pool.members]
    assert max(logs) < -1e6
    assert pool.log_likelihood == pytest.approx(np.logaddexp(*logs) - np.log(2.0), rel=1e-14)


def test_one_member_is_itself(fuzzy_model):
    alone, pool = fuzzy_model.filter(), pool_models([fuzzy_model])
    for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
        got, expected = getattr(pool.filter(ZS), name), getattr(alone.filter(ZS), name)
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-14)
    assert pool.filter_many(ZS[None]).log_likelihood.shape == (1, 5)


def test_with_nodes_the_interval_is_that_of_all_nodes(pool):
    result = pool.filter(ZS, keep_nodes=True)
    fuzzy, hard, _ = (len(one.nodes) if hasattr(one, "nodes") else 1 for one in pool.members)
    assert result.nodes.tolist() == [0.0] * fuzzy + [1.0] * hard + [2.0]
    np.testing.assert_allclose(result.mu.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(result.mu[:, fuzzy : fuzzy + hard].sum(axis=1), 0.3, rtol=1e-12)
    np.testing.assert_allclose((result.mu[..., None] * result.node_x).sum(axis=1), result.x, atol=1e-12)
    upper = result.interval(0.9)[1]
    stds = np.sqrt(result.node_P[..., 0, 0])
    below = (result.mu * norm.cdf(upper, result.node_x[..., 0], stds)).sum(axis=1)
    np.testing.assert_allclose(below, 0.95, rtol=1e-9)
    assert np.abs(upper - pool.filter(ZS).interval(0.9)[1]).max() > 1e-3
    nested = FilterPool([pool, kalman(0.5)])
    assert nested.filter(ZS, keep_nodes=True).mu.shape == (5, fuzzy + hard + 2)
    np.testing.assert_allclose(nested.filter(ZS).mu, 0.5)


def test_many_series_are_as_one_after_another(pool):
    series = {"a": ZS, "b": ZS[:3] + 1.0}
    names = ("x", "P", "mu", "node_x", "node_P", "log_likelihood", "P_prior")
    pool.step(5.0)
    many = pool.filter_many(series, keep=names)
    assert list(many.names) == ["a", "b"]
    for name, zs in series.items():
        one, expected = many.one(name), pool.copy().filter(zs)
        for field in names:
            np.testing.assert_allclose(getattr(one, field), getattr(expected, field), rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(one.interval(0.9)[0], expected.interval(0.9)[0], rtol=1e-10)
    assert pool._n == 1
    with pytest.raises(ParameterError, match="keep: got 'switch', expected names among x, P, mu"):
        pool.filter_many(series, keep=("switch",))


def test_forecasts_are_mixtures(pool):
    pool.filter(ZS)
    ahead = pool.forecast(3)
    found = [one.forecast(3) for one in pool.members]
    mean = sum(w * one.z_prior for w, one in zip(pool.weights, found, strict=True))
    second = sum(
        w * (one.S + one.z_prior[..., None] ** 2) for w, one in zip(pool.weights, found, strict=True)
    )
    np.testing.assert_allclose(ahead.z_prior, mean, rtol=1e-12)
    np.testing.assert_allclose(ahead.S, second - mean[..., None] ** 2, rtol=1e-10)
    assert ahead.node_x.shape == (3, 3, 1)
    pool.predict()
    with pytest.raises(SequenceError, match="forecast: predict was called since"):
        pool.forecast(3)


def test_dates_go_along(pool):
    index = pd.date_range("2024-01-01", periods=5, freq="h")
    assert pool.filter(pd.Series(ZS, index)).index.equals(index)
    assert pool.forecast(2).index[0] == pd.Timestamp("2024-01-01 05:00")
    with pytest.raises(ParameterError, match="zs"):
        pool.filter(pd.Series(ZS, index), resume=True)
    assert pool.filter(iter(ZS[:3])).x.shape == (3, 1)


def test_names_are_those_of_the_members():
    rng = np.random.default_rng(0)
    y = pd.DataFrame(rng.normal(size=(200, 2)), columns=["t", "h"])
    x, r = rng.normal(size=200), np.arange(200) // 20 % 2
    fits = [CGOMSModel.fit(x, y[names], r, form="regression") for names in (["t", "h"], ["h", "t"])]
    pool = pool_models([fits[0], fits[0].model])
    expected = fits[0].model.filter().filter(y).x
    np.testing.assert_allclose(pool.filter(y[["h", "t"]].assign(more=0.0)).x, expected)
    np.testing.assert_allclose(pool.filter_many([y[["h", "t"]]]).x[0], expected)
    changed = type("Changed", (FilterPool,), {"update": lambda self, z: FilterPool.update(self, z)})
    np.testing.assert_allclose(changed(pool.members).filter(y[["h", "t"]]).x, expected)
    with pytest.raises(ParameterError, match="some that observe t, h and some that observe h, t"):
        pool_models(fits)


class Stubborn(KalmanFilter):
    """Takes no observation above 1."""

    def update(self, z, *args, **kwargs):
        if z is not None and np.max(z) > 1.0:
            raise ArithmeticError("too much")
        super().update(z, *args, **kwargs)


@pytest.mark.parametrize("call", [lambda f: f.step(2.0), lambda f: f.filter([0.3, 2.0])])
def test_what_one_member_refuses_leaves_all_as_they_were(call, hard):
    imm = IMMEstimator([kalman(), kalman(0.5)], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]])
    parts = [hard.filter(), imm, FilterPool([kalman()]), Stubborn(1, 1, H=[[1.0]])]
    pool, other = FilterPool(parts), FilterPool(parts)
    for f in (pool, other):
        f.filter([0.2, -0.3])
    with pytest.raises(ArithmeticError, match="too much"):
        call(pool)
    for _ in range(2):
        np.testing.assert_array_equal(
            [one.x.ravel() for one in pool.members], [one.x.ravel() for one in other.members]
        )
        np.testing.assert_array_equal(pool.P, other.P)
        pool.step(0.4)
        other.step(0.4)


def test_it_works_on_copies_that_begin_at_the_beginning(hard):
    f = hard.filter()
    f.step(3.0)
    before = f.x.copy()
    pool = FilterPool([f, f])
    assert pool.step(1.0) == pytest.approx(hard.filter().step(1.0))
    np.testing.assert_array_equal(f.x, before)


def test_what_is_told_reaches_each_member():
    controlled = [KalmanFilter(1, 1, 1, H=[[1.0]], B=[[b]]) for b in (1.0, 2.0)]
    pool = FilterPool(controlled)
    pool.predict(u=3.0)
    np.testing.assert_allclose([one.x.item() for one in pool.members], [3.0, 6.0])
    pool.update(1.0, R=0.25)
    result = pool.filter([1.0, 2.0], us=[3.0, 0.0])
    expected = [one.copy() for one in controlled]
    xs = [one.filter([1.0, 2.0], us=[3.0, 0.0]).x for one in expected]
    np.testing.assert_allclose(result.x, np.mean(xs, axis=0))
    changed = type("Changed", (FilterPool,), {"update": lambda self, z: FilterPool.update(self, z)})
    with pytest.raises(
        ParameterError, match="filter: got us, but the predict or update of this pool was changed"
    ):
        changed(controlled).filter([1.0], us=[3.0])


def test_files(pool, fuzzy_model, hard, tmp_path):
    saved = FilterPool([FilterPool([fuzzy_model.filter(1)]), hard.filter()], [0.25, 0.75])
    saved.filter(ZS)
    saved.predict()
    io.save_filter(saved, tmp_path / "pool")
    loaded = io.load_filter(tmp_path / "pool")
    np.testing.assert_array_equal([*loaded.weights, *loaded.P.ravel()], [0.25, 0.75, *saved.P.ravel()])
    np.testing.assert_array_equal(loaded.step(1.0), saved.step(1.0))
    text = (tmp_path / "pool").read_text()
    head, _, tail = text.partition('"n": 5')
    (tmp_path / "pool").write_text(f'{head}"n": 4{tail}')
    with pytest.raises(FileFormatError, match="members: got one after 5 observations"):
        io.load_filter(tmp_path / "pool")
    with pytest.raises(ParameterError, match="save: got a pool of OFSRFilter, CGOMSMFilter, KalmanFilter"):
        pool.save(tmp_path / "other")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    "weights", [[0.5], [0.5, 0.6], [1.0, 0.0], [1.5, -0.5], [[0.5, 0.5]], [np.nan, 1.0], 0.5]
)
def test_weights_are_positive_with_the_sum_one(weights):
    with pytest.raises(ParameterError, match=r"weights: "):
        FilterPool([kalman(), kalman(0.5)], weights)


class Silent(Filter):
    """Has no density."""

    dim_x = dim_z = 1
    x = P = x_prior = P_prior = np.zeros((1, 1))

    def predict(self):
        """Do nothing."""

    def update(self, z):
        """Do nothing."""


def test_what_cannot_be_pooled(fuzzy_model):
    for given in ([], None, kalman(), "pool"):
        with pytest.raises(
            ParameterError, match=r"filters: got .*, expected a sequence of one filter at least"
        ):
            FilterPool(given)
    with pytest.raises(ParameterError, match=r"models: got .*, expected a sequence of models and filters"):
        pool_models(fuzzy_model)
    with pytest.raises(
        ParameterError, match=r"filters\[1\]: got a CGOFMSModel, expected a filter \(pool_models"
    ):
        FilterPool([kalman(), fuzzy_model])
    with pytest.raises(ParameterError, match=r"filters\[0\]: got the class KalmanFilter, expected a filter"):
        FilterPool([KalmanFilter])
    with pytest.raises(ParameterError, match=r"filters\[0\]: got a Silent, which has no log_likelihood"):
        FilterPool([Silent()])
    with pytest.raises(
        ParameterError, match=r"filters\[1\]: got dim_x=2, dim_z=2, expected .* dim_x=1, dim_z=1"
    ):
        FilterPool([kalman(), kalman(m=2)])


def test_inputs_go_to_those_members_whose_models_have_some() -> None:
    rng = np.random.default_rng(0)
    r, u = np.arange(200) // 40 % 2, rng.normal(size=(200, 1))
    y = 3.0 * r + u[:, 0] + rng.normal(size=200)
    x = np.where(r, y, -y) + u[:, 0] + 0.3 * rng.normal(size=200)
    options = {"n_starts": 1, "max_iter": 5, "form": "regression"}
    told = CGOMSModel.fit(x, y, inputs=u, **options).model.filter()
    plain = CGOMSModel.fit(x, y, **options).model.filter()
    pool = FilterPool([FilterPool([plain, plain]), told])
    found = pool.filter(y, us=u)
    members = plain.filter(y), told.filter(y, us=u)
    np.testing.assert_allclose(found.x, 0.5 * (members[0].x + members[1].x), rtol=1e-12)
    pool.reset()
    stepped = np.array([pool.step(one, u=told)[:, 0] for one, told in zip(y[:20], u, strict=False)])
    np.testing.assert_allclose(stepped, found.x[:20], rtol=1e-9)
    for us in (u, np.stack([u, u])):
        many = pool.filter_many(np.stack([y, y])[..., None], us=us)
        np.testing.assert_allclose(many.x[1], found.x, rtol=1e-9)
    with pytest.raises(ParameterError, match=r"u: got .*, but the model has no inputs"):
        FilterPool([plain]).step(1.0, u=0.5)
    with pytest.raises(ShapeError, match=r"us: got shape \(200,\), expected \(n, k\) or \(series, n, k\)"):
        pool.filter_many(np.stack([y, y])[..., None], us=u[:, 0])
