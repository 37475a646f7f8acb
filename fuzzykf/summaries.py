"""What a fit found, as text and as a table for notebooks."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fuzzykf.reprs import WIDTH, cut, html_table, reprs, shown, shown_html, text_table
from fuzzykf.texts import printable

__all__ = ["FitSummary", "SummaryTable", "summarise_fit"]

#: Warnings that a repr has room for.
MOST_WARNINGS = 8

#: Rows of a table that a repr has room for above warnings.
MOST_ROWS = 10

#: Components whose means have room beside one another.
MOST_MEANS = 5


@reprs()
class SummaryTable(NamedTuple):
    """Table of a `FitSummary`.

    Attributes
    ----------
    title : str
    header : tuple of str
    rows : tuple of tuple of str

    Examples
    --------
    >>> from fuzzykf.summaries import SummaryTable
    >>> SummaryTable("Regimes", ("regime", "share"), (("0", "0.7"), ("1", "0.3"))).header
    ('regime', 'share')
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, repr=False)
class FitSummary:
    """Summary of a fit, from `FitResult.summary`; it prints as plain text.

    Attributes
    ----------
    title : str
    facts : tuple of (str, str)
        Model, data and quality of fit, as pairs of label and text.
    tables : tuple of SummaryTable
        Tables of the parameters.
    warnings : tuple of str
        Parts of the model that the data do not support.
    warnings_last : bool
        Whether the warnings are printed below the tables.

    Examples
    --------
    >>> from fuzzykf import KalmanFilter
    >>> kf = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], P=0.0, Q=0.0)
    >>> fit = kf.fit([2.0, -2.0] * 100, free={"R": "full"})
    >>> fit.summary().tables[0].header[0]
    'parameter'
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    tables: tuple[SummaryTable, ...]
    warnings: tuple[str, ...]
    warnings_last: bool = False

    def __str__(self) -> str:
        """All of it, however many regimes there are."""
        return self._text(self.tables, self.warnings)

    def _text(self, tables: tuple[SummaryTable, ...], warnings: tuple[str, ...]) -> str:
        width = max((len(name) for name, _ in self.facts), default=0)
        lines = [self.title]
        for name, value in self.facts:
            lines += _wrapped(f"  {name.ljust(width)}  ", value)
        below = [line for table in tables for line in (table.title, *text_table(table.header, table.rows))]
        noted = ["warnings"] if warnings else []
        for warning in warnings:
            noted += _wrapped("  - ", warning)
        return "\n".join([*lines, *(below + noted if self.warnings_last else noted + below)])

    @shown
    def __repr__(self) -> str:
        warnings = [cut(one, 4 * WIDTH) for one in self.warnings[:MOST_WARNINGS]]
        more = len(self.warnings) - MOST_WARNINGS
        tables = tuple(_shortened(one) for one in self.tables) if self.warnings_last else self.tables
        return self._text(tables, (*warnings, *([f"and {more} more"] if more > 0 else [])))

    @shown_html
    def _repr_html_(self) -> str:
        notes = [f"warning: {one}" for one in self.warnings]
        tables = [html_table(*table) for table in self.tables]
        if self.warnings_last and tables:
            head, last = html_table(self.title, (), self.facts), html_table(*self.tables[-1], notes)
            return "\n".join([head, *tables[:-1], last])
        return "\n".join([html_table(self.title, (), self.facts, notes), *tables])


def _shortened(table: SummaryTable) -> SummaryTable:
    """Return a table with the rows that a repr has room for, if warnings are to follow."""
    more = len(table.rows) - MOST_ROWS
    if more <= 0:
        return table
    return table._replace(title=f"{table.title} ({more} more: see summary())", rows=table.rows[:MOST_ROWS])


def _wrapped(begin: str, text: str) -> list[str]:
    text = printable(text)
    return textwrap.wrap(text, WIDTH, initial_indent=begin, subsequent_indent=" " * len(begin)) or [begin]


def summarise_fit(fit: Any) -> FitSummary:
    """Return the summary of a fit, a `fuzzykf.results.FitResult` of any model.

    What a model has no word for is left out: `named_parameters`, `regime_means`, `describe_switch`.
    """
    model = fit.model
    named = model.named_parameters() if hasattr(model, "named_parameters") else {}
    rows = tuple((name, _number(value)) for name, value in named.items())
    law = [SummaryTable("law of the switch", ("parameter", "value"), rows)] if rows else []
    return FitSummary(
        title=f"{type(model).__name__}, learned",
        facts=(*_about_model(fit), *_about_data(fit), *_about_search(fit)),
        tables=(*law, *_regimes(fit)),
        warnings=tuple(fit.warnings),
    )


def _number(value: float) -> str:
    return f"{value:.5g}"


def _about_model(fit: Any) -> list[tuple[str, str]]:
    model = fit.model
    facts = []
    if hasattr(model, "describe_switch"):
        facts.append(("switch", model.describe_switch()))
    if hasattr(model, "n_classes"):
        facts.append(("regimes", str(model.n_classes)))
    if hasattr(model, "labels"):
        facts += model.labels.facts(model.dim_x, model.dim_z)
    else:
        for name, attribute in (
            ("components of the state", "dim_x"),
            ("components of an observation", "dim_z"),
        ):
            if hasattr(model, attribute):
                facts.append((name, str(getattr(model, attribute))))
    if hasattr(model, "form"):
        others = [f"{kind} {value:.1f}" for kind, value in fit.bic_of_forms.items()]
        facts.append(("form", model.form.kind + (f" (BIC: {', '.join(others)})" if len(others) > 1 else "")))
    return facts


def _about_data(fit: Any) -> list[tuple[str, str]]:
    given = fit.n_observations if fit.class_weights is None else len(fit.class_weights)
    left_out = given - fit.n_observations
    return [
        ("rows used", f"{fit.n_observations:,}"),
        ("rows left out", f"{left_out:,}" + (", in which something is missing" if left_out else "")),
    ]


def _about_search(fit: Any) -> list[tuple[str, str]]:
    iterations = len(fit.trace) - 1
    return [
        *_about_training(fit),
        ("log-likelihood", f"{fit.log_likelihood:.3f}"),
        ("parameters", str(fit.n_parameters)),
        ("AIC", f"{fit.aic:.3f}"),
        ("BIC", f"{fit.bic:.3f}"),
        ("converged", "yes" if fit.converged else "no"),
        ("iterations", str(iterations) if iterations > 0 else "none, the switch was given"),
    ]


def _about_training(fit: Any) -> list[tuple[str, str]]:
    """Return which fit was kept of those for the filter and for the joint likelihood, and their scores."""
    training = getattr(fit, "training", None)
    if training is None:
        return []
    kept, after = f"kept the {training.kept} fit", f" after {training.n_iterations} iterations"
    widened = f", state noise widened {training.inflation:g} times" if training.inflation > 1.0 else ""
    scores = (
        f"filter fit {training.score_filter:.3f}{after}{widened}, joint fit {training.score_joint:.3f} "
        f"(standard error of the difference {training.standard_error:.2g}); mean over "
        f"{training.n_kept_back:,} validation states"
    )
    return [("objective", f"filter; {kept}"), ("log score of the state", scores)]


def _names(model: Any, which: str, letter: str, size: int) -> list[str]:
    """Return the names of components with their units, as far as the model knows them."""
    labels: Any = getattr(model, "labels", None)
    names = getattr(labels, which, None)
    return [f"{letter}[{k}]" for k in range(size)] if names is None else [*map(labels.with_unit, names)]


def _all_names(model: Any) -> list[str]:
    """Return the names of all components; a state and an observation of one name say which they are."""
    states = _names(model, "states", "x", model.dim_x)
    observations = _names(model, "observations", "y", model.dim_z)
    both = set(states) & set(observations)
    return [
        f"{word} {name}" if name in both else name
        for word, names in (("state", states), ("observation", observations))
        for name in names
    ]


def _regimes(fit: Any) -> list[SummaryTable]:
    """Return the table of the regimes: how much of the data they have, and the means of x and y there."""
    model = fit.model
    if fit.occupancy is None or not hasattr(model, "regime_means"):
        return []
    components = _all_names(model)
    header = ("regime", "share of the rows", *(f"mean of {one}" for one in components[:MOST_MEANS]))
    means = np.asarray(model.regime_means())
    rows = tuple(
        (str(k), f"{share:.3f}", *map(_number, row[:MOST_MEANS]))
        for k, (share, row) in enumerate(zip(fit.occupancy, means, strict=True))
    )
    more = len(components) - MOST_MEANS
    title = "regimes" + (f" (means of {more} more components: see model.regime_means())" if more > 0 else "")
    return [SummaryTable(title, header, rows)]
