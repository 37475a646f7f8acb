"""Tables 1 to 4 of the 2001 paper: intervals against the extended Kalman filter.

J. R. Layne, K. M. Passino, "A fuzzy dynamic model based state estimator", Fuzzy Sets and
Systems 122 (2001), sections 4.2 to 4.5.  Scalar systems x' = f(x) + w, z = g(x) + v with
uniform noises; 100 steps, a measurement every tenth; x = 0 is known at the start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from fuzzykf.experiments.core import Experiment, new_figure
from fuzzykf.experiments.verdicts import Finding, measured, printed_sample, printed_wins, wins_claim
from fuzzykf.plotting import BLUE, ORANGE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from fuzzykf.arrays import FloatArray
    from fuzzykf.experiments.core import Samples

__all__ = ["INTERVALS", "System", "extended_kalman_filter", "interval_estimator", "simulate"]

Reading = Literal["mean", "true"]


class System(NamedTuple):
    """x' = a x^p + w, z = b x^q + v, with p and q of 1 or 3 and uniform noises."""

    a: float
    p: int
    b: float
    q: int
    w: float  # half-widths
    v: float = 0.5

    def f(self, x: FloatArray) -> FloatArray:
        """Dynamics; increasing."""
        return self.a * x**self.p

    def g(self, x: FloatArray) -> FloatArray:
        """Measurement; increasing."""
        return self.b * x**self.q

    def g_inverse(self, z: FloatArray) -> FloatArray:
        """State that is measured as z."""
        return np.cbrt(z / self.b) if self.q == 3 else z / self.b

    def slopes(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of f and g."""
        return self.a * self.p * x ** (self.p - 1), self.b * self.q * x ** (self.q - 1)


#: Sections 4.2 to 4.5, in the order of Tables 1 to 4.
SYSTEMS = {
    "Table 1": System(1.0, 1, 0.5, 1, 3.0),
    "Table 2": System(1.0, 1, 0.0005, 3, 3.0),
    "Table 3": System(0.01, 3, 1.0, 1, 2.0),
    "Table 4": System(0.01, 3, 1.0, 3, 2.0),
}

# fmt: off
#: Printed energies of twenty runs: of the (extended) Kalman filter, of the fuzzy estimator.
PRINTED: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "Table 1": (
        (0.0206, 0.5384, 0.0035, 0.0148, 0.2295, 0.1003, 0.0202, 0.2908, 1.1933, 0.0024,
         0.0058, 1.4112, 2.1468, 0.0280, 0.0104, 0.0440, 0.4370, 0.0138, 0.0412, 0.7661),
        (0.0204, 0.5228, 0.0031, 0.0151, 0.2201, 0.0972, 0.0205, 0.2774, 1.1538, 0.0014,
         0.0079, 1.3619, 2.0758, 0.0265, 0.0111, 0.0407, 0.4088, 0.0140, 0.0389, 0.7444),
    ),
    "Table 2": (
        (9.9088, 8.6008, 5.0778, 13.893, 2.0858, 0.6675, 0.3584, 0.0114, 0.1984, 7.0437,
         10.549, 2.0992, 8.0853, 14.511, 2.6094, 7.6547, 6.3317, 10.412, 5.8117, 3.9570),
        (0.9492, 3.2983, 0.7673, 1.0984, 0.0001, 0.8350, 1.3149, 4.7174, 0.3036, 0.7604,
         0.3871, 0.6510, 4.2605, 2.8257, 6.5030, 1.7186, 0.5599, 4.3276, 0.2005, 0.0394),
    ),
    "Table 3": (
        (0.8398e-3, 0.0098, 0.1869e-3, 0.1955e-3, 0.2385e-4, 0.0089, 0.0085, 0.0146, 0.0044, 0.0203,
         0.0057, 0.1605e-4, 0.0015, 0.0067, 0.3056e-3, 0.0030, 0.0018, 0.0024, 0.0018, 0.0052),
        (0.8375e-3, 0.0096, 0.1743e-3, 0.1578e-3, 0.8722e-4, 0.0088, 0.0080, 0.0148, 0.0042, 0.0197,
         0.0052, 0.0120e-4, 0.0019, 0.0065, 0.2923e-3, 0.0029, 0.0016, 0.0027, 0.0014, 0.0051),
    ),
    "Table 4": (
        (0.0013, 0.1572e-3, 0.0219, 0.0223, 0.0237, 0.4345e-3, 0.1471e-4, 0.0059, 0.0027, 0.0099,
         0.0052, 0.0018, 0.0021, 0.0054, 0.0022, 0.0012, 0.0058, 0.0028, 0.0116, 0.0050),
        (0.0005, 0.0565e-3, 0.0184, 0.0182, 0.0217, 0.0998e-3, 0.8272e-4, 0.0052, 0.0021, 0.0083,
         0.0031, 0.0008, 0.0017, 0.0050, 0.0013, 0.0020, 0.0016, 0.0007, 0.0064, 0.0033),
    ),
}
# fmt: on

_READINGS: dict[Reading, tuple[str, str]] = {
    "mean": ("½ (mean error)²", "energy is ½ (mean error of the run)², not ½ e'e"),
    "true": ("½ e'e", ""),
}

#: Why a printed number is not found again, where it is known.
_REASONS = {
    ("mean", "Table 2", "EKF"): "from x = 0 the gain of the EKF is zero for ever; the printed one has moved",
    ("mean", "Table 2", "wins"): "from x = 0 the gain of the EKF is zero for ever",
}
_TOO_LARGE = "½ e'e is larger by orders of magnitude"

# --------------------------------------------------------------------------- the two estimators


def simulate(
    system: System, rng: np.random.Generator, runs: int, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Draw states and measurements, (steps, runs) each, from x = 0."""
    w = rng.uniform(-system.w, system.w, (steps, runs))
    v = rng.uniform(-system.v, system.v, (steps, runs))
    x = np.zeros(runs)
    states = np.empty((steps, runs))
    for k in range(steps):
        x = system.f(x) + w[k]
        states[k] = x
    return states, system.g(states) + v


def interval_estimator(system: System, z: FloatArray, every: int) -> FloatArray:
    """Carry intervals of possible states through many runs; return their centres.

    Interval memberships under (24) and (28) for increasing f and g, as
    `FuzzyRelationEstimator` does it run by run: the image widened by the noise, then the part
    of it that the measurement allows.

    Parameters
    ----------
    system : System
    z : ndarray, shape (steps, runs)
        Used at every ``every``-th step.
    every : int

    Returns
    -------
    ndarray, shape (steps, runs)
    """
    low, high = np.zeros(z.shape[1]), np.zeros(z.shape[1])
    centres = np.empty(z.shape)
    for k, measurement in enumerate(z, start=1):
        low, high = system.f(low) - system.w, system.f(high) + system.w
        if k % every == 0:
            low = np.maximum(low, system.g_inverse(measurement - system.v))
            high = np.minimum(high, system.g_inverse(measurement + system.v))
        centres[k - 1] = (low + high) / 2.0
    return centres


def extended_kalman_filter(system: System, z: FloatArray, every: int) -> FloatArray:
    """Run the extended Kalman filter (69)-(75) on many runs; return its means.

    Q and R are the variances of the uniform noises, and P = 0 at the start.

    Parameters
    ----------
    system, z, every
        As in `interval_estimator`.

    Returns
    -------
    ndarray, shape (steps, runs)
    """
    Q, R = (2.0 * system.w) ** 2 / 12.0, (2.0 * system.v) ** 2 / 12.0
    x, P = np.zeros(z.shape[1]), np.zeros(z.shape[1])
    means = np.empty(z.shape)
    for k, measurement in enumerate(z, start=1):
        F = system.slopes(x)[0]
        x, P = system.f(x), F * P * F + Q
        if k % every == 0:
            G = system.slopes(x)[1]
            gain = P * G / (G * P * G + R)
            x, P = x + gain * (measurement - system.g(x)), (1.0 - gain * G) * P
        means[k - 1] = x
    return means


def _energies(errors: FloatArray) -> dict[Reading, FloatArray]:
    """Energy of each run, in both readings, of errors (steps, runs)."""
    return {"mean": 0.5 * errors.mean(axis=0) ** 2, "true": 0.5 * np.sum(errors**2, axis=0)}


# --------------------------------------------------------------------------- the experiment


def _run_table(rng: np.random.Generator, runs: int, *, table: str, steps: int, every: int) -> Samples:
    """Energies of both estimators in each run."""
    system = SYSTEMS[table]
    x, z = simulate(system, rng, runs, steps)
    out: Samples = {}
    estimates = {
        "fuzzy": interval_estimator(system, z, every),
        "EKF": extended_kalman_filter(system, z, every),
    }
    for name, estimate in estimates.items():
        for reading, energies in _energies(estimate - x).items():
            out[f"{name} {reading}"] = energies
    return out


def _assess(samples: Mapping[str, Samples]) -> list[Finding]:
    findings: list[Finding] = []
    for reading, (label, correction) in _READINGS.items():
        for table, values in samples.items():
            energies = {name: values[f"{name} {reading}"] for name in ("EKF", "fuzzy")}
            kalman, fuzzy = PRINTED[table]
            won = sum(b < a for a, b in zip(kalman, fuzzy, strict=True))
            where = f"{table}, {label}"
            wins, runs = int(np.sum(energies["fuzzy"] < energies["EKF"])), len(energies["EKF"])
            findings += [
                printed_wins(
                    f"{where}: share of runs won by the fuzzy estimator",
                    wins,
                    runs,
                    printed=(won, len(kalman)),
                    correction=correction,
                    reason=_REASONS.get((reading, table, "wins"), ""),
                ),
                wins_claim(
                    f"{where}: the fuzzy estimator wins more than half of the runs",
                    wins,
                    runs,
                    correction=correction,
                    reason=f"it wins {wins / runs:.1%}",
                ),
            ]
            findings += [
                printed_sample(
                    f"{where}: energies of the {name}",
                    energies[name],
                    printed=numbers,
                    correction=correction,
                    reason=_REASONS.get((reading, table, name), _TOO_LARGE if reading == "true" else ""),
                )
                for name, numbers in (("EKF", kalman), ("fuzzy", fuzzy))
            ]
            findings.append(
                measured(f"{where}: energy of the EKF - of the fuzzy", energies["EKF"] - energies["fuzzy"])
            )
    return findings


def _draw(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(9.0, 6.5)
    axes = figure.subplots(2, 2)
    for ax, (table, values) in zip(axes.flat, samples.items(), strict=True):
        for name, colour, dashes, marker, printed in (
            ("EKF", ORANGE, "--", "s", PRINTED[table][0]),
            ("fuzzy", BLUE, "-", "o", PRINTED[table][1]),
        ):
            energies = np.sort(values[f"{name} mean"])
            share = (np.arange(len(energies)) + 0.5) / len(energies)
            ax.semilogx(energies, share, linestyle=dashes, color=colour, label=f"{name}, ours")
            at = (np.arange(len(printed)) + 0.5) / len(printed)
            ax.semilogx(
                np.sort(printed),
                at,
                marker,
                color=colour,
                markersize=4,
                markerfacecolor="none",
                label=f"{name}, printed",
            )
        won = np.mean(values["fuzzy mean"] < values["EKF mean"])
        ax.set(title=f"{table}: fuzzy wins {won:.0%}", xlim=(1e-6, 1e3))
        ax.grid(color="0.9")
    for ax in axes[1]:
        ax.set_xlabel("energy, ½ (mean error)²")
    for ax in axes[:, 0]:
        ax.set_ylabel("share of runs below")
    axes[0, 0].legend(loc="upper left", fontsize="small")
    return figure


INTERVALS = Experiment(
    name="interval",
    paper="2001",
    reproduces="Tables 1-4: intervals against the extended Kalman filter",
    runs=5000,
    quick_runs=2000,
    pieces={table: {"table": table, "steps": 100, "every": 10} for table in SYSTEMS},
    run=_run_table,
    assess=_assess,
    draw=_draw,
)
