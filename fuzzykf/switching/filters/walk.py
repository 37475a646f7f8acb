"""Series through the verbs of a switching filter, one after another."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.inference.series import FOUND, Trajectory, allocate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem

__all__ = ["walk"]


def walk(
    f: Any,
    system: SwitchingSystem,
    ys: FloatArray,
    states: bool,
    moves: Sequence[tuple[Any, ...]] | None = None,
    looks: Sequence[dict[str, Any]] | None = None,
) -> tuple[Trajectory, FloatArray]:
    """Filter a series by the verbs, which somebody has changed.

    Parameters
    ----------
    f : SwitchingFilter
    system : SwitchingSystem
        Of the filter.
    ys : ndarray, shape (n, dim_z)
    states : bool
        Whether the states of the nodes are wanted as well.
    moves : sequence of n tuples, optional
        What `predict` is given.
    looks : sequence of n dicts, optional
        What `update` is given besides the observation.

    Returns
    -------
    trajectory : Trajectory
    taken : ndarray, shape (n, dim_z)
        The observations that the filter took: a verb may have passed on others.
    """
    out, taken = allocate(system, (1, len(ys)), FOUND, states), np.empty_like(ys)
    for n, y in enumerate(ys):
        f.predict(*(() if moves is None else moves[n]))
        f.update(y, **(looks[n] if looks else {}))
        for name in FOUND:
            value = f._switch_key if name == "switch" else getattr(f, name)
            if value is not None:  # there is no mean between more than two classes
                out[name][0, n] = np.reshape(value, out[name].shape[2:])
        taken[n] = f._z
        if states:
            if f._mixture is None or f._predicted:
                raise ParameterError(
                    f"keep_nodes: this {type(f).__name__} has no state at observation {n}, as its "
                    "update does not call that of fuzzykf; expected False"
                )
            out["table"][0, n] = f._mixture.state_table(f.dim_x)
    fields = {name: out[name][0] for name in (*FOUND, *(["table"] if states else []))}
    return Trajectory(fields, {}, f._mixture, f._before), taken
