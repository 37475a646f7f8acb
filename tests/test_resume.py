"""`filter` with ``resume`` goes on where a filter stands: parts give what the whole gives, to the bit."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from fuzzykf import (
    CGOMSMFilter,
    CGOMSModel,
    ExtendedKalmanFilter,
    FadeLaw,
    Filter,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.base import as_observation
from fuzzykf.errors import ParameterError
from fuzzykf.results import FIELDS
from fuzzykf.switching import EXACT, Method, SwitchingFilter

N = 16

#: What is compared after a series: all that a filter shows.
SHOWN = [name for name, known in FIELDS.items() if known.streamed]


class Plain(Method):
    """A method of one's own."""

    def first(self, law, y):
        return EXACT.first(law, y)

    def advance(self, tables, mixture, y, width):
        return EXACT.advance(tables, mixture, y, width)

    def ahead(self, tables, mixture):
        return EXACT.ahead(tables, mixture)


class Average(Filter):
    """A filter of one's own."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.array([[10.0]])
        self.x_prior, self.P_prior = self.x, self.P

    def predict(self):
        self.remember_origin()
        self.x_prior, self.P_prior = self.x, self.P

    def update(self, z):
        self.remember_origin()
        y = as_observation(z, 1)
        if y is not None:
            self.x, self.P = 0.8 * self.x + 0.2 * y[:, None], 0.64 * self.P + 0.04


class Passing(OFSRFilter):
    """Goes by the verbs, as one of them is changed."""

    def update(self, z):
        super().update(z)


def scalars():
    return [[[0.9]], [[0.5]]], [[[1.0]], [[0.7]]], [[[0.4]], [[1.0]]], [[[0.5]], [[0.8]]]


def from_cglssm(order=1, **options):
    return CGOMSModel.from_cglssm([[0.9, 0.1], [0.2, 0.8]], *scalars(), order=order, **options)


@functools.cache  # models never change
def space():
    law = FadeLaw.between(10, 4, jump=0.02)
    return SwitchingStateSpace(
        law, F=[[[0.9]], [[0.5]]], H=[[[1.0]], [[0.7]]], Q=0.2, R=0.4, d=[[0.0], [1.0]]
    )


def linear(q=0.1):
    return KalmanFilter(2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]], Q=q * np.eye(2), R=0.5)


def bank(method):
    return IMMEstimator([linear(), linear(2.0)], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], method=method)


def possibilistic(**options):
    est = FuzzyRelationEstimator(1, 1, **options)
    est.F, est.H = np.array([[0.9]]), np.eye(1)
    return est


def gaussian(variance):
    names = ("state", "process_noise", "measurement_noise")
    return {
        name: GaussianMembership(0.0, value) for name, value in zip(names, (variance, 0.1, 1.0), strict=True)
    }


@pytest.fixture(scope="module")
def models(fuzzy_model, hard_model, make_transitions):
    A, Q, means, Sigma = make_transitions(2, 1, 2, seed=3)
    return {
        "fuzzy": fuzzy_model,
        "hard": hard_model,
        "pair": CGOMSModel.from_transitions([[0.8, 0.2], [0.3, 0.7]], A, Q, means, Sigma, 1),
        "order 3": from_cglssm(3),
        "moving": from_cglssm(mode="time_varying", initial_probability=[1.0, 0.0]),
        "moving, order 3": from_cglssm(3, mode="time_varying", initial_probability=[0.5, 0.5]),
    }


MAKES = {
    "Filter": lambda m: Average(),
    "KalmanFilter": lambda m: linear(),
    "ExtendedKalmanFilter": lambda m: ExtendedKalmanFilter(1, 1, fx=np.sin, hx=np.tanh, Q=0.1),
    "IMMEstimator": lambda m: bank("imm"),
    "gpb2": lambda m: bank("gpb2"),
    "FuzzyRelationEstimator": lambda m: possibilistic(),
    "on a grid": lambda m: possibilistic(**gaussian(4.0), points=25),
    "fuzzy": lambda m: OFSRFilter(m["fuzzy"], 3),
    "many nodes": lambda m: OFSRFilter(m["fuzzy"], 14),
    "signed": lambda m: OFSRFilter(m["fuzzy"], 5, "product"),
    "by the verbs": lambda m: Passing(m["fuzzy"], 3),
    "hard": lambda m: CGOMSMFilter(m["hard"]),
    "pair": lambda m: CGOMSMFilter(m["pair"]),
    "order 3": lambda m: CGOMSMFilter(m["order 3"]),
    "moving": lambda m: CGOMSMFilter(m["moving"]),
    "moving, order 3": lambda m: CGOMSMFilter(m["moving, order 3"]),
    "own method": lambda m: SwitchingFilter(m["order 3"].placed(), Plain()),
    "known": lambda m: KnownSwitchFilter(m["fuzzy"]),
    "state space": lambda m: SwitchingKalmanFilter(space(), n_nodes=3),
    "state space, gpb2": lambda m: SwitchingKalmanFilter(space(), method="gpb2", n_nodes=3),
    "known, state space": lambda m: KnownSwitchFilter(space()),
    "known, moving, order 3": lambda m: KnownSwitchFilter(m["moving, order 3"]),
}


@pytest.fixture(params=MAKES)
def make(request, models):
    return lambda: MAKES[request.param](models)


def series(f, missing):
    """Observations with an outlier, and unless ``missing`` is "none" with gaps of every kind."""
    zs = np.random.default_rng(8).normal(size=(N, f.dim_z))
    zs[13] *= 1.0 if isinstance(f, FuzzyRelationEstimator) else 30.0
    if missing == "gaps":
        zs[[5, 6, 11]] = np.nan
        zs[14, 0] = np.nan
    if missing == "first":
        zs[[0, 1, 9]] = np.nan
    return zs


def more(f, at=slice(None)):
    """What `filter` takes beside the observations."""
    r = np.tile([0.0, 0.0, 1.0, 1.0], N // 4)
    return {"r": r[at]} if isinstance(f, KnownSwitchFilter) else {}


def fields(result, at=slice(None)):
    return {name: getattr(result, name)[at] for name in SHOWN if getattr(result, name, None) is not None}


def attributes(f):
    return {name: np.array(getattr(f, name)) for name in (*SHOWN, "z") if getattr(f, name, None) is not None}


def assert_same(got, expected):
    assert got.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(got[name], value, err_msg=name)


@pytest.mark.parametrize("missing", ["none", "gaps", "first"])
def test_parts_give_what_the_whole_gives_to_the_bit(make, missing) -> None:
    whole = make()
    zs = series(whole, missing)
    expected = fields(whole.filter(zs, **more(whole)))
    for cuts in ([1, 6, 7, 12], [3, 3, 5, 14]):  # in gaps, around them; an empty part
        f, parts = make(), []
        for a, b in zip([0, *cuts], [*cuts, N], strict=True):
            parts.append(fields(f.filter(zs[a:b], **more(f, slice(a, b)), resume=True)))
        for name, value in expected.items():
            np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), value, err_msg=name)
        assert_same(attributes(f), attributes(whole))
    x = f.step(zs[3], **{name: float(value) for name, value in more(f, 3).items()})
    np.testing.assert_array_equal(x, whole.step(zs[3], **{k: float(v) for k, v in more(f, 3).items()}))


def test_it_is_steps_from_where_the_filter_stands(make) -> None:
    # after single steps, and after a predict that waits for its observation
    f, g = make(), make()
    zs, one = series(f, "gaps"), {name: float(value) for name, value in more(f, 7).items()}
    for waits in (False, True):
        for k in range(3):
            for each in (f, g):
                each.step(zs[k], **{name: float(value) for name, value in more(f, k).items()})
        if waits:
            f.predict(**one)
            g.predict(**one)
        result = f.filter(zs[8:], **more(f, slice(8, None)), resume=True)
        for k in range(8, N):
            g.step(zs[k], **{name: float(value) for name, value in more(f, k).items()})
            for name in ("x", "P"):
                value = np.squeeze(getattr(result, name)[k - 8])
                np.testing.assert_allclose(value, np.squeeze(getattr(g, name)), rtol=1e-7, atol=1e-9)
        for name, value in attributes(g).items():
            np.testing.assert_allclose(attributes(f)[name], value, rtol=1e-7, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("make", [*MAKES][7:], indirect=True)
def test_a_prediction_that_waits_is_a_gap(make) -> None:
    # of a switching filter, which knows that it has predicted; to the bit
    f, whole = make(), make()
    zs = series(f, "gaps")
    zs[8] = np.nan
    expected = fields(whole.filter(zs, **more(f)), slice(9, None))
    f.filter(zs[:8], **more(f, slice(0, 8)))
    f.predict(**{name: float(value) for name, value in more(f, 8).items()})
    assert_same(fields(f.filter(zs[9:], **more(f, slice(9, None)), resume=True)), expected)
    assert_same(attributes(f), attributes(whole))
    f.reset()
    f.predict(**{name: float(value) for name, value in more(f, 0).items()})  # shows the initial law alone
    shown = f.x.copy()
    f.filter(zs[:0], **more(f, slice(0, 0)), resume=True)  # nothing came, so nothing moves
    np.testing.assert_array_equal(f.x, shown)
    assert f._predicted
    assert_same(fields(f.filter(zs, **more(f), resume=True), slice(9, None)), expected)


@pytest.mark.parametrize("missing", ["none", "gaps"])
def test_many_series_go_on_and_the_filter_stays(make, missing) -> None:
    f = make()
    zs = series(f, missing)
    f.filter(zs[:4], **more(f, slice(0, 4)))
    for waits in (False, True) if missing == "none" else (False,):
        if waits:
            f.predict(**{name: float(value) for name, value in more(f, 4).items()})
        before = attributes(f)
        many = np.stack([zs[5:], 0.5 * zs[5:]])
        given = {name: np.stack([value, value]) for name, value in more(f, slice(5, None)).items()}
        got = f.filter_many(many, keep=("x", "P"), **given, resume=True)
        assert_same(attributes(f), before)
        for k, one in enumerate(many):
            expected = f.copy().filter(one, **more(f, slice(5, None)), resume=True)
            for name in ("x", "P"):
                np.testing.assert_allclose(
                    getattr(got, name)[k], getattr(expected, name), rtol=1e-9, atol=1e-11
                )


def test_without_it_each_starts_where_it_did(make) -> None:
    f = make()
    zs = series(f, "none")
    first = f.filter(zs, **more(f)).x
    again = f.filter(zs, **more(f)).x
    assert np.array_equal(first, again) == isinstance(f, SwitchingFilter)
    with pytest.raises(ParameterError, match="resume: got 'yes', expected True or False"):
        f.filter(zs, **more(f), resume="yes")
    with pytest.raises(ParameterError, match="resume: got 'yes', expected True or False"):
        f.filter_many(zs[None], **{name: value[None] for name, value in more(f).items()}, resume="yes")


def test_an_error_leaves_the_filter_where_it_stood(make) -> None:
    f = make()
    zs = series(f, "none")
    f.filter(zs[:4], **more(f, slice(0, 4)))
    before = attributes(f)
    zs[9] = np.inf
    with pytest.raises(ParameterError, match="zs: observation 5 is"):
        f.filter(zs[4:], **more(f, slice(4, None)), resume=True)
    assert_same(attributes(f), before)


def test_the_switch_of_a_gap_has_to_be_known(models) -> None:
    f = KnownSwitchFilter(models["fuzzy"])
    f.predict(1.0)
    with pytest.raises(ParameterError, match=r"r: got 0.0 after 1.0; the switch is given once"):
        f.filter([1.0], [0.0], resume=True)
    f.update(1.0)
    f.predict()
    with pytest.raises(ParameterError, match="r: the value of the switch at the missing observation"):
        f.filter([1.0], [0.0], resume=True)


def test_many_threads_go_on_alike(models) -> None:
    f = OFSRFilter(models["fuzzy"], 3)
    zs = series(f, "none")
    f.filter(zs)
    many = np.stack([zs, 0.5 * zs, -zs])
    one, three = (f.filter_many(many, resume=True, threads=n) for n in (1, 3))
    np.testing.assert_allclose(one.x, three.x, rtol=1e-12)  # to the bit where the core is compiled


def test_blocks_of_a_dataset_go_on(models) -> None:
    xr = pytest.importorskip("xarray")
    pytest.importorskip("dask")
    from fuzzykf.distributed import filter_dataset

    f = OFSRFilter(models["fuzzy"], 3)
    f.filter([1.0, 2.0])
    zs = np.random.default_rng(1).normal(size=(3, 6))
    found = filter_dataset(xr.Dataset({"z": (("site", "time"), zs)}), f, resume=True, keep=["x"])
    np.testing.assert_array_equal(found.x.values, f.filter_many(zs, keep=["x"], resume=True).x)
