"""Exact filters for Gaussian systems whose regime switches abruptly or gradually."""

from fuzzykf.results import Simulation
from fuzzykf.switching.dynamics.placed import StationarySystem
from fuzzykf.switching.filters.exact import CGOMSMFilter, OFSRFilter
from fuzzykf.switching.filters.known_switch import KnownSwitchFilter
from fuzzykf.switching.filters.switching_filter import SwitchingFilter
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.law import FuzzyMarkovLaw
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
    "KnownSwitchFilter",
    "OFSRFilter",
    "Simulation",
    "StationarySystem",
    "SwitchChain",
    "SwitchingFilter",
    "shrink_covariances",
]
