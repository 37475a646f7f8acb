"""Forecasts are what a filter says that is given nothing to see, and observations with their noise."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import ExtendedKalmanFilter, Filter, IMMEstimator, KalmanFilter
from fuzzykf.errors import ParameterError, ShapeError

F, H = np.array([[1.0, 1.0], [0.0, 0.9]]), np.array([[1.0, 0.0]])


def linear(Q=0.2):
    return KalmanFilter(2, 1, 1, F=F, H=H, Q=Q * np.eye(2), R=[[0.5]], x=[1.0, -1.0])


def extended():
    return ExtendedKalmanFilter(
        2,
        1,
        fx=lambda x, u=0.0: np.array([x[0] + np.sin(x[1]), 0.9 * x[1] + u]),
        hx=lambda x: x[:1] + 0.1 * x[:1] ** 2,
        Q=0.2,
        R=0.5,
    )


def bank(method="imm"):
    return IMMEstimator([linear(0.01), linear(2.0)], [0.7, 0.3], [[0.9, 0.1], [0.2, 0.8]], method=method)


MAKERS = [linear, extended, bank, lambda: bank("gpb2")]
ZS = [0.3, 1.0, None, 2.0]


@pytest.mark.parametrize("make", MAKERS)
def test_states_are_those_of_a_filter_that_sees_nothing(make):
    f = make()
    f.filter(ZS)
    before = (f.x.copy(), f.P.copy())
    found = f.forecast(5)
    np.testing.assert_array_equal(f.x, before[0])
    np.testing.assert_array_equal(f.P, before[1])
    blind = f.copy().filter([None] * 5)
    np.testing.assert_allclose(found.x, blind.x, rtol=1e-12)
    np.testing.assert_allclose(found.P, blind.P, rtol=1e-12)
    if blind.mu is not None:
        np.testing.assert_allclose(found.mu, blind.mu, rtol=1e-12)
        np.testing.assert_array_equal(found.switch, found.nodes[found.mu.argmax(axis=1)])


@pytest.mark.parametrize("make", MAKERS)
def test_the_first_observation_is_expected_as_the_next_update_expects_it(make):
    f = make()
    f.filter(ZS)
    found = f.forecast(1)
    density = f.copy()
    density.step(1.3)
    if not isinstance(f, IMMEstimator):
        np.testing.assert_allclose(1.3 - found.z_prior[0], density.y.ravel(), rtol=1e-12)
        np.testing.assert_allclose(found.S[0], density.S, rtol=1e-12)
        return
    # a mixture: its moments by integrating its density
    grid = np.linspace(-40.0, 40.0, 161)
    p = np.empty(grid.size)
    for k, z in enumerate(grid):
        one = f.copy()
        one.step(z)
        p[k] = np.exp(one.log_likelihood)
    mean = np.trapezoid(p * grid, grid)
    assert found.z_prior.item() == pytest.approx(mean, rel=1e-6)
    assert found.S.item() == pytest.approx(np.trapezoid(p * (grid - mean) ** 2, grid), rel=1e-6)


def test_controls_move_the_state():
    f = linear()
    f.B = np.array([[0.0], [1.0]])
    found = f.forecast(2, us=[[1.0], None])
    assert found.x[:, 1] == pytest.approx([-0.9 + 1.0, 0.09])
    e = extended()
    assert e.forecast(1, us=[0.5]).x[0, 1] == pytest.approx(0.5)


def test_arguments_of_the_functions():
    f = ExtendedKalmanFilter(1, 1, fx=lambda x, t: x + t, hx=lambda x, gain: gain * x, Q=1.0, R=1.0)
    found = f.forecast(2, fx_args=[{"t": 1.0}, {"t": 2.0}], hx_args=[{"gain": 2.0}, {"gain": 3.0}])
    assert found.x.ravel() == pytest.approx([1.0, 3.0])
    assert found.z_prior.ravel() == pytest.approx([2.0, 9.0])
    assert found.S.ravel() == pytest.approx([4.0 * 2.0 + 1.0, 9.0 * 3.0 + 1.0])


def test_without_a_function_of_observations_there_are_states_alone():
    found = ExtendedKalmanFilter(1, 1, fx=lambda x: x).forecast(2)
    assert found.z_prior is None
    assert found.P.ravel() == pytest.approx([2.0, 3.0])


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0,), "steps: got 0, expected"),
        ((2.5,), "steps: got 2.5, expected"),
        ((10**15,), "steps: got 1"),
        ((3, [1.0]), "us: "),
    ],
)
def test_what_is_refused(make, arguments, message):
    with pytest.raises((ParameterError, ShapeError), match=message):
        make().forecast(*arguments)


class Own(Filter):
    """A member that does not say how an observation comes about."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.eye(1)
        self.x_prior, self.P_prior, self.log_likelihood = self.x, self.P, 0.0

    def predict(self, u=None):
        self.x, self.P = 0.5 * self.x, self.P + 1.0

    def update(self, z):
        pass


def test_a_bank_with_a_member_that_says_nothing_of_observations_forecasts_states():
    found = IMMEstimator([Own(), Own()], [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]]).forecast(2)
    assert found.z_prior is None
    assert found.P.ravel() == pytest.approx([2.0, 3.0])
    assert found.mu.sum(axis=1) == pytest.approx([1.0, 1.0])
