r"""
A rocket behind an altimeter with outliers
==========================================

Section 5 of Layne and Passino (2001): a rocket climbs for 200 seconds, and every 20
seconds an altimeter measures its altitude with Cauchy noise.  Altitude and velocity
are estimated by the fuzzy estimator, whose memberships are those of the noise, and by
the extended Kalman filter, for which a Cauchy law is a Gaussian law of the same scale.

Gravity falls with the square of the distance from the centre of the earth and drag
acts against the motion; the paper prints both otherwise.  Set ``PRINTED`` to see its
version.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import (
    CauchyMembership,
    ExtendedKalmanFilter,
    FuzzyRelationEstimator,
    SingletonMembership,
)
from fuzzykf.errors import SupportWarning
from fuzzykf.plotting import BLUE, ORANGE, TRUTH

PRINTED = False

STEP, STEPS, EVERY = 2.0, 100, 10  # s, steps, a measurement every so many of them
SCALE_W, SCALE_V = (
    15.0,
    1000.0,
)  # scales of the noises of velocity (m/s) and altimeter (m)
MASS, FUEL, EXHAUST = 20100.0, 100.0, 4000.0  # kg, kg/s, m/s
GRAVITY, RADIUS, DRAG = 9.8, 6.37e6, 0.5 * 1.21 * 0.3  # m/s^2, m, kg/m


# %%
# The dynamics: an Euler step of two seconds, with noise on the velocity.


def climb(x, k):
    """Move (altitude, velocity), shape (..., 2), from step k to k + 1."""
    h, v = x[..., 0], x[..., 1]
    mass = MASS - FUEL * STEP * k
    if PRINTED:
        pull, drag = GRAVITY * RADIUS / (RADIUS + h), DRAG * v**2
    else:
        pull, drag = GRAVITY * (RADIUS / (RADIUS + h)) ** 2, DRAG * v * np.abs(v)
    return np.stack(
        [h + STEP * v, v + STEP * (EXHAUST * FUEL / mass - pull - drag / mass)], axis=-1
    )


# %% A launch. The noise of the velocity is truncated at its scale, like its membership
# below; the noise of the altimeter is unbounded.


def launch(rng):
    """Draw states (steps, 2) and what the altimeter shows (steps,)."""
    states, x = np.empty((STEPS, 2)), np.zeros(2)
    for k in range(STEPS):
        x = climb(x, k)
        x[1] += SCALE_W * np.tan(0.5 * np.pi * (rng.random() - 0.5))
        states[k] = x
    return states, states[:, 0] + SCALE_V * rng.standard_cauchy(STEPS)


# %% Both estimators know the same: where the rocket started, and the noise.


def estimators():
    """Make a fuzzy estimator and an extended Kalman filter."""
    fuzzy = FuzzyRelationEstimator(
        2,
        1,
        fx=climb,
        hx=lambda x: x[..., :1],
        state=SingletonMembership([0.0, 0.0]),
        process_noise=[None, CauchyMembership(0.0, SCALE_W).cut((-SCALE_W, SCALE_W))],
        measurement_noise=CauchyMembership(0.0, SCALE_V),
        points=101,
        on_empty="keep",
    )
    extended = ExtendedKalmanFilter(
        2,
        1,
        fx=climb,
        hx=lambda x: x[:1],
        x=np.zeros(2),
        P=np.zeros((2, 2)),
        Q=np.diag([0.0, SCALE_W**2]),
        R=[[SCALE_V**2]],
    )
    return {"fuzzy": fuzzy, "EKF": extended}


SHOWN = (29, 59, 99)  # steps at which the membership is drawn


def follow(altimeter):
    """Return the estimates (steps, 2) of both, and the membership at some steps."""
    both, memberships = estimators(), {}
    estimates = {name: np.empty((STEPS, 2)) for name in both}
    for k in range(STEPS):
        for name, estimator in both.items():
            estimator.predict(k=k)
            if (k + 1) % EVERY == 0:
                estimator.update(altimeter[k])
            estimates[name][k] = estimator.x.ravel()
        if k in SHOWN:
            memberships[k] = both["fuzzy"].membership
    return estimates, memberships


# %%
# Twelve launches.

rng = np.random.default_rng(0)
launches = [launch(rng) for _ in range(12)]
with warnings.catch_warnings():
    warnings.simplefilter(
        "ignore", SupportWarning
    )  # an outlier may lie beyond the live region
    followed = [follow(altimeter) for _, altimeter in launches]
errors = {
    name: np.array(
        [
            np.sqrt(np.mean((estimates[name] - states) ** 2, axis=0))
            for (states, _), (estimates, _) in zip(launches, followed, strict=True)
        ]
    )
    for name in ("fuzzy", "EKF")
}
for name, error in errors.items():
    low, middle, high = np.percentile(error[:, 0], [25, 50, 75])
    print(
        f"{name:6s} error of the altitude: median {middle:.0f} m, "
        f"quartiles {low:.0f} and {high:.0f} m"
    )
wins = int((errors["fuzzy"][:, 0] < errors["EKF"][:, 0]).sum())
print(f"The fuzzy estimator errs less in {wins} of {len(launches)} launches.")

# %% The picture shows the median launch by the error of the extended Kalman filter. An
# outlier of the altimeter pulls that filter along. The fuzzy estimator does not follow
# it: states that the dynamics cannot reach are impossible, whatever the altimeter says.

middle = int(np.argsort(errors["EKF"][:, 0])[len(launches) // 2])
(states, altimeter), (estimates, memberships) = launches[middle], followed[middle]
time = STEP * (np.arange(STEPS) + 1)
measured = (np.arange(STEPS) + 1) % EVERY == 0
figure, axes = plt.subplots(3, 1, figsize=(8.0, 7.0), sharex=True, layout="constrained")
axes[0].plot(time, 1e-3 * states[:, 0], color=TRUTH, label="true")
axes[0].plot(
    time[measured], 1e-3 * altimeter[measured], "x", color="0.4", label="altimeter"
)
axes[0].set_ylabel("altitude (km)")
for axis, component, scale, label in (
    (axes[1], 0, 1e-3, "error of the altitude (km)"),
    (axes[2], 1, 1.0, "error of the velocity (m/s)"),
):
    off = {
        name: scale * (estimate - states)[:, component]
        for name, estimate in estimates.items()
    }
    axis.axhline(0.0, color=TRUTH, linewidth=0.8)
    axis.plot(time, off["EKF"], "--", color=ORANGE, label="extended Kalman filter")
    axis.plot(time, off["fuzzy"], color=BLUE, label="fuzzy estimator")
    axis.set_ylabel(label)
for axis in axes:
    axis.grid(color="0.9")
axes[0].legend()
axes[1].legend()
axes[2].set_xlabel("time (s)")
plt.show()

# %% The membership moves with the rocket: the estimator keeps only the region that is
# possible.

figure, axes = plt.subplots(1, len(SHOWN), figsize=(9.0, 3.2), layout="constrained")
for axis, k in zip(axes, SHOWN, strict=True):
    grid = memberships[k]
    altitude, velocity = grid.axes
    image = axis.pcolormesh(
        1e-3 * altitude, velocity, grid.values.T, cmap="viridis", vmin=0.0, vmax=1.0
    )
    axis.plot(
        1e-3 * states[k, 0], states[k, 1], "x", color="white", markeredgewidth=2.0
    )
    axis.set(title=f"{time[k]:.0f} s (cross: true)", xlabel="altitude (km)")
axes[0].set_ylabel("velocity (m/s)")
figure.colorbar(image, ax=axes, label="membership")
plt.show()
