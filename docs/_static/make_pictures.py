"""Make the picture of README and of the front page: python docs/_static/make_pictures.py."""

from __future__ import annotations

import runpy
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

HERE = Path(__file__).parent
runpy.run_path(str(HERE.parents[1] / "examples" / "plot_fuzzy_switches.py"))
plt.savefig(HERE / "fuzzy_switches.png", dpi=110)
