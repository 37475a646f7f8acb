"""The interactive picture of a report: state and switch, every method to be switched on and off."""

from __future__ import annotations

import html
import json
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Restoration
    from fuzzykf.comparison.run import Comparison

__all__ = ["Layer", "Picture", "draw", "plotly_script"]

#: Most steps in the picture: a page with more of them is slow on a phone.
MAX_STEPS = 20_000

#: Steps that are shown at first: two weeks of hours.
EXCERPT = 336

#: Colours that colour-blind readers tell apart (Okabe and Ito), and dashes for readers of grey.
_STYLES = (
    ("#0072B2", "solid"),
    ("#D55E00", "dash"),
    ("#009E73", "dashdot"),
    ("#8F4E8B", "dot"),
    ("#7A6A00", "longdash"),
    ("#56B4E9", "longdashdot"),
    ("#B8860B", "dash"),
)
_TRUTH = ("#000000", "solid")


@dataclass(frozen=True)
class Layer:
    """What a reader switches on and off at once: the traces of one method.

    Attributes
    ----------
    name : str
    color : str
    dash : str
        As SVG's stroke-dasharray.
    traces : list of int
        Their numbers in the figure.
    is_shown : bool
        Whether it is there at first.
    """

    name: str
    color: str
    dash: str
    traces: list[int]
    is_shown: bool


@dataclass(frozen=True)
class Picture:
    """A figure of plotly as JSON, without the abscissa, which all traces share.

    Attributes
    ----------
    figure : str
        Traces and layout.
    x : str
        The abscissa, JSON.
    layers : tuple of Layer
    begin, end : int
        The steps shown at first: of the abscissa, the last one not included.
    first, n_steps, n_all : int
        The first step in the picture, how many there are in it, and how many were compared.
    """

    figure: str
    x: str
    layers: tuple[Layer, ...]
    begin: int
    end: int
    first: int
    n_steps: int
    n_all: int


def plotly_script() -> str:
    """Return the source of plotly.js.

    Raises
    ------
    MissingDependencyError
        If plotly is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise MissingDependencyError("a report needs plotly: pip install 'fuzzykf[report]'") from error
    script: str = get_plotlyjs()
    return script


def draw(comparison: Comparison, *, state_label: str, unit: str) -> Picture:
    """Draw state and switch of all methods.

    Parameters
    ----------
    comparison : Comparison
    state_label, unit : str
        What the state is, and its unit; may hold any characters.
    """
    import plotly.graph_objects as go

    task = comparison.task
    n = task.n_test
    first = max(0, (n - MAX_STEPS) // 2)
    part = slice(first, min(n, first + MAX_STEPS))
    traces: list[Any] = []
    layers: list[Layer] = []

    def add(name: str, style: tuple[str, str], is_shown: bool, lines: list[Any]) -> None:
        numbers = list(range(len(traces), len(traces) + len(lines)))
        layers.append(Layer(name, style[0], _DASHES[style[1]], numbers, is_shown))
        for line in lines:
            line.visible = is_shown
        traces.extend(lines)

    add("measured", _TRUTH, True, [_line(comparison.truth[part], "measured", _TRUTH)])
    shown = _shown_at_first(comparison)
    for k, one in enumerate(comparison.restorations):
        style = _STYLES[k % len(_STYLES)]
        add(one.title, style, one.name in shown, _method(one, style, part))
    if task.switch is not None:
        rule, style = task.switch[task.n_train :][part], ("#555555", "dot")
        name = "switch of the rule (not seen by the methods)"
        add(name, style, True, [_line(rule, "rule", style, axis="y2")])
    n_steps = part.stop - part.start
    rows = slice(task.n_train + part.start, task.n_train + part.stop)
    x = range(rows.start, rows.stop) if task.time is None else np.datetime_as_string(task.time[rows])
    begin = max(0, (n_steps - EXCERPT) // 2)
    end = min(n_steps, begin + EXCERPT)
    label = f"{state_label} ({unit})" if unit else state_label
    figure = go.Figure(traces, _layout(label, task.time is None, any(t.yaxis == "y2" for t in traces)))
    return Picture(
        figure=figure.to_json(),
        x=json.dumps(list(x)),
        layers=tuple(layers),
        begin=begin,
        end=end,
        first=first,
        n_steps=n_steps,
        n_all=n,
    )


def _shown_at_first(comparison: Comparison) -> set[str]:
    """Return the best two, and the first method (the fuzzy filter) in any case."""
    return {comparison.best, comparison.second, comparison.restorations[0].name}


_DASHES = {
    "solid": "",
    "dash": "7 4",
    "dot": "2 3",
    "dashdot": "7 3 2 3",
    "longdash": "12 4",
    "longdashdot": "12 3 2 3",
}


def _method(restoration: Restoration, style: tuple[str, str], part: slice) -> list[Any]:
    lower, upper = (end[part] for end in restoration.interval(0.9))
    name = restoration.title
    edge: dict[str, Any] = {"line": {"width": 0}, "hoverinfo": "skip"}
    found = [
        _line(lower, name, style, **edge),
        _line(upper, name, style, fill="tonexty", fillcolor=_translucent(style[0]), **edge),
        _line(restoration.mean[part], name, style),
    ]
    if restoration.switch is not None:
        found.append(_line(restoration.switch[part], f"{name}, mean", style, axis="y2"))
    return found


def _line(values: FloatArray, name: str, style: tuple[str, str], *, axis: str = "y", **options: Any) -> Any:
    import plotly.graph_objects as go

    line = {"color": style[0], "dash": style[1], "width": 1.6} | options.pop("line", {})
    return go.Scatter(
        y=values.astype(np.float32),
        name=html.escape(name),
        mode="lines",
        line=line,
        xaxis="x",
        yaxis=axis,
        **{"hovertemplate": "%{y:.4g}", **options} if "hoverinfo" not in options else options,
    )


def _translucent(color: str) -> str:
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.16)"


def _layout(label: str, is_row: bool, has_switch: bool) -> dict[str, Any]:
    grid = {"gridcolor": "#e4e4e4", "zeroline": False, "ticks": "outside", "tickcolor": "#999999"}
    title = "<br>".join(html.escape(line) for line in textwrap.wrap(label, 32))
    layout: dict[str, Any] = {
        "template": "none",
        "showlegend": False,
        "hovermode": "x unified",
        "margin": {"l": 60, "r": 12, "t": 12, "b": 48},
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#222222"},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "xaxis": grid
        | {"anchor": "y2" if has_switch else "y", "tickangle": 0}
        | ({"title": {"text": "row"}} if is_row else {"type": "date"}),
        "yaxis": grid
        | {"title": {"text": title, "standoff": 6}, "domain": [0.32, 1.0] if has_switch else [0.0, 1.0]},
    }
    if has_switch:
        layout["yaxis2"] = grid | {
            "title": {"text": "switch", "standoff": 6},
            "domain": [0.0, 0.26],
            "range": [-0.05, 1.05],
            "tickvals": [0, 0.5, 1],
            "fixedrange": True,
        }
    return layout
