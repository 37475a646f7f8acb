"""What goes with observations row by row: its index, and controls of many series in every form."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from fuzzykf import Filter
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter, batch_filter, rts_smoother

DAYS = pd.date_range("2024-01-01", periods=4, freq="D")
ZS = pd.Series([1.0, np.nan, 3.0, 4.0], DAYS)
WIDE = pd.DataFrame({"a": ZS, "b": ZS + 1.0})
US = pd.Series([1.0, 0.0, 2.0, 0.5], DAYS, name="u")


class OwnVerb(KalmanFilter):
    """A filter with a verb of its own, which goes through series step by step."""

    def predict(self, u=None, B=None, F=None, Q=None):
        super().predict(u, B, F, Q)


def linear(kind=KalmanFilter, Q=1.0):
    return kind(1, 1, 1, F=[[0.9]], H=[[1.0]], B=[[2.0]], Q=Q, R=0.5)


def extended():
    return ExtendedKalmanFilter(
        1, 1, 1, fx=lambda x, u=0.0: 0.9 * x + 2.0 * np.ravel(u), hx=lambda x: x, Q=1.0, R=0.5
    )


def bank(method="imm"):
    return IMMEstimator([linear(), linear(Q=4.0)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


MAKERS = {
    "KalmanFilter": linear,
    "own verb": lambda: linear(OwnVerb),
    "ExtendedKalmanFilter": extended,
    "IMM": bank,
    "GPB2": lambda: bank("gpb2"),
}


# ------------------------------------------------------------------ indexes

ONE = pd.Series([[[0.9]]] * 4, DAYS)  # a matrix for each row
RISING, COVARIANCES = np.arange(4.0)[:, None] ** 2, np.ones((4, 1, 1))

#: Verbs with what goes with the observations: who has them, the argument, the call with a table.
VERBS = {
    "filter": (MAKERS, "us", US, lambda f, zs, t: f.filter(zs, us=t).x),
    "smooth": (list(MAKERS)[:3], "us", US, lambda f, zs, t: f.smooth(zs, us=t).x),
    "batch_filter": (list(MAKERS)[:3], "us", US, lambda f, zs, t: f.batch_filter(zs, us=t)[0]),
    **{
        f"batch_filter {name}": (
            list(MAKERS)[:2],
            name,
            table,
            lambda f, zs, t, name=name: f.batch_filter(zs, us=np.ones(4), **{name: t})[0],
        )
        for name, table in {"Rs": US + 1, "Qs": US + 1, "Fs": ONE, "Hs": ONE, "Bs": ONE}.items()
    },
    "filter_many": (
        list(MAKERS)[:3],
        "us",
        US.to_frame(),
        lambda f, zs, t: f.filter_many(pd.DataFrame({"a": zs, "b": zs}), us=t).x[1],
    ),
    "filter_many of a mapping": (
        list(MAKERS)[:3],
        "us",
        US.to_frame(),
        lambda f, zs, t: f.filter_many({"a": zs.to_numpy()[:1], "b": zs}, us=t).x[1],
    ),
    "rts_smoother": (
        list(MAKERS)[:2],
        "Qs",
        US,
        lambda f, zs, t: f.rts_smoother(RISING, COVARIANCES, pd.Series([1.0] * 4, zs.index), t)[0],
    ),
    "the function rts_smoother": (
        ["KalmanFilter"],
        "Qs",
        US,
        lambda f, zs, t: rts_smoother(RISING, COVARIANCES, pd.Series([1.0] * 4, zs.index), t)[0],
    ),
    "the function batch_filter": (
        ["KalmanFilter"],
        "Rs",
        US + 1,
        lambda f, zs, t: batch_filter([0.0], 1.0, zs, [1.0] * 4, [1.0] * 4, [1.0] * 4, t)[0],
    ),
}

#: Tables whose index is another one.
OTHERS = {
    "reversed": lambda t: t[::-1],
    "a day later": lambda t: t.set_axis(DAYS + pd.Timedelta("1D")),
    "numbered": lambda t: t.reset_index(drop=True),
    "a row less": lambda t: t[:3],
    "a row more": lambda t: pd.concat([t, t[:1].set_axis([pd.Timestamp("2024-01-05")])]),
}

CASES = [(verb, who) for verb, (names, *_) in VERBS.items() for who in names]


@pytest.mark.parametrize(("verb", "who"), CASES)
def test_what_goes_with_observations_has_their_index(verb, who) -> None:
    _, name, table, call = VERBS[verb]
    found = call(MAKERS[who](), ZS, table)
    np.testing.assert_array_equal(found, call(MAKERS[who](), ZS, table.to_numpy()))
    other_numbers = call(MAKERS[who](), ZS, table * 0.5 if table is not ONE else ONE.map(lambda F: [[0.1]]))
    assert not np.array_equal(found, other_numbers)  # so that the table counts
    for other in OTHERS.values():
        f = MAKERS[who]()
        x, P = f.x.copy(), f.P.copy()
        with pytest.raises(ParameterError, match=f"{name}.*: rows of different indexes; .* has 4 from"):
            call(f, ZS, other(table))
        np.testing.assert_array_equal(f.x, x)
        np.testing.assert_array_equal(f.P, P)


@pytest.mark.parametrize("who", MAKERS)
def test_controls_of_a_forecast_have_the_index_of_the_rows_ahead(who) -> None:
    ahead = pd.Series([1.0, -2.0], pd.date_range("2024-01-05", periods=2))
    f = MAKERS[who]()
    expected = f.copy().forecast(2, us=ahead).x  # where nobody knows the rows ahead: by position
    np.testing.assert_array_equal(expected, f.forecast(2, us=[1.0, -2.0]).x)
    with pytest.raises(ParameterError, match="us: the index of row 1 is 2024-01-05"):
        f.forecast(2, us=ahead[::-1])
    f.filter(ZS)
    expected = f.forecast(2, us=[1.0, -2.0]).x
    assert not np.allclose(expected, f.forecast(2).x)
    np.testing.assert_array_equal(f.forecast(2, us=ahead).x, expected)
    np.testing.assert_array_equal(f.forecast(1, us=ahead).x, expected[:1])
    for us in (US, ahead[::-1], ahead.shift(freq="D"), ahead[:1], ahead.reset_index(drop=True)):
        with pytest.raises(ParameterError, match="forecast, us: rows of different indexes; forecast has 2"):
            f.forecast(2, us=us)
    f.filter(ZS.reset_index(drop=True))
    for us in ([1.0, -2.0], [1.0, -2.0, 9.0]):
        np.testing.assert_array_equal(
            f.forecast(2, us=pd.Series(us, range(4, 4 + len(us)))).x, f.forecast(2, us=us).x
        )
    np.testing.assert_array_equal(f.forecast(2, us=pd.Series(us[:2])).x, f.forecast(2, us=us).x)
    with pytest.raises(
        ParameterError, match=r"forecast, us: .*forecast has 2 from 4 to 5 and us has 2 from 0"
    ):
        f.forecast(2, us=pd.Series([0.0] * 6))


# ------------------------------------------------------------------ controls of many series

OWN = pd.DataFrame({"a": US, "b": [0.5, -1.0, 0.0, 3.0]}, DAYS)

#: Controls of the series a and b in all their forms, and which each has.
FORMS = {
    **{
        f"for all: {form}": (us, [US.to_numpy()] * 2)
        for form, us in {
            "Series": US,
            "array": US.to_numpy(),
            "column": US.to_numpy()[:, None],
            "columns": US.to_numpy()[:, None, None],
            "list": US.tolist(),
            "list of lists": [[u] for u in US],
            "list with None": [1.0, None, 2.0, 0.5],
            "list of lists with None": [[1.0], None, [2.0], [0.5]],
            "frame of one column": US.to_frame(),
            "DataArray": US.rename_axis("day").to_xarray(),
        }.items()
    },
    **{
        f"for each: {form}": (us, OWN.to_numpy().T)
        for form, us in {
            "array": OWN.to_numpy().T,
            "array with components": OWN.to_numpy().T[..., None],
            "list of lists": OWN.to_numpy().T.tolist(),
            "list of Series": [OWN["a"], OWN["b"]],
            "list of frames": [OWN[["a"]], OWN[["b"]]],
            "mapping": {"a": OWN["a"].tolist(), "b": OWN["b"].to_numpy()},
            "mapping of Series": {"a": OWN["a"], "b": OWN["b"]},
            "frame": OWN,
            "nullable frame": OWN.convert_dtypes(),
            "DataArray": OWN.rename_axis("day").to_xarray().to_dataarray("meter"),
            "Dataset": OWN.rename_axis("day").to_xarray(),
        }.items()
    },
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("who", list(MAKERS)[:4])
def test_controls_of_many_series_are_those_of_each_alone(who, form) -> None:
    f, (us, each) = MAKERS[who](), FORMS[form]
    found = f.filter_many(WIDE, us=us)
    assert list(found.names) == ["a", "b"]
    for k, name in enumerate(WIDE):
        alone = f.copy().filter(WIDE[name], us=each[k])
        for field in ("x", "P", "log_likelihood"):
            np.testing.assert_allclose(getattr(found, field)[k], getattr(alone, field), rtol=1e-12)
    assert not np.allclose(found.x, f.filter_many(WIDE).x)


RAGGED = {"a": ZS, "s": ZS[1:3] * 2.0, "b": ZS + 1.0}
OWN_RAGGED = {"a": US, "s": US[1:3] + 1.0, "b": US * 2.0}
PADDED = np.array([[*u, np.nan, np.nan][:4] for u in OWN_RAGGED.values()])
BY = pd.concat(RAGGED, names=["meter", "day"]).rename("z").reset_index()

#: Series of unequal length and their controls.
UNEQUAL = {
    "mapping": (RAGGED, {}, OWN_RAGGED),
    "lists": ([z.tolist() for z in RAGGED.values()], {}, [u.tolist() for u in OWN_RAGGED.values()]),
    "list of Series": (list(RAGGED.values()), {}, list(OWN_RAGGED.values())),
    "padded array": (RAGGED, {}, PADDED),
    "padded array with components": (RAGGED, {}, PADDED[..., None]),
    "long frame": (BY, {"by": "meter"}, OWN_RAGGED),
}


@pytest.mark.parametrize("form", UNEQUAL)
@pytest.mark.parametrize("who", MAKERS)
def test_controls_of_series_of_unequal_length_end_with_them(who, form) -> None:
    f, (zs, by, us) = MAKERS[who](), UNEQUAL[form]
    found = f.filter_many(zs, us=us, **by)
    shared = f.filter_many([z.to_numpy() for z in RAGGED.values()], us=US.to_numpy())
    for k, (name, z) in enumerate(RAGGED.items()):
        alone = f.copy().filter(z, us=OWN_RAGGED[name])
        np.testing.assert_allclose(found.x[k, : len(z)], alone.x, rtol=1e-12)
        alone = f.copy().filter(z.to_numpy(), us=US.to_numpy()[: len(z)])
        np.testing.assert_allclose(shared.x[k, : len(z)], alone.x, rtol=1e-12)
    assert np.isnan(found.x[1, 2:]).all()


B2 = np.array([[1.0, 0.5], [0.0, -2.0]])


def planar(kind=KalmanFilter, flat=False, Q=1.0):
    # two states, two controls; vectors are flat or columns
    f = kind(2, 1, 2, F=[[1.0, 1.0], [0.0, 0.9]], Q=Q, R=0.5, x=[1.0, 0.0] if flat else [[1.0], [0.0]])
    f.B, f.H = B2, np.array([[1.0, 0.0]])
    if kind is ExtendedKalmanFilter:
        f.hx = lambda x: x[:1]
    return f


PLANAR = {
    "KalmanFilter": planar,
    "own verb": lambda flat=False: planar(OwnVerb, flat),
    "ExtendedKalmanFilter": lambda flat=False: planar(ExtendedKalmanFilter, flat),
    "IMM": lambda flat=False: IMMEstimator(
        [planar(flat=flat), planar(flat=flat, Q=4.0)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]]
    ),
}
TWO = {name: pd.DataFrame({"u": OWN[name], "v": OWN[name] ** 2}, DAYS) for name in OWN}

#: Controls of two components, and which each series has.
COMPONENTS = {
    "for all: array": (TWO["a"].to_numpy(), "aa"),
    "for all: columns": (TWO["a"].to_numpy()[..., None], "aa"),
    "for all: frame": (TWO["a"], "aa"),
    "for each: array": (np.stack(list(TWO.values())), "ab"),
    "for each: mapping": (TWO, "ab"),
    "for each: list of frames": (list(TWO.values()), "ab"),
    "for each: list of lists": ([table.to_numpy().tolist() for table in TWO.values()], "ab"),
    "for each: pairs of columns": (pd.concat(TWO, axis=1), "ab"),
    "for each: DataArray": (
        xr.DataArray(np.stack(list(TWO.values())), {"day": DAYS}, ("meter", "day", "control")),
        "ab",
    ),
}


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("form", COMPONENTS)
@pytest.mark.parametrize("who", PLANAR)
def test_controls_of_several_components(who, form, flat) -> None:
    f, (us, each) = PLANAR[who](flat=flat), COMPONENTS[form]
    if flat and form == "for all: columns":
        us = us[..., 0]  # filter takes columns where x is one
    found = f.filter_many(WIDE, us=us)
    for k, name in enumerate(each):
        one = TWO[name].to_numpy()
        alone = f.copy().filter(WIDE["ab"[k]], us=one if flat else one[..., None])
        np.testing.assert_allclose(found.x[k], alone.x, rtol=1e-12)


@pytest.mark.parametrize("verb", ["filter", "smooth", "forecast"])
@pytest.mark.parametrize("who", PLANAR)
def test_rows_of_a_table_are_controls_of_one_series(who, verb) -> None:
    # a row is flat, and the verbs take columns where x is one
    f, table = PLANAR[who](), TWO["a"].to_numpy()
    call = {"forecast": lambda us: f.copy().forecast(4, us=us)}.get(
        verb, lambda us: getattr(f.copy(), verb)([1.0, np.nan, 3.0, 4.0], us=us)
    )
    expected = call(table[..., None]).x
    for us in (table, table.tolist(), pd.DataFrame(table), xr.DataArray(table), list(table)):
        np.testing.assert_array_equal(call(us).x, expected)
    some, zeros = ([table[0], none, *table[2:]] for none in (None, np.zeros(2)))
    np.testing.assert_allclose(call(some).x, call(zeros).x, rtol=1e-12)


def test_functions_are_given_controls_in_their_form() -> None:
    # fx, not B, says what a control is: a number of each row, or its components
    given = []

    def fx(x, u):
        given.append(np.shape(u))
        return 0.9 * x + np.sum(u)

    for us, shape in (
        (US + 1.5, ()),  # a number 0 is no control
        (OWN + 1.5, ()),
        (OWN.to_numpy().T + 1.5, ()),
        (TWO["a"].rename(columns={"u": "p"}), (2,)),
        (TWO, (2,)),
        (np.ones((2, 4, 3)), (3,)),
    ):
        f = ExtendedKalmanFilter(1, 1, fx=fx, FJacobian=lambda x, u: 0.9, hx=lambda x: x)
        given.clear()
        f.filter_many(WIDE, us=us)
        assert set(given) == {shape}


class Moved(Filter):
    """A member that knows neither B nor fx."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.eye(1)
        self.x_prior, self.P_prior, self.log_likelihood = self.x, self.P, 0.0

    def predict(self, u=None):
        self.x = self.x_prior = 0.5 * self.x + (0.0 if u is None else u)

    def update(self, z):
        pass


def test_members_of_a_bank_need_not_know_what_a_control_is() -> None:
    f = IMMEstimator([Moved(), Moved()], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]])
    for us in (US, OWN):
        found = f.filter_many(WIDE, us=us).x[0]
        np.testing.assert_allclose(found, f.copy().filter(ZS, us=US).x)
        assert found.any()


@pytest.mark.parametrize("shape", [(0, 4), (2, 0)])
def test_nothing_is_controlled_where_there_is_no_row(shape) -> None:
    for us in (np.zeros((*shape, 1)), np.zeros(shape), np.zeros(shape[1])):
        assert linear().filter_many(np.zeros(shape), us=us).shape == shape


REFUSED = {
    "other series": ({"b": US, "a": US}, r"us: got the series b, a, expected those of zs"),
    "a series less": ({"a": US}, r"us: got 1 series of 4, expected one value for each of 2 series of 4"),
    "a series more": (OWN.assign(c=1.0), r"us: got 3 series of 4, expected"),
    "other rows": (OWN.shift(freq="D"), "zs, us: rows of different indexes"),
    "rows in another order": (OWN[::-1], "us: the index of row 1"),
    "other rows of one": ({"a": US, "b": US.shift(freq="D")}, "zs, us: rows of different indexes"),
    "other rows of all": (US.shift(freq="D"), "zs, us: rows of different indexes"),
    "too short": ({"a": US[:3], "b": US}, "us: got 2 series of 3, 4, expected"),
    "missing": ({"a": US, "b": [1.0, 0.0, None, 1.0]}, r"us: step 2 of series 'b' is nan, expected finite"),
    "missing in an array": (OWN.to_numpy().T * [1, np.nan, 1, 1], r"us: step 1 of series 'a' is nan"),
    "infinite": (OWN.replace(3.0, np.inf), r"us: observation 3 of series 'b' is inf"),
    "nothing": ({}, "us: got no series"),
    "a text": ("controls", "us: got 'controls', expected one value for each of the 4"),
    "a number": (1.0, "us: got 1.0, expected one value for each of the 4"),
    "two components": ({"a": TWO["a"], "b": TWO["b"]}, "us: got controls of 2 components, expected 1"),
}


@pytest.mark.parametrize("what", REFUSED)
@pytest.mark.parametrize("who", list(MAKERS)[:4])
def test_controls_of_other_series_are_refused(who, what) -> None:
    us, message = REFUSED[what]
    with pytest.raises(ParameterError, match=message):
        MAKERS[who]().filter_many(WIDE, us=us)


def test_controls_that_may_be_of_rows_or_of_series_are_refused() -> None:
    square = np.ones((4, 4))
    f = ExtendedKalmanFilter(1, 1, fx=lambda x, u: x + np.sum(u), hx=lambda x: x)
    with pytest.raises(ParameterError, match=r"us: got shape \(4, 4\), and there are 4 series of 4 rows"):
        f.filter_many(square, us=square)
    f.dim_u = 1
    one = f.filter_many(square, us=square).x
    f.dim_u = 4
    assert not np.allclose(one, f.filter_many(square, us=square).x)


# ------------------------------------------------------------------ messages

TEXTS = pd.DataFrame({"a": ["x"] * 4, "b": ["y"] * 4}, DAYS)
TABLES = {"frame": TEXTS, "Series": TEXTS["a"], "array": TEXTS.to_numpy(), "list of frames": [TEXTS] * 4}

#: Who prints a table of no use: the argument and the call.
PRINTS = {
    **{
        f"{verb} of {who}": (
            "us",
            lambda t, who=who, verb=verb, a=a: getattr(MAKERS[who](), verb)(a, us={"a": t, "b": t}),
        )
        for who in ("KalmanFilter", "IMM")
        for verb, a in {"filter": ZS, "batch_filter": ZS, "filter_many": WIDE, "forecast": 4}.items()
    },
    **{
        f"batch_filter({name}=)": (
            name[0],
            lambda t, name=name: linear().batch_filter(ZS, us=[1.0] * 4, **{name: [t] * 4}),
        )
        for name in ("Rs", "Qs", "Fs", "Hs", "Bs")
    },
    "update(R=)": ("R", lambda t: linear().update(1.0, R=t)),
    "predict(u=)": ("u", lambda t: linear().predict(t)),
    "the constructor": ("R", lambda t: KalmanFilter(1, 1, R=t)),
    "a dimension": ("dim_x", lambda t: KalmanFilter(t, 1)),
    "a function": ("hx", lambda t: ExtendedKalmanFilter(1, 1, hx=t)),
    "HJacobian": ("HJacobian", lambda t: extended().update(1.0, HJacobian=t)),
}


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("who", PRINTS)
def test_a_message_is_one_line(who, table) -> None:
    name, call = PRINTS[who]
    with pytest.raises(ParameterError, match=f"^{name}: ") as error:
        call(TABLES[table])
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_controls_without_a_matrix_are_refused():
    # `predict(u)` alone leaves them out, as in filterpy
    f = KalmanFilter(1, 1, F=[[1.0]], H=[[1.0]])
    one = bank()
    one.filters[1].B = None
    for each in (f, one):
        for verb in (each.filter, each.smooth):
            with pytest.raises(
                ShapeError, match=r"B: got None, expected a matrix \(1, dim_u\) to go with us"
            ):
                verb([1.0, 2.0], us=[1.0, 1.0])
    f.predict(u=3.0)
    assert f.x[0, 0] == 0.0

    class Moved(KalmanFilter):
        """Knows what to do with a control."""

        def predict(self, u=None, B=None, F=None, Q=None):
            super().predict(F=F, Q=Q)
            self.x = self.x + u

    assert Moved(1, 1, F=[[1.0]], H=[[0.0]]).filter([1.0, 2.0], us=[1.0, 1.0]).x[-1, 0] == 2.0
