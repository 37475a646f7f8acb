"""Learning the parameters of switching models from data.

`fuzzykf.switching.learning.data` brings data to a common form; with a hidden switch,
`em` alternates between the posterior of the nodes and the maximisation of `gaussians`
and `chains`; `fit` chooses between starts and reports what the data cannot support, `choice`
chooses between the forms of the Gaussian part, and `update` goes on with new rows from the `statistics` of
those before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice, as_count, as_flag, check_generator
from fuzzykf.labels import NO_LABELS, Labels
from fuzzykf.progress import progress_bar
from fuzzykf.results import FitResult, bic
from fuzzykf.switching.laws.base import NODES
from fuzzykf.switching.laws.chains import as_law
from fuzzykf.switching.learning.choice import forms_to_try, learn_forms
from fuzzykf.switching.learning.data import Earlier, gather, irregular
from fuzzykf.switching.learning.fit import Fitted, Options, fit_fuzzy, fit_hard
from fuzzykf.switching.learning.law import law_to_learn
from fuzzykf.switching.learning.memory import check_memory, memory_of_fuzzy, memory_of_hard
from fuzzykf.switching.learning.notes import one_name
from fuzzykf.switching.learning.present import present
from fuzzykf.switching.learning.update import Continuation, why_not
from fuzzykf.switching.learning.window import as_features, chosen
from fuzzykf.switching.models.base import given_regimes

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import BoolArray, FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.learning.data import TrainingData
    from fuzzykf.switching.learning.further import Further
    from fuzzykf.switching.models.fuzzy import CGOFMSModel
    from fuzzykf.switching.models.hard import CGOMSModel

__all__ = ["FitResult", "fit_fuzzy_model", "fit_hard_model"]

T = TypeVar("T")


def fit_fuzzy_model(
    x: Any, y: Any, r: Any, *, law: Any, n_nodes: int | None, progress: bool | None, **options: Any
) -> FitResult[CGOFMSModel]:
    """Learn a fuzzy switching model; the function behind `CGOFMSModel.fit`.

    Parameters
    ----------
    x, y, r
        As in `CGOFMSModel.fit`; None for a hidden switch.
    law, n_nodes
        As in `CGOFMSModel.fit`.
    progress : bool or None
        As in `CGOFMSModel.fit`.
    **options
        Further arguments of `CGOFMSModel.fit`.

    Returns
    -------
    FitResult

    See Also
    --------
    fuzzykf.CGOFMSModel.fit : With all parameters and an example.
    """
    again = _over_features(
        partial(fit_fuzzy_model, x, y, r, law=law, n_nodes=n_nodes, progress=progress), options
    )
    if again is not None:
        return again
    K = 2 if isinstance(law, str) else as_law(law).n_classes
    nodes = None if n_nodes is None else as_count("n_nodes", n_nodes, 0)
    data = _prepared(x, y, r, options, K)

    def check_size(size: Callable[[int], int]) -> None:
        for form in forms_to_try(options["form"], data, K):
            memory = partial(_memory, size=size, K=K, data=data, form=form)
            check_memory("n_nodes", NODES if nodes is None else nodes, 0, memory)

    start = law_to_learn(law, nodes, check_size, is_hidden=r is None)
    return _learn(partial(fit_fuzzy, law=start, n_nodes=nodes), data, x, y, progress, options, K)


def _over_features(fit: Callable[..., FitResult[Any]], options: dict[str, Any]) -> FitResult[Any] | None:
    """Settle which map of the window is learned with; fit with each where one is to be chosen."""
    has_inputs, order = options.get("inputs") is not None, options.pop("order", 1)
    objective = options.get("objective", "joint")
    given = as_features(order, options.get("features"), has_inputs=has_inputs, objective=objective)
    options["features"] = given
    if not isinstance(given, str):
        return None
    memo: dict[int, Any] = {}
    return chosen(order, has_inputs, lambda one: fit(**{**options, "features": one, "memo": memo}))


def _memory(n_nodes: int, size: Callable[[int], int], K: int, data: TrainingData, form: str) -> int:
    return memory_of_fuzzy(size(n_nodes), K, data, form)


def fit_hard_model(
    x: Any,
    y: Any,
    r: Any,
    *,
    n_switches: int | None = None,
    n_regimes: int | None = None,
    progress: bool | None,
    **options: Any,
) -> FitResult[CGOMSModel]:
    """Learn a hard switching model; the function behind `CGOMSModel.fit`.

    Parameters
    ----------
    x, y, r
        As in `CGOMSModel.fit`; None for a hidden switch.
    n_switches, n_regimes : int
        Number of regimes, under either name.
    progress : bool or None
        As in `CGOMSModel.fit`.
    **options
        Further arguments of `CGOMSModel.fit`.

    Returns
    -------
    FitResult

    See Also
    --------
    fuzzykf.CGOMSModel.fit : With all parameters and an example.
    """
    size: Any = {"n_switches": n_switches, "n_regimes": n_regimes}
    again = _over_features(partial(fit_hard_model, x, y, r, **size, progress=progress), options)
    if again is not None:
        return again
    K = given_regimes(n_switches, n_regimes, 2)
    data = _prepared(x, y, r, options)
    for form in forms_to_try(options["form"], data):
        check_memory("n_switches, n_regimes", K, 1, partial(memory_of_hard, data=data, form=form))
    return _learn(partial(fit_hard, K=K), data, x, y, progress, options)


def _learn(
    fit: Callable[..., Fitted],
    data: TrainingData,
    x: Any,
    y: Any,
    progress: bool | None,
    options: dict[str, Any],
    n_fuzzy: int = 2,
) -> FitResult[Any]:
    forms = forms_to_try(options.pop("form"), data, n_fuzzy)

    def learn(tick: Callable[[], None] | None) -> tuple[Fitted, dict[str, float]]:
        return learn_forms(
            lambda form: fit(data, options=Options(form=form, tick=tick, **options)), forms, data
        )

    fitted, values = _with_progress(progress, learn)
    told = {**options, "form": "regression" if data.further is not None else fitted.model.form.kind}
    told.pop("memo", None)
    known = None if data.is_complete else data.known
    refit = Refit(fit, told, data.r is not None, data.labels, n_fuzzy, known, data.further, data.us)
    found = _present(fitted, values, data, x, refit)
    return replace(found, warnings=(*irregular(x, y), *one_name(data.labels), *found.warnings))


@dataclass(frozen=True)
class Refit:
    """Learns from simulated data as something was learned; a class, since closures cannot be pickled.

    Attributes
    ----------
    fit : callable
        From data and options to what is learned.
    options : dict of str to object
    knows_switch : bool
        Whether the switch was known, and is known again.
    labels : Labels
        Of the data that are simulated.
    n_fuzzy : int
        Number of classes between which a fuzzy switch moves.
    known : ndarray of bool, shape (N,), optional
        Rows in which x was known, and is known again; by default all.
    further : Further, optional
        Names of inputs, and the map of the window, as learned.
    us : ndarray, shape (N, k), optional
        Inputs of the rows.
    """

    fit: Callable[..., Fitted]
    options: dict[str, Any]
    knows_switch: bool
    labels: Labels = NO_LABELS
    n_fuzzy: int = 2
    known: BoolArray | None = None
    further: Further | None = None
    us: FloatArray | None = None

    def __call__(self, sample: Simulation) -> FitResult[Any]:
        """Learn from a simulation."""
        x = sample.x if self.known is None else np.where(self.known[:, None], sample.x, np.nan)
        r = sample.r if self.knows_switch else None
        feedback = self.options.get("state_feedback", True)
        features = None if self.further is None else self.further.features
        data = gather(
            x, sample.y, r, self.n_fuzzy, state_feedback=feedback, inputs=self.us, features=features
        )
        if data.further is not None and self.further is not None:
            data = replace(data, further=data.further._replace(inputs=self.further.inputs))
        guess = None if self.knows_switch else sample.r
        found = self.fit(data, options=Options(guess=guess, **self.options))
        value = bic(found.n_parameters, len(data.z), found.log_likelihood)
        named = replace(data, labels=self.labels)
        return _present(found, {found.model.form.kind: value}, named, sample.x, self)


def _prepared(x: Any, y: Any, r: Any, options: dict[str, Any], n_fuzzy: int = 2) -> TrainingData:
    for name in ("n_starts", "max_iter"):
        options[name] = as_count(name, options[name], 1)
    tolerance, rng = options["tolerance"], options["rng"]
    if not isinstance(tolerance, Real) or not float(tolerance) > 0.0:
        raise ParameterError(f"tolerance: got {tolerance!r}, expected a positive number")
    if rng is not None:
        check_generator(rng)
    if options["n_starts"] > 4 and rng is None:
        raise ParameterError("rng: missing; more than 4 starts are drawn at random and need a Generator")
    as_choice("form", options["form"], ("auto", "regression", "covariance"))
    if not as_flag("state_feedback", options.get("state_feedback", True)):
        if options["form"] == "covariance":
            raise ParameterError(
                "state_feedback: got False with form='covariance', whose state always depends on the one "
                "before; expected True, or the form 'regression'"
            )
        options["form"] = "regression"
    if as_choice("objective", options.get("objective", "joint"), ("joint", "filter")) == "filter":
        if options["form"] == "covariance":
            raise ParameterError(
                "objective: got 'filter' with form='covariance', which is learned jointly; expected 'joint', "
                "or the form 'regression'"
            )
        if r is not None:
            raise ParameterError(
                "r: got a switch with objective='filter', which learns what the filter needs to find it by "
                "itself; expected None, or objective='joint'"
            )
        options["form"] = "regression"
    inputs, features = options.pop("inputs", None), options.pop("features", None)
    if inputs is not None or features is not None:
        if options["form"] == "covariance":
            raise ParameterError(
                "form: got 'covariance' with inputs or features, which it does not have; expected "
                "'regression' or 'auto'"
            )
        options["form"] = "regression"
    state_feedback, complete = options.get("state_feedback", True), options["form"] == "covariance"
    return gather(
        x,
        y,
        r,
        n_fuzzy,
        state_feedback=state_feedback,
        complete=complete,
        inputs=inputs,
        features=features,
    )


def _with_progress(progress: bool | None, learn: Callable[[Callable[[], None] | None], T]) -> T:
    if progress is not None:
        progress = as_flag("progress", progress)
    with progress_bar(None, progress) as tell:
        iterations = count(1)
        return learn(lambda: tell(f"learning, {next(iterations)} iterations"))


def _present(
    fitted: Fitted, bic_of_forms: dict[str, float], data: TrainingData, x: Any, refit: Refit
) -> FitResult[Any]:
    obstacle = why_not(refit.options, knows_switch=refit.knows_switch)
    earlier = Earlier(data.scale, data.labels, data.dim_x, data.further)
    onwards = Continuation(fitted.learned, earlier, refit.options, obstacle)
    return present(fitted, bic_of_forms, data, x, refit=refit, continuation=onwards)
