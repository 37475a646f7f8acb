"""Membership functions: smooth, bounded, sampled, and made from others."""

from fuzzykf.possibility.memberships.base import Membership
from fuzzykf.possibility.memberships.bounded import (
    BoxMembership,
    IntervalMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.possibility.memberships.derived import CutMembership, JointMembership, sampled
from fuzzykf.possibility.memberships.elliptical import (
    CauchyMembership,
    EllipticalMembership,
    GaussianMembership,
    ParabolicMembership,
)
from fuzzykf.possibility.memberships.sampled import FunctionMembership, GridMembership

__all__ = [
    "BoxMembership",
    "CauchyMembership",
    "CutMembership",
    "EllipticalMembership",
    "FunctionMembership",
    "GaussianMembership",
    "GridMembership",
    "IntervalMembership",
    "JointMembership",
    "Membership",
    "ParabolicMembership",
    "SingletonMembership",
    "TriangularMembership",
    "sampled",
]
