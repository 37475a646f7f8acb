"""Read files that have been tampered with: each is refused in words, or is of use, within a second."""

from __future__ import annotations

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from mutations import changed, reader, things, use
from report import Report

from fuzzykf.errors import FileFormatError, FuzzykfError

__all__ = ["run"]

#: Files of the full run.
FILES = 1500

#: Most seconds that a file may take.
SECONDS = 1.0


def tried(path: Path, thing: object, content: bytes) -> tuple[str, str, float]:
    """Read a file and use what it holds; return how that ended, what is wrong, and how long reading took."""
    path.write_bytes(content)
    start, found = time.process_time(), None
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            found = reader(thing)(path)
        except FileFormatError:
            return "refused", "", time.process_time() - start
        except Exception as error:
            return "wrong", f"{type(error).__name__}: {str(error)[:200]}", time.process_time() - start
        taken = time.process_time() - start
        try:
            with np.errstate(all="ignore"):  # numbers may be too large to go on with
                use(found)
        except FuzzykfError:
            pass
        except Exception as error:
            return "wrong", f"in use: {type(error).__name__}: {str(error)[:200]}", taken
    return "of use", "", taken


def run(share: float, seed: int) -> Report:
    """Tamper with files of every kind."""
    report = Report("files that have been tampered with", {"files": 0, "refused": 0, "of use": 0})
    slowest, specimens = 0.0, things()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file.json")
        texts = {}
        for name, thing in specimens.items():
            thing.save(path)
            texts[name] = path.read_text("utf-8")
        for k in range(round(FILES * share)):
            name = list(specimens)[k % len(specimens)]
            content = changed(texts[name], k // len(specimens), np.random.default_rng([seed, k]))
            how, wrong, taken = tried(path, specimens[name], content)
            report.figures["files"] += 1
            slowest = max(slowest, taken)
            if wrong or taken > SECONDS:
                report.faults.append(f"{name}, seed {seed}, file {k}: {wrong or how} after {taken:.2f} s")
            else:
                report.figures[how] += 1
    report.figures["slowest, in seconds"] = round(slowest, 3)
    return report
