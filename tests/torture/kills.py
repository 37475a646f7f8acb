"""Writers that are killed at random moments: what they write is the old file or the new one, never a part."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from report import Report
from systems import KINDS

from fuzzykf import CGOFMSModel, CGOMSMFilter, OFSRFilter
from fuzzykf.cli.app import app
from fuzzykf.files import PART
from fuzzykf.io import load_filter, load_model

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["run"]

KILLS = 500

#: Rows of the table that the command line filters.
ROWS = 300


@dataclass(frozen=True)
class Writer:
    """What writes a file, and what reads it.

    Attributes
    ----------
    name : str
        Of the file.
    write : callable
        Takes a path, and 0 or 1: which of two contents.
    read : callable
        Raises where the file is not whole.
    """

    name: str
    write: Callable[[Path, int], None]
    read: Callable[[Path], object]


# --------------------------------------------------------------------------- writers


def filters() -> list[CGOMSMFilter | OFSRFilter]:
    """Make two filters of unlike size and kind, each with a state."""
    made = [KINDS[kind](*size, np.random.default_rng(0)).make() for kind, size in (("hard", (1, 1)), FUZZY)]
    for f in made:
        for _ in range(3):
            f.step(np.full(f.dim_z, 0.3))
    return made


FUZZY = ("fuzzy, FMC2", (4, 2))


def command(*arguments: object) -> None:
    """Run the command line in this process, in silence."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        app([*map(str, arguments)], standalone_mode=False)


def read_table(path: Path) -> None:
    """Read a table whose every line, the last one included, has all its cells."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    if not text.endswith("\n") or len(lines) != ROWS + 1 or len({line.count(",") for line in lines}) != 1:
        raise ValueError(f"{len(lines)} lines, {len(text)} characters")


def writers(folder: Path) -> list[Writer]:
    """Make every kind of writer; what they need stands in a folder."""
    kept = filters()
    models = [f.model for f in kept]
    small = KINDS["fuzzy, FMC1"](1, 1, np.random.default_rng(0)).make().model
    assert isinstance(small, CGOFMSModel)
    small.save(folder / "model.json")
    data = folder / "data.csv"
    rows = small.simulate(ROWS, np.random.default_rng(1)).y[:, 0]
    data.write_text("reading\n" + "".join(f"{value!r}\n" for value in rows.tolist()), encoding="utf-8")

    def estimate(path: Path, which: int) -> None:
        options = ("--obs", "reading", "--nodes", 1 + 4 * which, "-o", path)
        command("filter", folder / "model.json", data, *options)

    def simulate(path: Path, which: int) -> None:
        command("simulate", folder / "model.json", "-n", ROWS, "--seed", which, "-o", path)

    return [
        Writer("filter.json", lambda path, which: kept[which].save(path), load_filter),
        Writer("model.json", lambda path, which: models[which].save(path), load_model),
        Writer("filtered.csv", estimate, read_table),
        Writer("simulated.csv", simulate, read_table),
    ]


# --------------------------------------------------------------------------- kills


def killed(writer: Writer, path: Path, seconds: float) -> None:
    """Let a process write one content after the other, and kill it after so many seconds."""
    begun, begins = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(begins, b".")
            for n in count():
                writer.write(path, n % 2)
        finally:
            os._exit(1)
    os.read(begun, 1)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    os.close(begun)
    os.close(begins)
    if not os.WIFSIGNALED(status):
        raise RuntimeError(f"{writer.name}: the writer ended by itself")


def duration(writer: Writer, path: Path) -> float:
    """Return how long it takes to write both contents."""
    began = time.perf_counter()
    for which in (0, 1):
        writer.write(path, which)
    return time.perf_counter() - began


def left(folder: Path) -> list[str]:
    """Return what writers who were killed have left."""
    return sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(PART))


def tried(
    writer: Writer, folder: Path, kills: int, rng: np.random.Generator
) -> tuple[Counter[str], list[str]]:
    """Kill the writer of one file again and again, and look at the file after each."""
    path, figures, faults = folder / writer.name, Counter[str](), list[str]()
    whole = []
    longest = duration(writer, path)
    for which in (0, 1):
        writer.write(path, which)
        whole.append(path.read_bytes())
    for n in range(kills):
        if n % 5 == 0:
            path.unlink()  # or nothing is there before
        killed(writer, path, float(rng.uniform(0.0, longest)))
        figures["in the middle of a file"] += bool(left(folder))
        if path.exists():
            if path.read_bytes() not in whole:
                faults.append(f"{writer.name}, kill {n}: the file is neither the old one nor the new one")
            try:
                writer.read(path)
            except Exception as error:
                faults.append(f"{writer.name}, kill {n}: {type(error).__name__}: {error}")
        elif n % 5:
            faults.append(f"{writer.name}, kill {n}: the file has gone")
        if n % 3 == 0:  # else rests of several pile up
            writer.write(path, n % 2)
            faults += [f"{writer.name}, kill {n}: {name} is left" for name in left(folder)]
        elif not path.exists():
            writer.write(path, 0)
    writer.write(path, 0)
    faults += [f"{writer.name}: {name} is left" for name in left(folder)]
    return figures, faults


def run(share: float, seed: int) -> Report:
    """Kill writers of every kind."""
    if not hasattr(os, "fork"):
        return Report("no kills without fork", {"kills": 0})
    rng = np.random.default_rng(seed)
    figures, faults = Counter[str](), list[str]()
    with tempfile.TemporaryDirectory() as sources:
        kinds = writers(Path(sources))
        each = max(2, round(KILLS * share / len(kinds)))
        for writer in kinds:
            with tempfile.TemporaryDirectory() as folder:
                found, wrong = tried(writer, Path(folder), each, rng)
            figures += found
            faults += wrong
    return Report(
        "writers that are killed",
        {"kills": each * len(kinds), "kinds of files": len(kinds), **figures},
        faults,
    )
