"""Exact filters for Gaussian systems whose regime switches abruptly or gradually."""

from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.pairs import InitialLaw, PairCoefficients, PairTables, SwitchingSystem
from fuzzykf.switching.dynamics.placed import StationarySystem
from fuzzykf.switching.filters import CGOMSMFilter, KnownSwitchFilter, OFSRFilter, SwitchingFilter
from fuzzykf.switching.laws import FuzzyMarkovLaw, SwitchChain
from fuzzykf.switching.models.fuzzy import CGOFMSModel
from fuzzykf.switching.models.hard import CGOMSModel
from fuzzykf.switching.models.repair import shrink_covariances
from fuzzykf.switching.state_space.cglssm import CGLSSM

__all__ = [
    "CGLSSM",
    "CGOFMSModel",
    "CGOMSMFilter",
    "CGOMSModel",
    "FuzzyMarkovLaw",
    "InitialLaw",
    "KnownSwitchFilter",
    "OFSRFilter",
    "PairCoefficients",
    "PairTables",
    "Simulation",
    "StationarySystem",
    "SwitchChain",
    "SwitchingFilter",
    "SwitchingSystem",
    "shrink_covariances",
]
