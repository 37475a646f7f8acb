"""Ill-treat the package, count what happens, and fail where it is not what docs/reliability.md promises.

    python tests/torture                  everything, about an hour on two cores
    python tests/torture --short          a sample of everything, in three minutes
    python tests/torture --only outliers  one part
    python tests/torture --seed 7         other random choices
    python tests/torture --share 0.1      a tenth of everything

Every part is a module with a function ``run(share, seed)`` that returns a Report.  The parts run one
after the other, each in a process of its own; one that dies or hangs is a fault of its own.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from processes import tried  # noqa: E402

#: In this order.  A new part is one file and one line here.
PARTS = ("calls", "outliers", "soak", "kills", "files", "pickles", "threads", "workers")

#: Share of the full run that the short one takes.
SHORT = 0.02


def main() -> int:
    """Run what was asked for; the exit code says whether anything was wrong."""
    parser = argparse.ArgumentParser(prog="torture", description="Ill-treat the package; count what happens.")
    parser.add_argument("--short", action="store_true", help="a sample of everything, in three minutes")
    parser.add_argument("--share", type=float, help="how much of the full run, 0 to 1")
    parser.add_argument("--only", choices=PARTS, action="append", help="this part; may be given repeatedly")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.share is not None and not 0.0 < args.share <= 1.0:
        parser.error(f"--share: got {args.share:g}, expected above 0 and at most 1")
    share = args.share if args.share is not None else SHORT if args.short else 1.0
    faults = 0
    for part in args.only or PARTS:
        begun = time.monotonic()
        report = tried(part, share, args.seed)
        print(*report.lines(part, time.monotonic() - begun), sep="\n", flush=True)
        print()
        faults += len(report.faults)
    print(f"{faults} faults" if faults else "No faults.")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
