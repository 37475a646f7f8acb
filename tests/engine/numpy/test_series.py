"""A series is its steps."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import series, switching, tables


def small_system(M, m, seed):
    """Arguments of `pack` for a random system of one observed component."""
    rng = np.random.default_rng(seed)
    C = rng.normal(size=(M, M, m, m))
    shapes = [(m, m), (m, 1), (m, 1), (m,)]
    Axx, H, G, c = (rng.normal(size=(M, M, *s)) * 0.4 for s in shapes)
    factor = rng.uniform(0.5, 1.5, (M, M, 1, 1))
    Ayy, Ny = rng.normal(size=(M, M, 1, 1)) * 0.3, rng.normal(size=(M, M, 1))
    return rng.dirichlet(np.ones(M), M), factor, Axx, H, G, c, C @ np.swapaxes(C, -1, -2), Ayy, Ny


def small_state(M, m):
    P = np.tile(np.eye(m).reshape(-1, 1), (1, M))
    return np.concatenate([np.full((1, M), -np.log(M)), np.arange(m * M).reshape(m, M) / 3.0, P])


@pytest.mark.parametrize("m", [1, 2])
@pytest.mark.parametrize("scale", [0.3, 12.0])
def test_a_series_is_its_steps_whatever_its_masses_add_up_to(m, scale):
    # masses drift along a series without being brought to one each time, up to e^-100 and no further
    kernel = tables.pack(*small_system(3, m, 7))
    y = scale * np.random.default_rng(8).normal(size=121)
    U = np.column_stack([np.ones(120), y[:-1], y[1:]])
    found, signs, log_likelihood = series.run(kernel, small_state(3, m), None, U)
    table, sign = small_state(3, m), None
    for k, u in enumerate(U):
        table, sign, value = switching.step(kernel, table, sign, u[1:2], u[2:])
        assert log_likelihood[k] == pytest.approx(value, rel=1e-9, abs=1e-11)
        np.testing.assert_allclose(found[k], table, rtol=1e-9, atol=1e-11)
    assert signs is None
    assert log_likelihood.sum() < -100.0  # the total has left the range once at least
