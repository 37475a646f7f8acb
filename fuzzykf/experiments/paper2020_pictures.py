"""Figures 2, 3 and 4 of the 2020 paper: densities, trajectories, one restoration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.experiments.core import Experiment, new_figure
from fuzzykf.experiments.paper2020 import (
    CORRECTED,
    FMC1,
    FMC2,
    make_law,
    make_model,
    mean_squared_errors,
    simulate_many,
)
from fuzzykf.experiments.verdicts import Finding, exact, printed_mean
from fuzzykf.plotting import BLUE, ORANGE, TRUTH
from fuzzykf.switching import CGOMSMFilter, KnownSwitchFilter, OFSRFilter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure

    from fuzzykf.experiments.core import Samples

__all__ = ["DENSITIES", "RESTORATION", "TRAJECTORIES"]

_LAWS = {"FMC1": {"parameters": FMC1}, "FMC2": {"parameters": FMC2}}

# --------------------------------------------------------------------------- Figure 2


def _tabulate(rng: np.random.Generator, runs: int, *, parameters: tuple[float, ...], **law: Any) -> Samples:
    """Evaluate the density on a grid; nothing here is random."""
    made = make_law(law["family"], parameters)
    at = np.linspace(0.0, 1.0, law["points"])
    joint = np.asarray(made.joint_density(at[:, None], at))
    return {
        "at": at,
        "joint": joint,
        "beta": np.array(made.beta),
        "p_hard": np.array(made.p_hard),
    }


def _assess_densities(samples: Mapping[str, Samples]) -> list[Finding]:
    printed = {"FMC1": "0.03", "FMC2": "0.0"}
    return [
        *(
            exact(f"{name}: β", printed=beta, ours=float(samples[name]["beta"]))
            for name, beta in printed.items()
        ),
        *(Finding(quantity=f"{name}: p_H", ours=float(values["p_hard"])) for name, values in samples.items()),
    ]


def _draw_densities(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(9.0, 4.2)
    for k, (name, values) in enumerate(samples.items()):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d")
        at, joint = values["at"], values["joint"]
        width = 0.8 * (at[1] - at[0])
        x, y = np.meshgrid(at, at, indexing="ij")
        corner = ((x == 0.0) | (x == 1.0)) & ((y == 0.0) | (y == 1.0))
        # A bar of no height is drawn as nothing: where the density is zero the floor stays bare.
        for mask, colour, label in ((~corner, BLUE, "density"), (corner, ORANGE, "mass (corner)")):
            shown = mask & (joint > 0.0)
            axes.bar3d(
                x[shown] - width / 2,
                y[shown] - width / 2,
                np.zeros(shown.sum()),
                width,
                width,
                joint[shown],
                color=colour,
                edgecolor="white",
                linewidth=0.2,
                label=label,
            )
        axes.set(
            xlabel="$r_1$",
            ylabel="$r_2$",
            title=f"{name}: β = {float(values['beta']):.4f}, $p_H$ = {float(values['p_hard']):.3f}",
        )
        axes.set_zlabel("density or mass", labelpad=10)
        axes.set_box_aspect(None, zoom=0.82)
        axes.legend(loc="upper left", fontsize="small")
    return figure


DENSITIES = Experiment(
    name="densities",
    paper="2020",
    reproduces="Fig. 2: densities of FMC1 and FMC2",
    runs=2,
    quick_runs=2,
    pieces={name: {"family": name, "points": 21} | law for name, law in _LAWS.items()},
    run=_tabulate,
    assess=_assess_densities,
    draw=_draw_densities,
)

# --------------------------------------------------------------------------- Figure 3


def _sample_paths(
    rng: np.random.Generator, runs: int, *, family: str, parameters: tuple[float, ...], n: int
) -> Samples:
    """Draw paths of the switch; shares of hard values, and of fuzzy ones after the value 0."""
    law = make_law(family, parameters)
    paths = np.stack([law.sample(n, rng) for _ in range(runs)])
    hard = (paths == 0.0) | (paths == 1.0)
    from_zero = paths[:, :-1] == 0.0
    into_fuzzy = (from_zero & ~hard[:, 1:]).sum(axis=1) / from_zero.sum(axis=1)
    return {"path": paths[0, :200], "hard": hard.mean(axis=1), "fuzzy_after_zero": into_fuzzy}


def _assess_paths(samples: Mapping[str, Samples]) -> list[Finding]:
    findings = []
    for name, values in samples.items():
        law = make_law(name, _LAWS[name]["parameters"])
        findings.append(
            printed_mean(f"{name}: share of hard values", values["hard"], printed=f"{law.p_hard:.9f}")
        )
        if name == "FMC2":
            alpha, gamma, delta = FMC2
            expected = gamma * delta / (alpha + law.beta + gamma * delta)
            findings.append(
                printed_mean(
                    "FMC2: share of fuzzy values after 0",
                    values["fuzzy_after_zero"],
                    printed=f"{expected:.9f}",
                    correction="γδ/S, printed γ/S",
                )
            )
    return findings


def _draw_paths(samples: Mapping[str, Samples]) -> Figure:
    figure = new_figure(8.0, 4.5)
    axes = figure.subplots(2, 1, sharex=True)
    for ax, (name, values) in zip(axes, samples.items(), strict=True):
        path = values["path"]
        steps = np.arange(len(path))
        hard = (path == 0.0) | (path == 1.0)
        ax.plot(steps, path, color="0.7", linewidth=0.8)
        ax.plot(steps[hard], path[hard], ".", color=ORANGE, markersize=5, label="hard")
        ax.plot(steps[~hard], path[~hard], "x", color=BLUE, markersize=4, label="fuzzy")
        ax.set(ylabel="switch $r_n$", title=f"{name}, first run")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes[-1].set_xlabel("step n")
    return figure


TRAJECTORIES = Experiment(
    name="trajectories",
    paper="2020",
    reproduces="Fig. 3: trajectories of the switch",
    runs=100,
    quick_runs=20,
    pieces={name: {"family": name, "n": 1000} | law for name, law in _LAWS.items()},
    run=_sample_paths,
    assess=_assess_paths,
    draw=_draw_paths,
)

# --------------------------------------------------------------------------- Figure 4

#: Mean squared errors in the captions of Figure 4: of the fuzzy and of the hard filter.
_PRINTED = {"known": ("0.35", "0.75"), "switch": ("0.03", "0.11"), "unknown": ("0.47", "0.54")}
_LABELS = {
    "known": "state, switch known",
    "switch": "switch (MPM)",
    "unknown": "state, switch unknown",
}


def _restore(
    rng: np.random.Generator, runs: int, *, parameters: tuple[float, ...], n: int, n_nodes: int
) -> Samples:
    """Restore series of the FMC2 law with fuzzy and hard filters, told the switch or not."""
    model = make_model(make_law("FMC2", parameters))
    hard = model.harden()
    series = simulate_many(model, runs, n, rng)
    fuzzy = OFSRFilter(model, n_nodes=n_nodes).filter_many(series.y, keep=("x", "switch"))
    crisp = CGOMSMFilter(hard).filter_many(series.y, keep=("x", "switch"))
    # The hard filter that is told the switch is told the nearer of its two values.
    told = KnownSwitchFilter(model).filter_many(series.y, keep=("x",), r=series.r)
    told_hard = KnownSwitchFilter(hard).filter_many(series.y, keep=("x",), r=np.round(series.r))
    shown = int(np.argmax(np.mean(series.r * (1.0 - series.r), axis=1)))  # for the picture
    out: Samples = {"x": series.x[shown], "r": series.r[shown], "shown": np.array(shown)}
    for name, result, known in (("fuzzy", fuzzy, told), ("hard", crisp, told_hard)):
        out |= {
            f"{name}_unknown": mean_squared_errors(result.x, series.x),
            f"{name}_switch": mean_squared_errors(result.switch, series.r),
            f"{name}_known": mean_squared_errors(known.x, series.x),
            f"{name}_x": result.x[shown, :, 0],
            f"{name}_r": result.switch[shown],
            f"{name}_x_known": known.x[shown, :, 0],
        }
    return out


def _assess_restoration(samples: Mapping[str, Samples]) -> list[Finding]:
    values = samples["FMC2"]
    return [
        printed_mean(
            f"{_LABELS[what]}: MSE of the {name} filter",
            values[f"{name}_{what}"],
            printed=_PRINTED[what][k],
            printed_runs=1,
            correction=CORRECTED,
        )
        for what in _PRINTED
        for k, name in enumerate(("fuzzy", "hard"))
    ]


def _draw_restoration(samples: Mapping[str, Samples]) -> Figure:
    values = samples["FMC2"]
    figure = new_figure(8.0, 7.0)
    axes = figure.subplots(3, 1, sharex=True)
    steps = np.arange(len(values["x"]))
    rows = (("x", "x_known", "known"), ("r", "r", "switch"), ("x", "x", "unknown"))
    for ax, (truth, estimate, what) in zip(axes, rows, strict=True):
        ax.plot(steps, values[truth], color=TRUTH, linewidth=1.0, label="simulated")
        ax.plot(steps, values[f"hard_{estimate}"], "--", color=ORANGE, linewidth=1.1, label="hard filter")
        ax.plot(steps, values[f"fuzzy_{estimate}"], color=BLUE, linewidth=1.4, label="fuzzy filter")
        scores = [values[f"{name}_{what}"][values["shown"]] for name in ("fuzzy", "hard")]
        ax.set_title(f"{_LABELS[what]}: MSE {scores[0]:.2f} (fuzzy), {scores[1]:.2f} (hard)")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    figure.suptitle(f"Run {int(values['shown']) + 1}, in which the switch is fuzziest")
    axes[0].set_ylabel("state")
    axes[1].set_ylabel("switch")
    axes[2].set(ylabel="state", xlabel="step n")
    return figure


RESTORATION = Experiment(
    name="restoration",
    paper="2020",
    reproduces="Fig. 4: restoration of a series of FMC2, F = 5",
    runs=200,
    quick_runs=30,
    pieces={"FMC2": {"parameters": FMC2, "n": 80, "n_nodes": 5}},
    run=_restore,
    assess=_assess_restoration,
    draw=_draw_restoration,
)
