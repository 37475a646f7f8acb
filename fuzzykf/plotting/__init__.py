"""Pictures that stay readable without colour."""

from fuzzykf.plotting.comparison import plot_comparison
from fuzzykf.plotting.laws import plot_law, plot_model
from fuzzykf.plotting.memberships import plot_estimate, plot_membership
from fuzzykf.plotting.results import plot_result
from fuzzykf.plotting.style import BLUE, ORANGE, TRUTH

__all__ = [
    "BLUE",
    "ORANGE",
    "TRUTH",
    "plot_comparison",
    "plot_estimate",
    "plot_law",
    "plot_membership",
    "plot_model",
    "plot_result",
]
