"""Make equations wrong, one at a time, and see whether the tests notice.

``nox -s mutants`` copies the package, as it is built, into a temporary folder, draws mutants by
rule from the files in targets.py, and runs for each of them the tests that ought to fail.
It prints a Markdown table and the mutants that survived; below 95 % killed it fails.

    python tests/mutants                     all of them, about half an hour
    python tests/mutants --only kalman       files whose path has this in it
    python tests/mutants --seed 2 --times 3  other mutants, three times as many
    python tests/mutants --keep FILE         keep the results, and when run again with the same file
                                             take only those that were not killed
    python tests/mutants --list              show the mutants and run nothing

A mutant of C is compiled into the one translation unit that targets.py names, with little
optimisation.  Tests that take over half a second each are left out.  What changes no result is listed in
equivalent.toml with the reason, and another mutant is drawn in its place.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import sys
import tempfile
import tomllib
from dataclasses import asdict
from pathlib import Path

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from rules import Mutant, mutants_of  # noqa: E402
from runner import Copy, Verdict  # noqa: E402
from targets import TARGETS, Target  # noqa: E402

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
LEAST = 0.95


def drawn(target: Target, seed: int, times: float) -> list[Mutant]:
    """Draw the mutants of a target; the same ones for the same seed and the same source."""
    file = f"fuzzykf/{target.file}"
    source = (ROOT / file).read_bytes()
    found = mutants_of(file, source, target.functions)
    random.Random(f"{seed} {file} {target.functions}").shuffle(found)
    harmless = tomllib.loads((HERE / "equivalent.toml").read_text(encoding="utf-8")).get("mutant", [])
    known = {(f"fuzzykf/{entry['file']}", entry["line"], entry.get("new")) for entry in harmless}
    chosen: list[Mutant] = []
    for mutant in found:
        old, new = mutant.lines(source)
        if not {(file, old, None), (file, old, new)} & known:
            chosen.append(mutant)
    return sorted(chosen[: max(1, round(target.number * times))], key=lambda mutant: mutant.start)


def key(mutant: Mutant) -> str:
    """Name a mutant by what it changes, wherever it stands."""
    old, new = mutant.lines((ROOT / mutant.file).read_bytes())
    return f"{mutant.file}: {old} => {new}"


def judge(copy: Copy, target: Target, mutants: list[Mutant], baselines: dict) -> list[Verdict]:
    """Run the tests of a target on each of its mutants."""
    tests, engine = tuple(f"tests/{path}" for path in target.tests), target.engine
    unit = f"fuzzykf/{target.unit}"
    if target.unit and unit not in baselines:
        if not copy.build(unit):
            raise SystemExit(f"{unit}: cannot be compiled")
        baselines[unit] = copy.library(unit).read_bytes()
    slow, usual = set(), 0.0
    for path in tests:
        if (path, engine) not in baselines:
            baselines[path, engine] = copy.baseline((path,), engine)
        slow, usual = slow | baselines[path, engine][0], usual + baselines[path, engine][1]
    verdicts = []
    for mutant in mutants:
        source = copy.read(mutant.file)
        copy.write(mutant.file, mutant.applied(source))
        if target.unit and not copy.build(unit, again=mutant.file == unit):
            verdict = Verdict("killed", "compiler")
        else:
            verdict = copy.judge(tests, engine, slow, 20.0 + 2.0 * usual)
        copy.write(mutant.file, source)
        if target.unit:
            copy.library(unit).unlink(missing_ok=True)
            copy.library(unit).write_bytes(baselines[unit])
        print(f"{verdict.outcome:9} {verdict.seconds:5.1f} s  {key(mutant)}  [{verdict.by}]", file=sys.stderr)
        verdicts.append(verdict)
    return verdicts


def table(rows: list[tuple[Target, list[Mutant], list[Verdict]]]) -> str:
    """Show what was killed, in Markdown, and every mutant that was not."""
    lines = ["| module | mutants | killed | of these by timeout |", "|---|--:|--:|--:|"]
    survivors = []
    for target, mutants, verdicts in rows:
        killed = sum(verdict.outcome != "survived" for verdict in verdicts)
        late = sum(verdict.outcome == "timeout" for verdict in verdicts)
        which = f" ({target.functions.replace('|', ', ')})" if target.functions else ""
        lines.append(f"| {target.file}{which} | {len(mutants)} | {killed} | {late} |")
        for mutant, verdict in zip(mutants, verdicts, strict=True):
            if verdict.outcome == "survived":
                old, new = mutant.lines((ROOT / mutant.file).read_bytes())
                survivors.append(f"- {mutant.file}:{mutant.line} ({mutant.rule})\n  `{old}`\n  `{new}`")
    number, killed = (
        sum(len(row[1]) for row in rows),
        sum(v.outcome != "survived" for row in rows for v in row[2]),
    )
    lines.append(f"| all | {number} | {killed} ({killed / max(number, 1):.1%}) | |")
    return "\n".join([*lines, "", "Survivors:" if survivors else "No survivors.", "", *survivors])


def main() -> int:
    """Run what was asked for; the exit code says whether enough was killed."""
    parser = argparse.ArgumentParser(prog="mutants", description="Make equations wrong; see who notices.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--times", type=float, default=1.0)
    parser.add_argument("--only", default="")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--list", action="store_true")
    args = parser.parse_args()
    plan = [(t, drawn(t, args.seed, args.times)) for t in TARGETS if args.only in f"{t.file} {t.unit}"]
    if args.list:
        for _, mutants in plan:
            print(*(f"{mutant.line:4} {mutant.rule:11} {key(mutant)}" for mutant in mutants), sep="\n")
        print(sum(len(mutants) for _, mutants in plan))
        return 0
    known = json.loads(args.keep.read_text()) if args.keep and args.keep.exists() else {}
    known = {name: Verdict(**kept) for name, kept in known.items()}
    folder = Path(tempfile.mkdtemp(prefix="mutants-"))
    rows = []
    try:
        copy, baselines = Copy(ROOT, folder.resolve()), {}
        for target, mutants in plan:
            again = [m for m in mutants if known.get(key(m), Verdict("survived")).outcome == "survived"]
            if again:
                for mutant, verdict in zip(again, judge(copy, target, again, baselines), strict=True):
                    known[key(mutant)] = verdict
            rows.append((target, mutants, [known[key(m)] for m in mutants]))
            if args.keep:
                args.keep.write_text(json.dumps({name: asdict(v) for name, v in known.items()}, indent=1))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(table(rows))
    verdicts = [verdict for row in rows for verdict in row[2]]
    return int(sum(verdict.outcome != "survived" for verdict in verdicts) < LEAST * len(verdicts))


if __name__ == "__main__":
    sys.exit(main())
