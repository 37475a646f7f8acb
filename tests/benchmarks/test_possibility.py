"""Speed of the grid estimator as ratios, measured in one run.

Run with ``pytest tests/benchmarks/test_possibility.py --benchmark-only -s``; the ratios are
printed and stand in the table's extra information.  Nothing passes or fails on a time.
With ``FUZZYKF_ENGINE=numpy`` the estimator runs on NumPy and scipy alone.
"""

from __future__ import annotations

import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CauchyMembership, FuzzyRelationEstimator, GaussianMembership, SingletonMembership
from fuzzykf.engine.numpy.convolution import convolve_parabola
from fuzzykf.engine.numpy.kernels import convolve_bounded, convolve_convex, convolve_table

N = 1000


def best_of(run, repeats=5):
    """Shortest time of several runs, in seconds."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def report(benchmark, **figures):
    benchmark.extra_info.update({name: round(value, 3) for name, value in figures.items()})
    print("\n" + ", ".join(f"{name} {value:.3g}" for name, value in figures.items()))


def shifted_maxima(mu, noise):
    """Propagation along one axis by one shifted maximum per noise node, as on the grids of the paper.

    The fastest of four ways to write it: whole rows are shifted, and nothing is allocated.
    """
    out, product = np.zeros_like(mu), np.empty_like(mu)
    half = noise.size // 2
    for k, weight in enumerate(noise):
        shift = k - half
        to, source = (out[shift:], mu[: N - shift]) if shift >= 0 else (out[:shift], mu[-shift:])
        scaled = product[: source.shape[0]]
        np.multiply(source, weight, out=scaled)
        np.maximum(to, scaled, out=to)
    return out


@pytest.fixture(scope="module")
def plane():
    x = np.linspace(-5.0, 5.0, N)
    return x, 0.5 * (x[:, None] ** 2 + x**2 + 0.4 * x[:, None] * x)


def interleaved(benchmark, plane, run, rounds=7):
    """Time a run and the shifted maxima in turns, so that both meet the same load."""
    mu, noise = np.exp(-plane[1]), np.exp(-0.5 * np.linspace(-3, 3, 121) ** 2)
    baseline = []
    benchmark.pedantic(
        run, setup=lambda: baseline.append(best_of(lambda: shifted_maxima(mu, noise), 1)), rounds=rounds
    )
    report(
        benchmark,
        speedup_over_121_shifts=min(baseline) / benchmark.stats["min"],
        milliseconds_121_shifts=1e3 * min(baseline),
    )


def test_gaussian_convolution_against_shifted_maxima(benchmark, plane):
    # 1000 x 1000 states; 121 noise nodes against none
    x, cost = plane
    step = x[1] - x[0]
    interleaved(benchmark, plane, lambda: convolve_parabola(cost, x[0], step, x[0], step, N, 0.5 / 0.2**2))


def test_full_prediction_against_shifted_maxima(benchmark, plane):
    # the same grid, and the map of the state and all moments besides
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([0.0, 0.0], [[1.0, 0.2], [0.2, 1.0]]),
        process_noise=[None, GaussianMembership(0.0, 0.01)],
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=N,
        domain=((-8.0, 8.0), (-8.0, 8.0)),
    )
    est.F = np.array([[1.0, 0.1], [0.0, 1.0]])
    interleaved(benchmark, plane, lambda: (est.reset(), est.predict()))


@pytest.mark.parametrize("kernel", ["cauchy cut at its scale", "interval", "triangle"])
def test_convex_kernels_against_brute_force(benchmark, plane, kernel):
    x, cost = plane
    d = x[:, None] - x
    with np.errstate(divide="ignore"):
        table = {
            "cauchy cut at its scale": np.where(abs(d) <= 0.6, np.log1p((d / 0.6) ** 2), np.inf),
            "interval": np.where(abs(d) <= 0.6, 0.0, np.inf),
            "triangle": -np.log(np.maximum(0.0, 1.0 - abs(d) / 0.7)),
        }[kernel]
    brute = best_of(lambda: convolve_table(cost, table), 3)
    benchmark.pedantic(lambda: convolve_convex(cost, table), rounds=5, warmup_rounds=1)
    report(benchmark, speedup_over_brute_force=brute / benchmark.stats["min"])


def test_untruncated_cauchy_against_brute_force(benchmark, plane):
    x, cost = plane
    cost = np.log1p(2.0 * cost)
    table = 1.0 + ((x[:, None] - x) / 0.3) ** 2
    brute = best_of(lambda: convolve_table(cost, np.log(table)), 3)
    reciprocal = np.exp(cost)
    benchmark.pedantic(lambda: convolve_bounded(reciprocal, table, np.multiply), rounds=5, warmup_rounds=1)
    report(benchmark, speedup_over_brute_force=brute / benchmark.stats["min"])


# ------------------------------------------------------------------ the rocket of section 5


def rocket(x, time):
    """Altitude and velocity two seconds later (corrected gravity and drag)."""
    h, v = x[..., 0], x[..., 1]
    mass = 20100.0 - 100.0 * time
    gravity = 9.8 * (6.37e6 / (6.37e6 + h)) ** 2
    acceleration = 4000.0 * 100.0 / mass - gravity - 0.5 * v * np.abs(v) * 0.363 / mass
    return np.stack([h + 2.0 * v, v + 2.0 * acceleration], axis=-1)


def measurements(steps=100, seed=1):
    rng = np.random.default_rng(seed)

    def cut_cauchy(scale):
        while True:
            value = scale * rng.standard_cauchy()
            if abs(value) <= scale:
                return value

    x, zs = np.zeros(2), []
    for k in range(steps):
        x = rocket(x, 2.0 * k)
        x[1] += cut_cauchy(15.0)
        zs.append(x[0] + cut_cauchy(1000.0) if k % 10 == 9 else None)
    return zs


def fly(zs, **options):
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=rocket,
        hx=lambda x: x[..., :1],
        state=SingletonMembership([0.0, 0.0]),
        process_noise=[None, CauchyMembership(0.0, 15.0).cut(0.5)],
        measurement_noise=CauchyMembership(0.0, 1000.0).cut(0.5),
        on_empty="keep",
        **options,
    )
    path = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # cells of 200 m do not resolve the first seconds
        for k, z in enumerate(zs):
            est.predict(time=2.0 * k)
            est.update(z)
            path.append(est.x.ravel().copy())
    return np.array(path)


UNIVERSE = {"points": N, "domain": ((0.0, 200_000.0), (0.0, 2000.0))}


def test_live_region_against_full_grid(benchmark):
    # 100 steps; the live grid of 101 x 101 nodes has finer cells than the full one at all times
    zs = measurements()
    live = benchmark.pedantic(lambda: fly(zs, points=101), rounds=3)
    start = time.perf_counter()
    full = fly(zs, **UNIVERSE)
    seconds = time.perf_counter() - start
    report(
        benchmark,
        speedup_over_full_grid=seconds / benchmark.stats["min"],
        seconds_live=benchmark.stats["min"],
        seconds_full=seconds,
        altitude_difference_in_full_cells=np.abs(live - full)[:, 0].max() / 200.2,
    )


def test_memory_of_the_full_grid(benchmark):
    # peak resident memory of a process that does nothing else
    code = (
        "import sys, resource; sys.path.insert(0, sys.argv[1])\n"
        "from test_possibility import fly, measurements, UNIVERSE\n"
        "fly(measurements(12), **UNIVERSE)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    peak = benchmark.pedantic(
        lambda: float(subprocess.run(command, capture_output=True, text=True, check=True).stdout), rounds=1
    )
    report(benchmark, peak_megabytes=peak)
