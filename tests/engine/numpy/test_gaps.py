"""Pairs of nodes conditioned on parts of an observation: the density that weighs them is the same one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.engine.numpy.gaps import condition_pairs, pair_mixture


@pytest.fixture(scope="module")
def prediction():
    """Moments of the pairs after a gap, for two states and two observed components."""
    rng = np.random.default_rng(4)
    root = 0.4 * rng.normal(size=(4, 4)) + np.eye(4)
    z = root @ root.T
    cross = 0.4 * z + 0.05 * rng.normal(size=(4, 4))
    cross[2:, :2] = cross[2:, 2:] @ np.linalg.solve(z[2:, 2:], z[2:, :2])
    pair = np.block([[z, cross.T], [cross, z]])
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    model = CGOFMSModel(law, [np.zeros(4), np.ones(4)], np.broadcast_to(pair, (2, 2, 8, 8)), 2)
    f = OFSRFilter(model, 2)
    for y in ([0.3, -0.2], [np.nan, 0.5]):
        f.step(y)
    tables, known = f._next_tables(), f._mixture
    state = known.table, known.sign, known.window, known.root
    return pair_mixture(tables.in_slots, tables.noise_root, *state)


@pytest.mark.parametrize("y", [[0.4, -1.0], [np.nan, -1.0], [0.4, np.nan], [np.nan, np.nan]])
def test_observed_parts_weigh_pairs_by_their_normal_density(prediction, y) -> None:
    y, m = np.array(y), 2
    seen = np.flatnonzero(~np.isnan(y))
    at = m + seen
    expected = np.zeros(prediction.log_w.shape)
    for index in np.ndindex(*expected.shape) if seen.size else ():
        mean, P = prediction.mean[index][at], prediction.covariance[index][np.ix_(at, at)]
        expected[index] = multivariate_normal(mean, P).logpdf(y[seen])
    conditioned = condition_pairs(prediction, y, m)
    np.testing.assert_allclose(conditioned.log_w - prediction.log_w, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("y", [[0.4, -1.0], [np.nan, -1.0], [0.4, np.nan]])
def test_pairs_are_conditioned_as_normal_vectors(prediction, y) -> None:
    y, m = np.array(y), 2
    seen = np.flatnonzero(~np.isnan(y))
    at = m + seen
    conditioned = condition_pairs(prediction, y, m)
    for index in np.ndindex(*prediction.log_w.shape):
        mean, P = prediction.mean[index], prediction.covariance[index]
        gain = P[:, at] @ np.linalg.inv(P[np.ix_(at, at)])
        np.testing.assert_allclose(
            conditioned.mean[index], mean + gain @ (y[seen] - mean[at]), rtol=1e-9, atol=1e-11
        )
        np.testing.assert_allclose(conditioned.covariance[index], P - gain @ P[at], rtol=1e-9, atol=1e-11)
        np.testing.assert_array_equal(conditioned.mean[index][at], y[seen])  # what is seen is certain
        assert not conditioned.covariance[index][at].any()
        assert not conditioned.covariance[index][:, at].any()
