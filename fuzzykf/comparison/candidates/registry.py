"""The one registry of candidates: what is compared is known here by its name."""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from fuzzykf.comparison.candidates.switching import hard_candidate
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import brief

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.comparison.candidates import Candidate

__all__ = ["FAMILIES", "candidate", "candidate_names", "chosen"]

#: Modules of this folder with a tuple ``CANDIDATES``, in the order in which names are told.  A new
#: family is a module and its line here.
FAMILIES = (
    "switching",
    "state_space",
    "memoryless",
    "filter_trained",
    "pool",
    "inputs",
    "linear",
    "regression",
    "boosting",
    "pool_boosting",
    "daily",
)


@cache
def _registry() -> dict[str, Candidate]:
    modules = [import_module(f"{__package__}.{family}") for family in FAMILIES]
    found = [one for module in modules for one in module.CANDIDATES]
    registry = {one.name: one for one in found}
    if len(registry) < len(found):
        raise ParameterError(f"CANDIDATES: got {[one.name for one in found]}, expected each name once")
    return registry


def candidate_names() -> tuple[str, ...]:
    """Return the names of all candidates of `compare`, `compare_models` and the command line.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> from fuzzykf.comparison import candidate_names
    >>> "kalman" in candidate_names()
    True
    """
    return tuple(_registry())


def candidate(name: str) -> Candidate:
    """Return a candidate by its name.

    Parameters
    ----------
    name : str
        A name from `candidate_names`, or "hard4", "hard5", ...

    Returns
    -------
    Candidate

    Raises
    ------
    ParameterError
        If there is no such candidate.

    Examples
    --------
    >>> from fuzzykf.comparison import candidate
    >>> candidate("kalman").title
    'KalmanFilter'
    """
    given: Any = name
    if not isinstance(given, str):
        raise ParameterError(
            f"candidates: got {brief(given)}, expected names of {', '.join(candidate_names())}"
        )
    if name in _registry():
        return _registry()[name]
    if hard := re.fullmatch(r"hard([1-9]\d*)", name):
        return hard_candidate(int(hard[1]))
    raise ParameterError(f"candidates: got {name!r}, expected names of {', '.join(candidate_names())}")


def chosen(candidates: Sequence[str | Candidate]) -> list[Candidate]:
    """Return candidates of which some are given by name.

    Raises
    ------
    ParameterError
        If there is none, or a name is unknown or comes twice.
    """
    given: Any = candidates
    if not hasattr(given, "__iter__"):
        raise ParameterError(
            f"candidates: got {brief(given)}, expected names of {', '.join(candidate_names())}"
        )
    found = [one if hasattr(one, "learn") else candidate(one) for one in given]
    names = [one.name for one in found]
    if not names or len(set(names)) < len(names):
        raise ParameterError(f"candidates: got {names}, expected one at least and each name once")
    return found
