"""How often intervals of learned noise contain the truth, for Kalman filters that learn from observations."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import KalmanFilter

pytestmark = pytest.mark.study

SERIES = 200
BLOCK = np.array([[0.25, 0.5], [0.5, 1.0]])
VELOCITY = {"F": [[1.0, 1.0], [0.0, 1.0]], "H": [[1.0, 0.0]], "P": np.diag([10.0, 1.0])}

#: Filters that are true, rows of a series, the share of rows that is missing, and what is free.
SYSTEMS = {
    "local level": (KalmanFilter(1, 1, H=[[1.0]], P=10.0, R=2.0), 300, 0.0, {"Q": "full", "R": "full"}),
    "local level with gaps": (
        KalmanFilter(1, 1, H=[[1.0]], P=10.0, R=2.0),
        400,
        0.25,
        {"Q": "full", "R": "full"},
    ),
    "AR(1) and noise": (
        KalmanFilter(1, 1, H=[[1.0]], F=[[0.9]], P=5.0),
        400,
        0.0,
        {"F": "full", "Q": "full", "R": "full"},
    ),
    "constant velocity": (
        KalmanFilter(2, 1, Q=0.05 * BLOCK, R=4.0, **VELOCITY),
        300,
        0.0,
        {"Q": ("scale", BLOCK), "R": "full"},
    ),
    "two sensors": (
        KalmanFilter(1, 2, H=[[1.0], [1.0]], P=10.0, R=np.diag([1.0, 4.0])),
        200,
        0.0,
        {"Q": "full", "R": "diagonal"},
    ),
}


def drawn(kf, n, missing, rng):
    """Draw a series of a filter."""

    def noise(V, *shape):
        return rng.multivariate_normal(np.zeros(len(V)), V, shape, method="eigh")

    x, zs = kf.x.ravel() + noise(kf.P), np.empty((n, kf.dim_z))
    w, v = noise(kf.Q, n), noise(kf.R, n)
    for k in range(n):
        x = kf.F @ x + w[k]
        zs[k] = kf.H @ x + v[k]
    zs[rng.random(n) < missing] = np.nan
    return zs


def truth(kf, name):
    if name == "Q":  # a factor of BLOCK
        return kf.Q[1, 1]
    i, j = (int(k) for k in name[2:-1].split(", "))
    return getattr(kf, name[0])[i, j]


def test_intervals_of_noise_contain_the_truth_as_often_as_they_say(write_table):
    rng = np.random.default_rng(0)
    rows, coverage = [], {}
    for system, (kf, n, missing, free) in SYSTEMS.items():
        fits = [kf.fit(drawn(kf, n, missing, rng), free=free) for _ in range(SERIES)]
        assert all(fit.converged for fit in fits), system
        intervals = [fit.intervals(0.95) for fit in fits]
        for name in fits[0].estimates:
            true = truth(kf, name)
            estimates = np.array([fit.estimates[name] for fit in fits])
            errors = np.array([fit.standard_errors[name] for fit in fits])
            inside = [lower <= true <= upper for lower, upper in (one[name] for one in intervals)]
            coverage[system, name] = np.mean(inside)
            numbers = (true, estimates.mean(), estimates.std(), np.nanmean(errors))
            cells = [f"{number:.3g}" for number in numbers]
            rows.append(
                [system, str(n), name, *cells, f"{np.mean(inside):.1%}", f"{(estimates == 0.0).sum()}"]
            )
    header = [
        *("system", "rows", "parameter", "truth", "mean estimate", "its deviation", "mean standard error"),
        *("95 % intervals with the truth", "at the bound"),
    ]
    write_table("coverage", header, rows)
    assert {key: value for key, value in coverage.items() if not 0.90 <= value <= 0.98} == {}
