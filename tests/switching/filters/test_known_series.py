"""Series of a known switch side by side: the numbers of each alone, for every kind of model and of gap."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingStateSpace,
)
from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError
from fuzzykf.switching.inference.series import SHOWN
from fuzzykf.testing import check_filter

S, N = 7, 9
HARD = [[0.9, 0.1], [0.2, 0.8]]
FADES = FadeLaw.between(30, 10)
RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})
CHAIN = SwitchChain([3.0, 7.0], np.ones(2), np.ones(2) / 2, np.full((2, 2), 0.5), [[0.9, 0.1], [0.3, 0.7]])


def space(law, q=2, **more):
    rng = np.random.default_rng(1)
    K = len(law) if isinstance(law, list) else getattr(law, "n_classes", 2)
    return SwitchingStateSpace(
        law, F=0.5 * rng.normal(size=(K, 2, 2)), H=rng.normal(size=(K, q, 2)), Q=np.eye(2), R=0.5 * np.eye(q),
        d=3.0 * rng.normal(size=(K, q)), B=rng.normal(size=(K, 2, 1)), **more,
    )  # fmt: skip


def blocks(K, m, q, seed=3):
    """Means and covariances of pairs of K classes."""
    rng = np.random.default_rng(seed)
    d = m + q
    root = np.eye(d) + 0.15 * rng.normal(size=(K, d, d))
    z = root @ np.swapaxes(root, 1, 2)
    pairs = [[np.block([[z[i], 0.4 * z[i]], [0.4 * z[i], z[j]]]) for j in range(K)] for i in range(K)]
    return 2.0 * rng.normal(size=(K, d)), pairs


def regressions(C=1.0):
    """Two hard regimes, two states and two observations; C tells how much Y' leaves open of X'."""
    rng = np.random.default_rng(4)
    pair = (2, 2, 2, 2)
    return CGOMSModel.from_regressions(
        HARD, Ayy=0.4 * rng.normal(size=pair), Ny=rng.normal(size=(2, 2, 2)),
        Qyy=np.broadcast_to(np.eye(2), pair), Axx=0.4 * rng.normal(size=pair), H=rng.normal(size=pair),
        G=3.0 * rng.normal(size=pair), c=rng.normal(size=(2, 2, 2)), C=np.broadcast_to(C * np.eye(2), pair),
        means=np.zeros((2, 4)), covariances=np.broadcast_to(np.eye(4), (2, 4, 4)),
    )  # fmt: skip


def transitions():
    A = np.array([[0.5, 0.2, 0.1], [0.0, 0.4, 0.1], [0.0, 0.1, 0.3]])
    z = np.eye(3)
    return CGOMSModel.from_transitions(
        HARD, np.broadcast_to(A, (2, 2, 3, 3)), np.broadcast_to(z - A @ A.T, (2, 2, 3, 3)),
        [[0.0, 1.0, 0.0], [1.0, -1.0, 2.0]], [z, z], 1,
    )  # fmt: skip


MODELS = {
    "space, fades": lambda: space(FADES),
    "space, one observation": lambda: space(FADES, 1),
    "space, hard": lambda: space(HARD),
    "space, ring": lambda: space(RING),
    "space, chain": lambda: space(CHAIN),
    "space, functions": lambda: space(FADES, x0=lambda w: [w[0], 1.0], P0=lambda w: (1.0 + w[1]) * np.eye(2)),
    "pairs, fuzzy": lambda: CGOFMSModel(FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2), *blocks(2, 2, 2), 2),
    "pairs, ring": lambda: CGOFMSModel(RING, *blocks(3, 1, 2), 1),
    "pairs, hard": lambda: CGOMSModel(HARD, *blocks(2, 1, 1), 1),
    "pairs, transitions": transitions,
    "pairs, regressions": regressions,
    "pairs, all but told": lambda: regressions(1e-12),
    "pairs, told": lambda: regressions(0.0),
}


def switches(model, seed=0):
    """A path of its own for each series: values of the switch, or class weights."""
    rng = np.random.default_rng(seed)
    if model.takes_weights:
        return rng.dirichlet(np.ones(model.n_classes), (S, N))
    if not model.is_fuzzy:
        return rng.integers(0, model.n_classes, (S, N)).astype(float)
    if isinstance(getattr(model, "law", None), SwitchChain):
        return rng.choice(model.law.nodes, (S, N))
    return rng.uniform(size=(S, N)).round(1)


def complete(ys):
    return ys


def gaps(ys):
    """Gaps of every kind, an outlier, and one before a gap; the last series is complete."""
    ys[0, 3], ys[1, [0, 1]], ys[2, 5:], ys[3, 1:] = (np.nan,) * 4
    ys[0, 4, 0], ys[2, 0, -1], ys[4, ::2, 0], ys[5, 1::2, -1], ys[5, -1, 0] = (np.nan,) * 5
    ys[4, 3] *= 1e4
    ys[5, 2], ys[5, 3] = 1e4, np.nan
    return ys


INPUTS = {one.__name__: one for one in (complete, gaps)}
STANDS = ("told", "resumed", "after a gap", "after a skip")
CASES = [(name, missing, "beginning") for name in MODELS for missing in INPUTS]
CASES += [
    (name, "gaps", where)
    for where in STANDS
    for name in ("space, fades", "space, ring", "pairs, fuzzy", "pairs, regressions", "pairs, ring")
]


def standing(model, where, ys, r):
    """A filter that has taken the first series up to somewhere."""
    f = KnownSwitchFilter(model)
    if where == "told":
        f.predict(r[0, 0])
    elif where != "beginning":
        seen = ys[0, :4].copy()
        if where == "after a gap":
            seen[-1, 0] = np.nan
        f.filter(seen, r[0, :4])
        if where == "after a skip":
            f.predict(r[1, 0])
    return f


def assert_alike(found, expected, rtol=1e-12):
    for name in SHOWN:
        got, value = getattr(found, name), getattr(expected, name)
        assert (got is None) == (value is None), name
        if value is not None:
            scale = max(1.0, np.abs(value).max())
            np.testing.assert_allclose(got, value, rtol=rtol, atol=1e-14 * scale, err_msg=name)


@pytest.mark.parametrize(("name", "missing", "where"), CASES)
def test_many_are_as_each_alone_and_go_side_by_side(name, missing, where, monkeypatch):
    model = MODELS[name]()
    r = switches(model)
    if where == "told":
        r[:, 0] = r[0, 0]
    ys = INPUTS[missing](np.random.default_rng(6).normal(size=(S, N, model.dim_z)))
    us = {"us": np.random.default_rng(7).normal(size=(S, N, 1))} if "space" in name else {}
    f = standing(model, where, ys, r)
    resume = where != "beginning"
    alone = []
    for k in range(S):
        one = {key: value[k] for key, value in us.items()}
        alone.append(f.copy().filter(ys[k], r[k], resume=resume, **one))
    monkeypatch.setattr(KnownSwitchFilter, "_filter_each", None)  # nothing goes alone
    before = f.x, f.P, f._n
    many = f.filter_many(ys, keep=SHOWN, r=r, resume=resume, **us)
    for now, was in zip((f.x, f.P, f._n), before, strict=True):
        np.testing.assert_array_equal(now, was)
    for k, expected in enumerate(alone):
        assert_alike(many.one(k), expected)
    only = f.filter_many(ys, keep=("P_prior",), r=r, resume=resume, **us)
    np.testing.assert_array_equal(only.P_prior, many.P_prior)
    assert only.x is None


@pytest.mark.parametrize("name", ["space, fades", "pairs, fuzzy", "pairs, ring"])
def test_series_of_any_length(name):
    model = MODELS[name]()
    r, ys = switches(model), np.random.default_rng(6).normal(size=(S, N, model.dim_z))
    lengths = [9, 1, 4, 9, 2, 4, 1]
    found = KnownSwitchFilter(model).filter_many(
        [y[:n] for y, n in zip(ys, lengths, strict=True)],
        keep=SHOWN,
        r=[one[:n] for one, n in zip(r, lengths, strict=True)],
    )
    for k, n in enumerate(lengths):
        assert_alike(found.one(k), KnownSwitchFilter(model).filter(ys[k, :n], r[k, :n]))


def test_steps_go_in_chunks_that_do_not_show(monkeypatch):
    from fuzzykf.switching.inference import known_paths

    for name in ("space, fades", "pairs, fuzzy"):
        model = MODELS[name]()
        r, ys = switches(model), gaps(np.random.default_rng(6).normal(size=(S, N, model.dim_z)))
        f = KnownSwitchFilter(model)
        whole = f.filter_many(ys, keep=SHOWN, r=r)
        for size in (1, 2000):
            monkeypatch.setattr(known_paths, "_NUMBERS", size)
            parts = f.filter_many(ys, keep=SHOWN, r=r)
            for field in SHOWN:
                np.testing.assert_allclose(getattr(parts, field), getattr(whole, field), rtol=1e-13)
        monkeypatch.undo()


def test_a_converted_model_goes_one_series_after_another():
    model = CGOMSModel.from_cglssm(HARD, [[[0.9]], [[0.5]]], [[[1.0]]] * 2, [[[0.3]]] * 2, [[[0.5]]] * 2)
    r = switches(model)
    ys = gaps(np.random.default_rng(6).normal(size=(S, N, 1)))
    many = KnownSwitchFilter(model).filter_many(ys, keep=SHOWN, r=r)
    for k in range(S):
        assert_alike(many.one(k), KnownSwitchFilter(model).filter(ys[k], r[k]))


# --------------------------------------------------------------------------- what is refused


def indefinite():
    gamma = np.array(blocks(2, 1, 1)[1])
    gamma[0, 1, 0, 2] = gamma[0, 1, 2, 0] = 1.7
    return CGOFMSModel(FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0), np.zeros((2, 2)), gamma, 1)


def singular():
    return SwitchingStateSpace(HARD, F=0.5, H=[[[1.0]], [[0.0]]], Q=0.2, R=0.0, x0=[0.0], P0=1.0)


REFUSED = {  # model, a series, its switches: the error
    "absurd": (MODELS["pairs, hard"], [0.0, 1e300], [0, 1], NumericalRangeError, r"got \[1e\+300\]"),
    "absurd, space": (MODELS["space, one observation"], [0.0, 1e300], [0, 1], NumericalRangeError, "1e.300"),
    "indefinite": (
        indefinite,
        [0.0, 0.0],
        [0, 1],
        NotPositiveDefiniteError,
        r"known pair r_n = 0, r_n\+1 = 1",
    ),
    "singular": (singular, [0.0, 0.0], [0, 1], NotPositiveDefiniteError, "S = H P H' . R"),
    "no switch": (MODELS["pairs, fuzzy"], [[0.0, 0.0]] * 2, [0.5, 2.0], ParameterError, "r: got values from"),
    "NaN": (MODELS["space, fades"], [[0.0, 0.0]] * 2, [0.5, np.nan], ParameterError, "r: got values from"),
    "no regime": (MODELS["space, hard"], [[0.0, 0.0]] * 2, [0, 2], ParameterError, "r: got values from 0"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_goes_wrong_in_one_series_is_said_as_it_is_alone(name):
    make, ys, r, error, message = REFUSED[name]
    f = KnownSwitchFilter(make())
    q = f.dim_z
    fine = np.zeros((2, q)), [0.0, 0.0]
    f.step(np.zeros(q), 0.0)
    x = f.x
    with pytest.raises(error, match=message):
        f.copy().filter(ys, r)
    with pytest.raises(error, match=message):
        f.filter_many(np.array([fine[0], np.reshape(ys, (2, q))]), r=[fine[1], r])
    np.testing.assert_array_equal(f.x, x)


def test_each_series_has_to_go_on_from_what_was_told():
    f = KnownSwitchFilter(MODELS["space, fades"]())
    f.predict(0.3)
    with pytest.raises(ParameterError, match=r"r: got 0\.4 after 0\.3; the switch is given once"):
        f.filter_many(np.zeros((2, 1, 2)), r=[[0.3], [0.4]], resume=True)
    f.update([0.0, 0.0])
    f.predict()
    for call in (f.filter_many, lambda zs, **given: f.filter(zs[0], given["r"][0], resume=True)):
        with pytest.raises(ParameterError, match="r: the value of the switch at the missing observation was"):
            call(np.zeros((1, 1, 2)), r=[[0.3]], resume=True)
    with pytest.raises(ShapeError, match=r"zs: got no series|r: "):
        f.filter_many(np.zeros((0, 1, 2)), r=np.zeros((0, 1)))


# --------------------------------------------------------------------------- the contract of filters


class AtOneSwitch(KnownSwitchFilter):
    """One value for all switches, so that no verb needs it."""

    value = 1.0

    def predict(self, r=None, u=None):
        told = self._n == 0 and self._r_next is not None  # a leading predict has been told already
        super().predict(None if told else self.value)

    def update(self, z, r=None, R=None, H=None):
        super().update(z, self.value if self._r_next is None else None)

    def step(self, z, r=None, u=None, R=None, H=None):
        return super().step(z, self.value)

    def filter(self, zs, r=None, *, resume=False):
        return super().filter(zs, [self.value] * len(zs), resume=resume)

    def smooth(self, zs, r=None):
        return super().smooth(zs, [self.value] * len(zs))

    def filter_many(self, zs, keep=("x", "P", "log_likelihood"), *, resume=False):
        return super().filter_many(zs, keep, r=np.full(np.shape(zs)[:2], self.value), resume=resume)


@pytest.mark.parametrize("name", ["space, one observation", "space, hard", "space, ring"])
def test_a_known_switch_of_a_state_space_model_keeps_the_contract(name):
    model = MODELS[name]()
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None] + 0.7 * np.arange(model.dim_z))
    report = check_filter(lambda: AtOneSwitch(model), zs)
    assert {"step", "filter", "filter_many", "missing", "smooth", "pickle", "resume", "overrides"} <= set(
        report.passed
    )
