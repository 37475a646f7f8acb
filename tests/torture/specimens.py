"""One small, valid specimen of every kind of public object, made afresh each time it is asked for.

Functions that specimens carry stand at the top of this module, so that all of them can be pickled.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

import fuzzykf
from fuzzykf import possibility
from fuzzykf.comparison import prepare
from fuzzykf.possibility import memberships, norms
from fuzzykf.switching import CGLSSM
from fuzzykf.switching.laws.cells import CellLaw

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["FILTERS", "LINEAR", "SPECIMENS", "known_switch", "specimen"]

LINEAR: dict[str, Any] = {
    "transition": [[0.9, 0.1], [0.2, 0.8]],
    "A": [[[0.9]], [[0.5]]],
    "B": [[[1.0]], [[1.0]]],
    "C": [[[0.3]], [[1.0]]],
    "D": [[[0.5]], [[0.5]]],
}


# --------------------------------------------------------------------------- functions


def drift(x: Any, u: Any = 0.0) -> Any:
    """Move two components: the second is the speed of the first, and turns back."""
    return np.array([x[0] + 0.1 * x[1], x[1] - 0.1 * np.sin(x[0])]).reshape(np.shape(x))


def drift_jacobian(x: Any, u: Any = 0.0) -> Any:
    """Derive `drift`."""
    first = float(np.ravel(x)[0])
    return np.array([[1.0, 0.1], [-0.1 * np.cos(first), 1.0]])


def distance(x: Any) -> Any:
    """See the first of two components from one unit aside."""
    return np.array([np.sqrt(1.0 + np.ravel(x)[0] ** 2)]).reshape(-1, *([1] * (np.ndim(x) - 1)))


def distance_jacobian(x: Any) -> Any:
    """Derive `distance`."""
    first = float(np.ravel(x)[0])
    return np.array([[first / np.sqrt(1.0 + first**2), 0.0]])


def bent(x: Any, *rest: Any) -> Any:
    """Move one component, slightly bent."""
    return 0.9 * x + 0.1 * np.sin(x)


def identity(x: Any) -> Any:
    """See what there is."""
    return x


def tent(x: Any) -> Any:
    """Return a membership."""
    return np.maximum(0.0, 1.0 - np.abs(np.asarray(x)[..., 0]))


# --------------------------------------------------------------------------- models


@cache
def fuzzy_model() -> Any:
    """Return a scalar fuzzy model in covariances."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    law = fuzzykf.FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return fuzzykf.CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)


def transitions(K: int, m: int, q: int) -> tuple[Any, ...]:
    """Return A, Q, means and covariances of a stable system without symmetries."""
    rng, d = np.random.default_rng(5), m + q
    A = 0.6 * rng.uniform(-1, 1, (K, K, d, d)) / np.sqrt(d)
    A[..., range(d), range(d)] += 0.3
    A[..., m:, :m] = 0.0
    root = rng.normal(size=(K, K, d, d)) * 0.4 + 0.5 * np.eye(d)
    first = rng.normal(size=(K, d, d)) * 0.4 + np.eye(d)
    return A, root @ np.swapaxes(root, -1, -2), rng.normal(size=(K, d)), first @ np.swapaxes(first, -1, -2)


@cache
def hard_model(m: int = 2, q: int = 1) -> Any:
    """Return a model of two hard regimes."""
    return fuzzykf.CGOMSModel.from_transitions([[0.8, 0.2], [0.3, 0.7]], *transitions(2, m, q), dim_x=m)


@cache
def space(q: int = 1) -> Any:
    """Return a state-space model whose gain fades."""
    law = fuzzykf.FadeLaw.between(10, 6, jump=0.02)
    H = np.array([np.eye(2)[:q], 0.3 * np.eye(2)[:q]])
    return fuzzykf.SwitchingStateSpace(law, F=[[0.9, 0.1], [0.0, 0.8]], H=H, Q=np.eye(2), R=np.eye(q))


@cache
def converted(mode: str) -> Any:
    """Return a converted state-space model."""
    start = [0.5, 0.5] if mode == "time_varying" else None
    return fuzzykf.CGOMSModel.from_cglssm(**LINEAR, mode=mode, initial_probability=start)


# --------------------------------------------------------------------------- filters


def kalman(m: int = 1, flat: bool = False) -> Any:
    """Return a Kalman filter of position and speed that sees ``m`` components."""
    f = fuzzykf.KalmanFilter(2, m, 1, F=[[1.0, 0.1], [0.0, 0.9]], H=np.eye(2)[:m], B=[[0.0], [0.1]])
    f.Q, f.R = 0.1 * np.eye(2), 0.5 * np.eye(m)
    if flat:
        f.x = np.zeros(2)
    return f


def extended() -> Any:
    """Return an extended Kalman filter."""
    return fuzzykf.ExtendedKalmanFilter(
        2, 1, fx=drift, FJacobian=drift_jacobian, hx=distance, HJacobian=distance_jacobian, Q=0.1 * np.eye(2)
    )


def bank(method: str = "imm") -> Any:
    """Return a bank of two Kalman filters."""
    slow, fast = kalman(), kalman()
    fast.Q = 2.0 * np.eye(2)
    return fuzzykf.IMMEstimator([slow, fast], [0.6, 0.4], [[0.9, 0.1], [0.2, 0.8]], method=method)


def linear_estimator() -> Any:
    """Return an estimator in closed form."""
    g = memberships.GaussianMembership
    return fuzzykf.FuzzyRelationEstimator(
        1,
        1,
        state=g([0.0], [[1.0]]),
        process_noise=g([0.0], [[0.1]]),
        measurement_noise=g([0.0], [[0.5]]),
        H=1.0,
    )


def box_estimator() -> Any:
    """Return an estimator on intervals."""
    one = memberships.IntervalMembership
    return fuzzykf.FuzzyRelationEstimator(
        1, 1, state=one(-2.0, 2.0), process_noise=one(-0.2, 0.2), measurement_noise=one(-1.0, 1.0), H=1.0
    )


def grid_estimator(on_empty: str = "reset") -> Any:
    """Return an estimator on a grid."""
    three = memberships.TriangularMembership
    return fuzzykf.FuzzyRelationEstimator(
        1,
        1,
        fx=bent,
        hx=identity,
        state=three(-3.0, 0.0, 3.0),
        process_noise=three(-0.5, 0.0, 0.5),
        measurement_noise=three(-2.0, 0.0, 2.0),
        on_empty=on_empty,
        points=41,
        domain=[[-6.0, 6.0]],
    )


#: Filters by name.  The number of components of an observation stands beside.
FILTERS: dict[str, tuple[int, Callable[[], Any]]] = {
    "OFSRFilter": (1, lambda: fuzzykf.OFSRFilter(fuzzy_model(), 3)),
    "OFSRFilter, signed": (1, lambda: fuzzykf.OFSRFilter(fuzzy_model(), 4, "product")),
    "CGOMSMFilter": (1, lambda: fuzzykf.CGOMSMFilter(hard_model())),
    "CGOMSMFilter, wide": (2, lambda: fuzzykf.CGOMSMFilter(hard_model(1, 2))),
    "CGOMSMFilter, steady": (1, lambda: fuzzykf.CGOMSMFilter(converted("stationary"))),
    "CGOMSMFilter, moving": (1, lambda: fuzzykf.CGOMSMFilter(converted("time_varying"))),
    "SwitchingKalmanFilter": (1, lambda: fuzzykf.SwitchingKalmanFilter(space(), n_nodes=3)),
    "SwitchingKalmanFilter, gpb2": (
        2,
        lambda: fuzzykf.SwitchingKalmanFilter(space(2), method="gpb2", n_nodes=3),
    ),
    "KnownSwitchFilter": (1, lambda: fuzzykf.KnownSwitchFilter(fuzzy_model())),
    "KnownSwitchFilter, wide": (2, lambda: fuzzykf.KnownSwitchFilter(hard_model(1, 2))),
    "KalmanFilter": (1, kalman),
    "KalmanFilter, wide": (2, lambda: kalman(2)),
    "KalmanFilter, flat": (2, lambda: kalman(2, flat=True)),
    "ExtendedKalmanFilter": (1, extended),
    "IMMEstimator": (1, bank),
    "IMMEstimator, gpb2": (1, lambda: bank("gpb2")),
    "FuzzyRelationEstimator": (1, linear_estimator),
    "FuzzyRelationEstimator, box": (1, box_estimator),
    "FuzzyRelationEstimator, grid": (1, grid_estimator),
}


# --------------------------------------------------------------------------- everything


def sample(n: int = 40) -> Any:
    """Return a simulated series."""
    return fuzzy_model().simulate(n, np.random.default_rng(3))


@cache
def fit() -> Any:
    """Return what learning found."""
    s = sample()
    return fuzzykf.CGOMSModel.fit(s.x, s.y, max_iter=2, n_starts=1, form="covariance")


@cache
def comparison() -> Any:
    """Return a comparison."""
    s = sample(200)
    return fuzzykf.compare_models(
        s.x[:, 0],
        s.y[:, 0],
        np.random.default_rng(0),
        candidates=["hard2", "regression"],
        n_folds=2,
        max_iter=2,
        n_resamples=100,
    )


def times(n: int = 48) -> Any:
    """Return hours."""
    return np.datetime64("2014-01-06T00:00", "s") + np.arange(n) * np.timedelta64(3600, "s")


def law(name: str = "fmc1") -> Any:
    """Return a law of the switch."""
    laws = fuzzykf.FuzzyMarkovLaw
    if name == "cells":
        return CellLaw(np.random.default_rng(0).random((5, 5)))
    if name == "density":
        return laws.from_density([[0.2, 0.05], [0.05, 0.2]], edge, lambda a, b: 0.1 + 0.0 * a * b)
    return laws.fmc1(0.07, 0.05, 0.16) if name == "fmc1" else laws.fmc2(0.15, 0.6, 0.2)


def edge(r: Any) -> Any:
    """Return a density on an edge."""
    return 0.1 + 0.0 * np.asarray(r)


def known_switch(n: int) -> Any:
    """Return a switch that is known."""
    return (np.arange(n) // 3 % 2).astype(float)


#: Everything that is not a filter, by name.
OTHERS: dict[str, Callable[[], Any]] = {
    "CGOFMSModel": fuzzy_model,
    "CGOMSModel": hard_model,
    "CGOMSModel, wide": lambda: hard_model(1, 2),
    "CGOMSModel, steady": lambda: converted("stationary"),
    "CGOMSModel, moving": lambda: converted("time_varying"),
    "CGOMSModel, hardened": lambda: fuzzy_model().harden(),
    "CGLSSM": lambda: CGLSSM(**LINEAR),
    "SwitchingStateSpace": lambda: space(),
    "FuzzyMarkovLaw, fmc1": law,
    "FuzzyMarkovLaw, fmc2": lambda: law("fmc2"),
    "FuzzyMarkovLaw, cells": lambda: law("cells"),
    "FadeLaw": lambda: fuzzykf.FadeLaw.between(10, 6, jump=0.02, turn_back=0.1),
    "GraphLaw": lambda: fuzzykf.GraphLaw.from_masses([3, 3, 2], {(0, 1): 1.0, (1, 2): 0.5}),
    "SwitchChain": lambda: law().discretize(3),
    "SwitchChain, classes": lambda: fuzzykf.SwitchChain.from_classes([[0.8, 0.2], [0.3, 0.7]]),
    "placed": lambda: fuzzy_model().placed(2),
    "FilterResult": lambda: FILTERS["OFSRFilter"][1]().smooth(sample(6).y, keep_nodes=True),
    "Simulation": lambda: sample(5),
    "FitResult": fit,
    "ModelComparison": comparison,
    "Task": lambda: prepare(sample(200).x[:, 0], sample(200).y[:, 0]),
    "Standardizer": lambda: fuzzykf.Standardizer().fit(np.arange(12.0).reshape(6, 2) ** 2),
    "DailyProfile": lambda: fuzzykf.DailyProfile().fit(np.arange(48.0) % 24, times(), np.arange(48) >= 24),
    "GaussianMembership": lambda: memberships.GaussianMembership([0.0, 1.0], [[1.0, 0.3], [0.3, 2.0]]),
    "CauchyMembership": lambda: memberships.CauchyMembership(0.5, 2.0),
    "ParabolicMembership": lambda: memberships.ParabolicMembership(0.5, 2.0),
    "TriangularMembership": lambda: memberships.TriangularMembership(-1.0, 0.0, 2.0),
    "IntervalMembership": lambda: memberships.IntervalMembership(-1.0, 2.0),
    "SingletonMembership": lambda: memberships.SingletonMembership(0.5),
    "GridMembership": lambda: memberships.GridMembership([np.linspace(-1, 1, 5)], [0.0, 0.5, 1.0, 0.5, 0.0]),
    "FunctionMembership": lambda: memberships.FunctionMembership(tent, [-1.0, 1.0]),
    "CutMembership": lambda: memberships.CauchyMembership(0.5, 2.0).cut(0.1),
    "JointMembership": lambda: memberships.JointMembership(
        [memberships.TriangularMembership(-1.0, 0.0, 2.0), memberships.IntervalMembership(-1.0, 2.0)],
        norms.MIN,
    ),
    "RuleBase": lambda: possibility.RuleBase.from_function(bent, np.linspace(-1.0, 1.0, 3)),
    **{f"TNorm, {name.name}": lambda name=name: name for name in (norms.PRODUCT, norms.HAMACHER, norms.MIN)},
    "TNorm, lukasiewicz": lambda: norms.LUKASIEWICZ,
    "TConorm": lambda: norms.BOUNDED_SUM,
    "TConorm, dual": lambda: norms.PROBABILISTIC_SUM,
}

#: Everything, by name.
SPECIMENS: dict[str, Callable[[], Any]] = {name: make for name, (_, make) in FILTERS.items()} | OTHERS


def specimen(name: str) -> Any:
    """Make a specimen; models and results may be shared, since nothing changes them."""
    return SPECIMENS[name]()
