"""Laws in words: which classes fade into which, and what is wrong with the words."""

from __future__ import annotations

from math import sqrt

import pytest

from fuzzykf import FadeLaw, FuzzyMarkovLaw
from fuzzykf.cli.law import law_of_words, notes_of_fades
from fuzzykf.errors import ParameterError


def words(name=None, *, fades=None, jumps=None, edges=None, stay=None, length=None):
    return law_of_words(name, fades, jumps, edges, stay, length)


def test_fades_and_jumps_share_out_how_often_a_class_is_left():
    law = words(fades="0-1, 1-0 ,1-2,2-0", jumps="0-2", stay=20.0, length=8.0)
    assert law.fades == {(0, 1): (0.025, 8), (1, 0): (0.025, 8), (1, 2): (0.025, 8), (2, 0): (0.05, 8)}
    assert law.jumps == {(0, 2): 0.025}
    assert law.mean_dwell().tolist() == pytest.approx([20.0, 20.0, 20.0])


def test_edges_are_a_graph():
    law = words("graph", edges="0-1,2-1", jumps="0-2")
    assert law.edges == ((0, 1), (2, 1))
    assert law.corners[0, 2] > 0.0
    assert law.class_masses == pytest.approx([2 / 8, 2 / 8, 2 / 8])


def test_names_stay_names():
    assert words() == "fmc1"
    assert words("free") == "free"
    assert words("fade") == "fade"


def test_durations_of_two_classes():
    law = words("fade", stay=80.0)
    assert law.mean_dwell().tolist() == pytest.approx([80.0, 80.0])
    assert law.fades[0, 1][1] == 10.0
    usual = FadeLaw.by_name(5)
    assert words("fade", stay=40.0, length=10.0).to_dict() == usual.to_dict()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fades": "0>1"}, r"--fades: got '0>1', expected pairs of classes such as 0-1,1-2,2-0"),
        ({"fades": "0-1,,1-0"}, r"--fades: got '', expected pairs"),
        ({"fades": "0-1,0-1"}, r"--fades: got '0-1' twice"),
        ({"fades": "0-1,1-3,3-0"}, r"none of them leads to or from class 2; expected the classes 0 to 3"),
        ({"fades": "1-1"}, r"--fades: got '1-1', expected two different classes"),
        ({"edges": "0-1,1-0"}, r"--edges: got '1-0' twice, expected each pair once"),
        ({"fades": "0-1,1-0", "stay": float("inf")}, r"--stay: got inf, expected a finite number of steps"),
        (
            {"fades": "0-1,1-0", "stay": 0.5},
            r"--stay: got 0.5, expected a finite number of steps, at least 1",
        ),
        ({"fades": "0-1,1-0", "length": float("nan")}, r"--length: got nan, expected a finite number"),
        ({"fades": "0-1,1-0", "edges": "0-1"}, r"--edges, --fades: got both, expected one of them"),
        ({"stay": 30.0}, r"--stay: got 30, but no fades; it goes with --fades or --law fade"),
        ({"name": "fmc1", "length": 3.0}, r"--length: got 3, but no fades"),
        ({"edges": "0-1", "length": 3.0}, r"--length: got 3, but no fades"),
        ({"name": "fade", "stay": 0.0}, r"--stay: got 0, expected a finite number of steps"),
        ({"jumps": "0-1"}, r"--jumps: got some without --fades or --edges"),
        ({"name": "fmc2", "fades": "0-1,1-0"}, r"--fades: are of the law fade, got --law fmc2"),
        ({"name": "fade", "edges": "0-1"}, r"--edges: are of the law graph, got --law fade"),
    ],
)
def test_words_that_are_no_law(options, message):
    with pytest.raises(ParameterError, match=message):
        words(**options)


def test_fades_of_few_cells_are_told_with_how_their_length_varies():
    """Oracle: F geometric times of rate F/T, each of variance (1 - p)/p^2."""
    law = FadeLaw(2, {(0, 1): (0.02, 9), (1, 0): (0.05, 32)}, jumps={(0, 1): 0.01})
    (note,) = notes_of_fades(law, 5)
    before, after = (100.0 * sqrt((1.0 - F / 32) / F) for F in (5, 9))  # the other fade has room for 9
    assert note == (
        "a fade takes 32 steps on average and has 5 cells: its length varies by "
        f"{before:.0f} %; --nodes 9 makes that {after:.0f} %"
    )
    (note,) = notes_of_fades(law, 9)
    assert note.endswith(f"has 9 cells: its length varies by {after:.0f} %")  # no more is possible
    assert notes_of_fades(FadeLaw.between(60, 15), 5) == []  # three steps for each cell
    assert notes_of_fades(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), 5) == []
    assert notes_of_fades(law, 0) == []
