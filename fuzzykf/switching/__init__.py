"""Exact filters for Gaussian systems whose regime switches abruptly or gradually."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import moved
from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.pairs import InitialLaw, PairCoefficients, PairTables, SwitchingSystem
from fuzzykf.switching.dynamics.placed import StationarySystem
from fuzzykf.switching.filters import (
    CGOMSMFilter,
    FilterPool,
    FuzzySwitchFilter,
    HardSwitchFilter,
    KnownSwitchFilter,
    OFSRFilter,
    SwitchingFilter,
    SwitchingKalmanFilter,
    pool_models,
)
from fuzzykf.switching.inference.exact import EXACT
from fuzzykf.switching.inference.method import Method
from fuzzykf.switching.inference.mixture import Mixture
from fuzzykf.switching.inference.on_nodes import GPB2, IMM
from fuzzykf.switching.laws import FuzzyMarkovLaw, SwitchChain
from fuzzykf.switching.laws.fades import FadeLaw
from fuzzykf.switching.laws.graph import GraphLaw
from fuzzykf.switching.models.fuzzy import CGOFMSModel
from fuzzykf.switching.models.hard import CGOMSModel
from fuzzykf.switching.models.repair import shrink_covariances
from fuzzykf.switching.state_space.cglssm import CGLSSM
from fuzzykf.switching.state_space.model import SwitchingStateSpace

__all__ = [
    "CGLSSM",
    "EXACT",
    "GPB2",
    "IMM",
    "CGOFMSModel",
    "CGOMSMFilter",
    "CGOMSModel",
    "FadeLaw",
    "FilterPool",
    "FuzzyMarkovLaw",
    "FuzzySwitchFilter",
    "GraphLaw",
    "HardSwitchFilter",
    "InitialLaw",
    "KnownSwitchFilter",
    "Method",
    "Mixture",
    "OFSRFilter",
    "PairCoefficients",
    "PairTables",
    "Simulation",
    "StationarySystem",
    "SwitchChain",
    "SwitchingFilter",
    "SwitchingKalmanFilter",
    "SwitchingStateSpace",
    "SwitchingSystem",
    "WindowFeatures",
    "pool_models",
    "shrink_covariances",
]

if not TYPE_CHECKING:  # to type checkers only what is listed is there

    def __getattr__(name: str) -> object:
        """Find what has moved."""
        return moved.lookup(__name__, name)
