"""The compiled Kalman filter is the NumPy one: equal numbers, for any shape, data and input."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.engine.numpy import kalman

core = pytest.importorskip("fuzzykf.engine.compiled.kalman", reason="the compiled core has not been built")

few = settings(max_examples=60, deadline=None)
SIZES = [
    (1, 1),
    (2, 1),
    (2, 2),
    (3, 1),
    (3, 2),
    (4, 1),
    (4, 2),
    (5, 2),
    (6, 2),
    (6, 3),
    (7, 7),
    (9, 4),
    (16, 16),
]


def system(n, m, seed=0):
    """x, P, F, Q, H, R of a stable random system."""
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
    roots = (rng.normal(size=(k, k)) / np.sqrt(k) for k in (n, n, m))
    P, Q, R = (root @ root.T + 0.1 * np.eye(len(root)) for root in roots)
    return rng.normal(size=n), P, F, Q, rng.normal(size=(m, n)), R


def series(n_steps, m, gaps=0.0, seed=0):
    rng = np.random.default_rng(seed + 1)
    zs = rng.normal(size=(n_steps, m))
    zs[rng.random(zs.shape) < gaps] = np.nan
    return zs


def assert_same(got, expected):
    for a, b in zip(got, expected, strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max(initial=1.0))


@pytest.mark.parametrize("column", [False, True])
@pytest.mark.parametrize("alpha_sq", [1.0, 1.1])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_prediction_and_update_are_those_of_numpy(n, m, alpha_sq, column) -> None:
    x, P, F, Q, H, R = system(n, m)
    z = series(1, m)[0]
    if column:
        x, z = x[:, None], z[:, None]
    assert_same(core.predict_linear(x, P, F, Q, alpha_sq), kalman.predict_linear(x, P, F, Q, alpha_sq))
    assert_same(core.update_linear(x, P, z, H, R), kalman.update_linear(x, P, z, H, R))


@pytest.mark.parametrize(("n", "m"), [(2, 2), (4, 3), (3, 5)])
def test_every_pattern_of_missing_components(n, m) -> None:
    x, P, _, _, H, R = system(n, m)
    for pattern in range(2**m - 1):
        z = np.array([np.nan if pattern >> k & 1 else float(k) for k in range(m)])
        assert_same(core.update_linear(x, P, z, H, R), kalman.update_linear(x, P, z, H, R))


@pytest.mark.parametrize("m", [1, 2, 3, 4])
@pytest.mark.parametrize("change", [-5.0, np.nan, np.inf])
def test_an_inadmissible_innovation_is_refused_by_both(m, change) -> None:
    x, P, _, _, H, R = system(3, m)
    R = R.copy()
    R[m - 1, m - 1] = change * 10.0
    for engine in (core, kalman):
        with pytest.raises(np.linalg.LinAlgError), np.errstate(invalid="ignore"):
            engine.update_linear(x, P, np.zeros(m), H, R)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_an_innovation_that_is_singular_to_rounding_is_refused_by_both(m) -> None:
    rng = np.random.default_rng(m)
    for _ in range(20):
        row, root = rng.normal(size=3), rng.normal(size=(3, 3))
        H, P = np.outer(rng.uniform(0.5, 2.0, m), row), root @ root.T
        for engine in (core, kalman):
            with pytest.raises(np.linalg.LinAlgError):
                engine.update_linear(np.zeros(3), P, np.zeros(m), H, np.zeros((m, m)))


# ------------------------------------------------------------------ series


@pytest.mark.parametrize("gaps", [0.0, 0.4])
@pytest.mark.parametrize("controlled", [False, True])
@pytest.mark.parametrize(("n", "m"), SIZES)
def test_a_series_is_that_of_numpy(n, m, gaps, controlled) -> None:
    x, P, F, Q, H, R = system(n, m)
    zs = series(40, m, gaps)
    controls = np.random.default_rng(3).normal(size=(40, n)) if controlled else None
    outs = []
    for engine in (core, kalman):
        out = {"x": np.empty((40, n)), "P": np.empty((40, n, n)), "x_prior": np.empty((40, n))}
        out |= {"P_prior": np.empty((40, n, n)), "log_likelihood": np.empty(40)}
        last = engine.filter_linear(x[:, None], P, zs, F, Q, H, R, 1.05, controls, out)
        outs.append([*out.values(), *last])
    assert_same(*outs)


def test_a_series_is_step_by_step_to_the_last_bit() -> None:
    x, P, F, Q, H, R = system(4, 2)
    zs = series(50, 2, 0.2)
    out = {"x": np.empty((50, 4)), "P": np.empty((50, 4, 4))}
    core.filter_linear(x, P, zs, F, Q, H, R, 1.0, None, out)
    for z, x_t, P_t in zip(zs, out["x"], out["P"], strict=True):
        x, P = core.predict_linear(x, P, F, Q, 1.0)
        if not np.isnan(z).all():
            x, P, *_ = core.update_linear(x, P, z, H, R)
        np.testing.assert_array_equal(x, x_t)
        np.testing.assert_array_equal(P, P_t)


def test_a_series_of_which_nothing_was_seen_has_no_innovation() -> None:
    x, P, F, Q, H, R = system(2, 1)
    out = {"log_likelihood": np.ones(3)}
    assert core.filter_linear(x, P, np.full((3, 1), np.nan), F, Q, H, R, 1.0, None, out) is None
    np.testing.assert_array_equal(out["log_likelihood"], 0.0)
    assert core.filter_linear(x, P, np.empty((0, 1)), F, Q, H, R, 1.0, None, {}) is None


def test_a_series_with_an_inadmissible_innovation_is_refused() -> None:
    x, P, F, Q, H, R = system(2, 1)
    for engine in (core, kalman):
        with pytest.raises(np.linalg.LinAlgError):
            engine.filter_linear(x, P, series(4, 1), F, Q, H, -100.0 * R, 1.0, None, {})


def test_many_threads_may_share_the_matrices() -> None:
    x, P, F, Q, H, R = system(4, 2)
    zs = series(2000, 2, 0.1)

    def run(_):
        out = {"x": np.empty((2000, 4))}
        core.filter_linear(x, P, zs, F, Q, H, R, 1.0, None, out)
        return out["x"]

    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(run, range(8))
    for other in others:
        np.testing.assert_array_equal(first, other)


# ------------------------------------------------------------------ any input


@st.composite
def shown_otherwise(draw, array):
    """Return the same numbers in an array of another type, order, stride or alignment."""
    array = np.asarray(array)
    way = draw(
        st.sampled_from(
            ["plain", "fortran", "strided", "reversed", "misaligned", "swapped", "list", "object"]
        )
    )
    if way == "fortran":
        return np.asfortranarray(array)
    if way == "strided":
        wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]))
        wide[..., ::2] = array
        return wide[..., ::2]
    if way == "reversed":
        return np.ascontiguousarray(array[::-1])[::-1]
    if way == "misaligned":
        raw = np.zeros(array.nbytes + 1, dtype=np.uint8)
        shifted = raw[1:].view(np.float64).reshape(array.shape)
        shifted[...] = array
        return shifted
    if way == "swapped":
        return array.astype(array.dtype.newbyteorder())
    return {"plain": array, "list": array.tolist(), "object": array.astype(object)}[way]


@given(data=st.data(), size=st.sampled_from([(1, 1), (2, 1), (4, 2), (5, 3)]))
@few
def test_any_form_of_the_same_numbers_gives_the_same_result(data, size) -> None:
    x, P, F, Q, H, R = system(*size)
    z, zs = series(1, size[1])[0], series(5, size[1], 0.2)

    def form(array):
        return data.draw(shown_otherwise(array))

    got = core.predict_linear(form(x), form(P), form(F), form(Q), 1.0)
    assert_same(got, core.predict_linear(x, P, F, Q, 1.0))
    assert_same(
        core.update_linear(form(x), form(P), form(z), form(H), form(R)), core.update_linear(x, P, z, H, R)
    )
    out, expected = {"x": np.empty((5, size[0]))}, {"x": np.empty((5, size[0]))}
    core.filter_linear(form(x), form(P), form(zs), form(F), form(Q), form(H), form(R), 1.0, None, out)
    core.filter_linear(x, P, zs, F, Q, H, R, 1.0, None, expected)
    np.testing.assert_array_equal(out["x"], expected["x"])


@given(
    which=st.integers(0, 6),
    shape=st.lists(st.integers(0, 5), min_size=0, max_size=4).map(tuple),
)
@few
def test_wrong_shapes_are_refused(which, shape) -> None:
    x, P, F, Q, H, R = system(3, 2)
    arguments = [x, P, series(4, 2), F, Q, H, R]
    admissible = {(3,), (3, 1)} if which == 0 else {arguments[which].shape}
    if which == 2:
        admissible = {(k, 2) for k in range(6)}
    if shape in admissible:
        return
    arguments[which] = np.zeros(shape)
    with pytest.raises(ValueError, match="got shape"):
        core.filter_linear(*arguments, 1.0, None, {})


@pytest.mark.parametrize(
    "array",
    [np.empty((3, 3)), np.empty((4, 2)), np.empty((4, 3), dtype=np.float32), np.empty((3, 4)).T, [1.0]],
)
def test_what_cannot_be_filled_is_refused(array) -> None:
    x, P, F, Q, H, R = system(3, 2)
    with pytest.raises(ValueError, match=r"x: expected a contiguous array of float64, shape \(4, 3\)"):
        core.filter_linear(x, P, series(4, 2), F, Q, H, R, 1.0, None, {"x": array})


def test_larger_systems_are_refused() -> None:
    x, P, F, Q, H, R = system(core.LARGEST + 1, 1)
    with pytest.raises(ValueError, match="expected at most"):
        core.predict_linear(x, P, F, Q, 1.0)
    with pytest.raises(ValueError, match="expected at most"):
        core.update_linear(x, P, np.zeros(1), H, R)
