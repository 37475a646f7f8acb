"""The filters, as users meet them."""

from fuzzykf.switching.filters.exact import CGOMSMFilter, OFSRFilter
from fuzzykf.switching.filters.known_switch import KnownSwitchFilter
from fuzzykf.switching.filters.switching_filter import SwitchingFilter

__all__ = ["CGOMSMFilter", "KnownSwitchFilter", "OFSRFilter", "SwitchingFilter"]
