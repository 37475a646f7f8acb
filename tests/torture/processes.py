"""Run a part in a process of its own.

Not in the script itself: what a process starts with has to be found by the name of a module.
"""

from __future__ import annotations

import faulthandler
import importlib
import multiprocessing
import multiprocessing.connection

from report import Report

__all__ = ["tried"]

#: A part that takes longer than this, in seconds, hangs.
PATIENCE = 7200.0


def work(part: str, share: float, seed: int, results: multiprocessing.connection.Connection) -> None:
    """Run a part in this process and send its report."""
    faulthandler.enable()
    results.send(importlib.import_module(part).run(share, seed))


def tried(part: str, share: float, seed: int) -> Report:
    """Run a part in a process of its own."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(part, share, seed, there))
    process.start()
    there.close()
    try:
        if here.poll(PATIENCE):
            return here.recv()
        return Report("did not end", faults=[f"{part}: nothing after {PATIENCE:.0f} s"])
    except EOFError:
        process.join()
        return Report("did not end", faults=[f"{part}: the process ended with code {process.exitcode}"])
    finally:
        process.kill()
        process.join()
