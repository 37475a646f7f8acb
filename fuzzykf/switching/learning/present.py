"""From what was found to a `FitResult`: along the rows as they were given, with their index."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.results import FitResult

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.fit import Fitted

__all__ = ["present"]


def present(
    fitted: Fitted,
    bic_of_forms: dict[str, float],
    data: TrainingData,
    x: Any,
    *,
    refit: Callable[..., FitResult[Any]] | None = None,
    continuation: Callable[..., FitResult[Any]] | None = None,
) -> FitResult[Any]:
    """Make a result.

    Parameters
    ----------
    fitted : Fitted
    bic_of_forms : dict of str to float
    data : TrainingData
        What was learned from.
    x : object
        The states as they were given, of which the index is taken.
    refit, continuation : callable, optional
        What `FitResult.bootstrap` and `FitResult.update` call.
    """
    weights: Any = np.full((data.n_rows, fitted.class_weights.shape[1]), np.nan)
    weights[data.kept] = fitted.class_weights
    switch: Any = None
    if fitted.switch_mean is not None:
        switch = np.full(data.n_rows, np.nan)
        switch[data.kept] = fitted.switch_mean
    if hasattr(x, "to_numpy") and hasattr(x, "index"):
        import pandas as pd

        weights = pd.DataFrame(weights, x.index, [f"class_weights{k}" for k in range(weights.shape[1])])
        if switch is not None:
            switch = pd.Series(switch, index=x.index, name="switch_mean")

    return FitResult(
        model=fitted.model._with_labels(data.labels),
        log_likelihood=fitted.log_likelihood,
        n_parameters=fitted.n_parameters,
        n_observations=len(data.z),
        trace=np.array(fitted.trace),
        converged=fitted.converged,
        warnings=(*fitted.warnings, *_unjudged(fitted), *_unused(fitted, data)),
        switch_mean=switch,
        class_weights=weights,
        bic_of_forms=bic_of_forms,
        refit=refit,
        continuation=continuation,
        occupancy=fitted.class_weights.mean(axis=0),
        training=fitted.training,
    )


def _unjudged(fitted: Fitted) -> list[str]:
    """Say that nothing could be learned for the filter, and why."""
    training = fitted.training
    if training is None or not training.note:
        return []
    return [
        f"kept the joint fit: the rows before the {training.n_kept_back:,} validation states are not "
        f"sufficient ({training.note})"
    ]


def _unused(fitted: Fitted, data: TrainingData) -> list[str]:
    """Say that inputs and features have no effect where the joint fit was kept."""
    if fitted.training is None or fitted.training.kept != "joint" or not sum(data.window):
        return []
    return ["kept the joint fit, in which inputs and features have no effect: only the filter fit uses them"]
