"""What a linear filter is told of each step of a series: as filterpy's lists, on every kind and call."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
import pytest

from fuzzykf import FixedLag
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError, StepsWarning
from fuzzykf.kalman import ExtendedKalmanFilter, KalmanFilter

filterpy = pytest.importorskip("filterpy.kalman")

N = 12
RNG = np.random.default_rng(3)
ZS = 2.0 * RNG.normal(size=(N, 2))
GAPS = ZS.copy()
GAPS[4] = np.nan
SPANS = RNG.choice([0.0, 0.25, 1.0, 3.5], size=N)


def covariances(d: int, n: int = N) -> np.ndarray:
    roots = RNG.normal(size=(n, d, d))
    return roots @ np.swapaxes(roots, -1, -2) + 0.1 * np.eye(d)


def F_over(dt: float) -> np.ndarray:
    return np.array([[1.0, dt, 0.0], [0.0, np.exp(-0.3 * dt), 0.0], [0.0, 0.0, 0.9**dt]])


def Q_over(dt: float) -> np.ndarray:
    return 0.2 * np.diag([dt**3 / 3.0, dt, 2.0 * dt]) + 0.01 * np.eye(3)


BEGIN = {"x": [0.5, -1.0, 2.0], "P": covariances(3, 1)[0]}
OWN = {
    "F": F_over(0.5),
    "Q": covariances(3, 1)[0],
    "H": RNG.normal(size=(2, 3)),
    "R": covariances(2, 1)[0],
    "B": RNG.normal(size=(3, 2)),
}
FS = np.array([F_over(span) for span in RNG.exponential(size=N)])
QS, HS, RS, US = covariances(3), RNG.normal(size=(N, 2, 3)), covariances(2), RNG.normal(size=(N, 2, 1))


def some(rows: np.ndarray) -> list:
    """Return every other row, and None between them."""
    return [None if k % 2 else row for k, row in enumerate(rows)]


MIXED = {"Fs": FS, "Rs": RS}
TIMED = {"F": F_over, "Q": Q_over}

#: What is told, attributes that are functions of dt, and the same in lists of filterpy's.
TOLD = {
    "Rs": ({"Rs": RS}, {}, {"Rs": list(RS)}),
    "Rs, numbers": (
        {"Rs": [1.0, 2, None, np.float64(0.5)] * 3},
        {},
        {"Rs": [np.eye(2), 2.0 * np.eye(2), OWN["R"], 0.5 * np.eye(2)] * 3},
    ),
    "Qs": ({"Qs": QS}, {}, {"Qs": list(QS)}),
    "Fs": ({"Fs": FS}, {}, {"Fs": list(FS)}),
    "Hs": ({"Hs": HS}, {}, {"Hs": list(HS)}),
    "runs of one matrix": (
        {"Rs": np.repeat(RS[:3], 4, axis=0)},
        {},
        {"Rs": list(np.repeat(RS[:3], 4, axis=0))},
    ),
    "None here and there": (
        {"Fs": some(FS), "Qs": some(QS), "Hs": some(HS), "Rs": some(RS)},
        {},
        {
            name: [OWN[name[0]] if row is None else row for row in some(rows)]
            for name, rows in (("Fs", FS), ("Qs", QS), ("Hs", HS), ("Rs", RS))
        },
    ),
    "None alone": ({"Fs": [None] * N, "Rs": [None] * N}, {}, {}),
    "controls": ({"us": US}, {}, {"us": US}),
    "all": (
        {"us": US, "Fs": FS, "Qs": QS, "Hs": HS, "Rs": RS},
        {},
        {"us": US, "Fs": list(FS), "Qs": list(QS), "Hs": list(HS), "Rs": list(RS)},
    ),
    "one dt": ({"dt": 0.75}, TIMED, {"Fs": [F_over(0.75)] * N, "Qs": [Q_over(0.75)] * N}),
    "dt": ({"dt": SPANS}, TIMED, {"Fs": [*map(F_over, SPANS)], "Qs": [*map(Q_over, SPANS)]}),
    "dt of Q alone": ({"dt": list(SPANS)}, {"Q": Q_over}, {"Qs": [*map(Q_over, SPANS)]}),
    "dt, and some Fs": (
        {"dt": SPANS, "Fs": some(FS), "Rs": RS},
        TIMED,
        {
            "Fs": [F_over(dt) if row is None else row for row, dt in zip(some(FS), SPANS, strict=True)],
            "Qs": [*map(Q_over, SPANS)],
            "Rs": list(RS),
        },
    ),
}


class OwnVerbs(KalmanFilter):
    """A filter that goes through series by its verbs."""

    def predict(self, u=None, B=None, F=None, Q=None):
        super().predict(u, B, F, Q)

    def update(self, z, R=None, H=None):
        super().update(z, R, H)


KINDS = {"plain": KalmanFilter, "own verbs": OwnVerbs}


def made(kind=KalmanFilter, functions=(), **more):
    return kind(3, 2, 2, **{**OWN, **BEGIN, "x": np.reshape(BEGIN["x"], (3, 1)), **dict(functions), **more})


def of_filterpy(lists, alpha=1.0):
    """Return filterpy's four arrays, the first and the third flat, and what it smooths."""
    f = filterpy.KalmanFilter(3, 2, 2)
    for name, value in {**OWN, **BEGIN, "B": OWN["B"] if "us" in lists else None}.items():
        setattr(f, name, None if value is None else np.array(value))
    f.x, f.alpha = np.reshape(BEGIN["x"], (3, 1)), alpha
    zs = [None if np.isnan(z).any() else z.reshape(2, 1) for z in GAPS]
    x, P, x_prior, P_prior = f.batch_filter(zs, **lists)
    smooth = f.rts_smoother(x, P, lists.get("Fs"), lists.get("Qs"))[:2]
    return (x[..., 0], P, x_prior[..., 0], P_prior), (smooth[0][..., 0], smooth[1])


def close(found, expected, names):
    for name, value in zip(names, expected, strict=True):
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-12, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("alpha", [1.0, 1.02])
@pytest.mark.parametrize("told", TOLD)
@pytest.mark.parametrize("kind", KINDS)
def test_a_series_is_that_of_filterpy(kind, told, alpha) -> None:
    arguments, functions, lists = TOLD[told]
    expected, smoothed = of_filterpy(lists, alpha)
    f, g = made(KINDS[kind], functions), made(KINDS[kind], functions)
    f.alpha = g.alpha = alpha
    result = f.filter(GAPS, **arguments)
    close(result, expected, ("x", "P", "x_prior", "P_prior"))
    np.testing.assert_array_equal(f.x.ravel(), result.x[-1])
    assert f.log_likelihood == pytest.approx(result.log_likelihood[-1], rel=1e-12)
    smooth = g.smooth(GAPS, **arguments)
    np.testing.assert_array_equal(g.P, f.P)
    if alpha == 1.0 and "us" not in lists:  # of which filterpy's smoother knows nothing
        close(smooth, smoothed, ("x", "P"))


@pytest.mark.parametrize("told", TOLD)
def test_the_engine_does_what_the_verbs_do(told) -> None:
    arguments, functions, _ = TOLD[told]
    series = GAPS.copy()
    series[7, 0] = series[9, 1] = series[0] = series[-1] = np.nan
    plain, verbs = made(functions=functions), made(OwnVerbs, functions)
    plain.alpha = verbs.alpha = 1.02
    for call in (
        lambda f: f.filter(series, **arguments),
        lambda f: f.smooth(series, **arguments),
        lambda f: f.smooth_lag(series, 3, **arguments),
        lambda f: f.filter_many([series, ZS, ZS[:5]], **arguments),
    ):
        one, other = call(plain.copy()), call(verbs.copy())
        for name in ("x", "P", "x_prior", "P_prior", "log_likelihood"):
            if getattr(other, name) is not None:
                np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-11, atol=1e-12)
    plain.filter(series, **arguments)
    verbs.filter(series, **arguments)
    for name in ("x", "P", "y", "S", "SI", "K", "x_prior", "x_post", "P_post"):
        np.testing.assert_allclose(getattr(plain, name), getattr(verbs, name), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("told", TOLD)
@pytest.mark.parametrize("kind", KINDS)
def test_calls_agree_with_one_another(kind, told) -> None:
    arguments, functions, _ = TOLD[told]
    f = made(KINDS[kind], functions)
    result, smooth = f.copy().filter(GAPS, **arguments), f.copy().smooth(GAPS, **arguments)
    close(f.copy().smooth_lag(GAPS, 0, **arguments), (result.x, result.P), ("x", "P"))
    close(f.copy().smooth_lag(GAPS, N, **arguments), (smooth.x, smooth.P), ("x", "P"))
    many = f.filter_many([GAPS, GAPS[:7]], keep=["x", "P", "log_likelihood"], **arguments)
    for k, n in enumerate((N, 7)):
        close(
            result,
            [np.concatenate([getattr(many, one)[k, :n], getattr(result, one)[n:]]) for one in ("x", "P")],
            ("x", "P"),
        )
    np.testing.assert_allclose(many.log_likelihood[0], result.log_likelihood, rtol=1e-11, atol=1e-12)
    # halves give the whole
    g, parts = f.copy(), []
    for part in (slice(5), slice(5, N)):
        own = {name: one if isinstance(one, float) else one[part] for name, one in arguments.items()}
        parts.append(g.filter(GAPS[part], **own, resume=True).x)
    np.testing.assert_allclose(np.concatenate(parts), result.x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_many_series_may_have_spans_of_their_own(kind) -> None:
    f = made(KINDS[kind], TIMED)
    other = SPANS[::-1] + 0.1
    forms = {
        "array": ([GAPS, ZS], np.array([SPANS, other])),
        "mapping": ({"a": GAPS, "b": ZS[:6]}, {"a": SPANS, "b": other[:6]}),
        "list": ([GAPS, ZS[:6]], [SPANS, other[:6]]),
    }
    for zs, dt in forms.values():
        # the term B u of a step does not depend on its length
        many = f.filter_many(zs, dt=dt, Rs=RS, us=US[..., 0], keep=["x", "P", "log_likelihood"])
        of_each = zs.values() if isinstance(zs, dict) else zs
        spans = dt.values() if isinstance(dt, dict) else dt
        for k, (one, own) in enumerate(zip(of_each, spans, strict=True)):
            n = len(one)
            alone = f.copy().filter(one, us=US[:n], dt=own, Rs=RS[:n])
            for name in ("x", "P", "log_likelihood"):
                np.testing.assert_allclose(
                    getattr(many, name)[k, :n], getattr(alone, name), rtol=1e-12, atol=1e-12
                )
            assert np.isnan(many.x[k, n:]).all()


@pytest.mark.parametrize("kind", [KalmanFilter])
def test_verbs_and_forecast_take_dt(kind) -> None:
    f = made(kind, TIMED)
    result, g = f.copy().filter(GAPS, dt=SPANS, us=US), f.copy()
    for z, dt, u in zip(GAPS, SPANS, US, strict=True):
        g.predict(u, dt=dt)
        g.update(z)
    np.testing.assert_allclose(g.x.ravel(), result.x[-1], rtol=1e-12)
    ahead, nothing = f.forecast(3, dt=SPANS[:3]), f.copy().filter(np.full((3, 2), np.nan), dt=SPANS[:3])
    np.testing.assert_array_equal(ahead.x, nothing.x)
    np.testing.assert_array_equal(ahead.P, nothing.P)
    given = f.copy()
    given.predict(F=FS[0], dt=1.0)  # what is given goes before a function
    np.testing.assert_allclose(given.P, FS[0] @ f.P @ FS[0].T + Q_over(1.0), rtol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_a_fixed_lag_is_told_of_each_step(kind) -> None:
    f = made(KINDS[kind], TIMED)
    f.alpha = 1.02
    lagged, found = FixedLag(f.copy(), 3), []
    for k in range(N):
        matrices = {"F": FS[k], "R": RS[k]} if k % 2 else {}
        found.append(lagged.step(GAPS[k], u=US[k], dt=SPANS[k], **matrices))
    rows = {name: [row if k % 2 else None for k, row in enumerate(all_)] for name, all_ in MIXED.items()}
    expected = f.copy().smooth_lag(GAPS, 3, us=US, dt=SPANS, **rows)
    np.testing.assert_allclose(np.squeeze(found[3:]), expected.x[:-3], rtol=1e-10, atol=1e-10)


def test_a_function_is_asked_once_for_each_span_and_may_use_its_array_again() -> None:
    asked, room = [], np.empty((3, 3))

    def transition(dt):
        asked.append(dt)
        room[:] = F_over(dt)
        return room

    expected = made(functions=TIMED).filter(ZS, dt=SPANS)
    result = made(functions={"F": transition, "Q": Q_over}).filter(ZS, dt=SPANS)
    np.testing.assert_array_equal(result.x, expected.x)
    assert asked == sorted(set(SPANS.tolist()))


def test_a_function_may_be_assigned() -> None:
    f = made()
    f.F, f.Q = F_over, Q_over
    np.testing.assert_array_equal(f.filter(ZS, dt=2.0).x, made(functions=TIMED).filter(ZS, dt=2.0).x)


DAYS = pd.date_range("2024-01-01", periods=N, freq="D")
UNEVEN = DAYS[0] + pd.to_timedelta([0, 1, 2, 3, 4, 5, 6, 8, 9, 14, 15, 16], unit="D")


@pytest.mark.parametrize("call", ["filter", "smooth", "smooth_lag", "filter_many"])
def test_spans_have_the_index_of_the_observations(call) -> None:
    f, zs = made(functions=TIMED), pd.DataFrame(GAPS, UNEVEN)
    more = (2,) if call == "smooth_lag" else ()
    series = {"a": zs} if call == "filter_many" else zs

    def run(**told):
        return getattr(f.copy(), call)(series, *more, **told)

    with warnings.catch_warnings():  # the steps are told, so that they need not be even
        warnings.simplefilter("error", StepsWarning)
        found = run(dt=pd.Series(SPANS, UNEVEN), Rs=pd.Series(list(RS), UNEVEN))
    assert found.index.equals(UNEVEN)
    with pytest.warns(StepsWarning, match="rows are missing"):
        steady = getattr(made(), call)(series, *more)
    assert steady.index.equals(UNEVEN)
    with pytest.raises(ParameterError, match="rows of different indexes"):
        run(dt=pd.Series(SPANS, DAYS + pd.Timedelta("1h")))
    with pytest.raises(ParameterError, match="rows of different indexes"):
        run(dt=1.0, Rs=pd.Series(list(RS), DAYS + pd.Timedelta("1h")))


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: made(functions=TIMED), {"dt": [1.0, 1.0]}),
        (made, {"Fs": FS[:2]}),
        (
            lambda: ExtendedKalmanFilter(3, 2, fx=lambda x, dt=1.0: x, hx=lambda x: x[:2]),
            {"fx_args": [{"dt": 1.0}] * 2},
        ),
    ],
    ids=["dt", "Fs", "fx_args"],
)
def test_a_series_resumes_at_any_later_time_if_the_steps_are_told(make, told) -> None:
    f = make()
    f.filter(pd.DataFrame(ZS[:2], DAYS[:2]), **told)
    later, earlier = pd.DataFrame(ZS[2:4], DAYS[[5, 6]]), pd.DataFrame(ZS[2:4], DAYS[[1, 2]])
    with pytest.raises(ParameterError, match="expects a later time next"):
        f.filter(earlier, **told, resume=True)
    f.copy().filter(later, **told, resume=True)
    if "dt" not in told:
        with pytest.raises(ParameterError, match="expects 2024-01-03"):
            f.filter(later, resume=True)


# --------------------------------------------------------------------------- what is refused

NEITHER = "dt: got .*, but neither F nor Q of this .* is a function of it; expected None"
#: Attributes that are functions, what is told, and the error.
REFUSED = {
    "too few": ({}, {"Rs": RS[:3]}, ShapeError, "Rs: got 3 values, expected one for each of the 12 obs"),
    "too many": ({}, {"Fs": [*FS, None]}, ShapeError, "Fs: got 13 values, expected one for each of the 12"),
    "one for all": ({}, {"Qs": 2.0}, ShapeError, "Qs: got 2.0, expected one value for each of the 12"),
    "a text": ({}, {"Hs": "abc"}, ShapeError, "Hs: got 'abc', expected one value for each of the 12"),
    "a shape": (
        {},
        {"Hs": np.ones((N, 1, 3))},
        ShapeError,
        r"Hs\[0\]: got shape \(1, 3\), expected \(2, 3\)",
    ),
    "NaN": ({}, {"Fs": np.full((N, 3, 3), np.nan)}, ParameterError, "Fs: entry .* is nan, expected finite"),
    "NaN in a list": ({}, {"Rs": [1.0, np.nan] * 6}, ParameterError, r"Rs\[1\]: entry .* is nan"),
    "indefinite": ({}, {"Rs": [1.0, None, -2.0, *[1.0] * 9]}, NotPositiveDefiniteError, r"Rs\[2\]: expected"),
    "an indefinite stack": (
        {},
        {"Qs": np.eye(3) * np.r_[np.ones(5), -np.ones(7)][:, None, None]},
        NotPositiveDefiniteError,
        r"Qs\[5\]: expected a positive semi-definite matrix",
    ),
    "dt without a function": ({}, {"dt": 1.0}, ParameterError, NEITHER),
    "F without dt": ({"F": F_over}, {}, ParameterError, "F: got a function of dt, but no dt to go with it"),
    "Q without dt": ({"Q": Q_over}, {"Fs": FS}, ParameterError, "Q: got a function of dt, but no dt"),
    "some without dt": (
        {"F": F_over},
        {"Fs": some(FS)},
        ParameterError,
        "F: got a function of dt, but no dt",
    ),
    "a negative dt": (TIMED, {"dt": -1.0}, ParameterError, "dt: got -1.0, expected a finite number of at l"),
    "a missing dt": (
        TIMED,
        {"dt": [np.nan, *SPANS[1:]]},
        ParameterError,
        r"dt: step 0 is nan, expected a finite number of at least 0; dt\[0\] leads from",
    ),
    "few dt": (TIMED, {"dt": SPANS[:4]}, ShapeError, r"dt: got shape \(4,\), expected a number, or one for"),
    "durations": (
        TIMED,
        {"dt": np.full(N, np.timedelta64(1, "D"))},
        ParameterError,
        "dt: got .*, expected numbers in the unit of time of the functions",
    ),
    "a duration": (TIMED, {"dt": pd.Timedelta("1D")}, ParameterError, "expected numbers in the unit of time"),
    "a wrong F": (
        {"F": lambda dt: np.eye(2)},
        {"dt": 1.5},
        ShapeError,
        r"F\(dt=1.5\): got shape \(2, 2\), expected \(3, 3\)",
    ),
    "a wrong Q": ({"Q": lambda dt: -dt}, {"dt": 1.5}, NotPositiveDefiniteError, r"Q\(dt=1.5\): expected"),
}


def assert_unchanged(f, before) -> None:
    for name, value in before.items():
        np.testing.assert_array_equal(vars(f)[name], value, err_msg=name)


@pytest.mark.parametrize("refused", REFUSED)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_inadmissible_is_named_and_changes_nothing(kind, refused) -> None:
    functions, told, error, message = REFUSED[refused]
    f = made(KINDS[kind], functions)
    before = dict(vars(f))
    for call in (
        lambda: f.filter(ZS, **told),
        lambda: f.smooth(ZS, **told),
        lambda: f.smooth_lag(ZS, 2, **told),
        lambda: f.filter_many([ZS, ZS], **told),
    ):
        with pytest.raises(error, match=message):
            call()
    assert_unchanged(f, before)


def test_a_bad_span_of_one_series_among_many_is_named() -> None:
    f = made(functions=TIMED)
    with pytest.raises(ParameterError, match="dt of series 'b': step 2 is -1"):
        f.filter_many({"a": ZS[:3], "b": ZS[:3]}, dt={"a": [1.0] * 3, "b": [1.0, 1.0, -1.0]})
    with pytest.raises((ShapeError, ParameterError), match="dt"):
        f.filter_many({"a": ZS[:3], "b": ZS[:3]}, dt={"a": [1.0] * 3, "c": [1.0] * 3})


#: Calls that are told no dt: they say what is missing.
WITHOUT = {
    "predict": lambda f: f.predict(),
    "step": lambda f: f.step(ZS[0]),
    "forecast": lambda f: f.forecast(2),
    "batch_filter": lambda f: f.batch_filter(ZS),
    "fit": lambda f: f.fit(ZS),
    "predict_steadystate": lambda f: f.predict_steadystate(),
    "get_prediction": lambda f: f.get_prediction(),
}


@pytest.mark.parametrize("call", WITHOUT)
def test_a_function_without_dt_is_an_error(call) -> None:
    f = made(functions=TIMED)
    before = dict(vars(f))
    with pytest.raises(ParameterError, match=r"[FQ]: got a function of dt, but no dt"):
        WITHOUT[call](f)
    assert_unchanged(f, before)


@pytest.mark.parametrize("dt", [-1.0, np.nan, [1.0], "1", None])
def test_a_prediction_takes_one_finite_span(dt) -> None:
    f = made(functions=TIMED)
    with pytest.raises((ParameterError, ShapeError), match="dt"):
        f.predict(dt=dt)
    with pytest.raises(ParameterError, match=r"dt: got 1\.0, but neither"):
        made().predict(dt=1.0)
