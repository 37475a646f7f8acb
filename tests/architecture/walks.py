"""Through how many files a call walks, and how often it changes from one to another.

    FUZZYKF_ENGINE=numpy python tests/architecture/walks.py

A walk is what somebody has to follow who reads along: the files of fuzzykf whose functions run, in order.
A call of a function that stands in another file than the one called before is a change of file.
"""

from __future__ import annotations

import os
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if __name__ == "__main__":  # the compiled core is one file, and no walk
    os.environ.setdefault("FUZZYKF_ENGINE", "numpy")

import numpy as np

import fuzzykf
import fuzzykf.engine
from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, FuzzyRelationEstimator, GaussianMembership, OFSRFilter

if TYPE_CHECKING:
    from collections.abc import Callable

PACKAGE = f"{Path(fuzzykf.__file__).parent}{os.sep}"


class Walk(NamedTuple):
    """Files in the order in which they were entered."""

    files: list[str]

    @property
    def visited(self) -> int:
        """How many files there are."""
        return len(set(self.files))

    @property
    def changes(self) -> int:
        """How often the file changes."""
        return sum(a != b for a, b in pairwise(self.files))


def walk(call: Callable[[], Any]) -> Walk:
    """Follow a call through the files of fuzzykf."""
    files: list[str] = []

    def follow(frame: Any, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(PACKAGE):
            files.append(frame.f_code.co_filename[len(PACKAGE) :])

    sys.setprofile(follow)
    try:
        call()
    finally:
        sys.setprofile(None)
    return Walk(files)


def switching_filter() -> OFSRFilter:
    """A filter of one state and one observation."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    return OFSRFilter(CGOFMSModel(law, [[0.0, 0.0], [3.0, 3.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1))


def third_step() -> Walk:
    """The third step of a switching filter, when all that is made once has been made."""
    f = switching_filter()
    f.step(0.1)
    f.step(0.2)
    return walk(lambda: f.step(0.3))


def filter_with_a_gap() -> Walk:
    """Sixty values with one missing, by a filter that has filtered before."""
    f, zs = switching_filter(), np.sin(np.arange(60.0))
    zs[20] = np.nan
    f.filter(zs)
    return walk(lambda: f.filter(zs))


def grid_predict() -> Walk:
    """The second prediction of a fuzzy estimator on a grid, for two states and a function of them."""
    est = FuzzyRelationEstimator(
        2,
        1,
        fx=lambda x: np.stack(
            [x[..., 0] + 0.1 * x[..., 1], 0.9 * x[..., 1] - 0.1 * np.sin(x[..., 0])], axis=-1
        ),
        hx=lambda x: x[..., :1],
        state=GaussianMembership([0.0, 0.0], np.eye(2)),
        process_noise=GaussianMembership([0.0, 0.0], 0.1 * np.eye(2)),
        measurement_noise=GaussianMembership([0.0], [[0.2]]),
        points=61,
        domain=[(-6.0, 6.0), (-6.0, 6.0)],
    )
    est.predict()
    return walk(est.predict)


WALKS = {
    "third step": third_step,
    "filter with a gap": filter_with_a_gap,
    "grid predict": grid_predict,
}


def main() -> None:
    """Print files visited and changes of file of every walk."""
    print(f"engine: {fuzzykf.engine.info().name}")
    for name, take in WALKS.items():
        found = take()
        print(f"{name}: {found.visited} files, {found.changes} changes of file")
        for file in sorted(set(found.files)):
            print(f"    {file}")


if __name__ == "__main__":
    main()
