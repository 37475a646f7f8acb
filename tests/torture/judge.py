"""What an outlier may do to a filter, and what it may not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from systems import System, system

from fuzzykf.errors import NumericalRangeError, ParameterError, QuadratureError

__all__ = ["LENGTH", "Case", "Judge", "Outcome"]

#: Up to here, in standard deviations, an outlier has to be taken.
PROMISED = 1e150

LENGTH = 12

#: How many systems of each kind and size there are.
PARAMETERS = 8

#: Probabilities sum to one; engines, and ties, agree, relative to the scale of the arrays.
SUMS, AGREE = 1e-12, 1e-9

#: How many times the rounding of an outlier is left where it cancels.
ROUNDINGS = 64 * np.finfo(float).eps

#: Below this, differences count as they are.
LEAST = {"mu": 1.0, "log_likelihood": 1.0}

#: P of regimes that do not differ is that of one regime up to here, on NumPy and where a gap comes next:
#: their weights differ by rounding, and so do their means then, by that of the outlier.
TIES = 1e10

#: A bank of unlike filters that finds a gap after an outlier subtracts covariances of its size squared.
BANK_IN_GAP = 1e5


@dataclass(frozen=True)
class Case:
    """One outlier."""

    kind: str
    size: tuple[int, int]
    far: float
    gap: str
    seed: int

    @property
    def system(self) -> System:
        """The filters to try it on."""
        return system(self.kind, self.size, self.seed % PARAMETERS)

    @property
    def is_beyond(self) -> bool:
        """Whether docs/reliability.md says that digits are lost there; a named error may come."""
        return self.kind == "IMM" and self.gap != "none" and self.far > BANK_IN_GAP

    def knows_ties(self, where: str) -> bool:
        """Whether equal regimes have to have the covariance of one."""
        return self.far <= TIES or ("numpy" not in where and self.gap == "none")

    def series(self) -> np.ndarray:
        """Return observations, of which one is off."""
        rng = np.random.default_rng(self.seed)
        q = self.size[1]
        zs = rng.normal(size=(LENGTH, q))
        at = int(rng.integers(0, LENGTH - 4))
        direction = rng.normal(size=q)
        zs[at] = self.far * direction / np.abs(direction).max()
        if self.gap != "none":
            zs[at + 1, : q if self.gap == "whole" else 1] = np.nan
        return zs


@dataclass
class Outcome:
    """What one verb did: the arrays along the series, or a named error, and which step it met first."""

    fields: dict[str, np.ndarray] = field(default_factory=dict)
    error: str = ""
    refused: int | None = None
    faults: list[str] = field(default_factory=list)


def scales(fields: dict[str, np.ndarray], zs: np.ndarray, *, cancels: bool) -> dict[str, np.ndarray]:
    """Return to what the differences of each array are relative, at each time."""
    now = {name: np.abs(value).reshape(LENGTH, -1).max(axis=1) for name, value in fields.items()}
    found = {name: np.maximum(value, LEAST.get(name, 1e-300)) for name, value in now.items()}
    if cancels and now:  # what is left of an outlier is known to the rounding of the outlier
        seen = np.maximum(now["x"], np.nanmax(np.abs(zs), axis=1, initial=0.0, where=~np.isnan(zs)))
        found["x"], found["P"] = np.maximum.accumulate(seen), np.maximum.accumulate(found["P"])
        rounding = ROUNDINGS * found["x"]
        with np.errstate(over="ignore"):  # beyond what is promised
            found["P"] = found["P"] + (2.0 * np.sqrt(found["P"]) * rounding + rounding**2) / AGREE
    return found


def distance(
    one: dict[str, np.ndarray],
    other: dict[str, np.ndarray],
    scale: dict[str, np.ndarray],
    steps: slice = slice(None),
) -> float:
    """Return the largest difference of two outcomes at these steps, relative to these scales."""
    largest = 0.0
    for name in one.keys() & other.keys() & scale.keys():
        with np.errstate(invalid="ignore"):  # both are infinite: a fault of its own
            apart = np.abs(one[name] - other[name]).reshape(LENGTH, -1).max(axis=1) / scale[name]
        largest = max(largest, float(np.nan_to_num(apart[steps], nan=0.0).max(initial=0.0)))
    return largest


@dataclass
class Judge:
    """Counts and faults over all cases."""

    faults: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    sums: float = 0.0
    apart: float = 0.0

    def alone(self, outcome: Outcome, where: str, far: float) -> None:
        """Judge what one verb did on one engine."""
        self.faults += [f"{where}: {fault}" for fault in outcome.faults]
        if outcome.error:
            self.counts["named errors"] += 1
            if far <= PROMISED and outcome.error in (NumericalRangeError.__name__, ParameterError.__name__):
                self.faults.append(f"{where}: {outcome.error} within {PROMISED:g} standard deviations")
        for name, value in outcome.fields.items():
            endless = name == "log_likelihood" and far > PROMISED  # the logarithm of a density of nothing
            if not (np.isfinite(value) | (endless & (value == -np.inf))).all():
                self.faults.append(f"{where}: {name} is not finite")
        if "mu" in outcome.fields:
            off = np.abs(outcome.fields["mu"].sum(axis=-1) - 1.0).max()
            self.sums = max(self.sums, float(off))
            if not off <= SUMS:
                self.faults.append(f"{where}: probabilities sum to one but for {off:.3g}")
        if "P" in outcome.fields:
            variances = np.diagonal(outcome.fields["P"], axis1=-2, axis2=-1)
            if (variances < 0.0).any():
                self.counts["negative variances"] += 1
                self.faults.append(f"{where}: a variance of {variances.min():.3g}")

    def together(self, one: Outcome, other: Outcome, where: str, case: Case) -> None:
        """Judge whether two engines agree."""
        if one.error != other.error:
            self.faults.append(f"{where}: {one.error or 'no error'} and {other.error or 'no error'}")
            return
        scale = scales(one.fields, case.series(), cancels=case.system.cancels)
        if case.system.twin is not None and not case.knows_ties(where):
            scale.pop("P", None)
        steps = slice(None)
        if one.error == QuadratureError.__name__:  # rounding decides when the first is refused, if it is late
            steps = slice(min(one.refused or 0, other.refused or 0))
        apart = distance(one.fields, other.fields, scale, steps)
        self.apart = max(self.apart, apart)
        if not apart <= AGREE:
            self.faults.append(f"{where}: {apart:.3g} apart")

    def tie(self, outcome: Outcome, twin: Outcome, where: str, case: Case) -> None:
        """Judge whether equal regimes are one filter; where numbers end, a bank refuses what one takes."""
        if case.far > PROMISED:
            return
        if outcome.error != twin.error:
            self.faults.append(f"{where}: {outcome.error or 'no error'}, as one {twin.error or 'no error'}")
            return
        scale = scales(twin.fields, case.series(), cancels=False)
        scale.pop("mu", None)  # of one regime
        if not case.knows_ties(where):
            scale.pop("P", None)
        if not (apart := distance(outcome.fields, twin.fields, scale)) <= AGREE:
            self.faults.append(f"{where}: equal regimes are {apart:.3g} off one filter")
