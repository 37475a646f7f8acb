"""Pictures of what measurements show of a state, and of where noise takes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ShapeError
from fuzzykf.plotting.style import BLUE, ORANGE, TRUTH, axes_or_new

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from fuzzykf.possibility.observing import Controllability, Observability

__all__ = ["plot_widths"]

#: How components are told apart, in colour and in print.
_LINES = [(BLUE, "-"), (ORANGE, "--"), (TRUTH, ":"), (BLUE, "-."), (ORANGE, ":")]


def plot_widths(
    result: Observability | Controllability,
    ax: Axes | None = None,
    *,
    label: str | Sequence[str] | None = None,
    unit: str | Sequence[str] = "",
) -> Axes:
    """Draw the widths of each component over the number of measurements, or of predictions.

    Parameters
    ----------
    result : Observability or Controllability
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    label, unit : str or sequence of str
        Of the components.

    Returns
    -------
    matplotlib.axes.Axes
        Widths that nothing bounds have no line; the legend says so.

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ShapeError
        Another number of labels than components.

    Examples
    --------
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.possibility import observability
    >>> est = FuzzyRelationEstimator(1, 1)
    >>> est.H = 1.0
    >>> axes = plot_widths(observability(est, 10), label="altitude", unit="m")
    >>> axes.get_xlabel(), axes.get_ylabel()
    ('measurements', 'undecided at level 0.5')
    """
    n, m = result.widths.shape
    names = (
        [f"x{k}" for k in range(m)] if label is None else [label] if isinstance(label, str) else list(label)
    )
    units = [unit] * m if isinstance(unit, str) else list(unit)
    for name, given in (("label", names), ("unit", units)):
        if len(given) != m:
            raise ShapeError(f"{name}: got {len(given)}, expected {m}, one for each component")
    axes = axes_or_new(ax, figsize=(6.0, 3.5))
    from matplotlib.ticker import MaxNLocator  # it is there, or the axes would not be

    count = np.arange(1, n + 1)
    for k in range(m):
        colour, dashes = _LINES[k % len(_LINES)]
        bounded = np.isfinite(result.widths[:, k])
        text = f"{names[k]} ({units[k]})" if units[k] else names[k]
        text += "" if bounded.any() else ": not bounded"
        axes.plot(
            count[bounded], result.widths[bounded, k], color=colour, linestyle=dashes, marker=".", label=text
        )
    axes.set_xlim(0.5, n + 0.5)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(result.counted)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel(f"{result.meaning} at level {result.level:g}")
    axes.legend(fontsize="small", framealpha=0.8)
    return axes
