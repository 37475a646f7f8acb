"""
A vehicle that eases into bends
===============================

Roads do not jump from straight to bent: between the two lies a clothoid, along which
the curvature grows evenly. A tracker with two modes, straight and bent, believes in one
or the other while the clothoid lasts. A fuzzy switch covers everything in between. This
example learns the noise of receiver and motion, and how long bends last and how gently
they begin, from the measured positions of a single drive. It then filters other drives
with what it has learned.
"""

# %%
# The model
# ---------
# The state is position and velocity in metres and metres per second, (east, v east,
# north, v north), and a step is one second. In a bend the velocity turns by 9 degrees
# per second; at 15 m/s the radius is 95 m. In between it turns by less: the transition
# is a *function* of the class weights, since a mixture of two rotations is not a
# rotation.

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import (
    FadeLaw,
    KalmanFilter,
    KnownSwitchFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.plotting import BLUE, ORANGE, TRUTH

RATE, SPEED, STEPS, RUNS = np.deg2rad(9.0), 15.0, 200, 20


def turning(rate):
    """Make the transition of one second at a constant turn rate, in radians/second."""
    cosine, sine = np.cos(rate), np.sin(rate)
    along, across = np.sinc(rate / np.pi), 0.5 * rate * np.sinc(0.5 * rate / np.pi) ** 2
    return np.array(
        [
            [1.0, along, 0.0, -across],
            [0.0, cosine, 0.0, -sine],
            [0.0, across, 1.0, along],
            [0.0, sine, 0.0, cosine],
        ]
    )


def drives(law):
    """Make the model of all drives: the law of its switch, and a guess of the noise."""
    return SwitchingStateSpace(
        law,
        F=lambda weights: turning(RATE * weights[1]),
        H=np.eye(4)[[0, 2]],
        Q=PUSH,
        R=np.diag([9.0, 9.0]),
        x0=[0.0, SPEED, 0.0, 0.0],
        P0=np.diag([100.0, 4.0, 100.0, 4.0]),
    )


PUSH = np.kron(
    np.eye(2), np.outer([0.5, 1.0], [0.5, 1.0])
)  # of an acceleration of 1 m/s^2

# %%
# The drives
# ----------
# The drives do not follow the law: straights and bends last for a random time each, the
# clothoids between them for 20 seconds. The receiver errs by 2 m, the accelerations are
# of 0.2 m/s^2.


def drive(steps, length, rng):
    """Draw states (steps, 4), measured positions (steps, 2), and the bend (steps,)."""
    up, pieces, k = np.arange(1, length + 1) / length, [], 0
    while sum(map(len, pieces)) < steps:
        pieces += [
            np.full(5 + rng.geometric(1.0 / 40.0), float(k)),
            up if k == 0 else 1.0 - up,
        ]
        k = 1 - k
    bent = np.concatenate(pieces)[:steps]
    x = np.zeros((steps, 4))
    x[0] = 0.0, SPEED, 0.0, 0.0
    for n in range(1, steps):
        push = np.kron(0.2 * rng.standard_normal(2), [0.5, 1.0])
        x[n] = turning(RATE * bent[n]) @ x[n - 1] + push
    return x, x[:, [0, 2]] + 2.0 * rng.standard_normal((steps, 2)), bent


# %%
# Learning from one drive
# -----------------------
# ``free`` says what to learn: the law, the size of the accelerations, and the noise of
# both coordinates. Everything else is fixed.

rng = np.random.default_rng(1)
_, lesson, _ = drive(1500, 20, rng)
free = {"Q": ("scale", PUSH), "R": "diagonal", "law": True}
fuzzy_fit = drives(FadeLaw.between(60, 10)).fit(lesson, free=free)
hard_fit = drives(np.array([[0.98, 0.02], [0.02, 0.98]])).fit(lesson, free=free)
print(fuzzy_fit.summary())

# %% The true clothoids last 20 seconds, the true variances are 0.04 and 4, and a
# straight or a bend lasts 45 seconds. ``hard_fit`` must explain the clothoids by jumps,
# and therefore leaves a class more often.
#
# Other drives
# ------------
# The rivals are a single Kalman filter whose noise is learned from the same drive, and
# the hard switch. The bound is the filter that is told how bent the road is.

start = KalmanFilter(
    4,
    2,
    x=[0.0, SPEED, 0.0, 0.0],
    P=np.diag([100.0, 4.0, 100.0, 4.0]),
    R=np.diag([9.0, 9.0]),
)
start.F, start.H, start.Q = turning(0.0), np.eye(4)[[0, 2]], PUSH
single = start.fit(lesson, free={"Q": ("scale", PUSH), "R": "diagonal"}).model

FILTERS = {
    "fuzzy, learned": SwitchingKalmanFilter(fuzzy_fit.model),
    "hard, learned": SwitchingKalmanFilter(hard_fit.model),
    "one Kalman filter": single,
}
known = KnownSwitchFilter(fuzzy_fit.model)


def estimates(y, bent):
    """Estimate the states (steps, 4) of a drive by all filters, by name."""
    found = {
        "no filter": np.stack(
            [y[:, 0], np.gradient(y[:, 0]), y[:, 1], np.gradient(y[:, 1])], axis=1
        )
    }
    for name, f in FILTERS.items():
        f.reset()
        found[name] = f.filter(y).x.reshape(len(y), 4)
    return found | {"bend known": known.filter(y, bent).x}


tests = {length: [drive(STEPS, length, rng) for _ in range(RUNS)] for length in (20, 1)}
errors = {}
for length, runs in tests.items():
    for x, y, bent in runs:
        for name, found in estimates(y, bent).items():
            off = (found - x)[5:] ** 2
            errors.setdefault((length, name), []).append(
                (off[:, [0, 2]].sum(1).mean(), off[:, [1, 3]].sum(1).mean())
            )
print(f"{'mean squared error of':22s}{'position, m^2':>30s}{'velocity, m^2/s^2':>32s}")
print(f"{'clothoids of':22s}" + 2 * f"{'20 s':>18s}{'at once':>14s}")
for name in estimates(*tests[1][0][1:]):
    cells = [
        np.array(errors[length, name])[:, what] for what in (0, 1) for length in (20, 1)
    ]
    texts = [f"{e.mean():.2f} +- {e.std(ddof=1) / np.sqrt(RUNS):.2f}" for e in cells]
    print(f"{name:22s}{texts[0]:>18s}{texts[1]:>14s}{texts[2]:>18s}{texts[3]:>14s}")

# %% On clothoids the fuzzy switch has half the velocity error of the hard one, and
# comes closest to the filter that is told the bend. If bends begin abruptly, the
# learned law is wrong and the hard switch is better: learn from drives like those that
# you want to filter. A single Kalman filter takes bends for accelerations, and its
# velocities are worse than differences of the raw positions.
#
# The drive in the middle, by the error of the hard switch:

middle = np.argsort([e[1] for e in errors[20, "hard, learned"]])[RUNS // 2]
x, y, bent = tests[20][middle]
found = estimates(y, bent)
fuzzy = FILTERS["fuzzy, learned"].filter(y)
hard = FILTERS["hard, learned"].filter(y)

figure, (road, curve, speed) = plt.subplots(
    3, 1, figsize=(9, 10), layout="constrained", height_ratios=(3, 2, 2)
)
road.plot(y[:, 0], y[:, 1], ".", color="0.6", markersize=3, label="measured")
road.plot(x[:, 0], x[:, 2], color=TRUTH, linewidth=1, label="true")
road.plot(
    *found["fuzzy, learned"][:, [0, 2]].T,
    color=BLUE,
    linewidth=1.2,
    label="fuzzy, learned",
)
road.set(title="The road", xlabel="east, m", ylabel="north, m", aspect="equal")
curve.fill_between(range(STEPS), 9.0 * bent, color="0.85", label="true")
curve.plot(9.0 * fuzzy.class_weights[:, 1], color=BLUE, label="fuzzy, learned")
curve.plot(9.0 * hard.class_weights[:, 1], "--", color=ORANGE, label="hard, learned")
curve.set(title="The rate of turn", ylabel="degrees a second")
for name, color, line in (
    ("fuzzy, learned", BLUE, "-"),
    ("hard, learned", ORANGE, "--"),
    ("one Kalman filter", "0.35", "-."),
):
    off = np.hypot(*(found[name] - x)[:, [1, 3]].T)
    speed.plot(
        off,
        line,
        color=color,
        linewidth=1.2,
        label=f"{name}, root mean square {np.sqrt((off[5:] ** 2).mean()):.2f}",
    )
speed.set(
    title="The error of the velocity", xlabel="second", ylabel="m/s", ylim=(0, None)
)
for panel in (road, curve, speed):
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    panel.grid(color="0.92")
plt.show()
