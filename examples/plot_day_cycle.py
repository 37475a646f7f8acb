"""
A cycle of four classes
=======================

A day goes from night to morning, day and evening, and from each to the next one gradually. The demand
for electricity follows, and only the temperature is observed. The switch is a *fade law* on a ring of
four classes; what the filter knows of it are *class weights*, the expected share of each class.
"""

# %%
# The law
# -------
# Steps are quarters of an hour. Each arrow shows the rate at which the fade begins and
# its mean number of steps; with the dwells in the four classes they add up to 24 hours.

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import CGOFMSModel, FadeLaw, KnownSwitchFilter
from fuzzykf.plotting import BLUE, ORANGE, TRUTH, plot_path

CLASSES = ["night", "morning", "day", "evening"]
law = FadeLaw(
    4,
    {(0, 1): (1 / 26, 8), (1, 2): (1 / 8, 6), (2, 3): (1 / 24, 8), (3, 0): (1 / 10, 6)},
)
law.plot()
plt.show()

# %%
# The model
# ---------
# Demand (GW) and temperature (°C) have a mean in each class, and the same spread in
# all. Between classes the means are interpolated.

means = [[4.0, 10.0], [8.0, 13.0], [6.0, 20.0], [9.0, 16.0]]
z = np.array([[0.5, 0.4], [0.4, 1.0]])
pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
model = CGOFMSModel(law, means, np.broadcast_to(pair, (4, 4, 4, 4)), dim_x=1)
axes = model.plot(labels=("demand", "temperature"), units=("GW", "°C"))
axes.set_xticks(range(4), CLASSES)
plt.show()

# %%
# Two days
# --------
# The filter sees only temperatures. Below the estimate are the true class weights, then
# the estimated ones. The areas fill the height, since weights sum to one.

truth = model.simulate(192, np.random.default_rng(15))
result = model.filter().filter(truth.y)
figure, panels = plt.subplots(
    3, 1, figsize=(9, 8), sharex=True, layout="constrained", height_ratios=(3, 2, 2)
)
hard = model.harden().filter().filter(truth.y)
panels[0].plot(truth.x[:, 0], color=TRUTH, linewidth=1, label="true")
panels[0].plot(
    hard.x[:, 0],
    color=ORANGE,
    linewidth=1.2,
    linestyle=(0, (4, 1.5)),
    label="hard filter",
)
panels[0].plot(result.x[:, 0], color=BLUE, linewidth=1.8, label="fuzzy filter")
panels[0].set(ylabel="demand (GW)", title="state")
panels[0].legend(ncols=3, loc="lower right")
panels[0].grid(color="0.9")
panels[0].margins(x=0)
for panel, weights, title in zip(
    panels[1:], (truth.r, result.class_weights), ("true", "found"), strict=True
):
    plot_path(weights, panel)
    panel.set(title=f"class weights, {title}", xlabel="")
    panel.get_legend().remove()
panels[2].set_xlabel("step of a quarter of an hour")
areas = panels[1].collections
figure.legend(areas, CLASSES, loc="outside lower center", ncols=4, frameon=False)
plt.show()

# %%
# The picture of a result has the same areas at its foot.

result.plot(truth=truth.x, label="demand", unit="GW")
plt.show()

# %%
# What the fades are worth
# ------------------------
# Errors over twenty series of five days, for three filters: the fuzzy filter, the
# filter of the hardened model, which has the same cycle with abrupt switches, and a
# filter that is told the class weights.

days = [model.simulate(480, np.random.default_rng(seed)) for seed in range(20)]
x, y, r = (np.stack([getattr(one, name) for one in days]) for name in ("x", "y", "r"))
found = {
    "fuzzy": model.filter().filter_many(y),
    "hard": model.harden().filter().filter_many(y),
    "known": KnownSwitchFilter(model).filter_many(y, r=r),
}
print("mean squared error of the demand")
for name, many in found.items():
    errors = np.mean((many.x - x) ** 2, axis=(1, 2))
    print(f"{name:6s} {errors.mean():.3f} +- {errors.std() / np.sqrt(len(errors)):.3f}")
