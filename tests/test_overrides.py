"""Verbs that somebody has changed are honoured by whatever runs a filter.

Every filter, with its update changed to halve what it is given, or its predict to move twice: by a
subclass, in one object, or in the class itself.  The verbs called in turn say what is right.
"""

from __future__ import annotations

from types import MethodType

import numpy as np
import pytest

from fuzzykf import (
    CGOMSMFilter,
    ExtendedKalmanFilter,
    Filter,
    FuzzyRelationEstimator,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.base import as_observation
from fuzzykf.errors import ParameterError
from fuzzykf.overrides import follows_copies, is_patched
from fuzzykf.switching import SwitchingFilter

ZS = np.array([0.4, 1.0, -0.3, 2.0, 0.7])[:, None]
RS = np.array([0.0, 0.5, 1.0, 1.0, 0.3])


class Average(Filter):
    """A filter of one's own."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.array([[10.0]])
        self.x_prior, self.P_prior = self.x, self.P

    def predict(self):
        self.remember_origin()
        self.x, self.P = 0.9 * self.x, self.P + 0.1
        self.x_prior, self.P_prior = self.x, self.P

    def update(self, z):
        self.remember_origin()
        y = as_observation(z, 1)
        if y is not None:
            self.x = 0.8 * self.x_prior + 0.2 * y[:, None]
        self.P = self.P_prior


def linear(cls=KalmanFilter, q=0.1):
    return cls(2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]], Q=q * np.eye(2), R=0.5)


def bank(method, cls=IMMEstimator, member=KalmanFilter):
    return cls([linear(member), linear(q=2.0)], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], method=method)


def space():
    return SwitchingStateSpace([[0.9, 0.1], [0.2, 0.8]], F=[[[0.9]], [[0.5]]], H=1.0, Q=0.2, R=0.4)


@pytest.fixture
def make(fuzzy_model, hard_model):
    """By name: makes a filter of the class, or of a subclass of it."""
    return {
        "Filter": lambda cls=Average: cls(),
        "KalmanFilter": lambda cls=KalmanFilter: linear(cls),
        "ExtendedKalmanFilter": lambda cls=ExtendedKalmanFilter: cls(1, 1, fx=np.sin, hx=np.tanh, Q=0.1),
        "IMMEstimator": lambda cls=IMMEstimator: bank("imm", cls),
        "gpb2": lambda cls=IMMEstimator: bank("gpb2", cls),
        "OFSRFilter": lambda cls=OFSRFilter: cls(fuzzy_model, 2),
        "CGOMSMFilter": lambda cls=CGOMSMFilter: cls(hard_model),
        "SwitchingKalmanFilter": lambda cls=SwitchingKalmanFilter: cls(space()),
        "KnownSwitchFilter": lambda cls=KnownSwitchFilter: cls(fuzzy_model),
        "SwitchingFilter": lambda cls=SwitchingFilter: cls(fuzzy_model.placed(1)),
        "FuzzyRelationEstimator": lambda cls=FuzzyRelationEstimator: possibilistic(cls),
    }


def possibilistic(cls):
    est = cls(1, 1)
    est.F, est.H = np.array([[0.9]]), np.eye(1)
    return est


NAMES = (
    *("Filter", "KalmanFilter", "ExtendedKalmanFilter", "IMMEstimator", "gpb2", "OFSRFilter", "CGOMSMFilter"),
    *("SwitchingKalmanFilter", "KnownSwitchFilter", "SwitchingFilter", "FuzzyRelationEstimator"),
)


def halving(update):
    """Change an update, a function of (self, z), to take half of what it is given."""
    return lambda self, z, *args, **kwargs: update(self, half(z), *args, **kwargs)


def half(z):
    return None if z is None else 0.5 * np.asarray(z, dtype=float)


def twice(predict):
    """Change a predict to move two steps."""

    def both(self, *args, **kwargs):
        predict(self, *args, **kwargs)
        predict(self, *args, **kwargs)

    return both


CHANGES = {"update": halving, "predict": twice}


def by_subclass(make, verb, monkeypatch):
    cls = type(make())
    return make(type(cls.__name__, (cls,), {verb: CHANGES[verb](getattr(cls, verb))}))


def in_the_object(make, verb, monkeypatch):
    f = make()
    setattr(f, verb, MethodType(CHANGES[verb](getattr(type(f), verb)), f))
    return f


def by_a_function(make, verb, monkeypatch):
    f = make()
    original = getattr(f, verb)  # which knows this object alone
    changed = CHANGES[verb](lambda self, *args, **kwargs: original(*args, **kwargs))
    setattr(f, verb, lambda *args, **kwargs: changed(None, *args, **kwargs))
    return f


def in_the_class(make, verb, monkeypatch):
    cls = type(make())
    monkeypatch.setattr(cls, verb, CHANGES[verb](getattr(cls, verb)))
    return make()


HOW = {
    "subclass": by_subclass,
    "object": in_the_object,
    "function": by_a_function,
    "class": in_the_class,
}


def state(f):
    return np.concatenate([np.ravel(f.x), np.ravel(f.P)])


def extra(f, k=slice(None)):
    """Arguments beside the observation."""
    return (RS[k],) if isinstance(f, KnownSwitchFilter) else ()


def by_verbs(f):
    rows = []
    for k, z in enumerate(ZS):
        f.predict(*extra(f, k))
        f.update(z.copy())
        rows.append(state(f))
    return np.array(rows)


def by_step(f):
    rows = []
    for k, z in enumerate(ZS):
        f.step(z.copy(), *extra(f, k))
        rows.append(state(f))
    return np.array(rows)


def rows_of(x, P):
    return np.concatenate([x.reshape(len(ZS), -1), P.reshape(len(ZS), -1)], axis=1)


def by_filter(f):
    result = f.filter(ZS, *extra(f))
    np.testing.assert_allclose(state(f), rows_of(result.x, result.P)[-1], rtol=1e-9)  # it ends there
    return rows_of(result.x, result.P)


def by_batch_filter(f):
    return rows_of(*f.batch_filter(ZS, *extra(f))[:2])


def by_filter_many(f):
    before = state(f)
    given = {"r": np.stack([RS, RS])} if isinstance(f, KnownSwitchFilter) else {}
    result = f.filter_many(np.stack([ZS, ZS]), keep=("x", "P"), **given)
    np.testing.assert_array_equal(state(f), before)  # the filter stays as it is
    np.testing.assert_array_equal(result.x[0], result.x[1])
    return rows_of(result.x[1], result.P[1])


def by_dataset(f):
    xr = pytest.importorskip("xarray")
    pytest.importorskip("dask")
    from fuzzykf.distributed import filter_dataset

    variables = {"z": (("site", "time"), np.stack([ZS[:, 0], ZS[:, 0]]))}
    inputs = {}
    if isinstance(f, KnownSwitchFilter):
        variables["r"], inputs = (("site", "time"), np.stack([RS, RS])), {"r": "r"}
    ds = filter_dataset(xr.Dataset(variables), f, "z", inputs=inputs, keep=["x", "P"]).compute()
    return rows_of(ds.x.values[1], ds.P.values[1])


RUNS = {
    "step": by_step,
    "filter": by_filter,
    "batch_filter": by_batch_filter,
    "filter_many": by_filter_many,
    "filter_dataset": by_dataset,
}


#: A patched class is asked for as a subclass is; so one of each kind of engine will do.
CASES = [
    (name, verb, how)
    for name in NAMES
    for verb in CHANGES
    for how in HOW
    if how != "class" or name in ("KalmanFilter", "IMMEstimator", "OFSRFilter", "KnownSwitchFilter")
]


@pytest.mark.parametrize(("name", "verb", "how"), CASES)
def test_every_run_is_the_verbs_in_turn(make, name, verb, how, monkeypatch) -> None:
    plain = by_verbs(make[name]())
    changed = HOW[how]
    expected = by_verbs(changed(make[name], verb, monkeypatch))
    monkeypatch.undo()
    assert np.abs(expected - plain).max() > 1e-3  # the change shows
    for run in RUNS.values():
        if run is by_dataset and (how in ("object", "class") or verb != "update"):
            continue  # what it does with a block is filter_many
        got = run(changed(make[name], verb, monkeypatch))
        monkeypatch.undo()
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-10, err_msg=run.__name__)


@pytest.mark.parametrize("name", NAMES)
def test_every_run_reads_and_writes_as_a_subclass_does(make, name) -> None:
    # neither verb is overridden: what stands for update, and what is written, is changed on the way
    cls = type(make[name]())

    class Halving(cls):
        def __getattribute__(self, attribute):
            value = super().__getattribute__(attribute)
            if attribute != "update":
                return value
            return lambda z, *more, **options: value(half(z), *more, **options)

    class Counting(cls):
        def __setattr__(self, attribute, value):
            written.append(attribute)
            super().__setattr__(attribute, value)

    Halving.__name__ = Counting.__name__ = cls.__name__
    written: list[str] = []
    expected = by_verbs(make[name](Halving))
    assert np.abs(expected - by_verbs(make[name]())).max() > 1e-3
    for run in (by_step, by_filter, by_batch_filter, by_filter_many):
        got = run(make[name](Halving))
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-10, err_msg=run.__name__)
    f, seen = make[name](Counting), []
    for z, r in zip(ZS, RS, strict=True):  # the engine may take over after some steps
        written.clear()
        f.step(z.copy(), *([r] if isinstance(f, KnownSwitchFilter) else []))
        seen.append(len(written))
    assert min(seen) > 0


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("Filter", "FuzzyRelationEstimator")])
def test_a_smoother_goes_forward_by_the_verbs_and_back_only_if_it_can(make, name, how, monkeypatch) -> None:
    if not hasattr(make[name](), "smooth") or not getattr(make[name](), "has_smoother", True):
        pytest.skip("no smoother")
    g = make[name]()
    expected = g.smooth(half(ZS), *extra(g))
    f = HOW[how](make[name], "update", monkeypatch)
    got = f.smooth(ZS, *extra(f))
    assert type(f).__name__ == type(g).__name__
    for field in ("x", "P", "log_likelihood"):
        np.testing.assert_allclose(getattr(got, field), getattr(expected, field), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(state(f), state(g), rtol=1e-9)
    monkeypatch.undo()
    f = HOW[how](make[name], "predict", monkeypatch)
    before = state(f)
    with pytest.raises(ParameterError, match=r"smooth: after .* override smooth as well"):
        f.smooth(ZS, *extra(f))
    np.testing.assert_array_equal(state(f), before)


def test_an_object_patched_after_the_engine_took_over_is_honoured(fuzzy_model) -> None:
    f, g = OFSRFilter(fuzzy_model, 2), OFSRFilter(fuzzy_model, 2)
    for z in ZS[:4]:
        f.step(z)
        g.step(z)
    f.update = MethodType(halving(OFSRFilter.update), f)
    np.testing.assert_allclose(f.step(ZS[4]), g.step(0.5 * ZS[4]))
    del f.update
    np.testing.assert_allclose(f.step(1.0), g.step(1.0))


def test_a_class_patched_after_the_engine_took_over_is_honoured(fuzzy_model, monkeypatch) -> None:
    f, g = OFSRFilter(fuzzy_model, 2), OFSRFilter(fuzzy_model, 2)
    for z in ZS[:4]:
        f.step(z)
        g.step(z)
    expected = g.step(0.5 * ZS[4])
    monkeypatch.setattr(SwitchingFilter, "update", halving(SwitchingFilter.update))  # a base of its class
    np.testing.assert_allclose(f.step(ZS[4]), expected)


def test_series_of_a_known_switch_see_a_patch_of_its_base(fuzzy_model, monkeypatch) -> None:
    expected = KnownSwitchFilter(fuzzy_model).filter(0.5 * ZS, RS).x
    monkeypatch.setattr(SwitchingFilter, "update", halving(SwitchingFilter.update))
    np.testing.assert_allclose(KnownSwitchFilter(fuzzy_model).filter(ZS, RS).x, expected)


class Gated(KalmanFilter):
    """Leaves out what is far off, and counts it."""

    left_out = 0

    def update(self, z, *args, **kwargs):
        far = z is not None and abs(float(np.ravel(z)[0])) > 1.5
        self.left_out += far
        super().update(None if far else z, *args, **kwargs)


@pytest.mark.parametrize("method", ["imm", "gpb2"])
@pytest.mark.parametrize("how", [*HOW, "gated"])
def test_members_of_a_bank_keep_their_verbs(method, how, monkeypatch) -> None:
    # the first member is changed, the second is plain
    def make():
        if how == "gated":
            return bank(method, member=Gated)
        monkeypatch.undo()
        imm = bank(method)
        imm.filters[0] = HOW[how](linear, "update", monkeypatch)
        return imm

    if (method, how) == ("gpb2", "function"):  # it works with copies, which the function does not know
        with pytest.raises(ParameterError, match=r"types\.MethodType"):
            make().step(1.0)
        return
    plain = by_verbs(bank(method))
    expected = by_verbs(make())
    assert np.abs(expected - plain).max() > 1e-3
    for run in (by_step, by_filter, by_filter_many):
        got = run(make())
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-10, err_msg=run.__name__)


def test_smoothing_follows_matrices_that_predict_sets(make) -> None:
    # a predict that sets F and Q for its time is no secret to the way back
    class Clocked(KalmanFilter):
        n = 0

        def predict(self, *args, **kwargs):
            dt = 1.0 + self.n % 3
            self.F, self.Q = np.array([[1.0, dt], [0.0, 1.0]]), 0.1 * dt * np.eye(2)
            self.n += 1
            super().predict(*args, **kwargs)

    f = linear(Clocked)
    got = f.smooth(ZS)
    dts = [1.0 + n % 3 for n in range(len(ZS))]
    Fs, Qs = [np.array([[1.0, dt], [0.0, 1.0]]) for dt in dts], [0.1 * dt * np.eye(2) for dt in dts]
    g = linear()
    x, P, _, _ = g.rts_smoother(*g.batch_filter(ZS, Fs=Fs, Qs=Qs)[:2], Fs, Qs)
    np.testing.assert_allclose(got.x, x[..., 0], rtol=1e-9)
    np.testing.assert_allclose(got.P, P, rtol=1e-9)


def test_controls_reach_changed_verbs_of_many_series() -> None:
    class Halving(KalmanFilter):
        update = halving(KalmanFilter.update)

    zs, us = np.stack([ZS, -ZS]), np.linspace(0.0, 1.0, 2 * len(ZS)).reshape(2, -1, 1)
    f, g = (cls(1, 1, H=[[1.0]], B=[[2.0]]) for cls in (Halving, KalmanFilter))
    for controls in (us, us[0]):
        np.testing.assert_allclose(f.filter_many(zs, us=controls).x, g.filter_many(0.5 * zs, us=controls).x)


def test_an_error_on_the_way_leaves_everything_as_it_was(fuzzy_model) -> None:
    class Failing(OFSRFilter):
        seen = 0

        def update(self, z):
            self.seen += 1
            super().update(z)
            if self.seen == 5:
                raise RuntimeError("no more")

    f = Failing(fuzzy_model, 2)
    f.step(1.0)
    before, seen = state(f), f.seen
    for call in (f.filter, f.smooth):
        with pytest.raises(RuntimeError):
            call(ZS)
        np.testing.assert_array_equal(state(f), before)
        assert f.seen == seen


def test_who_follows_copies() -> None:
    f, g = KalmanFilter(1, 1), KalmanFilter(1, 1)
    assert not is_patched(f)
    assert follows_copies(f)
    f.update = MethodType(KalmanFilter.update, f)
    assert is_patched(f)
    assert follows_copies(f)
    assert follows_copies(f.copy())
    f.update = g.update  # a method, but of another filter
    assert not follows_copies(f)
    f.update = lambda z: None
    assert not follows_copies(f)


def test_a_copy_of_a_filter_whose_verb_knows_the_original_alone_is_refused():
    f = KalmanFilter(1, 1, H=[[1.0]])
    own = f.update
    f.update = lambda z, *more: own(z, *more)
    with pytest.raises(ParameterError, match=r"copy: this KalmanFilter has a function .*MethodType"):
        f.copy()


class InPlace(KalmanFilter):
    """Writes into its own arrays, as filterpy's users may."""

    def predict(self, *args, **kwargs):
        self.remember_origin()
        self.x *= 0.9
        self.P += 1.0


def test_verbs_that_write_into_their_arrays():
    f = InPlace(1, 1, x=[[1.0]], H=[[1.0]])
    ahead, walked = f.forecast(3), f.copy()
    for x, P in zip(ahead.x, ahead.P, strict=True):
        walked.predict()
        np.testing.assert_array_equal(x, walked.x.ravel())
        np.testing.assert_array_equal(P, walked.P)
    f.R = [[-5.0]]
    with pytest.raises(ParameterError):
        f.step(1.0)  # refused by update, after predict
    assert (f.x.item(), f.P.item()) == (1.0, 1.0)


def test_a_function_in_place_of_a_hook_of_predict_is_honoured_too():
    def make():
        f = KalmanFilter(1, 1, H=[[1.0]])
        own = f.get_prediction

        def shifted(*args, **more):
            x, P = own(*args, **more)
            return x + 1.0, P

        f.get_prediction = shifted
        return f

    f, walked = make(), make()
    expected = []
    for z in (1.0, 2.0, 0.5):
        walked.step(z)
        expected.append(walked.x.item())
    assert make().filter_many([[1.0, 2.0, 0.5]]).x.ravel().tolist() == expected
    ahead = f.forecast(3).x.ravel().tolist()
    loop = []
    for _ in range(3):
        f.predict()
        loop.append(f.x.item())
    assert ahead == loop
