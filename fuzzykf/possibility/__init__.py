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

__all__ = [
    "CauchyMembership",
    "FunctionMembership",
    "FuzzyRelationEstimator",
    "GaussianMembership",
    "GridMembership",
    "IntervalMembership",
    "ParabolicMembership",
    "SingletonMembership",
    "TriangularMembership",
]
