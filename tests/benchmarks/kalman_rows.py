"""Pieces of work to be timed, for the Kalman filters and IMM: fuzzykf beside filterpy and pykalman.

Every function returns works that do the same thing, by name: a call without arguments, and
how many units (steps of one series) it does.  Peers that are not installed are left out.
"""

from __future__ import annotations

import contextlib
import time

import numpy as np
from filterpy import kalman as filterpy

from fuzzykf import kalman


def make(module, n, m, seed=0):
    """Return a stable random filter of this package or of filterpy."""
    rng = np.random.default_rng(seed)
    f = module.KalmanFilter(n, m)
    f.F = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    f.F *= 0.9 / np.abs(np.linalg.eigvals(f.F)).max()
    f.H = rng.normal(size=(m, n))
    f.Q *= 1.0 + seed
    return f


def make_bank(module, n, m, modes=3):
    M = np.full((modes, modes), 0.1 / (modes - 1))
    np.fill_diagonal(M, 0.9)
    return module.IMMEstimator([make(module, n, m, seed) for seed in range(modes)], np.ones(modes) / modes, M)


def observations(n_steps, m):
    return np.random.default_rng(1).normal(size=(n_steps, m))


def stepping(f, zs):
    """Return work: f.step along zs."""

    def work():
        step = f.step
        for z in zs:
            step(z)

    return work, len(zs)


def predicting_and_updating(f, zs):
    """Return work: f.predict and f.update along zs, as code written for filterpy does it."""

    def work():
        for z in zs:
            f.predict()
            f.update(z)

    return work, len(zs)


def steps(n, m):
    """Single steps of a Kalman filter."""
    zs = list(observations(500, m)[..., None])
    return {
        "filterpy": predicting_and_updating(make(filterpy, n, m), zs[:50]),
        "step": stepping(make(kalman, n, m), zs),
        "predict + update": predicting_and_updating(make(kalman, n, m), zs),
    }


def sequences(n, m, n_steps=2000):
    """A whole series through a Kalman filter."""
    zs, few = observations(n_steps, m), 40
    ours, reference = make(kalman, n, m), make(filterpy, n, m)
    columns = list(zs[:few, :, None])
    works = {
        "filterpy": (lambda: reference.batch_filter(columns), few),
        "filter": (lambda: ours.filter(zs), n_steps),
        "batch_filter": (lambda: ours.batch_filter(zs), n_steps),
    }
    with contextlib.suppress(ImportError):
        import pykalman

        f = make(kalman, n, m)
        peer = pykalman.KalmanFilter(
            transition_matrices=f.F,
            observation_matrices=f.H,
            transition_covariance=f.Q,
            observation_covariance=f.R,
            initial_state_mean=np.zeros(n),
            initial_state_covariance=f.F @ f.P @ f.F.T + f.Q,
        )
        works["pykalman"] = (lambda: peer.filter(zs[:few]), few)
    return works


def bank_steps(n, m, modes=3):
    """Single steps of an IMM estimator."""
    zs = list(observations(200, m)[..., None])
    return {
        "filterpy": predicting_and_updating(make_bank(filterpy, n, m, modes), zs[:3]),
        "step": stepping(make_bank(kalman, n, m, modes), zs),
        "predict + update": predicting_and_updating(make_bank(kalman, n, m, modes), zs),
    }


def bank_sequences(n, m, modes=3, n_steps=1000):
    """A whole series through an IMM estimator; filterpy has no function for it."""
    zs = observations(n_steps, m)
    ours = make_bank(kalman, n, m, modes)
    return {
        "filterpy": predicting_and_updating(make_bank(filterpy, n, m, modes), list(zs[:3, :, None])),
        "filter": (lambda: ours.filter(zs), n_steps),
    }


def many_series(n, m, missing):
    """1,000 series at once, against as many one after the other."""
    rng = np.random.default_rng(1)
    zs = rng.normal(size=(1000, 20, m))
    zs[rng.random(zs.shape) < missing] = np.nan
    ours = make(kalman, n, m)
    # 50 of filterpy's take about as long as all of ours, so that other work on the machine slows both
    return {
        "filterpy": predicting_and_updating(make(filterpy, n, m), zs[:50].reshape(-1, m)),
        "filter_many": (lambda: ours.filter_many(zs), 20_000),
    }


def measure(works, rounds=40):
    """Seconds of processor time per unit of each work, (rounds,), all in turn in each round.

    All works keep to one thread, so that its own time leaves out what other programs took.
    """
    found = {name: [] for name in works}
    for _ in range(rounds + 1):
        for name, (work, units) in works.items():
            start = time.thread_time()
            work()
            found[name].append((time.thread_time() - start) / units)
    return {name: np.array(times[1:]) for name, times in found.items()}
