"""An estimator shows what it knows, how it moves and is seen, its noises and its constraint."""

from __future__ import annotations

import numpy as np

from fuzzykf import FuzzyRelationEstimator, GaussianMembership, IntervalMembership


def test_a_closed_form() -> None:
    est = FuzzyRelationEstimator(1, 1, F=0.5, constraint=GaussianMembership(0.0, 1.0))
    assert repr(est).splitlines() == [
        "FuzzyRelationEstimator(dim_x=1, dim_z=1): representation 'gaussian', t-norm 'product'",
        "  state: GaussianMembership(mean=[0.], covariance=[[0.5]])",
        "  dynamics: F = [[0.5]]",
        "  measurement: H is not set",
        "  process noise: GaussianMembership(mean=[0.], covariance=[[1.]])",
        "  measurement noise: GaussianMembership(mean=[0.], covariance=[[1.]])",
        "  constraint: GaussianMembership(mean=[0.], covariance=[[1.]])",
    ]


def test_a_grid_of_functions() -> None:
    box = IntervalMembership([0.0, -1.0], [2.0, 1.0])
    error = IntervalMembership(-1.0, 1.0)
    est = FuzzyRelationEstimator(
        2, 1, fx=np.sin, hx=np.cos, state=box, measurement_noise=error, points=11, constraint=(-np.inf, 1.5)
    )
    assert repr(est).splitlines()[1:4] == [
        "  state: 11 x 11 nodes, [0., -1.] to [1.5, 1.], the likeliest [0., -1.]",
        "  dynamics: sin",
        "  measurement: cos",
    ]
    assert repr(est).endswith("constraint: BoxMembership(lower=[-inf, -inf], upper=[1.5, 1.5])")
