"""The compiled kernels are the NumPy kernels: equal numbers, for any shape, any data and any input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.engine.numpy import series, switching, tables

core = pytest.importorskip("fuzzykf.engine.compiled.switching", reason="the compiled core has not been built")
core_series = pytest.importorskip("fuzzykf.engine.compiled.series")
packed = pytest.importorskip("fuzzykf.engine.compiled.tables")

few = settings(max_examples=40, deadline=None)
SIZES = [(1, 1, 1, 1), (3, 3, 1, 1), (7, 7, 1, 1), (8, 8, 1, 1), (9, 9, 1, 1), (20, 20, 1, 1), (5, 3, 1, 1)]
SIZES += [(3, 3, 2, 1), (7, 7, 3, 1), (7, 7, 4, 2), (2, 2, 5, 3), (4, 4, 1, 2), (9, 9, 2, 2)]


def rows_of(shape, n, scale=1.0, order=1, seed=0):
    y = np.random.default_rng(seed + 2).normal(size=(n, (order + 1) * shape[3])) * scale
    return np.concatenate([np.ones((n, 1)), y], axis=1)


def assert_same(got, expected, largest=0.0):
    """Equal to 1e-12, or to 1e-15 times the largest log-weight where that is more."""
    tolerance = max(1e-12, 1e-15 * largest)
    for a, b in zip(got, expected, strict=True):
        if b is None:
            assert a is None
        else:
            np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance * np.abs(b).max(initial=1.0))


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize(("signed", "zeros", "order"), [(0, 0, 1), (1, 0, 1), (0, 1, 1), (0, 0, 3)])
def test_a_step_and_the_pairs_are_those_of_numpy(shape, signed, zeros, order, tables_of, state_of) -> None:
    arguments = tables_of(shape, order, signed=signed, zeros=zeros)
    reference, compiled = tables.pack(*arguments), packed.pack(*arguments)
    table, U = state_of(shape), rows_of(shape, 3, order=order)
    w = order * shape[3]
    sign = np.ones(shape[0]) if reference.sign is not None else None
    for u in U:
        window, y = u[1 : 1 + w], u[1 + w :]
        got, expected = (
            k.step(p, table, sign, window, y) for k, p in ((core, compiled), (switching, reference))
        )
        for a, b in zip(got[0], expected[0], strict=True):  # the dead nodes' logarithms are huge
            assert_same([a[b > switching.DEAD]], [b[b > switching.DEAD]])
        assert_same([got[2]], [expected[2]])
        if expected[1] is not None:
            np.testing.assert_array_equal(got[1], expected[1])
    np.testing.assert_allclose(
        core.log_pairs(compiled, U), switching.log_pairs(reference, U), rtol=1e-12, atol=1e-12
    )
    assert compiled.shape == shape


@pytest.mark.parametrize("shape", [s for s in SIZES if s[0] == s[1]])
@pytest.mark.parametrize("deviations", [1.0, 10.0, 30.0, 100.0])
def test_a_series_is_that_of_numpy_up_to_100_standard_deviations(
    shape, deviations, tables_of, state_of
) -> None:
    arguments = tables_of(shape)
    reference, compiled = tables.pack(*arguments), packed.pack(*arguments)
    U = rows_of(shape, 40)
    _, L, *_, Ayy, Ny = arguments
    w = shape[3]
    innovation = U[:, None, None, 1 + w :] - (Ayy @ U[:, None, None, 1 : 1 + w, None])[..., 0] - Ny
    white = np.linalg.solve(L, innovation[..., None])
    U[:, 1:] *= deviations / np.abs(white).max()  # no innovation is further off, for any pair
    got, expected = (
        core_series.run(compiled, state_of(shape), None, U),
        series.run(reference, state_of(shape), None, U),
    )
    assert_same(got, expected)
    for table, u in zip(got[0][:-1], U[1:], strict=True):  # the state after a step stands for itself
        assert np.isfinite(core.step(compiled, table, None, u[1 : 1 + shape[3]], u[1 + shape[3] :])[2])


@pytest.mark.parametrize("shape", [(7, 7, 1, 1), (3, 3, 2, 2), (7, 7, 4, 2)])
@pytest.mark.parametrize("scale", [1e3, 1e5, 1e8])
@pytest.mark.parametrize("seed", range(3))
def test_far_outliers_differ_by_the_rounding_of_their_weights_only(
    shape, scale, seed, tables_of, state_of
) -> None:
    arguments = tables_of(shape, seed=seed)
    reference, compiled = tables.pack(*arguments), packed.pack(*arguments)
    U = rows_of(shape, 30)
    U[10, -1] = U[11, 1] = scale  # an outlier, and ordinary data after it
    largest = np.abs(switching.log_pairs(reference, U)).max()
    got = core_series.run(compiled, state_of(shape), None, U)
    assert_same(got, series.run(reference, state_of(shape), None, U), 1.0 * largest)
    assert all(np.isfinite(part).all() for part in (got[0], got[2]))


def test_a_signed_series_is_that_of_numpy(tables_of, state_of) -> None:
    shape = (6, 6, 1, 1)
    arguments = tables_of(shape, signed=True)
    U = rows_of(shape, 30)
    got = core_series.run(packed.pack(*arguments), state_of(shape), np.ones(6), U)
    assert_same(got, series.run(tables.pack(*arguments), state_of(shape), np.ones(6), U))


@pytest.mark.parametrize("shape", SIZES)
def test_many_series_side_by_side_are_those_of_numpy(shape, tables_of, state_of) -> None:
    arguments = tables_of(shape)
    states = np.stack([state_of(shape, seed) for seed in range(4)])
    U = rows_of(shape, 4)
    got = core_series.step_many(packed.pack(*arguments), states, U)
    assert_same(got, series.step_many(tables.pack(*arguments), states, U))


@pytest.mark.parametrize(("M", "m", "q"), [(1, 1, 1), (7, 1, 1), (3, 2, 2), (9, 4, 3)])
def test_the_first_step_is_that_of_numpy(M, m, q) -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(M, m + q, m + q))
    S = root @ np.swapaxes(root, -1, -2)
    arguments = (
        np.log(rng.dirichlet(np.ones(M))),
        rng.normal(size=(M, m + q)),
        S,
        np.linalg.cholesky(S[:, m:, m:]),
        rng.normal(size=(5, q)),
    )
    got, expected = core.first_step(*arguments), switching.first_step(*arguments)
    np.testing.assert_allclose(got[0], expected[0], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(got[1], expected[1], rtol=1e-12)


# --------------------------------------------------------------------------- inputs of every kind


@few
@given(
    st.sampled_from([np.float64, np.float32, np.int64, np.int8, ">f8", np.bool_]),
    st.booleans(),
    st.booleans(),
    st.integers(0, 5),
)
def test_any_type_stride_alignment_and_length_gives_the_same_answer(
    tables_of, state_of, dtype, reverse, odd, n
) -> None:
    shape = (3, 3, 1, 1)
    compiled = packed.pack(*tables_of(shape))
    U = np.random.default_rng(n).integers(0, 2, (n, 3)).astype(dtype)
    plain = np.ascontiguousarray(U, dtype=np.float64)
    if reverse:
        U = U[::-1].copy()[::-1]
    if odd:  # not aligned
        raw = np.zeros(U.nbytes + 1, np.uint8)
        unaligned = np.ndarray(U.shape, U.dtype, raw, offset=1)
        unaligned[...] = U
        U = unaligned
    table = np.asfortranarray(state_of(shape))
    assert_same(
        core_series.run(compiled, table, None, U), core_series.run(compiled, state_of(shape), None, plain)
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda k, t: core.step(k, t, None, np.ones(2), np.ones(1)), "window: got shape"),
        (lambda k, t: core.step(k, t[:2], None, np.ones(1), np.ones(1)), "table: got shape"),
        (lambda k, t: core_series.run(k, t, None, np.ones((4, 2))), "U: got shape"),
        (lambda k, t: core_series.run(k, t, None, np.ones(3)), "U: got shape"),
        (lambda k, t: core_series.step_many(k, t, np.ones((2, 3))), "table: got shape"),
        (lambda k, t: core.node_mean(np.ones(2), np.ones((1, 3))), "p: got shape"),
    ],
)
def test_wrong_shapes_are_refused(call, message, tables_of, state_of) -> None:
    with pytest.raises(ValueError, match=message):
        call(packed.pack(*tables_of((3, 3, 1, 1))), state_of((3, 3, 1, 1)))


def test_tables_of_no_nodes_are_refused(tables_of) -> None:
    with pytest.raises(ValueError, match="at least one node"):
        packed.pack(*(array[:0] for array in tables_of((3, 3, 1, 1))))


def test_nothing_where_tables_are_expected_is_refused(state_of) -> None:
    with pytest.raises(TypeError, match="kernel"):
        core.step(None, state_of((3, 3, 1, 1)), None, np.ones(1), np.ones(1))
    with pytest.raises(TypeError, match="positional"):
        packed.Summary()


def test_tables_that_were_never_packed_do_no_harm(state_of) -> None:
    with pytest.raises(ValueError, match="table: got shape"):
        core.step(packed.Kernel(), state_of((3, 3, 1, 1)), None, np.ones(0), np.ones(0))
