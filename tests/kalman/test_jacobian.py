"""Central differences."""

import numpy as np

from fuzzykf.kalman.jacobian import central_jacobian


def test_it_is_the_derivative_to_eight_digits():
    # the error of the difference is h^2 f'''/6 + eps f/h, about 1e-10 here
    def f(x):
        return np.array([np.sin(x[0]) * x[1], np.exp(0.1 * x[1]), x[0] ** 3])

    x = np.array([0.7, 20.0])
    expected = np.array([[np.cos(0.7) * 20.0, np.sin(0.7)], [0.0, 0.1 * np.exp(2.0)], [3 * 0.49, 0.0]])
    np.testing.assert_allclose(central_jacobian(f, x), expected, rtol=1e-8, atol=1e-9)
    assert np.array_equal(x, [0.7, 20.0])


def test_a_residual_that_wraps_angles_keeps_it_finite_at_the_jump():
    def bearing(x):
        return np.array([np.arctan2(x[1], x[0])])

    def wrapped(a, b):
        return (a - b + np.pi) % (2 * np.pi) - np.pi

    x = np.array([-2.0, 0.0])  # the bearing jumps between pi and -pi here
    np.testing.assert_allclose(central_jacobian(bearing, x, wrapped), [[0.0, -0.5]], atol=1e-8)
    assert abs(central_jacobian(bearing, x)[0, 1]) > 1e4
