"""The fuzzy (possibilistic) state estimator: norms, memberships, relations and filters."""

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
from fuzzykf.possibility.relations import Rule, RuleBase, compose, extend, fuzzify

__all__ = [
    "CauchyMembership",
    "FunctionMembership",
    "FuzzyRelationEstimator",
    "GaussianMembership",
    "GridMembership",
    "IntervalMembership",
    "ParabolicMembership",
    "Rule",
    "RuleBase",
    "SingletonMembership",
    "TConorm",
    "TNorm",
    "TriangularMembership",
    "compose",
    "extend",
    "fuzzify",
]
