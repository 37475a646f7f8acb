"""Parameters that depend on the switch: their derivatives by what was given."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.switching.state_space.parameters import Parameter

RNG = np.random.default_rng(0)
ROOTS = RNG.normal(size=(3, 2, 2))

#: Classes, and values between two and between all of them.
SHARES = np.concatenate([np.eye(3), [[0.5, 0.5, 0.0], [0.2, 0.3, 0.5]]])

COVARIANCES = ROOTS @ np.swapaxes(ROOTS, 1, 2)

#: The second component is twice the first one, in all classes; the first one has no variance.
SINGULAR = np.array([1.0, 4.0, 0.5])[:, None, None] * np.array([[1.0, 2.0], [2.0, 4.0]])
SECOND = np.array([1.0, 4.0, 0.5])[:, None, None] * np.array([[0.0, 0.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("given", "mix"),
    [
        (RNG.normal(size=(2, 2)), None),
        (RNG.normal(size=(3, 2, 2)), None),
        (COVARIANCES[0], "log"),
        (COVARIANCES, "linear"),
        (COVARIANCES, "log"),
        (SINGULAR, "log"),
        (SECOND, "log"),
    ],
    ids=["shared", "each", "shared log", "linear", "log", "singular log", "first singular log"],
)
def test_derivatives_are_those_of_differences(given, mix):
    way = RNG.normal(size=given.shape)
    if mix is not None:  # singular covariances move along their own range
        rank = np.linalg.matrix_rank(given).min()
        way = way + np.swapaxes(way, -1, -2) if rank == 2 else RNG.normal(size=(3, 1, 1)) * given
    by_value = RNG.normal(size=(5, 2, 2))
    by_value = by_value + np.swapaxes(by_value, 1, 2)

    def value(step):
        return (Parameter("Q", given + step * way, 3, (2, 2), mix).at(SHARES) * by_value).sum()

    slope = Parameter("Q", given, 3, (2, 2), mix).pull_back(SHARES, by_value)
    exact = float((slope * way).sum())
    assert exact == pytest.approx((value(1e-5) - value(-1e-5)) / 2e-5, rel=1e-8)


def test_a_function_has_none():
    parameter = Parameter("F", lambda weights: np.eye(2), 3, (2, 2))
    with pytest.raises(ParameterError, match="F: a function of the class weights has no gradient"):
        parameter.pull_back(SHARES, np.zeros((5, 2, 2)))
