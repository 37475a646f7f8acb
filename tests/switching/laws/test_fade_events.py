"""What happens along a known switch: counted by hand, and against chains that were sampled."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.fade_events import count_events

RING = FadeLaw(3, {(0, 1): (0.05, 10), (1, 2): (0.07, 8), (2, 0): (0.04, 12)}, jumps={(0, 2): 0.01})


def weights(r):
    return np.stack([1.0 - np.asarray(r), r], axis=1)


def test_counted_by_hand():
    # two steps at 0, a fade of three steps, two at 1 (the second the last but one row of a jump), 0
    events = count_events([weights([0.0, 0.0, 0.2, 0.2, 0.8, 1.0, 1.0, 0.0])], 2)
    np.testing.assert_array_equal(events.visits, [2.0, 2.0])
    assert events.begun == {(0, 1): 1.0}
    assert events.steps == {(0, 1): 3.0}
    assert events.way == {(0, 1): pytest.approx(1.0)}
    assert events.jumped == {(1, 0): 1.0}
    assert events.turned == 0


def test_turning_back_by_hand():
    events = count_events([weights([0.0, 0.5, 0.75, 0.75, 0.25, 0.0])], 2)
    assert events.begun == {(0, 1): 1.0}
    assert events.turned == 1
    assert events.steps == {(0, 1): 2.0, (1, 0): 2.0}  # standing still at .75 goes on
    assert events.way == {(0, 1): pytest.approx(0.75), (1, 0): pytest.approx(0.75)}


def test_paths_that_begin_and_end_between_classes():
    events = count_events([weights([0.5, 0.5, 0.7]), weights([0.3]), weights([0.4, 0.4])], 2)
    assert events.begun == {}
    assert events.steps == {(0, 1): 2.0}  # the last row is no step; what does not move tells nothing
    assert events.way == {(0, 1): pytest.approx(0.2)}


@pytest.mark.parametrize(
    "law",
    [RING, FadeLaw.between(30, 10, jump=0.01, turn_back=0.05), FadeLaw.between(25, 5)],
    ids=["ring", "turning", "deterministic"],
)
def test_the_likeliest_law_of_a_sampled_path_is_near_the_law(law):
    path = law.sample(40_000, np.random.default_rng(0), n_nodes=5)
    path = weights(path) if path.ndim == 1 else path
    found = law.likeliest([path[:15_000], path[15_000:]], 5)
    for pair, (rate, length) in law.fades.items():
        n = 40_000 / sum(1 / r + t for r, t in law.fades.values())  # about how often each is begun
        assert found.fades[pair][0] == pytest.approx(rate, rel=4 / np.sqrt(n)), pair
        assert found.fades[pair][1] == pytest.approx(length, rel=2 / np.sqrt(n)), pair
    for pair, p in law.jumps.items():
        assert found.jumps[pair] == pytest.approx(p, rel=0.4)
    assert found.turn_back == pytest.approx(law.turn_back, abs=0.01)


def test_ramps_that_are_no_chain_have_their_length():
    # 12 steps from 0 to 1, evenly: 11 of them between
    ramp = np.linspace(0.0, 1.0, 13)
    r = np.concatenate([np.zeros(30), ramp, np.ones(20), ramp[::-1], np.zeros(10)])
    found = FadeLaw.between(5, 5).likeliest([weights(r)], 5)
    assert found.fades[0, 1] == (pytest.approx(1 / 41), pytest.approx(11.0))  # 42 rows at 0, one the last
    assert found.fades[1, 0] == (pytest.approx(1 / 22), pytest.approx(11.0))


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([[0.2, 0.3, 0.5]], r"r: got \(0.2, 0.3, 0.5\), between 3 classes"),
        ([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5]], "in a step, past a class"),
        ([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]], "in a step, past a class"),
        (
            [[0.0, 1.0, 0.0], [0.3, 0.7, 0.0], [1.0, 0.0, 0.0]],
            r"r: fades from class 1 to 0, expected the fades",
        ),
        ([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]], r"r: jumps from class 1 to 0, expected .* alone: \(0, 2\)"),
        ([[1.0, 0.0, 0.0], [0.3, 0.7, 0.0], [0.5, 0.5, 0.0]], "r: fades from class 1 to 0"),
    ],
)
def test_paths_that_the_law_does_not_have(path, message):
    with pytest.raises(ParameterError, match=message):
        RING.likeliest([np.array(path)], 5)


def test_a_fade_that_turns_back_although_it_cannot():
    with pytest.raises(ParameterError, match="r: turns back in a fade 1 time, which turn_back = 0"):
        FadeLaw.between(20, 10).likeliest([weights([0.0, 0.5, 0.25, 0.0])], 5)


def test_what_never_happens_stays_possible():
    # a step of each class, and none of them leaves: as likely as in one more step of the law before
    found = FadeLaw.between(20, 10).likeliest([weights([0.0, 0.0]), weights([1.0, 1.0])], 5)
    assert found.fades == {(0, 1): (pytest.approx(0.05 / 2), 10.0), (1, 0): (pytest.approx(0.05 / 2), 10.0)}


def test_fades_that_are_cut_off_keep_their_length():
    # on cells a fade of 5 steps, of which the third is the last row: 2 steps for 2 of 5 parts of the way
    found = FadeLaw.between(20, 10).likeliest([weights([0.0, 0.1, 0.3, 0.5])], 5)
    assert found.fades[0, 1] == (1.0, pytest.approx(5.0))


def test_paths_that_make_no_law_say_so():
    zigzag = weights([0.0, *[0.3, 0.7] * 20, 1.0])
    with pytest.raises(
        ParameterError, match=r"r: does what makes no law of these fades; turn_back: got 0\.9"
    ):
        FadeLaw.between(20, 10, turn_back=0.1).likeliest([zigzag], 5)


def test_classes_that_were_never_visited_keep_their_numbers():
    found = RING.likeliest([np.eye(3)[[0, 0, 0, 0]]], 5)
    assert found.fades == {(0, 1): (0.05 / 4, 10), (1, 2): (0.07, 8), (2, 0): (0.04, 12)}
    assert found.jumps == {(0, 2): 0.01 / 4}
