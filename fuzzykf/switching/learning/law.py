"""Parameters of a fuzzy law, or of a hard chain, from observed transitions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.registry import either
from fuzzykf.switching.laws.base import NODES
from fuzzykf.switching.laws.chains import as_law
from fuzzykf.switching.laws.registry import LAWS, learned_laws

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.base import Law

__all__ = ["count_transitions", "law_to_learn"]


def law_to_learn(
    law: Any,
    n_nodes: int | None,
    check_size: Callable[[Callable[[int], int]], None],
    *,
    is_hidden: bool = True,
) -> Law:
    """Return the law at which a search begins, and whose structure it keeps.

    Parameters
    ----------
    law : str, Law or SwitchChain
    n_nodes : int, optional
    check_size : callable
        Told how many nodes the chain of the law has on so many between two classes, before there is one.
    is_hidden : bool
        Whether the switch is.

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
        nodes = NODES if n_nodes is None else n_nodes
        check_size(LAWS[law].by_name(min(nodes, NODES)).size)
        start: Law = LAWS[law].by_name(nodes)
    else:
        start = as_law(law)
        check_size(start.size)
        nodes = start.nodes_up_to(NODES) if n_nodes is None else n_nodes
    if is_hidden:  # what is wrong with it for a search is said before any work
        learner = start.learner(nodes)
        present = learner.initial @ learner.class_weights
        gone = [str(k) for k in np.flatnonzero(present <= 0.0)]
        if gone:
            raise ParameterError(
                f"law: leaves class {' and '.join(gone)} for ever, so that no search can begin there; "
                "expected ways back, by fades or jumps"
            )
    return start


def count_transitions(before: FloatArray, after: FloatArray, K: int) -> FloatArray:
    """Count the transitions between K regimes, (K, K)."""
    counts = np.zeros((K, K))
    np.add.at(counts, (before.astype(int), after.astype(int)), 1.0)
    return counts
