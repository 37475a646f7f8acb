"""Pairs of nodes of probability zero have no part in anything, on both engines, for every kernel.

The oracle are the equations of the recursion written as loops over the pairs that can be, in decimal numbers
of so many digits that no outlier rounds anything away.
"""

from __future__ import annotations

import types
from decimal import Decimal, localcontext
from functools import cache

import numpy as np
import pytest

from fuzzykf import FadeLaw
from fuzzykf.engine.numpy import backward, hidden_markov, series, switching, tables

try:
    from fuzzykf.engine import compiled
except ImportError:
    ENGINES = ["numpy"]
else:
    core = types.SimpleNamespace(**compiled.MODULES)
    ENGINES = ["numpy", *core.processor.available_instructions()]

#: Log-probabilities below this are those of nodes that cannot be.
DEAD = tables.DEAD


def chain_of(name):
    """Transition probabilities (M1, M2)."""
    rng = np.random.default_rng(3)
    if name == "fade":  # 24 pairs of 144
        return FadeLaw.between(40, 10).discretize(5).transition
    if name == "ring":  # 49 pairs of 576
        fades = {(0, 1): (1 / 20, 10), (1, 2): (1 / 30, 8), (2, 3): (1 / 15, 12), (3, 0): (1 / 25, 6)}
        return FadeLaw(4, fades, jumps={(0, 2): 0.002}).discretize(5).transition
    if name == "turning":  # fades that turn back, jumps
        return FadeLaw.between(20, 10, jump=0.01, turn_back=0.1).discretize(3).transition
    if name == "one way":  # each node leads to the next alone
        return np.roll(np.eye(9), 1, axis=1)
    if name == "transient":  # nothing leads to nodes 0 and 1, and from 0 to 2 alone
        P = np.diag(np.full(10, 0.7)) + np.diag(np.full(9, 0.3), 1)
        P[:2], P[:, :2], P[-1] = 0.0, 0.0, 0.0
        P[0, 2], P[1, 3:6], P[-1, 2:4] = 1.0, 1 / 3, 0.5
        return P
    if name == "hub":  # all nodes lead to the last one
        P = 0.8 * np.eye(20) + 0.1 * np.roll(np.eye(20), 1, axis=1)
        P[:, -1] += 0.1
        return P
    if name == "20 to 11":
        P = np.zeros((20, 11))
        for i in range(20):
            P[i, [i % 11, (3 * i + 1) % 11]] += rng.dirichlet(np.ones(2))
        return P
    assert name == "mostly positive"
    P = rng.uniform(0.1, 1.0, (7, 7)) * (np.add.outer(np.arange(7), np.arange(7)) % 3 > 0)
    return P / P.sum(axis=1, keepdims=True)


CHAINS = ["fade", "ring", "turning", "one way", "transient", "hub", "20 to 11", "mostly positive"]
SHAPES = [(1, 1, 1), (2, 2, 1), (2, 1, 1), (1, 1, 2), (5, 3, 1)]  # m, q, order
CASES = [("fade", shape) for shape in SHAPES] + [(name, shape) for name in CHAINS[1:] for shape in SHAPES[:2]]
ROUND = [case for case in CASES if case[0] != "20 to 11"]
SCALES = [1.0, 1e3, 1e100]


@cache
def system_of(chain, shape, is_alike=False):
    """Arguments of `pack`: each pair has its own system, or all have one."""
    P, (m, q, order) = chain_of(chain), shape
    rng, lead, w = np.random.default_rng(5), P.shape if not is_alike else (1, 1), q * order
    root = np.tril(rng.normal(size=(*lead, q, q)) * 0.2)
    root[..., range(q), range(q)] = rng.uniform(0.5, 1.5, (*lead, q))
    Axx = rng.normal(size=(*lead, m, m))
    Axx *= 0.8 / np.linalg.norm(Axx, 2, axis=(2, 3), keepdims=True)
    C = rng.normal(size=(*lead, m, m))
    parts = [root, Axx, rng.normal(size=(*lead, m, w)), rng.normal(size=(*lead, m, q))]
    parts += [rng.normal(size=(*lead, m)), C @ np.swapaxes(C, -1, -2)]
    parts += [rng.normal(size=(*lead, q, w)) * 0.3, rng.normal(size=(*lead, q))]
    return P, *(np.ascontiguousarray(np.broadcast_to(part, P.shape + part.shape[2:])) for part in parts)


def state_of(chain, shape, dead=()):
    """A table, and a row (1, w, y'); nodes of ``dead`` are impossible."""
    M, (m, q, order) = len(chain_of(chain)), shape
    rng = np.random.default_rng(6)
    root, p = rng.normal(size=(M, m, m)), rng.dirichlet(np.ones(M))
    p[list(dead)] = 0.0
    log_p = np.log(p / p.sum(), where=p > 0.0, out=np.full(M, tables.LOG_ZERO))
    P = (root @ np.swapaxes(root, -1, -2)).reshape(M, -1).T
    u = np.concatenate([np.ones(1), rng.normal(size=(order + 1) * q)])
    return np.concatenate([log_p[None], rng.normal(size=(m, M)), P]), u


# --------------------------------------------------------------------------- the oracle


def exact(values):
    """The same numbers as decimals."""
    return np.vectorize(Decimal, otypes=[object])(values)


def log_densities(arguments, u):
    """Log |P_ij| + log N(y'; Ayy w + Ny, Qyy) by pair that can be."""
    P, root, *_, Ayy, Ny = arguments
    q, found = root.shape[-1], {}
    for i, j in zip(*np.nonzero(P), strict=True):
        L = exact(root[i, j])
        z = exact(u[-q:]) - exact(Ayy[i, j]) @ exact(u[1:-q]) - exact(Ny[i, j])
        for r in range(q):
            z[r] = (z[r] - sum(L[r, s] * z[s] for s in range(r))) / L[r, r]
        constants = np.log(P[i, j]) - np.log(np.diag(root[i, j])).sum() - 0.5 * q * np.log(2.0 * np.pi)
        found[int(i), int(j)] = Decimal(constants) - sum(z * z) / 2
    return found


def weights_of(log_w):
    """Weights of those entries, and the logarithm of their sum."""
    best = max(log_w.values())
    w = {key: np.exp(float(value - best)) for key, value in log_w.items()}
    total = sum(w.values())
    return {key: value / total for key, value in w.items()}, best + Decimal(np.log(total))


def step_by_loops(arguments, table, u):
    """Equations (10) to (20): log-probabilities, means, covariances, NaN if impossible; log-likelihood."""
    P, _, Axx, H, G, c, C, _, _ = arguments
    M2, m, q = P.shape[1], H.shape[2], G.shape[3]
    log_w = log_densities(arguments, u)
    log_w = {k: value + Decimal(table[0, k[0]]) for k, value in log_w.items() if table[0, k[0]] > DEAD}
    log_p, x, V = np.full(M2, -np.inf), np.full((M2, m), np.nan), np.full((M2, m, m), np.nan)
    total = weights_of(log_w)[1]
    y, w = exact(u[-q:]), exact(u[1:-q])
    for j in range(M2):
        column = {k: value for k, value in log_w.items() if k[1] == j}
        if not column:
            continue
        o, log_column = weights_of(column)
        log_p[j] = float(log_column - total)
        means = {
            k: exact(Axx[k]) @ exact(table[1 : 1 + m, k[0]]) + exact(H[k]) @ w + exact(G[k]) @ y + exact(c[k])
            for k in column
        }
        first = means[max(o, key=o.get)]  # weights sum to one but for rounding
        mean = first + sum(Decimal(o[k]) * (means[k] - first) for k in column)
        x[j], V[j] = mean, 0.0
        for k in column:
            off = (means[k] - mean).astype(float)
            within = Axx[k] @ table[1 + m :, k[0]].reshape(m, m) @ Axx[k].T + C[k]
            V[j] += o[k] * (within + np.outer(off, off))
    return log_p, x, V, float(total)


@cache
def expected_step(chain, shape, scale, is_alike, dead):
    """What a step leads to, and the size of the log-densities."""
    arguments, (table, u) = system_of(chain, shape, is_alike), state_of(chain, shape, dead)
    u = np.concatenate([u[:1], scale * u[1:]])
    with localcontext(prec=260):
        largest = max(abs(value) for value in log_densities(arguments, u).values())
        return table, u, step_by_loops(arguments, table, u), float(largest)


# --------------------------------------------------------------------------- engines


@pytest.fixture(params=ENGINES)
def engine(request):
    """Functions of one engine, and of one set of instructions."""
    if request.param == "numpy":
        modules = tables, switching, series, backward, hidden_markov
        yield types.SimpleNamespace(**{k: v for module in modules for k, v in vars(module).items()})
        return
    before = core.processor.instructions()
    core.processor.use_instructions(request.param)
    modules = core.tables, core.switching, core.series, core.backward, core.hidden_markov
    yield types.SimpleNamespace(**{k: v for module in modules for k, v in vars(module).items()})
    core.processor.use_instructions(before)


def assert_step(got, expected, tolerance, of_covariance):
    """A table is that of the oracle; nodes that no path reaches have no moments, and log 0."""
    log_p, x, V, _ = expected
    can_be, m = np.isfinite(log_p), x.shape[1]
    assert (got[0, ~can_be] < DEAD).all()
    assert (got[1:, ~can_be] == 0.0).all()
    size = np.abs(x[can_be]).max()
    np.testing.assert_allclose(got[0, can_be], log_p[can_be], rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(got[1 : 1 + m, can_be].T, x[can_be], rtol=tolerance, atol=tolerance * size)
    V = V[can_be].reshape(-1, m * m)
    if of_covariance < 1.0:
        atol = of_covariance * np.abs(V).max()
        np.testing.assert_allclose(got[1 + m :, can_be].T, V, rtol=of_covariance, atol=atol)


def tolerance_of(scale, largest, is_alike=False):
    """Coefficients rounded by 1e-16 move log-densities by so much; far off one pair has all the weight."""
    return 1e-12 if is_alike or scale > 1e6 else max(1e-12, 2e-15 * largest)


DEEPEST = {"fade": 2, "ring": 3, "turning": 3, "one way": 1, "transient": 4, "hub": 20, "20 to 11": 4}


@pytest.mark.parametrize(("chain", "deepest"), DEEPEST.items())
def test_pairs_that_cannot_be_have_no_room_where_that_pays(engine, chain, deepest) -> None:
    P = chain_of(chain)
    assert (P > 0.0).sum(axis=0).max() == deepest
    assert engine.pack(*system_of(chain, (2, 2, 1))).depth == deepest
    assert engine.pack(np.full(P.shape, 1.0 / P.shape[1]), *system_of(chain, (2, 2, 1))[1:]).depth == len(P)
    assert engine.pack(*system_of("mostly positive", (1, 1, 1))).depth == 7


@pytest.mark.parametrize("is_alike", [False, True], ids=["pairs that differ", "pairs alike"])
@pytest.mark.parametrize(("chain", "shape"), CASES)
def test_a_step_is_that_of_loops_over_the_pairs_that_can_be(engine, chain, shape, is_alike) -> None:
    kernel = engine.pack(*system_of(chain, shape, is_alike))
    q, M1 = shape[1], len(chain_of(chain))
    for scale in SCALES:
        for dead in [(), (M1 - 1,), tuple(range(1, M1))] if scale == 1.0 else [(0,)]:
            table, u, expected, largest = expected_step(chain, shape, scale, is_alike, dead)
            got, sign, log_likelihood = engine.step(kernel, table, None, u[1:-q], u[-q:])
            assert sign is None
            tolerance = tolerance_of(scale, largest, is_alike)
            # means as large as the outlier round the differences away that the pairs had before it
            of_covariance = max(tolerance, 1e-15 * scale) if is_alike else tolerance
            assert_step(got, expected, tolerance, of_covariance)
            np.testing.assert_allclose(log_likelihood, expected[3], rtol=tolerance)
            side_by_side = engine.step_many(kernel, np.stack([table, table]), np.stack([u, u]))
            for one in side_by_side[0]:
                assert_step(one, expected, tolerance, of_covariance)
            np.testing.assert_allclose(side_by_side[1], expected[3], rtol=tolerance)


@pytest.mark.parametrize(("chain", "shape"), CASES)
def test_densities_beyond_all_numbers_are_no_law(engine, chain, shape) -> None:
    kernel, (table, u), q = engine.pack(*system_of(chain, shape)), state_of(chain, shape), shape[1]
    with np.errstate(all="ignore"):
        assert np.isnan(engine.step(kernel, table, None, u[1:-q], 1e200 * u[-q:])[2])
        assert np.isnan(
            engine.step_many(kernel, table[None], np.append(u[:-q], 1e200 * u[-q:])[None])[1]
        ).all()


@pytest.mark.parametrize(("chain", "shape"), ROUND)
def test_a_series_is_its_steps(engine, chain, shape) -> None:
    # long enough for probabilities of zero to add up to minus infinity if they did
    _, q, order = shape
    kernel = engine.pack(*system_of(chain, shape))
    ys = np.random.default_rng(8).normal(size=(70, q))
    ys[[30, 31, 45, 60]] *= np.array([30.0, 1e3, 1e30, 1e3])[:, None]
    U = np.array([np.concatenate([[1.0], ys[t - order : t][::-1].ravel(), ys[t]]) for t in range(order, 70)])
    table = state_of(chain, shape, (0,))[0]
    tables_, signs, values = engine.run(kernel, table, None, U)
    assert signs is None
    assert np.isfinite(tables_).all()
    for u, new, value in zip(U, tables_, values, strict=True):
        got, _, log_likelihood = engine.step(kernel, table, None, u[1:-q], u[-q:])
        can_be = new[0] > DEAD
        np.testing.assert_array_equal(can_be, got[0] > DEAD)
        size = np.abs(new[:, can_be]).max(axis=1, keepdims=True)
        assert (np.abs(got - new)[:, can_be] <= 1e-9 * np.abs(new[:, can_be]) + 1e-11 * size).all()
        np.testing.assert_allclose(log_likelihood, value, rtol=1e-12)
        table = new
    np.testing.assert_array_equal(tables_[-1, 0] > DEAD, _reached(chain, (0,), len(U)))


def _reached(chain, dead, n):
    """Which nodes can be after n steps."""
    P = chain_of(chain) > 0.0
    now = ~np.isin(np.arange(len(P)), dead)
    for _ in range(n):
        now = now @ P
    return now


@pytest.mark.parametrize(("chain", "shape"), CASES)
def test_log_densities_of_pairs_that_cannot_be_are_those_of_zero(engine, chain, shape) -> None:
    arguments, (_, u) = system_of(chain, shape), state_of(chain, shape)
    got = engine.log_pairs(engine.pack(*arguments), np.stack([u, u])).reshape(2, *arguments[0].shape)
    with localcontext(prec=60):
        expected = {k: float(value) for k, value in log_densities(arguments, u).items()}
    for one in got:
        assert (one[arguments[0] == 0.0] < DEAD).all()
        for k, value in expected.items():
            np.testing.assert_allclose(one[k], value, rtol=1e-12)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("chain", "shape"), CASES)
def test_the_way_back_is_that_of_loops(engine, chain, shape, scale) -> None:
    arguments, (table, u) = system_of(chain, shape), state_of(chain, shape, (1,))
    u = np.concatenate([u[:1], scale * u[1:]])
    kernel, (M1, M2), log_p = engine.pack(*arguments), arguments[0].shape, table[0]
    with localcontext(prec=260):
        log_w = {k: v + Decimal(log_p[k[0]]) for k, v in log_densities(arguments, u).items() if k[0] != 1}
        columns = [{k: value for k, value in log_w.items() if k[1] == j} for j in range(M2)]
        o = [weights_of(column)[0] if column else {} for column in columns]
        best = max(log_w.values())
        score = [float(max(column.values()) - best) if column else -np.inf for column in columns]
        pointers = [max(column, key=column.get)[0] if column else None for column in columns]
    after = np.random.default_rng(4).dirichlet(np.ones(M2)) * np.isfinite(score)
    after /= after.sum()
    expected = np.zeros(M1)
    for j, column in enumerate(o):
        for (i, _), share in column.items():
            expected[i] += share * after[j]
    tolerance = tolerance_of(scale, -float(min(log_w.values())))
    got = engine.smooth_back(kernel, log_p[None], u[None], after)[0]
    np.testing.assert_allclose(got, expected, rtol=tolerance, atol=tolerance)
    end, nodes = engine.best_path(kernel, log_p, u[None])
    can_be = np.isfinite(score)
    assert (end[~can_be] < DEAD).all()
    np.testing.assert_allclose(end[can_be], np.array(score)[can_be], rtol=tolerance, atol=tolerance)
    assert [int(i) for i, there in zip(nodes[0], can_be, strict=True) if there] == [
        i for i in pointers if i is not None
    ]


@pytest.mark.parametrize(("chain", "shape"), ROUND)
def test_the_prediction_is_the_mixture_of_the_pairs_that_can_be(engine, chain, shape) -> None:
    arguments, (table, u) = system_of(chain, shape), state_of(chain, shape, (1,))
    P, _, Axx, H, _, c, C, *_ = arguments
    (m, q, order), M = shape, len(P)
    offset = np.moveaxis(np.concatenate([c[..., None], H], axis=-1), -1, 0).reshape(1 + order * q, -1)
    twice = np.einsum("ij,ijkl,ijrs->ilskr", P, Axx, Axx).reshape(-1, m * m)
    noise = np.einsum("ij,ijkl->ikl", P, C).reshape(M, m * m)
    kernel = engine.pack(*arguments)
    last = [1] * (M - 2) + [2, 2]
    switch = np.linspace(0.0, 1.0, M), np.ones(M), np.arange(M) == M - 1, np.array([np.arange(M), last])
    summary = engine.Summary(kernel, P, offset, twice, noise, *switch)
    ys = u[1:].reshape(1, -1, q)[:, ::-1].copy()
    ys = np.concatenate([ys[:, -1 - order :], ys[:, :1]], axis=1) if ys.shape[1] > order else ys
    out = {"x_prior": np.empty((1, ys.shape[1], m)), "P_prior": np.empty((1, ys.shape[1], m, m))}
    engine.filter_series(kernel, summary, (table[None], None), ys, order, order + 1, out)
    window = ys[0, :order][::-1].ravel()
    weights, means, within = [], [], []
    for i, j in zip(*np.nonzero(P), strict=True):
        weights.append(np.exp(table[0, i]) * P[i, j])
        means.append(Axx[i, j] @ table[1 : 1 + m, i] + H[i, j] @ window + c[i, j])
        within.append(Axx[i, j] @ table[1 + m :, i].reshape(m, m) @ Axx[i, j].T + C[i, j])
    mean = np.average(means, axis=0, weights=weights)
    covariance = np.einsum("k,kab->ab", weights, within)
    covariance += np.einsum("k,ka,kb->ab", weights, means - mean, means - mean)
    np.testing.assert_allclose(out["x_prior"][0, order], mean, rtol=1e-12)
    np.testing.assert_allclose(out["P_prior"][0, order], covariance, rtol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1000.0])
@pytest.mark.parametrize("chain", [name for name in CHAINS if name != "20 to 11"])
def test_hidden_markov_messages_are_those_of_loops(engine, chain, scale) -> None:
    P = chain_of(chain)
    (M, _), T, rng = P.shape, 12, np.random.default_rng(2)
    first = rng.dirichlet(np.ones(M))
    log_e = scale * rng.normal(size=(T, M, M))
    log_e[:, P == 0.0] += 1e4 * (1.0 + scale)  # what cannot be is likeliest
    with np.errstate(divide="ignore"):
        got = engine.forward_backward(first, P, log_e)
        moves = log_e + np.log(P)
        alpha, beta = [np.log(first)], [np.zeros(M)]
    for move in moves:
        alpha.append(np.logaddexp.reduce(alpha[-1][:, None] + move, axis=0))
    for move in moves[::-1]:
        beta.append(np.logaddexp.reduce(move + beta[-1], axis=1))
    alpha, beta = np.array(alpha), np.array(beta[::-1])
    totals = np.logaddexp.reduce(alpha, axis=1)
    joint = np.exp(alpha[:-1, :, None] + moves + beta[1:, None, :] - totals[-1])
    tolerance = 1e-12 * scale
    np.testing.assert_allclose(got[0], np.exp(alpha + beta - totals[-1]), rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(got[1], joint, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(got[2], np.diff(totals), rtol=tolerance, atol=tolerance)
