"""Checks of what a filter promises to those who feed it and to those who change it."""

from __future__ import annotations

from functools import partial
from inspect import Parameter, signature
from types import MethodType
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.testing.case import Case, check

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray


@check("missing_forms")
def check_missing_forms(case: Case) -> None:
    """Check that what is masked, or NA to pandas, is missing, one by one and in a series."""
    m = case.dim_z
    hidden = np.ma.array(np.full(m, 1e6), mask=True)
    forms: dict[str, Any] = {"all of it masked": hidden, "a list of None": [None] * m}
    gaps = np.ma.array(case.zs, mask=False)
    gaps[1:3] = 1e6
    gaps[1:3] = np.ma.masked
    tables: dict[str, Any] = {
        "masked rows": gaps,
        "a list with a masked array": [*case.zs[:1], hidden, hidden],
    }
    tables["a list with a masked array"] += list(case.zs[3:])
    try:
        import pandas as pd
    except ImportError:
        pass
    else:
        forms["pandas' NA"] = pd.array([pd.NA] * m, dtype="Float64")
        frame = pd.DataFrame(case.zs).convert_dtypes()
        frame.iloc[1:3] = pd.NA
        tables["rows of pandas' NA"] = frame
    for form, z in forms.items():
        f, g = case.stepped(2), case.stepped(2)
        f.step(z)
        g.step(None)
        case.same(f, g, f"step with {form}, instead of step(None)")
    listed: list[Any] = [None if k in (1, 2) else z for k, z in enumerate(case.zs)]
    steps = case.along(case.factory(), listed)
    for form, zs in tables.items():
        result = case.factory().filter(zs)
        expected = {"x": steps["x"], "P": steps["P"]}
        case.compare(case.fields(result), expected, f"filter of a series with {form}")


@check("refused")
def check_refused(case: Case) -> None:
    """Check that a step and a series which are refused leave the filter as it was."""
    bad = case.zs
    bad[-1, 0] = np.inf
    calls: dict[str, Callable[[Any], Any]] = {
        "step with an infinite observation": lambda f: f.step(bad[-1]),
        "step with a text": lambda f: f.step("nothing"),
        "filter of a series that ends in infinity": lambda f: f.filter(bad),
        "filter of a series that ends in a text": lambda f: f.filter([*case.zs[:-1].tolist(), "nothing"]),
        "filter_many of series one of which ends in infinity": lambda f: f.filter_many(
            np.stack([case.zs, bad])
        ),
    }
    for what, call in calls.items():
        f = case.stepped(2)
        case.refuses(what, partial(call, f))
        case.same(f, case.stepped(2), f"after a refused {what}")


@check("overrides")
def check_overrides(case: Case) -> None:
    """Check that an update which a subclass or one object has changed is the one that is called."""
    for how, change in (("a subclass", _in_a_subclass), ("one object", _in_the_object)):
        expected = case.along(case.factory(), 0.5 * case.zs)
        wanted = {"x": expected["x"], "P": expected["P"]}
        what = f"whose update was changed in {how} to take half of what it is given"
        case.compare(case.along(change(case), case.zs), wanted, f"step of a filter {what}")
        case.compare(case.fields(change(case).filter(case.zs)), wanted, f"filter of one {what}")
        many = case.fields(change(case).filter_many(case.zs[None], keep=("x", "P")))
        one = {name: value[0] for name, value in many.items()}
        case.compare(one, wanted, f"filter_many of one {what}")


def _halving(update: Any) -> Callable[..., None]:
    def half(self: Any, z: Any, *args: Any, **kwargs: Any) -> None:
        update(self, None if z is None else 0.5 * np.asarray(z, dtype=np.float64), *args, **kwargs)

    return half


def _in_a_subclass(case: Case) -> Any:
    f = case.factory()
    cls = type(f)
    f.__class__ = type(cls.__name__, (cls,), {"update": _halving(cls.update)})
    return f


def _in_the_object(case: Case) -> Any:
    f = case.factory()
    f.update = MethodType(_halving(type(f).update), f)
    return f


@check("resume")
def check_resume(case: Case) -> None:
    """Check that with ``resume`` parts of a series give what the whole gives."""
    for name in ("filter", "filter_many"):
        known = signature(getattr(case.factory(), name)).parameters
        if "resume" not in known and all(one.kind is not Parameter.VAR_KEYWORD for one in known.values()):
            case.fail(
                f"{name} has no argument resume, expected resume=False; with True it goes on from where "
                "the filter stands"
            )
    zs = case.zs
    whole = case.factory()
    expected = case.fields(whole.filter(zs))
    for cuts in ((1,), (2, 4), (3, 3)):
        f = case.factory()
        parts = [
            case.fields(f.filter(zs[a:b], resume=True))
            for a, b in zip((0, *cuts), (*cuts, len(zs)), strict=True)
        ]
        got: dict[str, FloatArray] = {
            name: np.concatenate([part[name] for part in parts]) for name in expected if name in parts[-1]
        }
        case.compare(got, expected, f"filter with resume, in parts cut at {cuts}")
        case.compare(case.state(f), case.state(whole), f"after filter with resume, in parts cut at {cuts}")
    f = case.stepped(2)
    many = case.fields(f.filter_many(zs[None, 2:], keep=("x", "P"), resume=True))
    wanted = {name: expected[name][2:] for name in ("x", "P")}
    case.compare({name: value[0] for name, value in many.items()}, wanted, "filter_many with resume")
    case.same(f, case.stepped(2), "after filter_many with resume")
