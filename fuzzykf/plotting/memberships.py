"""Pictures of membership functions, and of what a fuzzy estimator knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers
from fuzzykf.plotting.style import BLUE, SURFACE, TRUTH, axes_or_new
from fuzzykf.possibility.memberships import GridMembership, Membership
from fuzzykf.possibility.memberships.base import as_level, as_vector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.estimator import FuzzyRelationEstimator

__all__ = ["plot_estimate", "plot_membership"]

#: Nodes per axis of a picture, by number of dimensions.
_NODES = {1: 401, 2: 201}

#: Margin around the support, and width of a component without any, as parts of the picture.
_MARGIN, _THIN = 0.05, 0.02


def plot_membership(
    membership: Membership,
    ax: Axes | None = None,
    *,
    components: Sequence[int] | None = None,
    level: float = 0.01,
    estimate: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    label: str | Sequence[str] | None = None,
    unit: str | Sequence[str] = "",
) -> Axes:
    """Draw a membership: a curve in one dimension, a heat map in two.

    Parameters
    ----------
    membership : Membership
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.
    components : sequence of int, optional
        One or two components, in increasing order; the plot shows the supremum over the others.  By default
        all.
    level : float
        Smallest membership in the plot.
    estimate, truth : array_like, shape (dim,) or (dim, 1), optional
        Points to mark.
    label, unit : str or sequence of str
        Labels and units of the components.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ParameterError, ShapeError
        If there are more than two dimensions, a component does not exist, the level is outside ]0, 1], or the
        dimension of points or number of labels is wrong.

    Examples
    --------
    >>> from fuzzykf import GaussianMembership
    >>> axes = plot_membership(GaussianMembership(0.0, 1.0), label="altitude", unit="m")
    >>> axes.get_xlabel(), axes.get_ylabel()
    ('altitude (m)', 'membership')
    """
    kept = _checked_components(components, membership.dim)
    level = as_level("level", level)
    marks = {
        name: as_vector(name, np.ravel(as_numbers(name, point)), membership.dim)[kept]
        for name, point in (("estimate", estimate), ("truth", truth))
        if point is not None
    }
    labels = _labels(label, unit, kept, membership.dim)
    drawn = membership.project(kept)
    axes = axes_or_new(ax, figsize=(6.0, 3.5) if len(kept) == 1 else (6.0, 4.5))
    draw = _draw_curve if len(kept) == 1 else _draw_map
    draw(axes, drawn, _coordinates(drawn, level), marks)
    axes.set_xlabel(labels[0])
    axes.set_ylabel("membership" if len(kept) == 1 else labels[1])
    if marks:
        axes.legend(loc="best" if len(kept) == 1 else "upper right", fontsize="small", framealpha=0.8)
    return axes


def plot_estimate(
    est: FuzzyRelationEstimator,
    ax: Axes | None = None,
    *,
    components: Sequence[int] | None = None,
    level: float = 0.01,
    truth: ArrayLike | None = None,
    label: str | Sequence[str] | None = None,
    unit: str | Sequence[str] = "",
) -> Axes:
    """Draw the membership of a fuzzy estimator, with its estimate.

    Parameters
    ----------
    est : FuzzyRelationEstimator
    ax : matplotlib.axes.Axes, optional
    components : sequence of int, optional
        By default the first two.
    level, truth, label, unit
        See `plot_membership`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError, ParameterError, ShapeError
        See `plot_membership`.

    Examples
    --------
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> plot_estimate(
    ...     FuzzyRelationEstimator(2, 1), label=["position", "velocity"]
    ... ).get_ylabel()
    'velocity'
    """
    return plot_membership(
        est.membership,
        ax,
        components=range(min(est.dim_x, 2)) if components is None else components,
        level=level,
        estimate=est.x,
        truth=truth,
        label="state" if label is None and est.dim_x == 1 else label,
        unit=unit,
    )


def _checked_components(components: Sequence[int] | None, dim: int) -> list[int]:
    """Return the components to draw, after checking them."""
    kept = list(range(dim)) if components is None else [int(k) for k in components]
    if components is None and dim > 2:
        raise ParameterError(
            f"components: got none for a membership of {dim} dimensions, expected one or two of them"
        )
    if not 1 <= len(kept) <= 2 or kept != sorted(set(kept)) or kept[0] < 0 or kept[-1] >= dim:
        raise ParameterError(
            f"components: got {kept}, expected one or two increasing numbers from 0 to {dim - 1}"
        )
    return kept


def _labels(
    label: str | Sequence[str] | None, unit: str | Sequence[str], kept: list[int], dim: int
) -> list[str]:
    """One label per component, with its unit."""
    if label is None:
        label = ["x"] if dim == 1 else [f"$x_{k + 1}$" for k in kept]
    labels = [label] if isinstance(label, str) else list(label)
    units = [unit] * len(kept) if isinstance(unit, str) else list(unit)
    for name, values in (("label", labels), ("unit", units)):
        if len(values) != len(kept):
            raise ShapeError(f"{name}: got {values}, expected one for each of {len(kept)} components")
    return [f"{name} ({u})" if u else name for name, u in zip(labels, units, strict=True)]


def _coordinates(membership: Membership, level: float) -> list[FloatArray]:
    """Where to evaluate, along each axis; a single number where a component is known exactly."""
    lower, upper = membership.support(level)
    axes = []
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        if low == high:
            axes.append(np.array([low]))
            continue
        margin = _MARGIN * (high - low)
        even = np.linspace(low - margin, high + margin, _NODES[membership.dim])
        if membership.dim == 2 and isinstance(membership, GridMembership):
            # The nodes themselves: nothing is invented between them.
            own = membership.axes[k]
            axes.append(own[(own >= low - margin) & (own <= high + margin)])
        elif membership.dim == 1:
            # Jumps at the edges are drawn upright, and peaks reach one.
            edges = [np.nextafter(low, -np.inf), low, membership.peak[k], high, np.nextafter(high, np.inf)]
            own = membership.axes[k] if isinstance(membership, GridMembership) else even
            axes.append(np.unique(np.concatenate([even, edges, own])))
        else:
            axes.append(even)
    return axes


def _draw_curve(
    axes: Axes, membership: Membership, coordinates: list[FloatArray], marks: dict[str, FloatArray]
) -> None:
    x = coordinates[0]
    if x.size == 1:
        axes.vlines(x, 0.0, 1.0, color=BLUE, linewidth=1.4)
    else:
        value = membership(x)
        axes.fill_between(x, 0.0, value, color=BLUE, alpha=0.25, linewidth=0)
        axes.plot(x, value, color=BLUE, linewidth=1.4)
    for name, color, style in (("estimate", BLUE, "--"), ("truth", TRUTH, ":")):
        if name in marks:
            axes.axvline(
                float(marks[name][0]), color=color, linestyle=style, linewidth=1.2, label=_NAMES[name]
            )
    axes.set_ylim(0.0, 1.05)


#: What the marks are called in the legend.
_NAMES = {"estimate": "estimate", "truth": "true"}


def _draw_map(
    axes: Axes, membership: Membership, coordinates: list[FloatArray], marks: dict[str, FloatArray]
) -> None:
    points = np.stack(np.meshgrid(*coordinates, indexing="ij"), axis=-1)
    value = membership(points).T
    edges = _edges(coordinates)
    image = axes.pcolormesh(*edges, value, cmap=SURFACE, vmin=0.0, vmax=1.0, rasterized=True)
    half = min(value.shape) > 1 and value.min() < 0.5 < value.max()
    if half:
        axes.contour(*coordinates, value, levels=[0.5], colors="white", linewidths=0.8, linestyles="--")
    bar = axes.figure.colorbar(image, ax=axes)
    bar.set_label("membership (dashed: 0.5)" if half else "membership")
    for name, coordinate, ends in zip("xy", coordinates, edges, strict=True):
        if coordinate.size == 1:
            axes.set(**{f"{name}lim": (6.0 * ends[0] - 5.0 * ends[1], 6.0 * ends[1] - 5.0 * ends[0])})
    for name, marker, size in (("estimate", "o", 6.0), ("truth", "x", 7.0)):
        if name in marks:
            axes.plot(
                *marks[name],
                marker,
                color="white" if name == "estimate" else TRUTH,
                markeredgecolor=TRUTH,
                markersize=size,
                markeredgewidth=1.5,
                label=_NAMES[name],
            )


def _edges(coordinates: list[FloatArray]) -> list[FloatArray]:
    """Edges of the cells around the nodes; a component known exactly becomes a thin strip."""
    spans = [float(c[-1] - c[0]) for c in coordinates]
    edges = []
    for c in coordinates:
        if c.size == 1:
            half = 0.5 * _THIN * (max(spans) or 1.0)
            edges.append(np.array([c[0] - half, c[0] + half]))
        else:
            middle = 0.5 * (c[1:] + c[:-1])
            edges.append(np.concatenate([[2.0 * c[0] - middle[0]], middle, [2.0 * c[-1] - middle[-1]]]))
    return edges
