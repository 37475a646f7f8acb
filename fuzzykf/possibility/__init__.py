"""The fuzzy (possibilistic) state estimator: norms, memberships, relations and filters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import moved
from fuzzykf.possibility.estimator import FuzzyRelationEstimator
from fuzzykf.possibility.memberships import (
    CauchyMembership,
    FunctionMembership,
    GaussianMembership,
    GridMembership,
    IntervalMembership,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.possibility.norms import TConorm, TNorm
from fuzzykf.possibility.observing import (
    Controllability,
    LocalObservability,
    Observability,
    controllability,
    observability,
)
from fuzzykf.possibility.relations import Rule, RuleBase, compose, extend, fuzzify

__all__ = [
    "CauchyMembership",
    "Controllability",
    "FunctionMembership",
    "FuzzyRelationEstimator",
    "GaussianMembership",
    "GridMembership",
    "IntervalMembership",
    "LocalObservability",
    "Observability",
    "ParabolicMembership",
    "Rule",
    "RuleBase",
    "SingletonMembership",
    "TConorm",
    "TNorm",
    "TriangularMembership",
    "compose",
    "controllability",
    "extend",
    "fuzzify",
    "observability",
]

if not TYPE_CHECKING:  # to type checkers only what is listed is there

    def __getattr__(name: str) -> object:
        """Find what has moved."""
        return moved.lookup(__name__, name)
