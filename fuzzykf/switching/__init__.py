"""Exact filters for Gaussian systems whose regime switches abruptly or gradually."""

from fuzzykf.switching.cglssm import CGLSSM
from fuzzykf.switching.chain import SwitchChain
from fuzzykf.switching.filter_base import SwitchingFilter
from fuzzykf.switching.filters import CGOMSMFilter, OFSRFilter
from fuzzykf.switching.fuzzy_model import CGOFMSModel
from fuzzykf.switching.hard_model import CGOMSModel
from fuzzykf.switching.known_switch import KnownSwitchFilter
from fuzzykf.switching.laws import FuzzyMarkovLaw
from fuzzykf.switching.repair import shrink_covariances
from fuzzykf.switching.simulation import Simulation
from fuzzykf.switching.systems import StationarySystem

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
