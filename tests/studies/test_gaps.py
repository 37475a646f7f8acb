"""How far gaps of several observations are from exact: the figures of docs/howto/missing_observations.md."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel

pytestmark = pytest.mark.study


def oracle():
    path = Path(__file__).parents[1] / "exactness" / "path_enumeration.py"
    spec = importlib.util.spec_from_file_location("path_enumeration", path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.enumerate_paths


def random_model(rng, K, m, q):
    """Regimes that differ in all things, with dynamics of spectral radius .5 to .98."""
    d = m + q
    T, initial = rng.dirichlet(2.0 * np.ones(K), size=K), rng.dirichlet(2.0 * np.ones(K))
    A = rng.normal(0.0, 0.5, (K, K, d, d))
    radius = np.abs(np.linalg.eigvals(A)).max(axis=-1)
    A *= (rng.uniform(0.5, 0.98, (K, K)) / radius)[..., None, None]
    A[:, :, m:, :m] = 0.0
    root, first = rng.normal(0.0, 0.5, (K, K, d, d)), rng.normal(size=(K, d, d))
    Q = root @ np.swapaxes(root, -1, -2) + 0.05 * np.eye(d)
    covariances = first @ np.swapaxes(first, -1, -2) + 0.1 * np.eye(d)
    return CGOMSModel.from_transitions(T, A, Q, rng.normal(0.0, 2.0, (K, d)), covariances, m, initial=initial)


def test_gaps_of_two_to_four_observations():
    enumerate_paths, rng = oracle(), np.random.default_rng(0)
    worst = {"filtered mean": [], "smoothed mean": [], "log-likelihood": []}
    every = {name: [] for name in worst}
    for _ in range(2500):
        K, m, q = (int(rng.integers(1, 3)) + one for one in (1, 0, 0))
        N = 7 if K == 2 else 5
        model = random_model(rng, K, m, q)
        ys = model.simulate(N, rng).y
        length = int(rng.integers(2, min(4, N - 2) + 1))
        begin = int(rng.integers(0, N - length))
        ys[begin : begin + length][rng.random((length, q)) < rng.choice([0.7, 1.0])] = np.nan
        f, system = CGOMSMFilter(model), model.on_nodes()
        result, looked_back = f.filter(ys), f.smooth(ys)
        truth = [enumerate_paths(system, ys, n + 1) for n in range(N)]
        mean = np.array([one.mean[n] for n, one in enumerate(truth)])
        variance = np.array([np.diagonal(one.covariance[n]) for n, one in enumerate(truth)])
        last = np.diagonal(truth[-1].covariance, axis1=1, axis2=2)
        total = np.array([one.log_likelihood for one in truth])
        off = (
            np.abs(result.x - mean) / np.sqrt(variance),
            np.abs(looked_back.x - truth[-1].mean) / np.sqrt(last),
            np.abs(result.log_likelihood - np.diff(total, prepend=0.0)),
        )
        for name, values in zip(worst, off, strict=True):
            worst[name].append(values.max())
            every[name].append(values[begin:].mean())
    for name, values in worst.items():
        above = int((np.array(values) > 0.2).sum())
        print(
            f"{name}: most {max(values):.2f}, above .2 in {above}, mean {np.mean(every[name]):.4f}, "
            f"median of the largest of a model {np.median(values):.1e}"
        )
        assert above < 50
        assert np.mean(every[name]) < 0.01
        assert np.median(values) < 0.01
