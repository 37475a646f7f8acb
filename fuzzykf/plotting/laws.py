"""Pictures of laws and of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief, is_whole
from fuzzykf.plotting.style import BLUE, ORANGE, SURFACE, axes_or_new, shades_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.model import SwitchingModel
    from fuzzykf.switching.laws.edges import GraphicLaw
    from fuzzykf.switching.laws.law import FuzzyMarkovLaw

__all__ = ["plot_graph", "plot_law", "plot_model", "plot_path"]

#: Cells per axis in the picture of a density.
_CELLS = 24


def plot_law(law: FuzzyMarkovLaw, ax: Axes | None = None) -> Axes:
    """Draw the joint density of two consecutive values of the switch as bars (figure 2 of the 2020 paper).

    Bars on the edges are densities, those at the corners are masses.

    Parameters
    ----------
    law : FuzzyMarkovLaw
    ax : matplotlib 3-D axes, optional
        By default those of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ParameterError
        If ``ax`` is not three-dimensional.

    Examples
    --------
    >>> from fuzzykf import FuzzyMarkovLaw
    >>> plot_law(FuzzyMarkovLaw.fmc1(0.1, 0.076, 0.21)).get_zlabel()
    'density (corners: mass)'
    """
    axes: Any = axes_or_new(ax, figsize=(6.0, 5.0), projection="3d")
    if not hasattr(axes, "bar3d"):
        raise ParameterError("ax: got flat axes, expected 3-D ones (projection='3d')")
    inner = (np.arange(_CELLS) + 0.5) / _CELLS
    r = np.concatenate([[0.0], inner, [1.0]])
    width = 1.0 / _CELLS
    left = np.concatenate([[-2.0 * width], inner - 0.5 * width, [1.0 + width]])
    density = law.joint_density(r[:, None], r[None, :])
    x, y = np.meshgrid(left, left, indexing="ij")
    shades = _shades(density)
    axes.bar3d(
        x.ravel(), y.ravel(), np.zeros(x.size), width, width, density.ravel(), color=shades, linewidth=0.0
    )
    values = ", ".join(f"{name} = {value:.3g}" for name, value in law.parameters.items())
    title = f"{law.kind.upper()}  {values}" if values else "joint density"
    axes.set(xlabel="$r_n$", ylabel="$r_{n+1}$", zlabel="density (corners: mass)", title=title)
    return axes  # type: ignore[no-any-return]


def _shades(density: Any) -> Any:
    from matplotlib import colormaps

    flat = density.ravel()
    top = float(flat.max()) or 1.0
    return colormaps[SURFACE](0.15 + 0.75 * flat / top)


def plot_graph(law: GraphicLaw, ax: Axes | None = None) -> Axes:
    """Draw a law as a graph, with the classes at the corners of a regular polygon.

    For a `FadeLaw`, solid arrows are fades with rate and mean length, dashed arrows are jumps with their
    probability per step.  For a `GraphLaw`, lines are edges with their mass, dashed lines are jumps with
    their joint probability.

    Parameters
    ----------
    law : FadeLaw or GraphLaw
    ax : matplotlib.axes.Axes, optional
        By default those of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.

    Examples
    --------
    >>> from fuzzykf import FadeLaw
    >>> axes = plot_graph(FadeLaw.between(40, 10))
    >>> [text.get_text() for text in axes.texts]
    ['0.025, 10 steps', '0.025, 10 steps', '0', '1']
    """
    axes = axes_or_new(ax, figsize=(5.0, 4.0))
    from matplotlib.patches import FancyArrowPatch

    corners = _corners(law.n_classes)
    ways: dict[tuple[int, int], int] = {}
    for link in law.links():
        a, b = link.ends if link.directed else sorted(link.ends)
        # each one from a to b is bent more than the last; what has no direction begins with a straight line
        bend = 0.18 * (ways.get((a, b), 0) + 1) if link.directed else 0.35 * ways.get((a, b), 0)
        ways[a, b] = ways.get((a, b), 0) + 1
        color = BLUE if link.gradual else ORANGE
        arrow = FancyArrowPatch(
            corners[a],
            corners[b],
            arrowstyle="-|>" if link.directed else "-",
            connectionstyle=f"arc3,rad={bend}",
            mutation_scale=12,
            shrinkA=14,
            shrinkB=14,
            color=color,
            linestyle="-" if link.gradual else "--",
        )
        axes.add_patch(arrow)
        along = corners[b] - corners[a]
        # the middle of the arc lies half of its bend away from the chord
        middle = (corners[a] + corners[b]) / 2 + 0.5 * bend * np.array([along[1], -along[0]])
        axes.text(
            float(middle[0]),
            float(middle[1]),
            link.text,
            ha="center",
            va="center",
            fontsize="small",
            color=color,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )
    for k, (x, y) in enumerate(corners):
        axes.scatter([x], [y], s=600, facecolor="white", edgecolor="black", zorder=3)
        axes.text(x, y, str(k), ha="center", va="center", zorder=4)
    axes.set(xlim=(-1.4, 1.4), ylim=(-0.8, 0.8) if law.n_classes == 2 else (-1.35, 1.35), aspect="equal")
    axes.set_axis_off()
    return axes


def _corners(K: int) -> FloatArray:
    """Corners of a regular polygon, (K, 2); two classes lie side by side, else class 0 is on top."""
    angle = np.pi * (np.array([1.0, 0.0]) if K == 2 else 0.5 - 2.0 * np.arange(K) / K)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def plot_path(r: ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw values of the switch over time: a line for two classes, stacked class weights for more.

    Parameters
    ----------
    r : array_like, shape (n,) or (n, K)
        Values of the switch in [0, 1], or class weights.
    ax : matplotlib.axes.Axes, optional
        By default those of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ShapeError
        If ``r`` has the wrong shape.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FadeLaw
    >>> plot_path(
    ...     FadeLaw.between(40, 10).sample(200, np.random.default_rng(0))
    ... ).get_ylabel()
    'switch'
    """
    path = as_numbers("r", r)
    if path.ndim not in (1, 2) or not path.size:
        raise ShapeError(f"r: got shape {path.shape}, expected values (n,) or class weights (n, K)")
    axes = axes_or_new(ax, figsize=(8.0, 2.5))
    time = np.arange(len(path))
    if path.ndim == 1:
        axes.plot(time, path, color=BLUE, linewidth=1.0)
        axes.set(ylabel="switch", ylim=(-0.05, 1.05))
    else:
        K = path.shape[1]
        axes.stackplot(time, path.T, colors=shades_of(K), labels=[f"class {k}" for k in range(K)])
        axes.set(ylabel="class weights", ylim=(0.0, 1.0))
        axes.legend(fontsize="small", ncols=K, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    axes.set_xlabel("step")
    axes.margins(x=0)
    return axes


def plot_model(
    model: SwitchingModel,
    ax: Axes | None = None,
    *,
    component: int = 0,
    labels: tuple[str, str] = ("state", "observation"),
    units: tuple[str, str] = ("", ""),
) -> Axes:
    """Draw mean and spread of state and observation in every regime.

    The horizontal axis is the value of a fuzzy switch between two classes, otherwise the regime or class.
    Bands are two standard deviations of the stationary (first) law.

    Parameters
    ----------
    model : CGOFMSModel or CGOMSModel
    ax : matplotlib.axes.Axes, optional
    component : int
        Index of the component of state and observation.
    labels, units : (str, str)
        Labels and units of state and observation.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    MissingDependencyError
        If matplotlib is not installed.
    ParameterError
        If there is no such component.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSModel
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.2, 0.8]], np.zeros((2, 2)), np.full((2, 2, 4, 4), np.eye(4)), 1
    ... )
    >>> axes = plot_model(model, labels=("demand", "temperature"), units=("GW", "°C"))
    >>> [text.get_text() for text in axes.get_legend().get_texts()]
    ['demand (GW)', 'temperature (°C)']
    """
    m, q = model.dim_x, model.dim_z
    if not is_whole(component) or not 0 <= component < min(m, q):
        raise ParameterError(f"component: got {brief(component)}, expected 0 to {min(m, q) - 1}")
    axes = axes_or_new(ax, figsize=(6.0, 3.5))
    fuzzy = model.is_fuzzy and model.n_classes == 2  # between more there is no line of values
    r = np.linspace(0.0, 1.0, 101) if fuzzy else np.arange(model.n_classes, dtype=np.float64)
    mean, covariance = model.form.marginal(model.class_weights(r))
    shown = [f"{label} ({unit})" if unit else label for label, unit in zip(labels, units, strict=True)]
    for name, k, color, style, marker, shift in (
        (shown[0], component, BLUE, "-", "o", -0.06),
        (shown[1], m + component, ORANGE, "--", "s", 0.06),
    ):
        half = 2.0 * np.sqrt(covariance[:, k, k])
        if fuzzy:
            axes.fill_between(r, mean[:, k] - half, mean[:, k] + half, color=color, alpha=0.2, linewidth=0)
            axes.plot(r, mean[:, k], color=color, linestyle=style, label=name)
        else:
            axes.errorbar(
                r + shift, mean[:, k], half, fmt=marker, color=color, capsize=3, label=name, linestyle="none"
            )
    axes.set(
        xlabel="switch" if fuzzy else "class" if model.is_fuzzy else "regime",
        ylabel="mean, with two standard deviations",
    )
    if not fuzzy:
        axes.set_xticks(r)
    axes.legend(fontsize="small")
    return axes
