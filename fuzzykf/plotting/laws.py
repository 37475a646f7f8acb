"""Pictures of laws and of models."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import brief, is_whole
from fuzzykf.plotting.style import BLUE, ORANGE, SURFACE, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fuzzykf.switching.laws.law import FuzzyMarkovLaw
    from fuzzykf.switching.models.base import SwitchingModel

__all__ = ["plot_law", "plot_model"]

#: Cells per axis in the picture of a density.
_CELLS = 24


def plot_law(law: FuzzyMarkovLaw, ax: Axes | None = None) -> Axes:
    """Draw the joint density of two consecutive values of the switch as bars (2020 paper, Fig. 2).

    Bars on the rim are densities along the edges, those at the corners are masses.

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


def plot_model(
    model: SwitchingModel,
    ax: Axes | None = None,
    *,
    component: int = 0,
    labels: tuple[str, str] = ("state", "observation"),
    units: tuple[str, str] = ("", ""),
) -> Axes:
    """Draw what a switch does: mean and spread of state and observation in every regime.

    For a fuzzy model the horizontal axis is the value of the switch, for a hard one the
    regime.  Bands are two standard deviations of the stationary (first) law.

    Parameters
    ----------
    model : CGOFMSModel or CGOMSModel
    ax : matplotlib.axes.Axes, optional
    component : int
        Which component of the state and of the observation.
    labels, units : (str, str)
        Of state and observation.

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
    >>> model = CGOMSModel([[0.9, 0.1], [0.2, 0.8]], np.zeros((2, 2)), np.full((2, 2, 4, 4), np.eye(4)), 1)
    >>> axes = plot_model(model, labels=("demand", "temperature"), units=("GW", "°C"))
    >>> [text.get_text() for text in axes.get_legend().get_texts()]
    ['demand (GW)', 'temperature (°C)']
    """
    m, q = model.dim_x, model.dim_z
    if not is_whole(component) or not 0 <= component < min(m, q):
        raise ParameterError(f"component: got {brief(component)}, expected 0 to {min(m, q) - 1}")
    axes = axes_or_new(ax, figsize=(6.0, 3.5))
    fuzzy = model.is_fuzzy
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
    axes.set(xlabel="switch" if fuzzy else "regime", ylabel="mean, with two standard deviations")
    if not fuzzy:
        axes.set_xticks(r)
    axes.legend(fontsize="small")
    return axes
