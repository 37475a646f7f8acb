"""Tables go together by their index, and are refused where it differs; arrays go together by position."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSModel,
    DailyProfile,
    KalmanFilter,
    KnownSwitchFilter,
    compare_models,
)
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.observations import check_aligned, is_uneven, one_per_step


@pytest.fixture
def pair(fuzzy_model):
    """A state and an observation, one row per hour."""
    trajectory = fuzzy_model.simulate(600, np.random.default_rng(0))
    hours = pd.date_range("2026-01-01", periods=600, freq="h")
    return pd.Series(trajectory.x[:, 0], hours), pd.Series(trajectory.y[:, 0], hours)


WRONG = {
    "reversed": lambda s: s[::-1],
    "shifted": lambda s: s.set_axis(s.index + pd.Timedelta(hours=1)),
    "numbered": lambda s: s.reset_index(drop=True),
}


@pytest.mark.parametrize("how", WRONG)
def test_series_of_other_rows_are_refused(pair, how) -> None:
    x, y = pair
    other = WRONG[how](y)
    said = r"x, y: rows of different indexes; x has 600 from 2026-01-01 00:00:00 to .* and y has 600 from "
    with pytest.raises(ParameterError, match=said):
        CGOFMSModel.fit(x, other)
    with pytest.raises(ParameterError, match=said):
        CGOMSModel.fit(x.to_frame(), other.to_frame())
    with pytest.raises(ParameterError, match=said):
        CGOMSModel.fit([x, x], [y, other])
    with pytest.raises(ParameterError, match=said):
        compare_models(x, other, np.random.default_rng(0))
    with pytest.raises(ParameterError, match="x, r: rows of different indexes"):
        CGOMSModel.fit(x, y, WRONG[how](pd.Series(0.0, x.index)))


def test_workdays_of_other_rows_are_refused(pair) -> None:
    x, _ = pair
    workday = pd.Series(x.index.day_of_week < 5, x.index)
    DailyProfile().fit(x, workday=workday)
    for verb in (DailyProfile().fit, DailyProfile().fit(x).transform):
        with pytest.raises(ParameterError, match="values, workday: rows of different indexes"):
            verb(x, workday=workday[::-1])


def test_what_has_one_index_or_none_goes_together(pair) -> None:
    x, y = pair
    options = {"law": "fmc1", "n_nodes": 1, "form": "regression", "max_iter": 2, "n_starts": 1}
    expected = CGOFMSModel.fit(x.to_numpy(), y.to_numpy(), **options).log_likelihood
    for one, other in ((x, y), (x, y.to_numpy()), (list(x), y), (x.to_frame(), y.to_frame())):
        assert CGOFMSModel.fit(one, other, **options).log_likelihood == expected


def test_an_empty_table() -> None:
    with pytest.raises(ParameterError, match="a has no row and b has 1 from 0 to 0"):
        check_aligned(a=pd.Series(dtype=float), b=pd.Series([1.0]), c=None)


# ------------------------------------------------------------------ what goes with the observations


def controlled():
    return KalmanFilter(1, 1, F=[[0.9]], H=[[1.0]], B=[[1.0]])


def test_controls_go_by_position_in_an_index_of_whatever_order():
    frame = pd.DataFrame({"z": np.ones(4), "u": [0.0, 1.0, 2.0, 3.0]}, index=[2, 3, 0, 1])
    expected = controlled().filter(frame.z.to_numpy(), us=frame.u.to_numpy())
    np.testing.assert_array_equal(controlled().filter(frame.z, us=frame.u).x, expected.x)
    np.testing.assert_array_equal(controlled().filter(frame.z, us=frame[["u"]]).x, expected.x)
    noise = pd.Series([1.0, 2.0, 3.0, 4.0], index=[2, 3, 0, 1])
    one = controlled().batch_filter(frame.z, Rs=noise)
    other = controlled().batch_filter(frame.z.to_numpy(), Rs=noise.to_numpy())
    np.testing.assert_array_equal(one[0], other[0])
    ahead = controlled().forecast(4, us=frame.u)
    np.testing.assert_array_equal(ahead.x, controlled().forecast(4, us=frame.u.to_numpy()).x)


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda a, b, m: controlled().filter(a, us=b), "zs, us"),
        (lambda a, b, m: KnownSwitchFilter(m).filter(a, b), "zs, r"),
        (lambda a, b, m: KnownSwitchFilter(m).smooth(a, b), "zs, r"),
        (lambda a, b, m: CGOFMSModel.fit(np.zeros(len(a)), a, b), "y, r"),
    ],
)
def test_tables_that_go_with_observations_have_their_rows(call, names, fuzzy_model):
    one = pd.Series([0.1, 0.5, 0.9, 0.2], index=[0, 1, 2, 3])
    with pytest.raises(ParameterError, match=f"^{names}: rows of different indexes"):
        call(one, one[::-1], fuzzy_model)


def test_workdays_of_a_profile_go_with_the_times():
    time = pd.Series(pd.date_range("2014-01-06", periods=48, freq="h"))
    profile = DailyProfile().fit(np.arange(48.0), time, np.arange(48) < 24)
    with pytest.raises(ParameterError, match=r"^time, workday: rows of different indexes"):
        profile.at(time, pd.Series(np.arange(48) < 24)[::-1])


def test_one_per_step_is_neither_more_nor_less() -> None:
    assert one_per_step("Rs", [1.0, None], 2) == [1.0, None]
    for values in ([1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(
            ShapeError, match=rf"Rs: got {len(values)} values, expected one for each of the 2"
        ):
            one_per_step("Rs", values, 2)


@pytest.mark.parametrize(
    ("name", "uneven"), [("Fs", True), ("Qs", True), ("dt", True), ("fx_args", True), ("Rs", False)]
)
def test_what_moves_a_state_may_make_steps_uneven(name, uneven) -> None:
    assert is_uneven({name: [1.0], "us": [2.0]}) == uneven
    assert not is_uneven({name: None})
