"""Learning the parameters of switching models from data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning.data import gather
from fuzzykf.switching.learning.result import FitResult
from fuzzykf.switching.learning.supervised import fit_fuzzy, fit_hard

if TYPE_CHECKING:
    from fuzzykf.switching.fuzzy_model import CGOFMSModel
    from fuzzykf.switching.hard_model import CGOMSModel

__all__ = ["FitResult", "fit_fuzzy_model", "fit_hard_model"]

_HIDDEN = (
    "r: missing; learning with a hidden switch is not supported yet, give the switch at each observation"
)


def fit_fuzzy_model(
    x: Any, y: Any, r: Any, *, law: str, form: str, n_nodes: int, rule: str
) -> FitResult[CGOFMSModel]:
    """See `CGOFMSModel.fit`."""
    _check_form(form)
    data = gather(x, y, r)
    if r is None:
        raise NotImplementedError(_HIDDEN)
    return fit_fuzzy(data, law, n_nodes, rule)


def fit_hard_model(x: Any, y: Any, r: Any, *, n_switches: int, form: str) -> FitResult[CGOMSModel]:
    """See `CGOMSModel.fit`."""
    _check_form(form)
    if n_switches < 1:
        raise ParameterError(f"n_switches: got {n_switches}, expected at least 1")
    data = gather(x, y, r)
    if r is None:
        raise NotImplementedError(_HIDDEN)
    return fit_hard(data, n_switches)


def _check_form(form: str) -> None:
    if form != "regression":
        raise ParameterError(f"form: got {form!r}, expected 'regression'")
