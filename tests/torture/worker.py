"""What the process of a part does; spawned processes do not find it in __main__."""

from __future__ import annotations

import faulthandler
import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

__all__ = ["work"]


def work(part: str, share: float, seed: int, results: Connection) -> None:
    """Run a part in this process and send its report."""
    faulthandler.enable()
    results.send(importlib.import_module(part).run(share, seed))
