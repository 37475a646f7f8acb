"""Work in processes of their own, each with an engine of its own: the engine is chosen once for a process."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["engines", "on_engine"]

T = TypeVar("T")


def choose(name: str) -> None:
    """Choose the engine of this process before it imports any: "numpy", or a set of instructions."""
    os.environ["FUZZYKF_ENGINE"] = "numpy" if name == "numpy" else "compiled"
    if name != "numpy":
        from fuzzykf.engine.compiled import processor

        processor.use_instructions(name)


def engines() -> tuple[str, ...]:
    """Return NumPy and every set of instructions that this processor can run, the best one last."""
    try:
        from fuzzykf.engine.compiled import processor
    except ImportError:
        return ("numpy",)
    return ("numpy", *processor.available_instructions())


def on_engine(name: str, work: Callable[..., T], *arguments: object) -> T:
    """Call a function in a new process that uses this engine, and return what it returns."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=choose, initargs=(name,)) as pool:
        return pool.submit(work, *arguments).result()
