"""Is one build of fuzzykf slower than another?  Both measured in turn, in one run.

    python tests/benchmarks/builds.py BEFORE AFTER [--turns 40]

BEFORE and AFTER are folders that hold a built package.  Each is imported by a process of its own,
which lives as long as the run; in every turn each work runs in the one and in the other process,
the first of the two changing from turn to turn.  A row gives the median time of both and the
median and the quartiles of the ratio AFTER / BEFORE over the turns, and the ratio of the lowest
deciles, which a clock that jumps moves less.  To see the spread of the run itself, name one folder
twice.  Works use the public interface alone, so that older builds
can be measured as well.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

#: Observations of a series, and seconds that a work is repeated for within a turn.
N, LEAST = 2000, 5e-3


def gaussian_filter(kind, m, q):
    f = kind(m, q)
    f.F, f.H, f.Q, f.R = 0.9 * np.eye(m), np.eye(q, m), 0.2 * np.eye(m), 0.5 * np.eye(q)
    return f


def model(m, q):
    """Two regimes with correlated noise."""
    from fuzzykf import CGOFMSModel, FuzzyMarkovLaw

    d = m + q
    root = np.random.default_rng(6).normal(size=(d, d)) * 0.3 + np.eye(d)
    S = root @ root.T
    pair = np.block([[S, 0.3 * S], [0.3 * S, S]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel(law, [np.zeros(d), np.ones(d)], np.broadcast_to(pair, (2, 2, 2 * d, 2 * d)), m)


def grid():
    """A fuzzy estimator on a grid of two dimensions, its states bent by a function."""
    from fuzzykf import FuzzyRelationEstimator, GaussianMembership

    return FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: np.stack(
            [x[..., 0] + 0.1 * x[..., 1], 0.9 * x[..., 1] - 0.1 * np.sin(x[..., 0])], axis=-1
        ),
        hx=lambda x: x[..., :1],
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=GaussianMembership([0.0, 0.0], 0.1 * np.eye(2)),
        measurement_noise=GaussianMembership([0.0], [[0.2]]),
        points=61,
        domain=[(-6.0, 6.0), (-6.0, 6.0)],
    )


def works():
    """Name to a function to be timed."""
    from fuzzykf import CGOMSMFilter, CGOMSModel, IMMEstimator, KalmanFilter, OFSRFilter

    rng = np.random.default_rng(0)
    scalar, vector = OFSRFilter(model(1, 1), 5), OFSRFilter(model(4, 2), 5)
    y, y4 = (f.model.simulate(N, rng).y for f in (scalar, vector))
    values, columns, rows = y[:, 0].tolist(), [z[:, None] for z in y4], list(y4)
    many, gaps = np.array([y] * 100), y[:300].copy()
    gaps[::50] = np.nan
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    hard = CGOMSModel([[0.9, 0.1], [0.2, 0.8]], [[0, 0], [3, 3]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)
    hard_filter, batch = CGOMSMFilter(hard), gaussian_filter(KalmanFilter, 4, 2)
    two, four = gaussian_filter(KalmanFilter, 2, 1), gaussian_filter(KalmanFilter, 4, 2)
    bank = [gaussian_filter(KalmanFilter, 2, 1) for _ in range(3)]
    imm = IMMEstimator(bank, [0.5, 0.3, 0.2], [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6]])

    def each(step, zs):
        def run():
            for one in zs:
                step(one)

        return run

    def predict_update(f, zs):
        def run():
            for one in zs:
                f.predict()
                f.update(one)

        return run

    return {
        "OFSRFilter.step": each(scalar.step, values),
        "OFSRFilter.predict, update": predict_update(OFSRFilter(model(1, 1), 5), values[:200]),
        "OFSRFilter.filter": lambda: scalar.filter(y),
        "OFSRFilter.filter of 20 values": lambda: scalar.filter(y[:20]),
        "OFSRFilter.filter, one value in 50 missing": lambda: scalar.filter(gaps),
        "OFSRFilter.smooth": lambda: scalar.smooth(y),
        "OFSRFilter.filter_many, 100 series": lambda: scalar.filter_many(many),
        "OFSRFilter.step, m = 4, q = 2": each(vector.step, rows),
        "OFSRFilter.filter, m = 4, q = 2": lambda: vector.filter(y4),
        "CGOMSMFilter.step": each(hard_filter.step, values),
        "CGOMSMFilter.filter": lambda: hard_filter.filter(y),
        "KalmanFilter(2, 1).step": each(two.step, values),
        "KalmanFilter(4, 2).step": each(four.step, columns),
        "KalmanFilter(4, 2).filter": lambda: batch.filter(y4),
        "IMMEstimator of 3, step": each(imm.step, values[:500]),
        "FuzzyRelationEstimator on a grid, step": each(grid().step, [0.1, -0.2, 0.3]),
    }


def serve():
    """Time the works whose names are read, line by line; the first line answered is their list."""
    known = works()
    repeats = {}
    for name, work in known.items():
        start = time.perf_counter()
        work()
        repeats[name] = 1 + int(LEAST / (time.perf_counter() - start))
    print("\t".join(known), flush=True)
    for line in sys.stdin:
        work, n = known[line.rstrip("\n")], repeats[line.rstrip("\n")]
        work()  # the caches are warm
        start = time.perf_counter()
        for _ in range(n):
            work()
        print((time.perf_counter() - start) / n, flush=True)


class Build:
    """A process that has imported one build."""

    def __init__(self, folder: str) -> None:
        path = str(Path(folder).resolve())
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=path,
            env={**os.environ, "PYTHONPATH": path},
        )
        self.names = self.process.stdout.readline().rstrip("\n").split("\t")

    def seconds(self, name: str) -> float:
        self.process.stdin.write(f"{name}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("before")
    parser.add_argument("after")
    parser.add_argument("--turns", type=int, default=40)
    options = parser.parse_args()
    builds = [Build(options.before), Build(options.after)]
    found = {name: [[], []] for name in builds[0].names if name in builds[1].names}
    for turn in range(options.turns):
        for name, times in found.items():
            for k in (0, 1) if turn % 2 else (1, 0):
                times[k].append(builds[k].seconds(name))
    print("| work | before, us | after, us | after / before, median (quartiles) | of lowest deciles |")
    print("|---|---|---|---|---|")
    for name, (before, after) in found.items():
        low, middle, high = np.quantile(np.array(after) / np.array(before), [0.25, 0.5, 0.75])
        times = f"{np.median(before) * 1e6:.4g} | {np.median(after) * 1e6:.4g}"
        lowest = np.quantile(after, 0.1) / np.quantile(before, 0.1)
        print(f"| {name} | {times} | {middle:.3f} ({low:.3f} to {high:.3f}) | {lowest:.3f} |")


if __name__ == "__main__":
    serve() if "--serve" in sys.argv else main()
