"""What all pictures share: colours, and where they are drawn.

The colours are told apart by colour-blind readers (Okabe and Ito), and lines differ
in their dashes as well, so that a print in grey loses nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "ORANGE",
    "STRIP",
    "SURFACE",
    "TRUTH",
    "axes_or_new",
    "date_axis",
    "figure_class",
    "shades_of",
]

#: Colours: of the main estimate, of its rival, and of what is true.
BLUE, ORANGE, TRUTH = "#0072B2", "#D55E00", "#000000"

#: Colour maps whose lightness rises all the way: of strips, and of surfaces.
STRIP, SURFACE = "Greys", "viridis"

#: Most labels of dates on an axis, and on an inch of it; with fewer than five some ranges have no even steps.
MOST_DATES, DATES_PER_INCH, FEWEST_DATES = 8, 1.6, 5

_NEEDED = "pictures need matplotlib: pip install 'fuzzykf[cli]'"


def figure_class() -> type[Figure]:
    """Return matplotlib's figure, which is not registered with pyplot."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(_NEEDED) from error
    return Figure


def shades_of(n_classes: int) -> Any:
    """Return a shade for each class, (K, 4), from light to dark, which are told apart in a print in grey."""
    from matplotlib import colormaps

    return colormaps[STRIP]([0.15 + 0.7 * k / max(n_classes - 1, 1) for k in range(n_classes)])


def axes_or_new(ax: Axes | None, **options: Any) -> Axes:
    """Return the axes given, or those of a new figure of pyplot, which a notebook shows."""
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise MissingDependencyError(_NEEDED) from error
    figure = pyplot.figure(figsize=options.pop("figsize", (8.0, 3.5)), layout="constrained")
    axes: Axes = figure.add_subplot(**options)
    return axes


def date_axis(axes: Axes) -> None:
    """Label an axis of times so that labels do not overlap, unless its owner has chosen labels for it."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    if not (axes.xaxis.isDefault_majloc and axes.xaxis.isDefault_majfmt):
        return
    inches = axes.bbox.width / axes.figure.dpi
    most = min(max(int(DATES_PER_INCH * inches), FEWEST_DATES), MOST_DATES)
    locator = AutoDateLocator(minticks=2, maxticks=most)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
