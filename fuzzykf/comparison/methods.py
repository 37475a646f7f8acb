"""The methods of a comparison, and what each says of the part to be restored."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from fuzzykf.comparison.candidates import Candidate
from fuzzykf.comparison.linear import learn_imm, learn_kalman
from fuzzykf.comparison.regression import learn_regression
from fuzzykf.comparison.switching import LAWS, learn_chosen_law, learn_fuzzy, learn_hard
from fuzzykf.errors import MissingDependencyError, ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.comparison.candidates import Learned

__all__ = ["KNOTS", "Restoration", "main_methods", "restore"]

#: A method's time per step is the least of this many passes over this many steps.
TIMED_PASSES, TIMED_STEPS = 5, 500

#: Knots of the piecewise-linear regression, at the quartiles of the observation.
KNOTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Restoration:
    """What one method says of the part to be restored.

    Attributes
    ----------
    name : str
        Name of the method.
    mean, std : ndarray, shape (n_test,)
        Its estimate of the state, and the standard deviation that it claims.
    log_likelihood : ndarray, shape (n_test,), or None
        Logarithm of the density of each observation given the earlier ones.
    microseconds : float
        Time of one step.
    switch : ndarray, shape (n_test,), or None
        Posterior mean of the switch.
    notes : tuple of str
        What a reader should know before trusting the method.
    description : str
        What was chosen while learning, in words; may be empty.
    """

    name: str
    mean: FloatArray
    std: FloatArray
    log_likelihood: FloatArray | None = None
    microseconds: float
    switch: FloatArray | None = None
    notes: tuple[str, ...] = ()
    description: str = ""


def main_methods(law: str = "auto") -> tuple[Candidate, ...]:
    """Return the methods that `compare` sets side by side, in the order of its table.

    Parameters
    ----------
    law : {"auto", "fmc1", "fmc2", "free"}
        Family of the law of the fuzzy switch; "auto" is the one that filters best on
        the last quarter of the learning part, which takes four times as long.

    Raises
    ------
    ParameterError
        If ``law`` is none of these.
    MissingDependencyError
        If filterpy is not installed.
    """
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError as error:
        raise MissingDependencyError(
            "the comparison needs filterpy: pip install 'fuzzykf[compare]'"
        ) from error
    if law == "auto":
        fuzzy = Candidate("OFSRFilter", learn_chosen_law, pieces=len(LAWS) + 1)
    elif law in LAWS:
        fuzzy = Candidate("OFSRFilter", partial(learn_fuzzy, law=law))
    else:
        raise ParameterError(f"law: got {law!r}, expected 'auto', {', '.join(map(repr, LAWS))}")
    return (
        fuzzy,
        Candidate("CGOMSMFilter", partial(learn_hard, n_switches=2)),
        Candidate("IMMEstimator", learn_imm),
        Candidate("KalmanFilter (filterpy)", partial(learn_kalman, kalman_filter=KalmanFilter)),
        Candidate("linear regression", partial(learn_regression, lags=(0,))),
        Candidate("regression with lags", learn_regression),
        Candidate("piecewise-linear with lags", partial(learn_regression, n_knots=KNOTS)),
    )


def restore(name: str, learned: Learned, before: FloatArray, zs: FloatArray) -> Restoration:
    """Let a method restore a scalar state, and measure the time of a step.

    Parameters
    ----------
    name : str
    learned : Learned
    before, zs : ndarray, shapes (k, 1) and (n, 1)
        Observations before the part to be restored, and those of it.
    """
    found = learned.restore(before, zs)
    return Restoration(
        name=name,
        mean=found.mean[:, 0],
        std=found.std[:, 0],
        log_likelihood=found.log_likelihood,
        microseconds=_microseconds(learned.stepper(), zs),
        switch=found.switch,
        notes=learned.notes,
        description=learned.description,
    )


def _microseconds(step: Callable[[FloatArray], object], zs: FloatArray) -> float:
    """Time of one call of ``step``: the least mean over several passes, in microseconds."""
    values = list(zs[:TIMED_STEPS])
    passes = []
    for _ in range(TIMED_PASSES):
        start = time.perf_counter()
        for z in values:
            step(z)
        passes.append(time.perf_counter() - start)
    return 1e6 * min(passes) / len(values)
