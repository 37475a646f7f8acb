"""Folds of a plane: what noise carries from them, against suprema over many more states."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CauchyMembership, FuzzyRelationEstimator, GaussianMembership, TriangularMembership
from fuzzykf.possibility.grid.folds import folded_cells

DOMAIN = ((-8.0, 9.0), (-8.0, 8.0))
STATE = GaussianMembership([0.5, 0.0], [[1.0, 0.3], [0.3, 0.7]])
GAUSS = GaussianMembership(0.0, 0.05)

#: Functions of the first component that fold.
FOLDS = {
    "square": lambda x: x**2 / 4 - 1,
    "modulus": np.abs,
    "cubic": lambda x: x**3 / 6 - x,  # twice, and inside of its image
}


def estimator(fold, first, second=None, t_norm="product", domain=DOMAIN, swap=False):
    """A plane of which one component folds and is seen by the other."""

    def fx(x):
        a, b = (x[..., 1], x[..., 0]) if swap else (x[..., 0], x[..., 1])
        image = [FOLDS[fold](a), b + 0.5 * a]
        return np.stack(image[::-1] if swap else image, axis=-1)

    state = GaussianMembership(STATE.center[::-1], STATE.matrix[::-1, ::-1]) if swap else STATE
    return FuzzyRelationEstimator(
        2,
        1,
        fx=fx,
        hx=lambda x: x[..., :1],
        state=state,
        process_noise=[second, first] if swap else [first, second],
        measurement_noise=GaussianMembership(0.0, 1.0),
        points=101,
        domain=domain if domain is None or not swap else domain[::-1],
        t_norm=t_norm,
    )


def supremum(fold, axes, noise, t_norm):
    """Of all states x1, with x2 as the second component of the image asks for it."""
    x = np.linspace(-6.0, 7.0, 2001)
    carried = noise(axes[0][:, None] - FOLDS[fold](x))
    columns = [STATE(np.stack([x, second - 0.5 * x], axis=-1)) for second in axes[1]]
    return np.stack([t_norm(mu, carried).max(axis=1) for mu in columns], axis=1)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("fold", FOLDS)
def test_noise_spreads_from_the_edge_of_a_fold(fold, swap):
    est = estimator(fold, GAUSS, swap=swap)
    est.predict()
    values = est.membership.values.T if swap else est.membership.values
    axes = est.membership.axes[::-1] if swap else est.membership.axes
    exact = supremum(fold, axes, GAUSS, est.t_norm)
    # where nodes alone carried the noise, up to 0.45 was missing beside an edge
    assert np.abs(values - exact / exact.max()).max() < 0.02


@pytest.mark.parametrize(
    ("t_norm", "noise", "tolerance"),
    [
        ("min", TriangularMembership(-0.4, 0.0, 0.6), 0.02),
        ("lukasiewicz", TriangularMembership(-0.4, 0.0, 0.6), 0.02),
        ("hamacher", CauchyMembership(0.0, 0.22), 0.02),
        ("product", CauchyMembership(0.0, 0.3).cut(0.5), 0.04),  # a jump is known to a fraction of a cell
    ],
)
def test_it_holds_for_other_norms_and_noises(t_norm, noise, tolerance):
    est = estimator("square", noise, t_norm=t_norm)
    est.predict()
    exact = supremum("square", est.membership.axes, noise, est.t_norm)
    assert np.abs(est.membership.values - exact / exact.max()).max() < tolerance


def test_a_moving_grid_keeps_the_moments():
    est = estimator("modulus", GAUSS, domain=None)
    est.predict()
    axes = est.membership.axes
    exact = supremum("modulus", axes, GAUSS, est.t_norm)
    weight = exact / exact.sum()
    mean = [(weight.sum(axis=1 - k) * axes[k]).sum() for k in range(2)]
    np.testing.assert_allclose(est.x.ravel(), mean, atol=2e-3)


def test_the_noise_of_the_other_component_follows():
    # noise of both components: that of the second one convolves what the first one has made of the fold
    other = GaussianMembership(0.0, 0.2)
    est = estimator("square", GAUSS, other)
    est.predict()
    axes = est.membership.axes
    fine = np.linspace(-9.0, 9.0, 451)
    alone = supremum("square", (axes[0], fine), GAUSS, est.t_norm)
    exact = np.stack([(alone * other(second - fine)).max(axis=1) for second in axes[1]], axis=1)
    assert np.abs(est.membership.values - exact / exact.max()).max() < 0.02


def test_without_noise_both_preimages_count():
    est = estimator("square", None)
    est.predict()
    first, second = np.meshgrid(*est.membership.axes, indexing="ij")
    with np.errstate(invalid="ignore"):
        root = 2.0 * np.sqrt(first + 1.0)
    ends = [np.stack([x, second - 0.5 * x], axis=-1) for x in (root, -root)]
    exact = np.where(np.isnan(root), 0.0, np.maximum(*(STATE(np.nan_to_num(end)) for end in ends)))
    assert np.abs(est.membership.values - exact / exact.max()).max() < 0.01


def test_only_folds_are_found():
    axis = np.linspace(-1.0, 1.0, 12)
    x = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    live, step = np.ones(x.shape[:2], dtype=bool), np.array([0.2, 0.2])
    turned = x @ np.array([[0.6, 0.8], [-0.8, 0.6]]).T
    reflected = x * [1.0, -1.0]
    flat = np.stack([x[..., 0], 0.0 * x[..., 1]], axis=-1)
    for image in (turned, reflected, flat):
        assert [cells.size for cells in folded_cells(image, live, step)] == [0, 0]
    image = np.stack([np.abs(x[..., 0]), x[..., 1]], axis=-1)
    at, beside = folded_cells(image, live, step)
    assert set(at[:, 0].tolist()) >= {5}  # the kink is in the middle cell
    assert at.shape[0] + beside.shape[0] < 0.8 * 121
    none, _ = folded_cells(image, np.zeros_like(live), step)
    assert none.size == 0
    image[0] = np.nan  # states that are mapped nowhere
    assert folded_cells(image, live, step)[0].shape == at.shape
