"""From columns to a task: what is learned on the first part is fixed before the rest is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.comparison.clock import Clock
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_choice, as_real
from fuzzykf.observations import check_aligned
from fuzzykf.preprocessing import DailyProfile, as_columns, as_days, as_times, hour_of_day, is_constant
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from typing import Self

    from numpy.typing import ArrayLike, NDArray

    from fuzzykf.arrays import FloatArray

__all__ = ["ClockSwitch", "Task", "check_known", "prepare", "quantile_switch"]

#: Fewest rows to learn on, and fewest to compare on.
MIN_TRAIN, MIN_TEST = 100, 50

#: Length in hours of the times of day in which the clock switch stays at 0 and at 1
#: (section VII of the 2020 paper: from 1 to 5 at night and from 1 to 5 in the afternoon).
PLATEAU = 4.0

#: Quantiles of the observation between which `quantile_switch` rises from 0 to 1.
QUANTILES = (0.2, 0.8)

#: What `Task.switch_source` says if the switch is not given.
LEARNED = "hidden, learned with each model"


@reprs()
@dataclass(frozen=True)
class ClockSwitch:
    """Switch that follows the clock: 0 in the hours of lowest values, 1 in those of highest.

    It is linear in between (section VII of the 2020 paper, in which the hours are chosen by hand).

    Attributes
    ----------
    low, high : float
        Hours of the day at which the plateaus at 0 and 1 start; each lasts four hours.

    Examples
    --------
    >>> import numpy as np
    >>> switch = ClockSwitch(low=1.0, high=13.0)
    >>> switch(
    ...     np.array(
    ...         ["2010-06-01T03:00", "2010-06-01T09:00", "2010-06-01T15:00"],
    ...         dtype="datetime64[s]",
    ...     )
    ... )
    array([0. , 0.5, 1. ])
    """

    low: float
    high: float

    @classmethod
    def learn(cls, time: Any, values: FloatArray) -> Self:
        """Find the four hours with the lowest and with the highest mean of ``values``.

        Parameters
        ----------
        time : array_like of times, shape (n,)
            As in `DailyProfile.fit`; hours are in local time.
        values : ndarray, shape (n,)
            Values of the series; NaN where missing.

        Returns
        -------
        ClockSwitch

        Raises
        ------
        ParameterError
            If a window of four hours has no row.
        """
        known = ~np.isnan(values)
        hour, values = hour_of_day(time)[known], values[known]
        means = np.empty(24)
        for start in range(24):
            inside = (hour - start) % 24.0 <= PLATEAU
            if not inside.any():
                raise ParameterError(
                    f"switch: no row between {start}:00 and {(start + PLATEAU) % 24:.0f}:00, so the clock "
                    "cannot make the switch; use the quantiles of the observation"
                )
            means[start] = values[inside].mean()
        low = int(np.argmin(means))
        # At least one hour has to remain on both sides for the way between the plateaus.
        distance = np.minimum((np.arange(24) - low) % 24, (low - np.arange(24)) % 24)
        high = int(np.argmax(np.where(distance > PLATEAU, means, -np.inf)))
        return cls(float(low), float(high))

    def __call__(self, time: Any) -> FloatArray:
        """Return the switch at the given times, shape (n,), between 0 and 1."""
        rise = (self.high - self.low) % 24.0
        knots = [0.0, PLATEAU, rise, rise + PLATEAU, 24.0]
        return np.interp((hour_of_day(time) - self.low) % 24.0, knots, [0.0, 0.0, 1.0, 1.0, 0.0])

    def __str__(self) -> str:
        """Say in words when the switch is 0 and when it is 1."""
        low, high = (
            f"from {start:.0f}:00 to {(start + PLATEAU) % 24:.0f}:00" for start in (self.low, self.high)
        )
        return f"the clock, 0 {low}, 1 {high}, linear in between"


def quantile_switch(learning: FloatArray) -> tuple[float, float]:
    """Return the quantiles of an observation below which the switch is 0 and above which it is 1.

    Parameters
    ----------
    learning : ndarray, shape (n,)
        Observation in the training rows.

    Returns
    -------
    low, high : float
        Its 20 % and 80 % quantiles.

    Raises
    ------
    ParameterError
        If the two are equal up to rounding.

    Examples
    --------
    >>> import numpy as np
    >>> quantile_switch(np.arange(11.0))
    (2.0, 8.0)
    """
    learning = as_array("learning", learning, (None,))
    if not learning.size:
        raise ParameterError("learning: got no observation, expected at least one")
    low, high = (float(level) for level in np.quantile(learning, QUANTILES))
    if is_constant(np.array([low, high])):
        raise ParameterError(
            f"switch: the quantiles of {QUANTILES[0]:.0%} and {QUANTILES[1]:.0%} of the observation are "
            f"both {low:g}, so they cannot make the switch"
        )
    return low, high


@reprs()
@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A series, split into training and test rows.

    Attributes
    ----------
    state, observation : ndarray, shape (n,)
        State and observation; NaN where missing.  Methods are trained on the first ``n_train`` rows, and in
        later folds on more; of the test rows, they see the observation only.
    n_train : int
        Number of training rows before the first fold.
    switch : ndarray, shape (n,), or None
        The switch in the training rows, if it is given; otherwise it is learned.
    switch_source : str
        Description of the source of the switch.
    time : ndarray of datetime64, shape (n,), or None
        Local time, for plots.
    profile : DailyProfile or None
        Daily profile to subtract from the state; learned on the first ``n_train`` rows.
    clock : Clock or None
        Times and working days, for methods that use them.

    See Also
    --------
    prepare : Create a task; with an example.
    """

    state: FloatArray
    observation: FloatArray
    n_train: int
    switch: FloatArray | None = None
    switch_source: str = LEARNED
    time: NDArray[np.datetime64] | None = None
    profile: DailyProfile | None = None
    clock: Clock | None = None

    @property
    def n_test(self) -> int:
        """Number of test rows."""
        return len(self.state) - self.n_train

    def target(self, split: int, end: int) -> FloatArray:
        """Return the state of the first ``end`` rows, minus the profile of the rows before ``split``.

        Parameters
        ----------
        split : int
            Number of training rows, at least ``n_train``.  Ignored without a profile.
        end : int
            Number of rows to return.

        Returns
        -------
        ndarray, shape (end,)
        """
        state = self.state[:end]
        if self.profile is None or self.clock is None:
            return state
        clock = self.clock[:end]
        # The means of what is left are what more rows add to the profile.
        more = DailyProfile(self.profile.slot_).fit(state[:split], clock.times[:split], clock.workday[:split])
        found: FloatArray = more.transform(state, clock.times, clock.workday)
        return found


def check_known(argument: str, known: int, states: FloatArray, n_train: int) -> None:
    """Raise unless enough of the held-out states are known to judge by.

    Parameters
    ----------
    argument : str
    known : int
        How many are.
    states : ndarray, shape (n,) or (n, m)
        Those of the series, NaN where missing.
    n_train : int
        Rows that are not held out.
    """
    if known >= MIN_TEST:
        return
    there = np.flatnonzero(np.isfinite(states.reshape(len(states), -1)).any(axis=1))
    last = (
        f"the last known one is in row {there[-1] + 1:,} of {len(states):,}"
        if len(there)
        else "none is known"
    )
    raise ParameterError(
        f"{argument}: {known} held-out states are known of those after row {n_train:,}, expected at least "
        f"{MIN_TEST}; {last}: leave out the rows behind it, or learn on a smaller share at first"
    )


def prepare(
    state: ArrayLike,
    observation: ArrayLike,
    *,
    train: float = 0.5,
    time: Any = None,
    workday: ArrayLike | None = None,
    profile: bool = False,
    switch: Literal["learned", "clock", "quantiles"] = "learned",
) -> Task:
    """Split a series into training and test rows, and learn profile and switch on the former.

    Parameters
    ----------
    state, observation : array_like, shape (n,)
        The state to estimate, and the observation to estimate it from; NaN where missing.
    train : float
        Share of the rows used for training before the first fold.
    time : array_like of times, shape (n,), optional
        Times of the rows, as in `DailyProfile.fit`; needed for a profile and for ``switch="clock"``.
    workday : array_like of bool, shape (n,), optional
        Working days; by default Mondays to Fridays.
    profile : bool
        Subtract the daily profile of the state (see `DailyProfile`).
    switch : {"learned", "clock", "quantiles"}
        Switch of the training rows.  "learned": hidden, learned with each model.  "clock": `ClockSwitch`,
        learned on the state before the profile is subtracted.  "quantiles": 0 below the 20 % quantile of
        the observation, 1 above its 80 % quantile, linear in between.

    Returns
    -------
    Task

    Raises
    ------
    ShapeError
        If the columns differ in length.
    ParameterError
        If ``train`` is not a share or leaves too few rows on either side; if a column is constant or missing
        in the training rows; if times are needed and missing, or do not increase; if the observation
        defines the switch and has gaps.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.comparison import prepare
    >>> rng = np.random.default_rng(0)
    >>> y = rng.normal(size=400)
    >>> task = prepare(np.abs(y), y, train=0.75)
    >>> task.n_train, task.n_test
    (300, 100)
    """
    check_aligned(state=state, observation=observation, time=time, workday=workday)
    x = _series("state", state, None)
    n = len(x)
    y = _series("observation", observation, n)
    times = None if time is None else as_times(time, None, n)
    days = None if workday is None else as_days(workday, n)
    n_train = _split(n, train)
    for name, values in (("state", x), ("observation", y)):
        known = values[:n_train][~np.isnan(values[:n_train])]
        if not known.size or is_constant(known):
            told = f"{known[0]:g}" if known.size else "missing"
            raise ParameterError(f"{name}: it is {told} in all {n_train} rows to learn on")
    as_choice("switch", switch, ("learned", "clock", "quantiles"))
    if times is None and (profile or switch == "clock"):
        needs = "profile" if profile else "switch"
        raise ParameterError(f"{needs}: the time of day needs a column of times, and there is none")
    r, source = None, LEARNED
    if switch == "clock" and times is not None:
        rule = ClockSwitch.learn(times[:n_train], x[:n_train])
        r, source = rule(times), str(rule)
    elif switch == "quantiles":
        if np.isnan(y).any():
            raise ParameterError(
                f"switch: the observation is missing in row {int(np.isnan(y).argmax())}, so it cannot make "
                "the switch there; let it be learned"
            )
        low, high = quantile_switch(y[:n_train])
        r = np.clip((y - low) / (high - low), 0.0, 1.0)
        source = f"the observation, 0 below {low:g}, 1 above {high:g}, linear in between"
    learned = None
    if profile and times is not None:
        learned = DailyProfile().fit(x[:n_train], times[:n_train], None if days is None else days[:n_train])
        x = learned.transform(x, times, days)
    return Task(
        state=x,
        observation=y,
        switch=r,
        n_train=n_train,
        time=None if times is None else times.clock,
        switch_source=source,
        profile=learned,
        clock=None if times is None else Clock.of(times, days),
    )


def _series(name: str, values: ArrayLike, n: int | None) -> FloatArray:
    """Return one column of numbers, NaN where missing."""
    columns = as_columns(name, values)
    given: Any = values
    if np.ndim(given) != 1 or (n is not None and len(columns) != n):
        expected = "(n,)" if n is None else f"({n},)"
        raise ShapeError(f"{name}: got shape {np.shape(given)}, expected {expected}")
    return columns[:, 0]


def _split(n: int, train: float) -> int:
    if not 0.0 < as_real("train", train, "a share between 0 and 1") < 1.0:
        raise ParameterError(f"train: got {train:g}, expected a share between 0 and 1")
    n_train = round(train * n)
    if n_train < MIN_TRAIN or n - n_train < MIN_TEST:
        raise ParameterError(
            f"train: {train:g} of {n} rows are {n_train} to learn on and {n - n_train} to compare on, "
            f"expected at least {MIN_TRAIN} and {MIN_TEST}"
        )
    return n_train
