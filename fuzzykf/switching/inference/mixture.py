"""The one state of a switching filter: a mixture on the nodes.

After an observation a filter knows, per node, its probability and mean and covariance of
s = (X, u), with u the parts of the window of latest observations that are missing.  Where
nothing is missing s is X alone; a gap is the same state with more unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import mixture_moments
from fuzzykf.io import decode, encode

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["Mixture", "Source", "most_likely_switch"]


# no tuples: filterpy's Saver makes an array of whatever a filter holds
@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """What is known after an observation.

    Attributes
    ----------
    table : ndarray, shape (1 + e + e*e, M)
        Per node: log-probability, mean and covariance of s = (X, u), e = m + unknown.
    window : ndarray, shape (w,)
        The latest observations, newest first; NaN in the parts u that are missing.
    sign : ndarray, shape (M,), or None
        Signs of the probabilities, only for chains with negative weights.
    mass : ndarray, shape (M,), or None
        The probabilities, where the engine carries them, too.
    unknown : int
        How many parts of the window are missing.
    """

    table: FloatArray
    window: FloatArray
    sign: FloatArray | None = None
    mass: FloatArray | None = None
    unknown: int = 0

    @property
    def probabilities(self) -> FloatArray:
        """p(r_n = i | y_1..n), (M,)."""
        return self.mass.copy() if self.mass is not None else engine.probabilities(self.table, self.sign)

    def state_table(self, m: int) -> FloatArray:
        """Return the table of X alone, (1 + m + m*m, M)."""
        if not self.unknown:
            return self.table
        e = m + self.unknown
        rows = np.arange(e * e).reshape(e, e)[:m, :m].ravel()
        table: FloatArray = self.table[np.concatenate([np.arange(1 + m), 1 + e + rows])]
        return table

    def mean(self, m: int) -> FloatArray:
        """Mean (m,) of X given all observations so far (2020 paper, eq. 21)."""
        return engine.node_mean(self.probabilities, self.table[1 : 1 + m])

    def moments(self, m: int) -> tuple[FloatArray, FloatArray]:
        """Mean (m,) and covariance (m, m) of X given all observations so far (eqs. 21 and 22)."""
        return mixture_moments(self.probabilities, *engine.node_moments(self.state_table(m), m))

    # ------------------------------------------------------------------ X and the whole window

    def spread(self, m: int) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return mean (M, m + w) and covariance of (X, w) per node, and which parts of w are known."""
        known = ~np.isnan(self.window)
        at = np.flatnonzero(np.concatenate([np.ones(m, dtype=bool), ~known]))
        e, M, size = at.size, self.table.shape[1], m + known.size
        mean, covariance = np.empty((M, size)), np.zeros((M, size, size))
        mean[:, m:] = self.window
        mean[:, at] = self.table[1 : 1 + e].T
        covariance[:, at[:, None], at] = self.table[1 + e :].T.reshape(M, e, e)
        return mean, covariance, known

    @classmethod
    def gather(
        cls,
        log_p: FloatArray,
        sign: FloatArray | None,
        mean: FloatArray,
        covariance: FloatArray,
        window: FloatArray,
    ) -> Mixture:
        """Make a mixture from moments of (X, w) per node; what is known of the window is certain."""
        unknown = np.isnan(window)
        at = np.flatnonzero(np.concatenate([np.ones(mean.shape[1] - window.size, dtype=bool), unknown]))
        P = covariance[:, at[:, None], at].reshape(len(mean), -1)
        table = np.concatenate([log_p[None], mean[:, at].T, P.T])
        return cls(np.ascontiguousarray(table), window, sign, None, int(unknown.sum()))

    # ------------------------------------------------------------------ files

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values, bit for bit."""
        window, sign = encode(self.window), encode(self.sign)
        if not self.unknown:
            state = {"table": encode(self.table), "sign": sign, "mass": encode(self.mass)}
            return {"kind": "complete", "window": window, "state": state}
        mean, covariance, known = self.spread(_dim_x(self.table, self.unknown))
        state = {
            "log_p": encode(self.table[0]),
            "sign": sign,
            "mean": mean.tolist(),
            "covariance": covariance.tolist(),
            "known": known.tolist(),
        }
        return {"kind": "gap", "window": window, "state": state}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Mixture:
        """Make it from what `to_dict` returned."""
        state = values["state"]
        sign, window = decode(state["sign"], 1), decode(values["window"], 1)
        if values["kind"] == "complete":
            return cls(decode(state["table"], 2), window, sign, decode(state.get("mass"), 1))
        known = np.array(state["known"], dtype=bool)
        if known.shape != window.shape or not np.array_equal(known, ~np.isnan(window)):
            raise ValueError(f"known: got {known.tolist()} for the window {window.tolist()}")
        moments = decode(state["log_p"], 1), sign, decode(state["mean"], 2), decode(state["covariance"], 3)
        return cls.gather(*moments, window)

    def is_sound(self, m: int, q: int, M: int, order: int) -> bool:
        """Whether it has the sizes of a system, and finite numbers."""
        w, e = self.window.size, m + self.unknown
        shaped = self.table.shape == (1 + e + e * e, M) and (self.sign is None or self.sign.shape == (M,))
        known = int(np.isfinite(self.window).sum()) == w - self.unknown
        finite = np.isfinite(self.table).all() and (self.sign is None or np.isfinite(self.sign).all())
        return bool(shaped and known and finite and w % q == 0 and 0 < w <= order * q)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """From what an observation is predicted."""

    mixture: Mixture
    tables: PairTables


def _dim_x(table: FloatArray, unknown: int) -> int:
    e = round((np.sqrt(4 * len(table) - 3) - 1) / 2)
    return int(e) - unknown


def most_likely_switch(chain: SwitchChain, mu: FloatArray) -> FloatArray:
    """MPM estimate of the switch, (...), from the probabilities of its nodes (..., M)."""
    return engine.most_likely(mu, chain.nodes, chain.weights, chain.atoms)
