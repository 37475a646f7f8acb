"""The compiled steps on nodes are those of NumPy, on every instruction set, for systems of any kind."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import nodes as twin

core = pytest.importorskip("fuzzykf.engine.compiled.nodes", reason="the compiled core has not been built")

SIZES = [
    (1, 1, 1),
    (2, 1, 1),
    (7, 4, 2),
    (8, 2, 2),
    (9, 3, 1),
    (12, 2, 1),
    (5, 4, 1),
    (3, 5, 4),
    (3, 16, 3),
    (2, 3, 16),
]
NAN = np.nan


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.1 * np.eye(shape[-1])


def space_of(rng, size, lead=(1, 1)):
    M, m, q = size
    F = rng.normal(size=(*lead, M, m, m))
    F *= 0.9 / np.linalg.norm(F, 2, axis=(-2, -1), keepdims=True)
    b, d = rng.normal(size=(*lead, M, m)), rng.normal(size=(*lead, M, q))
    H = rng.normal(size=(*lead, M, q, m))
    return twin.NodeSpace(F, b, definite(rng, *lead, M, m), H, d, definite(rng, *lead, M, q))


def law_of(rng, M, sparse=False):
    """Logs of transitions, of a chain that cannot go everywhere if it is sparse, and of a first law."""
    T = rng.dirichlet(np.ones(M), M)
    p = rng.dirichlet(np.ones(M))
    if sparse and M > 2:
        T = np.triu(T)  # the first node is never entered again
        T[0, 0], p[1] = 0.0, 0.0
        T, p = T / T.sum(axis=1, keepdims=True), p / p.sum()
    with np.errstate(divide="ignore"):
        return np.log(T), np.maximum(np.log(p), -1e307)


def table_of(rng, log_p, m, s):
    M = len(log_p)
    rows = [log_p[None], rng.normal(size=(m, M)), definite(rng, M, m).reshape(M, -1).T]
    return np.repeat(np.concatenate(rows)[None], s, axis=0)


def run(engine, space, log_T, every_pair, table, begins, ys):
    s, n, _ = ys.shape
    M, m = space.F.shape[2:4]
    shapes = {"x": (m,), "P": (m, m), "x_prior": (m,), "P_prior": (m, m), "mu": (M,), "log_likelihood": ()}
    shapes |= {"switch": (), "switch_mean": (), "table": table.shape[1:]}
    out = {name: np.empty((s, n, *shape)) for name, shape in shapes.items()}
    ranking = np.array([np.arange(M), np.full(M, 2)])
    switch = np.linspace(0.0, 1.0, M), np.ones(M), np.ones(M, dtype=bool), ranking
    kernel = engine.pack_nodes(space, log_T)
    last = engine.filter_nodes(kernel, every_pair, table, begins, ys, out, switch)
    return out | dict(zip(("before", "last"), last, strict=True))


def assert_alike(found, expected):
    for name, values in expected.items():
        got = found[name]
        if got.shape[-2:] == expected["table"].shape[-2:]:  # logarithms of nothing are very negative
            np.testing.assert_array_equal(got[..., 0, :] < -1e306, values[..., 0, :] < -1e306, err_msg=name)
            got, values = (np.where(a < -1e306, 0.0, a) for a in (got, values))
        np.testing.assert_allclose(got, values, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("kind", ["plain", "gaps", "sparse", "outlier", "own parameters"])
@pytest.mark.parametrize("size", SIZES)
def test_series_are_those_of_numpy(size, kind) -> None:
    M, m, q = size
    rng = np.random.default_rng(100 * M + 10 * m + q)
    lead = (2, 5) if kind == "own parameters" else (1, 1)
    space, (log_T, log_p) = space_of(rng, size, lead), law_of(rng, M, kind == "sparse")
    table, ys = table_of(rng, log_p, m, 2), 2.0 * rng.normal(size=(2, 5, q))
    if kind == "gaps":
        ys[rng.random(ys.shape) < 0.4] = ys[0, 0] = NAN
    elif kind == "outlier":
        ys[0, 2] = 1e3
    for every_pair in (False, True):
        for begins in (True, False):
            arguments = space, log_T, every_pair, table, begins, ys
            assert_alike(run(core, *arguments), run(twin, *arguments))


@pytest.mark.parametrize("every_pair", [False, True], ids=["imm", "gpb2"])
def test_steps_are_those_of_a_series_to_the_bit(every_pair) -> None:
    rng = np.random.default_rng(1)
    size = 7, 4, 2
    space, (log_T, log_p) = space_of(rng, size), law_of(rng, 7)
    table, ys = table_of(rng, log_p, 4, 3), rng.normal(size=(3, 6, 2))
    ys[1, 2, 0] = ys[2, 3] = NAN
    whole, kernel = run(core, space, log_T, every_pair, table, True, ys), core.pack_nodes(space, log_T)
    now, value = core.first_node_step(kernel, table, ys[:, 0])
    for n in range(6):
        if n:
            now, value = core.node_step(kernel, every_pair, now, ys[:, n])
        np.testing.assert_array_equal(now, whole["table"][:, n])
        np.testing.assert_array_equal(value, whole["log_likelihood"][:, n])
    begun = run(core, space, log_T, every_pair, table, True, ys[:, :2])
    rest = run(core, space, log_T, every_pair, begun["last"], False, ys[:, 2:])
    np.testing.assert_array_equal(rest["P_prior"], whole["P_prior"][:, 2:])
    np.testing.assert_array_equal(rest["last"], whole["last"])
    np.testing.assert_array_equal(whole["P"], whole["P"].mT)


def test_what_is_known_before_a_step_is_that_of_numpy() -> None:
    rng = np.random.default_rng(2)
    space, (log_T, log_p) = space_of(rng, (6, 3, 2)), law_of(rng, 6, sparse=True)
    table = table_of(rng, log_p, 3, 2)
    found, expected = (e.before_node_step(e.pack_nodes(space, log_T), table) for e in (core, twin))
    for got, wanted in zip(found, expected, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("every_pair", [False, True], ids=["imm", "gpb2"])
@pytest.mark.parametrize("q", [1, 2, 3])
def test_singular_covariances_are_refused_where_numpy_refuses_them(q, every_pair) -> None:
    rng = np.random.default_rng(3)
    space, (log_T, log_p) = space_of(rng, (4, 2, q)), law_of(rng, 4)
    space.R[0, 0, 2] = 0.0
    space.H[0, 0, 2] = 0.0 if q == 1 else 1.0  # of rank one
    table, y = table_of(rng, log_p, 2, 1), rng.normal(size=(1, q))
    for engine in (core, twin):
        with pytest.raises(np.linalg.LinAlgError):
            engine.node_step(engine.pack_nodes(space, log_T), every_pair, table, y)
        with pytest.raises(np.linalg.LinAlgError):
            run(engine, space, log_T, every_pair, table, True, y[:, None])
        # a node that cannot be is asked for no density
        none = log_T.copy()
        none[:, 2] = -np.inf
        now, value = engine.node_step(engine.pack_nodes(space, none), every_pair, table, y)
        assert np.isfinite(value).all()
        assert (now[0, 1:, 2] == 0.0).all()


@pytest.mark.parametrize("every_pair", [False, True], ids=["imm", "gpb2"])
def test_weights_far_below_the_range_of_numbers_keep_their_digits(every_pair) -> None:
    # the likely node leads nowhere else: what the others hold is far below exp(-745)
    rng = np.random.default_rng(4)
    space = space_of(rng, (3, 2, 1))
    T = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.4, 0.6]])
    with np.errstate(divide="ignore"):
        log_T = np.log(T)
    table = table_of(rng, np.array([0.0, -2000.0, -2001.0]), 2, 1)
    found, expected = (
        run(e, space, log_T, every_pair, table, False, np.zeros((1, 4, 1))) for e in (core, twin)
    )
    np.testing.assert_allclose(found["table"][0, :, 0], expected["table"][0, :, 0], rtol=1e-12)
    assert_alike(found, expected)


def test_shapes_that_do_not_fit_are_refused() -> None:
    rng = np.random.default_rng(5)
    space, (log_T, log_p) = space_of(rng, (3, 2, 1)), law_of(rng, 3)
    table, kernel = table_of(rng, log_p, 2, 1), core.pack_nodes(space, log_T)
    for bad in (
        space._replace(b=space.b[..., :1]),
        space._replace(H=space.H[..., :1]),
        space._replace(F=space.F[0]),
    ):
        with pytest.raises(ValueError, match=r"shape|expected"):
            core.pack_nodes(bad, log_T)
    with pytest.raises(ValueError, match="log_transition"):
        core.pack_nodes(space, log_T[:2])
    with pytest.raises(ValueError, match="table"):
        core.node_step(kernel, False, table[:, :3], np.zeros((1, 1)))
    with pytest.raises(ValueError, match="ys"):
        core.node_step(kernel, False, table, np.zeros((1, 2)))
    with pytest.raises(ValueError, match="parameters"):
        core.node_step(
            core.pack_nodes(space_of(rng, (3, 2, 1), (2, 5)), log_T), False, table, np.zeros((1, 1))
        )
    with pytest.raises(ValueError, match="observations"):
        run(core, space, log_T, False, table, True, np.zeros((1, 0, 1)))
    with pytest.raises(ValueError, match="16"):
        core.pack_nodes(space_of(rng, (2, 17, 1)), law_of(rng, 2)[0])
