"""What training data may look like, and what is refused."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.switching.learning.data import gather

RNG = np.random.default_rng(0)
X, Y = RNG.normal(size=(60, 2)), RNG.normal(size=(60, 1))


def assert_same(a, b):
    for name in ("z", "before", "after", "starts", "kept", "known", "has_state"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert a.dim_x == b.dim_x
    assert a.n_rows == b.n_rows


def test_one_series():
    data = gather(X, Y)
    assert data.dim_x == 2
    np.testing.assert_allclose(data.z.mean(axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(data.z.std(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(data.z * data.scale.std + data.scale.mean, np.hstack([X, Y]), rtol=1e-12)
    np.testing.assert_array_equal(data.before, np.arange(59))
    np.testing.assert_array_equal(data.after, np.arange(1, 60))
    np.testing.assert_array_equal(data.starts, [0])
    np.testing.assert_array_equal(data.kept, np.arange(60))
    assert data.r is None
    assert data.is_complete
    assert data.has_state.all()
    assert data.n_measured == 180


@pytest.mark.parametrize(
    "convert",
    [
        lambda a: a.tolist(),
        lambda a: tuple(map(tuple, a.tolist())),
        lambda a: a[..., None],  # filterpy's columns
        lambda a: pd.DataFrame(a),
        lambda a: pd.DataFrame(a, dtype=object),
        lambda a: [a],
        lambda a: (a,),
    ],
)
def test_spellings_of_a_series(convert):
    assert_same(gather(convert(X), convert(Y)), gather(X, Y))


@pytest.mark.parametrize(
    "convert",
    [lambda a: a, lambda a: a.tolist(), lambda a: pd.Series(a), lambda a: [np.array([v]) for v in a]],
)
def test_spellings_of_one_component(convert):
    x, y = X[:, 0], Y[:, 0]
    assert_same(gather(convert(x), convert(y)), gather(x[:, None], y[:, None]))
    r = RNG.random(60)
    np.testing.assert_array_equal(gather(x, y, convert(r)).r, r)


def test_several_series():
    # rows of different series do not follow one another
    data = gather([X[:25], X[25:30], X[30:]], [Y[:25], Y[25:30], Y[30:]])
    np.testing.assert_array_equal(data.starts, [0, 25, 30])
    assert 24 not in data.before
    assert 29 not in data.before
    assert len(data.before) == 57
    np.testing.assert_array_equal(data.after, data.before + 1)
    np.testing.assert_allclose(data.z, gather(X, Y).z)
    nested = gather([X[:25].tolist(), X[25:].tolist()], [Y[:25].tolist(), Y[25:].tolist()])
    np.testing.assert_array_equal(nested.starts, [0, 25])  # of different lengths, so several


@pytest.mark.parametrize("complete", [True, False])
def test_missing_rows_cut_a_series(complete):
    x, y, r = X.copy(), Y.copy(), RNG.random(60)
    (x[:, 1] if complete else y[:, 0])[10] = np.nan
    y[20, 0] = r[40] = np.nan
    (x if complete else y)[21:24] = np.nan
    data = gather(x, y, r, complete=complete)
    gone = [10, 20, 21, 22, 23, 40]
    np.testing.assert_array_equal(data.kept, np.setdiff1d(np.arange(60), gone))
    np.testing.assert_array_equal(data.kept[data.starts], [0, 11, 24, 41])
    np.testing.assert_array_equal(data.kept[data.after] - data.kept[data.before], 1)
    assert len(data.before) == 54 - 4
    assert data.n_rows == 60
    np.testing.assert_array_equal(data.r, r[data.kept])
    assert data.is_complete


@pytest.mark.parametrize("state_feedback", [True, False])
def test_rows_without_a_state_stay(state_feedback):
    x, y = X.copy(), Y.copy()
    x[[0, 10, 11]] = x[30, 1] = y[20, 0] = np.nan  # a row with half a state has none
    x[50:] += 10.0
    data = gather(x, y, state_feedback=state_feedback)
    known = ~np.isin(data.kept, [0, 10, 11, 30])
    np.testing.assert_array_equal(data.kept, np.delete(np.arange(60), 20))
    np.testing.assert_array_equal(data.kept[data.starts], [0, 21])
    np.testing.assert_array_equal(data.known, known)
    np.testing.assert_array_equal(np.isnan(data.z), np.outer(~known, [True, True, False]))
    after = known[data.after]
    np.testing.assert_array_equal(data.has_state, known[data.before] & after if state_feedback else after)
    # units are those of the numbers that are there
    np.testing.assert_allclose(np.nanmean(data.z, axis=0), 0.0, atol=1e-13)
    np.testing.assert_allclose(np.nanstd(data.z, axis=0), 1.0, rtol=1e-12)
    back = (data.z * data.scale.std + data.scale.mean)[known]
    np.testing.assert_allclose(back, np.hstack([x, y])[data.kept][known], atol=1e-12)
    assert data.n_measured == 59 + 2 * 55


def test_too_few_states_for_a_memory_are_told_of_the_other_way():
    x = X.copy()
    x[::2] = np.nan
    with pytest.raises(
        ParameterError,
        match=r"hold 0 steps .* 30 rows that follow one with y, from which state_feedback=False",
    ):
        gather(x, Y)
    assert gather(x, Y, state_feedback=False).has_state.sum() == 30
    x[20:] = np.nan
    with pytest.raises(ParameterError, match="hold 10 steps in which y is measured, and x after them"):
        gather(x, Y, state_feedback=False)
    with pytest.raises(ParameterError, match="hold 0 steps in which x and y are both measured, expected"):
        gather(x, Y)


def test_a_row_between_two_holes_is_a_stretch_of_its_own():
    x = X.copy()
    x[[5, 7]] = np.nan
    data = gather(x, Y, complete=True)
    np.testing.assert_array_equal(data.kept[data.starts], [0, 6, 8])
    assert not np.isin(np.flatnonzero(data.kept == 6), np.r_[data.before, data.after]).any()


def test_arrays_are_left_as_they_were():
    x, y, r = X.copy(), Y.copy(), np.full(60, 0.5)
    data = gather(x, y, r)
    data.z[:] = 7.0
    np.testing.assert_array_equal(x, X)
    np.testing.assert_array_equal(y, Y)


@pytest.mark.parametrize(("x", "y", "name"), [(None, Y, "x"), (X, None, "y")])
def test_both_are_needed(x, y, name):
    with pytest.raises(
        ParameterError, match=rf"{name}: missing; the parameters of the state are not identifiable"
    ):
        gather(x, y)


def constant(column):
    x, y = X.copy(), Y.copy()
    (x if column < 2 else y)[:, column % 2] = 0.1  # the mean of which is not exactly .1
    return x, y


@pytest.mark.parametrize(
    ("x", "y", "r", "error", "message"),
    [
        (X, Y[:50], None, ShapeError, "series 0 has 60 states, 50 observations"),
        (X, Y, np.ones(59), ShapeError, "and 59 switches"),
        (X, Y, np.ones((60, 2)), ShapeError, "r: series 0 has 2 columns"),
        ([X, X], [Y], None, ShapeError, "got 2, 1 and 2 series"),
        ([X, X[:, :1]], [Y, Y], None, ShapeError, r"x: got series of \[1, 2\] components"),
        ([X, X[:, :1]], [Y, X], None, ShapeError, r"x: got series of \[1, 2\] components"),
        (X[None, None], Y, None, ShapeError, "x: got shape"),
        (np.full(60, "a"), Y, None, ShapeError, "x: expected numbers"),
        (np.where(X > 2.0, np.inf, X), Y, None, ParameterError, "x: series 0 has .*inf.* expected finite"),
        (X, -np.inf * Y, None, ParameterError, "y: series 0 has .*inf"),
        (X, Y, np.full(60, np.inf), ParameterError, "r: series 0 has .*inf"),
        (X[:20], Y[:20], None, ParameterError, "hold 19 steps"),
        (X, Y * np.nan, None, ParameterError, "hold 0 steps"),
        (*constant(1), None, ParameterError, r"x\[1\]: is constant \(0.1\)"),
        (*constant(2), None, ParameterError, r"y\[0\]: is constant"),
        (
            X,
            2.0 * X[:, :1] - 3.0 * X[:, 1:],
            None,
            ParameterError,
            r"linear relation .* x\[0\], x\[1\], y\[0\]",
        ),
        (X, np.r_[Y[:1], X[:-1, :1]], None, ParameterError, r"linear relation .* x\[0\], y\[0\] of the next"),
        (X, np.arange(60.0), None, ParameterError, r"linear relation .* y\[0\], y\[0\] of the next"),
    ],
)
def test_what_no_model_can_be_learned_from(x, y, r, error, message):
    with pytest.raises(error, match=message):
        gather(x, y, r)


def test_relations_are_looked_for_where_they_can_be():
    x, y = X.copy(), Y.copy()
    x[::2] = np.nan
    # of y alone, where x is not known; of x and the y before, where its own predecessor is not known
    with pytest.raises(ParameterError, match=r"linear relation .* y\[0\], y\[0\] of the next"):
        gather(x, np.arange(60.0), state_feedback=False)
    x[1:, 0] = np.where(np.isnan(x[1:, 0]), np.nan, 2.0 * Y[:-1, 0])
    with pytest.raises(ParameterError, match=r"linear relation .* y\[0\], x\[0\] of the next"):
        gather(x, y, state_feedback=False)
    with pytest.raises(ParameterError, match=r"x\[1\]: is constant \(3\)"):
        gather(np.where(np.isnan(x), np.nan, [0.0, 3.0]) + [[1.0, 0.0]] * Y, y, state_feedback=False)


def test_a_large_offset_is_no_constant():
    data = gather(X + 1e6, 1e-6 * Y + 1e3)
    np.testing.assert_allclose(data.z, gather(X, Y).z, rtol=1e-5, atol=1e-6)
