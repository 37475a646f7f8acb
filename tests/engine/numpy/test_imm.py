"""Weights of the modes of one bank and of many, where a mode cannot be reached too."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.imm import log_mixing, merge_modes, mix_modes, weigh_modes

M = np.array([[0.9, 0.1, 0.0], [0.3, 0.7, 0.0], [0.2, 0.3, 0.5]])
MU = np.array([[0.5, 0.5, 0.0], [0.2, 0.3, 0.5], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def logs(p):
    with np.errstate(divide="ignore"):
        return np.log(p)


@pytest.mark.parametrize("many", [False, True])
def test_mixing_is_bayes_rule_for_the_mode_before(many):
    for rows in [MU] if many else MU:
        log_joint, log_cbar, omega = log_mixing(logs(rows), logs(M))
        joint = rows[..., :, None] * M
        np.testing.assert_allclose(np.exp(log_joint), joint, atol=1e-15)
        cbar = joint.sum(axis=-2)
        np.testing.assert_allclose(np.exp(log_cbar), cbar, atol=1e-15)
        # a mode that cannot be reached keeps to itself
        reached = cbar[..., None, :] > 0.0
        expected = np.where(reached, joint / np.where(reached, cbar[..., None, :], 1.0), np.eye(3))
        np.testing.assert_allclose(omega, expected, atol=1e-15)


def test_weights_are_multiplied_and_brought_to_one():
    log_p, total = weigh_modes(logs(np.array([0.2, 0.8])), np.array([-1000.0, -1001.0]))
    w = np.array([0.2, 0.8 * np.exp(-1.0)])
    np.testing.assert_allclose(np.exp(log_p), w / w.sum())
    assert total == pytest.approx(np.log(w.sum()) - 1000.0)


@pytest.mark.parametrize("lead", [(), (4,)])
def test_moments_of_mixtures_are_sums_over_modes(lead):
    rng = np.random.default_rng(0)
    xs, root = rng.normal(size=(*lead, 3, 2)), rng.normal(size=(*lead, 3, 2, 2))
    Ps = root @ np.swapaxes(root, -1, -2)
    omega = rng.dirichlet(np.ones(3), (*lead, 3))
    omega = np.swapaxes(omega, -1, -2)  # columns sum to one
    mixed_x, mixed_P = mix_modes(omega, xs, Ps)
    for index in np.ndindex(*lead):
        for j in range(3):
            w = omega[index][:, j]
            mean = w @ xs[index]
            P = sum(
                a * (p + np.outer(x - mean, x - mean))
                for a, p, x in zip(w, Ps[index], xs[index], strict=True)
            )
            np.testing.assert_allclose(mixed_x[index][j], mean)
            np.testing.assert_allclose(mixed_P[index][j], P)
            x, P_merged = merge_modes(w, xs[index], Ps[index])
            np.testing.assert_allclose(x, mean)
            np.testing.assert_allclose(P_merged, P)
