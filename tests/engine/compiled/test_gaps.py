"""Steps and series with something missing are those of NumPy, on every set of instructions."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel
from fuzzykf.engine.numpy import gap_series, gaps, tables
from fuzzykf.switching.dynamics import pairs

core = pytest.importorskip("fuzzykf.engine.compiled.gaps", reason="the compiled core has not been built")
series = pytest.importorskip("fuzzykf.engine.compiled.gap_series")

#: Nodes, states, observed components, and how many observations a step looks at.
SIZES = [(1, 1, 1, 1), (2, 1, 1, 1), (9, 1, 1, 1), (3, 2, 2, 1), (3, 1, 1, 3), (9, 3, 2, 1), (2, 1, 2, 2)]
FIELDS = ("x", "P", "x_prior", "P_prior", "mu", "switch", "switch_mean", "log_likelihood")


def system_of(K, m, q, order, band=False):
    """A system of K nodes; with ``band`` few pairs of them can be."""
    rng = np.random.default_rng(K + 10 * m)
    law = rng.dirichlet(np.ones(K), K)
    if band:
        law = np.where(np.abs(np.subtract.outer(range(K), range(K))) < 2, law, 0.0)
        law /= law.sum(axis=1, keepdims=True)
    if order > 1:
        A, B = 0.5 * np.eye(m) + 0.1 * np.arange(K)[:, None, None], rng.normal(size=(K, q, m))
        noise = np.tile(np.eye(m), (K, 1, 1)), np.tile(np.eye(q), (K, 1, 1))
        return CGOMSMFilter(CGOMSModel.from_cglssm(law, A, B, *noise, order=order))._system
    d = m + q
    A = rng.uniform(-1.0, 1.0, (K, K, d, d)) / np.sqrt(d)
    A[..., m:, :m] = 0.0
    root = 0.3 * rng.normal(size=(K, K, d, d)) + 0.6 * np.eye(d)
    Q = root @ np.swapaxes(root, -1, -2)
    start = np.ones(K) / K
    model = CGOMSModel.from_transitions(law, A, Q, rng.normal(size=(K, d)), Q[0], m, initial=start)
    return CGOMSMFilter(model)._system


def observations(q, n, seed=0):
    rng = np.random.default_rng(seed)
    ys = rng.normal(size=(n, q))
    ys[rng.random(ys.shape) < 0.4] = np.nan
    ys[:3], ys[-2:] = 0.5, np.nan
    return ys


def both(system, n):
    """The tables of a step in both engines."""
    pair_tables = system.pair_tables(n)
    given = pair_tables.in_slots, pair_tables.noise_root, len(pair_tables.transition)
    return pair_tables, core.pack_gaps(*given), gaps.pack_gaps(*given)


def check(got, expected):
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("band", [False, True])
@pytest.mark.parametrize("size", SIZES)
def test_series_are_those_of_numpy(size, band, instructions) -> None:
    m, q, order = size[1:]
    system = system_of(*size, band=band)
    pair_tables, packed, twin = both(system, order)
    summary, kernel = pair_tables.summary(system.chain), pair_tables.kernel
    given = pair_tables.pairs
    plain = tables.pack(pair_tables.transition, np.linalg.cholesky(given.Qyy), *given[:5], *given[5:7])
    ys = observations(q, 40)[None]
    table = np.concatenate([np.full((1, size[0]), -np.log(size[0])), np.zeros((m + m * m, size[0]))])
    table[1 + m :: m + 1] = 1.0
    found = []
    for module, tables_of, kernel_of, summary_of in (
        (series, packed, kernel, summary),
        (gap_series, twin, plain, numpy_summary(system, pair_tables, plain)),
    ):
        out = {name: np.zeros((1, 40, *shape(name, m, size[0]))) for name in FIELDS}
        result = module.filter_gappy(tables_of, kernel_of, summary_of, (table[None],), ys, order, 40, out)
        found.append((out, result))
    (got, (before, last, reached, states)), (expected, (before_, last_, _, states_)) = found
    assert reached.tolist() == [40]
    for name in FIELDS:
        check(got[name][:, order:], expected[name][:, order:])
    for one, other in ((before, before_), (last, last_)):
        check(np.exp(one[:, 0]), np.exp(other[:, 0]))
        check(one[:, 1:], other[:, 1:])
    for one, other in zip(states, states_, strict=True):  # two observations are missing at the end
        check(one.table[1:], other.table[1:])
        check(one.root @ np.swapaxes(one.root, 1, 2), other.root @ np.swapaxes(other.root, 1, 2))
        assert (one.branches is None) == (other.branches is None)
        if one.branches is not None:
            check(np.exp(one.branches.table[0]), np.exp(other.branches.table[0]))
            check(one.branches.table[1:], other.branches.table[1:])


@pytest.mark.parametrize("size", [size for size in SIZES if size[3] == 1])
def test_first_observations_in_part_are_those_of_numpy(size, instructions) -> None:
    M, m, q, _ = size
    system = system_of(*size)
    pair_tables, packed, twin = both(system, 0)
    summary, kernel, given = pair_tables.summary(system.chain), pair_tables.kernel, pair_tables.pairs
    plain = tables.pack(pair_tables.transition, np.linalg.cholesky(given.Qyy), *given[:5], *given[5:7])
    ys = np.stack([observations(q, 6, seed) for seed in range(5)])
    ys[0, 0], ys[1, :3], ys[2] = np.nan, np.nan, np.nan  # the others are complete there
    ys[3, 0, 0] = np.nan
    found = []
    for module, tables_of, kernel_of, summary_of in (
        (series, packed, kernel, summary),
        (gap_series, twin, plain, numpy_summary(system, pair_tables, plain)),
    ):
        out = {name: np.zeros((5, 6, *shape(name, m, M))) for name in FIELDS}
        law = system.initial().start(q)
        result = module.filter_gappy(tables_of, kernel_of, summary_of, law, ys, 0, 6, out)
        found.append((out, result))
    (got, (before, last, reached, _)), (expected, (before_, last_, reached_, _)) = found
    assert reached.tolist() == reached_.tolist() == [6] * 5
    for name in FIELDS:
        begin = 1 if "prior" in name else 0  # what is known before any is for who calls
        check(got[name][:, begin:], expected[name][:, begin:])
    for one, other in ((before, before_), (last, last_)):
        check(np.exp(one[:, 0]), np.exp(other[:, 0]))
        check(one[:, 1:], other[:, 1:])


def numpy_summary(system, pair_tables, kernel):
    """The summary of NumPy, from what the tables make theirs of."""
    fresh = type(pair_tables)(pair_tables.transition, pair_tables.pairs)
    with patch.object(pairs, "Summary", lambda _, *rest: tables.Summary(kernel, *rest)):
        return fresh.summary(system.chain)


def shape(name, m, M):
    return {"x": (m,), "x_prior": (m,), "P": (m, m), "P_prior": (m, m), "mu": (M,)}.get(name, ())


def test_after_an_outlier_the_step_is_that_of_numpy() -> None:
    system = system_of(3, 1, 1, 1)
    _, packed, twin = both(system, 0)
    table = np.array([[np.log(0.2), np.log(0.5), np.log(0.3)], [0.0, 1.0, 2.0], [1.0, 1.0, 2.0]])
    gap, none = np.array([np.nan]), np.array([1e6])
    _, _, root, branches, _ = gaps.step_in_part(twin, table, None, none, None, gap, gap)
    first = core.step_in_part(packed, table, None, none, None, gap, gap)
    for got, expected in ((first[2] ** 2, root**2), (first[3].table[1:], branches.table[1:])):
        np.testing.assert_allclose(np.abs(got).sum(), np.abs(expected).sum(), rtol=1e-9)
    far = np.array([-1e8])
    state = first[0], None, gap, first[2], far, far, first[3]
    got, expected = core.step_in_part(packed, *state), gaps.step_in_part(twin, *state)
    for one, other in zip((got[0], got[4]), (expected[0], expected[4]), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_not_compiled_is_refused() -> None:
    pair_tables, packed, twin = both(system_of(2, 1, 1, 1), 0)
    step = pair_tables.in_slots._replace(transition=np.array([[1.1, -0.1], [0.5, 0.5]]))
    with pytest.raises(ValueError, match="expected no negative weights"):
        core.pack_gaps(step, pair_tables.noise_root, 2)
    assert series.fit_together(packed, pair_tables.kernel)
    assert not series.fit_together(twin, pair_tables.kernel)
