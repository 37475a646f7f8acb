"""Inputs and features of training data: further regressors of each transition, in standard units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.labels import columns_of, match_columns
from fuzzykf.switching.dynamics.features import WindowFeatures, carried, past_of
from fuzzykf.switching.dynamics.told_inputs import by_name
from fuzzykf.texts import counted, listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Further", "check_unknown", "further_of", "read_inputs"]

#: Standard deviations, in those of the largest value, below which a column counts as constant.
FLAT = 1e-10

#: Variances of what is left of a component below which it follows from the others exactly.
DEPENDENT = 1e-10

#: Standard deviations that can be learned from.
SIZES = (1e-150, 1e150)


class Further(NamedTuple):
    """Regressors beside (1, x, y, y') of T transitions, in standard units; see `WindowFeatures`."""

    features: WindowFeatures
    inputs: tuple[str, ...]  # names of the k inputs
    common: FloatArray  # (T, c), the inputs first
    own_y: FloatArray  # (T, o): of the observation before
    own_next: FloatArray  # (T, o): of the new one
    mean: FloatArray  # (c + o,): that makes the unit of each, with std
    std: FloatArray  # (c + o,)
    raw: FloatArray  # (T, w - q): windows of the placed model, but for the latest observation
    middle: FloatArray  # (k + q,): of inputs and observations, off which factors of products are taken

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
        names = ("common", "own_y", "own_next", "raw")
        return self._replace(**{name: getattr(self, name)[which] for name in names})

    def windows(self, y: FloatArray) -> FloatArray:
        """Return the windows (T, w) of the placed model, in the units of the data; ``y`` (T, q) likewise."""
        return np.concatenate([y, self.raw], axis=1)

    def uncentred(self, slope: FloatArray, level: FloatArray, further: FloatArray) -> None:
        """Turn coefficients of products of what is off the middle into those of the products; in place.

        As (u - a)(y - b) = u y - a y - b u + a b, the others take up the difference.

        Parameters
        ----------
        slope, level, further : ndarray, shapes (..., q), (...,) and (..., c + o)
            Of the observation, 1, and (common, own), in the units of the data.
        """
        if not self.features.products:
            return
        k, q = len(self.inputs), slope.shape[-1]
        a, b = self.middle[:k], self.middle[k:]
        products = further[..., further.shape[-1] - k * q :].reshape(*further.shape[:-1], k, q)
        slope -= np.einsum("...uy,u->...y", products, a)
        further[..., :k] -= np.einsum("...uy,y->...u", products, b)
        level += np.einsum("...uy,u,y->...", products, a, b)


def read_inputs(
    parts: Sequence[Any], lengths: Sequence[int], names: tuple[str, ...] | None = None
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """Return inputs (n, k) of each series, and what they are called: by their columns, or by number.

    Parameters
    ----------
    parts : sequence
        Inputs of each series, (n, k) or (n,); tables go by the names of the first one.
    lengths : sequence of int
        Rows of y in each series.
    names : tuple of str, optional
        Of data that these follow.

    Raises
    ------
    ShapeError, ParameterError
        If there is not a row for each row of y, a name is missing or stands twice, or something is missing:
        inputs are known at all times.
    """
    if len(parts) != len(lengths):
        raise ShapeError(f"inputs: got {len(parts)} series, expected {len(lengths)}, as many as of y")
    called = _names_of(parts) if names is None else names
    found = []
    for k, (part, n) in enumerate(zip(parts, lengths, strict=True)):
        array = as_numbers("inputs", by_name("inputs", part, called or ()))
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
    if called is None:
        called = tuple(f"u{j}" for j in range(widths[0]))
    if len(called) != widths[0]:
        raise ShapeError(
            f"inputs: got {counted(widths[0], 'column')}, expected {len(called)}: {listed(called)}"
        )
    return found, called


def _names_of(parts: Sequence[Any]) -> tuple[str, ...] | None:
    """Return the names of the columns of the first table that has some, or the name of a single one."""
    for part in parts:
        columns = columns_of(part)
        if columns is not None:
            names = tuple(str(one) for one in columns)
            match_columns(names, names, "inputs")  # none stands twice
            return names
    first = parts[0]
    name = getattr(first, "name", None)
    return (name,) if isinstance(name, str) and name and getattr(first, "ndim", 0) == 1 else None


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

    Rows of which earlier observations are missing are not asked for: whatever stands for these is not learned
    from.

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
    q = ys[0].shape[1]
    middle = _middle(ys, us) if earlier is None else earlier.middle
    found: tuple[list[FloatArray], ...] = ([], [], [], [])
    for k, y in enumerate(ys):
        full = carried(y)
        u = np.empty((len(y), 0)) if us is None else us[k]
        lead = np.repeat(full[:1], features.n_past, axis=0)
        past = past_of(full, lead, features.n_past)
        common, before = features.common(past, u), past[:, 0]
        lags = past[:, 1:].reshape(len(y), -1)
        raw = np.concatenate([lags, u, features.own(before, u), features.own(full, u)], axis=1)
        these = common, *(_own_off(features, one, u, middle) for one in (before, full)), raw
        for some, one in zip(found, these, strict=True):
            some.append(one)
    *parts, raw = (np.concatenate(some)[after] for some in found)
    if earlier is not None:
        mean, std = earlier.mean, earlier.std
    else:
        mean, std = _units(parts, features, names, observations, q)
    c = parts[0].shape[1]
    own_y, own_next = ((one - mean[c:]) / std[c:] for one in parts[1:])
    common = (parts[0] - mean[:c]) / std[:c]
    return Further(features, names, common, own_y, own_next, mean, std, raw, middle)


def _middle(ys: Sequence[FloatArray], us: Sequence[FloatArray] | None) -> FloatArray:
    """Return means of inputs and observations, (k + q,)."""
    y = np.concatenate(ys)
    u = np.empty((1, 0)) if us is None else np.concatenate(us)
    return np.concatenate([u.mean(axis=0), y[np.isfinite(y).all(axis=1)].mean(axis=0)])


def _own_off(features: WindowFeatures, y: FloatArray, u: FloatArray, middle: FloatArray) -> FloatArray:
    """Return own(y, u), but products of what is off the middle: of other units they are the same.

    A product of numbers far from zero is nearly a multiple of one of them, and a ridge would not let it tell
    more than that.
    """
    if not features.products:
        return features.own(y, u)
    k, n = u.shape[1], features.n_hinges * y.shape[1]
    hinges = features.own(y, u)[:, :n]
    return np.concatenate([hinges, features.own(y - middle[k:], u - middle[:k])[:, n:]], axis=1)


def _units(
    parts: Sequence[FloatArray],
    features: WindowFeatures,
    inputs: tuple[str, ...],
    observations: Sequence[str] | None,
    q: int,
) -> tuple[FloatArray, FloatArray]:
    """Means and standard deviations of each column; raises if one is constant, or out of range."""
    columns = [*parts[0].T, *np.concatenate([parts[1], parts[2]]).T]
    called = observations or [f"y[{k}]" for k in range(q)]
    names = [one for part in features.names(called, inputs) for one in part]
    mean, std = np.empty(len(names)), np.empty(len(names))
    for k, (column, name) in enumerate(zip(columns, names, strict=True)):
        size = max(float(np.abs(column).max(initial=0.0)), np.finfo(np.float64).tiny)
        unit = column / size  # squares of the numbers themselves may leave the range
        mean[k], std[k] = size * unit.mean(), size * unit.std()
        argument = "inputs" if k < len(inputs) else "features"
        if not unit.std() > FLAT:
            raise ParameterError(
                f"{argument}: {name!r} is constant ({mean[k]:.6g}), which nothing can be learned from; "
                "expected it to vary"
            )
        low, high = SIZES
        if not low < std[k] < high:
            raise ParameterError(
                f"{argument}: {name!r} has a standard deviation of {std[k]:.2g}, expected one between "
                f"{low:g} and {high:g}; use other units"
            )
    return mean, std


def check_unknown(further: Further, before: FloatArray, after: FloatArray, m: int, *, feedback: bool) -> None:
    """Raise if inputs and features leave nothing unknown of an observation or a state that is measured.

    Parameters
    ----------
    further : Further
        Of T transitions.
    before, after : ndarray, shape (T, d)
        (X, Y) in standard units, NaN where missing.
    m : int
        Components of the state.
    feedback : bool
        Whether the state depends on the one before.

    Raises
    ------
    ParameterError
        If a component, or a combination of some, follows from what is known without noise.
    """
    x, y, x1, y1 = before[:, :m], before[:, m:], after[:, :m], after[:, m:]
    one = np.ones((len(y), 1))
    regressors_x = [one, *([x] if feedback else []), y, y1, further.common, further.own_next]
    for name, target, regressors in (
        ("y", y1, [one, y, further.common, further.own_y]),
        ("x", x1, regressors_x),
    ):
        A = np.concatenate(regressors, axis=1)
        rows = np.isfinite(A).all(axis=1) & np.isfinite(target).all(axis=1)
        if rows.sum() < 2 * A.shape[1]:  # so few rows can always be explained
            continue
        residual = target[rows] - A[rows] @ np.linalg.lstsq(A[rows], target[rows], rcond=None)[0]
        if np.linalg.eigvalsh(residual.T @ residual / len(residual))[0] < DEPENDENT:
            raise ParameterError(
                f"inputs, features: from them {name} of the same row follows without noise; expected inputs "
                "that do not hold it"
            )
