"""Matrices at construction, noises of single steps, and the matrix H that was forgotten."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    KalmanFilter,
    TriangularMembership,
)
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError

F, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
GAUSS, BOX = GaussianMembership(0.0, 1.0), IntervalMembership(-1.0, 1.0)
MATRICES = {"F": F, "H": H, "Q": np.diag([0.1, 0.3]), "R": 0.7, "B": [[0.0], [1.0]], "P": 3.0 * np.eye(2)}


@pytest.mark.parametrize("x", [[[1.0], [0.5]], [1.0, 0.5]], ids=["column", "flat"])
@pytest.mark.parametrize("t_norm", ["product", "hamacher", "lukasiewicz"])
def test_at_construction_is_as_if_assigned(t_norm, x) -> None:
    given = MATRICES | {"x": x}
    made = FuzzyRelationEstimator(2, 1, t_norm=t_norm, **given)
    assigned = FuzzyRelationEstimator(2, 1, t_norm=t_norm)
    for name, value in given.items():
        setattr(assigned, name, value)
    for est in (made, assigned):
        est.predict([0.2])
        est.update(1.1)
    for name in ("x", "P", "x_prior", "y", "S", "K", "F", "H", "B", "Q", "R", "possibility"):
        assert np.array_equal(getattr(made, name), getattr(assigned, name)), name
        assert np.shape(getattr(made, name)) == np.shape(x if name == "x" else getattr(assigned, name)), name


def test_it_is_the_kalman_filter_of_the_same_arguments() -> None:
    given = MATRICES | {"x": [1.0, 0.5]}
    zs, us = [1.0, None, 3.0], [[0.1], [0.2], [0.3]]
    found = FuzzyRelationEstimator(2, 1, 1, **given).filter(zs, us)
    expected = KalmanFilter(2, 1, 1, **given).filter(zs, us)
    np.testing.assert_allclose(found.x, expected.x, rtol=1e-12)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-12)


def test_arrays_are_copied_and_the_origin_is_kept() -> None:
    given = {name: np.array(value, dtype=float) for name, value in MATRICES.items()}
    est = FuzzyRelationEstimator(2, 1, **given)
    for value in given.values():
        value[...] = 9.0
    again = FuzzyRelationEstimator(2, 1, **MATRICES)
    assert np.array_equal(est.filter([1.0, 2.0]).x, again.filter([1.0, 2.0]).x)
    est.reset()
    assert np.array_equal(est.P, MATRICES["P"])


def test_representations_with_maps_take_them_too() -> None:
    for options in ({"points": 51}, {}):
        est = FuzzyRelationEstimator(1, 1, F=0.5, H=2.0, state=BOX, measurement_noise=BOX, **options)
        est.step(1.0)
        assert (est.lower.item(), est.upper.item()) == pytest.approx((0.0, 0.5), abs=0.03)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"F": np.eye(2)}, ShapeError, r"F: got shape \(2, 2\), expected \(1, 1\)"),
        ({"H": [[1.0, 2.0]]}, ShapeError, "H: got shape"),
        ({"H": np.nan}, ParameterError, "H: .*finite"),
        ({"Q": -1.0}, NotPositiveDefiniteError, "Q: "),
        ({"R": np.eye(2)}, ShapeError, "R: got shape"),
        ({"P": -1.0}, NotPositiveDefiniteError, "P: "),
        ({"x": [1.0, 2.0]}, ShapeError, "x: got shape"),
        ({"B": [[1.0], [2.0]]}, ShapeError, "B: got shape"),
        (
            {"F": 1.0, "fx": np.sin, "state": GAUSS, "measurement_noise": GAUSS},
            ParameterError,
            "F: .*beside fx",
        ),
        (
            {"B": 1.0, "fx": np.sin, "state": GAUSS, "measurement_noise": GAUSS},
            ParameterError,
            "B: .*beside fx",
        ),
        (
            {"H": 1.0, "hx": np.sin, "state": GAUSS, "measurement_noise": GAUSS},
            ParameterError,
            "H: .*beside hx",
        ),
        (
            {"Q": 1.0, "state": BOX, "measurement_noise": BOX},
            ParameterError,
            "Q: has no meaning.*process_noise",
        ),
        ({"x": 1.0, "state": BOX, "measurement_noise": BOX}, ParameterError, "x: has no meaning.*membership"),
    ],
)
def test_what_is_wrong_is_named(options, error, message) -> None:
    with pytest.raises(error, match=message):
        FuzzyRelationEstimator(1, 1, **options)


# ------------------------------------------------------------------ H


@pytest.mark.parametrize("options", [{}, {"state": BOX, "measurement_noise": BOX}])
def test_an_h_that_nobody_gave_is_missed_at_the_first_measurement(options) -> None:
    est = FuzzyRelationEstimator(1, 1, **options)
    assert "H is not set" in repr(est)
    est.predict()
    est.update(None)  # nothing is ignored
    before = est.x.copy()
    for one in (est, copy.deepcopy(est), pickle.loads(pickle.dumps(est))):
        for verb in (
            one.update,
            one.step,
            lambda z, one=one: one.filter([z]),
            lambda z, one=one: one.smooth([z]),
        ):
            with pytest.raises(ParameterError, match=r"H: got no matrix.*expected one of shape \(1, 1\)"):
                verb(1.0)
        assert np.array_equal(one.x, before)
    est.update(1.0, H=1.0)  # for once
    est.H[0, 0] = 1.0  # in place
    est.update(1.0)
    est = FuzzyRelationEstimator(1, 1, **options)
    est.H = np.zeros((1, 1))  # a sensor that is off, on purpose
    est.step(1.0)
    FuzzyRelationEstimator(1, 1, H=0.0, **options).step(0.5)


# ------------------------------------------------------------------ noises of single steps


@pytest.mark.parametrize("points", [None, 101])
def test_a_noise_may_be_a_membership_in_every_representation(points) -> None:
    narrow = IntervalMembership(-0.25, 0.25)
    given = {"state": BOX, "measurement_noise": BOX, "H": 1.0, "points": points}
    est = FuzzyRelationEstimator(1, 1, **given)
    est.predict(Q=narrow)
    assert est.upper.item() == pytest.approx(1.25)
    est.update(0.0, R=[narrow])
    assert (est.lower.item(), est.upper.item()) == pytest.approx((-0.25, 0.25), abs=0.02)
    assert est.measurement_noise is BOX


def test_a_membership_is_the_noise_and_what_else_is_given_reaches_hx() -> None:
    seen = []

    def hx(x, R=None):
        seen.append(R)
        return x

    given = {"hx": hx, "state": GAUSS, "process_noise": GAUSS, "points": 101}
    est = FuzzyRelationEstimator(1, 1, measurement_noise=GAUSS, **given)
    other = FuzzyRelationEstimator(1, 1, measurement_noise=CauchyMembership(0.0, 2.0), **given)
    est.update(1.0, R=CauchyMembership(0.0, 2.0))
    other.update(1.0)
    assert np.array_equal(est.x, other.x)
    assert set(seen) == {None}
    est.update(1.0, R=3.0)
    assert seen[-1] == 3.0


def test_a_noise_of_another_shape_is_refused() -> None:
    est = FuzzyRelationEstimator(1, 1, H=1.0)
    with pytest.raises(ParameterError, match="R: this estimator keeps gaussian memberships"):
        est.update(1.0, R=TriangularMembership(-1.0, 0.0, 1.0))
    with pytest.raises(ParameterError, match="Q: got a membership of 2 dimensions, expected 1"):
        est.predict(Q=GaussianMembership([0.0, 0.0], np.eye(2)))
    est.predict(Q=GaussianMembership(1.0, 2.0))  # with a bias
    assert (est.x.item(), est.P.item()) == (1.0, 3.0)
