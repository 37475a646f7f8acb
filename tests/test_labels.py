"""Models remember names, units and the length of a step, and take from a table what they were learned on."""

from __future__ import annotations

import copy
import datetime
import functools
import json
import pickle

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import FileFormatError, ParameterError, ShapeError
from fuzzykf.labels import NO_LABELS, Labels, read_labels

N = 30
HOURS = pd.date_range("2024-01-01", periods=N, freq="h")


def spread(K, d):
    """Regressions of one state and d - 1 observations, which differ in all of them."""
    rng = np.random.default_rng(K + d)
    q = d - 1

    def covariances(*shape):
        root = 0.3 * rng.normal(size=shape) + np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return {
        "Ayy": rng.normal(size=(K, K, q, q)) / 4,
        "Ny": rng.normal(size=(K, K, q)),
        "Qyy": covariances(K, K, q, q),
        "Axx": rng.normal(size=(K, K, 1, 1)) / 4,
        "H": rng.normal(size=(K, K, 1, q)),
        "G": rng.normal(size=(K, K, 1, q)),
        "c": rng.normal(size=(K, K, 1)),
        "C": covariances(K, K, 1, 1),
        "means": rng.normal(size=(K, d)),
        "covariances": covariances(K, d, d),
    }


LAW = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
STAYS = [[0.9, 0.1], [0.2, 0.8]]
LINEAR = {
    "A": [[[0.9]], [[0.5]]],
    "B": [[[1.0], [0.5]], [[0.2], [1.0]]],
    "C": [[[0.3]], [[1.0]]],
    "D": [[[0.5, 0.0], [0.1, 1.0]], [[0.5, 0.0], [0.2, 0.6]]],
}
NAMES = {"states": ["load"], "observations": ["t", "h"], "step": np.timedelta64(1, "h")}


@functools.cache
def make_model(kind):
    model = {
        "fuzzy": lambda: CGOFMSModel.from_regressions(LAW, **spread(2, 3)),
        "hard": lambda: CGOMSModel.from_regressions(STAYS, **spread(2, 3)),
        "converted": lambda: CGOMSModel.from_cglssm(STAYS, **LINEAR, order=2),
    }[kind]()
    return model.labelled(**NAMES)


#: The known switch.
R = np.arange(N) // 10 % 2

#: Models of one state and two observations, and what filters them.
FILTERS = {
    "fuzzy": lambda: OFSRFilter(make_model("fuzzy"), 1),
    "hard": lambda: CGOMSMFilter(make_model("hard")),
    "converted": lambda: CGOMSMFilter(make_model("converted")),
    "known, fuzzy": lambda: KnownSwitchFilter(make_model("fuzzy")),
    "known, hard": lambda: KnownSwitchFilter(make_model("hard")),
}
VERBS = ("filter", "smooth")


def met(forms):
    """Every filter with every form, by one verb or the other in turn: each verb meets all of either."""
    return [
        (kind, VERBS[(i + j) % 2], form) for i, kind in enumerate(FILTERS) for j, form in enumerate(forms)
    ]


def make_frame():
    rng = np.random.default_rng(0)
    table = pd.DataFrame(rng.normal(size=(N, 3)) * [1.0, 2.0, 5.0], HOURS, ["load", "t", "h"])
    table.iloc[5, 1] = np.nan
    return table.assign(note="dry")


@pytest.fixture
def frame():
    return make_frame()


def run(f, verb, zs):
    known = isinstance(f, KnownSwitchFilter)
    return getattr(f, verb)(zs, *([R] if known else []))


@functools.cache
def by_position(kind, verb):
    return run(FILTERS[kind](), verb, make_frame()[["t", "h"]].to_numpy()).x


#: Forms of the same observations: what the filter makes of them is what it makes of the array.
SAME = {
    "in order": lambda df: df[["t", "h"]],
    "in the other order": lambda df: df[["h", "t"]],
    "among others": lambda df: df,
    "unnamed": lambda df: pd.DataFrame(df[["t", "h"]].to_numpy(), df.index),
    "array": lambda df: df[["t", "h"]].to_numpy(),
    "list": lambda df: df[["t", "h"]].to_numpy().tolist(),
    "masked": lambda df: np.ma.masked_invalid(df[["t", "h"]].to_numpy()),
    "objects": lambda df: df[["h", "t"]].astype(object),
    "DataArray": lambda df: xr.DataArray(
        df[["load", "h", "t"]].to_numpy(), dims=("time", "what"), coords={"what": ["load", "h", "t"]}
    ),
    "DataArray without names": lambda df: xr.DataArray(df[["t", "h"]].to_numpy(), dims=("time", "what")),
    "rows missing at one step": lambda df: df.asfreq("h"),
}

#: Forms that are refused, and what is said.
OTHER = {
    "missing": (lambda df: df[["t"]], r"zs: got no column 'h'; the model was learned on t, h, and the col"),
    "a state": (lambda df: df[["load", "t"]], r"zs: got no column 'h'; .* and the columns are load, t"),
    "the state alone": (lambda df: df["load"], r"zs: got 'load', a state of the model, which observes t, h"),
    "strange names": (
        lambda df: df[["t", "h"]].set_axis(["u", "v"], axis=1),
        r"no column 't', 'h'; .* the columns are u, v: rename .*, or pass zs.to_numpy\(\), whose col",
    ),
    "twice": (lambda df: df[["t", "h", "t"]], r"zs: 2 columns are called 't', expected one"),
    "DataArray": (
        lambda df: xr.DataArray(np.zeros((N, 2)), dims=("time", "what"), coords={"what": ["t", "w"]}),
        r"zs: got no column 'h'",
    ),
    "days": (
        lambda df: df.set_axis(pd.date_range("2024", periods=N, freq="D")),
        r"zs: its rows are 1 day, 0:00:00 apart, but the model was learned on rows 1:00:00 apart; res",
    ),
    "half hours, unnamed": (
        lambda df: pd.DataFrame(np.zeros((N, 2)), pd.date_range("2024", periods=N, freq="30min")),
        r"zs: its rows are 0:30:00 apart",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "verb", "form"), met(SAME))
def test_observations_are_those_that_were_learned_on(kind, verb, form, frame) -> None:
    found = run(FILTERS[kind](), verb, SAME[form](frame))
    np.testing.assert_array_equal(found.x, by_position(kind, verb))
    if isinstance(SAME[form](frame), pd.DataFrame):
        assert found.index.equals(HOURS)


@pytest.mark.parametrize(("kind", "verb", "form"), met(OTHER))
def test_what_was_not_learned_on_is_refused(kind, verb, form, frame) -> None:
    f = FILTERS[kind]()
    run(f, "filter", frame)
    before = f.x.copy()
    make, message = OTHER[form]
    with pytest.raises(ParameterError, match=message):
        run(f, verb, make(frame))
    np.testing.assert_array_equal(f.x, before)
    assert f._n == N  # the filter is as it was


class Cautious(OFSRFilter):
    """Changes a verb, so that series go through the verbs."""

    def update(self, z):
        super().update(z)


def test_a_filter_with_verbs_of_its_own_sees_the_same_names(frame) -> None:
    f = Cautious(FILTERS["fuzzy"]().model, 1)
    expected = f.filter(frame[["t", "h"]].to_numpy())
    np.testing.assert_array_equal(f.filter(frame[["h", "t"]]).x, expected.x)
    np.testing.assert_array_equal(f.batch_filter(frame[["h", "t"]])[0][..., 0], expected.x)
    with pytest.raises(ParameterError, match="got no column 'h'"):
        f.smooth(frame[["t"]])


def test_a_model_without_names_takes_tables_by_position(frame) -> None:
    model = FILTERS["fuzzy"]().model.labelled(states=None, observations=None, step=None)
    assert not model.labels
    f = OFSRFilter(model, 1)
    swapped = frame[["h", "t"]]
    np.testing.assert_array_equal(f.filter(swapped).x, f.filter(swapped.to_numpy()).x)
    f.filter(swapped.set_axis(pd.date_range("2024", periods=N, freq="D")))  # and at any step


#: Names of a Series, for a model of "load" from "t".
SERIES = {"t": True, "renamed": True, None: True, 3: True, "load": False}


@pytest.mark.parametrize("name", SERIES)
def test_a_series_may_have_any_name_but_that_of_a_state(name, frame) -> None:
    model = CGOMSModel.from_regressions(STAYS, **spread(2, 2)).labelled(states=["load"], observations=["t"])
    f = model.filter()
    zs = frame["t"].rename(name)
    if SERIES[name]:
        np.testing.assert_array_equal(f.filter(zs).x, f.filter(zs.to_numpy()).x)
    else:
        with pytest.raises(
            ParameterError, match="zs: got 'load', a state of the model, which observes t; pass"
        ):
            f.filter(zs)
        f.filter(zs.to_numpy())
    # the name of a state that is observed as well, such as the value before, says nothing
    model.labelled(observations=["load"]).filter().filter(frame["load"])
    # if nothing is known of observations, a state is none all the same
    blind = model.labelled(observations=None).filter()
    with pytest.raises(ParameterError, match="a state of the model, and no observation"):
        blind.filter(frame[["load"]])
    blind.filter(frame[["h"]])


# --------------------------------------------------------------------------- steps

MONTHS = pd.date_range("2010-01-01", periods=60, freq="MS")
FRAMES = pd.DatetimeIndex(
    np.datetime64("2024", "ms") + np.round(np.arange(60) * 1000 / 30).astype("timedelta64[ms]")
)

#: What a model was learned on, rows that are as far apart, and rows that are not.
STEPS = {
    "hours": ("1h", [HOURS, HOURS[:1], HOURS[[0, 1, 2, 5, 6]], HOURS[:2], HOURS[:0]], [HOURS[::2], MONTHS]),
    "days": (
        "1D",
        [pd.date_range("2024-03-25", periods=12, freq="D", tz="Europe/Berlin")],  # one of them has 23 hours
        [HOURS, HOURS[::12]],
    ),
    "months": (
        np.timedelta64(1, "M"),
        [MONTHS, MONTHS[:2], MONTHS[6:8], MONTHS[:12].drop(MONTHS[4])],  # 31 days, and 31 days
        [MONTHS[::3], pd.date_range("2024", periods=9, freq="30D"), HOURS],
    ),
    "years": (np.timedelta64(1, "Y"), [MONTHS[::12]], [MONTHS]),
    "thirtieths of a second": (
        np.timedelta64(33, "ms"),
        [FRAMES, FRAMES[1:3], FRAMES[2:4], FRAMES[:6]],
        [FRAMES[::2], pd.date_range("2024", periods=9, freq="34ms")],
    ),
    "irregular": ("1h", [HOURS[[0, 1, 3, 7, 20]] + pd.to_timedelta([0, 7, 13, 21, 44], "s")], []),
    "no times": ("1h", [pd.RangeIndex(5), pd.Index(list("abc"))], []),
    "durations": (
        "1h",
        [pd.timedelta_range("0h", periods=4, freq="1h"), pd.to_timedelta([0, 1, 3], unit="h")],
        [pd.timedelta_range("0h", periods=4)],
    ),
}


@pytest.mark.filterwarnings("ignore::fuzzykf.errors.StepsWarning")  # some rows are missing
@pytest.mark.parametrize("kind", STEPS)
def test_rows_of_another_step_are_refused(kind) -> None:
    step, same, other = STEPS[kind]
    step = pd.Timedelta(step) if isinstance(step, str) else step
    model = CGOMSModel.from_regressions(STAYS, **spread(2, 2)).labelled(step=step)
    f = model.filter()
    for index in same:
        f.filter(pd.Series(np.zeros(len(index)), index))
    for index in other:
        zs = pd.Series(np.zeros(len(index)), index)
        with pytest.raises(
            ParameterError, match=r"zs: its rows are .* apart, but the model was learned on rows"
        ):
            f.filter(zs)
        f.filter(zs.to_numpy())


# --------------------------------------------------------------------------- one row

ROW = pd.Series({"h": 0.4, "load": 9.0, "t": -1.3})

#: One observation with names, the state among them.
ROWS = {
    "row of a frame": ROW,
    "row without the state": ROW[["h", "t"]],
    "frame of one row": ROW.to_frame().T,
    "mapping": dict(ROW),
    "named tuple": next(ROW.to_frame().T.itertuples(index=False)),
}


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("kind", ["fuzzy", "hard", "known"])
def test_a_row_is_matched_by_name(kind, name) -> None:
    model = make_model("fuzzy" if kind == "known" else kind)
    more = {"r": 0.0} if kind == "known" else {}

    def begun():
        f = KnownSwitchFilter(model) if kind == "known" else model.filter()
        for z in ([0.1, 0.2], [0.3, -0.1]):  # so that the compiled step is in force
            f.step(np.array(z), **more)
        return f

    expected = begun()
    expected.step(np.array([-1.3, 0.4]), **more)
    for call in ("step", "update", "filter"):
        f = begun()
        if call == "step":
            f.step(ROWS[name], **more)
        elif call == "update":
            f.predict(*more.values())
            f.update(ROWS[name])
        else:
            f.filter([ROWS[name]], **({"r": [0.0]} if more else {}), resume=True)
        np.testing.assert_allclose(f.x, expected.x, rtol=1e-12, err_msg=call)
    f = begun()
    before = f.x.copy()
    with pytest.raises(ParameterError, match="z: got no column 't'"):
        f.step(ROW[["h", "load"]], **more)
    np.testing.assert_array_equal(f.x, before)


#: One observation of a single name, alone and beside the state.
SINGLE = {
    "mapping": lambda name: {name: -1.3},
    "mapping with the state": lambda name: {"load": 9.0, name: -1.3},
    "row of a frame": lambda name: pd.DataFrame({name: [-1.3]}).iloc[0],
    "row at a time": lambda name: pd.DataFrame({name: [-1.3]}, HOURS[:1]).iloc[0],
    "frame of one row": lambda name: pd.DataFrame({name: [-1.3]}, HOURS[:1]),
    "named tuple": lambda name: next(pd.DataFrame({name: [-1.3]}).itertuples(index=False)),
}


@pytest.mark.parametrize("form", SINGLE)
@pytest.mark.parametrize("kind", ["hard", "known", "state space"])
def test_one_observation_of_a_single_name_is_matched_by_it(kind, form) -> None:
    if kind == "state space":
        model = SwitchingStateSpace(STAYS, F=[[0.9]], H=[[[1.0]], [[0.5]]], Q=[[1.0]], R=[[1.0]])
    else:
        model = CGOMSModel.from_regressions(STAYS, **spread(2, 2))
    model = model.labelled(states=["load"], observations=["t"])
    more = {"r": 0.0} if kind == "known" else {}

    def begun():
        return KnownSwitchFilter(model) if kind == "known" else model.filter()

    f, expected = begun(), begun()
    expected.step(-1.3, **more)
    f.step(SINGLE[form]("t"), **more)
    np.testing.assert_array_equal(f.x, expected.x)
    for wrong in ("load", "tt"):
        with pytest.raises(ParameterError, match="z: got no column 't'; the model was learned on t, and"):
            f.step(SINGLE[form](wrong), **more)
    np.testing.assert_array_equal(f.x, expected.x)


@pytest.mark.parametrize("index", [HOURS[3:4], pd.Index([7]), pd.Index(["2024-01-01"])])
def test_a_piece_of_a_column_is_taken_whatever_its_label(index) -> None:
    f = CGOMSModel.from_regressions(STAYS, **spread(2, 2)).labelled(observations=["t"]).filter()
    expected = f.copy()
    np.testing.assert_array_equal(f.step(pd.Series([-1.3], index, name="t")), expected.step(-1.3))


# --------------------------------------------------------------------------- learning


def learn(kind, x, y, r=None):
    switch = {"n_regimes": 1} if kind is CGOMSModel else {"n_nodes": 0}
    return kind.fit(x, y, r, form="regression", n_starts=1, max_iter=1, **switch)


DATA = {
    "Series and frame": lambda df: (df["load"], df[["t", "h"]], NAMES),
    "frames": lambda df: (df[["load"]], df[["t", "h"]], NAMES),
    "arrays": lambda df: (df[["load"]].to_numpy(), df[["t", "h"]].to_numpy(), {}),
    "unnamed": lambda df: (
        pd.DataFrame(df[["load"]].to_numpy()),
        pd.DataFrame(df[["t", "h"]].to_numpy()),
        {},
    ),
    "array and frame": lambda df: (
        df["load"].to_numpy(),
        df[["t", "h"]].reset_index(drop=True),
        {"observations": ["t", "h"]},
    ),
    "two series": lambda df: ([df["load"]] * 2, [df[["t", "h"]], df[["h", "t"]]], NAMES),
    "two series, one without names": lambda df: (
        [df["load"]] * 2,
        [df[["t", "h"]], df[["t", "h"]].to_numpy()],
        NAMES,
    ),
    "states of two places": lambda df: (
        [df["load"].rename("north"), df["load"].rename("south")],
        [df[["t", "h"]]] * 2,
        NAMES | {"states": None},
    ),
}


def make_training():
    return make_frame()[["load", "t", "h"]].fillna(0.0)


@pytest.fixture
def training():
    return make_training()


@functools.cache
def likelihood_of_arrays(kind, repeat):
    """What is learned from so many copies of the arrays."""
    x, y = (make_training()[columns].to_numpy() for columns in (["load"], ["t", "h"]))
    return learn(kind, [x] * repeat, [y] * repeat).log_likelihood


@pytest.mark.parametrize("form", DATA)
@pytest.mark.parametrize("kind", [CGOFMSModel, CGOMSModel])
def test_fit_remembers_what_tables_say(kind, form, training) -> None:
    x, y, known = DATA[form](training)
    found = learn(kind, x, y)
    assert found.model.labels == Labels(**known)
    assert found.log_likelihood == likelihood_of_arrays(kind, len(x) if isinstance(x, list) else 1)


@pytest.mark.parametrize("kind", [CGOFMSModel, CGOMSModel])
def test_learning_again_in_another_order_gives_a_filter_of_the_same_names(kind, training) -> None:
    zs = training[["t", "h"]]
    r = R if kind is CGOFMSModel else None  # a hidden one is sought from other beginnings
    one, other = learn(kind, training["load"], zs, r), learn(kind, training["load"], zs[["h", "t"]], r)
    assert other.model.labels.observations == ("h", "t")
    a, b = (found.model.filter(1).filter(training) for found in (one, other))
    np.testing.assert_allclose(a.x, b.x, rtol=1e-4, atol=1e-5)
    (again,) = one.bootstrap(1, np.random.default_rng(0))
    assert again.model.labels == one.model.labels


def test_the_order_of_columns_makes_no_difference_with_a_hidden_switch() -> None:
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    truth = CGOFMSModel(LAW, [[0.0, 0.0], [4.0, 3.0]], np.broadcast_to(pair, (2, 2, 4, 4)), dim_x=1)
    series = truth.simulate(500, np.random.default_rng(0))
    df = pd.DataFrame({"t": series.y[:, 0]})
    df["h"] = 20.0 + 5.0 * np.random.default_rng(1).normal(size=500)
    fit = CGOFMSModel.fit(series.x, df[["t", "h"]], n_starts=1, max_iter=3, n_nodes=1)
    f = fit.model.filter()
    right, swapped = f.filter(df[["t", "h"]]), f.filter(df[["h", "t"]])
    np.testing.assert_array_equal(swapped.x, right.x)
    error = np.sqrt(np.mean((swapped.x - series.x) ** 2))
    by_position = np.sqrt(np.mean((f.filter(df[["h", "t"]].to_numpy()).x - series.x) ** 2))
    assert error < 1.5
    assert by_position > 5.0 * error


BAD_DATA = {
    "other names": (
        lambda df: ([df["load"]] * 2, [df[["t", "h"]], df[["t", "h"]].set_axis(["t", "w"], axis=1)]),
        "y: the columns of one series are t, h, those of another t, w; expected the same",
    ),
    "a name twice": (
        lambda df: (df["load"], df[["t", "h"]].set_axis(["t", "t"], axis=1)),
        "y: columns: the name 't' stands twice, expected each once",
    ),
    "other steps": (
        lambda df: (
            [df["load"], df["load"].set_axis(pd.date_range("2024", periods=N, freq="D"))],
            [df[["t"]], df[["t"]].set_axis(pd.date_range("2024", periods=N, freq="D"))],
        ),
        "x, y: the rows of one series are 1 day, 0:00:00 apart, those of another 1:00:00",
    ),
}


@pytest.mark.parametrize("case", BAD_DATA)
@pytest.mark.parametrize("kind", [CGOFMSModel, CGOMSModel])
def test_series_that_do_not_go_together_are_not_learned_from(kind, case, training) -> None:
    make, message = BAD_DATA[case]
    with pytest.raises(ParameterError, match=message):
        learn(kind, *make(training))


def test_units_are_those_that_arrays_of_xarray_bring() -> None:
    x = xr.DataArray(np.zeros(3), dims="time", name="load", attrs={"units": "GW"})
    y = xr.DataArray(np.zeros(3), dims="time", name="t", attrs={"units": 7})
    assert read_labels([x], [y]) == Labels(["load"], ["t"], {"load": "GW"})


# --------------------------------------------------------------------------- values and files

LABELS = {
    "all": Labels(["load"], ["t", "h"], {"load": "GW", "h": "%"}, np.timedelta64(1, "h")),
    "states": Labels(["load"]),
    "observations": Labels(observations=["t", "h"]),
    "months": Labels(step=np.timedelta64(3, "M")),
    "parts of a second": Labels(step=np.timedelta64(33333, "us")),
}


def through_file(model, tmp_path):
    model.save(tmp_path / "model.json")
    return io.load_model(tmp_path / "model.json")


@pytest.mark.parametrize("name", LABELS)
@pytest.mark.parametrize("kind", ["fuzzy", "hard", "converted"])
def test_labels_go_wherever_the_model_goes(kind, name, tmp_path) -> None:
    labels = LABELS[name]
    f = FILTERS[kind]()
    model = f.model.labelled(
        states=labels.states, observations=labels.observations, units=labels.units, step=labels.step
    )
    assert model.labels == labels
    assert f.model.labels == Labels(**NAMES)  # the model that it was made from stays
    for other in (through_file(model, tmp_path), pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert other.labels == labels
        assert other.to_dict() == model.to_dict()
    f = model.filter()
    f.save(tmp_path / "filter.json")
    assert io.load_filter(tmp_path / "filter.json").model.labels == labels
    if kind == "fuzzy":
        assert model.harden().labels == labels


def test_a_model_without_labels_is_written_as_before(tmp_path) -> None:
    for kind in ("fuzzy", "hard"):
        model = FILTERS[kind]().model.labelled(states=None, observations=None, step=None)
        assert "labels" not in model.to_dict()
        assert through_file(model, tmp_path).labels == NO_LABELS


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.update(labels=None),
        lambda d: d.update(labels=3),
        lambda d: d["labels"].pop("units"),
        lambda d: d["labels"].update(colour="red"),
        lambda d: d["labels"].update(states="load"),
        lambda d: d["labels"].update(states=[3]),
        lambda d: d["labels"].update(states=["load", "load"]),
        lambda d: d["labels"].update(observations=["t"]),
        lambda d: d["labels"].update(observations=["t", ""]),
        lambda d: d["labels"].update(units={"wind": "m/s"}),
        lambda d: d["labels"].update(units={"t": None}),
        lambda d: d["labels"].update(step=3600),
        lambda d: d["labels"].update(step={"count": 0, "unit": "s"}),
        lambda d: d["labels"].update(step={"count": True, "unit": "s"}),
        lambda d: d["labels"].update(step={"count": 1, "unit": "h"}),
        lambda d: d["labels"].update(step={"count": 1, "unit": []}),
        lambda d: d["labels"].update(step={"count": 1}),
    ],
)
@pytest.mark.parametrize("kind", ["fuzzy", "hard"])
def test_damaged_labels_are_refused(kind, change, tmp_path) -> None:
    FILTERS[kind]().model.save(tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text())
    change(document)
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=r"model\.json: damaged: "):
        io.load_model(tmp_path / "model.json")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"states": "load"}, "states: got 'load', expected a list of names"),
        ({"states": [1]}, "states: got 1 among the names, expected text"),
        ({"states": ["a", "b"]}, "states: got 2 names, expected 1, one for each component"),
        ({"observations": ["t"]}, "observations: got 1 names, expected 2"),
        ({"observations": ["t", "t"]}, "observations: the name 't' stands twice"),
        ({"units": {"wind": "m/s"}}, "units: got one of 'wind', expected names among load, t, h"),
        ({"units": {"t": 3}}, "units: got 3 for 't', expected text"),
        ({"units": "GW"}, "units: got 'GW', expected units by name"),
        ({"step": "1h"}, "step: got '1h', expected a numpy.timedelta64"),
        ({"step": 3600}, "step: got 3600, expected"),
        ({"step": np.timedelta64(0, "s")}, "step: .* above zero"),
        ({"step": np.timedelta64("NaT")}, "step: "),
        ({"step": np.timedelta64(5)}, "step: "),
        ({"step": np.timedelta64(5, "ps")}, "step: .* no unit finer than a nanosecond"),
        ({"step": np.timedelta64(1 << 62, "W")}, "step: "),
    ],
)
def test_bad_labels_are_refused_and_the_model_stays(given, message) -> None:
    model = FILTERS["fuzzy"]().model
    with pytest.raises(ParameterError, match=message) as raised:
        model.labelled(**given)
    assert isinstance(raised.value, ShapeError) == (" names, expected " in message and "among" not in message)
    assert model.labels == Labels(**NAMES)


@pytest.mark.parametrize(
    "step",
    [np.timedelta64(60, "m"), datetime.timedelta(hours=1), pd.Timedelta("1h"), np.timedelta64(4, "15m")],
)
def test_one_length_of_a_step_is_one_value(step) -> None:
    labels = Labels(step=step)
    assert labels == Labels(step=np.timedelta64(3600, "s"))
    assert hash(labels) == hash(Labels(step=np.timedelta64(3600, "s")))
    assert labels != Labels(step=np.timedelta64(1, "M"))
    assert labels != Labels(["load"], step=step)
    assert Labels(step=np.timedelta64(1, "Y")) == Labels(step=np.timedelta64(12, "M"))


def test_units_go_with_their_components() -> None:
    model = FILTERS["fuzzy"]().model.labelled(units={"h": "%", "load": "GW"})
    other = model.labelled(states=["demand"], observations=["h", "t"])  # by position: h is now what t was
    assert other.labels.units == {"demand": "GW", "t": "%"}
    assert model.labelled(states=None).labels.units == {"h": "%"}
    with pytest.raises(AttributeError, match="never changes"):
        model.labels.step = None


def test_names_are_shown_where_components_are(training) -> None:
    fit = learn(CGOMSModel, training["load"], training[["t", "h"]])
    model = fit.model.labelled(units={"load": "GW"})
    assert repr(model).endswith("states=('load',), observations=('t', 'h'))")
    for text in ("1: load (GW)", "2: t, h", "rows apart"):
        assert text in model._repr_html_()
    said = str(fit.summary())
    for text in ("1: load", "2: t, h", "rows apart", "1:00:00", "mean of load", "mean of h"):
        assert text in said
    bare = learn(CGOMSModel, training["load"].to_numpy(), training[["t", "h"]].to_numpy())
    assert "mean of x[0]" in str(bare.summary())
    assert "rows apart" not in str(bare.summary())
    assert "states" not in repr(bare.model)
