"""Kernels of scalar noises: their costs are those of the membership, whatever way they are reckoned."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CauchyMembership, GaussianMembership, ParabolicMembership
from fuzzykf.possibility.grid.lattice import Kernel
from fuzzykf.possibility.norms import HAMACHER, LUKASIEWICZ, MIN, PRODUCT

OFFSET = np.linspace(-1.9, 1.9, 9)
CLOSED = {
    "gaussian": (GaussianMembership(0.3, 4.0), PRODUCT),
    "cauchy": (CauchyMembership(0.3, 2.0), HAMACHER),
    "parabolic": (ParabolicMembership(0.3, 2.0), LUKASIEWICZ),
}


@pytest.mark.parametrize("name", CLOSED)
def test_the_kernel_of_a_variance_is_that_of_the_membership(name) -> None:
    membership, t_norm = CLOSED[name]
    given, made = Kernel(membership, t_norm), Kernel.quadratic(4.0, t_norm)
    np.testing.assert_allclose(made.cost(OFFSET), membership.cost(OFFSET[:, None] + 0.3, t_norm), rtol=1e-14)
    assert made.curvature == given.curvature
    assert (made.lower, made.upper) == pytest.approx((given.lower, given.upper), rel=1e-15)
    assert made.kinks == given.kinks
    for a, b in zip(made.reach(np.array([0.5, 0.9])), given.reach(np.array([0.5, 0.9])), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("membership", [one for one, _ in CLOSED.values()])
@pytest.mark.parametrize("t_norm", [MIN, PRODUCT, HAMACHER, LUKASIEWICZ], ids=lambda one: one.name)
def test_the_costs_of_a_kernel_are_those_of_its_membership(membership, t_norm) -> None:
    kernel = Kernel(membership, t_norm)
    expected = membership.cost(OFFSET[:, None] + 0.3, t_norm)
    np.testing.assert_allclose(kernel.cost(OFFSET), expected, rtol=1e-13, atol=1e-15)
    assert (kernel.curvature is not None) == (t_norm.family == membership.family)
