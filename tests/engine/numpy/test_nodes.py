"""IMM and GPB2 on nodes: against reference numbers, and against the textbook's formulas node by node."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fuzzykf.engine.numpy.nodes import (
    NodeSpace,
    before_node_step,
    filter_nodes,
    first_node_step,
    node_step,
    pack_nodes,
)
from fuzzykf.engine.numpy.tables import LOG_ZERO

METHODS = {"imm": False, "gpb2": True}
FIELDS = {"x": (2,), "P": (2, 2), "x_prior": (2,), "P_prior": (2, 2), "mu": (3,), "log_likelihood": ()}
T = np.array([[0.9, 0.1, 0.0], [0.2, 0.5, 0.3], [0.0, 0.0, 1.0]])
NAN = np.nan


def log(p):
    with np.errstate(divide="ignore"):
        return np.log(p)


def definite(rng, *shape):
    root = 0.5 * rng.normal(size=shape) + np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2)


def space(rng, lead=(1, 1), M=3, m=2, q=2):
    return NodeSpace(
        F=0.5 * rng.normal(size=(*lead, M, m, m)),
        b=rng.normal(size=(*lead, M, m)),
        Q=definite(rng, *lead, M, m, m),
        H=rng.normal(size=(*lead, M, q, m)),
        d=rng.normal(size=(*lead, M, q)),
        R=definite(rng, *lead, M, q, q),
    )


def packed(p, x, P):
    """States (s, ...) as a table."""
    s, M, m = x.shape
    rows = np.concatenate([x, P.reshape(s, M, m * m)], axis=2)
    return np.concatenate([np.maximum(log(p), LOG_ZERO)[:, None], np.swapaxes(rows, 1, 2)], axis=1)


def states(rng, s=1, M=3, m=2, p=None):
    p = rng.dirichlet(np.ones(M), s) if p is None else np.array([p] * s)
    return packed(p, rng.normal(size=(s, M, m)), definite(rng, s, M, m, m))


def unpacked(table):
    rows, M = table.shape
    m = int(np.sqrt(rows - 0.75) - 0.5 + 1e-9)
    return np.exp(table[0]), table[1 : 1 + m].T, table[1 + m :].T.reshape(M, m, m)


def switch(M=3):
    """The arguments of the most likely value of a hard switch."""
    nodes = np.arange(M, dtype=np.float64)
    return nodes, np.ones(M), np.ones(M, dtype=bool), np.stack([np.arange(M)[::-1], [1] * (M - 1) + [2]])


def run(parameters, table, ys, every_pair, begins=True, log_transition=None):
    M = table.shape[-1]
    out = {name: np.full((*ys.shape[:2], *shape), NAN) for name, shape in FIELDS.items()}
    log_transition = log(T) if log_transition is None else log_transition
    kernel = pack_nodes(parameters, log_transition)
    last = filter_nodes(kernel, every_pair, table, begins, ys, out, switch(M))
    return out, last


# --------------------------------------------------------------------------- the textbook


def merge(w, xs, Ps):
    w = w / w.sum()
    x = w @ xs
    return x, sum(one * (P + np.outer(e - x, e - x)) for one, e, P in zip(w, xs, Ps, strict=True))


def kalman(x, P, y, H, d, R):
    """Update with what is there of y; the density of that."""
    seen = ~np.isnan(y)
    if not seen.any():
        return x, P, 1.0
    H, d, R, y = H[seen], d[seen], R[np.ix_(seen, seen)], y[seen]
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ (y - H @ x - d), P - K @ S @ K.T, multivariate_normal.pdf(y, H @ x + d, S)


def textbook(parameters, transition, every_pair, table, y):
    """One step, pair by pair; weights as they are."""
    F, b, Q, H, d, R = (one[0, 0] for one in parameters)
    p, xs, Ps = unpacked(table)
    M = len(p)
    w, nodes = np.zeros(M), []
    for j in range(M):
        joint = p * transition[:, j]
        if not every_pair:
            x, P = merge(joint, xs, Ps)
            x, P, density = kalman(F[j] @ x + b[j], F[j] @ P @ F[j].T + Q[j], y, H[j], d[j], R[j])
            w[j] = joint.sum() * density
        else:
            pairs = [
                kalman(F[j] @ x + b[j], F[j] @ P @ F[j].T + Q[j], y, H[j], d[j], R[j])
                for x, P in zip(xs, Ps, strict=True)
            ]
            each = joint * [density for *_, density in pairs]
            x, P = merge(each, np.array([one[0] for one in pairs]), [one[1] for one in pairs])
            w[j] = each.sum()
        nodes.append((x, P))
    return w / w.sum(), *map(np.array, zip(*nodes, strict=True)), np.log(w.sum())


# --------------------------------------------------------------------------- tests


@pytest.mark.parametrize("method", METHODS)
def test_the_reference_cases_to_the_last_digits(method, ssm_cases):
    for case, model in ssm_cases:
        system = model.placed(case["n_nodes"])
        chain, tables, m = system.chain, system.tables, system.dim_x
        np.testing.assert_allclose(chain.transition, case["chain"]["transition"], rtol=0, atol=1e-15)
        law, ys = system.initial(), np.array(case["y"])[None]
        parameters = NodeSpace(
            *(getattr(tables, name)[None, None] for name in ("F", "b", "Q", "H", "d", "R"))
        )
        shapes = {"x": (m,), "P": (m, m), "mu": (len(chain),), "log_likelihood": ()}
        out = {name: np.empty((*ys.shape[:2], *shape)) for name, shape in shapes.items()}
        begin = packed(law.probability[None], law.mean[None, :, :m], law.covariance[None, :, :m, :m])
        names = chain.keys, chain.weights, chain.atoms, chain.ranking
        kernel = pack_nodes(parameters, tables.log_transition)
        filter_nodes(kernel, METHODS[method], begin, True, ys, out, names)
        expected = case["expected"][method]
        for name in ("x", "P", "log_likelihood"):
            np.testing.assert_allclose(
                out[name][0], expected[name], rtol=1e-9, atol=1e-10, err_msg=case["id"]
            )
        np.testing.assert_allclose(
            out["mu"][0] @ chain.class_weights, expected["weights"], rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("y", [[1.0, -2.0], [NAN, 0.5], [0.5, NAN], [NAN, NAN]])
@pytest.mark.parametrize("q", [1, 2])
def test_a_step_is_that_of_the_textbook(method, y, q):
    rng = np.random.default_rng(3)
    parameters, table, y = space(rng, q=q), states(rng), np.array(y[:q])
    new, value = node_step(pack_nodes(parameters, log(T)), METHODS[method], table, y[None])
    p, x, P, expected = textbook(parameters, T, METHODS[method], table[0], y)
    for got, wanted in zip(unpacked(new[0]), (p, x, P), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-11, atol=1e-13)
    assert value[0] == pytest.approx(expected, abs=1e-12)
    if np.isnan(y).all():
        assert value[0] == 0.0  # exactly, not to rounding


def test_the_first_step_moves_nothing():
    rng = np.random.default_rng(4)
    parameters, table, y = space(rng), states(rng), np.array([0.3, NAN])
    new, value = first_node_step(pack_nodes(parameters, log(T)), table, y[None])
    still = parameters._replace(F=np.eye(2) + 0 * parameters.F, b=0 * parameters.b, Q=0 * parameters.Q)
    p, x, P, expected = textbook(still, np.eye(3), True, table[0], y)
    for got, wanted in zip(unpacked(new[0]), (p, x, P), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-11, atol=1e-13)
    assert value[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_series_side_by_side_and_in_parts_are_each_alone_to_the_bit(method):
    rng = np.random.default_rng(5)
    parameters, table, ys = space(rng), states(rng, s=4), 2.0 * rng.normal(size=(4, 30, 2))
    ys[1, 3:5] = ys[2, 0] = ys[3, 7, 1] = NAN
    every_pair = METHODS[method]
    whole, (before, last) = run(parameters, table, ys, every_pair)
    for k in range(4):
        one = slice(k, k + 1)
        first, (_, middle) = run(parameters, table[one], ys[one, :11], every_pair)
        rest, ends = run(parameters, middle, ys[one, 11:], every_pair, begins=False)
        for name, values in whole.items():
            parts = np.concatenate([first[name], rest[name]], axis=1)
            np.testing.assert_array_equal(values[one], parts, err_msg=name)
        np.testing.assert_array_equal(ends, (before[one], last[one]))
    assert not any(np.isnan(values).any() for values in whole.values())
    for name in ("P", "P_prior"):
        np.testing.assert_array_equal(whole[name], np.swapaxes(whole[name], -1, -2))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("lead", [(1, 6), (3, 1), (3, 6)], ids=["steps", "series", "both"])
def test_parameters_may_be_those_of_each_step_and_of_each_series(method, lead):
    rng = np.random.default_rng(6)
    parameters, table, ys = space(rng, lead), states(rng, s=3), rng.normal(size=(3, 6, 2))
    whole, _ = run(parameters, table, ys, METHODS[method])
    for k in range(3):
        now = table[k : k + 1]
        for n in range(6):
            here = NodeSpace(
                *(one[min(k, lead[0] - 1), None, min(n, lead[1] - 1), None] for one in parameters)
            )
            if n == 0:
                now, value = first_node_step(pack_nodes(here, log(T)), now, ys[k, :1])
            else:
                now, value = node_step(pack_nodes(here, log(T)), METHODS[method], now, ys[k, n, None])
            np.testing.assert_allclose(whole["log_likelihood"][k, n], value[0], rtol=1e-12)
            np.testing.assert_allclose(whole["mu"][k, n], np.exp(now[0, 0]), rtol=1e-10, atol=1e-14)


def test_many_series_in_blocks_and_long_ones_in_chunks_are_whole(monkeypatch):
    from fuzzykf.engine.numpy import nodes

    rng = np.random.default_rng(7)
    parameters, table, ys = space(rng), states(rng, s=5), rng.normal(size=(5, 9, 2))
    expected, states_there = run(parameters, table, ys, True)
    monkeypatch.setattr(nodes, "_BLOCK", 2 * 7 * 7)
    monkeypatch.setattr(nodes, "_NUMBERS", 2 * 4 * 7 * 3)
    found, states_here = run(parameters, table, ys, True)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    np.testing.assert_array_equal(states_here, states_there)


@pytest.mark.parametrize("method", METHODS)
def test_what_no_path_reaches_keeps_no_mass_and_is_asked_for_no_density(method):
    rng = np.random.default_rng(8)
    parameters, table = space(rng), states(rng, p=[1.0, 0.0, 0.0])
    parameters.Q[0, 0, 2] = parameters.R[0, 0, 2] = 0.0  # S is zero where H is
    parameters.H[0, 0, 2] = 0.0
    new, value = node_step(pack_nodes(parameters, log(T)), METHODS[method], table, np.array([[0.1, 0.2]]))
    assert np.isfinite(new).all()
    assert np.isfinite(value).all()
    assert new[0, 0, 2] == LOG_ZERO
    table = states(rng, p=[0.0, 0.5, 0.5])
    with pytest.raises(np.linalg.LinAlgError):
        node_step(pack_nodes(parameters, log(T)), METHODS[method], table, np.array([[0.1, 0.2]]))


def test_pairs_that_cannot_be_cost_nothing():
    from fuzzykf.engine.numpy.nodes import _pairs_of

    unreached = np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [1.0, 0.0, 0.0]])
    for transition, expected in ((T, 6), (unreached, 6)):  # of nine; the last node then stays alone
        pairs = _pairs_of(log(transition))
        assert len(pairs.after) == expected
        assert pairs.after[pairs.begins].tolist() == [0, 1, 2]
    assert (pairs.before[-1], pairs.after[-1]) == (2, 2)


def test_a_scalar_observation_without_spread_is_refused_as_others_are():
    rng = np.random.default_rng(9)
    parameters, table = space(rng, q=1), states(rng)
    parameters.H[:] = parameters.R[:] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        node_step(pack_nodes(parameters, log(T)), False, table, np.array([[0.1]]))


@pytest.mark.parametrize("method", METHODS)
def test_before_a_step_both_methods_know_the_same(method):
    rng = np.random.default_rng(10)
    parameters, table = space(rng), states(rng)
    mu, x, P = before_node_step(pack_nodes(parameters, log(T)), table)
    new, _ = node_step(pack_nodes(parameters, log(T)), METHODS[method], table, np.array([[NAN, NAN]]))
    p, xs, Ps = unpacked(new[0])
    for got, wanted in ((mu[0], p), (x[0], xs), (P[0], Ps)):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_two_nodes_that_are_alike_stay_alike_however_far_an_observation_is(method):
    rng = np.random.default_rng(11)
    parameters, M = space(rng, M=2), np.array([[0.7, 0.3], [0.3, 0.7]])
    alike = NodeSpace(*(np.repeat(one[:, :, :1], 2, axis=2) for one in parameters))
    x, P = rng.normal(size=(1, 1, 2)), definite(rng, 1, 1, 2, 2)
    table = packed(np.array([[0.8, 0.2]]), np.repeat(x, 2, axis=1), np.repeat(P, 2, axis=1))
    for size in (1.0, 1e3, 1e6, 1e9):
        y = size * np.array([[1.0, -1.0]])
        new, value = node_step(pack_nodes(alike, log(M)), METHODS[method], table, y)
        # the densities are equal to the bit, so the prior stays: .8 .7 + .2 .3
        np.testing.assert_allclose(np.exp(new[0, 0]), [0.62, 0.38], rtol=1e-14)
        assert np.isfinite(value).all()
