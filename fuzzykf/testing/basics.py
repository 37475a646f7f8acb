"""Checks that apply to every filter."""

from __future__ import annotations

import copy
import pickle
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.testing.case import Case, check

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray


@check("construction")
def check_construction(case: Case) -> None:
    """Check that the factory makes new filters, whose estimates can be read at once."""
    first, second = case.factory(), case.factory()
    if first is second:
        case.fail("the factory returned the same object twice, expected a new filter at each call")
    for name in ("x", "P", "x_prior", "P_prior"):
        if not hasattr(first, name):
            case.fail(f"{name} cannot be read before the first predict")
    repr(first)


@check("shapes")
def check_shapes(case: Case) -> None:
    """Check the shapes of x and P at all times, and that they are finite after an update."""
    m = case.dim_x
    expected: dict[str, list[tuple[int, ...]]] = {"x": [(m, 1), (m,)], "P": [(m, m)]}
    f = case.factory()
    for when, verb in (
        ("before the first predict", lambda: None),
        ("after predict", f.predict),
        ("after update", lambda: f.update(case.zs[0])),
    ):
        verb()
        for name in ("x", "P", "x_prior", "P_prior"):
            shape = np.shape(getattr(f, name))
            if shape not in expected[name[0]]:
                case.fail(f"{name} has shape {shape} {when}, expected {expected[name[0]][0]}")
    case.require_finite(f, "after an update")


@check("covariance")
def check_covariance(case: Case) -> None:
    """Check that P and P_prior are symmetric and positive semi-definite."""
    f = case.factory()
    for k, z in enumerate(case.zs):
        f.step(z)
        for name in ("P", "P_prior"):
            P = np.array(getattr(f, name), dtype=np.float64)
            largest = np.abs(P).max(initial=0.0)
            if not np.abs(P - P.T).max(initial=0.0) <= 1e-9 * largest:
                case.fail(f"{name} is {P.tolist()} after step {k}, expected a symmetric matrix")
            smallest = np.linalg.eigvalsh(0.5 * (P + P.T))[0]
            if not smallest >= -1e-9 * largest:
                case.fail(f"{name} has the eigenvalue {smallest} after step {k}, expected none below 0")


@check("repeatable")
def check_repeatable(case: Case) -> None:
    """Check that the same observations give the same states."""
    first, second = (case.along(case.factory(), case.zs) for _ in range(2))
    case.compare(first, second, "two new filters along the same series")


@check("step")
def check_step(case: Case) -> None:
    """Check that step is predict, then update, and returns x."""
    f, g = case.stepped(2), case.stepped(2)
    returned = f.step(case.zs[2])
    g.predict()
    g.update(case.zs[2])
    case.compare(case.state(f), case.state(g), "step, instead of predict and update")
    if not np.array_equal(returned, f.x):
        case.fail(f"step returned {returned!r}, expected x, {f.x!r}")


@check("priors")
def check_priors(case: Case) -> None:
    """Check that x_prior and P_prior are what predict left in x and P, after the update and in results.

    A filter whose ``x_prior`` is the array of ``x`` itself shows the updated state there as soon as an
    update writes into ``x``.
    """
    f = case.factory()
    predicted: dict[str, list[FloatArray]] = {"x_prior": [], "P_prior": []}
    for k, z in enumerate(case.zs):
        f.predict()
        after = {f"{name}_prior": np.array(getattr(f, name), dtype=np.float64) for name in ("x", "P")}
        f.update(z)
        shown = {name: np.array(getattr(f, name), dtype=np.float64) for name in after}
        case.compare(shown, after, f"after step {k}, instead of x and P after its predict")
        for name, value in after.items():
            predicted[name].append(value)
    got = case.fields(case.factory().filter(case.zs))
    expected = {name: np.array(values) for name, values in predicted.items() if name in got}
    case.compare(got, expected, "filter, instead of x and P after each predict")


@check("filter")
def check_filter(case: Case) -> None:
    """Check that filter is step along the series."""
    result = case.factory().filter(case.zs)
    steps = case.along(case.factory(), case.zs)
    if len(result) != len(case.zs):
        case.fail(f"the result has {len(result)} steps, expected {len(case.zs)}")
    got = case.fields(result)
    wanted = [name for name in ("x", "P", "x_prior", "P_prior", "log_likelihood") if name in steps]
    expected = {name: steps[name] for name in {*wanted, *got} & steps.keys()}
    n, m = len(case.zs), case.dim_x
    for name, value in got.items():
        shape = {"x": (n, m), "P": (n, m, m)}.get(name.removesuffix("_prior"), value.shape)
        if value.shape != shape:
            case.fail(f"{name} of the result has shape {value.shape}, expected {shape}")
    case.compare(got, expected, "filter, instead of step by step")


@check("continuation")
def check_continuation(case: Case) -> None:
    """After filter the series can be continued; filter starts where it should."""
    f = case.factory()
    f.filter(case.zs[:-2])
    case.same(f, case.stepped(len(case.zs) - 2), "step after filter")
    f = case.stepped(3)
    if case.switching:
        got, expected = f.filter(case.zs), case.factory().filter(case.zs)
        case.compare(case.fields(got), case.fields(expected), "filter, restarted from the initial law")
    else:
        got, steps = f.filter(case.zs[3:]), case.along(case.stepped(3), case.zs[3:])
        case.compare({"x": got.x}, {"x": steps["x"]}, "filter, from the current state on")


@check("empty_series")
def check_empty_series(case: Case) -> None:
    """Check that a series of no observations has a result of no steps."""
    result = case.factory().filter(np.empty((0, case.dim_z)))
    if len(result) != 0:
        case.fail(f"filter returned {len(result)} steps for a series of none")


@check("batch_filter")
def check_batch_filter(case: Case) -> None:
    """Check that batch_filter returns filterpy's four arrays."""
    f = case.factory()
    returned = f.batch_filter(case.zs)
    if len(returned) != 4:
        case.fail(f"{len(returned)} arrays were returned, expected 4")
    steps = case.along(case.factory(), case.zs)
    n, m = len(case.zs), case.dim_x
    for array, name in zip(returned, ("x", "P", "x_prior", "P_prior"), strict=True):
        admissible = {(n, m, m)} if name[0] == "P" else {(n, m, 1), (n, m)}
        if array.shape not in admissible:
            case.fail(f"the array of {name} has shape {array.shape}, expected {max(admissible, key=len)}")
        case.compare({name: array}, {name: steps[name]}, "batch_filter, instead of step by step")


@check("observation_forms")
def check_observation_forms(case: Case) -> None:
    """Check that lists, flat, row and column vectors are the same observation."""
    z = case.zs[2]
    forms: list[Any] = [z.tolist(), z[:, None].copy(), z[None, :].copy(), z[:, None].tolist()]
    if case.dim_z == 1:
        forms += [float(z[0]), np.array(z[0])]
    expected = case.state(case.stepped(3))
    for form in forms:
        f = case.stepped(2)
        f.predict()
        f.update(form)
        case.compare(case.state(f), expected, f"update({form!r})")


@check("bad_observations")
def check_bad_observations(case: Case) -> None:
    """Check that wrong shapes and infinite values are refused and change nothing."""
    m = case.dim_z
    bad: list[Any] = [np.zeros(m + 1), np.zeros((m, 1, 1)), np.zeros((2, m + 1)), [], "nothing"]
    bad += [np.where(np.arange(m) == 0, np.inf, case.zs[2]), np.where(np.arange(m) == 0, -np.inf, case.zs[2])]
    for z in bad:
        f, g = case.stepped(2), case.stepped(2)
        f.predict()
        g.predict()
        case.refuses(f"update({z!r})", partial(f.update, z))
        f.update(case.zs[2])
        g.update(case.zs[2])
        case.same(f, g, f"after a failed update({z!r})")


@check("input")
def check_input(case: Case) -> None:
    """Check that arrays given to the filter are neither kept nor written into."""
    z, zs = case.zs[2].copy(), case.zs.copy()
    f = case.stepped(2)
    f.step(z)
    before = case.state(f)
    if not np.array_equal(z, case.zs[2]):
        case.fail(f"step wrote into its argument: {z.tolist()} instead of {case.zs[2].tolist()}")
    z[:] = 7.0
    case.compare(case.state(f), before, "after the array given to step was written into")
    if hasattr(f, "z") and f.z is not None and (np.ravel(f.z) == 7.0).any():
        case.fail("z is the array given to step, expected a copy")
    case.factory().filter(zs)
    if not np.array_equal(zs, case.zs):
        case.fail("filter wrote into its argument")


@check("copy")
def check_copies(case: Case) -> None:
    """Check that copies are independent and go on like the original."""
    ways: dict[str, Callable[[Any], Any]] = {"copy()": lambda f: f.copy(), "copy.deepcopy": copy.deepcopy}
    for how, make in ways.items():
        for n in (0, 3):
            f = case.stepped(n)
            before = case.state(f)
            g = make(f)
            g.step(case.zs[n])
            case.compare(case.state(f), before, f"after a step of a copy made by {how} after {n} steps")
            case.same(make(f), f, f"a copy made by {how} after {n} steps")


@check("pickle")
def check_pickled(case: Case) -> None:
    """Check that a pickled filter goes on like the original."""
    for n in (0, 3):
        f = case.stepped(n)
        case.same(pickle.loads(pickle.dumps(f)), f, f"unpickled after {n} steps")


@check("saver")
def check_saver(case: Case) -> None:
    """Check that filterpy's Saver records every step, missing observations included."""
    from filterpy.common import Saver

    f = case.factory()
    record = Saver(f)
    record.save()
    expected = [np.array(f.x)]
    for k, z in enumerate(case.zs[:5]):
        f.predict()
        f.update(None if k == 3 and case.no_missing is None else z)
        record.save()
        expected.append(np.array(f.x))
    record.to_array()
    if not np.allclose(np.array(record.x, dtype=np.float64), np.array(expected), equal_nan=True):
        case.fail(
            f"filterpy.common.Saver stored x = {record.x.tolist()}, expected {np.array(expected).tolist()}"
        )


@check("reset")
def check_reset(case: Case) -> None:
    """Check that reset leads back to the state before the first verb."""
    f = case.factory()
    f.reset()
    case.same(f, case.factory(), "after a reset before any step")
    f.reset()
    case.same(f, case.factory(), "after two steps and a reset")
    f.filter(case.zs)
    f.reset()
    case.same(f, case.factory(), "after filter and a reset")
