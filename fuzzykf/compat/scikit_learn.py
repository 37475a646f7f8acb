"""A learned switching filter as an estimator of scikit-learn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self, overload

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.metrics import r2_score
from sklearn.utils import estimator_html_repr
from sklearn.utils.validation import (
    _check_sample_weight,
    check_array,
    check_consistent_length,
    check_is_fitted,
    validate_data,
)

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_flag, brief, is_whole
from fuzzykf.observations import index_of
from fuzzykf.registry import either
from fuzzykf.reprs import shown, shown_html
from fuzzykf.switching.laws.base import Law
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.chains import as_law
from fuzzykf.switching.laws.registry import learned_laws
from fuzzykf.times import check_increasing

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FitResult

__all__ = ["SwitchingRegressor"]


class SwitchingRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]  # sklearn has no types
    """Switching filter as a scikit-learn estimator.

    ``fit`` learns a switching model from observations and states, ``predict`` filters new observations.
    Unlike other regressors, it has a memory: each row is one time step, and its estimate uses the
    observations up to that row.  Keep rows in order, and split them with
    ``sklearn.model_selection.TimeSeriesSplit``, never at random.

    Parameters
    ----------
    switch : {"hard", "fmc1", "fmc2", "free", "fade", "graph"}, or a law
        Law of the switch.  "hard" means hard regimes, a `CGOMSModel`; otherwise a `CGOFMSModel` with a law of
        this family, or of the structure of the given law.
    n_switches : int, optional
        Number of hard regimes, by default 2; for "hard" only.
    form : {"auto", "regression", "covariance"}
        Form of the Gaussian part, as in `CGOFMSModel.fit`.
    n_nodes : int, optional
        Number of nodes between two classes of a fuzzy switch, by default 5, or as many as fades have room
        for; see `CGOFMSModel.fit`.
    state_feedback : bool
        Whether the state may depend on the previous state, as in `CGOFMSModel.fit`.
    objective : {"joint", "filter"}
        Objective to maximise, as in `CGOFMSModel.fit`.
    n_starts : int
        Number of initial guesses of the switch; beyond 4 they are random.
    max_iter : int
        Largest number of iterations.
    tolerance : float
        Stop when an iteration gains less than this in log-likelihood per observation.
    random_state : int or numpy.random.Generator, optional
        Needed if ``n_starts`` is above 4.

    Attributes
    ----------
    model_ : CGOFMSModel or CGOMSModel
        The learned model; ``model_.filter()`` is a filter for single steps.
    fit_result_ : FitResult
        Result of the fit, with `FitResult.summary`.
    n_features_in_ : int
        Number of components of an observation.
    feature_names_in_ : ndarray of str
        Names of the components, if X was a DataFrame.
    n_iter_ : int
        Number of iterations.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.compat import SwitchingRegressor
    >>> rng = np.random.default_rng(0)
    >>> r = (np.arange(600) // 5) % 2
    >>> Y = (4.0 * r + rng.normal(size=600))[:, None]
    >>> x = np.where(r == 1, 8.0 - Y[:, 0], Y[:, 0]) + 0.3 * rng.normal(size=600)
    >>> estimator = SwitchingRegressor("hard", form="regression").fit(Y[:400], x[:400])
    >>> mean, std = estimator.predict(Y[400:], return_std=True)
    >>> mean.shape, std.shape
    ((200,), (200,))
    >>> bool(estimator.score(Y[400:], x[400:]) > 0.75)
    True
    """

    def __init__(
        self,
        switch: str | Law | SwitchChain = "fmc1",
        *,
        n_switches: int | None = None,
        form: Literal["auto", "regression", "covariance"] = "auto",
        n_nodes: int | None = None,
        state_feedback: bool = True,
        objective: Literal["joint", "filter"] = "joint",
        n_starts: int = 4,
        max_iter: int = 500,
        tolerance: float = 1e-6,
        random_state: int | np.random.Generator | None = None,
    ) -> None:
        self.switch = switch
        self.n_switches = n_switches
        self.form = form
        self.n_nodes = n_nodes
        self.state_feedback = state_feedback
        self.objective = objective
        self.n_starts = n_starts
        self.max_iter = max_iter
        self.tolerance = tolerance
        self.random_state = random_state

    @shown
    def __repr__(self) -> str:
        return str(super().__repr__())

    @shown_html
    def _repr_html_(self) -> str:
        return str(estimator_html_repr(self))

    def __sklearn_tags__(self) -> Any:
        """Tell scikit-learn that observations and states may be missing, and states may be vectors."""
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.target_tags.multi_output = True
        return tags

    def fit(self, X: Any, y: Any) -> Self:
        """Learn from observations and states.

        Parameters
        ----------
        X : array_like or DataFrame, shape (n, q)
            Observations, a row for each step of time; NaN where missing.
        y : array_like, shape (n,) or (n, m)
            States; NaN where they were not measured.

        Returns
        -------
        SwitchingRegressor
            Itself.

        Raises
        ------
        ParameterError
            If a parameter is inadmissible, an index of times does not increase, or the data do not support a
            model; see `CGOFMSModel.fit`.
        ValueError
            If shapes do not agree, or a value is infinite.
        """
        _check_order("X", X)
        observations = validate_data(
            self, X, dtype=np.float64, ensure_all_finite="allow-nan", ensure_min_samples=2
        )
        states = _as_states(y, self)
        check_consistent_length(observations, states)
        self.fit_result_ = self._learn(states, observations)
        self.model_ = self.fit_result_.model
        self.n_iter_ = len(self.fit_result_.trace)
        self._flat = states.ndim == 1
        return self

    def _learn(self, x: FloatArray, y: FloatArray) -> FitResult[Any]:
        from fuzzykf.switching import CGOFMSModel, CGOMSModel

        if self.random_state is None and is_whole(self.n_starts) and self.n_starts > 4:
            raise ParameterError(
                "random_state: got None, expected a whole number or a numpy.random.Generator: more than 4 "
                "starts are drawn at random"
            )
        options: dict[str, Any] = {
            "form": self.form,
            "n_starts": self.n_starts,
            "max_iter": self.max_iter,
            "tolerance": self.tolerance,
            "state_feedback": self.state_feedback,
            "objective": self.objective,
            "rng": _as_generator(self.random_state),
            "progress": False,
        }
        K, switch = self.n_switches, self.switch
        if isinstance(switch, str) and switch == "hard":
            if self.n_nodes is not None:
                raise ParameterError(f"n_nodes: got {self.n_nodes!r} with switch='hard', expected None")
            return CGOMSModel.fit(x, y, n_switches=2 if K is None else K, **options)
        names = ("hard", *learned_laws())
        if switch not in names if isinstance(switch, str) else not isinstance(switch, Law | SwitchChain):
            raise ParameterError(f"switch: got {brief(switch)}, expected {either(names)}, or a law")
        own = 2 if isinstance(switch, str) else as_law(switch).n_classes
        if K is not None and own != K:
            raise ParameterError(
                f"n_switches: got {brief(K)}, expected None, or {own} as the law of the switch has"
            )
        return CGOFMSModel.fit(x, y, law=switch, n_nodes=self.n_nodes, **options)

    @overload
    def predict(self, X: Any, return_std: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, X: Any, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
    def predict(self, X: Any, return_std: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Filter a series: estimate the state of each row from the observations up to it.

        Filtering starts from the initial law of the model.

        Parameters
        ----------
        X : array_like or DataFrame, shape (n, q)
            Observations, a row for each step of time; NaN where missing.
        return_std : bool
            Whether to return standard deviations as well.

        Returns
        -------
        mean : ndarray, shape (n,) or (n, m)
            Estimates, in the shape of ``y`` in `fit`.
        std : ndarray, same shape
            Standard deviations; with ``return_std`` only.

        Raises
        ------
        sklearn.exceptions.NotFittedError
            If `fit` was not called.
        ParameterError
            If an index of times does not increase.
        ValueError
            If shapes do not agree, or a value is infinite.
        """
        check_is_fitted(self)
        wants_std = as_flag("return_std", return_std)
        _check_order("X", X)
        observations = validate_data(self, X, dtype=np.float64, ensure_all_finite="allow-nan", reset=False)
        nodes = {} if self.n_nodes is None else {"n_nodes": self.n_nodes}
        found = self.model_.filter(**nodes).filter(observations)
        mean, std = found.x, np.sqrt(np.diagonal(found.P, axis1=-2, axis2=-1))
        if self._flat:
            mean, std = mean[:, 0], std[:, 0]
        return (mean, std) if wants_std else mean

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:
        """Return the coefficient of determination R² of the estimates.

        Parameters
        ----------
        X : array_like, shape (n, q)
            Observations.
        y : array_like, shape (n,) or (n, m)
            States; rows with NaN are filtered but do not count.
        sample_weight : array_like, shape (n,), optional

        Returns
        -------
        float
            1 for exact estimates, 0 for the mean of ``y``.
        """
        mean = self.predict(X)
        states = _as_states(y, self)
        check_consistent_length(mean, states)
        weights = None if sample_weight is None else _check_sample_weight(sample_weight, mean)
        known = np.isfinite(states.reshape(len(states), -1)).all(axis=1)
        if not known.any():
            raise ParameterError("y: no row has a measured state, expected at least one")
        return float(
            r2_score(states[known], mean[known], sample_weight=None if weights is None else weights[known])
        )


def _as_states(y: Any, estimator: object) -> FloatArray:
    """Return states (n,) or (n, m), NaN where missing; refuse what is none."""
    if y is None:
        raise ValueError(
            f"This {type(estimator).__name__} estimator requires y to be passed, but the target y is None."
        )
    states: FloatArray = check_array(
        y,
        dtype=np.float64,
        ensure_2d=False,
        ensure_all_finite="allow-nan",
        input_name="y",
        estimator=estimator,
    )
    return states


def _check_order(name: str, rows: Any) -> None:
    """Refuse a table whose index of times does not increase: a model takes each row for one step."""
    index = index_of(rows)
    if index is None:
        return
    try:
        check_increasing(index, lambda row: f"row {row}")
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}; expected rows in the order of time") from error


def _as_generator(state: int | np.random.Generator | None) -> np.random.Generator | None:
    if state is None or isinstance(state, np.random.Generator):
        return state
    if is_whole(state) and state >= 0:
        return np.random.default_rng(int(state))
    raise ParameterError(
        f"random_state: got {brief(state)}, expected None, a whole number from 0, or a numpy.random.Generator"
    )
