"""What nobody may assign says so, and what to do instead."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf import (
    CGLSSM,
    CGOMSMFilter,
    FadeLaw,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.immutable import Unassignable


def model():
    return SwitchingStateSpace(FadeLaw.between(20, 5), 0.9, [[[1.0]], [[0.5]]], 0.1, 0.2)


OBJECTS = {
    "SwitchingKalmanFilter": lambda: SwitchingKalmanFilter(model()),
    "KnownSwitchFilter": lambda: KnownSwitchFilter(model()),
    "SwitchingStateSpace": model,
}


@pytest.mark.parametrize("name", ["F", "H", "Q", "R", "B"])
@pytest.mark.parametrize("made", OBJECTS)
def test_parameters_of_a_kalman_filter_are_not_taken_for_those_of_a_model(made, name) -> None:
    one = OBJECTS[made]()
    with pytest.raises(AttributeError, match=rf"^{name}: cannot be assigned to a {made}; .*make another"):
        setattr(one, name, np.eye(1))
    assert not hasattr(one, name)
    assert name not in vars(one)


def test_every_filter_of_a_switch_says_it(fuzzy_model, hard_model) -> None:
    for f in (OFSRFilter(fuzzy_model), CGOMSMFilter(hard_model)):
        with pytest.raises(AttributeError, match="M: cannot be assigned"):
            f.M = np.eye(2)


def test_a_subclass_may_have_the_attribute() -> None:
    system = CGLSSM([[1.0]], A=[[[0.9]]], B=[[[1.0]]], C=[[[0.3]]], D=[[[0.5]]])
    np.testing.assert_array_equal(system.B, [[[1.0]]])  # in the notation of its paper
    with pytest.raises(AttributeError, match="R: cannot be assigned to a CGLSSM"):
        system.R = 1.0


def test_copies_and_pickles_are_as_before() -> None:
    f = SwitchingKalmanFilter(model())
    f.step(0.3)
    for g in (copy.copy(f), copy.deepcopy(f), pickle.loads(pickle.dumps(f))):
        np.testing.assert_array_equal(g.x, f.x)
    assert isinstance(SwitchingKalmanFilter.R, Unassignable)


@pytest.mark.parametrize(
    ("made", "name"),
    [
        *((lambda: SwitchingKalmanFilter(model()), name) for name in ("model", "method", "n_nodes", "rule")),
        (lambda: KnownSwitchFilter(model()), "model"),
    ],
)
def test_a_filter_keeps_what_it_was_made_with(made, name) -> None:
    # another method or model would be written to a file, and not be used
    f = made()
    before = getattr(f, name)
    with pytest.raises(AttributeError, match=rf"^{name}: a \w+ keeps what it was made with"):
        setattr(f, name, "gpb2")
    assert getattr(f, name) is before
    assert getattr(pickle.loads(pickle.dumps(f)), name) is not None
    assert not hasattr(type(f).__new__(type(f)), name)
