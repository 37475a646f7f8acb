"""The compiled way back along a series is that of NumPy, and both are matrix products written out."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import backward, switching, tables

compiled = pytest.importorskip(
    "fuzzykf.engine.compiled.backward", reason="the compiled core has not been built"
)
packed = pytest.importorskip("fuzzykf.engine.compiled.tables")

SIZES = [(1, 1, 1), (2, 1, 1), (7, 1, 1), (9, 1, 3), (20, 2, 1), (3, 3, 2)]  # nodes, dim_z, order


def system(M, q, order, seed=0):
    """Arguments of `pack`, filtered log-probabilities and rows of 600 steps."""
    rng = np.random.default_rng(seed)
    w, n = order * q, 600
    root = np.tril(rng.normal(size=(M, M, q, q)) * 0.2)
    root[..., range(q), range(q)] = rng.uniform(0.5, 1.5, (M, M, q))
    transition = rng.dirichlet(np.ones(M), M)
    shapes = [(1, 1), (1, w), (1, q), (1,), (1, 1)]
    Axx, H, G, c, C = (rng.normal(size=(M, M, *shape)) for shape in shapes)
    Ayy, Ny = rng.normal(size=(M, M, q, w)) * 0.3, rng.normal(size=(M, M, q))
    U = np.concatenate([np.ones((n, 1)), rng.normal(size=(n, w + q))], axis=1)
    log_p = np.log(rng.dirichlet(np.ones(M), n))
    return (transition, root, Axx, H, G, c, C, Ayy, Ny), log_p, U, rng.dirichlet(np.ones(M))


@pytest.mark.parametrize("size", SIZES)
def test_smoothed_probabilities_are_those_of_numpy_and_of_bayes(size) -> None:
    arguments, log_p, U, after = system(*size)
    U[17, -1] = 1e4  # an outlier
    U[23:33, -1] = np.linspace(18.0, 45.0, 10)  # the largest that are none: densities down to exp(-500)
    kernel = tables.pack(*arguments)
    got = compiled.smooth_back(packed.pack(*arguments), log_p, U, after)
    np.testing.assert_allclose(got, backward.smooth_back(kernel, log_p, U, after), rtol=1e-9, atol=1e-12)
    # one step by Bayes' rule, probability by probability
    M = size[0]
    joint = log_p[-1][:, None] + switching.log_pairs(kernel, U[-1:]).reshape(M, M)
    share = np.exp(joint - joint.max(axis=0))
    np.testing.assert_allclose(got[-1], (share / share.sum(axis=0) * after).sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(got.sum(axis=1), 1.0, rtol=1e-14)


@pytest.mark.parametrize("size", SIZES)
def test_the_most_likely_path_is_that_of_numpy(size) -> None:
    arguments, log_p, U, _ = system(*size, seed=1)
    U[[17, 40], -1] = 1e4, -1e7  # outliers
    kernel = tables.pack(*arguments)
    score, pointers = compiled.best_path(packed.pack(*arguments), log_p[0], U)
    expected, nodes = backward.best_path(kernel, log_p[0], U)
    np.testing.assert_array_equal(pointers, nodes)
    np.testing.assert_allclose(score, expected, rtol=1e-9, atol=1e-9)
    assert score.max() == 0.0


def test_of_paths_that_are_as_likely_the_first_is_taken() -> None:
    arguments, _, U, _ = system(9, 1, 1)
    alike = [np.broadcast_to(part[:1, :1], part.shape) for part in arguments]  # pairs that do not differ
    score = np.zeros(9)
    for engine, pack in ((compiled, packed.pack), (backward, tables.pack)):
        assert not engine.best_path(pack(*alike), score, U)[1].any()


def test_no_step_at_all() -> None:
    arguments, log_p, U, after = system(3, 1, 1)
    kernel = packed.pack(*arguments)
    assert compiled.smooth_back(kernel, log_p[:0], U[:0], after).shape == (0, 3)
    score, pointers = compiled.best_path(kernel, after, U[:0])
    np.testing.assert_array_equal(score, after)
    assert pointers.shape == (0, 3)


def test_what_does_not_fit_is_refused() -> None:
    arguments, log_p, U, after = system(3, 1, 1)
    kernel = packed.pack(*arguments)
    with pytest.raises(ValueError, match="log_p: got shape"):
        compiled.smooth_back(kernel, log_p[:4], U, after)
    with pytest.raises(ValueError, match="after: got shape"):
        compiled.smooth_back(kernel, log_p, U, after[:2])
    with pytest.raises(ValueError, match="U: got shape"):
        compiled.best_path(kernel, after, U[:, :2])
    signed = packed.pack(arguments[0] - 0.4, *arguments[1:])
    with pytest.raises(ValueError, match="negative weights"):
        compiled.best_path(signed, after, U)


def test_steps_of_a_path_may_be_given() -> None:
    # what a step says by itself, given slot by slot, is what follows from its row
    arguments, log_p, U, _ = system(7, 1, 1, seed=2)
    kernel = tables.pack(*arguments)
    expected, nodes = backward.best_path(kernel, log_p[0], U)
    at, source = np.array([0, 5, 6, 599]), np.indices((7, 7))[0]
    pairs = switching.log_pairs(kernel, U[at]).reshape(-1, 7, 7)
    gone = U.copy()
    gone[at] = np.nan
    order = np.random.default_rng(0).permutation(7)  # slots in whatever order
    for engine, pack in ((compiled, packed.pack), (backward, tables.pack)):
        given = at, pairs[:, order], source[order]
        score, pointers = engine.best_path(pack(*arguments), log_p[0], gone, given)
        np.testing.assert_array_equal(pointers, nodes)
        np.testing.assert_allclose(score, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("at", "source"),
    [([3, 2], np.zeros((1, 3), dtype=int)), ([600], np.zeros((1, 3), dtype=int)), ([1], np.full((1, 3), 3))],
)
def test_given_steps_that_do_not_fit_are_refused(at, source) -> None:
    arguments, log_p, U, _ = system(3, 1, 1)
    with pytest.raises(ValueError, match="given: got"):
        compiled.best_path(
            packed.pack(*arguments), log_p[0], U, (np.array(at), np.zeros((len(at), 1, 3)), source)
        )
