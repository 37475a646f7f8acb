"""Simulation of dynamics with inputs and features of the window."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.gaussian import semidefinite_root
from fuzzykf.results import Simulation

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.switching.dynamics.inputs import InputForm, InputSystem

__all__ = ["sample_nodes", "simulate_driven"]


def sample_nodes(system: InputSystem, us: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw consecutive nodes of a switch on which inputs (n, k) act, (n,), as numbers of nodes."""
    n, chain = len(us), system.chain
    path = np.empty(n, dtype=np.intp)
    uniforms = rng.random(n)
    for k in range(n):
        law = chain.initial if k == 0 else system.at(us[k]).transition[path[k - 1]]
        below = np.cumsum(law)
        path[k] = min(int(np.searchsorted(below, uniforms[k] * below[-1], side="right")), len(chain) - 1)
    return path


def _name(k: int, index: tuple[int, ...]) -> str:
    return f"step {k - 1}"


def simulate_driven(
    form: InputForm, r: FloatArray, shares: FloatArray, us: FloatArray, rng: np.random.Generator
) -> Simulation:
    """Draw states and observations along a path of the switch.

    Before the first observation there is that one itself, as in learning and filtering.

    Parameters
    ----------
    form : InputForm
    r : ndarray, shape (n,) or (n, K)
        Values of the switch.
    shares : ndarray, shape (n, K)
        Their shares in the regimes.
    us : ndarray, shape (n, k)
        Inputs; those of the first time are not used.
    rng : numpy.random.Generator
    """
    n, m, q = len(r), form.dim_x, form.dim_z
    features = form.features
    x, y = np.empty((n, m)), np.empty((n, q))
    noise = rng.standard_normal((n, m + q))
    if n == 0:
        return Simulation(x, y, r)
    mean, covariance = form.marginal(shares[:1])
    first = mean[0] + semidefinite_root(covariance[0]) @ noise[0]
    x[0], y[0] = first[:m], first[m:]
    past = np.repeat(y[:1], features.n_past, axis=0)
    o = form.sizes[1]
    for k in range(1, n):
        step = form.pairs(shares[k - 1], shares[k], partial(_name, k))
        known = np.concatenate([past.ravel(), us[k], features.own(past[0], us[k])])
        window = np.concatenate([known, np.zeros(o)])
        y[k] = step.Ayy @ window + step.Ny + np.linalg.cholesky(step.Qyy) @ noise[k, m:]
        window[known.size :] = features.own(y[k], us[k])
        x[k] = step.Axx @ x[k - 1] + step.H @ window + step.G @ y[k] + step.c
        x[k] += semidefinite_root(step.C) @ noise[k, :m]
        past = np.concatenate([y[k : k + 1], past[:-1]])
    return Simulation(x, y, r)
