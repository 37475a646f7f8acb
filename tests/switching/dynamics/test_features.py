"""The map of the window: values against plain loops, names, knots, what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.switching.dynamics.features import WindowFeatures, carried, past_of

MAPS = [
    WindowFeatures(),
    WindowFeatures(order=3),
    WindowFeatures(blocks=(2, 1)),
    WindowFeatures(order=2, blocks=(2, 3)),
    WindowFeatures(hinges=[[-0.5, 0.5], [0.0, 2.0]]),
    WindowFeatures(products=True),
    WindowFeatures(order=2, blocks=(1, 3), hinges=[[-0.5, 0.5], [0.0, 2.0]], products=True),
]


def common_by_loops(features, past, u):
    found = list(u)
    for lag in range(2, features.order + 1):
        found += [past[lag - 1][c] for c in range(2)]
    lag = features.order
    for length in features.blocks:
        found += [sum(past[lag + j][c] for j in range(length)) / length for c in range(2)]
        lag += length
    return found


def own_by_loops(features, y, u):
    found = []
    if features.n_hinges:
        found += [max(y[c] - knot, 0.0) for c in range(2) for knot in features.knots[c]]
    if features.products:
        found += [a * b for a in u for b in y]
    return found


@pytest.mark.parametrize("features", MAPS, ids=repr)
def test_values_are_those_of_plain_loops(features):
    rng = np.random.default_rng(0)
    ys, us, lead = rng.normal(size=(6, 2)), rng.normal(size=(6, 3)), rng.normal(size=(features.n_past, 2))
    past = past_of(ys, lead, features.n_past)
    common, own = features.common(past, us), features.own(ys, us)
    whole = [*lead, *ys]
    for n in range(6):
        before = [whole[features.n_past + n - lag] for lag in range(1, features.n_past + 1)]
        np.testing.assert_allclose(common[n], common_by_loops(features, before, us[n]), rtol=1e-14)
        np.testing.assert_allclose(own[n], own_by_loops(features, ys[n], us[n]), rtol=1e-14)
        np.testing.assert_array_equal(features.common(past[n], us[n]), common[n])
        np.testing.assert_array_equal(features.own(ys[n], us[n]), own[n])
    names = features.names(["a", "b"], ["u", "v", "w"])
    assert (common.shape[1], own.shape[1]) == features.sizes(2, 3) == tuple(len(part) for part in names)


def test_names_stand_where_their_values_do():
    features = WindowFeatures(order=2, blocks=(1, 3), hinges=[[10.0], [0.25]], products=True)
    common, own = features.names(["t", "h"], ["day"])
    assert common == ["day", "t[-2]", "h[-2]", "t[-3]", "h[-3]", "t[-4..-6]", "h[-4..-6]"]
    assert own == ["t > 10", "h > 0.25", "day * t", "day * h"]
    assert WindowFeatures(hinges=2).names(["t"], [])[1] == ["t > knot 0", "t > knot 1"]


def test_nothing_before_an_empty_series():
    assert past_of(np.empty((0, 2)), np.zeros((3, 2)), 3).shape == (0, 3, 2)


def test_knots_are_learned_at_equally_spaced_quantiles():
    ys = np.column_stack([np.arange(101.0), 10.0 * np.arange(101.0)])
    features = WindowFeatures(order=2, hinges=3, products=True)
    learned = features.learned(ys)
    np.testing.assert_allclose(learned.knots, [[25.0, 50.0, 75.0], [250.0, 500.0, 750.0]])
    assert (learned.order, learned.products, features.knots) == (2, True, None)
    assert learned.learned(ys[:5]) is learned
    assert MAPS[0].learned(ys) is MAPS[0]


@pytest.mark.parametrize("features", [*MAPS, WindowFeatures(hinges=2)], ids=repr)
def test_it_comes_back_from_plain_values_and_from_pickle(features):
    for again in (WindowFeatures.from_dict(features.to_dict()), pickle.loads(pickle.dumps(features))):
        assert again.to_dict() == features.to_dict()
        assert (again.n_past, again.is_trivial) == (features.n_past, features.is_trivial)


def test_it_keeps_its_knots_whatever_becomes_of_the_array():
    knots = np.array([[0.0, 1.0]])
    features = WindowFeatures(hinges=knots)
    knots[:] = 7.0
    assert features.knots.tolist() == [[0.0, 1.0]]
    with pytest.raises(ValueError, match="read-only"):
        features.knots[0, 0] = 3.0


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"order": 0}, ParameterError, "order: got 0, expected"),
        ({"order": 1.5}, ParameterError, "order: got 1.5, expected"),
        ({"order": 1001}, ParameterError, "order: got 1,001, expected"),
        ({"blocks": (2, 0)}, ParameterError, "blocks: got 0, expected"),
        ({"blocks": 3}, ParameterError, "blocks: got 3, expected a sequence"),
        ({"blocks": "23"}, ParameterError, "blocks: got '23', expected a sequence"),
        ({"order": 900, "blocks": (101,)}, ParameterError, "look back at 1001 observations, expected"),
        ({"hinges": -1}, ParameterError, "hinges: got -1, expected"),
        ({"hinges": 21}, ParameterError, "hinges: got 21, expected"),
        (
            {"hinges": 1.5},
            ShapeError,
            r"hinges: got 1.5, expected a whole number, or knots of shape \(q, h\)",
        ),
        ({"hinges": [1.0, 2.0]}, ShapeError, r"hinges: got \[1.0, 2.0\], expected a whole number, or knots"),
        ({"hinges": [[1.0, 1.0]]}, ParameterError, "hinges: got .*, expected knots that rise"),
        ({"hinges": [[np.nan]]}, ParameterError, "hinges: .* nan, expected finite"),
        ({"products": "yes"}, ParameterError, "products: got 'yes', expected True or False"),
    ],
)
def test_what_is_no_map_is_refused(options, error, words):
    with pytest.raises(error, match=words):
        WindowFeatures(**options)


def test_knots_that_fall_together_or_do_not_fit_are_refused():
    with pytest.raises(ParameterError, match="hinges: got 3, but quantiles of y fall together"):
        WindowFeatures(hinges=3).learned(np.repeat([[0.0], [1.0]], [90, 10], axis=0))
    with pytest.raises(FuzzykfError, match="hinges: got knots of 1 components, expected 2, as y has"):
        WindowFeatures(hinges=[[0.0]]).learned(np.zeros((5, 2)))


def test_what_is_missing_counts_as_the_last_value_before():
    nan = np.nan
    ys = np.array([[nan, nan], [1.0, nan], [nan, nan], [3.0, nan]])
    assert carried(ys).tolist() == [[1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [3.0, 0.0]]
    assert np.isnan(ys[0]).all()
