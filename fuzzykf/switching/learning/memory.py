"""How much memory learning takes, so that what no machine holds is refused before it is asked for."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.switching.learning.data import TrainingData

__all__ = ["check_memory", "installed_memory", "memory_of_fuzzy", "memory_of_hard"]

#: What a machine is taken to have that does not tell.
USUAL = 1 << 36


def memory_of_hard(K: int, data: TrainingData, form: str) -> int:
    """Return about how many bytes it takes to learn K hard regimes.

    In the regression form most of it are the products of the shares of two pairs of regimes in each
    cell, (c, K^2, K^2), where a pair of regimes is a cell: it grows as K^6.
    """
    rows = data.after.size
    pairs = K * K
    cells = pairs + (pairs if data.r is None else min(rows, pairs))  # those of the prior, and of the data
    return _regression(pairs, cells, data, form) + (_pass(K, data) if data.r is None else 8 * rows * pairs)


def memory_of_fuzzy(M: int, K: int, data: TrainingData, form: str) -> int:
    """Return about how many bytes it takes to learn a fuzzy switch of K classes on M nodes."""
    if data.r is not None:
        return _pass(M, data)  # of the likelihood
    return _regression(K * K, K * K + M * M, data, form) + _pass(M, data)


def _regression(pairs: int, cells: int, data: TrainingData, form: str) -> int:
    if form != "regression":
        return 8 * cells * pairs
    m, d = data.dim_x, data.z.shape[1]
    q = d - m
    common, own = data.window
    further = common + own
    unknowns = pairs * max(m * (m + 2 * q + 1 + further), q * (q + 1 + further))
    return 8 * int(cells * pairs**2 + 2 * unknowns**2 + 3 * cells * (1 + 2 * d + common + 2 * own) ** 2)


def _pass(M: int, data: TrainingData) -> int:
    """Return the bytes of a forward-backward pass: d + 5 numbers a pair of nodes and a row."""
    ends = [*data.starts[1:].tolist(), len(data.z)]
    longest: int = max(end - start for start, end in zip(data.starts.tolist(), ends, strict=True))
    d = int(data.z.shape[1])
    return 8 * longest * M * M * (d + 5)


def installed_memory() -> int:
    """Return how many bytes this machine has, or what machines usually have if it does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # Windows has no sysconf
        return USUAL


def check_memory(name: str, value: int, least: int, needed: Callable[[int], int]) -> None:
    """Raise unless what a number of regimes or nodes takes is there.

    Parameters
    ----------
    name : str
        Of the argument.
    value : int
    least : int
        The smallest number that makes sense.
    needed : callable
        From such a number to bytes; it grows.

    Raises
    ------
    ParameterError
        Names the memory that it takes, that there is, and the largest number that fits.
    """
    there = installed_memory()
    if needed(value) <= there:
        return
    low, high = least, value  # the largest that fits lies in [low, high), if the least fits
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if needed(middle) <= there else (low, middle)
    raise ParameterError(
        f"{name}: got {value}, for which learning takes about {_spoken(needed(value))} of memory, and this "
        f"machine has {_spoken(there)}; expected at most {low}"
    )


def _spoken(size: int) -> str:
    units = ("bytes", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB")
    power = min(max(size.bit_length() - 1, 0) // 10, len(units) - 1)
    return f"{size / 1024**power:,.3g} {units[power]}"
