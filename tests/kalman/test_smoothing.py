"""rts_smoother, on the output of batch_filter."""

import numpy as np
import pytest

from fuzzykf.errors import ShapeError
from fuzzykf.kalman import KalmanFilter, rts_smoother


@pytest.mark.parametrize("flat", [False, True])
def test_it_is_the_conditional_law_given_everything(system, joint_gaussian, flat):
    matrices = {name: system[name] for name in ("P", "F", "Q", "H", "R")}
    f = KalmanFilter(3, 2, x=system["x"] if flat else system["x"][:, None], **matrices)
    zs = system["zs"]
    means, covariances, _, covariances_p = f.batch_filter(zs)
    x, P, K, Pp = f.rts_smoother(means, covariances)
    joint = joint_gaussian(*(system[name] for name in ("x", "P", "F", "Q", "H", "R")), len(zs))
    expected = joint.smoothed(zs)
    assert x.shape == means.shape
    np.testing.assert_allclose(x.reshape(-1, 3), expected[0], rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(P, expected[1], rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(Pp[:-1], covariances_p[1:], rtol=1e-12)
    assert not K[-1].any()
    assert np.array_equal(Pp[-1], covariances[-1])


def test_the_matrices_of_index_k_lead_to_step_k():
    # filterpy's function, unlike its method, takes those of the step before
    rng = np.random.default_rng(2)
    n = 5
    Fs = [np.eye(2) + 0.3 * rng.normal(size=(2, 2)) for _ in range(n)]
    Qs = [np.diag(rng.uniform(0.1, 1.0, 2)) for _ in range(n)]
    f = KalmanFilter(2, 1, H=[[1.0, 0.0]])
    zs = rng.normal(size=n)
    means, covariances, means_p, covariances_p = f.batch_filter(zs, Fs=Fs, Qs=Qs)
    for smoother in (rts_smoother, f.rts_smoother):
        x, _, K, Pp = smoother(means, covariances, Fs, Qs)
        np.testing.assert_allclose(Pp[:-1], covariances_p[1:], rtol=1e-13)
        expected = means[n - 2] + K[n - 2] @ (means[n - 1] - means_p[n - 1])
        np.testing.assert_allclose(x[n - 2], expected, rtol=1e-12)


def test_scalar_q_and_pseudo_inverse():
    means, covariances = np.zeros((3, 2)), np.zeros((3, 2, 2))
    x, P, K, _ = rts_smoother(means, covariances, [np.eye(2)] * 3, [0.0] * 3, inv=np.linalg.pinv)
    assert not x.any()
    assert not P.any()
    assert not K.any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            (np.zeros((3, 2)), np.zeros((2, 2, 2)), [np.eye(2)] * 3, [1.0] * 3),
            "Ps: got 2 covariances, expected 3",
        ),
        ((np.zeros((3, 2)), np.zeros((3, 2, 3)), [np.eye(2)] * 3, [1.0] * 3), "Xs, Ps: got shapes"),
        ((np.zeros(3), np.zeros((3, 1, 1)), [np.eye(1)] * 3, [1.0] * 3), "Xs, Ps: got shapes"),
        ((np.zeros((3, 2)), np.zeros((3, 2, 2)), [np.eye(2)] * 2, [1.0] * 3), "Fs: got 2 matrices"),
        ((np.zeros((3, 2)), np.zeros((3, 2, 2)), [np.eye(3)] * 3, [1.0] * 3), r"Fs\[2\]: got shape \(3, 3\)"),
    ],
)
def test_wrong_shapes_are_named(arguments, message):
    with pytest.raises(ShapeError, match=message):
        rts_smoother(*arguments)
