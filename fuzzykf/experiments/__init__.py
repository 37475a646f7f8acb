"""The tables and figures of the papers, made again and compared with what was printed."""

from __future__ import annotations

from fuzzykf.experiments.core import Experiment, Outcome, perform, write
from fuzzykf.experiments.paper2001_intervals import INTERVALS
from fuzzykf.experiments.paper2001_rocket import ROCKET
from fuzzykf.experiments.paper2013 import SWITCHING_STATE_SPACE
from fuzzykf.experiments.paper2020_building import BUILDING
from fuzzykf.experiments.paper2020_errors import HARD_FRACTION, NODES
from fuzzykf.experiments.paper2020_pictures import DENSITIES, RESTORATION, TRAJECTORIES
from fuzzykf.experiments.paper2020_quadrature import QUADRATURE

__all__ = ["EXPERIMENTS", "Experiment", "Outcome", "perform", "write"]

#: Every experiment, by its name.
EXPERIMENTS: dict[str, Experiment] = {
    experiment.name: experiment
    for experiment in (
        DENSITIES,
        TRAJECTORIES,
        RESTORATION,
        NODES,
        HARD_FRACTION,
        BUILDING,
        QUADRATURE,
        SWITCHING_STATE_SPACE,
        INTERVALS,
        ROCKET,
    )
}
