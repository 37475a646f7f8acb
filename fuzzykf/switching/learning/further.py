"""Inputs and features of training data: further regressors of each transition, in standard units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.labels import columns_of
from fuzzykf.switching.dynamics.features import WindowFeatures, carried, past_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Further", "further_of", "input_names", "read_inputs"]

#: Standard deviations, in those of the largest value, below which a column counts as constant.
FLAT = 1e-10


class Further(NamedTuple):
    """Regressors beside (1, x, y, y') of T transitions, in standard units; see `WindowFeatures`."""

    features: WindowFeatures
    inputs: tuple[str, ...]  # names of the k inputs
    common: FloatArray  # (T, c), the inputs first
    own_y: FloatArray  # (T, o): of the observation before
    own_next: FloatArray  # (T, o): of the new one
    mean: FloatArray  # (c + o,): that makes the unit of each, with std
    std: FloatArray  # (c + o,)

    @property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three parts."""
        return self.common, self.own_y, self.own_next

    @property
    def sizes(self) -> tuple[int, int]:
        """How many numbers ``common`` and ``own`` have."""
        return self.common.shape[1], self.own_y.shape[1]

    @property
    def us(self) -> FloatArray:
        """The inputs in standard units, (T, k)."""
        return self.common[:, : len(self.inputs)]

    def rows(self, which: BoolArray) -> Further:
        """Return those of some transitions."""
        return self._replace(
            common=self.common[which], own_y=self.own_y[which], own_next=self.own_next[which]
        )

    def windows(self, y: FloatArray) -> FloatArray:
        """Return the windows (T, w) of the placed model, in the units of the data; ``y`` (T, q) likewise."""
        c = self.common.shape[1]
        common = self.common * self.std[:c] + self.mean[:c]
        own = (one * self.std[c:] + self.mean[c:] for one in (self.own_y, self.own_next))
        return np.concatenate([y, common, *own], axis=1)


def read_inputs(inputs: Any, lengths: Sequence[int]) -> list[FloatArray]:
    """Return inputs (n, k) of each series.

    Raises
    ------
    ShapeError, ParameterError
        If there is not a row for each row of y, or something is missing: inputs are known at all times.
    """
    several = isinstance(inputs, list | tuple) and len(lengths) > 1
    parts = list(inputs) if several else [inputs]
    if len(parts) != len(lengths):
        raise ShapeError(f"inputs: got {len(parts)} series, expected {len(lengths)}, as many as of y")
    found = []
    for k, (part, n) in enumerate(zip(parts, lengths, strict=True)):
        array = as_numbers("inputs", part.to_numpy() if hasattr(part, "to_numpy") else part)
        array = array[:, None] if array.ndim == 1 else array
        if array.ndim != 2 or len(array) != n or array.shape[1] == 0:
            raise ShapeError(
                f"inputs: series {k} has shape {array.shape}, expected ({n}, k), a row for each of y"
            )
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise ParameterError(
                f"inputs: series {k} has {array[row].tolist()} at {row}, expected finite numbers: inputs are "
                "known at all times"
            )
        found.append(array)
    widths = sorted({one.shape[1] for one in found})
    if len(widths) > 1:
        raise ShapeError(f"inputs: got series of {widths} columns, expected as many in each")
    return found


def input_names(inputs: Any, k: int) -> tuple[str, ...]:
    """Return what inputs are called: by their columns, or by number."""
    first = inputs[0] if isinstance(inputs, list | tuple) and len(inputs) else inputs
    names = columns_of(first)
    if names is None and k == 1 and isinstance(getattr(first, "name", None), str):
        names = [first.name]
    return tuple(f"u{j}" for j in range(k)) if names is None else tuple(str(name) for name in names)


def further_of(
    ys: Sequence[FloatArray],
    us: Sequence[FloatArray] | None,
    after: IntArray,
    features: WindowFeatures,
    names: tuple[str, ...],
    observations: Sequence[str] | None,
    earlier: Further | None = None,
) -> Further:
    """Compute inputs and features of transitions.

    In them a missing observation counts as the last one before it: what a filter expects of it, which takes
    its place there later, nobody knows before something was learned.

    Parameters
    ----------
    ys : sequence of ndarray, shape (n, q)
        Of each series, NaN where missing.
    us : sequence of ndarray, shape (n, k), or None
    after : ndarray of int, shape (T,)
        Rows, of all series one after the other, to which the transitions lead.
    features : WindowFeatures
    names : tuple of str
        Of the inputs.
    observations : sequence of str, optional
        Names of the components of y.
    earlier : Further, optional
        Of data that these follow: it has the units.
    """
    if earlier is not None:
        features = earlier.features
    else:
        whole = np.concatenate(ys)
        features = features.learned(whole[np.isfinite(whole).all(axis=1)])
    found: tuple[list[FloatArray], ...] = ([], [], [])
    for k, y in enumerate(ys):
        full = carried(y)
        u = np.empty((len(y), 0)) if us is None else us[k]
        lead = np.repeat(full[:1], features.n_past, axis=0)
        past = past_of(full, lead, features.n_past)
        these = features.common(past, u), features.own(past[:, 0], u), features.own(full, u)
        for some, one in zip(found, these, strict=True):
            some.append(one)
    parts = [np.concatenate(some)[after] for some in found]
    if earlier is not None:
        mean, std = earlier.mean, earlier.std
    else:
        mean, std = _units(parts, features, names, observations, ys[0].shape[1])
    c = parts[0].shape[1]
    own_y, own_next = ((one - mean[c:]) / std[c:] for one in parts[1:])
    return Further(features, names, (parts[0] - mean[:c]) / std[:c], own_y, own_next, mean, std)


def _units(
    parts: Sequence[FloatArray],
    features: WindowFeatures,
    inputs: tuple[str, ...],
    observations: Sequence[str] | None,
    q: int,
) -> tuple[FloatArray, FloatArray]:
    """Means and standard deviations of each column; raises if one is constant."""
    both = np.concatenate([parts[1], parts[2]])
    mean = np.concatenate([parts[0].mean(axis=0), both.mean(axis=0)])
    std = np.concatenate([parts[0].std(axis=0), both.std(axis=0)])
    size = np.concatenate([np.abs(parts[0]).max(axis=0, initial=0.0), np.abs(both).max(axis=0, initial=0.0)])
    flat = np.flatnonzero(~(std > FLAT * size))
    if flat.size:
        called = observations or [f"y[{k}]" for k in range(q)]
        name = [one for part in features.names(called, inputs) for one in part][int(flat[0])]
        argument = "inputs" if flat[0] < len(inputs) else "features"
        raise ParameterError(f"{argument}: {name!r} is constant, which nothing can be learned from")
    return mean, std
