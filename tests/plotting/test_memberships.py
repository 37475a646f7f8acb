"""The pictures of memberships and fuzzy estimators show the numbers they should."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_hex

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.plotting import BLUE, plot_estimate, plot_membership


@pytest.fixture(autouse=True)
def without_screen():
    mpl.use("Agg")
    yield
    from matplotlib import pyplot

    pyplot.close("all")


def rocket_like(points=41):
    """A state of two components on a grid, its first known exactly at the start."""
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: np.stack([x[..., 0] + x[..., 1], 0.9 * x[..., 1]], axis=-1),
        hx=lambda x: x[..., :1],
        state=SingletonMembership([0.0, 1.0]),
        process_noise=[None, TriangularMembership(-1.0, 0.0, 1.0)],
        measurement_noise=CauchyMembership(0.0, 0.5),
        points=points,
    )
    est.predict()
    return est


def test_a_curve_shows_the_membership_above_a_band():
    membership = GaussianMembership(2.0, 4.0)
    axes = membership.plot(level=0.1, label="altitude", unit="m")
    (curve,) = axes.get_lines()
    np.testing.assert_allclose(curve.get_ydata(), membership(curve.get_xdata()))
    half = 2.0 * np.sqrt(2.0 * np.log(10.0))  # where it falls to 0.1
    assert curve.get_xdata()[0] == pytest.approx(2.0 - 1.1 * half)
    assert curve.get_xdata()[-1] == pytest.approx(2.0 + 1.1 * half)
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (0.0, 1.0)
    assert to_hex(curve.get_color()).upper() == BLUE
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("altitude (m)", "membership")


def test_jumps_are_upright():
    (curve,) = IntervalMembership(-1.0, 2.0).plot().get_lines()
    x, value = curve.get_xdata(), curve.get_ydata()
    np.testing.assert_array_equal(value, (x >= -1.0) & (x <= 2.0))
    rise = int(np.argmax(value))
    assert x[rise] - x[rise - 1] < 1e-15


def test_a_map_shows_the_membership_at_the_nodes():
    membership = GaussianMembership([0.0, 1.0], [[1.0, 0.5], [0.5, 2.0]])
    axes = membership.plot(label=["position", "velocity"], unit=["m", "m/s"])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("position (m)", "velocity (m/s)")
    mesh = axes.collections[0]
    corners = mesh.get_coordinates()
    centers = 0.5 * (corners[1:, 1:] + corners[:-1, :-1])
    np.testing.assert_allclose(np.asarray(mesh.get_array()), membership(centers), atol=1e-12)
    assert mesh.get_clim() == (0.0, 1.0)
    # the lightness rises with the membership, so that a print in grey can be read
    shades = mesh.get_cmap()(np.linspace(0.0, 1.0, 21))[:, :3] @ [0.299, 0.587, 0.114]
    assert (np.diff(shades) > 0.0).all()
    assert axes.figure.axes[1].get_ylabel().startswith("membership")


def test_a_grid_is_drawn_as_it_is():
    est = rocket_like()
    est.predict()
    est.update(1.5)
    axes = est.plot(level=1e-6)
    values = np.asarray(axes.collections[0].get_array())
    np.testing.assert_allclose(values, est.membership.values.T, atol=1e-12)


def test_an_estimator_marks_estimate_and_truth():
    est = FuzzyRelationEstimator(1, 1)
    est.x = [[0.7]]
    axes = est.plot(truth=0.2, unit="m")
    marks = {line.get_label(): line for line in axes.get_lines()}
    np.testing.assert_array_equal(marks["estimate"].get_xdata(), [0.7, 0.7])
    np.testing.assert_array_equal(marks["true"].get_xdata(), [0.2, 0.2])
    assert {marks[name].get_linestyle() for name in ("estimate", "true")} == {"--", ":"}
    assert axes.get_xlabel() == "state (m)"
    plane = rocket_like()
    axes = plot_estimate(plane, truth=[1.0, 0.4])
    marks = {line.get_label(): line for line in axes.get_lines()}
    np.testing.assert_array_equal(marks["estimate"].get_xydata()[0], plane.x.ravel())
    np.testing.assert_array_equal(marks["true"].get_xydata()[0], [1.0, 0.4])
    assert {marks[name].get_marker() for name in ("estimate", "true")} == {"o", "x"}
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$x_1$", "$x_2$")


def test_what_is_known_exactly_is_a_thin_strip():
    est = rocket_like()
    assert est.membership.values.shape == (1, 41)
    mesh = est.plot().collections[0]
    corners = mesh.get_coordinates()
    assert corners[0, 1, 0] - corners[0, 0, 0] == pytest.approx(0.02 * 2.0)  # of the velocities
    np.testing.assert_allclose(np.asarray(mesh.get_array())[:, 0], est.membership.values[0], atol=1e-12)
    # and points can be drawn, too
    SingletonMembership([0.0, 0.0]).plot()
    SingletonMembership(0.0).plot()


@pytest.mark.parametrize("representation", ["gaussian", "interval", "grid"])
def test_every_representation_is_drawn_into_given_axes(representation):
    from matplotlib import pyplot

    shape = {"gaussian": GaussianMembership, "interval": IntervalMembership}.get(representation)
    noise = TriangularMembership(-1.0, 0.0, 1.0) if shape is None else shape(0.0, 1.0)
    est = FuzzyRelationEstimator(1, 1, state=noise, process_noise=noise, measurement_noise=noise)
    est.H = np.eye(1)
    assert est.representation == representation
    _, axes = pyplot.subplots()
    est.step(0.3)
    assert est.plot(axes) is axes
    axes.figure.savefig("/dev/null", format="png")


def test_of_three_components_the_first_two_are_drawn_or_those_asked_for():
    est = FuzzyRelationEstimator(3, 1)
    est.P = np.diag([1.0, 4.0, 9.0])
    axes = est.plot()
    assert axes.get_ylabel() == "$x_2$"
    axes = est.plot(components=[0, 2])
    assert axes.get_ylabel() == "$x_3$"
    low, high = axes.get_ylim()
    assert high == pytest.approx(-low)
    assert high == pytest.approx(1.1 * 3.0 * np.sqrt(2.0 * np.log(100.0)), rel=0.01)
    (line,) = (c for c in est.plot(components=[1]).get_lines() if c.get_label() != "estimate")
    np.testing.assert_allclose(line.get_ydata(), np.exp(-(line.get_xdata() ** 2) / 8.0))


def test_a_series_of_intervals_is_drawn_with_its_bounds():
    box = IntervalMembership(-1.0, 1.0)
    est = FuzzyRelationEstimator(1, 1, state=box, process_noise=box, measurement_noise=box)
    est.H = np.eye(1)
    result = est.filter([0.5, None, 0.8, 1.0])
    band = result.plot().collections[0]
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == (result.lower.min(), result.upper.max())
    assert band.get_label() == "possible"
    # memberships of unbounded support have no such bounds
    assert (
        FuzzyRelationEstimator(1, 1, H=1.0).filter([0.5, 1.0]).plot().collections[0].get_label()
        == "90 % band"
    )


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({}, ParameterError, "components: got none for a membership of 3 dimensions"),
        ({"components": [2, 0]}, ParameterError, r"components: got \[2, 0\], expected .* 0 to 2"),
        ({"components": [0, 3]}, ParameterError, "components: got"),
        ({"components": []}, ParameterError, "components: got"),
        ({"components": [0], "level": 0.0}, ParameterError, "level: got 0.0"),
        ({"components": [0], "truth": [1.0]}, ShapeError, "truth: got shape"),
        (
            {"components": [0], "truth": np.ma.array([1.0, 9.0, 2.0], mask=[0, 1, 0])},
            ParameterError,
            "truth: entry .1,. is nan",
        ),
        ({"components": [0, 1], "label": "x"}, ShapeError, "label: got"),
        ({"components": [0], "unit": ["m", "m/s"]}, ShapeError, "unit: got"),
    ],
)
def test_inadmissible_options_are_named(options, error, message):
    with pytest.raises(error, match=message):
        plot_membership(GaussianMembership(np.zeros(3), np.eye(3)), **options)
