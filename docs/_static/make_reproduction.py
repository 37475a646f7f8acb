"""Take the results of a full run into the documentation: python docs/_static/make_reproduction.py FOLDER.

FOLDER is what ``fuzzykf reproduce all --out FOLDER`` has written.  Pictures are copied, and
the summary table of docs/reproduction.md is made anew; the text around it is written by hand.
"""

from __future__ import annotations

import csv
import re
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE.parent / "reproduction.md"

#: Experiments in which nothing is random.
WITHOUT_RUNS = {"densities", "building"}


def main(folder: Path) -> None:
    """Copy pictures and write the table."""
    with (folder / "summary.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    lines = [
        "| experiment | paper | what | runs | reproduced | with a correction | not reproduced |",
        "|---|---|---|---:|---:|---:|---:|",
    ]
    for row in rows:
        name = row["experiment"]
        shutil.copyfile(folder / f"{name}.png", HERE / "reproduction" / f"{name}.png")
        what = row["reproduces"].partition(":")[0]
        runs = "–" if name in WITHOUT_RUNS else row["runs"]
        verdicts = (
            row[k]
            for k in ("reproduced", "reproduced with a correction", "not reproduced")
        )
        lines.append(
            f"| `{name}` | {row['paper']} | {what} | {runs} | {' | '.join(verdicts)} |"
        )
    text = PAGE.read_text(encoding="utf-8")
    new, found = re.subn(
        r"\| experiment \|.*?\n(?=\n)",
        lambda _: "\n".join(lines) + "\n",
        text,
        flags=re.DOTALL,
    )
    if found != 1:
        raise SystemExit(f"{PAGE}: expected one table of experiments, found {found}")
    PAGE.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
