"""Many series, in every form they come in: each as `filter` would alone, under its name."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from fuzzykf import (
    CGOMSMFilter,
    ExtendedKalmanFilter,
    Filter,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
)
from fuzzykf.base import as_observation
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError, StepsWarning
from fuzzykf.many import read_many

HOURS = pd.date_range("2026-03-01", periods=5, freq="h", name="hour")
A = np.array([0.3, 1.0, np.nan, 2.0, -0.4])
B = np.array([1.2, 0.1, 0.8, -0.5, 0.0])
SHORT = np.array([0.7, -0.2, 0.4])


class Patched(KalmanFilter):
    """A filter with a verb of its own, which goes through the series one by one."""

    def update(self, z, R=None, H=None):
        super().update(z, R, H)


class Average(Filter):
    """A filter of one's own."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.array([[10.0]])
        self.x_prior, self.P_prior = self.x, self.P

    def predict(self):
        self.x_prior, self.P_prior = self.x, self.P

    def update(self, z):
        y = as_observation(z, 1)
        if y is not None:
            self.x, self.P = 0.5 * (self.x + y[0]), 0.5 * self.P


def linear(kind=KalmanFilter):
    return kind(1, 1, F=[[0.9]], H=[[1.0]], Q=[[0.2]], R=[[0.5]], P=[[2.0]])


def possible():
    names = ("state", "process_noise", "measurement_noise")
    est = FuzzyRelationEstimator(1, 1, **{name: GaussianMembership(0.0, 0.5) for name in names})
    est.F, est.H = np.array([[0.9]]), np.eye(1)
    return est


def bank(method):
    return IMMEstimator([linear(), linear(Patched)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


def alike(method):
    return IMMEstimator([linear(), linear()], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


@pytest.fixture(scope="module")
def filters(small_models):
    fuzzy, hard = small_models
    return {
        "OFSRFilter": OFSRFilter(fuzzy, 3),
        "CGOMSMFilter": CGOMSMFilter(hard),
        "KalmanFilter": linear(),
        "KalmanFilter, own verb": linear(Patched),
        "ExtendedKalmanFilter": ExtendedKalmanFilter(1, 1, fx=np.sin, hx=np.tanh, Q=0.2, R=0.5),
        "IMM": alike("imm"),
        "GPB2": alike("gpb2"),
        "IMM of a patched filter": bank("imm"),
        "FuzzyRelationEstimator": possible(),
        "own": Average(),
    }


@pytest.fixture(scope="module")
def small_models():
    from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw

    z = np.array([[0.5, 0.3], [0.3, 1.0]])
    pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
    means = [[0.0, 0.0], [1.0, 2.0]]
    fuzzy = CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), means, [[pair, pair], [pair, pair]], dim_x=1)
    hard = CGOMSModel([[0.9, 0.1], [0.2, 0.8]], means, [[pair, pair], [pair, pair]], dim_x=1)
    return fuzzy, hard


NAMES = [
    "OFSRFilter",
    "CGOMSMFilter",
    "KalmanFilter",
    "KalmanFilter, own verb",
    "ExtendedKalmanFilter",
    "IMM",
    "GPB2",
    "IMM of a patched filter",
    "FuzzyRelationEstimator",
    "own",
]

WIDE = pd.DataFrame({"a": A, "b": B}, index=HOURS)
LONG = WIDE.stack(future_stack=True).rename_axis(["hour", "meter"]).rename("load").to_frame()

#: Forms of the series a and b, their names and their index.
FORMS = {
    "array": (np.array([A, B]), {}, None, None),
    "array with components": (np.array([A, B])[..., None], {}, None, None),
    "list of lists": ([A.tolist(), B.tolist()], {}, None, None),
    "list with None": ([[None if np.isnan(v) else v for v in A], B], {}, None, None),
    "masked": (np.ma.masked_invalid([A, B]), {}, None, None),
    "wide frame": (WIDE, {}, ["a", "b"], HOURS),
    "wide nullable frame": (WIDE.convert_dtypes(), {}, ["a", "b"], HOURS),
    "wide frame of numbered rows": (WIDE.reset_index(drop=True), {}, ["a", "b"], pd.RangeIndex(5)),
    "DataArray": (xr.DataArray(WIDE).rename(dim_1="meter").transpose("meter", "hour"), {}, ["a", "b"], HOURS),
    "mapping": ({"a": A, "b": B}, {}, ["a", "b"], None),
    "mapping of Series": ({"a": WIDE["a"], "b": WIDE["b"]}, {}, ["a", "b"], HOURS),
    "list of Series": ([WIDE["a"], WIDE["b"]], {}, ["a", "b"], HOURS),
    "Dataset": (xr.Dataset(WIDE), {}, ["a", "b"], HOURS),
    "long frame, level": (LONG, {"by": "meter"}, ["a", "b"], HOURS),
    "long frame, column": (LONG.reset_index("meter"), {"by": "meter"}, ["a", "b"], HOURS),
    "long frame, column of times": (LONG.reset_index(), {"by": "meter"}, ["a", "b"], HOURS),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_filtered_as_each_series_alone(filters, name, form):
    f = filters[name]
    zs, given, names, index = FORMS[form]
    found = f.filter_many(zs, **given)
    for k, one in enumerate((A, B)):
        alone = f.copy().filter(one)
        np.testing.assert_allclose(found.x[k], alone.x, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(found.P[k], alone.P, rtol=1e-12)
        if alone.log_likelihood is not None:
            np.testing.assert_allclose(found.log_likelihood[k], alone.log_likelihood, rtol=1e-12, atol=1e-14)
    assert found.lengths is None
    assert (None if found.names is None else list(found.names)) == names
    assert index is None or found.index.equals(index)
    assert index is not None or found.index is None


RAGGED = {
    "list": ([A, SHORT, B], {}),
    "mapping": ({"a": A, "s": SHORT, "b": B}, {}),
    "mapping of Series": ({"a": pd.Series(A, HOURS), "s": pd.Series(SHORT, HOURS[1:4]), "b": WIDE["b"]}, {}),
    "long frame": (
        pd.DataFrame(
            {
                "load": [*A, *SHORT, *B],
                "meter": [*"aaaaa", *"sss", *"bbbbb"],
                "hour": [*HOURS, *HOURS[1:4], *HOURS],
            }
        ),
        {"by": "meter"},
    ),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", RAGGED)
def test_series_of_unequal_length_end_where_they_end(filters, name, form):
    f = filters[name]
    zs, given = RAGGED[form]
    found = f.filter_many(zs, **given)
    assert found.lengths.tolist() == [5, 3, 5]
    assert found.shape == (3, 5)
    for k, one in enumerate((A, SHORT, B)):
        alone = f.copy().filter(one)
        np.testing.assert_allclose(found.x[k, : len(one)], alone.x, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(
            found.one(k if found.names is None else found.names[k]).P, alone.P, rtol=1e-12
        )
    assert np.isnan(found.x[1, 3:]).all()
    assert np.isnan(found.P[1, 3:]).all()
    assert found.log_likelihood is None or np.isnan(found.log_likelihood[1, 3:]).all()
    if form in ("mapping of Series", "long frame"):
        frame = found.to_dataframe()
        assert frame.index.names == ["meter" if "by" in given else "series", "hour"]
        assert len(frame) == 13
        assert frame.loc["s"].index.equals(HOURS[1:4])
        np.testing.assert_allclose(
            frame.loc["s", "x"], f.copy().filter(SHORT).x[:, 0], rtol=1e-12, atol=1e-14
        )


def test_switches_come_in_the_same_forms(small_models):
    f = KnownSwitchFilter(small_models[0])
    r = [np.linspace(0.0, 1.0, 5), np.array([0.0, 0.2, 1.0]), np.ones(5)]
    alone = [f.copy().filter(z, one).x for z, one in zip((A, SHORT, B), r, strict=True)]
    listed = f.filter_many([A, SHORT, B], r=r)
    named = f.filter_many({"a": A, "s": SHORT, "b": B}, r=dict(zip("asb", r, strict=True)))
    rows = pd.DataFrame({"z": [*A, *SHORT, *B], "valve": np.concatenate(r), "k": [*"aaaaasssbbbbb"]})
    by = f.filter_many(rows, by="k", r="valve")
    for found in (listed, named, by):
        for k, x in enumerate(alone):
            np.testing.assert_allclose(found.x[k, : len(x)], x, rtol=1e-12, atol=1e-14)
    wide = f.filter_many(WIDE, r=pd.DataFrame({"a": r[0], "b": r[2]}, HOURS))
    np.testing.assert_allclose(wide.x[1], alone[2], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"r": pd.DataFrame({"b": A * 0, "a": A * 0}, HOURS)},
            "r: got the series b, a, expected those of zs",
        ),
        (
            {"r": pd.DataFrame({"a": A * 0, "b": A * 0}, HOURS[::-1])},
            "r: the index of row 1|different indexes",
        ),
        ({"r": np.zeros((2, 4))}, "r: got 2 series of 4, expected one value for each of 2 series of 5"),
        ({"r": [np.zeros(5), np.zeros(3)]}, "r: got 2 series of 5, 3, expected one value"),
        ({}, r"r: got nothing, expected the switches, shape \(2, 5\)"),
        ({"r": "valve", "by": "k"}, "r: got 'valve', expected a column of zs|by: got 'k'"),
    ],
)
def test_switches_of_other_series_are_refused(small_models, arguments, message):
    with pytest.raises(FuzzykfError, match=message):
        KnownSwitchFilter(small_models[0]).filter_many(WIDE, **arguments)


@pytest.mark.parametrize("kind", [KalmanFilter, Patched])
def test_controls_end_with_the_series(kind):
    f = kind(1, 1, 1, F=[[0.9]], H=[[1.0]], Q=[[0.2]], R=[[0.5]], B=[[2.0]])
    us = np.arange(15.0).reshape(3, 5, 1)
    found = f.filter_many([A, SHORT, B], us=us)
    same = f.filter_many([A, SHORT, B], us=us[0])
    for k, one in enumerate((A, SHORT, B)):
        n = len(one)
        np.testing.assert_allclose(found.x[k, :n], f.copy().filter(one, us=us[k, :n]).x, rtol=1e-12)
        np.testing.assert_allclose(same.x[k, :n], f.copy().filter(one, us=us[0, :n]).x, rtol=1e-12)


def test_several_components_come_as_pairs_of_columns():
    f = KalmanFilter(2, 2, H=np.eye(2), R=np.diag([0.5, 2.0]))
    one = pd.DataFrame({"u": A, "v": B}, index=HOURS)
    wide = pd.concat({"east": one, "west": 2 * one}, axis=1)
    found = f.filter_many(wide)
    assert list(found.names) == ["east", "west"]
    np.testing.assert_allclose(found.x[1], f.copy().filter(2 * one).x, rtol=1e-12)
    long = pd.concat({"east": one, "west": 2 * one}, names=["side"])
    np.testing.assert_array_equal(f.filter_many(long, by="side").x, found.x)
    np.testing.assert_array_equal(f.filter_many({"east": one, "west": 2 * one}).x, found.x)
    with_none = [[None if np.isnan(a) else [a, b] for a, b in zip(A, B, strict=True)]] * 2
    alone = f.copy().filter(with_none[0])
    np.testing.assert_allclose(f.filter_many(with_none).x[0], alone.x, rtol=1e-12)


def test_a_wide_frame_resumes_where_the_filter_stands(small_models):
    f = OFSRFilter(small_models[0], 3)
    f.filter(B)
    before = f.x.copy()
    found = f.filter_many(WIDE, resume=True)
    np.testing.assert_array_equal(f.x, before)
    np.testing.assert_allclose(found.x[0], f.copy().filter(A, resume=True).x, rtol=1e-12)


def test_tables_of_one_call_may_order_their_columns_otherwise():
    f = KalmanFilter(2, 2, H=np.eye(2), R=np.diag([0.5, 2.0]))
    one = pd.DataFrame({"u": A, "v": B}, index=HOURS)
    expected = f.copy().filter(one).x
    pairs = pd.concat({"east": one, "west": one[["v", "u"]]}, axis=1)
    long = pd.concat({"east": one, "west": one}, names=["side"]).reset_index()
    pivoted = long.pivot(index="hour", columns="side", values=["u", "v"])
    for zs in ({"a": one, "b": one[["v", "u"]]}, pairs, pivoted, [one, one[["v", "u"]]]):
        found = f.filter_many(zs)
        np.testing.assert_allclose(found.x[0], expected, rtol=1e-12)
        np.testing.assert_allclose(found.x[1], expected, rtol=1e-12)
    assert list(f.filter_many(pivoted).names) == ["east", "west"]
    with pytest.raises(ParameterError, match="series 'b', got the columns u, w, expected u, v as before"):
        f.filter_many({"a": one, "b": one.rename(columns={"v": "w"})})


def test_an_array_of_xarray_goes_by_the_names_of_its_components(learned):
    one = pd.DataFrame({"t": A, "h": B}, index=HOURS)
    expected = learned.copy().filter(one.to_numpy()).x
    values = np.stack([one.to_numpy(), one.to_numpy()])
    cube = xr.DataArray(
        values,
        dims=["meter", "hour", "quantity"],
        coords={"hour": HOURS, "quantity": ["t", "h"], "meter": [7, 8]},
    )
    for zs in (cube, cube.sel(quantity=["h", "t"])):
        found = learned.filter_many(zs)
        np.testing.assert_array_equal(found.x[1], expected)
        assert list(found.names) == [7, 8]
    with pytest.raises(ParameterError, match="no column 't'"):
        learned.filter_many(cube.assign_coords(quantity=["a", "b"]))
    with pytest.raises(ParameterError, match="1 day"):
        learned.filter_many(cube.assign_coords(hour=pd.date_range("2026-03-01", periods=5)))


REFUSED = {
    "durations in the columns": (
        WIDE.set_axis(pd.timedelta_range("0h", periods=5, freq="h")).T,
        {},
        ParameterError,
        "its columns are times",
    ),
    "time first, without coordinates": (
        xr.DataArray(WIDE.to_numpy(), dims=["time", "meter"]),
        {},
        ParameterError,
        r"expected series first: zs.transpose\('meter', 'time'",
    ),
    "times in the columns": (
        WIDE.T,
        {},
        ParameterError,
        r"its columns are times, expected those in the rows: zs.T",
    ),
    "two of a name": (pd.concat([WIDE, WIDE], axis=1), {}, ParameterError, "two columns have one name"),
    "a column of text": (
        LONG.reset_index("meter"),
        {},
        ParameterError,
        r"the column 'meter' holds .*expected numbers: each column is a series \('by' names a column of keys",
    ),
    "rows in another order": (WIDE[::-1], {}, ParameterError, "the index of row 1"),
    "infinite": (WIDE.replace(1.0, np.inf), {}, ParameterError, "observation 1 of series 'a' is inf"),
    "infinite in a mapping": ({"a": [np.inf]}, {}, ParameterError, "zs: series 'a', observation 0, z: got"),
    "no such key": (
        LONG,
        {"by": "metre"},
        ParameterError,
        "by: got 'metre', expected one of load, hour, meter",
    ),
    "keys": (LONG, {"by": ["meter"]}, ParameterError, "by: got"),
    "key of an array": (np.zeros((2, 3)), {"by": "meter"}, ParameterError, "which goes with a DataFrame"),
    "a missing key": (
        LONG.reset_index().replace({"meter": {"b": None}}),
        {"by": "meter"},
        ParameterError,
        "by: row 1 has no value of 'meter'",
    ),
    "two columns": (
        LONG.reset_index("meter").assign(more=1.0),
        {"by": "meter"},
        ShapeError,
        "series 'a', got shape|series 'a', observation",
    ),
    "one series": (A, {}, ShapeError, r"got shape \(5,\), expected \(series, n, 1\)"),
    "times first": (
        xr.DataArray(WIDE),
        {},
        ParameterError,
        r"counts times, expected series first: zs.transpose\(",
    ),
    "nothing": ({}, {}, ShapeError, "got no series"),
}


@pytest.mark.parametrize("form", REFUSED)
@pytest.mark.parametrize("name", ["OFSRFilter", "KalmanFilter", "own"])
def test_what_cannot_be_told_apart_is_refused(filters, name, form):
    zs, given, error, message = REFUSED[form]
    with pytest.raises(error, match=message):
        filters[name].filter_many(zs, **given)


def test_a_frame_of_one_series_of_several_components_is_refused():
    f = KalmanFilter(2, 2, H=np.eye(2))
    with pytest.raises(
        ShapeError, match=r"columns a, b, expected pairs \(series, component\).*one series alone"
    ):
        f.filter_many(WIDE)


def test_series_without_rows():
    many = read_many([[], [1.0]], 1)
    assert many.lengths.tolist() == [0, 1]
    found = linear().filter_many([[], [1.0]])
    assert np.isnan(found.x[0]).all()
    np.testing.assert_array_equal(found.x[1], linear().filter([1.0]).x)


@pytest.fixture(scope="module")
def learned():
    """A filter whose model observes t and h, in this order, once an hour."""
    from fuzzykf import CGOMSModel

    root = np.array([[1.0, 0.2, 0.1], [0.0, 1.0, 0.4], [0.0, 0.0, 0.7]])
    pair = np.block([[root @ root.T, 0.5 * root @ root.T], [0.5 * root @ root.T, root @ root.T]])
    model = CGOMSModel(
        [[0.9, 0.1], [0.2, 0.8]], [[0.0, 0.0, 1.0], [1.0, 2.0, 0.0]], [[pair, pair], [pair, pair]], dim_x=1
    )
    return CGOMSMFilter(model.labelled(states=["load"], observations=["t", "h"], step=np.timedelta64(1, "h")))


def test_components_of_many_series_go_by_name(learned):
    one = pd.DataFrame({"t": A, "h": B}, index=HOURS)
    other = one[["h", "t"]].assign(load=1.0)
    expected = learned.copy().filter(one.to_numpy()).x
    for zs, given in [
        ({"east": one, "west": other}, {}),
        ([one, other], {}),
        (pd.concat({"east": one, "west": other}, axis=1), {}),
        (pd.concat({"east": one, "west": other}, names=["side"]), {"by": "side"}),
    ]:
        found = learned.filter_many(zs, **given)
        np.testing.assert_array_equal(found.x[0], expected)
        np.testing.assert_array_equal(found.x[1], expected)
    days = pd.date_range("2026-03-01", periods=5, freq="D")
    with pytest.raises(ParameterError, match=r"series 'east', .*missing|series 'east', .*'h'"):
        learned.filter_many({"east": one[["t"]]})
    with pytest.raises(ParameterError, match=r"series 'west'.*1 day"):
        learned.filter_many({"east": one, "west": one.set_axis(days)})


def test_a_wide_frame_is_not_of_the_states_that_are_estimated(small_models):
    f = OFSRFilter(small_models[0].labelled(states=["load"], observations=["z"], step=np.timedelta64(1, "h")))
    np.testing.assert_array_equal(f.filter_many(WIDE).x[1], f.copy().filter(B).x)
    with pytest.raises(ParameterError, match="zs: got 'load', a state of the model"):
        f.filter_many(WIDE.rename(columns={"a": "load"}))
    with pytest.raises(ParameterError, match="1 day"):
        f.filter_many(WIDE.set_axis(pd.date_range("2026-03-01", periods=5, freq="D")))


@pytest.mark.parametrize("name", NAMES)
def test_dimensions_and_coordinates_of_an_array_come_back(filters, name):
    array = xr.DataArray(
        [A, B],
        dims=["meter", "hour"],
        coords={"hour": HOURS, "meter": [7, 8], "feeder": ("meter", ["n", "s"]), "region": "x"},
    )
    found = filters[name].filter_many(array).to_xarray()
    assert found.x.dims == ("meter", "hour", "state")
    assert found.feeder.values.tolist() == ["n", "s"]
    assert found.region == "x"
    assert found.sel(meter=8).x.shape == (5, 1)
    bare = filters[name].filter_many(array.drop_vars(["hour", "meter"])).to_xarray()
    assert bare.x.dims == ("meter", "hour", "state")


def test_names_that_results_have_are_refused_by_xarray():
    frame = WIDE.rename_axis(index="x")
    with pytest.raises(ParameterError, match="to_xarray: the index or a coordinate is called 'x'"):
        linear().filter_many(frame).to_xarray()
    assert linear().filter_many(WIDE.rename_axis(columns="meter")).to_xarray().x.dims[0] == "meter"


@pytest.mark.parametrize("name", NAMES)
def test_times_of_an_array_of_xarray_are_looked_at(filters, name):
    array = xr.DataArray([A, B], dims=["meter", "hour"], coords={"hour": HOURS})
    with pytest.raises(ParameterError, match="the index of row 1 is"):
        filters[name].filter_many(array[:, ::-1])
    with pytest.warns(StepsWarning, match="2 rows are missing"):
        filters[name].filter_many(array[:, [0, 1, 4]])


def test_keys_name_the_series_of_a_frame_whose_columns_are_numbered():
    numbered = LONG.reset_index("meter").set_axis([0, 1], axis=1)
    found = linear().filter_many(numbered, by=0)
    assert list(found.names) == ["a", "b"]
    np.testing.assert_allclose(found.x[1], linear().filter(B).x, rtol=1e-12)
