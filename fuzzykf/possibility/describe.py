"""How an estimator shows itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.possibility.beliefs import GridBelief
from fuzzykf.reprs import value_text

if TYPE_CHECKING:
    from fuzzykf.possibility.protocol import Belief

__all__ = ["describe"]

#: How long one line may be.
LONGEST = 90


def describe(est: Any) -> str:
    """Return what an estimator is and what it knows, in a few lines."""
    head = (
        f"{type(est).__name__}(dim_x={est.dim_x}, dim_z={est.dim_z}): representation "
        f"{est.representation!r}, t-norm {est.t_norm.name!r}"
    )
    parts = {
        "state": _state(est._belief),
        "dynamics": _map(est, "fx", "F"),
        "measurement": _map(est, "hx", "H"),
        "process noise": value_text(est._process_noise, LONGEST),
        "measurement noise": value_text(est._measurement_noise, LONGEST),
    }
    if est._constraint is not None:
        parts["constraint"] = value_text(est._constraint, LONGEST)
    return "\n".join([head, *(f"  {name}: {text}" for name, text in parts.items())])


def _state(belief: Belief) -> str:
    if not isinstance(belief, GridBelief):
        return value_text(belief.as_membership(), LONGEST)
    axes, cost = belief.lattice.axes, belief.lattice.cost  # and nothing that is computed once and kept
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    first, last = (np.array([axis[k] for axis in axes]) for k in (0, -1))
    likeliest = np.array([axis[k] for axis, k in zip(axes, best, strict=True)])
    size = " x ".join(str(axis.size) for axis in axes)
    return f"{size} nodes, {value_text(first)} to {value_text(last)}, the likeliest {value_text(likeliest)}"


def _map(est: Any, function: str, matrix: str) -> str:
    given = getattr(est, function)
    if given is not None:
        return value_text(given)
    value = getattr(est, matrix)
    if matrix == "H" and value is est._blank_H and not np.any(value):
        return "H is not set"
    return f"{matrix} = {value_text(value)}"
