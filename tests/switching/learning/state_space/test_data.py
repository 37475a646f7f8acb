"""Series to learn a state-space model from, in the forms in which they come."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import SwitchingStateSpace
from fuzzykf.errors import FuzzykfError
from fuzzykf.labels import Labels
from fuzzykf.switching.learning.state_space.data import labels_read, read_data

MODEL = SwitchingStateSpace([[1.0]], F=0.9, H=1.0, Q=1.0, R=1.0, B=1.0)
PLANE = SwitchingStateSpace([[1.0]], F=np.diag([0.9, 0.5]), H=np.eye(2), Q=np.eye(2), R=np.eye(2))

RNG = np.random.default_rng(7)
Z, X, U = RNG.normal(size=(40, 1)), RNG.normal(size=(40, 1)), RNG.normal(size=40)
Z2, X2, U2 = Z[:25], X[:25], U[:25]
DAYS = pd.date_range("2024-01-01", periods=40, freq="D")

FORMS = {
    "arrays": (1, (Z, X, U)),
    "flat": (1, (Z[:, 0], X[:, 0], U[:, None])),
    "lists": (1, (Z.tolist(), X.tolist(), U.tolist())),
    "columns": (1, (Z[:, :, None], X[:, :, None], U[:, None, None])),
    "pandas": (1, (pd.Series(Z[:, 0], DAYS), pd.Series(X[:, 0], DAYS), pd.Series(U, DAYS))),
    "an iterator": (1, (iter(list(Z)), X, U)),
    "one of several": (1, ([Z], [X], [U])),
    "several": (2, ([Z, Z2], [X, X2], [U, U2])),
    "several, flat": (2, ([Z[:, 0], Z2[:, 0]], [X[:, 0], X2[:, 0]], (U, U2))),
    "a mapping": (2, ({"a": Z, "b": Z2}, {"a": X, "b": X2}, {"b": U2, "a": U})),
    "frames": (
        2,
        (
            [pd.DataFrame(Z, DAYS), pd.DataFrame(Z2, DAYS[:25])],
            [pd.DataFrame(X, DAYS), pd.DataFrame(X2, DAYS[:25])],
            [U, U2],
        ),
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_series_come_in_many_forms(form):
    number, (zs, xs, us) = FORMS[form]
    found = read_data(MODEL, zs, xs, us)
    assert [len(one.ys) for one in found.series] == [40, 25][:number]
    for one in found.series:
        n = len(one.ys)
        np.testing.assert_array_equal(one.ys, np.concatenate([X, Z], axis=1)[:n])
        np.testing.assert_array_equal(one.us, np.concatenate([[0.0], U[1:n]])[:, None])
    assert found.n_observations == 40 + 25 * (number - 1)


def test_components_that_are_never_measured_are_left_out():
    z, x = RNG.normal(size=(9, 2)), np.full((9, 2), np.nan)
    x[3, 1], z[3:5] = 2.0, np.nan
    found = read_data(PLANE, z, x, None)
    assert found.measured.tolist() == [1]
    np.testing.assert_array_equal(found.series[0].ys, np.concatenate([x[:, 1:], z], axis=1))
    assert found.series[0].us is None
    assert found.n_observations == 8  # at 4 nothing was seen
    assert read_data(PLANE, z, None, None).measured.size == 0
    assert read_data(PLANE, z, np.full((9, 2), np.nan), None).measured.size == 0


def test_names_of_the_model_choose_columns():
    z, x = RNG.normal(size=(9, 2)), RNG.normal(size=(9, 2))
    named = PLANE.labelled(states=["slow", "fast"], observations=["one", "two"])
    seen = pd.DataFrame({"noise": 0.0, "two": z[:, 1], "one": z[:, 0]})
    measured = pd.DataFrame({"fast": x[:, 1], "slow": x[:, 0]})
    expected = np.concatenate([x, z], axis=1)
    for zs, xs in ((seen, measured), ([seen], [measured]), ({"a": seen}, {"a": measured})):
        np.testing.assert_array_equal(read_data(named, zs, xs, None).series[0].ys, expected)


FRAME = pd.DataFrame(RNG.normal(size=(9, 4)), DAYS[:9], ["slow", "fast", "one", "two"])
SLOW, SEEN, TURNED = FRAME[["slow", "fast"]], FRAME[["one", "two"]], FRAME[["two", "one"]]
LINE = FRAME["slow"], FRAME["one"]
ALL = Labels(["slow", "fast"], ["one", "two"], step=np.timedelta64(1, "D"))
ONE = Labels(["slow"], ["one"], step=np.timedelta64(1, "D"))

#: Model, measured states, observations, and what they say beside what the model knows.
TOLD = {
    "frames": (PLANE, SLOW, SEEN, ALL),
    "several": (PLANE, [SLOW, None], [SEEN, TURNED], ALL),
    "by name": (PLANE, {"b": SLOW}, {"a": SEEN, "b": TURNED}, ALL),
    "Series": (MODEL, *LINE, ONE),
    "several Series": (MODEL, [LINE[0]] * 2, [LINE[1]] * 2, ONE),
    "observations alone": (PLANE, None, SEEN, Labels(None, ["one", "two"], step=ALL.step)),
    "of other names": (MODEL, [LINE[0], LINE[1]], [LINE[1]] * 2, Labels(None, ["one"], step=ALL.step)),
    "arrays": (PLANE, SLOW.to_numpy(), SEEN.to_numpy(), Labels()),
    "rows": (PLANE, None, [row for _, row in SEEN.iterrows()], Labels()),
    "no times": (MODEL, None, LINE[1].reset_index(drop=True), Labels(None, ["one"])),
    "a frame of two series": (MODEL, None, SEEN, Labels()),
    "named": (PLANE.labelled(observations=["two", "one"], units={"one": "V"}), SLOW, SEEN,
              Labels(["slow", "fast"], ["two", "one"], {"one": "V"}, ALL.step)),
}  # fmt: skip


@pytest.mark.parametrize("kind", TOLD)
def test_names_and_step_are_found_in_tables(kind):
    model, xs, zs, expected = TOLD[kind]
    assert labels_read(model, zs, xs) == expected


def test_tables_of_other_columns_or_steps_do_not_go_together():
    with pytest.raises(FuzzykfError, match="zs: the columns of one series are one, two, those of another"):
        labels_read(PLANE, [SEEN, SLOW], None)
    with pytest.raises(FuzzykfError, match=r"xs, zs: the rows of one series are .* apart, those of another"):
        labels_read(PLANE, [SEEN, SEEN[::2]], None)


NAMED = {"a": Z, "b": Z}


@pytest.mark.parametrize(
    ("series", "message"),
    [
        ({"zs": np.full((5, 1), np.nan)}, "zs: got 5 rows without an observation"),
        ({"zs": np.zeros((0, 1))}, "zs: got no rows, expected at least one"),
        ({"zs": [Z, np.zeros((0, 1))]}, "zs: series 1, got no rows"),
        ({"zs": np.zeros((5, 2))}, r"zs: got shape \(5, 2\)"),
        ({"zs": [Z, np.zeros((5, 2))]}, r"zs: series 1, got shape \(5, 2\)"),
        ({"zs": [Z, np.full((5, 1), np.inf)]}, "zs: series 1, observation 0 is .inf."),
        ({"zs": 3.0}, "zs: got 3.0"),
        ({"xs": X[:39]}, "xs: got 39 rows, expected 40, one for each observation"),
        ({"xs": np.zeros((40, 2))}, r"xs: got shape \(40, 2\)"),
        ({"xs": np.full((40, 1), np.inf)}, "xs: observation 0 is .inf., expected finite numbers"),
        ({"us": U[:39]}, r"us: got shape \(39,\)"),
        ({"us": np.full(40, np.nan)}, "us: row 1 is .nan., expected finite numbers"),
        ({"zs": NAMED, "xs": {"a": X, "c": X}}, "xs: got the series a, c, expected those of zs"),
        ({"zs": NAMED, "xs": [X, X2]}, "xs: got .*, expected one value for each"),
        ({"zs": NAMED, "us": {"a": U, "c": U}}, "us: got the series .*, expected those of zs"),
        ({"zs": NAMED, "us": [U]}, "us: got .*, expected the controls of 2 series"),
        ({"zs": NAMED, "us": 3.0}, "us: got 3.0, expected the controls of 2 series"),
        ({"zs": NAMED, "us": [U, U2]}, "us: series 1, got shape"),
    ],
)
def test_what_does_not_fit_is_refused(series, message):
    given = {"zs": Z, "xs": None, "us": None} | series
    with pytest.raises(FuzzykfError, match=message):
        read_data(MODEL, **given)


def test_controls_need_their_matrix():
    with pytest.raises(FuzzykfError, match=r"us: got .*, but the model has no B"):
        read_data(PLANE, np.zeros((9, 2)), None, np.zeros(9))


@pytest.mark.parametrize(
    ("zs", "xs"), [([Z, Z2], [None, X2]), ((Z, Z2), (None, X2)), ({"a": Z, "b": Z2}, {"b": X2})]
)
def test_of_one_series_the_state_may_never_have_been_measured(zs, xs):
    first, second = read_data(MODEL, zs, xs, None).series
    assert np.isnan(first.ys[:, 0]).all()
    np.testing.assert_array_equal(second.ys[:, :1], X2)
