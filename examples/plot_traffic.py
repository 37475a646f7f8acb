"""
Speed on a road, from occupancy
===============================

Two sensors at one lane: one tells for how much of the time a vehicle stood over it (the occupancy), the other
one how fast they were. The second one fails. While traffic is free the speed hardly depends on the occupancy;
in a jam it does, and jams come and go. The 2020 paper ends with this application. Here the data are two weeks
of a road sensor in Minnesota, about every five minutes, with gaps.

The file is not part of the package: set the environment variable ``FUZZYKF_DATA`` to the folder that holds
``traffic_t4013.csv``, speed and occupancy of sensor T4013 of the Minnesota Department of Transportation, as
the Numenta Anomaly Benchmark has them.
"""

# %%
# A grid of five minutes
# ----------------------
# Rows come after 5 minutes, or 10, 15, 25. On a grid of five minutes all steps are of one length, as a model
# wants them, and what is missing is missing: NaN. The logarithm of the occupancy is what is observed.

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
    f"{len(series)} rows, {series.speed.isna().sum()} of them gaps; {after.speed.count()} speeds to restore"
)

# %%
# A switch that is told
# ---------------------
# As long as the speed is measured we may say what a jam is: free above 58 mph, congested below 33, and
# between these to a degree. That is the fuzzy switch, on the part that is learned on.

degree = ((58.0 - before.speed) / 25.0).clip(0.0, 1.0)
options = {"form": "regression", "tolerance": 1e-4, "progress": False}
told = CGOFMSModel.fit(before.speed, before.log_occupancy, degree, law="fmc1", n_nodes=3, **options).model

# %%
# A switch that nobody tells
# --------------------------
# Or the regimes are found. Of two, one takes the nights and one the days; so there are three, a jam is
# entered from the second one, and they *fade*, within twenty minutes or so. All numbers of the law are only
# where the search begins. ``objective="filter"`` goes on from the likelihood to what the filter will be asked
# for, the speed given the occupancies so far, and comes back unless rows kept back say that it is better.

law = FadeLaw(3, {(0, 1): (1 / 100, 4), (1, 0): (1 / 100, 4), (1, 2): (1 / 300, 4), (2, 1): (1 / 12, 4)})
hidden = CGOFMSModel.fit(
    before.speed, before.log_occupancy, law=law, n_nodes=2, objective="filter", **options
)
training = hidden.training
scores = f"log score {training.score_filter:.3f} for the filter, {training.score_joint:.3f} jointly"
print(f"kept: {training.kept} ({scores})")
weights = hidden.class_weights.to_numpy()
rows = before.speed.notna().to_numpy() & np.isfinite(weights).all(axis=1)
speeds = before.speed.to_numpy()[rows] @ weights[rows] / weights[rows].sum(axis=0)
jam = int(np.argmin(speeds))
print("mean speeds of the regimes: " + ", ".join(f"{speed:.0f}" for speed in speeds) + " mph")

# %%
# The last day, restored and forecast
# -----------------------------------
# Filters go on from the end of the part that was learned on: each by itself, and both in a pool, in which
# they have equal weights. Beside them stands a quadratic regression on the occupancy of the same moment and,
# for the forecast an hour ahead, on that of an hour before.

HOUR = 12
filters = {"told": told.filter(3), "hidden": hidden.model.filter(2)}
filters["pool"] = pool_models(list(filters.values()))


def now(f):
    """Filter the last day with the bounds of 90 %."""
    f.filter(before.log_occupancy)
    result = f.filter(after.log_occupancy, resume=True, keep_nodes=True)
    return result, result.x[:, 0], np.sqrt(result.P[:, 0, 0]), *(end[:, 0] for end in result.bounds(0.9))


def ahead(f):
    """Forecast an hour ahead, at each step; what is returned is in place where it is meant for."""
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
    speed, observed = before.speed.to_numpy(), before.log_occupancy.shift(lead).to_numpy()
    rows = np.isfinite(speed) & np.isfinite(observed)
    line = np.polynomial.Polynomial.fit(observed[rows], speed[rows], 2)
    mean = line(series.log_occupancy.shift(lead)[after.index].to_numpy())
    std = np.full(len(mean), np.std(speed[rows] - line(observed[rows])))
    return None, mean, std, mean - 1.645 * std, mean + 1.645 * std


found = {
    "now": {name: now(f) for name, f in filters.items()} | {"regression": regression(0)},
    "an hour ahead": {name: ahead(f) for name, f in filters.items()} | {"regression": regression(HOUR)},
}
truth = after.speed.to_numpy()
slow = truth < 45.0
print(f"{'':26s} RMSE  below 45 mph  90 % covers  log score")
for when, methods in found.items():
    rows = np.isfinite([truth, *(mean for _, mean, *_ in methods.values())]).all(axis=0)
    for name, (_, mean, std, low, high) in methods.items():
        error = truth - mean
        rmse, of_slow = (np.sqrt(np.mean(error[part] ** 2)) for part in (rows, rows & slow))
        inside = np.mean((low <= truth)[rows] & (truth <= high)[rows])
        score = np.mean((-0.5 * (error / std) ** 2 - np.log(std * np.sqrt(2.0 * np.pi)))[rows])
        print(f"{when + ', ' + name:26s} {rmse:4.1f} {of_slow:13.1f} {inside:12.0%} {score:10.2f}")

# %%
# The bands are meant for 90 %: those of the filter whose switch was told, and for the forecast of the pool.

figure, panels = plt.subplots(
    4, 1, figsize=(9, 10.5), sharex=True, layout="constrained", height_ratios=(2, 3, 1.5, 3)
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
        panel.plot(time[shown], methods[name][1][shown], line, color=color, linewidth=1.3, label=name)
    panel.plot(time, truth, ".", color=TRUTH, markersize=4, label="measured")
    panel.set(title=f"Speed, {when}", ylabel="mph", ylim=(0, 85))
    panel.legend(loc="lower right", ncols=4, frameon=False)
panels[-1].xaxis.set_major_formatter(DateFormatter("%H:%M"))
panels[-1].set_xlabel(f"{last_day:%d %B %Y}")
for panel in panels:
    panel.grid(color="0.92")
    panel.margins(x=0)
plt.show()

# %%
# A jam comes unforeseen: an hour before, nobody says anything of it, and no error is below that of the
# regression. What the switch is worth is in the bands. The regression has one width for all times; the filter
# is sure while traffic is free by day, widens its band in a jam, and the log score rewards that. The pool
# needs nobody to choose: of the estimates its error is the least, of the forecasts its log score the best.
# The gain of the estimates over the regression is made in the jam, and all this is one day with one jam.
