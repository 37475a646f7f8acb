"""The picture of a filtered series, the switch at its foot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief, is_whole
from fuzzykf.observations import check_aligned, index_of
from fuzzykf.plotting.style import BLUE, STRIP, TRUTH, axes_or_new, date_axis, shades_of
from fuzzykf.times import has_durations, has_times, read_times, written_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray, Numbers
    from fuzzykf.results import FilterResult

__all__ = ["plot_result"]

#: Share of the height that the strip of the switch takes, below the axis of time.
_STRIP_HEIGHT = 0.05

#: The same for the weights of more than two classes, which lie on one another there.
_AREAS_HEIGHT = 0.22

#: Most classes that the bar beside the picture numbers one by one.
_MOST_NUMBERED = 12

#: Share of the height that is kept free for the legend, above what is drawn.
_LEGEND_HEIGHT = 0.16


def plot_result(
    result: FilterResult,
    ax: Axes | None = None,
    *,
    component: int = 0,
    level: float = 0.9,
    truth: Numbers | None = None,
    label: str = "state",
    unit: str = "",
) -> Axes:
    """Draw one component of the state with an interval, and the switch as a shaded strip.

    For a fuzzy switch between more than two classes, the strip shows stacked class weights, class 0 at the
    bottom.

    Parameters
    ----------
    result : FilterResult
        Result of a single series.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    component : int
        Index of the component of the state.
    level : float
        Nominal coverage of the interval.  If the result has finite bounds of the state, as from a
        possibilistic filter with bounded memberships, these are drawn instead.
    truth : array_like, shape (n,) or (n, dim_x), optional
        True state; missing values (NaN, None, masked) are not drawn.  With an index, it is matched to that of
        the result and must contain all its rows; an array is matched by position.
    label, unit : str
        Label and unit of the state.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ParameterError, ShapeError
        If the result holds many series, or has no such component; if ``truth`` has another length or index.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FilterResult
    >>> result = FilterResult(x=np.zeros((20, 1)), P=np.ones((20, 1, 1)))
    >>> plot_result(result, label="level", unit="m").get_ylabel()
    'level (m)'
    """
    if result.x is None or result.P is None:
        raise ParameterError("result: holds no x and P, which the picture shows")
    if result.x.ndim != 2:
        raise ParameterError(
            f"result: holds many series (x has shape {result.x.shape}); select one: result.one(name)"
        )
    n, m = result.x.shape
    if not is_whole(component) or not -m <= component < m:
        raise ParameterError(
            f"component: got {brief(component)}, expected one of {m} components, 0 to {m - 1}"
        )
    known = None if truth is None else as_numbers("truth", truth)
    if known is not None:
        rows = _rows_of(truth, result.index)
        known = known if rows is None or known.ndim == 0 else known[rows]
        if known.shape not in {(n,), (n, m)}:
            raise ShapeError(f"truth: got shape {known.shape}, expected ({n},) or ({n}, {m})")
        known = known if known.ndim == 1 else known[:, component]
    lower, upper = result.bounds(level)
    name = f"{100 * level:g} % band"
    if result.lower is not None and np.isfinite([result.lower, result.upper]).all():
        lower, upper, name = result.lower, result.upper, "possible"
    axes = axes_or_new(ax)
    time, name_of_time, dated = _abscissa(result.index, n)
    axes.fill_between(
        time,
        lower[:, component],
        upper[:, component],
        color=BLUE,
        alpha=0.25,
        linewidth=0,
        label=name,
    )
    if known is not None:
        axes.plot(time, known, color=TRUTH, linewidth=0.9, linestyle=":", label="true")
    axes.plot(time, result.x[:, component], color=BLUE, linewidth=1.4, label="estimate")
    axes.set_ylabel(f"{label} ({unit})" if unit else label)
    axes.set_xlabel(name_of_time)
    if dated:
        date_axis(axes)
    axes.margins(x=0)
    if result.switch_mean is not None:
        _strip(axes, time, result)
    elif result.class_weights is not None:
        _areas(axes, time, result.class_weights)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + _LEGEND_HEIGHT * (high - low))
    axes.legend(loc="upper right", fontsize="small", ncols=3, frameon=False)
    return axes


def _rows_of(truth: Any, index: Any) -> Any:
    """Return where the rows of a result stand in a truth; None if both go together as they are.

    Raises
    ------
    ParameterError
        If both have an index, and that of the truth lacks rows, or has as many in another order.
    """
    there = index_of(truth)
    if not hasattr(there, "equals") or not hasattr(index, "equals") or there.equals(index):
        return None
    if there.is_unique and len(there) >= len(index):
        rows = there.get_indexer(index)
        in_order = np.array_equal(rows, np.arange(len(there)))  # of another type, such as another unit
        if (rows >= 0).all() and (in_order or len(there) > len(index)):
            return rows
    check_aligned(result=index.to_series(), truth=truth)
    return None


def _abscissa(index: Any, n: int) -> tuple[Any, str, bool]:
    """Return what a picture is drawn against, what it is called, and whether it is made of times."""
    if index is None:
        return np.arange(n), "step", False
    name = str(getattr(index, "name", None) or "time")
    values: Any = np.asarray(index)
    entries = index if hasattr(index, "dtype") else values
    times = read_times(entries, gaps=True, ordered=False) if has_times(entries) else written_times(entries)
    if times is not None:
        return times.instant, f"{name} (UTC)" if times.has_offsets else name, True
    if has_durations(entries):
        spans = values.astype("timedelta64[ns]")
        unit, written = next(
            (pair for pair in _UNITS.items() if np.ptp(spans) >= 3 * _span(pair[0])), ("ns", "ns")
        )
        return spans / _span(unit), f"{name} ({written})", False
    return values, name, False


def _span(unit: str) -> Any:
    return np.array(1, dtype=f"timedelta64[{unit}]")


#: Units of durations, as NumPy has them and as they are written.
_UNITS = {"D": "days", "h": "h", "m": "min", "s": "s", "ms": "ms", "us": "µs"}


def _strip(axes: Axes, time: Any, result: FilterResult) -> None:
    """Shade the posterior mean of the switch in a strip at the foot of the axes."""
    assert result.switch_mean is not None
    top = 1.0 if result.nodes is None else float(np.max(result.nodes))
    low, high = axes.get_ylim()
    foot = low - _STRIP_HEIGHT * 1.6 * (high - low)
    edges = np.array([foot, foot + _STRIP_HEIGHT * (high - low)])
    image = axes.imshow(
        result.switch_mean[None, :],
        aspect="auto",
        cmap=STRIP,
        vmin=0.0,
        vmax=max(top, 1e-300),
        extent=(*_ends(axes, time), *edges),
        interpolation="nearest",
        zorder=0,
    )
    axes.set_ylim(foot, high)
    bar = axes.figure.colorbar(image, ax=axes, pad=0.01, fraction=0.05)
    bar.set_label("switch (strip)")


def _areas(axes: Axes, time: Any, weights: FloatArray) -> None:
    """Draw class weights (n, K) as stacked areas in a strip at the foot of the axes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    K = weights.shape[1]
    low, high = axes.get_ylim()
    height = _AREAS_HEIGHT * (high - low)
    foot = low - 1.1 * height
    above = np.cumsum(weights, axis=1)
    above[:, -1] = 1.0  # the sum, whatever rounding has left of it
    below = np.column_stack([np.zeros(len(weights)), above[:, :-1]])
    shades = shades_of(K)
    for k in range(K):
        axes.fill_between(
            time, foot + height * below[:, k], foot + height * above[:, k], color=shades[k], linewidth=0
        )
    axes.axhline(foot + height, color="black", linewidth=0.6)
    axes.set_ylim(foot, high)
    scale = ScalarMappable(BoundaryNorm(np.arange(K + 1) - 0.5, K), ListedColormap(shades))
    numbers = range(0, K, -(-K // _MOST_NUMBERED))
    bar = axes.figure.colorbar(scale, ax=axes, pad=0.01, fraction=0.05, ticks=numbers)
    bar.set_label("class (areas at the foot)")


def _ends(axes: Axes, time: Any) -> tuple[float, float]:
    """Return where the strip begins and ends, in the units of the axis."""
    numbers = axes.xaxis.convert_units(time)  # type: ignore[no-untyped-call]
    return float(numbers[0]), float(numbers[-1])
