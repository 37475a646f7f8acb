"""What the page shows: a sampled switch, state and observation, and what three filters make of them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count, as_real, brief
from fuzzykf.switching.filters.switching_kalman import SwitchingKalmanFilter
from fuzzykf.switching.laws.fades import FadeLaw
from fuzzykf.switching.state_space.model import SwitchingStateSpace
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray

__all__ = ["BOUNDS", "Settings", "filters", "scene"]

#: Of the state, X' = 0.95 X + noise: its variance is one, so that contrast and noise are in its units.
PERSISTENCE = 0.95

#: Most nodes between the regimes.
NODES = 9

#: Least and greatest value of each slider, and its step.
BOUNDS = {
    "dwell": (5.0, 200.0, 1.0),
    "length": (2.0, 100.0, 1.0),
    "contrast": (0.0, 10.0, 0.1),
    "noise": (0.05, 3.0, 0.05),
}

#: Rows that are drawn, and the most that are.
ROWS, MOST_ROWS = 400, 5000


@dataclass(frozen=True)
class Settings:
    """Where the sliders stand.

    Parameters
    ----------
    dwell : float
        Mean number of steps that the switch stays at 0 or 1.
    length : float
        Mean number of steps of a fade.
    contrast : float
        What the second regime adds to an observation, in standard deviations of the state.
    noise : float
        Standard deviation of the noise of an observation, likewise.
    seed : int
        Of the random numbers: the same seed draws the same noise wherever the sliders stand.
    n : int
        Number of steps.
    """

    dwell: float = 40.0
    length: float = 20.0
    contrast: float = 4.0
    noise: float = 0.5
    seed: int = 0
    n: int = ROWS

    def __post_init__(self) -> None:
        for name, (low, high, _) in BOUNDS.items():
            value = as_real(name, getattr(self, name))
            if not low <= value <= high:
                raise ParameterError(f"{name}: got {value:g}, expected a number from {low:g} to {high:g}")
        as_count("seed", self.seed, most=2**32)
        as_count("n", self.n, 2, MOST_ROWS)

    @classmethod
    def from_text(cls, given: Mapping[str, str]) -> Self:
        """Read settings by name; what is not given stands where it does at first.

        Raises
        ------
        ParameterError
            If a name is unknown, or a value is no number or out of bounds.
        """
        kinds = {one.name: int if one.type == "int" else float for one in fields(cls)}
        values: dict[str, Any] = {}
        for name, text in given.items():
            if name not in kinds:
                raise ParameterError(f"{brief(name)}: no such setting, expected one of {listed([*kinds])}")
            try:
                values[name] = kinds[name](text)
            except ValueError as error:
                raise ParameterError(f"{name}: got {brief(text)}, expected a number") from error
        return cls(**values)


def filters(settings: Settings) -> tuple[SwitchingStateSpace, dict[str, SwitchingKalmanFilter]]:
    """Return the model Y = X + contrast r + noise with a switch r that fades, and three filters.

    The first has the model; the second one with a switch that jumps, as often as the fading one changes
    sides; the third, a Kalman filter, takes what the switch adds for noise of the same variance.

    Parameters
    ----------
    settings : Settings
    """
    law = FadeLaw.between(dwell=settings.dwell, length=settings.length)
    nodes = law.nodes_up_to(NODES)
    chain = law.discretize(nodes)
    joint = law.harden()
    u = chain.class_weights[:, 1]
    mean = float(chain.initial @ u)
    variance = float(chain.initial @ (u - mean) ** 2)

    def space(switch: Any, offsets: list[list[float]], extra: float = 0.0) -> SwitchingStateSpace:
        Q, R = 1.0 - PERSISTENCE**2, settings.noise**2 + extra
        return SwitchingStateSpace(switch, F=PERSISTENCE, H=1.0, Q=Q, R=R, d=offsets)

    c = settings.contrast
    model = space(law, [[0.0], [c]])
    jumping = space(joint / joint.sum(axis=1, keepdims=True), [[0.0], [c]])
    single = space([[1.0]], [[c * mean]], c**2 * variance)
    return model, {
        "fading switch": SwitchingKalmanFilter(model, n_nodes=nodes),
        "jumping switch": SwitchingKalmanFilter(jumping),
        "Kalman filter": SwitchingKalmanFilter(single),
    }


def scene(settings: Settings) -> dict[str, Any]:
    """Draw a series and filter it.

    Parameters
    ----------
    settings : Settings

    Returns
    -------
    dict
        Lists of numbers, one a step: ``switch``, ``state`` and ``observation`` as drawn; for each filter
        under ``filters`` its ``name``, ``mean``, ``std``, the root mean squared ``error`` and, where it has a
        switch, its posterior mean (``switch``).

    Examples
    --------
    >>> from fuzzykf.play.scene import Settings, scene
    >>> found = scene(Settings(n=200))
    >>> [one["name"] for one in found["filters"]]
    ['fading switch', 'jumping switch', 'Kalman filter']
    >>> len(found["state"]), len(found["filters"][0]["mean"])
    (200, 200)
    """
    model, methods = filters(settings)
    truth = model.simulate(settings.n, np.random.default_rng(settings.seed))
    x = truth.x[:, 0]
    shown = []
    for name, method in methods.items():
        found = method.filter(truth.y)
        mean = found.x[:, 0]
        shown.append(
            {
                "name": name,
                "mean": _rounded(mean),
                "std": _rounded(np.sqrt(found.P[:, 0, 0])),
                "switch": None if found.class_weights.shape[1] == 1 else _rounded(found.class_weights[:, 1]),
                "error": float(np.sqrt(np.mean((mean - x) ** 2))),
            }
        )
    return {
        "switch": _rounded(truth.r),
        "state": _rounded(x),
        "observation": _rounded(truth.y[:, 0]),
        "filters": shown,
    }


def _rounded(values: FloatArray) -> list[float]:
    """Return numbers as short as a picture needs them."""
    numbers: list[float] = np.round(values, 5).tolist()
    return numbers
