"""A conformance check for filters: those of this package, and your own.

`check_filter` plays through what `fuzzykf.base.Filter` promises and says which
promise a filter breaks.
"""

from fuzzykf.testing.case import FilterCheckError
from fuzzykf.testing.check import CheckReport, check_filter

__all__ = ["CheckReport", "FilterCheckError", "check_filter"]
