"""What is left of a belief by a constraint or a measurement, and what to do if that is nothing."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import EmptyIntersectionError, ParameterError, SupportWarning
from fuzzykf.possibility.beliefs import nothing_explains
from fuzzykf.possibility.constraint import as_measurement, is_crisp

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.mapping import Mapping
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.protocol import Belief, Outcome

__all__ = ["assigned", "explained", "restrained"]


def assigned(belief: Belief, constraint: Membership | None) -> Belief:
    """Return what a constraint leaves of a membership that a user gave.

    Raises
    ------
    ParameterError
        If that is nothing.

    Warns
    -----
    SupportWarning
        If a grid is too coarse.
    """
    if constraint is None:
        return belief
    outcome = belief.constrain(constraint)
    if outcome.belief is None:
        lower, upper = belief.bounds()
        raise ParameterError(
            f"constraint: got {constraint!r}, which excludes all that is possible; that is within "
            f"{lower.tolist()} and {upper.tolist()}"
        )
    for note in outcome.notes:
        warnings.warn(note, SupportWarning, stacklevel=3)
    return outcome.belief


def restrained(belief: Belief, constraint: Membership, on_empty: str) -> Outcome:
    """Combine a prediction with a constraint.

    Parameters
    ----------
    belief : Belief
    constraint : Membership
    on_empty : {"raise", "keep", "reset"}
        If they exclude each other: raise; keep the prediction; take all states of the constraint.

    Returns
    -------
    Outcome
        It has a belief.

    Raises
    ------
    EmptyIntersectionError
        If nothing is left, and ``on_empty`` is "raise" or there is nothing to restart from.
    """
    outcome = belief.constrain(constraint)
    if outcome.belief is not None:
        return outcome
    if on_empty == "keep":
        return replace(outcome, belief=belief)
    note = ""
    if on_empty == "reset":
        crisp = is_crisp(constraint)
        restarted = (
            belief.restart(*as_measurement(constraint)) if not crisp or _is_finite(constraint) else None
        )
        if restarted is not None:
            return replace(outcome, belief=_part(restarted, constraint) if crisp else restarted)
        note = "; nor does it bound the state, so that there is nothing to restart from"
    lower, upper = belief.bounds()
    raise EmptyIntersectionError(
        f"constraint: got {constraint!r}, which excludes all that is predicted; that is within "
        f"{lower.tolist()} and {upper.tolist()}{note}"
    )


def explained(
    belief: Belief,
    measure: Mapping,
    noise: Membership,
    z: FloatArray,
    constraint: Membership | None,
    on_empty: str,
) -> Outcome:
    """Combine a prediction, which the constraint has been applied to, with a measurement.

    Parameters
    ----------
    belief : Belief
    measure : Mapping
    noise : Membership
    z : ndarray
        Of the components seen.
    constraint : Membership or None
        A box is applied again: a grid may have been extended beyond it.  Any other one would count twice.
    on_empty : {"raise", "keep", "reset"}
        If they exclude each other: raise; keep the prediction; take what the measurement says.

    Returns
    -------
    Outcome
        It has a belief.

    Raises
    ------
    EmptyIntersectionError
        If nothing is left, and ``on_empty`` is "raise" or there is nothing to restart from.
    """
    outcome = belief.update(measure, noise, z)
    if outcome.belief is not None and constraint is not None and is_crisp(constraint):
        inner = outcome.belief.constrain(constraint)
        notes, possibility = [*outcome.notes, *inner.notes], outcome.possibility * inner.possibility
        outcome = replace(outcome, belief=inner.belief, notes=notes, possibility=possibility)
    if outcome.belief is not None:
        return outcome
    if on_empty == "keep":
        return replace(outcome, belief=belief)
    note = ""
    if on_empty == "reset":
        restarted = belief.restart(measure, noise, z)
        if restarted is not None:
            restarted = _part(restarted, constraint)
            if restarted is not None:
                return replace(outcome, belief=restarted)
            note = "; nor does any state within the constraint"
        else:
            note = "; nor does it bound the state, so that there is nothing to restart from"
    raise nothing_explains(z, measure, belief, outcome, note)


def _part(belief: Belief, constraint: Membership | None) -> Belief | None:
    return belief if constraint is None else belief.constrain(constraint).belief


def _is_finite(constraint: Membership) -> bool:
    return bool(np.isfinite(constraint.support()).all())
