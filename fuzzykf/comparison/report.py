"""A comparison as one page: the table, an interactive picture, the settings; it needs no network."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any

from fuzzykf.comparison.report_picture import draw, plotly_script
from fuzzykf.comparison.wording import (
    about_choices,
    about_failures,
    about_intervals,
    about_task,
    cells,
    labels,
)
from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.comparison.run import Comparison
    from fuzzykf.comparison.scores import Score

__all__ = ["check_installed", "report_page"]


def check_installed() -> None:
    """Refuse, before any work is done, to make a report without what it needs.

    Raises
    ------
    MissingDependencyError
        If jinja2 or plotly is not installed.
    """
    _template()
    plotly_script()


def report_page(
    comparison: Comparison,
    *,
    title: str = "comparison",
    state_label: str = "state",
    unit: str = "",
    settings: Mapping[str, str] | None = None,
) -> str:
    """Return a comparison as a self-contained HTML page.

    Parameters
    ----------
    comparison : Comparison
    title : str
        Title of the page.
    state_label, unit : str
        Name and unit of the state.
    settings : mapping of str to str, optional
        Settings of the comparison, for the last section.

    Returns
    -------
    str
        HTML, to be written as UTF-8; 5 MB, mostly plotly.js.

    Raises
    ------
    MissingDependencyError
        If jinja2 or plotly is not installed.

    Notes
    -----
    All text is escaped, and the Content-Security-Policy of the page forbids loading anything.
    """
    page: str = _template().render(
        title=title,
        state_label=state_label,
        unit=unit,
        verdict=comparison.verdict(unit),
        is_certain=comparison.is_certain,
        about_task=about_task(comparison, unit),
        about_intervals=about_intervals(comparison),
        labels=[label.replace("\n", " ") for label in labels(unit)],
        choices=(*about_failures(comparison), *about_choices(comparison)),
        best=comparison.ranked[0].title,
        rows=[{"name": s.title, "cells": cells(s), "bar": bar} for s, bar in _bars(comparison)],
        baseline=_Scale(comparison).place(comparison.baseline_rmse),
        baseline_rmse=f"{comparison.baseline_rmse:.4g}",
        picture=draw(comparison, state_label=state_label, unit=unit),
        settings=dict(settings or {}),
        plotly=plotly_script(),
    )
    return page


def _template() -> Any:
    try:
        import jinja2
    except ImportError as error:
        raise MissingDependencyError("a report needs jinja2: pip install 'fuzzykf[report]'") from error
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["as_json"] = _as_json
    return environment.from_string(resources.files(__package__).joinpath("report.html").read_text("utf-8"))


def _as_json(text: str) -> Any:
    """Return JSON as a script may hold it: nothing in it ends the script."""
    from markupsafe import Markup

    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


class _Scale:
    """Where an RMSE lies in a bar of width 100."""

    def __init__(self, comparison: Comparison) -> None:
        ends = [comparison.baseline_rmse]
        ends += [end for s in comparison.scores for end in (s.rmse_low, s.rmse_high)]
        self.low, self.high = min(ends), max(ends)

    def place(self, value: float) -> float:
        """Return the place of a value, with two units of room at either end."""
        width = self.high - self.low
        return round(2.0 + 96.0 * (value - self.low) / width, 2) if width > 0.0 else 50.0


def _bars(comparison: Comparison) -> list[tuple[Score, dict[str, float]]]:
    scale = _Scale(comparison)
    return [
        (s, {key: scale.place(getattr(s, key)) for key in ("rmse_low", "rmse", "rmse_high")})
        for s in comparison.scores
    ]
