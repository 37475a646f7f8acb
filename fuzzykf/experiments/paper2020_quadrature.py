"""What the text of the 2020 paper says of its quadrature: accuracy against cost, for all four rules."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError, QuadratureError
from fuzzykf.experiments.core import Experiment, new_figure
from fuzzykf.experiments.paper2020 import (
    CORRECTED,
    FMC2,
    make_law,
    make_model,
    mean_squared_errors,
    simulate_many,
)
from fuzzykf.experiments.verdicts import Finding, claim, exact, measured
from fuzzykf.plotting import BLUE, ORANGE, TRUTH
from fuzzykf.switching import OFSRFilter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from fuzzykf.arrays import FloatArray
    from fuzzykf.experiments.core import Samples

__all__ = ["QUADRATURE"]

_RULES = ("midpoint", "gauss", "cell", "product")
_NODES = (3, 5, 7, 10, 20, 40)
_PIECES = {
    "FMC1": {"family": "FMC1", "parameters": (0.07, 0.05, 0.16)},
    "FMC2": {"family": "FMC2", "parameters": FMC2},
}

#: Nodes of the filter that the others are compared with, by product integration.
_REFERENCE = 80


def _compare_rules(
    rng: np.random.Generator,
    runs: int,
    *,
    family: str,
    parameters: tuple[float, ...],
    n: int,
    reference: int,
    nodes: tuple[int, ...],
) -> Samples:
    """Root mean square difference of filtered means from those on many nodes, per run.

    A rule that refuses a number of nodes, or fails on it and says so, has no entry.
    """
    law = make_law(family, parameters)
    model = make_model(law)
    series = simulate_many(model, runs, n, rng)

    def means(rule: str, F: int) -> FloatArray:
        x: FloatArray = OFSRFilter(model, n_nodes=F, rule=rule).filter_many(series.y, keep=("x",)).x[..., 0]
        return x

    best = means("product", reference)
    out: Samples = {"mse": mean_squared_errors(best, series.x)}
    for rule in _RULES:
        for F in nodes:
            try:
                difference = means(rule, F) - best
            except (ParameterError, QuadratureError):
                continue
            out[f"{rule} {F}"] = np.sqrt(np.mean(difference**2, axis=1))
            chain = law.discretize(F, rule)
            out[f"{rule} {F} pairs"] = np.array(np.count_nonzero(chain.transition))
    return out


def _assess(samples: Mapping[str, Samples]) -> list[Finding]:
    findings = []
    for name, values in samples.items():
        ratio = float(values["cell 20 pairs"] / values["cell 10 pairs"])
        findings.append(
            exact(
                f"{name}: cost of a step with 20 nodes / with 10",
                printed="1.8",  # (20 + 2) / (10 + 2), the text calls the cost linear
                ours=ratio,
                reason="a step weighs pairs of nodes: quadratic in F",
            )
        )
        findings.append(
            claim(
                f"{name}: 5 midpoints add less than 1 % to the MSE (margin left)",
                0.01 * values["mse"] - values["midpoint 5"] ** 2,
                correction=CORRECTED,
            )
        )
        for rule in _RULES:
            findings += [
                measured(f"{name}, {rule}: rms error of {F} nodes", values[f"{rule} {F}"])
                for F in _NODES
                if f"{rule} {F}" in values
            ]
    return findings


def _draw(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(9.0, 4.2)
    axes = figure.subplots(1, 2, sharey=True)
    styles = {"midpoint": (ORANGE, "-", "o"), "gauss": ("#009E73", "--", "^"), "cell": (BLUE, "-.", "s")}
    styles["product"] = (TRUTH, ":", "D")
    for ax, (name, values) in zip(axes, samples.items(), strict=True):
        for rule, (colour, dashes, marker) in styles.items():
            there = [F for F in _NODES if f"{rule} {F}" in values]
            pairs = [int(values[f"{rule} {F} pairs"]) for F in there]
            errors = [values[f"{rule} {F}"].mean() for F in there]
            ax.loglog(pairs, errors, linestyle=dashes, color=colour, marker=marker, markersize=5, label=rule)
        ax.set(title=name, xlabel="pairs of nodes per step (cost)")
        ax.grid(color="0.9")
    axes[0].set_ylabel("rms error of the filtered mean")
    axes[0].legend()
    return figure


QUADRATURE = Experiment(
    name="quadrature",
    paper="2020",
    reproduces="Remark 1 and section VI-B: accuracy of the integrals against their cost",
    runs=20,
    quick_runs=6,
    pieces={
        name: piece | {"n": 500, "reference": _REFERENCE, "nodes": _NODES} for name, piece in _PIECES.items()
    },
    run=_compare_rules,
    assess=_assess,
    draw=_draw,
)
