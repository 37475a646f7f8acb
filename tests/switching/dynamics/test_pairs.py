"""Regressions of pairs of nodes: units change no verdict, and pairs that cannot be are not judged."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.switching.dynamics.pairs import regress


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_pairs_that_cannot_occur_are_not_judged_in_any_unit(unit) -> None:
    Q = np.array([[[1.0, 0.5], [0.5, 1.0]], [[1.0, 0.5], [0.5, -1.0]]]) * unit**2
    A, N, scale = np.zeros((2, 2, 2)), np.zeros((2, 2)), np.full((2, 2), unit)
    pairs = regress(A, N, Q, 1, lambda k: f"pair {k[0]}", np.array([True, False]), scale)
    np.testing.assert_allclose(pairs.G[0], 0.5)
    np.testing.assert_allclose(pairs.C[0], 0.75 * unit**2)
    assert (pairs.Qyy > 0.0).all()
    with pytest.raises(NotPositiveDefiniteError, match="pair 1"):
        regress(A, N, Q, 1, lambda k: f"pair {k[0]}", None, scale)
