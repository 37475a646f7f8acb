"""
A sensor between sun and shadow
===============================

The gain, the bias and the noise of a sensor are known in the sun and in the shadow. But
the shadow comes and goes over about twenty steps, at unknown times. In between neither
of the two Kalman filters fits, and an interacting multiple model (IMM) estimator, which
believes in one or the other, is wrong while the shadow moves. A *fuzzy* switch covers
everything in between. Such a sensor is the 2020 paper's own example.
"""

# %%
# Two filters and a law
# ---------------------
# The state is a temperature, relative to its mean, and a constant one. The constant
# carries the bias of the sensor in the shadow, since ``H`` has no offset of its own.

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import FadeLaw, KalmanFilter, SwitchingKalmanFilter, SwitchingStateSpace
from fuzzykf.plotting import BLUE, ORANGE, TRUTH


def sensor(gain, bias, noise):
    """Make the Kalman filter of a sensor: gain * temperature + bias + noise."""
    return KalmanFilter(
        dim_x=2,
        dim_z=1,
        F=np.diag([0.95, 1.0]),
        Q=np.diag([0.3**2, 0.0]),
        H=[[gain, bias]],
        R=noise**2,
        x=[0.0, 1.0],
        P=np.diag([0.92, 0.0]),
    )


sun, shadow = sensor(1.0, 0.0, 0.2), sensor(0.4, 2.0, 0.6)
model = SwitchingStateSpace.from_filters(
    [sun, shadow], FadeLaw.between(60, 20), mix="log"
)
fuzzy = SwitchingKalmanFilter(model)
for z in (-0.3, -0.2, 0.1):
    fuzzy.step(z)
    print(f"temperature {fuzzy.x[0, 0]:.2f} K, shadow {fuzzy.class_weights[1]:.2f}")

# %% That is all: ``FadeLaw.between(60, 20)`` says that sun and shadow last 60 steps
# each, on average, and that a change takes 20 steps. Neither number needs to be exact.
# With ``mix="log"`` the noise grows by the same percentage in each step. If some
# changes are abrupt, let some of the departures be jumps:

law = FadeLaw.between(60, 20, jump=0.005)
DWELL, STEPS, RUNS = 60, 300, 20


def fuzzy_filter(pair):
    """Make the filter of the fuzzy switch."""
    return SwitchingKalmanFilter(SwitchingStateSpace.from_filters(pair, law, mix="log"))


def imm_filter(pair, length):
    """Make the IMM estimator of the hard switch, that knows how often it switches."""
    p = 1.0 / (DWELL + length)
    return SwitchingKalmanFilter(
        SwitchingStateSpace.from_filters(pair, [[1.0 - p, p], [p, 1.0 - p]])
    )


def halfway(pair):
    """Make one Kalman filter, of a sensor that is always half in the shadow."""
    H, R = seen(pair, np.array([0.5]))
    return sensor(*H[0, 0], np.sqrt(R.item()))


def seen(pair, r):
    """Compute H and R, (n, 1, 2) and (n, 1, 1), for so much shadow (n,)."""
    a, b = pair
    r = r[:, None, None]
    return (1.0 - r) * a.H + r * b.H, a.R ** (1.0 - r) * b.R**r


# %%
# What happens
# ------------
# The shadow of these series does not follow the law: it stays for a random time, then
# moves evenly.


def shadows(length, rng):
    """Draw the amount of shadow (steps,): stays, with ramps between them."""
    up, pieces, k = np.arange(1, length + 1) / length, [], int(rng.integers(2))
    while sum(map(len, pieces)) < 3 * STEPS:
        pieces += [
            np.full(rng.geometric(1.0 / DWELL), float(k)),
            up if k == 0 else 1.0 - up,
        ]
        k = 1 - k
    return np.concatenate(pieces)[2 * STEPS : 3 * STEPS]


def series(pair, length, rng):
    """Draw temperatures, what the sensor shows, and the shadow, (steps,) each."""
    r, x = shadows(length, rng), np.sqrt(0.92) * rng.standard_normal(STEPS)
    for n in range(1, STEPS):
        x[n] = 0.95 * x[n - 1] + 0.3 * rng.standard_normal()
    H, R = seen(pair, r)
    noise = np.sqrt(R[:, 0, 0]) * rng.standard_normal(STEPS)
    return x, H[:, 0, 0] * x + H[:, 0, 1] + noise, r


def filters(pair, length):
    """Make all filters, by name."""
    return {
        "fuzzy": fuzzy_filter(pair),
        "hard IMM": imm_filter(pair, length),
        "one Kalman filter": halfway(pair),
    }


def estimates_of(f, ys):
    """Estimate the temperatures (runs, steps) of many series."""
    return f.filter_many(ys, keep=("x",)).x[:, :, 0].reshape(len(ys), STEPS)


def draw(pair, length, rng):
    """Draw many temperatures, readings and shadows, (runs, steps) each."""
    return [
        np.stack(part)
        for part in zip(*(series(pair, length, rng) for _ in range(RUNS)), strict=True)
    ]


rng = np.random.default_rng(4)
runs = draw((sun, shadow), 20, rng)
missed = np.mean(
    (estimates_of(imm_filter((sun, shadow), 20), runs[1]) - runs[0]) ** 2, axis=1
)
x, y, r = (part[np.argsort(missed)[RUNS // 2]] for part in runs)
results = {name: f.filter(y) for name, f in filters((sun, shadow), 20).items()}

# %% This is the median of twenty runs by the error of IMM. While the shadow moves, IMM
# takes it for sun or for full shadow, and attributes the difference to the temperature.
# When a fade begins, the fuzzy switch cannot tell a little shade from a little warmth
# either, but its errors are smaller and shorter. The bands should cover 90 %.

figure, panels = plt.subplots(
    5,
    1,
    figsize=(9, 11),
    sharex=True,
    layout="constrained",
    height_ratios=(3, 2, 3, 3, 3),
)
panels[0].plot(y, ".", color="0.5", markersize=4, label="sensor")
panels[0].plot(x, color=TRUTH, linewidth=1, label="temperature")
panels[0].set(title="The series", ylabel="K")
panels[1].fill_between(range(STEPS), r, color="0.85", label="true")
styles = {
    "fuzzy": (BLUE, "-"),
    "hard IMM": (ORANGE, "--"),
    "one Kalman filter": ("0.35", "-."),
}
for name in ("hard IMM", "fuzzy"):
    color, line = styles[name]
    panels[1].plot(
        results[name].class_weights[:, 1], line, color=color, linewidth=1.4, label=name
    )
panels[1].set(title="The shadow", ylim=(-0.03, 1.03), yticks=[0, 0.5, 1])
for panel, (name, result) in zip(panels[2:], results.items(), strict=True):
    color, line = styles[name]
    deviation = 1.645 * np.sqrt(result.P[:, 0, 0])
    estimate = result.x[:, 0].ravel()
    panel.fill_between(
        range(STEPS),
        estimate - deviation,
        estimate + deviation,
        color=color,
        alpha=0.25,
        linewidth=0,
    )
    panel.plot(x, color=TRUTH, linewidth=1, label="true")
    panel.plot(estimate, line, color=color, linewidth=1.4, label=name)
    inside = np.mean(np.abs(estimate - x) <= deviation)
    error = np.mean((estimate - x) ** 2)
    panel.set(
        title=f"{name}: mean squared error {error:.2f}, {inside:.0%} in the band",
        ylabel="K",
    )
    panel.sharey(panels[2])
for panel in panels:
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    panel.grid(color="0.92")
    panel.margins(x=0)
panels[-1].set_xlabel("step")
plt.show()

# %%
# Twenty runs, and where it does not help
# ---------------------------------------
# Mean squared errors, with a bound on either side: the mean temperature, which needs no
# sensor, and the Kalman filter that is told the shadow. Besides the sensor above there
# is the same one with a shadow that comes in a single step, and one of which only the
# noise fades, from 0.3 to 3.


def with_shadow(pair, y, r):
    """Estimate temperatures (steps,) with the Kalman filter that is told the shadow."""
    H, R = seen(pair, r)
    means, *_ = halfway(pair).batch_filter(y, Hs=H, Rs=R)
    return means[:, 0].ravel()


def squares(pair, length, runs):
    """Compute the mean squared errors (runs,) of all filters, by name."""
    truth, ys, rs = runs
    estimates = {"no filter": np.zeros_like(truth)}
    estimates |= {
        name: estimates_of(f, ys) for name, f in filters(pair, length).items()
    }
    estimates["shadow known"] = np.stack(
        [with_shadow(pair, y, r) for y, r in zip(ys, rs, strict=True)]
    )
    return {
        name: np.mean((found - truth) ** 2, axis=1) for name, found in estimates.items()
    }


noisy = sensor(1.0, 0.0, 0.3), sensor(1.0, 0.0, 3.0)
table = {
    "sensor, 20 steps": squares((sun, shadow), 20, runs),
    "at once": squares((sun, shadow), 1, draw((sun, shadow), 1, rng)),
    "noise, 20 steps": squares(noisy, 20, draw(noisy, 20, rng)),
}
print(f"{'':19s}" + "".join(f"{name:>20s}" for name in table))
for name in table["at once"]:
    columns = (errors[name] for errors in table.values())
    cells = (f"{e.mean():.3f} +- {e.std(ddof=1) / np.sqrt(RUNS):.3f}" for e in columns)
    print(f"{name:19s}" + "".join(f"{cell:>20s}" for cell in cells))

# %% Where the sensor fades, the fuzzy switch has about half the error of IMM. Where the
# shadow comes in one step, the hard switch is right, and the fuzzy one pays for its
# wrong law. Where only the noise fades there is little to gain: even the filter that
# knows the shadow is hardly better. A single Kalman filter does not help, since its
# bias is wrong in either light: where that matters, it is worse than no sensor at all.
