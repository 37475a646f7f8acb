"""IMM and GPB2 as methods: values that any filter takes, with functions that agree with whole series."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf import FadeLaw, SwitchingStateSpace
from fuzzykf.errors import NumericalRangeError
from fuzzykf.switching import EXACT, GPB2, IMM
from fuzzykf.switching.inference.joint import JOINT_GPB2, JOINT_IMM
from fuzzykf.switching.inference.registry import METHODS
from fuzzykf.switching.inference.series import FOUND, SHOWN, Stand

YS = np.array([[0.5], [np.nan], [-1.0], [2.0], [0.3]])


@pytest.fixture(scope="module")
def system():
    law = FadeLaw.between(10, 4, jump=0.02)
    H = [[[1.0, 0.0]], [[0.3, 1.0]]]
    return SwitchingStateSpace(law, F=[[0.9, 0.2], [0.0, 0.5]], H=H, Q=np.eye(2), R=0.4).placed(2)


def test_methods_are_found_by_their_names():
    joint = {"joint_imm": JOINT_IMM, "joint_gpb2": JOINT_GPB2}
    assert dict(METHODS) == {"exact": EXACT, "imm": IMM, "gpb2": GPB2} | joint


@pytest.mark.parametrize("method", [IMM, GPB2, JOINT_IMM, JOINT_GPB2])
def test_there_is_one_of_each(method):
    assert copy.deepcopy(method) is pickle.loads(pickle.dumps(method)) is method


@pytest.mark.parametrize("method", [IMM, GPB2])
def test_three_functions_do_what_a_series_does(system, method):
    found = method.run(system, YS, FOUND, states=True)
    mixture, value = method.first(system.initial(), YS[0])
    for n in range(5):
        if n:
            ahead = method.ahead(system.pair_tables(n - 1), mixture)
            np.testing.assert_allclose(ahead.x, found.fields["x_prior"][n], rtol=1e-12, atol=1e-14)
            np.testing.assert_allclose(ahead.P, found.fields["P_prior"][n], rtol=1e-12)
            mixture, value = method.advance(system.pair_tables(n - 1), mixture, YS[n], 0)
        np.testing.assert_allclose(mixture.table, found.fields["table"][n], rtol=1e-12, atol=1e-14)
        assert value == pytest.approx(found.fields["log_likelihood"][n], rel=1e-12)
        assert (mixture.unknown, mixture.window.size) == (0, 0)  # a gap leaves nothing else unknown
    np.testing.assert_array_equal(found.last.table, found.fields["table"][4])
    np.testing.assert_array_equal(found.before.mixture.table, found.fields["table"][3])
    assert found.gaps == {}


@pytest.mark.parametrize("method", [IMM, GPB2])
def test_series_go_on_from_where_one_stands_and_may_be_none(system, method):
    first = method.run(system, YS[:2], FOUND)
    stand = Stand(2, first.last)
    whole, rest = method.run(system, YS, FOUND), method.run(system, YS[2:], FOUND, stand=stand)
    many = method.run_many(system, np.stack([YS[2:], YS[2:]]), SHOWN, stand=stand)
    skipped = method.run(system, YS[3:], FOUND, stand=Stand(2, first.last, skips=True))
    gap = YS.copy()
    gap[2] = np.nan
    for name in FOUND:
        np.testing.assert_array_equal(rest.fields[name], whole.fields[name][2:])
        np.testing.assert_array_equal(many[name][1], rest.fields[name])
        np.testing.assert_array_equal(skipped.fields[name], method.run(system, gap, FOUND).fields[name][3:])
    none = method.run(system, YS[:0], FOUND, stand=stand)
    assert none.last is first.last
    assert none.fields["x"].shape == (0, 2)
    assert method.run(system, YS[:1], FOUND).before is None
    assert method.run_many(system, np.empty((0, 5, 1)), ("x",))["x"].shape == (0, 5, 2)


@pytest.mark.parametrize("method", [IMM, GPB2])
@pytest.mark.parametrize("names", [("x", "log_likelihood"), ("mu",), ("P",)])
def test_what_leaves_the_range_of_numbers_is_refused_whatever_is_asked_for(system, method, names):
    far = YS.copy()
    far[3] = 1e160
    with pytest.raises(NumericalRangeError, match=r"observation: got \[1e\+160\]"):
        method.run(system, far, names)
    mixture, _ = method.first(system.initial(), YS[0])
    with pytest.raises(NumericalRangeError, match=r"observation: got \[1e\+160\]"):
        method.advance(system.pair_tables(0), mixture, far[3], 0)
    with pytest.raises(NumericalRangeError, match=r"observation: got \[1e\+160\]"):
        method.first(system.initial(), far[3])
