"""The pictures of results, laws and models show the numbers they should."""

from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt

from fuzzykf import (
    CGOFMSModel,
    CGOMSModel,
    FadeLaw,
    FilterResult,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
)
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.plotting import plot_law, plot_model, plot_result


@pytest.fixture(autouse=True)
def without_screen():
    mpl.use("Agg")
    yield
    from matplotlib import pyplot

    pyplot.close("all")


@pytest.fixture
def model():
    z = np.array([[1.0, 0.5], [0.5, 2.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    return CGOFMSModel(
        FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
        [[0.0, 3.0], [1.0, 0.0]],
        np.broadcast_to(pair, (2, 2, 4, 4)),
        1,
    )


def curve(axes, label):
    return next(line for line in axes.get_lines() if line.get_label() == label)


def test_a_result_draws_estimate_band_truth_and_switch(model):
    truth = model.simulate(60, np.random.default_rng(0))
    result = OFSRFilter(model).filter(truth.y)
    axes = result.plot(truth=truth.x, level=0.8, label="speed", unit="m/s")
    np.testing.assert_array_equal(curve(axes, "estimate").get_ydata(), result.x[:, 0])
    np.testing.assert_array_equal(curve(axes, "true").get_ydata(), truth.x[:, 0])
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    lower, upper = result.interval(0.8)
    assert band.min() == pytest.approx(lower.min())
    assert band.max() == pytest.approx(upper.max())
    np.testing.assert_array_equal(axes.get_images()[0].get_array()[0], result.switch_mean)
    assert axes.get_ylabel() == "speed (m/s)"


def test_the_strip_lies_below_everything_that_is_drawn(model):
    result = OFSRFilter(model).filter(model.simulate(60, np.random.default_rng(0)).y)
    axes = plot_result(result)
    strip_top = axes.get_images()[0].get_extent()[3]
    assert strip_top < result.interval(0.9)[0].min()


def ring(K):
    """A fuzzy model of K classes, each of which fades into the next."""
    law = FadeLaw(K, {(k, (k + 1) % K): (0.1, 6) for k in range(K)})
    z = np.array([[1.0, 0.5], [0.5, 2.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    means = np.outer(np.arange(K), [2.0, 1.0])
    return CGOFMSModel(law, means, np.broadcast_to(pair, (K, K, 4, 4)), 1)


@pytest.mark.parametrize("K", [3, 5, 30])
@pytest.mark.parametrize("known", [False, True])
def test_weights_of_several_classes_are_areas_that_fill_a_strip(K, known):
    model = ring(K)
    truth = model.simulate(15, np.random.default_rng(0))
    result = (
        KnownSwitchFilter(model).filter(truth.y, truth.r) if known else OFSRFilter(model, 2).smooth(truth.y)
    )
    axes = plot_result(result)
    assert not axes.get_images()
    areas = [area.get_paths()[0].vertices for area in axes.collections[1 : K + 1]]  # after the band
    foot = axes.get_ylim()[0]
    top = max(area[:, 1].max() for area in areas)
    assert top < result.interval(0.9)[0].min()
    previous = np.zeros(15)
    for k, area in enumerate(areas):
        steps, height = area[:, 0], (area[:, 1] - foot) / (top - foot)
        upper = np.array([height[steps == n].max() for n in range(15)])
        np.testing.assert_allclose(upper - previous, result.class_weights[:, k], atol=1e-9)
        previous = upper
    np.testing.assert_allclose(previous, 1.0)
    shades = [tuple(area.get_facecolor()[0]) for area in axes.collections[1 : K + 1]]
    assert len(set(shades)) == K
    assert [shade[0] for shade in shades] == sorted((shade[0] for shade in shades), reverse=True)
    bar = axes.figure.axes[1]
    assert bar.get_ylabel() == "class (areas at the foot)"
    numbers = [round(tick) for tick in bar.get_yticks() if -0.5 < tick < K - 0.5]
    assert numbers == list(range(0, K, 1 if K < 13 else 3))


def test_areas_are_drawn_against_times():
    pd = pytest.importorskip("pandas")
    model = ring(3)
    index = pd.date_range("2026-01-01", periods=30, freq="h", name="time")
    series = pd.Series(model.simulate(30, np.random.default_rng(0)).y[:, 0], index=index)
    axes = OFSRFilter(model, 2).filter(series).plot()
    assert axes.get_xlabel() == "time"
    steps = axes.collections[1].get_paths()[0].vertices[:, 0]
    assert np.ptp(steps) * 24.0 == pytest.approx(29.0)


def test_a_model_of_several_classes_is_drawn_class_by_class():
    axes = plot_model(ring(4))
    assert axes.get_xlabel() == "class"
    assert [round(tick) for tick in axes.get_xticks()] == [0, 1, 2, 3]
    means = [bars.lines[0].get_ydata() for bars in axes.containers]
    np.testing.assert_array_equal(means, [[0, 2, 4, 6], [0, 1, 2, 3]])
    for bars, variance in zip(axes.containers, (1.0, 2.0), strict=True):
        ends = np.array([part[:, 1] for part in bars.lines[2][0].get_segments()])
        np.testing.assert_allclose(np.ptp(ends, axis=1), 4.0 * np.sqrt(variance))
    assert plot_model(ring(4).harden()).get_xlabel() == "regime"


def test_a_result_is_drawn_into_given_axes_against_its_index(model):
    pd = pytest.importorskip("pandas")
    from matplotlib import pyplot

    index = pd.date_range("2026-01-01", periods=30, freq="h", name="time")
    series = pd.Series(model.simulate(30, np.random.default_rng(0)).y[:, 0], index=index)
    _, axes = pyplot.subplots()
    assert OFSRFilter(model).filter(series).plot(axes) is axes
    assert axes.get_xlabel() == "time"
    left, right = axes.get_images()[0].get_extent()[:2]
    assert (right - left) * 24.0 == pytest.approx(29.0)  # days of the axis of dates


def labels_of(axes):
    """Where the labels of the axis of time are, from left to right, and what they say."""
    axes.figure.canvas.draw()
    found = [(label.get_window_extent(), label.get_text()) for label in axes.get_xticklabels()]
    return sorted(((box.x0, box.x1, text) for box, text in found if text), key=lambda one: one[0])


#: Indexes of times in all their forms; the name of the axis.
HOURS = {"start": "2014-12-28 10:00", "periods": 336, "freq": "h"}
INDEXES = {
    "hours": (lambda pd: pd.date_range(**HOURS), "time"),
    "hours in a zone": (lambda pd: pd.date_range(**HOURS, tz="Europe/Berlin", name="t"), "t (UTC)"),
    "seconds": (lambda pd: pd.date_range("2014-12-28 23:59", periods=100, freq="s"), "time"),
    "quarters of an hour": (lambda pd: pd.date_range("2014-12-28", periods=100, freq="15min"), "time"),
    "days": (lambda pd: pd.date_range("2014-12-28", periods=100, freq="D"), "time"),
    "years": (lambda pd: pd.date_range("1914", periods=100, freq="YS"), "time"),
    "months as periods": (lambda pd: pd.period_range("2014-12", periods=30, freq="M"), "time"),
    "objects: dates": (lambda pd: pd.Index(pd.date_range(**HOURS).date[::24], dtype=object), "time"),
    "a list": (lambda pd: pd.date_range(**HOURS).to_pydatetime().tolist(), "time"),
    "hours passed": (lambda pd: pd.to_timedelta(np.arange(100), unit="h"), "time (days)"),
    "seconds passed": (lambda pd: pd.to_timedelta(np.arange(100), unit="s"), "time (s)"),
    "numbers": (lambda pd: pd.RangeIndex(100, name="row"), "row"),
}


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize("kind", INDEXES)
@pytest.mark.parametrize("width", [3.5, 6.0, 10.0])
def test_labels_of_the_axis_of_time_do_not_overlap(kind, width):
    from matplotlib import pyplot

    make, name = INDEXES[kind]
    index = make(pytest.importorskip("pandas"))
    n = len(index)
    result = FilterResult(x=np.zeros((n, 1)), P=np.ones((n, 1, 1)), index=index)
    axes = result.plot(pyplot.subplots(figsize=(width, 3.0))[1])
    labels = labels_of(axes)
    assert len(labels) >= 2
    assert all(left[1] < right[0] for left, right in pairwise(labels))
    assert axes.get_xlabel() == name


def test_labels_that_were_chosen_for_given_axes_stay():
    from matplotlib import dates, pyplot

    index = pytest.importorskip("pandas").date_range("2026-01-01", periods=30, freq="D")
    result = FilterResult(x=np.zeros((30, 1)), P=np.ones((30, 1, 1)), index=index)
    _, axes = pyplot.subplots()
    chosen = dates.DateFormatter("%d. %m.")
    axes.xaxis.set_major_formatter(chosen)
    result.plot(axes)
    assert axes.xaxis.get_major_formatter() is chosen


@pytest.mark.parametrize(
    "truth",
    [
        np.ma.array([0.0, -999.0, 2.0], mask=[0, 1, 0]),
        np.ma.array([[0.0], [-999.0], [2.0]], mask=[[0], [1], [0]]),
        [0.0, None, 2.0],
        [0.0, np.nan, 2.0],
    ],
    ids=["masked", "masked column", "None", "NaN"],
)
def test_a_truth_that_is_missing_is_not_drawn(truth):
    axes = FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1))).plot(truth=truth)
    np.testing.assert_array_equal(np.ma.filled(curve(axes, "true").get_ydata(), np.nan), [0.0, np.nan, 2.0])
    assert axes.get_ylim()[0] > -900.0


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"component": 1}, ParameterError, "component: got 1"),
        ({"level": 1.5}, ParameterError, "level: got 1.5"),
        ({"truth": [1.0, 2.0]}, ShapeError, "truth: got shape"),
        ({"truth": "high"}, ShapeError, "truth: expected an array of numbers, got 'high'"),
    ],
)
def test_inadmissible_options_are_named(options, error, message):
    result = FilterResult(x=np.zeros((5, 1)), P=np.ones((5, 1, 1)))
    with pytest.raises(error, match=message):
        result.plot(**options)


def test_many_series_are_refused():
    with pytest.raises(ParameterError, match="many series"):
        FilterResult(x=np.zeros((3, 5, 1)), P=np.ones((3, 5, 1, 1))).plot()


def test_a_law_is_drawn_with_its_masses_and_densities(monkeypatch):
    from matplotlib import pyplot
    from mpl_toolkits.mplot3d import Axes3D

    bars = []
    draw = Axes3D.bar3d
    monkeypatch.setattr(Axes3D, "bar3d", lambda self, *a, **k: (bars.append(a), draw(self, *a, **k))[1])
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    axes = law.plot()
    assert "FMC2" in axes.get_title()
    assert "gamma = 0.6" in axes.get_title()
    x, y, heights = bars[0][0], bars[0][1], bars[0][5]
    at_corner = (x == x.min()) & (y == y.min())
    assert heights[at_corner] == pytest.approx([0.15])
    assert set(np.round(heights, 6)) == {0.0, 0.002, 0.15, 0.6}
    with pytest.raises(ParameterError, match="3-D"):
        plot_law(law, pyplot.subplots()[1])
    given = pyplot.figure().add_subplot(projection="3d")
    assert law.plot(given) is given
    assert given.get_title() == axes.get_title()


def test_a_fuzzy_and_a_hard_model_are_drawn_with_their_moments(model):
    axes = model.plot()
    np.testing.assert_allclose(curve(axes, "state").get_ydata()[[0, -1]], [0.0, 1.0])
    np.testing.assert_allclose(curve(axes, "observation").get_ydata()[[0, -1]], [3.0, 0.0])
    hard = plot_model(model.harden())
    assert [label.get_text() for label in hard.get_xticklabels()] == ["0", "1"]
    matrices = {"A": [[[0.9]], [[0.5]]], "B": [[[1.0]]] * 2, "C": [[[1.0]]] * 2, "D": [[[0.5]]] * 2}
    converted = CGOMSModel.from_cglssm([[0.9, 0.1], [0.2, 0.8]], **matrices)
    assert [label.get_text() for label in converted.plot().get_xticklabels()] == ["0", "1"]
    with pytest.raises(ParameterError, match="component: got 1"):
        model.plot(component=1)


# ------------------------------------------------------------------ a truth that has an index

DAYS = pd.date_range("2014-01-01", periods=6, freq="D")
WHOLE = pd.Series(np.arange(6.0), DAYS)

#: The index of a result of days 1 to 3 (the first is 0), a truth that goes with it, and what is drawn.
GOES = {
    "the same index": (DAYS[1:4], WHOLE[1:4], [1.0, 2.0, 3.0]),
    "more rows": (DAYS[1:4], WHOLE, [1.0, 2.0, 3.0]),
    "more rows, in another order": (DAYS[1:4], WHOLE[::-1], [1.0, 2.0, 3.0]),
    "more rows and columns": (DAYS[1:4], WHOLE.to_frame(), [1.0, 2.0, 3.0]),
    "more rows of a DataArray": (
        DAYS[1:4],
        xr.DataArray(np.arange(6.0), coords={"time": DAYS}, dims="time"),
        [1.0, 2.0, 3.0],
    ),
    "another unit of time": (DAYS[1:4], WHOLE[1:4].set_axis(DAYS[1:4].as_unit("s")), [1.0, 2.0, 3.0]),
    "an array": (DAYS[1:4], np.array([7.0, 8.0, 9.0]), [7.0, 8.0, 9.0]),
    "a series beside an array": (None, WHOLE[:3], [0.0, 1.0, 2.0]),
    "a name twice": (pd.Index([1, 1, 2]), pd.Series([4.0, 5.0, 6.0], [1, 1, 2]), [4.0, 5.0, 6.0]),
}


@pytest.mark.parametrize("case", GOES)
def test_a_truth_goes_by_its_index_with_the_result(case):
    index, truth, expected = GOES[case]
    result = FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1)), index=index)
    np.testing.assert_array_equal(curve(plot_result(result, truth=truth), "true").get_ydata(), expected)


#: A truth that does not go with a result of days 1 to 3.
STRAY = {
    "other days": WHOLE[2:5],
    "another order": WHOLE[1:4][::-1],
    "more rows, but not all": WHOLE.drop(DAYS[2]),
    "fewer rows": WHOLE[1:3],
    "no times": WHOLE[1:4].reset_index(drop=True),
    "another zone": WHOLE[1:4].tz_localize("UTC"),
    "one of its rows twice": pd.concat([WHOLE, WHOLE[1:2]]),
}


@pytest.mark.parametrize("case", STRAY)
def test_a_truth_of_another_index_is_refused_with_both_ends(case):
    result = FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1)), index=DAYS[1:4])
    message = "result, truth: .* result has 3 from 2014-01-02 .* to 2014-01-04 .* truth has .* from .* to "
    with pytest.raises(ParameterError, match=message):
        plot_result(result, truth=STRAY[case])
    assert not plt.get_fignums()


def test_an_index_of_text_that_holds_times_is_drawn_as_times():
    drawn = []
    text = pd.Index(DAYS.strftime("%Y-%m-%d"))
    for index in (DAYS, text, np.array(text, dtype=object)):
        result = FilterResult(x=np.zeros((6, 1)), P=np.ones((6, 1, 1)), index=index)
        axes = plot_result(result)
        axes.figure.canvas.draw()
        line = curve(axes, "estimate")
        drawn.append((line.get_xdata(orig=False).tolist(), [t.get_text() for t in axes.get_xticklabels()]))
    assert drawn[0] == drawn[1] == drawn[2]
