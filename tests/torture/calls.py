"""Call every public verb with arguments of all kinds, on both engines, and see how the calls end.

A call ends well if both engines return the same numbers, finite where they promise to be, or if both refuse
it with the same kind of error, which names the argument, and leave everything as it was.  To see a case
again: ``python tests/torture/calls.py SEED CASE``.
"""

from __future__ import annotations

import collections
import multiprocessing
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from calls_worker import KINDS, SECONDS, Outcome, work
from parts import differences
from report import Report

__all__ = ["run"]

ENGINES = ("numpy", "compiled")

#: Calls of the full run.
CALLS = 30_000

#: After so many processes of a chunk have died, something is wrong with all of them.
MOST_DEATHS = 10

#: How many cases a process makes before another one takes its place.
CHUNK = 500

#: Agreement of the engines.  Learning searches, and stops a little earlier or later.
TOLERANCE, LEARNED = 1e-7, 1e-4

#: Errors that are not as they should be, and why that is accepted: (object, verb, error) and the reason.
EXPLAINED: dict[tuple[str, str, str], str] = {}


def outcomes_on(engine: str, numbers: range, seed: int) -> dict[int, tuple[str, list[Outcome]]]:
    """Run cases on an engine; one that kills or blocks its process is noted, and the next one tried."""
    found: dict[int, tuple[str, list[Outcome]]] = {}
    deaths = 0
    while len(found) < len(numbers) and deaths < MOST_DEATHS:
        rest = numbers[len(found) :]
        with tempfile.TemporaryDirectory() as folder:
            trace = Path(folder, "trace")
            ended = listen(engine, rest, seed, trace, found)
            if ended and len(found) < len(numbers):
                deaths += 1
                lines = trace.read_text().splitlines() if trace.exists() else []
                found[numbers[len(found)]] = ("?", [Outcome("?", ended, " | ".join(lines[:12]))])
    return found


def listen(engine: str, numbers: range, seed: int, trace: Path, found: dict[int, Any]) -> str:
    """Collect what a process sends; return "crash" or "hang" if it does not come to its end."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(numbers, seed, there, str(trace)))
    before = os.environ.get("FUZZYKF_ENGINE")
    os.environ["FUZZYKF_ENGINE"] = engine
    try:
        process.start()
        there.close()
        while True:
            if not here.poll(30.0 + 8 * SECONDS):
                return "hang"
            sent = here.recv()
            if sent is None:
                return ""
            found[sent[0]] = sent[1:]
    except EOFError:
        return "crash"
    finally:
        process.kill()
        process.join()
        os.environ.pop("FUZZYKF_ENGINE") if before is None else os.environ.update(FUZZYKF_ENGINE=before)


#: Squares of numbers from here on leave the range of numbers.
ENDS = 1e300


def compared(found: dict[str, Any], size: float) -> dict[str, Any]:
    """Leave out what is not the same on both engines, and need not be.

    Only one engine keeps the probabilities of nodes as such beside their logarithms, and a residual that
    cancels huge numbers to nothing has no normalised square that means anything.
    """
    left_out = (".mass", ".nis") if size > 1.0 else (".mass",)
    return {path: value for path, value in found.items() if not any(name in path for name in left_out)}


def judged(name: str, one: list[Outcome], other: list[Outcome]) -> list[tuple[str, str]]:
    """Return the kind of each call of a case, and what is wrong with it."""
    verdicts = []
    for a, b in zip(one, other, strict=False):
        worst = max((a, b), key=lambda each: list(KINDS).index(each.kind))
        kind, text = worst.kind, worst.text
        if kind in ("right", "named") and not a.broken:
            size = max(a.size, b.size)
            same = a.kind == b.kind and a.text.partition(":")[0] == b.text.partition(":")[0]
            same = same or size >= ENDS  # whether S is singular is a matter of rounding there
            apart = "" if same else f"{a.text or 'no error'}; {b.text or 'no error'}"
            tolerance = LEARNED if a.call.partition("(")[0].endswith(("fit", "bootstrap")) else TOLERANCE
            apart = apart or differences(compared(a.found, size), compared(b.found, size), tolerance, size)
            if apart:
                kind, text = "differs", apart
        if (name, a.call.partition("(")[0], text.partition(":")[0]) in EXPLAINED:
            kind, text = "named", ""
        where = "" if a.kind == b.kind else f" (numpy: {a.kind}, compiled: {b.kind})"
        verdicts.append((kind, f"{text}{where}"))
        if kind not in ("right", "named"):  # whatever follows follows from that
            break
    return verdicts


def run(share: float, seed: int) -> Report:
    """Make calls until there are enough."""
    report = Report("calls with arguments of all kinds, on both engines")
    counted: collections.Counter[str] = collections.Counter()
    first = 0
    while sum(counted.values()) < CALLS * share:
        numbers = range(first, first + min(CHUNK, max(50, round(CALLS * share / 4))))
        first = numbers.stop
        both = [outcomes_on(engine, numbers, seed) for engine in ENGINES]
        for number in numbers:
            if number not in both[0] or number not in both[1]:
                report.faults.append(f"too many processes died before case {number}")
                return report
            (name, one), (_, other) = both[0][number], both[1][number]
            verdicts = judged(name, one, other)
            counted.update(kind for kind, _ in verdicts)
            if verdicts and verdicts[-1][0] not in ("right", "named"):
                kind, text = verdicts[-1]
                report.faults.append(
                    f"{kind}: {name}.{one[len(verdicts) - 1].call}: {text} [case {seed} {number}]"
                )
    report.figures["calls"] = sum(counted.values())
    report.figures |= {text: counted[kind] for kind, text in KINDS.items()}
    return report


def again(seed: int, number: int) -> None:
    """Show every call of one case, on both engines."""
    for engine in ENGINES:
        print(f"# {engine}")
        name, outcomes = outcomes_on(engine, range(number, number + 1), seed)[number]
        for one in outcomes:
            print(f"{name}.{one.call}\n    {one.kind} {one.text}")


if __name__ == "__main__":
    again(*map(int, sys.argv[1:3]))
