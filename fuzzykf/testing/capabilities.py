"""Checks that apply to filters which offer more than every filter does."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fuzzykf.errors import SequenceError
from fuzzykf.testing.case import Case, check

# --------------------------------------------------------------------------- missing observations


@check("missing")
def check_missing(case: Case) -> None:
    """Check that update(None) leaves the prediction as it is."""
    f = case.stepped(2)
    f.predict()
    before = case.state(f)
    f.update(None)
    kept = {name: before[name] for name in ("x", "P")}
    case.compare(case.state(f), kept, "after predict and update(None)")
    prior = {"x": np.array(f.x_prior), "P": np.array(f.P_prior)}
    case.compare(case.state(f), prior, "x_prior and P_prior after update(None)")
    if case.probabilistic and not np.abs(f.log_likelihood).max() <= 1e-12:
        case.fail(f"log_likelihood is {f.log_likelihood} after update(None), expected 0")
    after = case.along(f, case.zs[3:])
    if not all(np.isfinite(after[name]).all() for name in ("x", "P")):
        case.fail(f"x is {after['x'].tolist()} in the steps after update(None), expected finite numbers")


@check("missing_nan")
def check_missing_nan(case: Case) -> None:
    """Check that NaN in all components means the same as None, one by one and in a series."""
    f, g = case.stepped(2), case.stepped(2)
    f.step(np.full(case.dim_z, np.nan))
    g.step(None)
    case.same(f, g, "update with NaN in all components, instead of update(None)")
    listed: list[Any] = [None if k in (1, 2) else z for k, z in enumerate(case.zs)]
    gaps = case.zs.copy()
    gaps[1:3] = np.nan
    steps = case.along(case.factory(), listed)
    for series, form in ((listed, "None"), (gaps, "NaN")):
        result = case.factory().filter(series)
        case.compare(
            case.fields(result), {"x": steps["x"], "P": steps["P"]}, f"filter of a series with {form}"
        )


@check("missing_component")
def check_missing_component(case: Case) -> None:
    """Check that the other components are used where one is NaN."""
    f, g, nothing = case.stepped(2), case.stepped(2), case.stepped(2)
    z = case.zs[2].copy()
    z[0] = np.nan
    f.step(z)
    nothing.step(None)
    case.require_finite(f, f"after an update with {z.tolist()}")
    state = case.state(f)
    smallest = np.linalg.eigvalsh(state["P"])[0]
    if not smallest >= -1e-9 * np.abs(state["P"]).max():
        case.fail(f"P has the eigenvalue {smallest} after an update with {z.tolist()}, expected none below 0")
    z[1:] += 1.0
    g.step(z)
    without = case.state(nothing)
    for other, what in (
        (case.state(g), "does not depend on the others"),
        (without, "is as with none of them"),
    ):
        if all(np.array_equal(state[name], other[name], equal_nan=True) for name in state):
            case.fail(f"the state after an update with the first component missing {what}")


# --------------------------------------------------------------------------- probabilistic filters


@check("log_likelihood")
def check_log_likelihood(case: Case) -> None:
    """Check that the log-likelihood is one finite number, the same from a step and from a series."""
    f = case.factory()
    values = []
    for k, z in enumerate(case.zs):
        f.step(z)
        if np.ndim(f.log_likelihood) != 0 or not np.isfinite(f.log_likelihood):
            case.fail(f"log_likelihood is {f.log_likelihood!r} after step {k}, expected a finite number")
        values.append(float(f.log_likelihood))
    result = case.factory().filter(case.zs)
    if result.log_likelihood is None:
        case.fail("the result of filter holds no log_likelihood")
    total, steps = float(np.sum(result.log_likelihood)), float(np.sum(values))
    if not abs(total - steps) <= 1e-8 * (1.0 + abs(steps)):
        case.fail(f"log_likelihood of a series adds up to {total}, expected the sum over its steps, {steps}")


@check("density")
def check_density(case: Case) -> None:
    """Check that the likelihood integrates to one over all possible observations."""
    f = case.stepped(2)
    f.predict()

    def density(zs: Any) -> Any:
        values = []
        for z in zs:
            trial = f.copy()
            trial.update(float(z))
            values.append(float(trial.log_likelihood))
        return np.exp(values)

    coarse = np.sinh(np.linspace(-14.0, 14.0, 141))
    centre = coarse[np.argmax(density(coarse))]
    # a substitution that resolves any width from 1e-4 to 1e4 around the coarse maximum
    t, spacing = np.linspace(-19.0, 19.0, 381, retstep=True)
    total = float((density(centre + 1e-4 * np.sinh(t)) * 1e-4 * np.cosh(t)).sum() * spacing)
    if not abs(total - 1.0) <= 1e-3:
        case.fail(f"exp(log_likelihood) integrates to {total} over the observation, expected 1")


@check("outlier")
def check_outlier(case: Case) -> None:
    """Check that an observation far from anything expected leaves everything finite."""
    far = case.zs[2] + 1e3 * (1.0 + np.abs(case.zs).max(axis=0))
    for z in (far, -far):
        f = case.stepped(2)
        f.step(z)
        case.require_finite(f, f"after the outlier {z.tolist()}")


# --------------------------------------------------------------------------- switching filters


@check("mode_probabilities")
def check_mode_probabilities(case: Case) -> None:
    """Check that mu is a probability vector on the nodes at all times."""
    f = case.factory()
    for k, z in enumerate(case.zs):
        f.step(z)
        mu = np.asarray(f.mu)
        if mu.shape != np.shape(f.nodes)[:1]:
            case.fail(f"mu has shape {mu.shape} after step {k}, expected {np.shape(f.nodes)[:1]}, as nodes")
        if not ((mu >= -1e-9).all() and abs(mu.sum() - 1.0) <= 1e-9):
            case.fail(f"mu is {mu.tolist()} after step {k}, expected probabilities that sum to 1")


@check("leading_predict")
def check_leading_predict(case: Case) -> None:
    """Check that the first observation belongs to the initial law, after any leading predicts."""
    states = []
    for n in range(3):
        f = case.factory()
        for _ in range(n):
            f.predict()
        f.update(case.zs[0])
        states.append({name: value for name, value in case.state(f).items() if "prior" not in name})
    for n in (1, 2):
        case.compare(states[n], states[0], f"the first update after {n} leading predicts")


@check("sequence")
def check_sequence(case: Case) -> None:
    """Check that two updates without a predict in between are refused and change nothing."""
    f = case.stepped(2)
    try:
        f.update(case.zs[2])
    except SequenceError:
        pass
    else:
        case.fail("a second update without a predict was accepted, expected a SequenceError")
    case.same(f, case.stepped(2), "after a refused second update")


# --------------------------------------------------------------------------- possibilistic filters


@check("possibility")
def check_possibility(case: Case) -> None:
    """Check that possibilities lie between 0 and 1, and are 1 where nothing was observed."""
    f = case.factory()
    for k, z in enumerate(case.zs):
        f.step(z)
        if not 0.0 <= float(f.possibility) <= 1.0 + 1e-9:
            case.fail(f"possibility is {f.possibility} after step {k}, expected a number between 0 and 1")
        x, spread = np.ravel(f.x), np.sqrt(np.diagonal(f.P))
        points = x + np.linspace(-3.0, 3.0, 61)[:, None] * spread
        values = np.asarray(f.membership(points), dtype=np.float64).ravel()
        if not ((values >= 0.0).all() and (values <= 1.0 + 1e-9).all()):
            case.fail(f"membership takes values from {values.min()} to {values.max()}, expected 0 to 1")
        if not values.max() > 0.0:
            case.fail(f"membership vanishes within three spreads of x after step {k}")
    if case.no_missing is None:
        f.step(None)
        if not abs(float(f.possibility) - 1.0) <= 1e-12:
            case.fail(f"possibility is {f.possibility} after update(None), expected 1")


# --------------------------------------------------------------------------- methods


@check("filter_many")
def check_filter_many(case: Case) -> None:
    """Check that many series at once are as one after another, and that keep is honoured."""
    many = np.stack([case.zs[:5], case.zs[1:6], case.zs[:5] + 0.1])
    if case.no_missing is None:
        many[1, 3:] = np.nan
    names = ("x", "P", "log_likelihood") if case.probabilistic else ("x", "P")
    f = case.factory()
    before = case.state(f)
    result = f.filter_many(many) if case.probabilistic else f.filter_many(many, keep=names)
    case.compare(case.state(f), before, "the filter itself after filter_many")
    single = [case.fields(case.factory().filter(zs)) for zs in many]
    expected = {name: np.array([fields[name] for fields in single]) for name in names}
    case.compare(case.fields(result), expected, "filter_many, instead of one series after another")
    only = case.fields(case.factory().filter_many(many, keep=("x",)))
    if set(only) != {"x"}:
        case.fail(f"filter_many with keep=('x',) returned {sorted(only)}")


@check("smooth")
def check_smooth(case: Case) -> None:
    """Check that smoother and filter agree at the last observation, and P is a covariance."""
    smoothed, filtered = case.factory().smooth(case.zs), case.factory().filter(case.zs)
    for name in ("x", "P"):
        got, expected = getattr(smoothed, name), getattr(filtered, name)
        if got is None or got.shape != expected.shape:
            case.fail(f"{name} of smooth has shape {np.shape(got)}, expected {expected.shape}")
        case.compare({name: got[-1]}, {name: expected[-1]}, "the last step of smooth, as that of filter")
    smallest = np.linalg.eigvalsh(smoothed.P).min(axis=1)
    if not (smallest >= -1e-9 * np.abs(smoothed.P).max()).all():
        case.fail(f"P of smooth has the eigenvalues {smallest.tolist()}, expected none below 0")


@check("save")
def check_save(case: Case) -> None:
    """Check that a filter that was saved and loaded goes on like the original."""
    with tempfile.TemporaryDirectory() as folder:
        for n in (0, 3):
            f = case.stepped(n)
            f.save(Path(folder) / f"filter{n}")
            loaded = type(f).load(Path(folder) / f"filter{n}")
            case.same(loaded, f, f"loaded after {n} steps")
