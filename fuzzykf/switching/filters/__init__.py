"""The filters, as users meet them."""

from fuzzykf.switching.filters.cgomsm import CGOMSMFilter, HardSwitchFilter
from fuzzykf.switching.filters.known_switch import KnownSwitchFilter
from fuzzykf.switching.filters.ofsr import FuzzySwitchFilter, OFSRFilter
from fuzzykf.switching.filters.pool import FilterPool, pool_models
from fuzzykf.switching.filters.switching_filter import SwitchingFilter
from fuzzykf.switching.filters.switching_kalman import SwitchingKalmanFilter

__all__ = [
    "CGOMSMFilter",
    "FilterPool",
    "FuzzySwitchFilter",
    "HardSwitchFilter",
    "KnownSwitchFilter",
    "OFSRFilter",
    "SwitchingFilter",
    "SwitchingKalmanFilter",
    "pool_models",
]
