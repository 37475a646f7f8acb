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
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["Mixture", "Source", "most_likely_key", "most_likely_switch"]

#: Numbers of axes of the arrays of `Branches`.
_BRANCHES = {"table": 2, "sign": 1, "root": 3}


# no tuples: filterpy's Saver makes an array of whatever a filter holds
@reprs()
@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """State of a switching filter after an observation.

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
        Number of missing components of the window.
    root : ndarray, shape (M, e, e), or None
        In a gap: root of the covariances of ``table``, with the digits that they have lost after an
        outlier; None if there are signs.
    branches : Branches, or None
        In a gap: the components of the nodes, of which ``table`` has the moments; None if each has one.
    """

    table: FloatArray
    window: FloatArray
    sign: FloatArray | None = None
    mass: FloatArray | None = None
    unknown: int = 0
    root: FloatArray | None = None
    branches: engine.Branches | None = None

    @property
    def probabilities(self) -> FloatArray:
        """p(r_n = i | y_1..n), (M,)."""
        if self.mass is not None:
            return self.mass.copy()
        p: FloatArray = np.exp(self.table[0])
        return p if self.sign is None else p * self.sign

    def state_table(self, m: int) -> FloatArray:
        """Return the table of X alone, (1 + m + m*m, M).

        Parameters
        ----------
        m : int
            Number of components of the state.

        Returns
        -------
        ndarray, shape (1 + m + m*m, M)
        """
        return engine.state_table(self.table, m)

    def mean(self, m: int) -> FloatArray:
        """Mean (m,) of X given all observations so far (2020 paper, eq. 21).

        Parameters
        ----------
        m : int
            Number of components of the state.

        Returns
        -------
        ndarray, shape (m,)
        """
        return engine.node_mean(self.probabilities, self.table[1 : 1 + m])

    def moments(self, m: int) -> tuple[FloatArray, FloatArray]:
        """Mean (m,) and covariance (m, m) of X given all observations so far (eqs. 21 and 22).

        Parameters
        ----------
        m : int
            Number of components of the state.

        Returns
        -------
        mean, covariance : ndarray, shapes (m,) and (m, m)
        """
        return mixture_moments(self.probabilities, *engine.node_moments(self.state_table(m), m))

    # ------------------------------------------------------------------ files

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values, without loss.

        Returns
        -------
        dict
        """
        window, sign = encode(self.window), encode(self.sign)
        if not self.unknown:
            state = {"table": encode(self.table), "sign": sign, "mass": encode(self.mass)}
            return {"kind": "complete", "window": window, "state": state}
        mean, covariance = engine.window_moments(self.table, self.window)
        state = {
            "log_p": encode(self.table[0]),
            "sign": sign,
            "mean": mean.tolist(),
            "covariance": covariance.tolist(),
            "known": (~np.isnan(self.window)).tolist(),
        }
        if self.root is not None:
            state["root"] = encode(self.root)
        if self.branches is not None:
            state["branches"] = {name: encode(part) for name, part in self.branches._asdict().items()}
        return {"kind": "gap", "window": window, "state": state}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Mixture:
        """Create a state from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        Mixture
        """
        state = values["state"]
        sign, window = decode(state["sign"], 1), decode(values["window"], 1)
        if values["kind"] == "complete":
            return cls(decode(state["table"], 2), window, sign, decode(state.get("mass"), 1))
        known = np.array(state["known"], dtype=bool)
        if known.shape != window.shape or not np.array_equal(known, ~np.isnan(window)):
            raise ValueError(f"known: got {known.tolist()} for the window {window.tolist()}")
        log_p, mean, covariance = (
            decode(state[name], k) for name, k in (("log_p", 1), ("mean", 2), ("covariance", 3))
        )
        table = engine.window_table(log_p, mean, covariance, window)
        root = decode(state.get("root"), 3)  # files of older versions have none
        parts = state.get("branches")
        branches = None
        if parts is not None:
            branches = engine.Branches(*(decode(parts[name], k) for name, k in _BRANCHES.items()))
        return cls(table, window, sign, None, int((~known).sum()), root, branches)

    def is_sound(self, m: int, q: int, M: int, order: int) -> bool:
        """Whether shapes match a system and numbers are finite."""
        w, e = self.window.size, m + self.unknown
        shaped = self.table.shape == (1 + e + e * e, M) and (self.sign is None or self.sign.shape == (M,))
        known = int(np.isfinite(self.window).sum()) == w - self.unknown
        shaped &= self.root is None or self.root.shape == (M, e, e)
        arrays = [self.table, self.sign, self.root]
        if self.branches is not None:
            n = self.branches.table.shape[-1]
            shapes = (1 + e + e * e, n), (n,), (n, e, e)
            shaped &= n % M == 0 and self.branches.table.shape == shapes[0] and self.unknown > 0
            shaped &= all(a is None or a.shape == k for a, k in zip(self.branches, shapes, strict=True))
            arrays += self.branches
        finite = all(a is None or np.isfinite(a).all() for a in arrays)
        return bool(shaped and known and finite and w % q == 0 and w <= order * q)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """From what an observation is predicted."""

    mixture: Mixture
    tables: PairTables


def most_likely_key(chain: SwitchChain, mu: FloatArray) -> FloatArray:
    """Return the key of the MPM estimate of the switch, (...), see `SwitchChain.keys`."""
    return engine.most_likely(mu, chain.keys, chain.weights, chain.atoms, chain.ranking)


def most_likely_switch(chain: SwitchChain, mu: FloatArray) -> FloatArray:
    """MPM estimate of the switch, (...) or (..., K), from the probabilities of its nodes (..., M)."""
    key = most_likely_key(chain, mu)
    return key if chain.nodes.ndim == 1 else chain.values(key)
