"""Simulation of switching systems."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.gaussian import semidefinite_root
from fuzzykf.results import Simulation
from fuzzykf.switching.laws.chain import value_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.placed import Pairwise

__all__ = ["simulate_path"]

#: Pairs whose tables are held at once.
_CHUNK = 4096


def simulate_path(form: Pairwise, r: FloatArray, shares: FloatArray, rng: np.random.Generator) -> Simulation:
    """Draw states and observations along a path of the switch.

    Parameters
    ----------
    form : GaussianForm
    r : ndarray, shape (n,) or (n, K)
        Values of the switch.
    shares : ndarray, shape (n, K)
        Their shares in the regimes.
    rng : numpy.random.Generator
    """
    n, m, q = len(r), form.dim_x, form.dim_z
    x, y = np.empty((n, m)), np.empty((n, q))
    noise = rng.standard_normal((n, m + q))
    if n:
        mean, covariance = form.marginal(shares[:1])
        first = mean[0] + semidefinite_root(covariance[0]) @ noise[0]
        x[0], y[0] = first[:m], first[m:]

    for start in range(0, n - 1, _CHUNK):
        stop = min(start + _CHUNK, n - 1)
        steps = form.pairs(shares[start:stop], shares[start + 1 : stop + 1], _describe_steps(r, start))
        root_y, root_x = np.linalg.cholesky(steps.Qyy), semidefinite_root(steps.C)
        shock_y = (root_y @ noise[start + 1 : stop + 1, m:, None])[..., 0] + steps.Ny
        shock_x = (root_x @ noise[start + 1 : stop + 1, :m, None])[..., 0] + steps.c
        for k in range(stop - start):
            now = start + k
            y[now + 1] = steps.Ayy[k] @ y[now] + shock_y[k]
            x[now + 1] = steps.Axx[k] @ x[now] + steps.H[k] @ y[now] + steps.G[k] @ y[now + 1] + shock_x[k]
    return Simulation(x, y, r)


def _describe_steps(r: FloatArray, start: int) -> Callable[[tuple[int, ...]], str]:
    def describe(index: tuple[int, ...]) -> str:
        k = start + index[0]
        before, after = (value_of(r[i]) if r.ndim == 2 else f"{r[i]:.6g}" for i in (k, k + 1))
        return f"step {k}, r_n = {before}, r_n+1 = {after}"

    return describe
