"""Parameters of a fuzzy law, or of a hard chain, from observed transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.registry import either
from fuzzykf.switching.laws.chains import as_law
from fuzzykf.switching.laws.registry import LAWS, learned_laws

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.base import Law

__all__ = ["count_transitions", "law_to_learn"]

#: The size of a law by name is known from that on so few nodes, which always fits.
FEW = 5


def law_to_learn(law: Any, n_nodes: int, check_size: Callable[[Callable[[int], int]], None]) -> Law:
    """Return the law at which a search begins, and whose structure it keeps.

    Parameters
    ----------
    law : str, Law or SwitchChain
    n_nodes : int
    check_size : callable
        Told how many nodes the chain of the law has on so many between two classes, before there is one.

    Raises
    ------
    ParameterError
        If it is no law, or none that can be learned.
    """
    if isinstance(law, str):
        if law not in learned_laws():
            raise ParameterError(
                f"law: got {law!r}, expected {either(learned_laws())}, or a law to begin with"
            )
        check_size(LAWS[law].by_name(min(n_nodes, FEW)).size)
        start: Law = LAWS[law].by_name(n_nodes)
    else:
        start = as_law(law)
        check_size(start.size)
    start.learner(n_nodes)  # what is wrong with it for learning is said before any work
    return start


def count_transitions(before: FloatArray, after: FloatArray, K: int) -> FloatArray:
    """Count the transitions between K regimes, (K, K)."""
    counts = np.zeros((K, K))
    np.add.at(counts, (before.astype(int), after.astype(int)), 1.0)
    return counts
