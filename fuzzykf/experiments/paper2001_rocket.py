"""Tables 5 and 6 of the 2001 paper: a rocket under Cauchy noises.

J. R. Layne, K. M. Passino, Fuzzy Sets and Systems 122 (2001), section 5: altitude and
velocity from an altimeter, every 20 of 200 seconds, by Euler steps of 2 seconds.  The
printed dynamics (90) are used here; the theory pages tell what is wrong with them.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Literal

import numpy as np

from fuzzykf.errors import SupportWarning
from fuzzykf.experiments.core import Experiment, new_figure
from fuzzykf.experiments.verdicts import Finding, measured, printed_sample, printed_wins, wins_claim
from fuzzykf.kalman import ExtendedKalmanFilter
from fuzzykf.plotting import BLUE, ORANGE
from fuzzykf.possibility import CauchyMembership, FuzzyRelationEstimator, SingletonMembership

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from fuzzykf.arrays import FloatArray
    from fuzzykf.base import Filter
    from fuzzykf.experiments.core import Samples

__all__ = ["ROCKET", "dynamics", "jacobian", "launch"]

Noise = Literal["cut", "measurement", "both"]

#: Step (s), initial mass (kg), fuel per second (kg/s), gravity (m/s²), radius of the earth (m),
#: ½ ρ A C_d (kg/m), velocity of the exhaust gases (m/s).
_T, _MASS, _FUEL, _G0, _RADIUS, _DRAG, _EXHAUST = 2.0, 20100.0, 100.0, 9.8, 6.37e6, 0.5 * 1.21 * 0.3, 4000.0

_STEPS, _EVERY = 100, 10

#: Scales of the Cauchy noises: of the velocity (m/s), of the altimeter (m).
_SCALE_W, _SCALE_V = 15.0, 1000.0

#: A launch whose velocity leaves this range (m/s), the universe of the paper, is drawn again.
_VELOCITIES = (0.0, 2000.0)

# fmt: off
#: Printed energies of fifteen launches: altitude and velocity, by the EKF and the fuzzy estimator.
PRINTED = {
    "altitude": (
        (1.1069e9, 3.2948e9, 0.7444e9, 0.8057e9, 0.6832e9, 0.9067e9, 1.0646e9, 2.5950e9,
         3.5383e9, 4.8707e9, 0.6368e9, 1.9402e9, 0.1577e9, 0.8353e9, 4.1994e9),
        (0.2710e9, 0.5430e9, 0.7550e9, 0.3737e9, 0.2153e9, 0.2388e9, 0.2078e9, 1.4402e9,
         1.0915e9, 0.4013e9, 0.1299e9, 0.4322e9, 0.0267e9, 0.2032e9, 0.7887e9),
    ),
    "velocity": (
        (0.3771e7, 0.4791e7, 0.5573e7, 0.4758e7, 0.1169e7, 0.1536e7, 0.1538e7, 3.3999e7,
         0.1945e7, 0.4445e7, 0.1680e7, 0.2024e7, 0.0514e7, 0.1828e7, 0.4466e7),
        # The eighth is printed without its exponent.
        (0.3622e7, 0.4683e7, 0.6107e7, 0.4737e7, 0.1167e7, 0.1698e7, 0.1526e7, 3.4159e7,
         0.1416e7, 0.4262e7, 0.1815e7, 0.1959e7, 0.0542e7, 0.1815e7, 0.4410e7),
    ),
}
# fmt: on

_NOISES: dict[Noise, str] = {
    "cut": "both noises cut at their scales",
    "measurement": "Cauchy measurement, process cut",
    "both": "both noises Cauchy",
}
_UNCUT = "membership (93) of the altimeter not cut at its scale"
_OUTSIDE = {
    "cut": "no noise lies outside of the universe that was declared: no outliers",
    "measurement": "printed energies are those of a launch with Cauchy process noise as well",
    "both": "half of the process noise lies outside of the declared universe [-15, 15]",
}


def dynamics(x: FloatArray, k: int) -> FloatArray:
    """Move (altitude, velocity), shape (..., 2), from step k to k + 1: (89) and (90), as printed."""
    h, v = x[..., 0], x[..., 1]
    mass = _MASS - _FUEL * _T * k
    force = _EXHAUST * _FUEL / mass - _G0 * _RADIUS / (_RADIUS + h) - _DRAG * v**2 / mass
    moved: FloatArray = np.stack([h + _T * v, v + _T * force], axis=-1)
    return moved


def jacobian(x: FloatArray, k: int) -> FloatArray:
    """Return the Jacobian (94) of the dynamics."""
    h, v = x
    mass = _MASS - _FUEL * _T * k
    return np.array([[1.0, _T], [_T * _G0 * _RADIUS / (_RADIUS + h) ** 2, 1.0 - 2.0 * _T * _DRAG * v / mass]])


def _cauchy(rng: np.random.Generator, n: int, scale: float, cut: bool) -> FloatArray:
    """Draw Cauchy samples, or such as are not beyond the scale."""
    noise: FloatArray = scale * np.tan(np.pi * (rng.random(n) - 0.5) * (0.5 if cut else 1.0))
    return noise


def launch(rng: np.random.Generator, noise: Noise) -> tuple[FloatArray, FloatArray, int]:
    """Draw states (steps, 2) and measurements (steps,) of one launch.

    Launches whose velocity leaves the universe of the paper are drawn again; the third
    value is how often that was.
    """
    again = 0
    while True:
        w = _cauchy(rng, _STEPS, _SCALE_W, cut=noise != "both")
        x = np.zeros(2)
        states = np.empty((_STEPS, 2))
        for k in range(_STEPS):
            x = dynamics(x, k) + np.array([0.0, w[k]])
            states[k] = x
            if not _VELOCITIES[0] <= x[1] <= _VELOCITIES[1] and k >= _EVERY:
                break
        else:
            v = _cauchy(rng, _STEPS, _SCALE_V, cut=noise == "cut")
            return states, states[:, 0] + v, again
        again += 1


def _fuzzy(points: int) -> FuzzyRelationEstimator:
    estimator = FuzzyRelationEstimator(
        2,
        1,
        fx=dynamics,
        state=SingletonMembership([0.0, 0.0]),
        process_noise=[None, CauchyMembership(0.0, _SCALE_W).cut((-_SCALE_W, _SCALE_W))],
        measurement_noise=CauchyMembership(0.0, _SCALE_V),
        points=points,
        on_empty="keep",
    )
    estimator.H = np.array([[1.0, 0.0]])
    return estimator


def _extended() -> ExtendedKalmanFilter:
    return ExtendedKalmanFilter(
        2,
        1,
        fx=dynamics,
        FJacobian=jacobian,
        hx=lambda x: x[:1],
        HJacobian=lambda x: np.array([[1.0, 0.0]]),
        x=np.zeros(2),
        P=np.zeros((2, 2)),
        Q=np.diag([0.0, _SCALE_W**2]),
        R=[[_SCALE_V**2]],
    )


def _follow(estimator: Filter, z: FloatArray) -> FloatArray:
    """Return the estimates (steps, 2) of one launch; infinite once the estimator has overflowed.

    After an outlier the extended Kalman filter may believe in a velocity from which the Euler
    step of (90) diverges.
    """
    estimates = np.full((_STEPS, 2), np.inf)
    with warnings.catch_warnings(), np.errstate(over="raise", invalid="raise"):
        # An outlier may lie beyond the grid; what is extrapolated there is below 2e-8.
        warnings.simplefilter("ignore", SupportWarning)
        for k in range(_STEPS):
            try:
                estimator.predict(k=k)
                if (k + 1) % _EVERY == 0:
                    estimator.update(z[k])
            except FloatingPointError:
                break
            estimates[k] = estimator.x.ravel()
    return estimates


def _launches(rng: np.random.Generator, runs: int, *, noise: Noise, points: int) -> Samples:
    """Follow launches by both estimators; energies ½ e'e over all steps."""
    out: Samples = {
        f"{name} {what}": np.empty(runs) for name in ("EKF", "fuzzy") for what in ("altitude", "velocity")
    }
    out["again"] = np.zeros(runs)
    for run in range(runs):
        states, z, out["again"][run] = launch(rng, noise)
        estimators = {"EKF": _extended(), "fuzzy": _fuzzy(points)}
        estimates = {}
        for name, estimator in estimators.items():
            estimates[name] = _follow(estimator, z)
        for name, estimate in estimates.items():
            with np.errstate(over="ignore"):  # of an estimate that is about to overflow
                energy = 0.5 * np.sum((estimate - states) ** 2, axis=0)
            out[f"{name} altitude"][run], out[f"{name} velocity"][run] = energy
        if run == 0:
            out |= {"states": states, "z": z} | {f"{name} states": e for name, e in estimates.items()}
    return out


# --------------------------------------------------------------------------- the experiment


def _assess(samples: Mapping[str, Samples]) -> list[Finding]:
    findings: list[Finding] = []
    for noise, label in _NOISES.items():
        values = samples[noise]
        for what, (kalman, fuzzy) in PRINTED.items():
            ours = {name: values[f"{name} {what}"] for name in ("EKF", "fuzzy")}
            won = sum(b < a for a, b in zip(kalman, fuzzy, strict=True))
            where = f"{label}: {what}"
            wins, runs = int(np.sum(ours["fuzzy"] < ours["EKF"])), len(ours["EKF"])
            findings += [
                printed_wins(
                    f"{where}, share of launches won by the fuzzy estimator",
                    wins,
                    runs,
                    printed=(won, len(kalman)),
                    correction=_UNCUT,
                    reason=_OUTSIDE[noise],
                ),
                wins_claim(
                    f"{where}, the fuzzy estimator wins more than half of the launches",
                    wins,
                    runs,
                    correction=_UNCUT,
                    reason=f"it wins {wins / runs:.1%}; {_OUTSIDE[noise]}",
                ),
            ]
            findings += [
                printed_sample(
                    f"{where}, energies of the {name}",
                    ours[name],
                    printed=numbers,
                    correction=_UNCUT if name == "fuzzy" else "",
                    reason=_OUTSIDE[noise],
                )
                for name, numbers in (("EKF", kalman), ("fuzzy", fuzzy))
            ]
        findings += [
            measured(f"{label}: launches drawn again for one", values["again"]),
            measured(f"{label}: share in which the EKF overflows", np.isinf(values["EKF altitude"])),
        ]
    return findings


def _draw(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(10.5, 6.5)
    axes = figure.subplots(2, 3)
    time = _T * np.arange(1, _STEPS + 1)
    for column, (noise, label) in enumerate(_NOISES.items()):
        values = samples[noise]
        top, bottom = axes[:, column]
        for name, colour, dashes in (("EKF", ORANGE, "--"), ("fuzzy", BLUE, "-")):
            error = (values[f"{name} states"][:, 0] - values["states"][:, 0]) / 1000.0
            top.plot(time, error, color=colour, linestyle=dashes, label=name)
        top.axhline(0.0, color="0.6", linewidth=0.7)
        top.set(title=label, xlabel="time (s)")
        for energies, marker, face, source in (
            ({name: values[f"{name} altitude"] for name in ("EKF", "fuzzy")}, "o", BLUE, "ours"),
            (dict(zip(("EKF", "fuzzy"), PRINTED["altitude"], strict=True)), "s", "none", "printed"),
        ):
            bottom.loglog(
                energies["EKF"],
                energies["fuzzy"],
                marker,
                color=BLUE if source == "ours" else ORANGE,
                markerfacecolor=face,
                markersize=4,
                label=source,
            )
        limits = (1e6, 1e12)
        bottom.plot(limits, limits, color="0.6", linewidth=0.7)
        bottom.set(xlim=limits, ylim=limits, xlabel="altitude energy of the EKF (m²)")
        won = np.mean(values["fuzzy altitude"] < values["EKF altitude"])
        bottom.set_title(f"fuzzy wins {won:.0%} (below the line)", fontsize="medium")
    axes[0, 0].set_ylabel("altitude error, first launch (km)")
    axes[1, 0].set_ylabel("of the fuzzy estimator (m²)")
    axes[0, 0].legend()
    axes[1, 0].legend()
    return figure


ROCKET = Experiment(
    name="rocket",
    paper="2001",
    reproduces="Tables 5 and 6: a rocket under Cauchy noises",
    runs=40,
    quick_runs=8,
    pieces={noise: {"noise": noise, "points": 51} for noise in _NOISES},
    run=_launches,
    assess=_assess,
    draw=_draw,
)
