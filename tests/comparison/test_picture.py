"""Pictures show the numbers they should, are labelled with units, and do without colour."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest
from matplotlib.colors import to_hex

from fuzzykf.comparison import Restoration, Task, plot_comparison, score
from fuzzykf.errors import MissingDependencyError, ParameterError
from fuzzykf.plotting import BLUE, ORANGE, TRUTH

N_TRAIN, N_TEST = 100, 700


def comparison(step: str | None):
    rng = np.random.default_rng(0)
    n = N_TRAIN + N_TEST
    unit = np.timedelta64(1, step) if step else None
    task = Task(
        state=rng.normal(size=n),
        observation=rng.normal(size=n),
        switch=rng.random(n),
        n_train=N_TRAIN,
        time=None if unit is None else np.datetime64("2014-01-01T00:00", "s") + np.arange(n) * unit,
        switch_source="",
    )
    truth = task.state[N_TRAIN:]
    std = np.full(N_TEST, 0.5)
    restorations = (
        Restoration(
            name="OFSRFilter", mean=truth + 0.3, std=std, microseconds=1, switch=np.full(N_TEST, 0.2)
        ),
        Restoration(
            name="CGOMSMFilter", mean=truth + 0.2, std=std, microseconds=1, switch=np.full(N_TEST, 0.8)
        ),
        Restoration(name="linear regression", mean=truth + 0.1, std=std, microseconds=1),
    )
    return score(task, restorations, rng, n_resamples=100)


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_the_excerpt_shows_truth_estimate_rival_and_band() -> None:
    found = comparison("h")
    figure = plot_comparison(found, state_label="demand", unit="GW", steps=200)
    whole, state, switch = figure.axes
    excerpt = slice(250, 450)  # 200 steps from the middle of 700
    truth = found.task.state[N_TRAIN:]
    np.testing.assert_array_equal(lines(whole)["measured"].get_ydata(), truth)
    np.testing.assert_array_equal(lines(state)["measured"].get_ydata(), truth[excerpt])
    # the two of least error, and the band of the best
    np.testing.assert_array_equal(lines(state)["linear regression"].get_ydata(), truth[excerpt] + 0.1)
    np.testing.assert_array_equal(lines(state)["CGOMSMFilter"].get_ydata(), truth[excerpt] + 0.2)
    assert "OFSRFilter" not in lines(state)
    (band,) = state.collections
    upper = band.get_paths()[0].vertices[:, 1].max()
    assert upper == pytest.approx(truth[excerpt].max() + 0.1 + 1.6448536 * 0.5)
    for name, value in {"CGOMSMFilter": 0.8, "OFSRFilter": 0.2}.items():
        shown = lines(switch)[f"{name},\nposterior mean"]
        np.testing.assert_array_equal(shown.get_ydata(), np.full(200, value))
    assert state.get_ylabel() == "demand (GW)"
    assert (switch.get_ylabel(), switch.get_xlabel()) == ("switch", "time")


def test_the_switches_drawn_are_those_of_the_two_best_that_have_one() -> None:
    found = comparison("h")
    third = Restoration(
        name="a third",
        mean=found.truth + 0.4,
        std=np.full(N_TEST, 0.5),
        microseconds=1,
        switch=np.ones(N_TEST),
    )
    more = score(found.task, (third, *found.restorations), np.random.default_rng(0), n_resamples=100)
    *_, switch = plot_comparison(more).axes
    styles = {(line.get_color(), line.get_linestyle()) for line in switch.get_lines()}
    assert len(styles) == len(switch.get_lines()) == 3  # with the rule of the learning part
    assert not any("third" in label for label in lines(switch))


def test_lines_differ_in_dashes_as_well_as_in_colour() -> None:
    for axes in plot_comparison(comparison(None)).axes:
        (main,) = (line for line in axes.get_lines() if to_hex(line.get_color()).upper() == BLUE)
        (rival,) = (line for line in axes.get_lines() if to_hex(line.get_color()).upper() == ORANGE)
        (true,) = (line for line in axes.get_lines() if to_hex(line.get_color()).upper() == TRUTH)
        assert not main.is_dashed()
        assert rival.is_dashed()
        assert true.get_linewidth() < main.get_linewidth()


@pytest.mark.parametrize("step", [None, "s", "m", "h", "D"])
def test_every_resolution_of_time_can_be_drawn(step) -> None:
    # Warnings are errors here: labels that overlap or cannot be placed would show.
    file = io.BytesIO()
    plot_comparison(comparison(step)).savefig(file, format="png")
    assert file.getvalue().startswith(b"\x89PNG")


def test_drawing_leaves_pyplot_alone() -> None:
    import matplotlib.pyplot as plt

    before = plt.get_fignums()
    plot_comparison(comparison("h"))
    assert plt.get_fignums() == before


def test_bad_steps_and_a_missing_package_are_named(monkeypatch) -> None:
    with pytest.raises(ParameterError, match="steps: got 1, expected at least 2"):
        plot_comparison(comparison("h"), steps=1)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'fuzzykf\[cli\]'"):
        plot_comparison(comparison("h"))
