"""Pictures that stay readable without colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import moved
from fuzzykf.plotting.laws import plot_graph, plot_law, plot_model, plot_path
from fuzzykf.plotting.memberships import plot_estimate, plot_membership
from fuzzykf.plotting.results import plot_result
from fuzzykf.plotting.style import BLUE, ORANGE, TRUTH
from fuzzykf.plotting.widths import plot_widths

__all__ = [
    "BLUE",
    "ORANGE",
    "TRUTH",
    "plot_estimate",
    "plot_graph",
    "plot_law",
    "plot_membership",
    "plot_model",
    "plot_path",
    "plot_result",
    "plot_widths",
]

if not TYPE_CHECKING:  # to type checkers only what is listed is there
    __all__ += ["plot_comparison"]  # which has moved up

    def __getattr__(name: str) -> object:
        """Find what has moved."""
        return moved.lookup(__name__, name)
