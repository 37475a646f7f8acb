"""
Speed on a road, from occupancy
===============================

A lane has two sensors: one measures for how much of the time a vehicle is above it (the
occupancy), the other one measures speeds. The second one fails. In free traffic the
speed hardly depends on the occupancy; in a jam it does, and jams come and go. The 2020
paper ends with this application. Here the data are two weeks of a road sensor in
Minnesota, about every five minutes, with gaps.

The file is not part of the package: set the environment variable ``FUZZYKF_DATA`` to the folder that holds
``traffic_t4013.csv``, speed and occupancy of sensor T4013 of the Minnesota Department of Transportation, as
the Numenta Anomaly Benchmark has them.
"""

# %%
# A grid of five minutes
# ----------------------
# Rows are 5, 10, 15 or 25 minutes apart. A model needs steps of one length, so we put
# the rows on a grid of five minutes, with NaN where there is none. We observe the
# logarithm of the occupancy.

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.dates import DateFormatter

from fuzzykf import CGOFMSModel, FadeLaw, pool_models
from fuzzykf.datasets import load_traffic
from fuzzykf.plotting import BLUE, ORANGE, TRUTH

data = load_traffic()
columns = {"speed": data.speed, "log_occupancy": np.log1p(data.occupancy)}
series = pd.DataFrame(columns, index=pd.DatetimeIndex(data.time)).asfreq("5min")
last_day = series.index[-1].normalize()
before, after = series[series.index < last_day], series[series.index >= last_day]
print(
    f"{len(series)} rows, {series.speed.isna().sum()} of them gaps; "
    f"{after.speed.count()} speeds to restore"
)

# %%
# A switch that is told
# ---------------------
# While the speed is measured, we can define a jam: free above 58 mph, congested below
# 33, and in between to a degree. This is the fuzzy switch on the learning part.

degree = ((58.0 - before.speed) / 25.0).clip(0.0, 1.0)
options = {"form": "regression", "tolerance": 1e-4, "progress": False}
told = CGOFMSModel.fit(
    before.speed, before.log_occupancy, degree, law="fmc1", n_nodes=3, **options
).model

# %%
# A switch that nobody tells
# --------------------------
# Alternatively, the regimes are found. Of two regimes, one would take the nights and
# one the days. So we use three, of which a jam follows the second one, and which *fade*
# within about twenty minutes. The numbers of the law are only the start of the search.
# ``objective="filter"`` continues from the likelihood fit to what the filter will be
# used for, the speed given the occupancies so far. It keeps the likelihood fit unless
# the new one is better on rows kept back.

law = FadeLaw(
    3,
    {
        (0, 1): (1 / 100, 4),
        (1, 0): (1 / 100, 4),
        (1, 2): (1 / 300, 4),
        (2, 1): (1 / 12, 4),
    },
)
hidden = CGOFMSModel.fit(
    before.speed,
    before.log_occupancy,
    law=law,
    n_nodes=2,
    objective="filter",
    **options,
)
training = hidden.training
scores = (
    f"{training.score_filter:.3f} for the filter, {training.score_joint:.3f} jointly"
)
print(f"kept: {training.kept} (log scores {scores})")
weights = hidden.class_weights.to_numpy()
rows = before.speed.notna().to_numpy() & np.isfinite(weights).all(axis=1)
speeds = before.speed.to_numpy()[rows] @ weights[rows] / weights[rows].sum(axis=0)
jam = int(np.argmin(speeds))
print(
    "mean speeds of the regimes: "
    + ", ".join(f"{speed:.0f}" for speed in speeds)
    + " mph"
)

# %%
# The last day, restored and forecast
# -----------------------------------
# The filters continue from the end of the learning part: each by itself, and both in a
# pool with equal weights. We compare them with a quadratic regression on the current
# occupancy and, for the forecast an hour ahead, on the occupancy an hour before.

HOUR = 12
filters = {"told": told.filter(3), "hidden": hidden.model.filter(2)}
filters["pool"] = pool_models(list(filters.values()))


def now(f):
    """Filter the last day with the bounds of 90 %."""
    f.filter(before.log_occupancy)
    result = f.filter(after.log_occupancy, resume=True, keep_nodes=True)
    return (
        result,
        result.x[:, 0],
        np.sqrt(result.P[:, 0, 0]),
        *(end[:, 0] for end in result.bounds(0.9)),
    )


def ahead(f):
    """Forecast an hour ahead at each step; row n is the forecast for time n."""
    f.filter(before.log_occupancy)
    mean, std, low, high = np.full((4, len(after)), np.nan)
    for n, z in enumerate(after.log_occupancy[:-HOUR], start=HOUR):
        f.step(z)
        found = f.forecast(HOUR)
        mean[n], std[n] = found.x[-1, 0], np.sqrt(found.P[-1, 0, 0])
        low[n], high[n] = (end[-1, 0] for end in found.bounds(0.9))
    return None, mean, std, low, high


def regression(lead):
    """Learn speed on the observation ``lead`` steps before, and apply it."""
    speed, observed = (
        before.speed.to_numpy(),
        before.log_occupancy.shift(lead).to_numpy(),
    )
    rows = np.isfinite(speed) & np.isfinite(observed)
    line = np.polynomial.Polynomial.fit(observed[rows], speed[rows], 2)
    mean = line(series.log_occupancy.shift(lead)[after.index].to_numpy())
    std = np.full(len(mean), np.std(speed[rows] - line(observed[rows])))
    return None, mean, std, mean - 1.645 * std, mean + 1.645 * std


found = {
    "now": {name: now(f) for name, f in filters.items()}
    | {"regression": regression(0)},
    "an hour ahead": {name: ahead(f) for name, f in filters.items()}
    | {"regression": regression(HOUR)},
}
truth = after.speed.to_numpy()
slow = truth < 45.0
print(f"{'':26s} RMSE  below 45 mph  90 % covers  log score")
for when, methods in found.items():
    rows = np.isfinite([truth, *(mean for _, mean, *_ in methods.values())]).all(axis=0)
    for name, (_, mean, std, low, high) in methods.items():
        error = truth - mean
        rmse, of_slow = (
            np.sqrt(np.mean(error[part] ** 2)) for part in (rows, rows & slow)
        )
        inside = np.mean((low <= truth)[rows] & (truth <= high)[rows])
        score = np.mean(
            (-0.5 * (error / std) ** 2 - np.log(std * np.sqrt(2.0 * np.pi)))[rows]
        )
        print(
            f"{when + ', ' + name:26s} {rmse:4.1f} {of_slow:13.1f}"
            f" {inside:12.0%} {score:10.2f}"
        )

# %% The bands should cover 90 %. They belong to the filter whose switch was told and,
# for the forecast, to the pool.

figure, panels = plt.subplots(
    4,
    1,
    figsize=(9, 10.5),
    sharex=True,
    layout="constrained",
    height_ratios=(2, 3, 1.5, 3),
)
time = after.index
panels[0].plot(time, np.expm1(after.log_occupancy), ".", color="0.4", markersize=4)
panels[0].set(title="Observed: occupancy", ylabel="%")
degrees = {
    "told": found["now"]["told"][0].switch_mean,
    "hidden": found["now"]["hidden"][0].class_weights[:, jam],
}
styles = {"told": (BLUE, "-"), "hidden": ("0.35", "-."), "regression": (ORANGE, "--")}
for name, values in degrees.items():
    color, line = styles[name]
    panels[2].plot(time, values, line, color=color, linewidth=1.3, label=name)
panels[2].set(title="How congested", ylim=(-0.03, 1.03), yticks=[0, 0.5, 1])
panels[2].legend(loc="upper right", frameon=False)
for panel, (when, methods) in zip(panels[[1, 3]], found.items(), strict=True):
    names = ["told" if when == "now" else "pool", "hidden", "regression"]
    panel.fill_between(time, *methods[names[0]][3:], color=BLUE, alpha=0.2, linewidth=0)
    for name, (color, line) in zip(names, styles.values(), strict=True):
        shown = np.isfinite(methods[name][1])
        panel.plot(
            time[shown],
            methods[name][1][shown],
            line,
            color=color,
            linewidth=1.3,
            label=name,
        )
    panel.plot(time, truth, ".", color=TRUTH, markersize=4, label="measured")
    panel.set(title=f"Speed, {when}", ylabel="mph", ylim=(0, 85))
    panel.legend(loc="lower right", ncols=4, frameon=False)
panels[-1].xaxis.set_major_formatter(DateFormatter("%H:%M"))
panels[-1].set_xlabel(f"{last_day:%d %B %Y}")
for panel in panels:
    panel.grid(color="0.92")
    panel.margins(x=0)
plt.show()

# %% A jam cannot be foreseen: an hour ahead nothing indicates it, and no method has a
# lower error than the regression. The switch improves the bands. The regression has the
# same width at all times. The filter is certain while traffic is free by day, and
# widens its band in a jam, which the log score rewards. The pool avoids the choice
# between filters: its estimates have the smallest error, its forecasts the best log
# score. The gain over the regression comes from the jam, and all of this is one day
# with one jam.
