"""Threads that build and use filters of the same models, and forks among them.

The harness sets OPENBLAS_NUM_THREADS=1: a fork while another thread is in OpenBLAS may hang in its
own code to do with forks, about once in 400 times, which no user of it can help.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from report import Report
from systems import KINDS, System, system

from fuzzykf import FuzzyMarkovLaw

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["run"]

ROUNDS, FORKS, MANY = 200, 500, 40

#: More than there are processors, so that threads are interrupted at every place.
THREADS = 16

LENGTH, SERIES = 40, 37

#: A child that has not ended after so many seconds hangs.
PATIENCE = 60.0

#: Threads change so often, in seconds, rather than every 5 ms.
SWITCHES = 1e-5

#: Signed weights may be refused, as too coarse for what is drawn here.
UNSIGNED = [kind for kind in KINDS if "signed" not in kind]

Trace = dict[str, np.ndarray]


def streamed(made: System, zs: np.ndarray) -> Trace:
    """Build a filter, step it along a series, and return what it shows and what `filter` and a copy say."""
    f, told = made.make(), made.switches(len(zs))
    for k, z in enumerate(zs):
        f.step(z, *(value[k] for value in told.values()))
    result = made.make().filter(zs, **told)
    return {"x": np.array(f.x), "P": np.array(f.P), "xs": result.x, "copied": np.array(f.copy().x)}


def together(works: list[Callable[[], Trace]]) -> list[Trace]:
    """Do all works at once, each in a thread; they begin at the same moment."""
    barrier = threading.Barrier(len(works))

    def begin(work: Callable[[], Trace]) -> Trace:
        barrier.wait()
        return work()

    with ThreadPoolExecutor(len(works)) as pool:
        return list(pool.map(begin, works))


def differing(found: Trace, expected: Trace) -> list[str]:
    """Return the names of what is not the same to the bit."""
    return [name for name, value in expected.items() if not np.array_equal(found[name], value)]


# --------------------------------------------------------------------------- filters of one model


def shared_models(rounds: int, seed: int) -> list[str]:
    """Use one model, newly built each time, from many threads that build filters of it."""
    faults, kinds = [], UNSIGNED
    for n in range(rounds):
        kind, size = kinds[n % len(kinds)], (2, 1)
        rng = np.random.default_rng([seed, n])
        series = rng.normal(size=(THREADS, LENGTH, 1))
        # what is computed once is computed here first
        alone = KINDS[kind](*size, np.random.default_rng([seed, n]))
        expected = [streamed(alone, zs) for zs in series]
        made = KINDS[kind](*size, np.random.default_rng([seed, n]))
        found = together([lambda made=made, zs=zs: streamed(made, zs) for zs in series])
        for thread, (one, other) in enumerate(zip(found, expected, strict=True)):
            faults += [f"{kind}, round {n}, thread {thread}: {name}" for name in differing(one, other)]
    return faults


def shared_laws(rounds: int) -> list[str]:
    """Discretise one law from many threads, with as many nodes as the thread has for a number."""

    def nodes(law: FuzzyMarkovLaw, number: int) -> Trace:
        chain = law.discretize(number)
        return {"transition": chain.transition, "initial": chain.initial, "p_hard": np.array(law.p_hard)}

    faults = []
    for n in range(rounds):
        alone, shared = (FuzzyMarkovLaw.fmc2(0.1 + 1e-4 * n, 0.5, 0.17) for _ in range(2))
        expected = [nodes(alone, k % 5) for k in range(THREADS)]
        found = together([lambda law=shared, k=k: nodes(law, k % 5) for k in range(THREADS)])
        for one, other in zip(found, expected, strict=True):
            faults += [f"law, round {n}: {name}" for name in differing(one, other)]
    return faults


def shared_series(rounds: int, seed: int) -> list[str]:
    """Filter many series by one filter, with 1, 2, ... threads of its own and from threads at once."""
    faults = []
    kinds = [kind for kind in UNSIGNED if kind.startswith(("fuzzy", "hard", "state"))]
    for n in range(rounds):
        kind = kinds[n % len(kinds)]
        f = system(kind, (2, 1), seed).make()
        series = np.random.default_rng([seed, n]).normal(size=(SERIES, LENGTH, 1))

        def filtered(threads: int, f: Any = f, series: np.ndarray = series) -> Trace:
            result = f.filter_many(series, keep=("x", "P", "log_likelihood"), threads=threads)
            return {"x": result.x, "P": result.P, "log_likelihood": result.log_likelihood}

        expected = filtered(1)
        for threads in (2, 3, 7, THREADS, SERIES + 1):
            names = differing(filtered(threads), expected)
            faults += [f"{kind}, filter_many with {threads} threads: {name}" for name in names]
        found = together([lambda k=k, filtered=filtered: filtered(1 + k % 3) for k in range(THREADS // 2)])
        faults += [
            f"{kind}, filter_many in threads: {name}" for one in found for name in differing(one, expected)
        ]
    return faults


# --------------------------------------------------------------------------- forks


def ends(child: int) -> bool:
    """Wait until a child has ended well; one that hangs is ended."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status == 0
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def forked(forks: int, seed: int) -> list[str]:
    """Fork while other threads build filters, and build and step one in the child."""
    faults, stop, kinds = [], threading.Event(), UNSIGNED
    zs = np.random.default_rng(seed).normal(size=(5, 1))

    def build(number: int) -> None:
        n = 0
        while not stop.is_set():
            streamed(KINDS[kinds[n % len(kinds)]](1, 1, np.random.default_rng([number, n])), zs)
            n += 1

    builders = [threading.Thread(target=build, args=(number,)) for number in range(4)]
    for one in builders:
        one.start()
    for n in range(forks):
        kind = kinds[n % len(kinds)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12: of threads and forks
            child = os.fork()
        if child == 0:
            try:
                streamed(KINDS[kind](1, 1, np.random.default_rng(n)), zs)
                os._exit(0)
            finally:
                os._exit(1)
        if not ends(child):
            faults.append(f"fork {n}, {kind}: the child did not end well")
    stop.set()
    for one in builders:
        one.join()
    return faults


def run(share: float, seed: int) -> Report:
    """Use filters from many threads, and fork among them."""
    rounds, many = (max(len(KINDS), round(number * share)) for number in (ROUNDS, MANY))
    forks = max(10, round(FORKS * share)) if hasattr(os, "fork") else 0
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCHES)
    try:
        faults = shared_models(rounds, seed) + shared_laws(rounds) + shared_series(many, seed)
        faults += forked(forks, seed)
    finally:
        sys.setswitchinterval(before)
    figures = {
        "threads at once": THREADS,
        "models shared": rounds,
        "laws shared": rounds,
        "filter_many shared": many,
        "forks": forks,
    }
    return Report("threads and forks", figures, faults)
