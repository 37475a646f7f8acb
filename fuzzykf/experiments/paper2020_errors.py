"""Figure 5 and Table I of the 2020 paper: errors by number of nodes, and by share of hard values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.experiments.core import Experiment, new_figure
from fuzzykf.experiments.paper2020 import (
    CORRECTED,
    make_law,
    make_model,
    mean_squared_errors,
    simulate_many,
)
from fuzzykf.experiments.verdicts import claim, exact, measured, printed_mean
from fuzzykf.plotting import BLUE, ORANGE, TRUTH
from fuzzykf.switching import CGOMSMFilter, CGOMSModel, KnownSwitchFilter, OFSRFilter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from fuzzykf.arrays import FloatArray
    from fuzzykf.experiments.core import Samples
    from fuzzykf.experiments.verdicts import Finding
    from fuzzykf.switching import CGOFMSModel

__all__ = ["HARD_FRACTION", "NODES"]

# --------------------------------------------------------------------------- Figure 5

#: Parameters (alpha, delta, eta) of the law FMC1 of Figure 5.
_LAW = (0.07, 0.05, 0.16)

_MOST_NODES = 9


def _sweep_nodes(
    rng: np.random.Generator, runs: int, *, parameters: tuple[float, ...], n: int, most: int
) -> Samples:
    """Filter the same series with 0, 1, ..., ``most`` nodes, with a hard model, and with the known switch."""
    model = make_model(make_law("FMC1", parameters))
    series = simulate_many(model, runs, n, rng)
    out = {"known": mean_squared_errors(_told(model, series.y, series.r), series.x)}
    hard = CGOMSMFilter(model.harden()).filter_many(series.y, keep=("x", "switch"))
    fuzzy = [
        OFSRFilter(model, n_nodes=F).filter_many(series.y, keep=("x", "switch")) for F in range(most + 1)
    ]
    for name, result in [("hard", hard), *((str(F), result) for F, result in enumerate(fuzzy))]:
        out[f"state_{name}"] = mean_squared_errors(result.x, series.x)
        out[f"switch_{name}"] = mean_squared_errors(result.switch, series.r)
    return out


def _told(model: CGOFMSModel, y: Any, r: Any) -> Any:
    return KnownSwitchFilter(model).filter_many(y, keep=("x",), r=r).x


def _assess_nodes(samples: Mapping[str, Samples]) -> list[Finding]:
    values = samples["FMC1"]
    law = make_law("FMC1", _LAW)
    excess = {name: values[f"state_{name}"] - values["known"] for name in ("hard", "5")}
    return [
        exact("β", printed="0.158", ours=law.beta),
        exact("p_H", printed="0.69", ours=law.p_hard, reason="the parameters give .667"),
        claim("state: MSE hard - MSE fuzzy, F = 5", excess["hard"] - excess["5"], correction=CORRECTED),
        claim(
            "switch: MSE hard - MSE fuzzy, F = 5",
            values["switch_hard"] - values["switch_5"],
            correction=CORRECTED,
        ),
        printed_mean(
            "state: excess over the known switch, F = 5, as a share of that of the hard filter",
            _ratio(excess["5"], excess["hard"]),
            printed="0.5",
            printed_runs=50,
            correction=CORRECTED,
        ),
        claim(
            "state: MSE of F = 0 - MSE of F = 4", values["state_0"] - values["state_4"], correction=CORRECTED
        ),
        measured("state: MSE of F = 4 - MSE of F = 9", values["state_4"] - values["state_9"]),
        measured("state: MSE with the known switch", values["known"]),
        measured("state: MSE of the hard filter", values["state_hard"]),
        *(
            measured(f"{what}: MSE of F = {F}", values[f"{what}_{F}"])
            for what in ("state", "switch")
            for F in range(_MOST_NODES + 1)
        ),
    ]


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return numbers whose mean is mean(a) / mean(b), and scatter as that does (delta method)."""
    ratio = a.mean() / b.mean()
    linear: FloatArray = ratio + (a - ratio * b) / b.mean()
    return linear


def _draw_nodes(samples: Mapping[str, Samples]) -> Figure:
    values = samples["FMC1"]
    figure = new_figure(7.0, 6.0)
    axes = figure.subplots(2, 1, sharex=True)
    F = np.arange(_MOST_NODES + 1)
    for ax, what in zip(axes, ("switch", "state"), strict=True):
        runs = np.stack([values[f"{what}_{k}"] for k in F])
        error = runs.std(axis=1, ddof=1) / np.sqrt(runs.shape[1])
        ax.errorbar(F, runs.mean(axis=1), error, color=BLUE, marker="o", capsize=3, label="fuzzy filter")
        hard = values[f"{what}_hard"].mean()
        ax.axhline(hard, color=ORANGE, linestyle="--", label="hard filter")
        if what == "state":
            ax.axhline(values["known"].mean(), color=TRUTH, linestyle=":", label="switch known")
        ax.set_ylabel(f"MSE of the {what}")
        ax.grid(color="0.9")
        ax.legend(loc="center right", bbox_to_anchor=(1.0, 0.73))
    axes[1].set(xlabel="nodes F between 0 and 1", xticks=F)
    return figure


NODES = Experiment(
    name="nodes",
    paper="2020",
    reproduces="Fig. 5: errors by number of nodes",
    runs=100,
    quick_runs=30,
    pieces={"FMC1": {"parameters": _LAW, "n": 300, "most": _MOST_NODES}},
    run=_sweep_nodes,
    assess=_assess_nodes,
    draw=_draw_nodes,
)

# --------------------------------------------------------------------------- Table I

#: Law, printed share of hard values, parameters, printed errors: switch and state by
#: the fuzzy filter, switch and state by the hard filter.
_COLUMNS: tuple[tuple[str, int, tuple[float, ...], tuple[str, str, str, str]], ...] = (
    ("FMC1", 48, (0.07, 0.05, 0.275), ("0.051", "0.475", "0.126", "0.599")),
    ("FMC1", 58, (0.07, 0.05, 0.21), ("0.046", "0.446", "0.094", "0.535")),
    ("FMC1", 67, (0.07, 0.05, 0.16), ("0.039", "0.431", "0.074", "0.500")),
    ("FMC1", 75, (0.07, 0.05, 0.108), ("0.034", "0.415", "0.057", "0.468")),
    ("FMC1", 93, (0.07, 0.05, 0.005), ("0.017", "0.368", "0.020", "0.386")),
    ("FMC2", 48, (0.10, 0.8 / 1.71, 0.30), ("0.030", "0.442", "0.070", "0.538")),
    ("FMC2", 62, (0.15, 0.65, 0.15), ("0.026", "0.442", "0.040", "0.479")),
    ("FMC2", 75, (0.15, 0.65, 0.10), ("0.021", "0.420", "0.033", "0.457")),
    ("FMC2", 87, (0.15, 0.55, 0.06), ("0.014", "0.399", "0.021", "0.422")),
    ("FMC2", 100, (0.15, 0.0, 0.06), ("0.012", "0.37", "0.011", "0.374")),
)
_TABLE_NODES = {"FMC1": 4, "FMC2": 10}
_MEASURES = ("fuzzy_switch", "fuzzy_state", "hard_switch", "hard_state")
_INTERPOLATIONS: tuple[Literal["covariance", "transition"], ...] = ("covariance", "transition")
_HOW = {
    "covariance": CORRECTED,
    "transition": f"{CORRECTED}; A and the root of B B' interpolated, not Γ as in (42)",
}
_WHY_NOT = {
    "covariance": "the table was made with another interpolation than (42): see the rows called transition",
    "transition": "",
}
_BELOW = "γ = 0.55 makes β negative; with the largest admissible γ, "
_SAME = "without fuzzy values the two filters are one"


def _restore_column(
    rng: np.random.Generator,
    runs: int,
    *,
    family: str,
    parameters: tuple[float, ...],
    interpolation: Literal["covariance", "transition"],
    n: int,
    n_nodes: int,
    most_learned: int,
) -> Samples:
    """Restore series with the fuzzy filter, the hardened one, and a hard one that has learned.

    The latter learns on up to ``most_learned`` series of its own, from state and observation.
    """
    model = make_model(make_law(family, parameters), interpolation)
    series = simulate_many(model, runs, n, rng)
    lesson = simulate_many(model, max(1, min(most_learned, runs // 10)), n, rng)
    learned = CGOMSModel.fit(list(lesson.x), list(lesson.y), form="regression", n_starts=2).model
    out: Samples = {"hard_share": np.mean((series.r == 0.0) | (series.r == 1.0), axis=1)}
    filters = {
        "fuzzy": OFSRFilter(model, n_nodes=n_nodes),
        "hard": CGOMSMFilter(model.harden()),
        "learned": CGOMSMFilter(learned),
    }
    for name, filter_ in filters.items():
        result = filter_.filter_many(series.y, keep=("x", "switch"))
        out[f"{name}_state"] = mean_squared_errors(result.x, series.x)
        out[f"{name}_switch"] = mean_squared_errors(result.switch, series.r)
    return out


def _assess_table(samples: Mapping[str, Samples]) -> list[Finding]:
    findings = []
    for interpolation in _INTERPOLATIONS:
        for family, share, _, printed in _COLUMNS:
            values = samples[f"{family} {share} % {interpolation}"]
            where = f"{family} {share} %, {interpolation}"
            prefix = _BELOW if (family, share) == ("FMC2", 48) else ""
            findings += [
                printed_mean(
                    f"{where}: {' '.join(name.split('_'))} MSE",
                    values[name],
                    printed=number,
                    printed_runs=20,
                    correction=prefix + _HOW[interpolation],
                    reason=_WHY_NOT[interpolation],
                )
                for name, number in zip(_MEASURES, printed, strict=True)
            ]
            if share == 100:
                difference = float(np.mean(values["hard_state"] - values["fuzzy_state"]))
                findings.append(
                    exact(f"{where}: state MSE hard - fuzzy", printed="0.004", ours=difference, reason=_SAME)
                )
            else:
                gain = values["hard_state"] - values["fuzzy_state"]
                findings.append(
                    claim(f"{where}: state MSE hard - fuzzy", gain, correction=prefix + _HOW[interpolation])
                )
            findings += [
                measured(f"{where}: learned hard state MSE", values["learned_state"]),
                measured(
                    f"{where}: state MSE learned hard - fuzzy",
                    values["learned_state"] - values["fuzzy_state"],
                ),
            ]
    return findings


def _draw_table(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(9.5, 7.0)
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    styles = (
        ("fuzzy", BLUE, "-", "o", "fuzzy"),
        ("hard", ORANGE, "--", "s", "hardened"),
        ("learned", TRUTH, ":", "^", "hard, learned"),
    )
    for row, interpolation in enumerate(_INTERPOLATIONS):
        for column, family in enumerate(("FMC1", "FMC2")):
            ax = axes[row, column]
            chosen = [c for c in _COLUMNS if c[0] == family]
            shares = [share for _, share, _, _ in chosen]
            for name, colour, dashes, marker, label in styles:
                runs = [samples[f"{family} {share} % {interpolation}"][f"{name}_state"] for share in shares]
                error = [values.std(ddof=1) / np.sqrt(values.size) for values in runs]
                mean = [values.mean() for values in runs]
                ax.errorbar(shares, mean, error, color=colour, linestyle=dashes, marker=marker, label=label)
            for k, (colour, marker) in ((1, (BLUE, "o")), (3, (ORANGE, "s"))):
                numbers = [float(printed[k]) for _, _, _, printed in chosen]
                ax.plot(shares, numbers, marker, markerfacecolor="none", color=colour, markersize=11)
            ax.set_title(f"{family}, {interpolation} interpolated")
            ax.grid(color="0.9")
        axes[row, 0].set_ylabel("MSE of the state")
    axes[0, 1].plot([], [], "o", markerfacecolor="none", color="0.4", markersize=11, label="printed")
    axes[0, 1].legend()
    for ax in axes[1]:
        ax.set_xlabel("hard values (%)")
    return figure


HARD_FRACTION = Experiment(
    name="hard-fraction",
    paper="2020",
    reproduces="Table I: errors by share of hard values",
    runs=100,
    quick_runs=20,
    pieces={
        f"{family} {share} % {interpolation}": {
            "family": family,
            "parameters": parameters,
            "interpolation": interpolation,
            "n": 1000,
            "n_nodes": _TABLE_NODES[family],
            "most_learned": 5,
        }
        for interpolation in _INTERPOLATIONS
        for family, share, parameters, _ in _COLUMNS
    },
    run=_restore_column,
    assess=_assess_table,
    draw=_draw_table,
)
