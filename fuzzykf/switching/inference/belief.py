"""One step of a switching filter, whether observations are complete or not.

A belief is what a filter knows after an observation: the state of every node and the
window of the latest observations.  The functions here choose between the exact
recursion (`fuzzykf.switching.inference.recursion`) and that for gaps (`fuzzykf.switching.inference.missing`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.gaussian import mixture_moments
from fuzzykf.io import decode, encode
from fuzzykf.switching.dynamics.pairs import log_probability
from fuzzykf.switching.inference import missing, recursion
from fuzzykf.switching.inference.missing import GapState
from fuzzykf.switching.inference.recursion import NodeState

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import InitialLaw, PairTables

__all__ = [
    "Belief",
    "Source",
    "begin",
    "node_state",
    "predict_observation",
    "predict_state",
    "proceed",
]


# no tuples: filterpy's Saver makes an array of whatever a filter holds


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What is known after an observation."""

    state: NodeState | GapState
    window: FloatArray  # (w,): the latest observations, newest first; NaN where missing

    def to_dict(self) -> dict[str, Any]:
        """Return the belief as plain values, bit for bit."""
        kind = "gap" if isinstance(self.state, GapState) else "complete"
        fields = {name: encode(value) for name, value in self.state._asdict().items()}
        return {"kind": kind, "window": encode(self.window), "state": fields}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Belief:
        """Make a belief from what `to_dict` returned."""
        fields = values["state"]
        sign, window = decode(fields["sign"], 1), decode(values["window"], 1)
        if values["kind"] == "complete":
            return cls(NodeState(decode(fields["table"], 2), sign, decode(fields.get("mass"), 1)), window)
        gap = GapState(
            log_p=decode(fields["log_p"], 1),
            sign=sign,
            mean=decode(fields["mean"], 2),
            covariance=decode(fields["covariance"], 3),
            known=np.array(fields["known"], dtype=bool),
        )
        return cls(gap, window)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """From what an observation is predicted."""

    belief: Belief
    tables: PairTables


def begin(law: InitialLaw, y: FloatArray) -> tuple[Belief, float]:
    """Condition the initial law on the first observation, (q,), NaN where missing.

    Returns
    -------
    belief, log_likelihood
    """
    if _complete(y):
        state, log_likelihood = recursion.first_observation(law, y)
        return Belief(state, y), log_likelihood
    gap, log_likelihood = missing.start_gap(law, log_probability(law.probability), y)
    return Belief(*missing.close_gap(gap, law.mean.shape[1] - y.size)), log_likelihood


def proceed(tables: PairTables, belief: Belief, y: FloatArray, width: int) -> tuple[Belief, float]:
    """Take the next observation, (q,), NaN where missing, into account.

    Parameters
    ----------
    tables : PairTables
    belief : Belief
    y : ndarray, shape (q,)
    width : int
        Length of the window after it.

    Returns
    -------
    belief, log_likelihood
    """
    state, window = belief.state, belief.window
    if isinstance(state, NodeState) and _complete(y):
        new, log_likelihood = recursion.advance(tables, state, window, y)
        return Belief(new, y if width == y.size else np.concatenate([y, window])[:width]), log_likelihood
    m = tables.pairs.dim_x
    gap, log_likelihood = missing.advance_gap(tables, missing.open_gap(state, window, m), y, width)
    return Belief(*missing.close_gap(gap, m)), log_likelihood


def _complete(y: FloatArray) -> bool:
    if y.size == 1:  # asked at every step of a scalar filter, so asked quickly
        value = y.item()
        return bool(value == value)
    return not np.isnan(y).any()


def node_state(belief: Belief, m: int) -> NodeState:
    """Probabilities of the nodes and moments of X given each."""
    state = belief.state
    return state if isinstance(state, NodeState) else missing.marginal_state(state, m)


def predict_state(tables: PairTables, belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Mean (m,) and covariance (m, m) of X at the next observation."""
    state = belief.state
    if isinstance(state, NodeState):
        return recursion.predict_state(tables, state, belief.window)
    m = tables.pairs.dim_x
    mean, covariance = missing.predicted_moments(tables, state)
    return mean[:m], covariance[:m, :m]


def predict_observation(
    source: Source | None, law: InitialLaw | None, m: int
) -> tuple[FloatArray, FloatArray]:
    """Mean (q,) and covariance (q, q) of the next observation; of the first one without a source."""
    if source is None:
        assert law is not None
        return mixture_moments(law.probability, law.mean[:, m:], law.covariance[:, m:, m:])
    state, tables = source.belief.state, source.tables
    if isinstance(state, NodeState):
        return recursion.predict_observation(tables, state, source.belief.window)
    mean, covariance = missing.predicted_moments(tables, state)
    return mean[m:], covariance[m:, m:]


def is_sound(belief: Belief, m: int, q: int, M: int, order: int) -> bool:
    """Whether a belief that comes from a file has the sizes of a system, and finite numbers."""
    state, w = belief.state, belief.window.size
    sizes: list[tuple[FloatArray, tuple[int, ...]]] = [(belief.window, (w,))]
    if isinstance(state, NodeState):
        sizes.append((state.table, (1 + m + m * m, M)))
        complete = bool(np.isfinite(belief.window).all())
    else:
        sizes += [(state.log_p, (M,)), (state.mean, (M, m + w)), (state.covariance, (M, m + w, m + w))]
        complete = state.known.shape == (w,)
    if state.sign is not None:
        sizes.append((state.sign, (M,)))
    shaped = all(array.shape == shape for array, shape in sizes)
    finite = all(np.isfinite(array).all() for array, _ in sizes[1:])
    return bool(complete and shaped and finite and w % q == 0 and 0 < w <= order * q)
