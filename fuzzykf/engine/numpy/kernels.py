"""(min,+) and related convolutions along lines with a tabulated kernel.

For every line l and target i, the source j with the least combine(cost[l, j], table[i, j]);
combine is addition for costs, multiplication for reciprocal memberships (the lower
envelope of the parabolas of untruncated Cauchy noise), the maximum for the t-norm
min.  Three methods, which give the same minima:

- `convolve_table` tries every source: the twin by which the others are tested;
- `convolve_convex` divides and conquers where the kernel is convex, since the best
  source then moves monotonically with the target;
- `convolve_bounded` discards whole blocks of sources by a bound, for any kernel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fuzzykf.arrays import FloatArray, IntArray

__all__ = [
    "convolve_bounded",
    "convolve_convex",
    "convolve_joint",
    "convolve_table",
    "is_convex",
    "totals",
]


#: Elements worked on at a time: the temporaries then stay in the cache.
CHUNK = 1 << 16

#: Sources in a block of `convolve_bounded`.
BLOCK = 32


def convolve_table(cost: FloatArray, table: FloatArray, combine: np.ufunc = np.add) -> IntArray:
    """Find the best source of each target by trying them all.

    Parameters
    ----------
    cost : ndarray, shape (lines, n)
        Infinite where impossible.
    table : ndarray, shape (targets, n)
        Cost of the kernel from source j to target i.
    combine : ufunc
        ``np.add``, ``np.multiply`` or ``np.maximum``.

    Returns
    -------
    ndarray of int, shape (lines, targets)
        The first of the best sources; anything where none is possible.
    """
    source = np.empty((cost.shape[0], table.shape[0]), dtype=np.intp)
    total = np.empty(table.shape)
    for k, line in enumerate(cost):
        combine(table, line, out=total)
        total.argmin(axis=1, out=source[k])
    return source


def convolve_convex(cost: FloatArray, table: FloatArray) -> IntArray:
    """Find the best source of each target for a convex kernel, by divide and conquer.

    With table[i, j] = k(x_i - y_j), k convex where it is finite, and finite on an
    interval, the matrix of totals is totally monotone: the best source does not move
    back when the target moves on.  The middle target therefore bounds the search for
    those on either side; all targets of one depth are searched at once.

    Parameters and result are those of `convolve_table` with ``np.add``.
    """
    n = cost.shape[1]
    table = np.ascontiguousarray(table)
    possible = np.isfinite(table)
    first = possible.argmax(axis=1)
    last = np.where(possible.any(axis=1), n - 1 - possible[:, ::-1].argmax(axis=1), -1)
    source = np.zeros((cost.shape[0], table.shape[0]), dtype=np.intp)
    block = max(1, CHUNK // n)
    for start in range(0, cost.shape[0], block):
        _divide(cost[start : start + block], table, first, last, source[start : start + block])
    return source


def _divide(cost: FloatArray, table: FloatArray, first: IntArray, last: IntArray, source: IntArray) -> None:
    """Fill ``source`` for a few lines, from the coarse targets to the fine ones."""
    (lines, n), m = cost.shape, table.shape[0]
    # Column 0 stands for the target before the first, the last for all beyond.
    lowest = np.zeros((lines, m + 2), dtype=np.intp)
    highest = np.full((lines, m + 2), n - 1, dtype=np.intp)
    stride = 1 << max(0, m - 1).bit_length()
    while stride:
        rows = np.arange(stride - 1, m, 2 * stride)
        before = lowest[:, rows + 1 - stride]
        after = highest[:, np.minimum(rows + 1 + stride, m + 1)]
        low = np.maximum(before, first[rows])
        high = np.minimum(after, last[rows])
        best, found = _search(cost, table, rows, low, high)
        source[:, rows] = best
        # A target without any possible source rules out all that it reaches, for its neighbours too.
        within = last[rows] >= 0
        none_low = np.where(within, np.maximum(before, last[rows] + 1), before)
        none_high = np.where(within, np.minimum(after, first[rows] - 1), after)
        lowest[:, rows + 1] = np.where(found, best, none_low)
        highest[:, rows + 1] = np.where(found, best, none_high)
        stride //= 2


def _search(
    cost: FloatArray, table: FloatArray, rows: IntArray, low: IntArray, high: IntArray
) -> tuple[IntArray, NDArray[np.bool_]]:
    """First best source between ``low`` and ``high`` for each (line, row), and whether there is one."""
    n = cost.shape[1]
    best = np.zeros(low.size, dtype=np.intp)
    found = np.zeros(low.size, dtype=bool)
    length = np.maximum(high - low + 1, 0).ravel()
    cells = np.flatnonzero(length)
    if cells.size:
        length = length[cells]
        begin = np.concatenate(([0], np.cumsum(length)[:-1]))
        line, row = np.divmod(cells, rows.size)
        step = np.arange(length.sum()) - np.repeat(begin, length)
        total = cost.ravel().take(step + np.repeat(line * n + low.ravel()[cells], length))
        total += table.ravel().take(step + np.repeat(rows[row] * n + low.ravel()[cells], length))
        least = np.minimum.reduceat(total, begin)
        hits = np.flatnonzero(total == np.repeat(least, length))
        owner = np.searchsorted(begin, hits, side="right") - 1
        best[cells[owner[::-1]]] = (low.ravel()[cells[owner]] + step[hits])[::-1]
        found[cells] = np.isfinite(least)
    return best.reshape(low.shape), found.reshape(low.shape)


def convolve_bounded(cost: FloatArray, table: FloatArray, combine: np.ufunc = np.add) -> IntArray:
    """Find the best source of each target for any kernel, by bounds on blocks of sources.

    The least cost and the least kernel of a block bound its totals from below, one of
    its totals from above; only blocks that may hold the best source are searched.

    Parameters and result are those of `convolve_table`.
    """
    (lines, n), m = cost.shape, table.shape[0]
    blocks = -(-n // BLOCK)
    padding = ((0, 0), (0, blocks * BLOCK - n))
    cost = np.pad(cost, padding, constant_values=np.inf)
    table = np.pad(table, padding, constant_values=np.inf)
    targets, table_blocks = np.arange(m), table.reshape(m, blocks, BLOCK)
    kernel_least = table_blocks.min(axis=2)
    cost_least = cost.reshape(lines, blocks, BLOCK).min(axis=2)
    source = np.empty((lines, m), dtype=np.intp)
    guess = table.argmin(axis=1)
    for k, line in enumerate(cost):
        # Neighbouring lines are alike: the sources of the last one are a good guess.
        upper = combine(table[targets, guess], line[guess])
        row, block = np.nonzero(combine(kernel_least, cost_least[k]) < upper[:, None])
        if row.size * BLOCK > 0.3 * table.size:
            guess = combine(table, line).argmin(axis=1)  # the bounds discard too little here
        elif row.size:
            line_blocks = line.reshape(blocks, BLOCK)
            total = combine(table_blocks[row, block], line_blocks[block])
            least = total.min(axis=1)
            begin = np.flatnonzero(np.diff(row, prepend=-1))
            lowest = np.minimum.reduceat(least, begin)
            winner = np.flatnonzero(np.repeat(lowest, np.diff(begin, append=row.size)) == least)
            winner = winner[least[winner] < upper[row[winner]]]
            guess = guess.copy()
            guess[row[winner]] = block[winner] * BLOCK + total[winner].argmin(axis=1)
        source[k] = guess
    return source


def totals(
    cost: FloatArray, table: FloatArray, source: IntArray, shift: int, combine: np.ufunc = np.add
) -> FloatArray:
    """Total of the source ``shift`` places from the given one; infinite beyond the ends."""
    n = cost.shape[1]
    neighbour = source + shift
    clipped = np.clip(neighbour, 0, n - 1)
    total: FloatArray = combine(
        np.take_along_axis(cost, clipped, axis=1), table[np.arange(table.shape[0]), clipped]
    )
    return np.where(neighbour == clipped, total, np.inf)


def is_convex(table: FloatArray) -> bool:
    """Whether every row of a table is convex where it is finite, and finite on an interval.

    For equidistant sources that is the condition of `convolve_convex`.
    """
    finite = np.isfinite(table)
    gaps = np.diff(finite.astype(np.int8), axis=1, prepend=0, append=0)
    if (np.abs(gaps).sum(axis=1) > 2).any():
        return False
    with np.errstate(invalid="ignore"):
        bend = table[:, 2:] - 2.0 * table[:, 1:-1] + table[:, :-2]
        size = np.abs(table[:, 1:-1])
    return not (bend < -1e-12 * (1.0 + size)).any()


def convolve_joint(
    cost: FloatArray, kernel: FloatArray, center: tuple[int, ...], combine: np.ufunc = np.add
) -> FloatArray:
    """Convolve a lattice with a kernel on the same lattice, offset by offset.

    Parameters
    ----------
    cost : ndarray, shape (n_1, ..., n_d)
    kernel : ndarray, shape (k_1, ..., k_d)
        Cost of each offset; infinite offsets are skipped.
    center : tuple of int
        Index of the offset zero.

    Returns
    -------
    ndarray, shape (n_1, ..., n_d)
    """
    out = np.full(cost.shape, np.inf)
    for index in np.argwhere(np.isfinite(kernel)):
        shifts = [int(i) - c for i, c in zip(index, center, strict=True)]
        if any(abs(s) >= n for s, n in zip(shifts, cost.shape, strict=True)):
            continue
        to = tuple(slice(max(s, 0), n + min(s, 0)) for s, n in zip(shifts, cost.shape, strict=True))
        from_ = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(shifts, cost.shape, strict=True))
        np.minimum(out[to], combine(cost[from_], kernel[tuple(index)]), out=out[to])
    return out
