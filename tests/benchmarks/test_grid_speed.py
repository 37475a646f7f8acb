"""The grid estimator against the loops that its paper prints, as ratios measured in one run.

Run with ``nox -s benchmarks -- -k grid_speed -s``.  The loops are in C (``literal_loops.c``) and
compiled with the flags of the package.  Times are those of the processor, which other work on the
machine disturbs least.  Nothing passes or fails on a time.
"""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import FuzzyRelationEstimator, GaussianMembership, engine


def _beside(name):
    """Import a module of this folder, which is no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


literal, rockets = _beside("literal"), _beside("test_possibility")

N = 1000
PLANE = ((-8.0, 8.0), (-8.0, 8.0))
DEVIATION = 0.1


def seconds(work):
    """Processor time of some work, and its result."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def plane_estimator(points=N):
    """Two states on a grid, a linear model, Gaussian noise."""
    est = FuzzyRelationEstimator(
        2,
        1,
        state=GaussianMembership([0.0, 0.0], [[1.0, 0.2], [0.2, 1.0]]),
        process_noise=[None, GaussianMembership(0.0, DEVIATION**2)],
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=points,
        domain=PLANE,
    )
    est.F = np.array([[1.0, 0.1], [0.0, 1.0]])
    return est


def plane_loops(points=N):
    """Return the same as loops, with 121 noise values: a step to the next membership and its centre."""
    w = np.linspace(-3.0 * DEVIATION, 3.0 * DEVIATION, 121)
    grid, noise = literal.Grid.over(points, PLANE, w), np.exp(-0.5 * (w / DEVIATION) ** 2)

    def step(mu):
        mu = literal.propagate("linear", grid, mu, noise, 0.1)
        return mu, literal.center_of_gravity(grid, mu)

    return step


def grid_propagation(rounds=5):
    """Seconds of one prediction on 1000 x 1000 states: (rounds,) of the package and of the loops, in turn."""
    own, loops = [], []
    est, step = plane_estimator(), plane_loops()
    mu = np.ascontiguousarray(est.membership.values)
    for _ in range(rounds):
        own.append(seconds(est.predict)[0])  # with the moments of the result
        spent, (mu, _) = seconds(lambda mu=mu: step(mu))
        loops.append(spent)
    return np.array(own), np.array(loops)


def rocket_loops(zs, points=N):
    """Fly the rocket by loops over the full grid, step by step; yields the estimates."""
    w, v = np.linspace(-15.0, 15.0, 120), np.linspace(-1000.0, 1000.0, 120)
    domain = rockets.UNIVERSE["domain"]
    grid, measured = literal.Grid.over(points, domain, w), literal.Grid.over(points, domain, v)
    noise, likely = 1.0 / (1.0 + (w / 15.0) ** 2), 1.0 / (1.0 + (v / 1000.0) ** 2)
    mu = np.zeros((points, points))
    mu[0, 0] = 1.0
    for k, z in enumerate(zs):
        mu = literal.propagate("rocket", grid, mu, noise, 2.0 * k)
        if z is not None:
            literal.update_position(measured, mu, likely, z)
        yield literal.center_of_gravity(grid, mu)


def rocket_run(steps=100, looped=20, rounds=5):
    """Seconds of a run of ``steps``: (rounds,) with a live region, and one value by loops, in turn.

    Only the first ``looped`` steps are looped, and their time is scaled: all cost the same.
    """
    zs = rockets.measurements(steps)
    own, loops, path, live = [], 0.0, [], np.zeros((0, 2))
    flight = rocket_loops(zs)
    for k in range(looped):
        if k % max(1, looped // rounds) == 0:
            spent, live = seconds(lambda: rockets.fly(zs, points=101))
            own.append(spent)
        spent, center = seconds(lambda: next(flight))
        loops += spent
        path.append(center)
    return np.array(own), loops * steps / looped, live, np.array(path)


needs_compiler = pytest.mark.skipif(literal.library() is None, reason="there is no C compiler for the loops")


def report(benchmark, **figures):
    benchmark.extra_info.update({name: round(value, 3) for name, value in figures.items()})
    print(f"\n{engine.info()}\n" + ", ".join(f"{name} {value:.4g}" for name, value in figures.items()))


@needs_compiler
def test_grid_propagation_against_literal_loops(benchmark):
    own, loops = benchmark.pedantic(grid_propagation, rounds=1)
    report(
        benchmark,
        speedup_over_literal_loops=loops.min() / own.min(),
        milliseconds=1e3 * own.min(),
        milliseconds_of_loops=1e3 * loops.min(),
    )


@needs_compiler
def test_rocket_run_against_literal_loops(benchmark):
    own, loops, live, path = benchmark.pedantic(rocket_run, rounds=1)
    report(
        benchmark,
        speedup_over_literal_loops=loops / own.min(),
        seconds=own.min(),
        seconds_of_loops=loops,
        largest_altitude_difference=np.abs(live[: len(path)] - path)[:, 0].max(),
    )
