"""The checks behind `fuzzykf.testing.check_filter`, one function each."""

from fuzzykf._conformance import basics, capabilities
from fuzzykf._conformance.case import CHECKS, Case, FilterCheckError

__all__ = ["CHECKS", "Case", "FilterCheckError", "basics", "capabilities"]
