"""Make calls in a process whose memory and time are limited, and say how each of them ended."""

from __future__ import annotations

import contextlib
import faulthandler
import inspect
import re
import resource
import signal
import tempfile
import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from calls_arguments import argument, show
from parts import differences, parts

if TYPE_CHECKING:
    from calls_table import Verb

__all__ = ["KINDS", "Outcome", "case", "work"]

#: How a call may end, by one word.  The first two are as they should be.
KINDS = {
    "right": "right",
    "named": "errors that name the argument",
    "obscure": "obscure errors",
    "silent": "silent non-finite numbers",
    "warning": "warnings that leak",
    "changed": "changed after an error, or an argument changed",
    "memory": "out of memory",
    "hang": "hangs",
    "crash": "crashes",
    "differs": "engines differ",
}

#: Limits of a worker: bytes of address space, seconds of a call.
BYTES, SECONDS = 4 << 30, 10.0

#: Beyond this, numbers make rounding errors that can be seen in others.
HUGE = 1e5

#: What a filter knows; finite whatever was missing.
STATE = {"x", "P", "x_prior", "P_prior", "x_post", "P_post", "mu", "switch", "switch_mean", "class_weights"}

#: NaN where there has been no observation, or a switch is not known; infinite where there is no end.
UNKNOWN = {
    "means_",
    "z",
    "y",
    "nis",
    "mahalanobis",
    "difference",
    "difference_low",
    "difference_high",
    "log_likelihoods",
}
BOUNDS = {"lower", "upper", "impossible", "support"}

#: Of calls, this share is with valid arguments only, and this with one that is not.
VALID, ONE = 0.45, 0.45


class TimeUp(BaseException):
    """A call has taken too long."""


@dataclass
class Outcome:
    """How a call ended.

    Attributes
    ----------
    call : str
        What was called.
    kind : str
        One of KINDS.
    text : str
        The error, or what is wrong.
    found : dict
        What was returned, and how the object was left.
    size : float
        Of which the rounding errors are, at most: the largest number squared, where that is huge.
    broken : bool
        Whether the user has assigned what is not finite to an attribute: what follows is his affair.
    """

    call: str
    kind: str
    text: str = ""
    found: dict[str, Any] = field(default_factory=dict)
    size: float = 1.0
    broken: bool = False


# --------------------------------------------------------------------------- what is wrong


def bad_numbers(found: dict[str, Any], before: dict[str, Any], tainted: bool, infinite: bool) -> str:
    """Name what is not finite though it should be, and was before."""
    for name, value in found.items():
        last = re.sub(r"[.\d]*$", "", name).rpartition(".")[2]
        if not isinstance(value, np.ndarray) or value.dtype.kind != "f" or last in UNKNOWN:
            continue
        known = before.get(name.removeprefix("self"))
        if np.isfinite(value).all() or (isinstance(known, np.ndarray) and not np.isfinite(known).all()):
            continue
        wrong = np.isnan(value)
        if last in STATE:
            wrong = ~np.isfinite(value)
        elif last == "log_likelihood":
            wrong = wrong | (value == np.inf)
        elif tainted or last in BOUNDS:
            wrong = wrong & (not tainted)
        elif not infinite:
            wrong = ~np.isfinite(value)
        if wrong.any():
            return f"{name} = {value.ravel()[:4]}"
    return ""


def size_of(found: dict[str, Any]) -> float:
    """Return the largest number that is finite."""
    arrays = [
        one for one in found.values() if isinstance(one, np.ndarray) and one.dtype.kind in "fc" and one.size
    ]
    sizes = [
        float(abs(value)) for value in found.values() if type(value) in (int, float) and abs(value) < 1e300
    ]
    return max(
        [0.0, *sizes, *(float(np.abs(np.nan_to_num(one, posinf=0.0, neginf=0.0)).max()) for one in arrays)]
    )


def is_tainted(values: Any) -> bool:
    """Whether an argument holds something that is not finite, or nothing."""
    found = parts(list(values), depth=6)
    return any(
        value is None
        or (isinstance(value, np.ndarray) and value.dtype.kind in "fc" and not np.isfinite(value).all())
        for value in found.values()
    )


def names_of(call: Any, verb: Verb) -> set[str]:
    """Return the names of which an error should have one."""
    names = set(verb.arguments) | {verb.name}
    with contextlib.suppress(TypeError, ValueError):
        names |= set(inspect.signature(call).parameters)
    return names - {"self"}


def kind_of(error: Exception, names: set[str]) -> str:
    """Tell a good error from an obscure one."""
    from fuzzykf.errors import FuzzykfError

    if isinstance(error, FuzzykfError):
        return "named"
    if isinstance(error, MemoryError):
        return "memory"
    if isinstance(error, OSError):  # as everywhere in Python, it names the file
        return "named" if error.filename is not None else "obscure"
    words = set(re.findall(r"\w+", str(error)))
    return "named" if isinstance(error, TypeError | ValueError) and words & names else "obscure"


# --------------------------------------------------------------------------- one call


def draw(rng: np.random.Generator, verb: Verb, folder: str) -> tuple[list[Any], dict[str, Any]]:
    """Draw the arguments of a call."""
    kinds = verb.arguments
    named = [name for name, kind in kinds.items() if not kind.optional or rng.random() < 0.5]
    luck = rng.random()
    bad = set() if luck < VALID or not named else {named[rng.integers(len(named))]}
    if luck > VALID + ONE and bad:
        bad.add(named[rng.integers(len(named))])
    values = {name: argument(rng, kinds[name], name in bad) for name in named}
    for name, value in values.items():
        if isinstance(value, str) and value.startswith("file:"):
            values[name] = f"{folder}/{value[5:]}"
    positional = [values.pop(name) for name in named if name.startswith("arg")]
    return positional, values


def called(call: Any, args: list[Any], kwargs: dict[str, Any]) -> tuple[Any, Exception | None, list[Any]]:
    """Make a call with a clock at its side, and return what came of it with the warnings."""
    result, failed = None, None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        try:
            result = call(*args, **kwargs)
            if inspect.isgenerator(result):
                result = list(result)
        except Exception as error:
            failed = error
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    return result, failed, [one for one in caught if not issubclass(one.category, UserWarning)]


def outcome(
    target: Any, verb: Verb, args: list[Any], kwargs: dict[str, Any], tainted: bool, broken: bool
) -> Outcome:
    """Make a call and judge it."""
    given = ", ".join([*map(show, args), *(f"{name}={show(value)}" for name, value in kwargs.items())])
    text = f"{verb.name}({given})"
    call = verb.of(target)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        before, handed = parts(target), parts([args, kwargs], depth=6)
    try:
        result, error, caught = called(call, args, kwargs)
    except TimeUp:
        return Outcome(text, "hang", f"more than {SECONDS:.0f} s")
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        after = parts(target)
        found = parts(result, "result") | {f"self{name}": value for name, value in after.items()}
        moved = differences(handed, parts([args, kwargs], depth=6), 0.0)
    if moved:
        return Outcome(text, "changed", f"argument {moved}", found)
    if error is not None:
        said = f"{type(error).__name__}: {str(error)[:300]}"
        changed = differences(before, after, 0.0)
        if changed:
            return Outcome(text, "changed", f"{changed} after {said}", found)
        return Outcome(text, kind_of(error, names_of(call, verb)), said, found)
    if caught and not broken:
        return Outcome(text, "warning", f"{caught[0].category.__name__}: {caught[0].message}", found)
    told_later = (type(target).__name__, verb.name) == ("KnownSwitchFilter", "predict")
    fresh = verb.name in ("reset", "copy") or type(result).__name__ == "KnownSwitchFilter" or told_later
    bad = "" if fresh or broken or verb.gaps else bad_numbers(found, before, tainted, verb.infinite)
    return Outcome(text, "silent", bad, found) if bad else Outcome(text, "right", "", found)


def case(number: int, seed: int, folder: str) -> tuple[str, list[Outcome]]:
    """Make an object, and call a few of its verbs; end with the first call that is not as it should be."""
    from calls_table import drawn

    rng = np.random.default_rng([seed, number])
    name, target, verbs = drawn(rng)
    outcomes: list[Outcome] = []
    tainted, broken, largest = False, False, 0.0
    for verb in verbs:
        args, kwargs = draw(rng, verb, folder)
        tainted = tainted or is_tainted([*args, *kwargs.values()])
        broken = broken or (tainted and verb.name.startswith("set "))  # as the user wants it
        outcomes.append(outcome(target, verb, args, kwargs, tainted, broken))
        largest = max(largest, size_of(outcomes[-1].found), size_of(parts([args, kwargs], depth=6)))
        outcomes[-1].broken = broken
        outcomes[-1].size = min(largest * largest, 1e300) if largest > HUGE else 1.0
        if outcomes[-1].kind not in ("right", "named"):
            break
    return name, outcomes


def time_is_up(*_: Any) -> None:
    """End a call that takes too long."""
    raise TimeUp


def work(numbers: range, seed: int, results: Any, trace: str) -> None:
    """Send how each case of a range ended."""
    import matplotlib

    matplotlib.use("Agg")
    faulthandler.enable(open(trace, "w"))  # noqa: SIM115  (open as long as the process lives)
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    signal.signal(signal.SIGALRM, time_is_up)
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
    ):  # a word may be the name of a file
        for number in numbers:
            results.send((number, *case(number, seed, folder)))
    results.send(None)
