"""What `fit` is told of inputs and features, and the choice between maps of the window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.gaussian import as_count, brief
from fuzzykf.switching.dynamics.features import MOST_LAGS, WindowFeatures

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.results import FitResult

__all__ = ["AUTO", "LAGS", "as_features", "chosen"]

#: Distributed lags: three observations one by one, and the means of 3, 6 and 12 steps before them.
LAGS: dict[str, Any] = {"order": 3, "blocks": (3, 6, 12)}

#: Asks for the map whose filter scores best on states kept back.
AUTO = "auto"


#: Scores that differ by less, in parts of their size, are equal.
ROUNDING = 1e-9


def maps(order: int) -> tuple[WindowFeatures, ...]:
    """Return the maps between which `AUTO` chooses: nothing, lags, hinges, both, and all with products."""
    lags = LAGS | {"order": max(order, LAGS["order"])}
    return (
        WindowFeatures(order=order),
        WindowFeatures(**lags),
        WindowFeatures(order=order, hinges=3),
        WindowFeatures(**lags, hinges=3),
        WindowFeatures(**lags, hinges=3, products=True),
    )


def as_features(order: Any, features: Any, *, has_inputs: bool, objective: str) -> Any:
    """Return the map that a fit is asked for: None where there is none, `AUTO`, or one.

    Raises
    ------
    ParameterError
        If ``features`` is no map, both arguments name an order, or the choice is asked of a joint fit.
    """
    order = as_count("order", order, 1, MOST_LAGS)
    if isinstance(features, str) and features == AUTO:
        if objective != "filter":
            raise ParameterError(
                "features: got 'auto' with objective='joint', whose likelihood rises with every feature; "
                "expected objective='filter', or WindowFeatures"
            )
        return AUTO
    if features is None:
        return WindowFeatures(order=order) if order > 1 or has_inputs else None
    if not isinstance(features, WindowFeatures):
        raise ParameterError(f"features: got {brief(features)}, expected WindowFeatures, 'auto' or None")
    if order > 1:
        raise ParameterError(
            f"order: got {order} beside features, which have an order of their own; expected 1"
        )
    if features.products and not has_inputs:
        raise ParameterError("features: got products without inputs; expected inputs, or products=False")
    return None if features.is_trivial and not has_inputs else features


def chosen(order: int, has_inputs: bool, fit: Callable[[Any], FitResult[Any]]) -> FitResult[Any]:
    """Fit with each of some maps, and return the fit whose filter scored best on the states kept back.

    Raises
    ------
    FuzzykfError
        If none could be learned: what the first one said.
    """
    found: dict[str, FitResult[Any]] = {}
    refused: list[FuzzykfError] = []
    for one in maps(order):
        if one.products and not has_inputs:
            continue
        try:
            found[repr(one)] = fit(one if has_inputs or not one.is_trivial else None)
        except FuzzykfError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    scores = {name: _score(one) for name, one in found.items()}
    top = max(scores.values())
    # where a joint fit stays, all that can be added to it has no effect: of equal scores the first one counts
    best = found[next(name for name, score in scores.items() if score >= top - ROUNDING * abs(top))]
    best.score_of_features.update(scores)
    return best


def _score(fit: FitResult[Any]) -> float:
    """Return the log score of the states kept back; minus infinity where there is none."""
    training = fit.training
    if training is None or training.note:
        return float("-inf")
    return training.score_filter if training.kept == "filter" else training.score_joint
