"""Make the pictures of README, of the front page and of pages: python docs/_static/make_pictures.py."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

HERE = Path(__file__).parent
runpy.run_path(str(HERE.parents[1] / "examples" / "plot_fuzzy_switches.py"))
plt.savefig(HERE / "fuzzy_switches.png", dpi=110)

# the listings of these pages, up to the one that makes a figure, leave it behind
for name in ("howto/laws.md", "theory/exactness.md", "tutorials/bounded_noise.md"):
    page = (HERE.parent / name).read_text(encoding="utf-8")
    drawn: dict[str, object] = {}
    for listing in re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL):
        exec(compile(listing, name, "exec"), drawn)
        if "figure" in drawn:
            break
    drawn["figure"].savefig(HERE / f"{Path(name).stem}.png", dpi=90)  # type: ignore[attr-defined]
