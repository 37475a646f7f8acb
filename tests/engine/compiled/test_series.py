"""Series filtered and summarised in compiled code are those of NumPy, field by field."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import series, tables
from fuzzykf.switching.laws.chain import rank

core = pytest.importorskip("fuzzykf.engine.compiled.series", reason="the compiled core has not been built")
packed = pytest.importorskip("fuzzykf.engine.compiled.tables")

SIZES = [(1, 1, 1), (3, 1, 1), (9, 1, 1), (20, 1, 1), (3, 2, 1), (7, 3, 2), (9, 1, 2), (3, 5, 2)]  # M, m, q


def ranking_of(nodes, atoms):
    """The order of nodes that are hard, or lie between two regimes."""
    return rank(nodes, np.repeat(~np.asarray(atoms)[:, None], 2, axis=1))


@pytest.fixture
def system_of(tables_of, state_of):
    """Maker of the tables and summaries of both engines, and of states of s series."""

    def make(M, m, q, order=1, signed=False, s=1):
        arguments = tables_of((M, M, m, q), order, signed=signed)
        transition, _, Axx, H, _, c, C, _, _ = arguments
        offset = np.concatenate([c[..., None], H], axis=-1)
        twice = np.einsum("ij,ijkl,ijrs->ilskr", transition, Axx, Axx)
        rng = np.random.default_rng(8)
        summary = {
            "transition": transition,
            "offset": np.moveaxis(offset, -1, 0).reshape(1 + order * q, -1),
            "twice": twice.reshape(-1, m * m),
            "noise": np.einsum("ij,ijkl->ikl", transition, C).reshape(M, m * m),
            "nodes": np.linspace(0.0, 1.0, M),
            "weights": rng.uniform(0.5, 1.5, M),
            "atoms": np.isin(np.arange(M), (0, M - 1)),
            "ranking": ranking_of(np.linspace(0.0, 1.0, M), np.isin(np.arange(M), (0, M - 1))),
        }
        table = np.stack([state_of((M, M, m, q), seed) for seed in range(s)])
        sign = np.ones((s, M)) if signed else None
        both = []
        for module in (packed, tables):
            kernel = module.pack(*arguments)
            both.append((kernel, module.Summary(kernel=kernel, **summary)))
        return both, (table, sign)

    return make


def law_of(M, m, q):
    """Arguments of `first_step` but for the observations."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(M, m + q, m + q))
    S = root @ root.mT + 0.1 * np.eye(m + q)
    return np.log(rng.dirichlet(np.ones(M))), rng.normal(size=(M, m + q)), S, np.linalg.cholesky(S[:, m:, m:])


def fields(s, n, M, m, signed=False):
    shapes = {"x": (m,), "P": (m, m), "x_prior": (m,), "P_prior": (m, m), "mu": (M,), "switch": ()}
    shapes |= {"switch_mean": (), "log_likelihood": (), "table": (1 + m + m * m, M)}
    if signed:
        shapes["sign"] = (M,)
    return {name: np.full((s, n, *shape), 7.0) for name, shape in shapes.items()}


def assert_close(got, expected, name=""):
    scale = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-11 * scale, err_msg=name)


def assert_same_series(both, begin, ys, start, stop, signed=False):
    """Filter on both engines; returns what NumPy has filled in."""
    M, _, m, _ = both[1][0].shape
    found = []
    for module, (kernel, summary) in zip((core, series), both, strict=True):
        out = fields(*ys.shape[:2], M, m, signed)
        before, last = module.filter_series(kernel, summary, begin, ys, start, stop, out)
        found.append(out | {"before": before, "last": last})
    for name, value in found[1].items():
        assert_close(found[0][name], value, name)
    return found[1]


@pytest.mark.parametrize("s", [1, 4])
@pytest.mark.parametrize("size", SIZES)
def test_from_the_initial_law(system_of, size, s) -> None:
    both, _ = system_of(*size)
    ys = np.random.default_rng(1).normal(size=(s, 70, size[2]))
    out = assert_same_series(both, law_of(*size), ys, 0, 70)
    assert (out["x_prior"][:, 0] == 7.0).all()  # that of the first observation is another's
    assert not (out["x_prior"][:, 1:] == 7.0).any()
    np.testing.assert_array_equal(out["before"], out["table"][:, -2])
    np.testing.assert_array_equal(out["last"], out["table"][:, -1])


@pytest.mark.parametrize("s", [1, 4])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("size", SIZES)
def test_from_a_state_on(system_of, size, order, s) -> None:
    both, begin = system_of(*size, order=order, s=s)
    ys = np.random.default_rng(2).normal(size=(s, 50, size[2]))
    ys[:, 20] *= 30.0  # an outlier: the fast way hands over to logarithms and back
    out = assert_same_series(both, begin, ys, 3, 45)
    for name in ("x", "mu", "log_likelihood", "table"):  # the others are as they were
        assert (out[name][:, :3] == 7.0).all()
        assert (out[name][:, 45:] == 7.0).all()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("size", [size for size in SIZES if size[0] > 1])
def test_with_negative_weights(system_of, size, order) -> None:
    both, begin = system_of(*size, order=order, signed=True)
    ys = np.random.default_rng(2).normal(size=(1, 30, size[2]))
    assert_same_series(both, begin, ys, 2, 30, signed=True)
    assert_same_series(both, (begin[0], None), ys, 2, 30, signed=True)  # no signs: all are positive


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (0, 2), (1, 2), (4, 5)])
def test_one_observation_or_two(system_of, start, stop) -> None:
    both, begin = system_of(3, 2, 1, s=2)
    ys = np.random.default_rng(4).normal(size=(2, 6, 1))
    begin = begin if start else law_of(3, 2, 1)
    out = assert_same_series(both, begin, ys, start, stop)
    if start:
        np.testing.assert_array_equal(out["before"], begin[0])
    elif stop == 1:
        np.testing.assert_array_equal(out["before"], out["last"])


def test_a_series_goes_on_where_it_was_left(system_of) -> None:
    (compiled, _), _ = system_of(7, 1, 1)
    ys = np.random.default_rng(5).normal(size=(3, 40, 1))
    whole, parts = fields(3, 40, 7, 1), fields(3, 40, 7, 1)
    core.filter_series(*compiled, law_of(7, 1, 1), ys, 0, 40, whole)
    _, last = core.filter_series(*compiled, law_of(7, 1, 1), ys, 0, 17, parts)
    core.filter_series(*compiled, (last, None), ys, 17, 40, parts)
    for name, value in whole.items():
        assert_close(parts[name], value, name)


def test_nothing_is_filled_in_but_what_is_asked_for(system_of) -> None:
    (compiled, _), begin = system_of(3, 2, 1)
    ys = np.random.default_rng(6).normal(size=(1, 9, 1))
    whole = fields(1, 9, 3, 2)
    states = core.filter_series(*compiled, begin, ys, 1, 9, whole)
    for name, value in whole.items():
        out = {name: np.full_like(value, 7.0)}
        np.testing.assert_array_equal(core.filter_series(*compiled, begin, ys, 1, 9, out), states)
        np.testing.assert_array_equal(out[name], value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ys": np.ones((2, 9))}, "ys: got shape"),
        ({"ys": np.ones((2, 9, 2))}, "ys: got shape"),
        ({"start": 5, "stop": 5}, "start, stop: got"),
        ({"start": -1}, "start, stop: got"),
        ({"stop": 10}, "start, stop: got"),
        ({"start": 1, "order": 2}, "complete windows"),
        ({"start": 0, "order": 2}, "complete windows"),
        ({"start": 0, "stop": 1, "order": 2}, "of order one"),
        ({"start": 0, "signed": True}, "without negative weights"),
        ({"start": 0, "begin": (np.ones(2), *law_of(3, 2, 1)[1:])}, "log_initial: got shape"),
        ({"start": 0, "begin": (*law_of(3, 2, 1)[:3], np.ones((3, 2, 2)))}, "factor: got shape"),
        ({"begin": (np.ones((1, 7, 3)), None)}, "table: got shape"),
        ({"signed": True, "begin": (np.ones((2, 7, 3)), np.ones((2, 4)))}, "sign: got shape"),
        ({"out": {"x": np.empty((2, 9, 3))}}, "x: expected a contiguous array"),
        ({"out": {"P": np.empty((2, 9, 2, 2), dtype=np.float32)}}, "P: expected a contiguous array"),
        ({"out": {"mu": np.empty((2, 3, 9)).mT}}, "mu: expected a contiguous array"),
        ({"out": {"table": np.empty((2, 9, 3, 7))}}, "table: expected a contiguous array"),
        ({"out": {"sign": np.empty((2, 9, 3))}}, "sign: the tables have no negative weights"),
    ],
)
def test_what_does_not_fit_is_refused(system_of, change, message) -> None:
    (compiled, _), begin = system_of(
        3, 2, 1, order=change.get("order", 1), signed=change.get("signed", False), s=2
    )
    start = change.get("start", 2)
    begin = change.get("begin", begin if start else law_of(3, 2, 1))
    ys, stop = change.get("ys", np.ones((2, 9, 1))), change.get("stop", 9)
    with pytest.raises(ValueError, match=message):
        core.filter_series(*compiled, begin, ys, start, stop, change.get("out", {}))


@pytest.mark.parametrize(
    "name", ["transition", "offset", "twice", "noise", "nodes", "weights", "atoms", "ranking"]
)
def test_a_summary_of_other_tables_is_refused(tables_of, name) -> None:
    M, m = 3, 2
    shapes = {"transition": (M, M), "offset": (2, M * M * m), "twice": (M * m * m, m * m)}
    shapes |= {"noise": (M, m * m), "nodes": (M,), "weights": (M,), "atoms": (M,), "ranking": (2, M)}
    arguments = {key: np.zeros(shape) for key, shape in shapes.items()} | {name: np.zeros((5, 5))}
    with pytest.raises(ValueError, match=f"{name}: got shape"):
        packed.Summary(packed.pack(*tables_of((M, M, m, 1))), **arguments)


# --------------------------------------------------------------------------- MPM (2020 paper, section VI-B)


def mpm(mu, nodes, weights, atoms):
    """The likelier atom, the later on a tie, if all have more than half; else the densest of the others."""
    hard = [i for i in range(len(mu)) if atoms[i]]
    soft = [i for i in range(len(mu)) if not atoms[i]]
    if hard and (not soft or sum(mu[i] for i in hard) > 0.5):
        return nodes[max(hard, key=lambda i: (mu[i], i))]
    return nodes[max(soft, key=lambda i: (mu[i] / weights[i], -i))]


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 2)], ids=["scalar", "two states", "two observations"])
@pytest.mark.parametrize(
    ("law", "atoms", "expected"),
    [
        ([0.5, 0.5], [1, 1], 1.0),  # a tie of atoms goes to the later one
        ([0.25, 0.25, 0.25, 0.25], [1, 1, 1, 1], 1.0),
        ([0.375, 0.125, 0.125, 0.375], [1, 0, 0, 1], 1.0),
        ([0.375, 0.375, 0.125, 0.125], [1, 1, 0, 0], 1 / 3),
        ([0.125, 0.375, 0.375, 0.125], [1, 0, 0, 1], 1 / 3),  # one of densities to the earlier one
        ([0.25, 0.25, 0.25, 0.25], [0, 0, 0, 0], 0.0),
        ([0.5, 0.5], [1, 0], 1.0),  # one half on the atoms is not more than half
    ],
)
def test_mpm_of_ties(tables_of, law, atoms, expected, size) -> None:
    # the dynamics are the same on all nodes, so that every observation leaves the law as it is
    M, (m, q) = len(law), size
    first = tables_of((M, M, m, q))
    same = [np.ascontiguousarray(np.broadcast_to(a[:1, :1], a.shape)) for a in first[1:]]
    kernel = packed.pack(np.tile(law, (M, 1)), *same)
    _, Axx, H, _, c, C, _, _ = same
    nodes, weights, atoms = np.linspace(0.0, 1.0, M), np.full(M, 0.5), np.array(atoms, dtype=bool)
    summary = packed.Summary(
        kernel=kernel,
        transition=np.tile(law, (M, 1)),
        offset=np.moveaxis(np.concatenate([c[..., None], H], axis=-1), -1, 0).reshape(1 + q, -1),
        twice=np.einsum("ij,ijkl,ijrs->ilskr", np.tile(law, (M, 1)), Axx, Axx).reshape(-1, m * m),
        noise=C[0].reshape(M, m * m),
        nodes=nodes,
        weights=weights,
        atoms=atoms,
        ranking=ranking_of(nodes, atoms),
    )
    state = np.zeros((1, 1 + m + m * m, M))
    state[0, 0] = np.log(law)
    state[0, 1 + m :] = np.eye(m).reshape(-1, 1)
    out = {"mu": np.empty((1, 400, M)), "switch": np.empty((1, 400))}
    ys = np.random.default_rng(6).normal(size=(1, 400, q))
    core.filter_series(kernel, summary, (state, None), ys, 1, 400, out)
    mu, switch = out["mu"][0, 1:], out["switch"][0, 1:]
    np.testing.assert_allclose(mu, np.tile(law, (399, 1)), rtol=1e-14)
    for chosen, probabilities in zip(switch, mu, strict=True):
        assert chosen == mpm(probabilities, nodes, weights, atoms)
    tied = (mu[:, np.equal.outer(law, law).argmax(axis=0)] == mu).all(axis=1)  # not broken by rounding
    if np.array(law)[atoms].sum() == 0.5:
        tied &= mu[:, atoms].sum(axis=1) == 0.5
    assert tied.sum() > 3
    np.testing.assert_array_equal(switch[tied], expected)


#: Class weights of nodes: two directions of a fade, the edges of a triangle, regimes of two nodes each.
STRATA = {
    "fades": [
        [1, 0],
        [0, 1],
        *[[1 - r, r] for r in (0.125, 0.375, 0.625, 0.875, 0.875, 0.625, 0.375, 0.125)],
    ],
    "triangle": [*np.eye(3), [0.8, 0.2, 0], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.2, 0.8, 0]],
    "shared regimes": [[1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]],
}


@pytest.mark.parametrize("size", [(1, 1), (2, 1)], ids=["scalar", "two states"])
@pytest.mark.parametrize("name", STRATA)
def test_mpm_of_nodes_that_share_values(tables_of, name, size) -> None:
    u = np.array(STRATA[name], dtype=float)
    M, (m, q) = len(u), size
    hard = u.max(axis=1) == 1.0
    values = np.unique(u, axis=0, return_inverse=True)[1].reshape(-1).astype(float)
    weights = np.where(hard, 1.0, np.random.default_rng(1).uniform(0.2, 1.0, M))
    arguments = tables_of((M, M, m, q))
    transition, _, Axx, H, _, c, C, _, _ = arguments
    summary = packed.Summary(
        kernel=packed.pack(*arguments),
        transition=transition,
        offset=np.moveaxis(np.concatenate([c[..., None], H], axis=-1), -1, 0).reshape(1 + q, -1),
        twice=np.einsum("ij,ijkl,ijrs->ilskr", transition, Axx, Axx).reshape(-1, m * m),
        noise=np.einsum("ij,ijkl->ikl", transition, C).reshape(M, m * m),
        nodes=values,
        weights=weights,
        atoms=hard,
        ranking=rank(values, np.where(hard[:, None], False, u > 0.0)),
    )
    out = {"mu": np.empty((1, 300, M)), "switch": np.empty((1, 300))}
    ys = np.random.default_rng(2).normal(size=(1, 300, q)) * 2.0
    core.filter_series(packed.pack(*arguments), summary, law_of(M, m, q), ys, 0, 300, out)
    strata = [tuple(np.flatnonzero(one > 0.0)) if soft else () for one, soft in zip(u, ~hard, strict=True)]
    for mu, switch in zip(out["mu"][0], out["switch"][0], strict=True):
        mass = {s: sum(p for p, of in zip(mu, strata, strict=True) if of == s) for s in strata}
        best = max(mass, key=mass.get) if len(mass) != 2 else () if mass[()] > 0.5 else strata[-1]
        nodes = [k for k in range(M) if strata[k] == best]
        density = {values[k]: sum(mu[j] / weights[j] for j in nodes if values[j] == values[k]) for k in nodes}
        assert switch == max(density, key=density.get)
    assert len(set(out["switch"][0])) > 2


@pytest.mark.parametrize(
    ("ranking", "problem"),
    [
        ([[0, 1, 2], [1, 2, 2]], "expected all nodes, the atoms last"),  # an atom comes first
        ([[1, 1, 2], [2, 1, 2]], "expected all nodes, the atoms last"),
        ([[1, 2, 0], [1, 1, 2]], "expected all nodes, the atoms last"),  # the edge does not end
        ([[1, 2, 0], [2, 1, 1]], "expected all nodes, the atoms last"),
    ],
)
def test_a_ranking_of_other_nodes_is_refused(tables_of, ranking, problem) -> None:
    M, m = 3, 1
    shapes = {"transition": (M, M), "offset": (2, M * M), "twice": (M, 1), "noise": (M, 1), "nodes": (M,)}
    arguments = {key: np.zeros(shape) for key, shape in shapes.items()}
    with pytest.raises(ValueError, match=problem):
        packed.Summary(
            packed.pack(*tables_of((M, M, m, 1))),
            **arguments,
            weights=np.ones(M),
            atoms=np.array([True, False, True]),
            ranking=ranking,
        )
