"""Which form of the Gaussian part: the one that describes the data with fewer parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import FuzzykfError
from fuzzykf.results import bic

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.fit import Fitted

__all__ = ["forms_to_try", "learn_forms"]


def forms_to_try(form: str, data: TrainingData, n_fuzzy: int = 2) -> tuple[str, ...]:
    """Return the forms that a name stands for; "auto" is both, where both can be learned.

    The covariance form is learned from complete transitions alone.  Where some states are missing it would
    see other data than the regression form, and BIC could not compare them.

    Parameters
    ----------
    form : {"auto", "regression", "covariance"}
    data : TrainingData
    n_fuzzy : int
        Number of classes between which a fuzzy switch moves; between more than two the covariance form
        is not learned.
    """
    if form != "auto":
        return (form,)
    both = data.z.shape[1] == 2 and n_fuzzy == 2 and data.is_complete
    return ("regression", "covariance") if both else ("regression",)


def learn_forms(
    learn: Callable[[str], Fitted], forms: tuple[str, ...], data: TrainingData
) -> tuple[Fitted, dict[str, float]]:
    """Learn in each form, and take the one of least BIC.

    Neither form contains the other: they interpolate other quantities between the regimes,
    so this is a choice between models that are not nested.  A form whose parameters were
    stopped by the bound of positive definiteness is taken only if there is no other, since
    BIC holds for a maximum inside the parameter space.

    Parameters
    ----------
    learn : callable
        From the name of a form to what was found.
    forms : tuple of str
    data : TrainingData

    Returns
    -------
    Fitted
        The chosen one.
    dict
        BIC of each form that was learned.

    Raises
    ------
    FuzzykfError, LinAlgError
        If no form could be learned: what the first one said.
    """
    found: dict[str, Fitted] = {}
    refused: list[Exception] = []
    for form in forms:
        try:
            found[form] = learn(form)
        except (FuzzykfError, np.linalg.LinAlgError) as error:
            refused.append(error)
    if not found:
        raise refused[0]
    values = {form: bic(f.n_parameters, len(data.z), f.log_likelihood) for form, f in found.items()}
    best = min(found, key=lambda form: (found[form].bounded, values[form]))
    others = [form for form in found if values[form] < values[best]]
    notes = [
        f"the form {other!r} has the smaller BIC ({values[other]:.1f} against {values[best]:.1f}), but "
        f"positive definiteness bounds its parameters, so it was not taken; form={other!r} does"
        for other in others
    ]
    chosen = found[best]
    return (replace(chosen, warnings=[*chosen.warnings, *notes]) if notes else chosen), values
