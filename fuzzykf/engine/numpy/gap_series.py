"""Whole series in which something is missing, filtered and summarised; NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from fuzzykf.engine.numpy.gaps import before_step, first_step_in_part, step_in_part
from fuzzykf.engine.numpy.outliers import FARTHEST
from fuzzykf.engine.numpy.series import filter_series, state_table, summarise
from fuzzykf.engine.numpy.switching import is_in_range

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.engine.numpy.gaps import Branches, GapTables
    from fuzzykf.engine.numpy.tables import Kernel, Summary

__all__ = ["GapState", "filter_gappy", "fit_together"]


class GapState(NamedTuple):
    """What is known of the nodes, whether something of the window is unknown or nothing."""

    table: FloatArray  # (1 + e + e*e, M)
    root: FloatArray | None  # (M, e, e); None where nothing is unknown
    branches: Branches | None


def fit_together(gaps: GapTables, kernel: Kernel) -> bool:
    """Whether `filter_gappy` takes these tables: of one engine, and without negative weights."""
    return kernel.sign is None


def filter_gappy(
    gaps: GapTables,
    kernel: Kernel,
    summary: Summary,
    begin: tuple[FloatArray, ...] | GapState,
    ys: FloatArray,
    start: int,
    stop: int,
    out: dict[str, FloatArray],
    mass: FloatArray | None = None,
    kept: dict[int, GapState] | None = None,
) -> tuple[FloatArray, FloatArray, IntArray, tuple[GapState, GapState]]:
    """Filter observations start, ..., stop - 1, NaN where missing, of each series with constant tables.

    Parameters
    ----------
    gaps : GapTables
    kernel, summary, ys, start, stop, out, mass
        As in `filter_series`, of chains without negative weights.
    begin : tuple or GapState
        If start is 0, as in `filter_series`; else the tables (s, 1 + m + m*m, M) of series whose windows
        are complete, or the state of a single one.
    kept : dict, optional
        Gets the states of the last series after which something is unknown, by the number of the observation.

    Returns
    -------
    before, last : ndarray, shape (s, 1 + m + m*m, M)
        The states after the last two observations, of X alone; the last one twice where there is one alone.
    reached : ndarray of int, shape (s,)
        How far each series came: an engine may stop before an observation that is for `step_in_part`,
        and what it returns is then of the observations before that; and it stops after a first observation
        in part that leaves the range of numbers, the states being NaN.
    states : tuple of GapState
        The last two states of the last series.
    """
    _, _, m, q = kernel.shape
    order, switch = (kernel.rows.shape[1] - 1 - q) // q, summary.switch
    there = np.asarray(~np.isnan(ys).any(axis=2))
    befores, lasts, reached = [], [], []
    law = cast("tuple[FloatArray | None, ...]", begin)
    old = now = GapState(np.empty(0), None, None)
    for a, series in enumerate(ys):
        part = {name: values[a : a + 1] for name, values in out.items()}
        k, end_at = start, stop
        if start == 0 and not there[a, 0]:
            now, value = first_in_part(law, series[0])
            if kept is not None:
                kept[0] = now
            k, end_at = 1, 1 if np.isnan(value) else stop
            states = state_table(now.table, m)[None, None]
            summarise(part, slice(0, 1), states, None, np.array([[value]]), switch)
        elif start == 0:
            _, first = filter_series(kernel, summary, law, ys[a : a + 1], 0, 1, part)
            now, k = GapState(first[0], None, None), 1
        else:
            now = begin if isinstance(begin, GapState) else GapState(begin[0][a], None, None)
        old = now
        while k < end_at:
            window = series[k - order : k][::-1].ravel()
            if there[a, k] and not np.isnan(window).any():
                end = k + int(np.argmin(np.append(there[a, k:stop], False)))
                found = filter_series(kernel, summary, (now.table[None], None), ys[a : a + 1], k, end, part)
                old, now = (GapState(one[0], None, None) for one in found)
                k = end
                continue
            if "x_prior" in part or "P_prior" in part:
                _, x, P = before_step(gaps.step, now.table, None, window)
                for name, moment in (("x_prior", x[:m]), ("P_prior", P[:m, :m])):
                    if name in part:
                        part[name][0, k] = moment
            after = np.concatenate([series[k], window])[: window.size]
            table, _, root, branches, value = step_in_part(
                gaps, now.table, None, window, now.root, series[k], after, now.branches
            )
            old, now = now, GapState(table, root if np.isnan(after).any() else None, branches)
            states = state_table(table, m)[None, None]
            summarise(part, slice(k, k + 1), states, None, np.array([[value]]), switch)
            if kept is not None and now.root is not None:
                kept[k] = now
            k += 1
        befores.append(state_table(old.table, m))
        lasts.append(state_table(now.table, m))
        reached.append(k)
    return np.array(befores), np.array(lasts), np.array(reached), (old, now)


def first_in_part(law: tuple[FloatArray | None, ...], y: FloatArray) -> tuple[GapState, float]:
    """Condition the law of (r_1, Z_1) on what is there of y_1 (q,); NaN if it is too far off for numbers."""
    log_initial, mean, covariance = cast("tuple[FloatArray, ...]", law[:3])
    table, root, value = first_step_in_part(log_initial, mean, covariance, y)
    if not (value > FARTHEST and is_in_range(table)):
        return GapState(np.full_like(table, np.nan), root, None), np.nan
    return GapState(table, root, None), value
