"""Observations that are absurdly far off, before gaps or not, on every engine.

An outlier of up to 1e150 standard deviations leaves everything finite, probabilities that sum to one and
variances that are not negative; ties stay ties, and engines agree.  Beyond, it is a named error on
every engine, and the filter is as it was.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from engines import engines, on_engine
from judge import Case, Judge, Outcome
from report import Report
from systems import KINDS, SIZES, System

from fuzzykf.errors import NumericalRangeError, QuadratureError

__all__ = ["run"]

RUNS = 2560

#: How far off, in standard deviations; beyond the last but two, numbers end.
FAR = (1e3, 1e4, 1e6, 1e7, 1e8, 1e10, 1e15, 1e30, 1e75, 1e100, 1e150, 1e160, 1e300)

#: What a bank says of an observation that is too far off for all of its filters.
OF_BANKS = "no mode gives a positive density"

#: What is missing right after.
GAPS = ("none", "whole", "part")

VERBS = ("step", "filter", "filter_many")

#: How many numbers of one series `filter_many` takes at once, so that lanes are filled.
COPIES = 9


# --------------------------------------------------------------------------- on one engine


def read(f: Any) -> dict[str, np.ndarray]:
    """Copy what users read of a filter."""
    names = ("x", "P", "mu", "log_likelihood")
    return {name: np.array(getattr(f, name), dtype=float) for name in names if hasattr(f, name)}


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    """Whether two filters show the same, to the bit."""
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


def refused(error: Exception, f: Any, before: dict[str, np.ndarray]) -> Outcome:
    """Say how an observation was refused, and whether the filter is as it was."""
    faults = [] if same(before, read(f)) else ["the filter has changed"]
    named = isinstance(error, NumericalRangeError | QuadratureError) or OF_BANKS in str(error)
    if not named:
        faults.append(f"{type(error).__name__}: {str(error)[:150]}")
    return Outcome(error=type(error).__name__, faults=faults)


def stepped(system: System, zs: np.ndarray) -> Outcome:
    """Step along a series; what is refused is left out."""
    f, rows, outcome, is_begun = system.make(), [], Outcome(), False
    told = system.switches(len(zs))
    for k, z in enumerate(zs):
        before = read(f)
        try:
            f.step(z, *(value[k] for value in told.values()))
            is_begun = True
        except Exception as error:
            found = refused(error, f, before)
            outcome.error = found.error
            outcome.refused = k if outcome.refused is None else outcome.refused
            outcome.faults += [fault for fault in found.faults if fault not in outcome.faults]
        # of a known switch nothing is known before the first observation that is taken
        rows.append(read(f) if is_begun else {name: np.nan_to_num(value) for name, value in read(f).items()})
    outcome.fields = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    outcome.fields["x"] = outcome.fields["x"][..., 0]
    return outcome


def filtered(system: System, zs: np.ndarray) -> Outcome:
    """Filter a series at once."""
    f = system.make()
    before = read(f)
    try:
        result = f.filter(zs, **system.switches(len(zs)))
    except Exception as error:
        return refused(error, f, before)
    return Outcome({name: getattr(result, name) for name in before})


def filtered_many(system: System, zs: np.ndarray) -> Outcome:
    """Filter a series beside copies of it, and return what comes out of one in the middle."""
    f = system.make()
    before = read(f)
    options = {name: np.tile(value, (COPIES, 1)) for name, value in system.switches(len(zs)).items()}
    try:
        result = f.filter_many(np.tile(zs, (COPIES, 1, 1)), keep=tuple(before), **options)
    except Exception as error:
        return refused(error, f, before)
    return Outcome({name: getattr(result, name)[COPIES // 2] for name in before})


def outcomes(cases: list[Case]) -> list[dict[str, Outcome]]:
    """Try every verb on every case, and on the filter that it has to equal; on the engine in use."""
    verbs = dict(zip(VERBS, (stepped, filtered, filtered_many), strict=True))
    found = []
    with np.errstate(all="ignore"):  # a warning is no fault, what comes of it is
        for case in cases:
            made = case.system
            tried = {verb: call(made, case.series()) for verb, call in verbs.items()}
            if made.twin is not None:
                tried["twin"] = filtered(System(made.twin), case.series())
            found.append(tried)
    return found


# --------------------------------------------------------------------------- what is judged


def drawn(number: int, seed: int) -> list[Case]:
    """Draw cases: all combinations, one after the other in a random order, and again."""
    everything = [
        combination
        for combination in product(KINDS, SIZES, FAR, GAPS)
        if combination[3] != "part" or combination[1][1] > 1
    ]
    rng = np.random.default_rng(seed)
    order: list[int] = []
    while len(order) < number:
        order += rng.permutation(len(everything)).tolist()
    return [Case(*everything[k], seed * 100_000 + n) for n, k in enumerate(order[:number])]


def judged(cases: list[Case], found: dict[str, list[dict[str, Outcome]]]) -> Judge:
    """Judge everything that was found, by engine."""
    judge = Judge()
    first = next(iter(found))
    for k, case in enumerate(cases):
        for engine, all_ in found.items():
            for verb in VERBS:
                outcome, where = all_[k][verb], f"{case}, {verb}, {engine}"
                if case.is_beyond:
                    judge.counts["banks beyond their limit"] += 1
                    continue
                judge.alone(outcome, where, case.far)
                if engine != first:
                    judge.together(found[first][k][verb], outcome, f"{where} and {first}", case)
                if "twin" in all_[k]:
                    judge.tie(outcome, all_[k]["twin"], where, case)
    return judge


def run(share: float, seed: int) -> Report:
    """Try outliers on every engine."""
    cases = drawn(max(1, round(RUNS * share)), seed)
    found = {name: on_engine(name, outcomes, cases) for name in engines()}
    judge = judged(cases, found)
    figures = {
        "outliers": len(cases),
        "engines": ", ".join(found),
        "calls": len(cases) * len(found) * len(VERBS),
        "largest |sum of probabilities - 1|": f"{judge.sums:.2g}",
        "largest difference between engines": f"{judge.apart:.2g}",
        "negative variances": judge.counts["negative variances"],
        "named errors": judge.counts["named errors"],
        "banks beyond their limit": judge.counts["banks beyond their limit"],
    }
    return Report("outliers of 1e3 to 1e300 standard deviations", figures, judge.faults)
