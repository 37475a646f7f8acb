"""Mapped cells leave no holes and tell every pre-image."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.raster import cover, flat_cells, live_cells, samples


def lattice(shape):
    return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij"), axis=-1)


def covered(image, shape, alive=None):
    """All pairs of target node (p, d) and pre-image (p, s)."""
    alive = np.ones(image.shape[:-1], dtype=bool) if alive is None else alive
    parts = list(cover(image, alive, shape))
    node = np.concatenate([part.node for part in parts])
    position = np.concatenate([part.position for part in parts])
    return np.stack(np.unravel_index(node, shape), axis=1).astype(float), position


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_affine_maps(d, seed):
    # every target node inside the image is covered, by its exact pre-image
    rng = np.random.default_rng(seed)
    n = 9
    A = rng.normal(size=(d, d)) + np.eye(d)
    b = rng.uniform(5, 10, d)
    shape = (20,) * d
    node, position = covered(lattice((n,) * d) @ A.T + b, shape)
    np.testing.assert_allclose(position @ A.T + b, node, atol=1e-6)
    every = lattice(shape).reshape(-1, d)
    source = (every - b) @ np.linalg.inv(A).T
    inside = ((source > 1e-6) & (source < n - 1 - 1e-6)).all(axis=1)
    found = {tuple(v) for v in node}
    assert all(tuple(v) in found for v in every[inside])


@pytest.mark.parametrize(("angle", "factor"), [(np.pi / 4, 1.0), (0.0, 1.5), (0.7, 2.3)])
def test_rotation_and_expansion_leave_no_holes(angle, factor):
    # nearest-cell scatter leaves 13 to 56 % of the cells empty here
    A = factor * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    image = (lattice((41, 41)) - 20.0) @ A.T + 60.0
    node, _ = covered(image, (121, 121))
    every = lattice((121, 121)).reshape(-1, 2)
    inside = (np.abs((every - 60.0) @ np.linalg.inv(A).T) <= 20.0 - 1e-9).all(axis=1)
    scattered = {tuple(v) for v in np.rint(image).reshape(-1, 2)}
    assert len({tuple(v) for v in every[inside]} - {tuple(v) for v in node}) == 0
    missing = len({tuple(v) for v in every[inside]} - scattered)
    assert missing > (0.1 if factor == 1.0 else 0.5) * inside.sum()


def test_folds_give_all_preimages():
    # x^2: each positive value comes from both sides
    x = np.linspace(-3.0, 3.0, 601)
    node, position = covered((x**2)[:, None], (9,))
    for value in (1.0, 4.0, 7.0):
        found = np.sort(x[0] + 0.01 * position[node[:, 0] == value, 0])
        np.testing.assert_allclose(found[[0, -1]], [-np.sqrt(value), np.sqrt(value)], atol=1e-4)


def test_dead_cells_are_left_out():
    alive = np.zeros(11, dtype=bool)
    alive[3] = True
    node, _ = covered(np.arange(11.0)[:, None], (11,), alive)
    assert set(node[:, 0]) == {2.0, 3.0, 4.0}


def test_faces_of_a_map_to_a_line():
    # (x1, x2) -> x1 + x2: pre-images along the lattice lines of both directions
    image = lattice((5, 5)).sum(axis=-1)[..., None]
    node, position = covered(image, (9,))
    np.testing.assert_allclose(position.sum(axis=1), node[:, 0], atol=1e-9)
    assert {tuple(p) for p in position[node[:, 0] == 4.0]} >= {(0.0, 4.0), (2.0, 2.0), (4.0, 0.0)}


def test_flat_cells():
    x = np.arange(6.0)
    image = np.maximum(x - 3.0, 0.0)[:, None]
    alive = np.ones(6, dtype=bool)
    assert flat_cells(image, alive)[:, 0].tolist() == [0, 1, 2]
    diagonal = lattice((4, 4)).sum(axis=-1)[..., None] * np.ones(2)
    assert len(flat_cells(diagonal, np.ones((4, 4), dtype=bool))) == 9
    turned = lattice((4, 4)) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    assert len(flat_cells(turned, np.ones((4, 4), dtype=bool))) == 0
    # a curve in the plane has no area at all
    assert len(flat_cells(np.stack([x, x**2], axis=-1), alive)) == 5


def test_samples_are_dense():
    image = np.stack([3.0 * np.arange(4.0), np.arange(4.0)], axis=-1)
    points, position = samples(image, live_cells(np.ones(4, dtype=bool)))
    np.testing.assert_allclose(points, position * [[3.0, 1.0]])
    assert np.abs(np.diff(np.unique(points[:, 0]))).max() <= 0.5 + 1e-12
