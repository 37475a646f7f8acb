"""The picture of a comparison of methods."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fuzzykf.comparison import Comparison, Restoration

__all__ = ["plot_comparison"]


def plot_comparison(
    comparison: Comparison, *, state_label: str = "state", unit: str = "", steps: int = 336
) -> Figure:
    """Plot the two methods of least error: all test rows, an excerpt with intervals, and the switch.

    The intervals of 90 % are those of the best method.  The switch is that of the two best that have one.

    Parameters
    ----------
    comparison : Comparison
    state_label : str
        Name of the state.
    unit : str
        Unit of the state.
    steps : int
        Number of steps of the excerpt, from the middle.

    Returns
    -------
    matplotlib.figure.Figure
        Not registered with pyplot, so it need not be closed.

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ParameterError
        If ``steps`` is less than 2.
    """
    from fuzzykf.plotting.style import date_axis, figure_class

    if steps < 2:
        raise ParameterError(f"steps: got {steps}, expected at least 2")
    task = comparison.task
    truth = comparison.truth
    n = len(truth)
    time: Any = np.arange(task.n_train, len(task.state)) if task.time is None else task.time[task.n_train :]
    begin = max(0, (n - steps) // 2)
    excerpt = slice(begin, min(n, begin + steps))

    figure = figure_class()(figsize=(9.0, 8.0), layout="constrained")
    whole, state, switch = figure.subplots(3, 1, height_ratios=[2, 3, 2])
    by_name = {one.name: one for one in comparison.restorations}
    ranked = [by_name[one.name] for one in comparison.ranked]
    label = textwrap.fill(f"{state_label} ({unit})" if unit else state_label, 24)

    _draw_state(whole, time, truth, ranked, band=False)
    if n > steps:
        whole.axvspan(time[excerpt][0], time[excerpt][-1], color="0.88", zorder=0, label="shown below")
    whole.set(ylabel=label, title="Test rows")
    _draw_state(state, time[excerpt], truth[excerpt], ranked, band=True, part=excerpt)
    state.set(ylabel=label)
    _draw_switch(switch, comparison, ranked, time, excerpt)
    state.sharex(switch)
    state.tick_params(labelbottom=False)
    switch.set(ylabel="switch", ylim=(-0.05, 1.05), xlabel="row" if task.time is None else "time")
    for axes in (whole, state, switch):
        axes.margins(x=0)
        axes.grid(color="0.9")
        axes.set_axisbelow(True)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")
        if task.time is not None:
            date_axis(axes)
    figure.align_ylabels()
    return figure


def _draw_state(
    axes: Axes,
    time: Any,
    truth: Any,
    ranked: Sequence[Restoration],
    *,
    band: bool,
    part: slice = slice(None),
) -> None:
    from fuzzykf.plotting.style import BLUE, ORANGE, TRUTH

    main, rival = ranked[:2]
    if band:
        lower, upper = (end[part] for end in main.interval(0.9))
        axes.fill_between(time, lower, upper, color=BLUE, alpha=0.2, linewidth=0, label=f"{main.title}, 90 %")
    axes.plot(time, truth, color=TRUTH, linewidth=0.9, label="measured")
    axes.plot(time, rival.mean[part], color=ORANGE, linewidth=1.1, linestyle=(0, (4, 1.5)), label=rival.title)
    axes.plot(time, main.mean[part], color=BLUE, linewidth=1.5, label=main.title)


def _draw_switch(
    axes: Axes, comparison: Comparison, ranked: Sequence[Restoration], time: Any, excerpt: slice
) -> None:
    from fuzzykf.plotting.style import BLUE, ORANGE, TRUTH

    task = comparison.task
    if task.switch is not None:
        axes.plot(
            time[excerpt],
            task.switch[task.n_train :][excerpt],
            color=TRUTH,
            linewidth=0.9,
            linestyle=":",
            label="switch of the rule\n(not seen by the methods)",
        )
    styles = [(BLUE, "-", 1.5), (ORANGE, (0, (1.5, 1)), 1.1)]
    with_switch = [r for r in ranked if r.switch is not None]
    for (color, style, width), restoration in zip(styles, with_switch, strict=False):
        axes.plot(
            time[excerpt],
            restoration.switch[excerpt],  # type: ignore[index]
            color=color,
            linestyle=style,
            linewidth=width,
            label=f"{restoration.title},\nposterior mean",
        )
