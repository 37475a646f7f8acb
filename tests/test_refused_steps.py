"""A step that is refused leaves a filter as it was, whatever filter it is and whatever is refused."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import (
    CGOFMSModel,
    CGOMSModel,
    ExtendedKalmanFilter,
    Filter,
    FuzzyMarkovLaw,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    IntervalMembership,
    KalmanFilter,
)
from fuzzykf.base import as_observation
from fuzzykf.errors import EmptyIntersectionError, FuzzykfError

Z = np.array([[1.0, 0.5], [0.5, 1.0]])
PAIRS = np.broadcast_to(np.block([[Z, 0.8 * Z], [0.8 * Z, Z]]), (2, 2, 4, 4))
LAW = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)


class Average(Filter):
    """A filter of somebody's own, which moves before it looks."""

    dim_x = dim_z = 1

    def __init__(self):
        self.x, self.P = np.zeros((1, 1)), np.eye(1)
        self.x_prior, self.P_prior = self.x, self.P

    def predict(self):
        self.remember_origin()
        self.x = self.x_prior = 0.9 * self.x
        self.P = self.P_prior = self.P + 1.0

    def update(self, z):
        observed = as_observation(z, self.dim_z)
        if observed is not None:
            self.x = 0.5 * (self.x + observed[:, None])


class InPlace(Average):
    """One that moves its arrays where they are, so that the observation has to be looked at before."""

    def predict(self):
        self.remember_origin()
        self.x_prior, self.P_prior = 0.9 * self.x, self.P + 1.0
        self.x *= 0.9
        self.P += 1.0


def kalman(kind=KalmanFilter):
    f = kind(2, 1)
    f.F, f.Q, f.R = np.array([[1.0, 1.0], [0.0, 1.0]]), 0.1 * np.eye(2), 1.0
    f.H = np.array([[1.0, 0.0]])
    return f


def extended():
    f = kalman(ExtendedKalmanFilter)
    f.hx, f.HJacobian = lambda x: x[:1], lambda x: np.array([[1.0, 0.0]])
    return f


def bank(method):
    return IMMEstimator([kalman(), kalman()], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]], method=method)


def fuzzy(**options):
    return FuzzyRelationEstimator(
        1,
        1,
        fx=lambda x: 0.9 * x,
        hx=lambda x: x,
        state=GaussianMembership([0.0], [[1.0]]),
        process_noise=GaussianMembership([0.0], [[0.1]]),
        measurement_noise=GaussianMembership([0.0], [[0.2]]),
        points=51,
        **options,
    )


MAKERS = {
    "fuzzy switch": lambda: CGOFMSModel(LAW, np.zeros((2, 2)), PAIRS, 1).filter(),
    "hard switch": lambda: CGOMSModel([[0.9, 0.1], [0.3, 0.7]], np.zeros((2, 2)), PAIRS, 1).filter(),
    "Kalman": kalman,
    "extended": extended,
    "IMM": lambda: bank("imm"),
    "GPB2": lambda: bank("gpb2"),
    "grid": lambda: fuzzy(domain=[(-5.0, 5.0)]),
    "moving grid": fuzzy,
    "own": Average,
    "own, in place": InPlace,
}
SHOWN = ("x", "P", "x_prior", "P_prior", "mu", "y", "S", "log_likelihood", "possibility")


def shown(f):
    return {name: np.array(getattr(f, name)) for name in SHOWN if hasattr(f, name)}


@pytest.mark.parametrize("bad", ["a", [1.0, 2.0, 3.0], np.inf, [[1, 2], [3, 4]], 1j, {"a": 1}], ids=str)
@pytest.mark.parametrize("name", MAKERS)
def test_a_refused_step_leaves_the_filter_as_it_was(name, bad) -> None:
    f, twin = MAKERS[name](), MAKERS[name]()
    for z in (0.1, 0.3):
        f.step(z)
        twin.step(z)
    with pytest.raises(FuzzykfError, match="z: "):
        f.step(bad)
    for field, value in shown(twin).items():
        np.testing.assert_array_equal(getattr(f, field), value, err_msg=field)
    np.testing.assert_array_equal(f.step(0.2), twin.step(0.2))


def test_a_measurement_that_contradicts_the_state_is_refused_likewise() -> None:
    def bounded():
        return FuzzyRelationEstimator(
            1,
            1,
            fx=lambda x: 0.9 * x,
            hx=lambda x: x,
            state=IntervalMembership([-1.0], [1.0]),
            process_noise=IntervalMembership([-0.1], [0.1]),
            measurement_noise=IntervalMembership([-0.2], [0.2]),
            on_empty="raise",
        )

    f, twin = bounded(), bounded()
    f.step(0.1)
    twin.step(0.1)
    with pytest.raises(EmptyIntersectionError):
        f.step(50.0)
    np.testing.assert_array_equal(f.x, twin.x)
    np.testing.assert_array_equal(f.step(0.2), twin.step(0.2))


def test_a_series_that_is_refused_half_way_leaves_a_filter_as_it_was():
    one = IntervalMembership
    f = FuzzyRelationEstimator(
        1, 1, state=one(-2.0, 2.0), process_noise=one(-0.2, 0.2), measurement_noise=one(-1.0, 1.0), H=1.0
    )
    f.step(0.5)
    x, P = f.x.copy(), f.P.copy()
    for verb in (f.filter, f.batch_filter):
        with pytest.raises(EmptyIntersectionError):
            verb([0.4, 0.3, 50.0, 0.2])
        np.testing.assert_array_equal(f.x, x)
        np.testing.assert_array_equal(f.P, P)
