"""Make the pictures of README, of the front page and of pages: python docs/_static/make_pictures.py."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import matplotlib.pyplot as plt

from fuzzykf import IMMEstimator, SwitchingKalmanFilter
from fuzzykf.plotting import BLUE, ORANGE, TRUTH

HERE = Path(__file__).parent


def listings(page: Path) -> list[str]:
    """Return the Python on a page."""
    return re.findall(
        r"^```python\n(.*?)^```$",
        page.read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )


# the listings of these pages, up to the one that makes a figure, leave it behind
for name in ("howto/laws.md", "theory/exactness.md", "tutorials/bounded_noise.md"):
    drawn: dict[str, object] = {}
    for listing in listings(HERE.parent / name):
        exec(compile(listing, name, "exec"), drawn)
        if "figure" in drawn:
            break
    drawn["figure"].savefig(HERE / f"{Path(name).stem}.png", dpi=90)  # type: ignore[attr-defined]


# --------------------------------------------------------------------------- the sensor of README

readme: dict[str, Any] = {}
for listing in listings(HERE.parents[1] / "README.md"):
    exec(compile(listing, "README.md", "exec"), readme)
x, y, shadow = readme["x"], readme["y"], readme["shadow"]


def error(estimate: np.ndarray) -> float:
    """Return the root mean squared error of a series of estimates."""
    return float(np.sqrt(np.mean((estimate - x) ** 2)))


def imm(n_modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return states and shadow, of modes between sun and shadow, at the best of six rates in hindsight."""
    shades = np.linspace(0.0, 1.0, n_modes)
    steps = np.eye(n_modes, k=1) + np.eye(n_modes, k=-1)
    steps /= steps.sum(axis=1, keepdims=True)  # to a neighbour
    found = []
    for p in (0.001, 0.003, 0.01, 0.03, 0.1, 0.3):
        M = (1.0 - p) * np.eye(n_modes) + p * steps
        modes = [readme["sensor"](1.0 - 0.5 * shade) for shade in shades]
        result = IMMEstimator(modes, mu=np.full(n_modes, 1.0 / n_modes), M=M).filter(y)
        found.append((result.x[:, 0], result.mu @ shades))
    return min(found, key=lambda one: error(one[0]))


result = SwitchingKalmanFilter(readme["model"]).filter(y)
rows = (
    ("fuzzy", result.x[:, 0], result.switch_mean, BLUE, "-"),
    ("IMM, seven regimes", *imm(7), "#4a3aa7", "--"),
    ("IMM, two regimes", *imm(2), ORANGE, "-."),
)
figure, (upper, lower) = plt.subplots(
    2, 1, figsize=(6, 4.6), sharex=True, layout="constrained", height_ratios=(3, 1)
)
upper.plot(y, ".", color="0.6", markersize=4, label="reading of the sensor")
upper.plot(x, color=TRUTH, linewidth=2.2, label="truth")
lower.fill_between(range(len(x)), shadow, color="0.85", label="truth")
for name, state, shade, color, line in rows:
    upper.plot(
        state,
        line,
        color=color,
        linewidth=1.6,
        label=f"{name}: RMSE {error(state):.2f}",
    )
    lower.plot(shade, line, color=color, linewidth=1.4)
upper.set(
    ylabel="temperature",
    ylim=(7.0, None),
    title="A sensor whose gain fades to a half, and back",
)
lower.set(ylabel="shadow", xlabel="step", ylim=(-0.04, 1.04), yticks=[0, 0.5, 1])
figure.legend(
    *upper.get_legend_handles_labels(),
    loc="outside lower center",
    ncols=2,
    frameon=False,
)
for panel in (upper, lower):
    panel.grid(color="0.92")
    panel.margins(x=0)
figure.savefig(HERE / "fading_gain.png", dpi=160)
