"""Series side by side: each as its verbs filter it, whatever is missing and wherever it begins."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.errors import NumericalRangeError
from fuzzykf.switching import SwitchingFilter
from fuzzykf.switching.inference.exact import Exact

KEEP = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")


def vectors() -> CGOFMSModel:
    """Two states and two observed components."""
    rng = np.random.default_rng(4)
    root = 0.4 * rng.normal(size=(4, 4)) + np.eye(4)
    pair = np.kron([[1.0, 0.4], [0.4, 1.0]], root @ root.T)
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(4), np.ones(4)], np.broadcast_to(pair, (2, 2, 8, 8)), 2)


def series_of(model: CGOFMSModel, n: int = 12) -> np.ndarray:
    """Six series, of which all begin in other ways: with nothing, with a part, with a long gap, whole."""
    ys = np.stack([model.simulate(n, np.random.default_rng(k)).y for k in range(6)])
    ys[np.random.default_rng(9).random(ys.shape) < 0.25] = np.nan
    ys[0, 0], ys[1, :3], ys[2, 0], ys[3], ys[4, 0, 0], ys[4, 0, 1:] = np.nan, np.nan, 0.2, np.nan, np.nan, 0.1
    return ys


@pytest.fixture(params=["scalar", "vectors"])
def model(request, fuzzy_model) -> CGOFMSModel:
    return fuzzy_model if request.param == "scalar" else vectors()


def test_series_that_begin_with_a_gap_go_with_the_others(model, monkeypatch) -> None:
    ys, expected = series_of(model), []
    for y in ys:
        f = OFSRFilter(model, 2)
        for z in y:
            f.predict()
            f.update(z)
            expected.append([np.ravel(getattr(f, name)) for name in KEEP])
    taken = []
    for verb in ("first", "advance"):
        monkeypatch.setattr(Exact, verb, lambda *given: taken.append(given))
    f = OFSRFilter(model, 2)
    many = f.filter_many(ys, KEEP, threads=2)
    assert not taken  # all by the engine
    for name, column in zip(KEEP, zip(*expected, strict=True), strict=True):
        got = getattr(many, name).reshape(len(column), -1)
        np.testing.assert_allclose(got, np.array(column), rtol=1e-10, atol=1e-12, err_msg=name)


def test_a_series_that_begins_with_a_gap_leaves_the_filter_in_it(model) -> None:
    for n in (1, 3):  # in the gap at the beginning, and in one later on
        f, g = OFSRFilter(model, 2), OFSRFilter(model, 2)
        y = np.full((n, model.dim_z), np.nan)
        y[1:2] = 0.3
        f.filter(y)
        for z in (*y, np.full(model.dim_z, 0.1)):
            g.predict()
            g.update(z)
        np.testing.assert_allclose(f.step(np.full(model.dim_z, 0.1)), g.x, rtol=1e-11)
        np.testing.assert_allclose(f.log_likelihood, g.log_likelihood, rtol=1e-11)


@pytest.mark.parametrize("skips", [False, True])
def test_series_with_gaps_go_on_from_where_the_filter_stands(skips, model, monkeypatch) -> None:
    ys, f = series_of(model), OFSRFilter(model, 2)
    f.filter(np.full((3, model.dim_z), 0.2))
    if skips:
        f.predict()
    alone = [copy.deepcopy(f).filter(y, resume=True) for y in ys]
    blocks = []
    whole = f._method.gappy_series
    monkeypatch.setattr(
        Exact, "gappy_series", lambda self, *given: blocks.append(len(given[3])) or whole(*given)
    )
    many = f.filter_many(ys, KEEP, resume=True)
    assert blocks == [len(ys)]
    for name in KEEP:
        got = getattr(many, name)
        np.testing.assert_allclose(got, [getattr(one, name) for one in alone], rtol=1e-10, atol=1e-12)


def test_a_first_part_beyond_all_numbers_is_refused() -> None:
    ys = series_of(vectors())
    ys[4, 0] = 1e200, np.nan
    for given in (ys, ys[:, :1], ys[4:5]):
        with pytest.raises(NumericalRangeError, match=r"observation: got \[1e\+200, nan\]"):
            OFSRFilter(vectors()).filter_many(given)


@pytest.mark.parametrize("first", [0.3, np.nan])
def test_a_first_observation_of_ones_own_is_not_bypassed(first, fuzzy_model) -> None:
    class Counting(Exact):
        count = 0

        def first(self, law, y):
            self.count += 1
            return super().first(law, y)

    method, y = Counting(), np.array([first, np.nan, 0.2, 0.4])
    f = SwitchingFilter(fuzzy_model.placed(2), method)
    f.filter(y)
    assert method.count == 1
    many = f.filter_many([y, y + 0.1])
    assert method.count == 3
    np.testing.assert_allclose(many.x[0], OFSRFilter(fuzzy_model, 2).filter(y).x, rtol=1e-11)


def test_longer_windows_begin_as_the_verbs_do() -> None:
    # tables change as long as the window grows: what is missing then goes alone
    one = [[[0.8]], [[0.5]]]
    f = CGOMSMFilter(CGOMSModel.from_cglssm([[0.9, 0.1], [0.25, 0.75]], one, one, one, one, order=2))
    ys = np.random.default_rng(0).normal(size=(5, 10))
    ys[0, 0] = ys[1, 1] = ys[2, 2] = ys[3, :3] = np.nan
    many = f.filter_many(ys, KEEP)
    for k, y in enumerate(ys):
        g = CGOMSMFilter(f.model)
        for n, z in enumerate(y):
            g.predict()
            g.update(z)
            np.testing.assert_allclose(many.x[k, n], g.x[:, 0], rtol=1e-10, atol=1e-12)
