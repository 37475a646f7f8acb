"""The compiled way back on nodes is that of NumPy, on every instruction set, for systems of any kind."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fuzzykf.engine.numpy import nodes
from fuzzykf.engine.numpy import nodes_backward as twin

core = pytest.importorskip(
    "fuzzykf.engine.compiled.nodes_backward", reason="the compiled core has not been built"
)
compiled_nodes = pytest.importorskip("fuzzykf.engine.compiled.nodes")


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.1 * np.eye(shape[-1])


@cache  # for every instruction set the same
def way_back_of_numpy(size, kind):
    """A system, what is filtered and observed, and what NumPy makes of it by density and by Kim's rule."""
    M, m = size
    rng, n = np.random.default_rng(10 * M + m), 6
    lead = (1, n) if kind == "own parameters" else (1, 1)
    F = rng.normal(size=(*lead, M, m, m))
    F *= 0.9 / np.linalg.norm(F, 2, axis=(-2, -1), keepdims=True)
    Q = definite(rng, *lead, M, m)
    b, known = rng.normal(size=(*lead, M, m)), m - 1
    if kind == "singular":  # the last state is a constant without error
        F[..., known, :], F[..., known, known], b[..., known] = 0.0, 1.0, 0.0
        Q[..., known, :] = Q[..., :, known] = 0.0
    q = min(m, 2)
    H, d, R = rng.normal(size=(*lead, M, q, m)), rng.normal(size=(*lead, M, q)), definite(rng, *lead, M, q)
    space = nodes.NodeSpace(F, b, Q, H, d, R)
    T, p = rng.dirichlet(np.ones(M), M), rng.dirichlet(np.ones(M))
    if kind == "sparse" and M > 2:
        T = np.triu(T)
        T[0, 0], p[1] = 0.0, 0.0
        T, p = T / T.sum(axis=1, keepdims=True), p / p.sum()
    with np.errstate(divide="ignore"):
        log_T, log_p = np.log(T), np.maximum(np.log(p), -1e307)
    x, P = rng.normal(size=(m, M)), definite(rng, M, m)
    if kind == "singular":
        x[known], P[:, known], P[:, :, known] = 1.0, 0.0, 0.0
    begin = np.concatenate([log_p[None], x, P.reshape(M, -1).T])[None]
    table = np.empty((1, n, *begin.shape[1:]))
    switch = np.arange(M) * 1.0, np.ones(M), np.ones(M, dtype=bool), np.array([np.arange(M), np.full(M, 2)])
    ys = 2.0 * rng.normal(size=(1, n, q))
    ys[0, 2] = ys[0, 4, 0] = np.nan
    nodes.filter_nodes(nodes.pack_nodes(space, log_T), True, begin, True, ys, {"table": table}, switch)
    kernel = nodes.pack_nodes(space, log_T)
    smoothed = {how: twin.smooth_nodes(kernel, table[0], ys[0], how) for how in (True, False)}
    return space, log_T, table[0], ys[0], smoothed


@pytest.mark.parametrize("kind", ["plain", "sparse", "singular", "own parameters"])
@pytest.mark.parametrize("size", [(1, 1), (2, 1), (7, 4), (8, 2), (9, 3), (12, 2), (3, 5), (2, 16)])
def test_a_smoother_is_that_of_numpy(size, kind) -> None:
    space, log_T, table, ys, smoothed = way_back_of_numpy(size, kind)
    for by_density, (expected, way) in smoothed.items():
        found, path = core.smooth_nodes(compiled_nodes.pack_nodes(space, log_T), table, ys, by_density)
        np.testing.assert_array_equal(found[:, 0] < -1e306, expected[:, 0] < -1e306)
        for got, wanted in ((found[:, 0], expected[:, 0]), (found[:, 1:], expected[:, 1:])):
            got, wanted = (np.where(one < -1e306, 0.0, one) for one in (got, wanted))
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(path, way)


def test_shapes_that_do_not_fit_are_refused() -> None:
    one = np.ones((1, 1, 2, 1, 1))
    kernel = compiled_nodes.pack_nodes(
        nodes.NodeSpace(one, one[..., 0], one, one, one[..., 0], one), np.zeros((2, 2))
    )
    for bad in (np.zeros((3, 2, 2)), np.zeros((3, 3, 1)), np.zeros((3, 3))):
        with pytest.raises(ValueError, match="table"):
            core.smooth_nodes(kernel, bad, np.zeros((3, 1)), True)
    with pytest.raises(ValueError, match="no states"):
        core.smooth_nodes(kernel, np.zeros((0, 3, 2)), np.zeros((0, 1)), True)
