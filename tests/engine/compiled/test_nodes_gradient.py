"""The compiled gradient on nodes is that of NumPy, on every instruction set, for systems of any kind."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import nodes
from fuzzykf.engine.numpy import nodes_gradient as twin

core = pytest.importorskip(
    "fuzzykf.engine.compiled.nodes_gradient", reason="the compiled core has not been built"
)
compiled_nodes = pytest.importorskip("fuzzykf.engine.compiled.nodes")

SIZES = [(1, 1, 1), (7, 1, 1), (2, 2, 1), (8, 2, 2), (9, 3, 1), (5, 4, 1), (7, 4, 2), (3, 5, 4), (3, 16, 3)]
SIZES += [(2, 3, 16)]
KINDS = ("plain", "gaps", "sparse", "outlier", "certain", "controls", "steps")
NAN = np.nan


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.3 * np.eye(shape[-1])


def arguments(size, kind="plain", n=6):
    """Parameters, logs of transitions, a first law and observations."""
    M, m, q = size
    rng = np.random.default_rng(100 * M + 10 * m + q)
    varying = {"controls": "bd", "steps": "FbQHdR"}.get(kind, "")
    lead = {name: (1, n if name in varying else 1, M) for name in nodes.NodeSpace._fields}
    shapes = {"F": (m, m), "b": (m,), "H": (q, m), "d": (q,)}
    space = {name: rng.normal(size=(*lead[name], *shape)) for name, shape in shapes.items()}
    space |= {"Q": definite(rng, *lead["Q"], m), "R": definite(rng, *lead["R"], q)}
    space["F"] *= 0.9 / np.linalg.norm(space["F"], 2, axis=(-2, -1), keepdims=True)
    T, p = rng.dirichlet(np.ones(M), M), rng.dirichlet(np.ones(M))
    x, P, ys = rng.normal(size=(m, M)), definite(rng, M, m), 2.0 * rng.normal(size=(n, q))
    if kind == "gaps":
        ys[rng.random(ys.shape) < 0.4] = ys[0, 0] = ys[4] = NAN
    elif kind == "sparse" and M > 2:  # the first node is never entered again, the second not begun with
        T = np.triu(T)
        T[0, 0], p[1] = 0.0, 0.0
        T, p = T / T.sum(axis=1, keepdims=True), p / p.sum()
    elif kind == "outlier":
        ys[2] = 1e2  # of log-densities of 1e6 and more, weights keep no ten digits in either engine
    elif kind == "certain":
        space["Q"], P = np.ones_like(space["Q"]), np.zeros_like(P)
    with np.errstate(divide="ignore"):
        log_T, log_p = np.log(T), np.maximum(np.log(p), -1e307)
    table = np.concatenate([log_p[None], x, P.reshape(M, -1).T])
    return nodes.NodeSpace(**space), log_T, table, ys


def gradients(space, log_T, table, ys):
    """Of both engines, by name."""
    for engine, pack in ((core, compiled_nodes.pack_nodes), (twin, nodes.pack_nodes)):
        found = engine.node_gradient(pack(space, log_T), table, ys)
        yield found.space._asdict() | {k: v for k, v in found._asdict().items() if k != "space"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_a_gradient_is_that_of_numpy(size, kind) -> None:
    found, expected = gradients(*arguments(size, kind))
    for name, values in expected.items():
        scale = np.abs(values).max()
        assert np.shape(found[name]) == np.shape(values)
        np.testing.assert_allclose(found[name], values, rtol=1e-10, atol=1e-10 * scale, err_msg=name)
        if name in ("Q", "R", "covariance"):
            np.testing.assert_array_equal(found[name], found[name].mT)


def test_weights_far_below_the_range_of_numbers_keep_their_digits() -> None:
    # the likely node leads nowhere else, and is refuted in the end
    space, _, table, ys = arguments((3, 1, 1), n=7)
    for name, value in {"H": 0.1, "Q": 1.0, "R": 1.0}.items():
        getattr(space, name)[:] = value
    space.d[0, 0, :, 0], ys[:3], ys[3:] = [0.0, 60.0, 61.0], 0.0, 60.0
    T = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.4, 0.6]])
    with np.errstate(divide="ignore"):
        found, expected = gradients(space, np.log(T), table, ys)
    assert np.abs(expected["d"][0, 0, 1:]).min() > 1.0
    for name, values in expected.items():
        scale = np.abs(values).max()
        np.testing.assert_allclose(found[name], values, rtol=1e-10, atol=1e-10 * scale, err_msg=name)


def test_a_series_that_nothing_explains_has_no_gradient() -> None:
    space, log_T, table, ys = arguments((3, 2, 1))
    ys[2] = 1e200
    found, expected = gradients(space, log_T, table, ys)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], np.full_like(values, NAN))


def test_singular_covariances_are_refused() -> None:
    space, log_T, table, ys = arguments((3, 2, 2))
    space.R[0, 0, 1] = space.H[0, 0, 1] = 1.0  # of rank one
    with pytest.raises(np.linalg.LinAlgError):
        core.node_gradient(compiled_nodes.pack_nodes(space, log_T), table, ys)


def test_arguments_that_do_not_fit_are_refused() -> None:
    space, log_T, table, ys = arguments((3, 2, 2))
    kernel = compiled_nodes.pack_nodes(space, log_T)
    for bad in (ys[:, :1], ys[0], ys[:0]):
        with pytest.raises(ValueError, match=r"ys: got shape .* expected \(n, 2\)"):
            core.node_gradient(kernel, table, bad)
    with pytest.raises(ValueError, match=r"table: got shape \(1, 7, 3\), expected \(7, 3\)"):
        core.node_gradient(kernel, table[None], ys)
    varying, *_ = arguments((3, 2, 2), "controls", n=5)
    with pytest.raises(ValueError, match=r"b: got parameters of \(1, 5\) series and steps"):
        core.node_gradient(compiled_nodes.pack_nodes(varying, log_T), table, ys)
    several = nodes.NodeSpace(*(np.repeat(one, 2, axis=0) for one in space))
    with pytest.raises(ValueError, match=r"F: got parameters of \(2, 1\) series and steps"):
        core.node_gradient(compiled_nodes.pack_nodes(several, log_T), table, ys)
    with pytest.raises(TypeError, match="kernel"):
        core.node_gradient(nodes.pack_nodes(space, log_T), table, ys)
