"""The compiled kernels of grids are the NumPy kernels: equal numbers, for any shape, any data and any input.

They round as NumPy does, so that a choice (which source is best, whether differences agree)
is never another one: most results are equal to the last bit.  Only logarithms, exponentials
and long sums differ, in the last digits.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from fuzzykf.engine.numpy import convolution, grid, kernels, raster

core = pytest.importorskip("fuzzykf.engine.compiled", reason="the compiled core has not been built")

some = settings(max_examples=60, deadline=None)
few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)
SCALES = ["log", "reciprocal", "complement"]
COMBINE = [np.add, np.multiply, np.maximum]
#: Whole numbers make ties; the others make none.
KINDS = ["smooth", "rough", "whole", "torn", "impossible"]


@pytest.fixture(autouse=True)
def instructions():
    """There is one version of these kernels, for all processors."""


def costs(rng, shape, kind):
    """Costs of every kind, infinite where impossible."""
    place = np.moveaxis(np.indices(shape), 0, -1)
    bowl = (0.02 * (place - rng.uniform(0, max(*shape, 1), len(shape))) ** 2).sum(axis=-1)
    cost = {
        "smooth": bowl,
        "rough": bowl + rng.random(shape),
        "whole": rng.integers(0, 6, shape).astype(float),
        "torn": np.where(rng.random(shape) < 0.4, np.inf, rng.random(shape) * 5.0),
        "impossible": np.full(shape, np.inf),
    }[kind]
    if kind == "whole":
        cost[rng.random(shape) < 0.2] = np.inf
    return cost


def assert_same(got, expected):
    """Equal to 1e-12, and infinite in the same places."""
    got, expected = np.asarray(got), np.asarray(expected)
    assert got.shape == expected.shape
    assert got.dtype == expected.dtype
    np.testing.assert_array_equal(np.isinf(got), np.isinf(expected))
    finite = np.isfinite(expected)
    np.testing.assert_allclose(got[finite], expected[finite], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))


# --------------------------------------------------------------------------- convolutions


@some
@given(
    seeds, st.sampled_from(KINDS), st.integers(0, 5), st.integers(1, 60), st.integers(0, 60),
    st.floats(0.01, 20.0), st.floats(0.2, 4.0), st.floats(-30.0, 30.0),
)  # fmt: skip
def test_parabola(seed, kind, lines, n, m, curvature, dx, x0):
    cost = costs(np.random.default_rng(seed), (lines, n), kind)
    arguments = (0.0, 1.0, x0, dx, m, curvature)
    source = core.convolution.envelope_of_parabolas(cost, *arguments)
    np.testing.assert_array_equal(source, convolution.envelope_of_parabolas(cost, *arguments))
    assert_same(
        core.convolution.convolve_parabola(cost, *arguments), convolution.convolve_parabola(cost, *arguments)
    )
    # by brute force: no source is better
    table = curvature * (x0 + dx * np.arange(m)[:, None] - np.arange(n)) ** 2
    best = kernels.totals(cost, table, kernels.convolve_table(cost, table), 0)
    np.testing.assert_allclose(kernels.totals(cost, table, source, 0), best, rtol=1e-12, atol=1e-12)


@some
@given(seeds, st.lists(st.integers(0, 4), min_size=1, max_size=3))
def test_refine(seed, shape):
    near = [costs(np.random.default_rng(seed + k), tuple(shape), "whole") for k in range(5)]
    np.testing.assert_array_equal(core.convolution.refine(*near), convolution.refine(*near))


def tables(rng, m, n):
    """Kernels on an interval, convex and not."""
    offset = np.sort(rng.uniform(-20, n + 20, m))[:, None] - np.arange(n)
    width = rng.uniform(1, 30)
    inside = abs(offset) <= width
    return {
        "convex": np.where(inside, 0.01 * offset**2, np.inf),
        "interval": np.where(inside, 0.0, np.inf),
        "cauchy": 1.0 + (offset / width) ** 2,
        "whole": rng.integers(0, 4, (m, n)).astype(float),
    }


@some
@given(seeds, st.sampled_from(KINDS), st.integers(0, 4), st.integers(1, 80), st.integers(0, 40))
def test_searches(seed, kind, lines, n, m):
    rng = np.random.default_rng(seed)
    cost = costs(rng, (lines, n), kind)
    for name, table in tables(rng, m, n).items():
        assert core.kernels.is_convex(table) == kernels.is_convex(table)
        for combine in COMBINE:
            if combine is np.multiply and name != "cauchy":
                continue  # zero times infinity
            brute = kernels.convolve_table(cost, table, combine)
            np.testing.assert_array_equal(core.kernels.convolve_table(cost, table, combine), brute)
            least = kernels.totals(cost, table, brute, 0, combine)
            bounded = core.kernels.convolve_bounded(cost, table, combine)
            np.testing.assert_array_equal(kernels.totals(cost, table, bounded, 0, combine), least)
            for shift in (-2, 0, 1, n, -(2**60)):
                np.testing.assert_array_equal(
                    core.kernels.totals(cost, table, brute, shift, combine),
                    kernels.totals(cost, table, brute, shift, combine),
                )
        if name in ("convex", "interval"):
            source = core.kernels.convolve_convex(cost, table)
            np.testing.assert_array_equal(source, kernels.convolve_convex(cost, table))
            least = kernels.totals(cost, table, kernels.convolve_table(cost, table), 0)
            np.testing.assert_array_equal(kernels.totals(cost, table, source, 0), least)


@few
@given(seeds, st.integers(1, 60), st.integers(1, 40))
def test_tables_of_one_number_a_diagonal_are_searched_as_views(seed, n, m):
    # rows overlap and come backwards: strides of -8 and 8 bytes
    rng = np.random.default_rng(seed)
    cost, offset = costs(rng, (3, n), "rough"), np.arange(1.0 - n, m)[::-1]
    for diagonal in (0.01 * offset**2, np.where(abs(offset) < 7, 0.0, np.inf), rng.random(n + m - 1)):
        view = np.lib.stride_tricks.sliding_window_view(diagonal, n)[::-1]
        table = np.array(view)
        for module in (core.kernels, kernels):
            assert module.is_convex(view) == kernels.is_convex(table)
            source = kernels.convolve_table(cost, table)
            np.testing.assert_array_equal(module.convolve_table(cost, view), source)
            least = kernels.totals(cost, table, source, 0)
            np.testing.assert_array_equal(module.totals(cost, view, source, 0), least)
            methods = [module.convolve_bounded] + [module.convolve_convex] * kernels.is_convex(table)
            for method in methods:
                np.testing.assert_array_equal(kernels.totals(cost, table, method(cost, view), 0), least)


@few
@given(seeds, st.integers(1, 3), st.sampled_from([np.add, np.maximum]))
def test_joint_kernels(seed, d, combine):
    rng = np.random.default_rng(seed)
    shape, size = rng.integers(1, 7, d), rng.integers(1, 9, d)
    cost, kernel = costs(rng, tuple(shape), "torn"), costs(rng, tuple(size), "torn")
    center = tuple(int(c) for c in rng.integers(-1, size + 1))
    np.testing.assert_array_equal(
        core.kernels.convolve_joint(cost, kernel, center, combine),
        kernels.convolve_joint(cost, kernel, center, combine),
    )


# --------------------------------------------------------------------------- interpolation


def positions(rng, shape, n):
    """On nodes, along axes, anywhere, and outside."""
    place = rng.uniform(-0.2, 1.2, (n, len(shape))) * (np.array(shape) - 1)
    whole = rng.random(len(shape)) < 0.4
    place[:, whole] = np.rint(place[:, whole])
    place[rng.random(place.shape) < 0.02] = np.nan
    place[rng.random(place.shape) < 0.02] = np.inf
    return place


@some
@given(seeds, st.sampled_from(KINDS), st.integers(1, 4), st.integers(0, 60), st.sampled_from(SCALES))
def test_interpolation(seed, kind, d, n, scale):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(4, 8, d))
    cost, place = costs(rng, shape, kind), positions(rng, shape, n)
    assert_same(core.grid.interpolate(cost, place, scale), grid.interpolate(cost, place, scale))
    matrix = np.eye(d)[rng.permutation(d)] if rng.random() < 0.5 else rng.normal(size=(d, d))
    shift = rng.integers(-2, 3, d).astype(float) if rng.random() < 0.5 else rng.normal(size=d)
    new = tuple(rng.integers(0, 9, d))
    assert_same(
        core.grid.pull_back(cost, matrix, shift, new, scale), grid.pull_back(cost, matrix, shift, new, scale)
    )


def test_interpolation_at_more_positions_than_are_taken_at_a_time():
    # along the second axis all positions are nodes, but not in the last part
    rng = np.random.default_rng(0)
    cost = costs(rng, (30, 20), "torn")
    place = rng.uniform(0, 1, (2 * grid.CHUNK + 100, 2)) * [29, 19]
    place[: 2 * grid.CHUNK, 1] = np.rint(place[: 2 * grid.CHUNK, 1])
    assert_same(core.grid.interpolate(cost, place, "log"), grid.interpolate(cost, place, "log"))


@some
@given(seeds, st.sampled_from(KINDS), st.integers(0, 4), st.integers(4, 9), st.sampled_from(SCALES))
def test_interpolation_along_lines(seed, kind, lines, n, scale):
    rng = np.random.default_rng(seed)
    cost, place = costs(rng, (lines, n), kind), np.append(rng.uniform(-3, n + 2, 20), np.arange(n))
    assert_same(core.grid.interpolate_lines(cost, place, scale), grid.interpolate_lines(cost, place, scale))


@some
@given(seeds, st.lists(st.integers(0, 12), min_size=1, max_size=3), st.floats(0.5, 20.0), st.booleans())
def test_tails(seed, shape, limit, rough):
    rng = np.random.default_rng(seed)
    cost = costs(rng, tuple(shape), "smooth") + rough * rng.random(shape) * 0.01
    cost[cost > limit] = np.inf
    before = cost.copy()
    np.testing.assert_array_equal(core.grid.continue_tails(cost, limit), grid.continue_tails(cost, limit))
    np.testing.assert_array_equal(cost, before)


# --------------------------------------------------------------------------- images


def an_image(rng, sources, d, fold):
    """A smooth map of a lattice, with a flat piece and impossible images, in steps of the target."""
    shape = tuple(rng.integers(1, 8, sources))
    place = np.moveaxis(np.indices(shape).astype(float), 0, -1)
    image = place @ rng.normal(size=(sources, d)) + 3.0
    image += rng.normal(size=d) * np.sin(place.sum(axis=-1))[..., None] * fold
    if rng.random() < 0.5:
        image[place[..., 0] > 4] = image[(0,) * sources]
    image[rng.random(shape) < 0.03] = np.nan
    image[rng.random(shape) < 0.03] = np.inf
    return image, rng.random(shape) < rng.choice([0.1, 0.6, 1.1])


def joined(parts, d, sources):
    """All parts of a cover in one."""
    parts = list(parts)
    return (
        np.concatenate([np.zeros(0, dtype=np.intp), *(p.node for p in parts)]),
        np.concatenate([np.zeros((0, sources)), *(p.position for p in parts)]),
        np.concatenate([np.zeros((0, d, d)), *(p.inverse for p in parts)]),
        list(dict.fromkeys(p.axes for p in parts if p.node.size)),
    )


@some
@given(seeds, st.integers(1, 3), st.integers(0, 1), st.booleans())
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # infinite images, in NumPy
def test_covers(seed, d, more, fold):
    rng = np.random.default_rng(seed)
    image, alive = an_image(rng, d + more, d, fold)
    shape = tuple(int(n) for n in rng.integers(1, 9, d))
    got = joined(core.raster.cover(image, alive, shape), d, d + more)
    expected = joined(raster.cover(image, alive, shape), d, d + more)
    np.testing.assert_array_equal(got[0], expected[0])
    for k in (1, 2):
        np.testing.assert_allclose(got[k], expected[k], rtol=1e-9, atol=1e-12)  # thin simplices
    assert got[3] == expected[3]
    for part in raster.cover(image, alive, shape):
        miss = rng.normal(size=(part.node.size, d)) * 0.2
        assert_same(core.raster.corrected(part, miss, alive.shape), raster.corrected(part, miss, alive.shape))


def test_a_simplex_may_cover_more_nodes_than_are_taken_at_a_time(monkeypatch):
    monkeypatch.setattr(core.raster, "CHUNK", 50)
    image = np.moveaxis(np.indices((4, 4)).astype(float), 0, -1) @ [[20.0, 3.0], [-2.0, 17.0]]
    arguments = image, np.ones((4, 4), dtype=bool), (80, 80)
    parts = list(core.raster.cover(*arguments))
    assert len(parts) > 10
    got, expected = joined(parts, 2, 2), joined(raster.cover(*arguments), 2, 2)
    for k in range(3):
        # both take triangles of one kind first, cell by cell
        order = [np.lexsort((*x[1].T, x[0])) for x in (got, expected)]
        np.testing.assert_array_equal(got[k][order[0]], expected[k][order[1]])


@some
@given(seeds, st.integers(1, 3), st.integers(1, 3), st.booleans())
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_cells_and_their_images(seed, sources, d, fold):
    rng = np.random.default_rng(seed)
    image, alive = an_image(rng, sources, d, fold)
    np.testing.assert_array_equal(core.raster.live_cells(alive), raster.live_cells(alive))
    np.testing.assert_array_equal(core.raster.live_cells(alive, (0,)), raster.live_cells(alive, (0,)))
    np.testing.assert_array_equal(core.raster.flat_cells(image, alive), raster.flat_cells(image, alive))
    out = np.where(rng.random(rng.integers(1, 9, d)) < 0.5, np.inf, 1.0)
    np.testing.assert_array_equal(core.raster.stranded(image, alive, out), raster.stranded(image, alive, out))
    box = np.sort(rng.uniform(-5, 15, (d, 2)), axis=1)
    cost = costs(rng, alive.shape, "torn")
    assert core.grid.least_outside(image, cost, box) == grid.least_outside(image, cost, box)
    try:
        expected = raster.span(image, alive)
    except ValueError:
        with pytest.raises(ValueError, match="live"):
            core.raster.span(image, alive)
    else:
        for a, b in zip(core.raster.span(image, alive), expected, strict=True):
            np.testing.assert_array_equal(a, b)


@some
@given(seeds, st.lists(st.integers(1, 9), min_size=1, max_size=4))
def test_moments(seed, shape):
    rng = np.random.default_rng(seed)
    mass, axes = rng.random(shape), tuple(np.linspace(*np.sort(rng.normal(size=2)), n) for n in shape)
    center = rng.normal(size=len(shape))
    for a, b in zip(
        core.grid.moments_about(mass, axes, center), grid.moments_about(mass, axes, center), strict=True
    ):
        assert_same(a, b)


# --------------------------------------------------------------------------- inputs of every kind


def calls(a):
    """Kernels on one array (6, 5), or what it makes."""
    return {
        "parabola": lambda: core.convolution.convolve_parabola(a, 0.0, 1.0, 0.0, 1.0, 7, 0.3),
        "table": lambda: core.kernels.convolve_table(a, np.ones((3, 5))),
        "convex": lambda: core.kernels.convolve_convex(a, np.ones((3, 5))),
        "bounded": lambda: core.kernels.convolve_bounded(np.ones((2, 5)), a),
        "is_convex": lambda: [core.kernels.is_convex(a)],
        "joint": lambda: core.kernels.convolve_joint(a, a, (1, 1)),
        "interpolate": lambda: core.grid.interpolate(a, [[1.5, 2.5], [0.0, 3.0]], "log"),
        "positions": lambda: core.grid.interpolate(np.ones((9,) * 5), a, "log"),
        "tails": lambda: core.grid.continue_tails(a, 1.0),
        "span": lambda: core.raster.span(a, np.ones(6, dtype=bool)),
        "live": lambda: core.raster.live_cells(a),
        "flat": lambda: core.raster.flat_cells(np.ones((6, 5, 2)), a),
        "moments": lambda: core.grid.moments_about(a + 1, (np.arange(6), np.arange(5)), [0.0, 0.0]),
    }


@few
@given(
    st.sampled_from([np.float64, np.float32, np.int64, np.int8, ">f8", np.bool_]),
    st.integers(0, 2),
    st.booleans(),
    arrays.arrays(np.int8, (6, 5), elements=st.integers(0, 3)),
)
def test_any_type_stride_and_alignment_gives_the_same_answer(dtype, order, odd, values):
    a = values.astype(dtype)
    plain = np.ascontiguousarray(a, dtype=np.float64)
    if order == 1:
        a = np.asfortranarray(a)
    elif order == 2:
        a = a[::-1, ::-1].copy()[::-1, ::-1]
    if odd:  # not aligned
        unaligned = np.ndarray(a.shape, a.dtype, np.zeros(a.nbytes + 1, np.uint8), offset=1)
        unaligned[...] = a
        a = unaligned
    for name, expected in calls(plain).items():
        for one, other in zip(calls(a)[name](), expected(), strict=True):
            np.testing.assert_array_equal(one, other, err_msg=name)


ONE, PLANE = np.ones((2, 3)), np.ones((4, 4))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: core.convolution.convolve_parabola(np.ones(3), 0, 1, 0, 1, 4, 1), "cost: got shape"),
        (lambda: core.convolution.convolve_parabola(ONE, 0, 1, 0, 1, -1, 1), "n_targets: got -1"),
        (lambda: core.convolution.convolve_parabola(ONE, 0, 0, 0, 1, 4, 1), "expected positive"),
        (lambda: core.convolution.convolve_parabola(ONE, 0, 1, 0, 1, 4, np.nan), "expected positive"),
        (lambda: core.convolution.refine(ONE, ONE, ONE, ONE, ONE[:1]), "after: got shape"),
        (lambda: core.kernels.convolve_table(np.ones((2, 0)), np.ones((4, 0))), "at least one"),
        (lambda: core.kernels.convolve_table(ONE, ONE, np.minimum), "combine: got"),
        (lambda: core.kernels.totals(ONE, ONE, [[0, 3], [0, 0]], 0), "source: got 3"),
        (lambda: core.kernels.totals(ONE, ONE, [[0, -1], [0, 0]], 0), "source: got -1"),
        (lambda: core.kernels.totals(ONE, ONE, [[0.5, 1], [0, 0]], 0), "whole numbers"),
        (lambda: core.kernels.totals(ONE, ONE, [[0, 1]], 0), "source: got shape"),
        (lambda: core.kernels.convolve_joint(ONE, np.ones(3), (1,)), "expected 2 axes"),
        (lambda: core.kernels.convolve_joint(ONE, ONE, (1, 2**40)), "center: got"),
        (lambda: core.kernels.convolve_joint(ONE, ONE, (1, 1), np.multiply), "combine: got"),
        (lambda: core.kernels.convolve_joint(1.0, 1.0, ()), "1 to 16 axes"),
        (lambda: core.grid.interpolate(ONE, ONE, "log"), "at least 4 nodes"),
        (lambda: core.grid.interpolate(PLANE, np.ones((2, 3)), "log"), "position: got shape"),
        (lambda: core.grid.interpolate(PLANE, np.ones((2, 2)), "sqrt"), "scale: got 'sqrt'"),
        (lambda: core.grid.pull_back(PLANE, np.eye(2), np.ones(3), (2, 2), "log"), "shift: got shape"),
        (lambda: core.grid.pull_back(PLANE, np.eye(2), np.ones(2), (2,), "log"), "shape: got"),
        (lambda: core.grid.least_outside(ONE, ONE, np.ones((2, 2))), "image: got shape"),
        (lambda: core.raster.live_cells(np.True_), "alive: got shape"),
        (lambda: core.raster.live_cells(ONE, (2,)), "axes: got"),
        (lambda: core.raster.flat_cells(ONE, np.ones(3)), "image: got shape"),
        (lambda: list(core.raster.cover(ONE, np.ones(2), (4, 4))), "shape: got"),
        (lambda: core.raster.stranded(np.ones((2, 1)), np.ones(2), ONE), "out: got shape"),
        (lambda: core.raster.span(np.full((2, 1), np.nan), np.ones(2)), "live: expected"),
        (lambda: core.grid.moments_about(ONE, (np.ones(2),), [0.0]), "center: got shape|mass: got shape"),
        (lambda: core.grid.moments_about(ONE[:0], (np.ones(0), np.ones(3)), [0, 0]), "mass: got shape"),
        (lambda: core.grid.moments_about(ONE, (np.ones(2), np.ones(4)), [0, 0]), "axes: got shape"),
    ],
)
def test_what_is_inadmissible_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_threads_do_not_disturb_each_other():
    rng = np.random.default_rng(0)
    cost, place = costs(rng, (40, 50), "torn"), positions(rng, (40, 50), 500)

    def work(_):
        image = np.moveaxis(np.indices((40, 50)).astype(float), 0, -1) @ [[0.8, 0.6], [-0.6, 0.8]]
        cover = joined(core.raster.cover(image, cost < 4.0, (60, 60)), 2, 2)
        convolved = core.convolution.convolve_parabola(cost, 0.0, 1.0, 0.0, 1.0, 70, 0.1)
        return cover[1], convolved, core.grid.interpolate(cost, place, "log")

    with ThreadPoolExecutor(4) as pool:
        first, *others = pool.map(work, range(12))
    for other in others:
        for a, b in zip(first, other, strict=True):
            np.testing.assert_array_equal(a, b)
