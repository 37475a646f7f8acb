"""Steps back into gaps are those of NumPy: scalars and vectors, parts, few pairs, long windows."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel
from fuzzykf.engine.numpy import gap_backward as numpy_back
from fuzzykf.engine.numpy import gaps

TWIN = numpy_back.back_into_gap

core = pytest.importorskip("fuzzykf.engine.compiled.gaps", reason="the compiled core has not been built")
back = pytest.importorskip("fuzzykf.engine.compiled.gap_backward")

SIZES = [(1, 1, 1, 1), (2, 1, 1, 1), (5, 1, 1, 1), (3, 2, 2, 1), (5, 3, 2, 1), (3, 1, 1, 3), (2, 1, 2, 2)]


def tables_of(K, m, q, order, band):
    """The tables of a step of K nodes, of both engines; with ``band`` few pairs of them can be."""
    rng = np.random.default_rng(K + 10 * m)
    law = rng.dirichlet(np.ones(K), K)
    if band:  # a node, and that after it
        law = np.where((np.subtract.outer(range(K), range(K)) % -K) >= -1, law, 0.0)
        law /= law.sum(axis=1, keepdims=True)
    if order > 1:
        A, B = 0.5 * np.eye(m) + 0.1 * np.arange(K)[:, None, None], rng.normal(size=(K, q, m))
        noise = np.tile(np.eye(m), (K, 1, 1)), np.tile(np.eye(q), (K, 1, 1))
        f = CGOMSMFilter(CGOMSModel.from_cglssm(law, A, B, *noise, order=order))
    else:
        d = m + q
        A = rng.uniform(-1.0, 1.0, (K, K, d, d)) / np.sqrt(d)
        A[..., m:, :m] = 0.0
        root = 0.3 * rng.normal(size=(K, K, d, d)) + 0.6 * np.eye(d)
        Q = root @ np.swapaxes(root, -1, -2)
        start = np.ones(K) / K
        f = CGOMSMFilter(
            CGOMSModel.from_transitions(law, A, Q, rng.normal(size=(K, d)), Q[0], m, initial=start)
        )
    step = f._system.pair_tables(order + 1)
    given = step.in_slots, step.noise_root, K
    return core.pack_gaps(*given), gaps.pack_gaps(*given)


def along(tables, ys, order):
    """States after a complete one, and after each observation of ``ys``: table, root, branches and window."""
    M, m, q = tables.M1, tables.step.pairs[0].shape[-1], ys.shape[1]
    table = np.concatenate([np.full((1, M), -np.log(M)), np.zeros((m + m * m, M))])
    table[1 + m :: m + 1] = 1.0
    window = np.zeros(order * q)
    states = [(table, None, None, window)]
    for y in ys:
        after = np.concatenate([y, window])[: window.size]
        _, root, branches, _ = states[-1]
        table, _, root, branches, _ = gaps.step_in_part(tables, table, None, window, root, y, after, branches)
        window = after
        states.append((table, root if np.isnan(after).any() else None, branches, window))
    return states


@pytest.mark.parametrize("band", [False, True])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(2))
def test_each_step_back_is_that_of_numpy(size, band, seed, monkeypatch) -> None:
    K, _, q, order = size
    packed, twin = tables_of(*size, band)
    rng = np.random.default_rng(seed)
    ys = rng.normal(size=(6 + order, q))
    ys[1:4][rng.random((3, q)) < 0.7] = np.nan
    ys[1, 0] = ys[2, -1] = np.nan
    states, p, told, seen = along(twin, ys, order), rng.dirichlet(np.ones(K)), None, []
    monkeypatch.setattr(numpy_back, "back_into_gap", lambda *_: pytest.fail("it was handed on to NumPy"))
    for k in range(len(ys) - 1, 0, -1):
        table, root, branches, window = states[k]
        if root is None:
            continue
        state = table, None, window, root, ys[k], p, told, branches
        got, expected = back.back_into_gap(packed, *state), TWIN(twin, *state)
        for name in ("p", "mu", "x", "P"):
            np.testing.assert_allclose(getattr(got, name), getattr(expected, name), rtol=1e-10, atol=1e-12)
        there = expected.p > 0.0
        np.testing.assert_allclose(got.told.mean[there], expected.told.mean[there], rtol=1e-11, atol=1e-12)
        spreads = [one.told.root @ np.swapaxes(one.told.root, 1, 2) for one in (got, expected)]
        np.testing.assert_allclose(spreads[0][there], spreads[1][there], rtol=1e-10, atol=1e-12)
        assert (got.log_pairs is None) == (expected.log_pairs is None) == (told is not None)
        if told is None:
            can_be = twin.step.transition > 0.0
            np.testing.assert_allclose(got.log_pairs[can_be], expected.log_pairs[can_be], rtol=1e-11)
        p, told = expected.p, expected.told
        seen.append(k)
    assert len(seen) >= 2


def test_after_an_outlier_the_step_is_that_of_numpy() -> None:
    packed, twin = tables_of(2, 1, 1, 1, False)
    (table, root, branches, window) = along(twin, np.array([[np.nan]]), 1)[1]
    state = table, None, window, root, np.array([1e5]), np.array([0.3, 0.7]), None, branches
    got, expected = back.back_into_gap(packed, *state), numpy_back.back_into_gap(twin, *state)
    for name in ("p", "mu", "x", "P"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


def test_pairs_that_are_far_less_likely_keep_their_logarithms() -> None:
    packed, twin = tables_of(2, 1, 1, 1, False)
    table, root, branches, window = along(twin, np.array([[np.nan]]), 1)[1]
    shifted = branches.table.copy()
    shifted[0, ::2] -= 450.0  # the branches of node 0
    table = table.copy()
    table[0, 0] -= 450.0
    branches = branches._replace(table=shifted)
    state = table, None, window, root, np.array([0.3]), np.array([0.3, 0.7]), None, branches
    got, expected = back.back_into_gap(packed, *state), numpy_back.back_into_gap(twin, *state)
    np.testing.assert_allclose(got.log_pairs, expected.log_pairs, rtol=1e-10)
    np.testing.assert_allclose(got.p, expected.p, rtol=1e-10, atol=0.0)


def test_what_does_not_fit_is_refused() -> None:
    packed, twin = tables_of(2, 1, 1, 1, False)
    table, root, branches, window = along(twin, np.array([[np.nan]]), 1)[1]
    state = table, None, window, root, np.array([0.3])
    with pytest.raises(ValueError, match=r"p: .*3"):
        back.back_into_gap(packed, *state, np.full(3, 1 / 3), None, branches)
