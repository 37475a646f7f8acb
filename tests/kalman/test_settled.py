"""Covariances that have settled: a series does not reckon them again, and finds the same bits as steps do."""

import numpy as np
import pytest

from fuzzykf import engine
from fuzzykf.kalman import KalmanFilter

pytestmark = [
    pytest.mark.usefixtures("instructions"),
    pytest.mark.skipif(engine.info().name == "numpy", reason="NumPy takes every step"),
]

FIELDS = ("x", "P", "x_prior", "P_prior")


def settling(n, m):
    """Return a filter whose covariances come to a value, or to two in turn."""
    F = 0.6 * np.eye(n) + 0.2 * np.eye(n, k=1)
    return KalmanFilter(n, m, F=F, H=np.eye(m, n) + 0.1, Q=0.3 * np.eye(n), R=0.5, B=np.ones((n, 1)))


def stepped(f, zs, us):
    """Return what single steps find."""
    found = {name: [] for name in (*FIELDS, "log_likelihood")}
    for z, u in zip(zs, us, strict=True):
        f.predict(u)
        f.update(z[:, None])
        for name, values in found.items():
            values.append(np.copy(getattr(f, name)).squeeze())
    return found


@pytest.mark.parametrize("gap", [None, 150, 151])
@pytest.mark.parametrize("n_steps", [160, 161])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 2), (5, 2)])
def test_a_series_finds_the_bits_of_its_steps(n, m, n_steps, gap):
    rng = np.random.default_rng(n_steps)
    zs, us = rng.normal(size=(n_steps, m)), rng.normal(size=(n_steps, 1, 1))
    if gap is not None:
        zs[gap, 0] = np.nan
    f, g = settling(n, m), settling(n, m)
    result, expected = f.filter(zs, us=us), stepped(g, zs, us)
    log_likelihood = expected.pop("log_likelihood")  # of one step a sum in another order
    np.testing.assert_allclose(result.log_likelihood, log_likelihood, rtol=1e-13, atol=1e-13)
    for name, values in expected.items():
        np.testing.assert_array_equal(getattr(result, name).squeeze(), values, err_msg=name)
    for name in ("x", "P", "x_prior", "P_prior", "y", "K", "S", "SI"):
        np.testing.assert_array_equal(getattr(f, name), getattr(g, name), err_msg=name)


def test_the_covariances_of_these_series_settle():
    # else nothing would be shown above
    for n, m in ((1, 1), (4, 2), (5, 2)):
        P = settling(n, m).filter(np.zeros((160, m))).P
        assert np.array_equal(P[148], P[146]), (n, m)
