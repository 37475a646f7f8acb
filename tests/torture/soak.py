"""Streams of many millions of observations: filters that run for years neither drift nor grow."""

from __future__ import annotations

import gc
import os
import resource
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from engines import engines, on_engine
from report import Report
from systems import System, system

from fuzzykf.errors import QuadratureError

__all__ = ["run"]

STEPS = 10_000_000

#: Filters that stream, and their sizes.
STREAMS = (
    ("fuzzy, FMC1", (1, 1)),
    ("fuzzy, FMC2", (2, 1)),
    ("fuzzy, free chain", (1, 1)),
    ("fuzzy, signed weights", (1, 1)),
    ("hard", (1, 1)),
    ("hard", (4, 2)),
    ("state space, order 2", (2, 1)),
    ("known switch", (1, 1)),
    ("Kalman", (1, 1)),
    ("Kalman", (4, 2)),
    ("IMM", (2, 1)),
    ("GPB2", (1, 1)),
)

#: Those that step in Python on either engine get so much of their part, and are not run on NumPy again.
IN_PYTHON = {"known switch": 0.02, "GPB2": 0.02}

#: NumPy gets so much of all.
ON_NUMPY = 0.01

#: Observations that are drawn at once.  Memory is looked at after the first block; what is older than
#: the last one is forgotten.
BLOCK = 2_000

#: The same where each step takes long, as on NumPy.
SHORT_BLOCK = 1_000

#: How much the process may grow after its first steps, in bytes.
GROWTH = 8 << 20

SUMS, AGREE = 1e-12, 1e-9


@dataclass
class Streamed:
    """What became of one stream."""

    where: str
    steps: int
    growth: int
    sums: float
    forgotten: float
    series: float
    finite: bool


def shown(f: Any) -> dict[str, np.ndarray]:
    """Copy what users read of a filter."""
    names = ("x", "P", "mu", "log_likelihood")
    return {name: np.array(getattr(f, name), dtype=float) for name in names if hasattr(f, name)}


def apart(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Return how far two filters are from one another, relative to the scale of what they show."""
    differences = (
        np.abs(value - other[name]).max() / max(1.0, np.abs(value).max()) for name, value in one.items()
    )
    return float(max(differences))


def block(seed: int, number: int, size: int, dim_z: int) -> np.ndarray:
    """Draw the observations of one block; a few of the first are missing."""
    zs = np.random.default_rng([seed, number]).normal(size=(size, dim_z))
    zs[100:300:70] = np.nan
    return zs


def told(made: System, begin: int, size: int) -> np.ndarray | None:
    """Return the switches of a block, if they are known."""
    return (np.arange(begin, begin + size) // 3 % 2).astype(float) if made.knows_switch else None


def feed(f: Any, zs: np.ndarray, switches: np.ndarray | None) -> None:
    """Step along a block."""
    if switches is None:
        for z in zs:
            f.step(z)
    else:
        for z, r in zip(zs, switches, strict=True):
            f.step(z, r)


def memory() -> int:
    """Return how much of this process is in memory, in bytes: now, or where that is not told at its most."""
    if os.path.exists("/proc/self/statm"):
        with open("/proc/self/statm", encoding="ascii") as told_by_system:
            return int(told_by_system.read().split()[1]) * resource.getpagesize()
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def stream(kind: str, size: tuple[int, int], steps: int, length: int, seed: int, where: str) -> Streamed:
    """Step a filter for long, and compare it with one that has seen the last observations alone."""
    made = system(kind, size, seed)
    f, finite, before, latest = made.make(), True, 0, np.empty(0)
    blocks = max(2, steps // length)
    for number in range(blocks):
        latest = block(seed, number, length, size[1])
        feed(f, latest, told(made, number * length, length))
        finite &= all(np.isfinite(value).all() for value in shown(f).values())
        if number == 0:
            gc.collect()
            before = memory()
    gc.collect()
    growth = memory() - before
    switches = told(made, (blocks - 1) * length, length)
    fresh, whole = made.make(), made.make()
    feed(fresh, latest, switches)
    whole.filter(latest, **({} if switches is None else {"r": switches}))
    end = shown(f)
    sums = float(abs(end["mu"].sum() - 1.0)) if "mu" in end else 0.0
    forgotten, series = apart(end, shown(fresh)), apart(shown(fresh), shown(whole))
    return Streamed(where, blocks * length, growth, sums, forgotten, series, finite)


def streams(share: float, seed: int, engine: str) -> list[Streamed]:
    """Run all streams on the engine in use."""
    each = STEPS * share * (ON_NUMPY if engine == "numpy" else 1.0) / len(STREAMS)
    found = []
    for kind, size in STREAMS:
        if engine == "numpy" and kind in IN_PYTHON:
            continue
        length = SHORT_BLOCK if engine == "numpy" or kind in IN_PYTHON else BLOCK
        steps = round(each * IN_PYTHON.get(kind, 1.2))
        with suppress(QuadratureError):  # a rule with negative weights that is too coarse for what was drawn
            found.append(stream(kind, size, steps, length, seed, f"{kind} {size}, {engine}"))
    return found


def faults(found: Streamed) -> list[str]:
    """Say what must not be."""
    wrong = {
        "is not finite": not found.finite,
        f"has grown by {found.growth:,} bytes": found.growth > GROWTH,
        f"has probabilities that sum to one but for {found.sums:.3g}": not found.sums <= SUMS,
        f"is {found.forgotten:.3g} off one that saw the latest alone": not found.forgotten <= AGREE,
        f"is {found.series:.3g} off filter() on the series": not found.series <= SUMS,
    }
    return [f"{found.where}, after {found.steps:,} steps: {what}" for what, is_so in wrong.items() if is_so]


def run(share: float, seed: int) -> Report:
    """Stream on NumPy, and on the best set of instructions."""
    used = (engines()[0], engines()[-1])
    found = [one for engine in dict.fromkeys(used) for one in on_engine(engine, streams, share, seed, engine)]
    figures = {
        "steps": f"{sum(one.steps for one in found):,}",
        "streams": len(found),
        "largest growth of memory, bytes": f"{max(one.growth for one in found):,}",
        "largest |sum of probabilities - 1|": f"{max(one.sums for one in found):.2g}",
        "largest difference to one that saw the latest alone": f"{max(one.forgotten for one in found):.2g}",
        "largest difference between step and filter": f"{max(one.series for one in found):.2g}",
    }
    return Report("filters that run for long", figures, [fault for one in found for fault in faults(one)])
