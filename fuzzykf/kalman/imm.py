"""The interacting multiple model estimator, with filterpy's interface, and GPB2."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.base import (
    MOST_THREADS,
    Filter,
    FilterResult,
    as_observation,
    as_observations,
    check_keep,
    set_aside,
)
from fuzzykf.engine.selected import log_mixing, merge_modes, mix_modes, weigh_modes
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.fixed_lag import as_lag
from fuzzykf.gaussian import as_array, as_choice, as_count, as_flag, as_numbers, brief
from fuzzykf.kalman import bank, bank_series
from fuzzykf.kalman.arguments import SingularInnovationError, check_in_range
from fuzzykf.kalman.controls import control_moves, control_width, read_controls, takes_columns
from fuzzykf.kalman.describe import describe
from fuzzykf.kalman.forecast import expected_mixture, forecast
from fuzzykf.kalman.gaussian_filter import LEAST_LOG_LIKELIHOOD
from fuzzykf.kalman.gpb2 import predict_pairs, update_pairs
from fuzzykf.kalman.imm_smoothing import BankWayBack, can_look_back, smooth_bank
from fuzzykf.kalman.series import (
    BANK_FIELDS,
    as_batch,
    as_result,
    begin,
    collect,
    field_shapes,
    unchanged_on_error,
    whole_verb,
)
from fuzzykf.kalman.state_maps import CommonSpace, StateMap
from fuzzykf.kalman.stepper import BankStepper
from fuzzykf.many import as_output_type, as_stored, stacked
from fuzzykf.observations import check_aligned
from fuzzykf.overrides import VERBS, follows_copies, is_patched, lookups, overrides

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable

    from numpy.typing import ArrayLike, DTypeLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.kalman.gpb2 import PairBranches
    from fuzzykf.kalman.pair_moments import PairMoments
    from fuzzykf.kalman.series import PerStep

__all__ = ["IMMEstimator"]

#: Sums of probabilities may miss one by this much.
SUM_TOLERANCE = 1e-8


class IMMEstimator(BankStepper, Filter):
    """Interacting multiple model (IMM) estimator of a system that switches between modes.

    It takes the place of ``filterpy.kalman.IMMEstimator``.  Each mode has a filter of
    its own; their estimates are mixed before each prediction.

    Parameters
    ----------
    filters : sequence of filters
        At least two, with x of one shape (or with ``state_maps``).  Any `fuzzykf.base.Filter` with a
        log-likelihood, or any object with ``x``, ``P``, ``predict``, ``update`` and ``log_likelihood`` (or
        ``likelihood``), such as filterpy's filters; classes may be mixed.  A bank of plain Kalman filters
        of one shape is fastest.
    mu : array_like, shape (N,)
        Initial probabilities of the modes; they are normalised.
    M : array_like, shape (N, N)
        ``M[i, j]`` is the probability of mode j after mode i.
    method : {"imm", "gpb2"}
        "gpb2" filters once per pair of previous and current mode and merges the results (generalised
        pseudo-Bayes of second order): more accurate, at N times the cost.
    state_maps : sequence of StateMap, array_like or None, optional
        For filters with different states, such as constant velocity and constant acceleration: one map per
        filter from its state to a common state.  None if the state is the common one, a matrix
        (n, n_member) of full column rank, or a `StateMap` if missing components are not zero.  Estimates are
        mixed in the common space.

    Attributes
    ----------
    filters, M : as given
        May be changed between calls.
    mu : ndarray, shape (N,)
        Probabilities of the modes after the latest update.
    N : int
        Number of modes.
    x, P, x_prior, P_prior, x_post, P_post : ndarray
        Mean and covariance of the mixture, in the common space: current, after the latest prediction and
        after the latest update.
    state_maps : tuple of StateMap or None, or None
        As given; read-only.
    likelihood : ndarray, shape (N,)
        Density of the latest observation in each mode; zero before the first update.
    mode_log_likelihood : ndarray, shape (N,)
        Logarithm of ``likelihood``, without underflow.
    log_likelihood : float
        Log-density of the latest observation given the earlier ones, for the mixture.

    Raises
    ------
    ParameterError, ShapeError
        If there are fewer than two filters, shapes differ, ``mu`` is not a probability vector, ``M`` is not a
        transition matrix, or a map has the wrong shape or rank.

    Notes
    -----
    Weights are stored as logarithms, so that probabilities stay informative after an outlier, or for a mode
    that was ruled out for long.  A missing observation, or the first of two predictions in a row, changes
    the mode probabilities by M and has log-likelihood 0.  x after `predict` is the mean of the
    predicted mixture, with the predicted mode probabilities `cbar` as its weights.

    With "gpb2", the attributes y, S and K of a member are those of the most likely pair that ends in its
    mode.  A bank with ``state_maps`` calls the methods of its members and is slower.

    References
    ----------
    H. A. P. Blom, Y. Bar-Shalom, The interacting multiple model algorithm for systems
    with Markovian switching coefficients, IEEE Trans. Automatic Control 33 (1988),
    780-783.  Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to
    Tracking and Navigation, Wiley 2001, section 11.6.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf.kalman import KalmanFilter
    >>> calm = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], Q=0.01)
    >>> lively = KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], Q=9.0)
    >>> imm = IMMEstimator([calm, lively], [0.5, 0.5], [[0.95, 0.05], [0.05, 0.95]])
    >>> for z in (0.0, 0.1, 3.0):
    ...     imm.predict()
    ...     imm.update(z)
    >>> imm.mu.round(2)
    array([0.42, 0.58])
    """

    mu: Any
    _log_mu: FloatArray
    _known_mu: FloatArray  # mu as it was when its logarithms were taken

    def __init__(
        self,
        filters: Sequence[Any],
        mu: ArrayLike,
        M: ArrayLike,
        *,
        method: Literal["imm", "gpb2"] = "imm",
        state_maps: Sequence[StateMap | ArrayLike | None] | None = None,
    ) -> None:
        given: Any = filters
        if not isinstance(given, Sequence) or not all(hasattr(f, "x") and hasattr(f, "P") for f in given):
            raise ParameterError(f"filters: got {brief(filters)}, expected a list of Kalman filters")
        if len(filters) < 2:
            raise ParameterError(f"filters: got {len(filters)}, expected at least two")
        if len({id(f) for f in filters}) < len(filters):
            raise ParameterError(
                "filters: one object is there twice, expected a filter of its own for each mode"
            )
        self._space = None if state_maps is None else CommonSpace(filters, state_maps)
        xs, Ps = bank.member_states(filters, self._space)
        dims = [_observation_dimension(f) for f in filters]
        if any(dim != dims[0] for dim in dims):
            raise ShapeError(
                f"filters: observations have {dims} components, expected the same for all members"
            )
        as_choice("method", method, ("imm", "gpb2"))
        self.filters, self.N, self.method = filters, len(filters), method
        self.dim_x, self.dim_z = int(xs.shape[1]), dims[0]
        weights = as_array("mu", mu, (self.N,))
        if (weights < 0.0).any() or weights.sum() <= 0.0:
            raise ParameterError(f"mu: got {weights.tolist()}, expected weights of at least 0, not all 0")
        self.mu = weights / weights.sum()
        self._set_weights(_log(self.mu), self.mu)
        self.M = M if isinstance(M, np.ndarray) else as_numbers("M", M).copy()
        self._checked_M, self._log_M = _checked_transition(self.M, self.N)
        self.likelihood = np.zeros(self.N)
        self.mode_log_likelihood = np.full(self.N, LEAST_LOG_LIKELIHOOD)
        self.log_likelihood = LEAST_LOG_LIKELIHOOD
        self._log_cbar: FloatArray | None = None  # weights of the latest prediction, until they are used
        self._branches: PairMoments | PairBranches | None = None
        self.x, self.P = self._merged(self.mu, xs, Ps)
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()
        self.x_post, self.P_post = self.x.copy(), self.P.copy()

    # ------------------------------------------------------------------ modes

    @property
    def state_maps(self) -> tuple[StateMap | None, ...] | None:
        """Maps from the states of the filters to the common state; None if all states are the same."""
        return None if self._space is None else self._space.maps

    @property
    def cbar(self) -> FloatArray:
        """Predicted probabilities of the modes, mu M, shape (N,)."""
        return np.exp(log_mixing(self._log_weights(), self._log_transition())[1])

    @property
    def omega(self) -> FloatArray:
        """Mixing weights P(mode i before | mode j now), shape (N, N)."""
        return log_mixing(self._log_weights(), self._log_transition())[2]

    def _log_weights(self) -> FloatArray:
        """Logarithm of mu, with all its range unless mu has been assigned since."""
        if not np.array_equal(self.mu, self._known_mu):
            mu = as_array("mu", self.mu, (self.N,))
            if (mu < 0.0).any() or abs(mu.sum() - 1.0) > SUM_TOLERANCE:
                raise ParameterError(f"mu: got {mu.tolist()}, expected probabilities that sum to 1")
            self._log_mu, self._known_mu = _log(mu), mu
        return self._log_mu

    def _log_transition(self) -> FloatArray:
        """Logarithm of M, checked if it has changed since the last time."""
        if not np.array_equal(self.M, self._checked_M):
            self._checked_M, self._log_M = _checked_transition(self.M, self.N)
        return self._log_M

    def _set_weights(self, log_mu: FloatArray, mu: FloatArray) -> None:
        self._log_mu, self.mu, self._known_mu = log_mu, mu, mu.copy()

    def _merged(self, weights: FloatArray, xs: FloatArray, Ps: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, P = merge_modes(weights, xs, Ps)
        check_in_range(x=x, P=P)
        return x.reshape(self._form), P

    @property
    def _form(self) -> tuple[int, ...]:
        """The shape of x: that of the filters, of which a number is a column of one."""
        form = np.shape(self.filters[0].x) or (1, 1)
        return form if self._space is None else (self._space.dim, *form[1:])

    # ------------------------------------------------------------------ verbs

    def predict(self, u: Any = None) -> None:
        """Mix the estimates of the modes, then predict each by its filter.

        Parameters
        ----------
        u : array_like, optional
            Control input, passed to ``predict`` of every filter.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from the filters, which are then unchanged.
        """
        if u is None and self._predict_at_once():
            return
        with whole_verb(self, *self.filters):
            log_mu = self._log_weights() if self._log_cbar is None else self._log_cbar
            log_joint, log_cbar, omega = log_mixing(log_mu, self._log_transition())
            xs, Ps = bank.member_states(self.filters, self._space)
            branches: PairMoments | PairBranches | None = None
            if self.method == "imm":
                xs, Ps = bank.predict_members(self.filters, *mix_modes(omega, xs, Ps), u, self._space)
            else:
                weights = log_joint, omega
                branches, xs, Ps = predict_pairs(self.filters, weights, (xs, Ps), u, self._space)
            x, P = self._merged(np.exp(log_cbar), xs, Ps)
            if self._log_cbar is not None:  # a second prediction: the time in between had no observation
                self._set_weights(log_mu, np.exp(log_mu))
            self._log_cbar, self._branches = log_cbar, branches
            self.x, self.P = x, P
            self.x_prior, self.P_prior = x.copy(), P.copy()

    def update(self, z: Numbers) -> None:
        """Update the filter of each mode and the probabilities of the modes.

        Parameters
        ----------
        z : array_like
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z); None or
            NaN where missing.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from the filters; if z has density zero in all modes.  The filters are then unchanged.
        """
        if self._update_at_once(z):
            return
        with whole_verb(self, *self.filters):
            value = as_observation(z, self.dim_z)
            log_prior = self._log_cbar
            if log_prior is None:
                log_prior = log_mixing(self._log_weights(), self._log_transition())[1]
            if value is None:
                bank.skip_members(self.filters)
                log_mu, total, modes = log_prior, 0.0, np.zeros(self.N)
                xs, Ps = bank.member_states(self.filters, self._space)
            elif self._branches is not None:
                log_mu, total, modes, xs, Ps = update_pairs(self._branches, self.filters, value)
            else:
                modes, xs, Ps = bank.update_members(self.filters, value, log_prior, self._space)
                log_mu, normaliser = weigh_modes(log_prior, modes)
                total = float(normaliser)
            mu = np.exp(log_mu)
            if value is None and self._log_cbar is not None:
                x, P = self.x_prior.copy(), self.P_prior.copy()
            else:
                x, P = self._merged(mu, xs, Ps)
            self._set_weights(log_mu, mu)
            self._log_cbar = self._branches = None
            self.mode_log_likelihood, self.log_likelihood = modes, total
            self.likelihood = np.exp(modes)
            self.x, self.P = x, P
            self.x_post, self.P_post = x.copy(), P.copy()

    def _step_any(self, z: Numbers) -> FloatArray:
        """Do a step with any observation, by the verbs; an error leaves the bank as it was."""
        with unchanged_on_error(self, *self.filters):
            self.predict()
            self.update(z)
        estimate: FloatArray = self.x
        return estimate

    def _is_plain(self) -> bool:
        return type(self)._overrides() == 0 and not is_patched(self) and self._space is None

    @classmethod
    def _overrides(cls) -> int:
        return overrides(cls, _HOOKS) | overrides(cls, _VERBS) << 1

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the current estimates.

        The bank ends at the last observation, so `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : sequence of n controls, or array_like of shape (n, dim_u), optional
            Passed to `predict` one by one.  A pandas index must equal that of ``zs``.
        resume : bool
            Accepted for compatibility with switching filters; the bank always starts from its current
            estimates.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``, the mode probabilities ``mu``
            (n, N), the numbers of the modes ``nodes``, and the most likely mode ``switch``.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `predict` and `update`; the bank is then unchanged.
        """
        begin(self, zs, resume)
        stored = self._collect(zs, us)
        modes = np.arange(self.N, dtype=np.float64)
        return as_result(self, stored, zs, nodes=modes, switch=modes[stored["mu"].argmax(axis=1)])

    def _collect(self, zs: Any, us: PerStep | None) -> dict[str, FloatArray]:
        check_aligned(zs=zs, us=us)
        series = as_observations(zs, self.dim_z)
        if us is None and len(series) and self._log_cbar is None and self._is_plain():
            stored = self._filter_at_once(series)
            if stored is not None:
                return stored
        moves = control_moves(us, len(series), self.filters)
        with whole_verb(self, *self.filters):
            return collect(self, series, field_shapes(self.dim_x, self.N), moves, members=self.filters)

    def _filter_at_once(self, series: FloatArray) -> dict[str, FloatArray] | None:
        """Do predict and update for a whole series; None if that has to be done step by step."""
        weights, every_pair = (self._log_weights(), self._log_transition()), self.method != "imm"
        result = bank_series.filter_one(self.filters, series, weights, every_pair)
        if result is None:
            return None
        stored, state = result
        if not all(np.isfinite(stored[name][-1]).all() for name in ("x", "P")):
            return None  # the verbs say what has become too large
        self.remember_origin()
        bank.put_state(self.filters, state, series[-1])
        x, P, x_prior, P_prior = (stored[name][-1].copy() for name in ("x", "P", "x_prior", "P_prior"))
        form = self._form
        self.x, self.P, self.x_prior, self.P_prior = x.reshape(form), P, x_prior.reshape(form), P_prior
        self.x_post, self.P_post = self.x.copy(), P.copy()
        self._set_weights(state["log_mu"], np.exp(state["log_mu"]))
        self.mode_log_likelihood, self.log_likelihood = state["modes"], float(stored["log_likelihood"][-1])
        self.likelihood = np.exp(state["modes"])
        return stored

    def batch_filter(
        self, zs: ManyNumbers, us: PerStep | None = None, *, resume: bool = False
    ) -> tuple[FloatArray, ...]:
        """Run `filter` and return filterpy's four arrays.

        Parameters
        ----------
        zs, us, resume
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            After the updates and after the predictions; means of shape (n, dim_x, 1), or
            (n, dim_x) if x is flat.
        """
        as_flag("resume", resume)
        return as_batch(self, self._collect(zs, us), zs, np.ndim(self.x) == 1)

    def smooth(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        weights: Literal["density", "kim"] = "density",
    ) -> FilterResult:
        """Smooth a series: estimate every state given all observations.

        Approximate, like the filter: estimates of each mode are merged after each backward step.  If ``H``
        differs between members, "gpb2" is more accurate.  The bank ends at the last observation.

        Parameters
        ----------
        zs, us
            As in `filter`.
        weights : {"density", "kim"}
            Weights of the modes in a backward step: "density" uses the likelihood of all later observations;
            "kim" does not (Kim 1994), which is nearly always worse.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``mu``, ``nodes``, ``switch``, the most likely path of the modes in
            ``switch_path``, and the ``log_likelihood`` of the filter.

        Warns
        -----
        HindsightWarning
            If later observations move the states by more than their covariances admit.  The model is then
            wrong, or the filter has lost the switch, and smoothing may be worse than filtering.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if a member is not a plain `KalmanFilter` with alpha 1 and without a state map;
            if a
            subclass overrides `predict` or `update` in a way that the backward pass cannot follow.  Bank and
            filters are then unchanged.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> calm, lively = (KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], Q=q) for q in (0.01, 9.0))
        >>> imm = IMMEstimator([calm, lively], [0.5, 0.5], [[0.95, 0.05], [0.05, 0.95]])
        >>> result = imm.smooth([0.0, 0.1, None, 3.0])
        >>> result.x.shape, result.mu.shape
        ((4, 1), (4, 2))
        """
        return smooth_bank(self, zs, us, weights)

    def smooth_lag(
        self,
        zs: ManyNumbers,
        lag: int,
        us: PerStep | None = None,
        *,
        weights: Literal["density", "kim"] = "density",
    ) -> FilterResult:
        """Fixed-lag smoothing: estimate each state given the observations up to ``lag`` steps later.

        Parameters
        ----------
        zs, us
            As in `filter`; the bank ends at the last observation.
        lag : int
            Number of steps to look ahead, at least 0: row n is the estimate given the observations up to
            n + lag, or to the end.  0 is `filter`; the length of the series is `smooth`.
        weights : {"density", "kim"}
            As in `smooth`.

        Returns
        -------
        FilterResult
            As from `smooth`, without the most likely path.

        Warns
        -----
        HindsightWarning
            As from `smooth`.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `smooth`; if ``lag`` is not an integer of at least 0.

        See Also
        --------
        fuzzykf.FixedLag : The same step by step.

        Examples
        --------
        >>> from fuzzykf.kalman import KalmanFilter
        >>> calm, lively = (KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]], Q=q) for q in (0.01, 9.0))
        >>> imm = IMMEstimator([calm, lively], [0.5, 0.5], [[0.95, 0.05], [0.05, 0.95]])
        >>> imm.smooth_lag([0.0, 0.1, None, 3.0], lag=2).mu.shape
        (4, 2)
        """
        return smooth_bank(self, zs, us, weights, as_lag(lag))

    @property
    def has_smoother(self) -> bool:
        """Whether `smooth` is available."""
        return can_look_back(self)

    _way_back = BankWayBack  # of `fuzzykf.FixedLag`

    def forecast(self, steps: int, us: PerStep | None = None) -> FilterResult:
        """Forecast states, observations and modes; the bank does not change.

        Parameters
        ----------
        steps : int
            Number of predictions from the current estimates.
        us : sequence of controls, or array_like of shape (steps, dim_u), optional
            One per step.  A pandas index must equal that of the rows ahead, if these are known.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``mu``, ``nodes``, ``switch`` and, if all members have an observation model,
            mean ``z_prior`` and covariance ``S`` of the observations.

        Raises
        ------
        ShapeError, ParameterError
            As from `predict`; if ``steps`` is below one.
        """
        weights: list[FloatArray] = []

        def expected(f: Any, _step: int) -> Any:
            weights.append(np.exp(f._log_cbar))
            return expected_mixture(f.filters, weights[-1])

        found = forecast(self, steps, {"us": us}, lambda n: control_moves(us, n, self.filters), expected)
        mu, modes = np.array(weights), np.arange(self.N, dtype=np.float64)
        return replace(found, mu=mu, nodes=modes, switch=modes[mu.argmax(axis=1)])

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = ("x", "P", "log_likelihood"),
        us: ManySeriesLike | PerStep = None,
        *,
        by: Hashable | None = None,
        threads: int = 1,
        dtype: DTypeLike = np.float64,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each starting from the current estimates.

        The bank itself does not change.  A bank of plain Kalman filters of one shape is filtered by the
        engine; other banks, and banks with controls or ``state_maps``, by their methods.

        Parameters
        ----------
        zs : array_like, DataFrame, DataArray, list, tuple or mapping
            Shape (series, n, dim_z), or (series, n) if ``dim_z`` is 1; NaN where missing.  Or a frame with a
            column for each series (pairs (series, component) if ``dim_z`` is not 1), or a list or mapping of
            series of any lengths, each as `filter` takes it.
        keep : sequence of str
            Fields to store, from ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``log_likelihood``.
        us : array_like, DataFrame, DataArray, list, tuple or mapping, optional
            Controls, the same for all series or one set per series, as in `KalmanFilter.filter_many`.
        by : hashable, optional
            Column (or index level) that names the series of each row, if the frame holds all series one after
            another.
        threads : int
            Number of threads over which the compiled engine distributes the series.  Results are identical to
            the bit.  NumPy uses one thread.
        dtype : numpy.float64 or numpy.float32
            Type in which results are stored.  Computations are in double precision.
        resume : bool
            As in `filter`.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.  Names and index are kept, see `FilterResult.to_dataframe`.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            As from `filter`; if a name in ``keep`` is unknown.
        NumericalRangeError
            If a result is too large for ``dtype``.
        """
        as_flag("resume", resume)
        names, dtype = check_keep(keep, BANK_FIELDS), as_output_type(dtype)
        threads = as_count("threads", threads, 1, MOST_THREADS)
        many = self._read_many(zs, by)
        controls = None if us is None else read_controls(us, many, control_width(self.filters))

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            if controls is None:
                found = self._at_once(series, names, dtype, threads)
                return found or as_stored(stacked(self._filter_each(series), names), dtype)
            each = controls.of(rows, series.shape[:2], takes_columns(self.filters))
            return as_stored(stacked(self._filter_each(series, each), names), dtype)

        return many.filtered(several)

    def _at_once(
        self, series: FloatArray, names: tuple[str, ...], dtype: np.dtype[Any], threads: int
    ) -> dict[str, FloatArray] | None:
        """Filter many series at once; None if that has to be done one by one."""
        model = bank_series.whole_model(self.filters) if self._is_plain() else None
        if model is None or self._log_cbar is not None:
            return None
        logs, pairs = (self._log_weights(), self._log_transition()), self.method != "imm"
        try:
            found = bank_series.filter_many(self.filters, model, series, logs, pairs, names, dtype, threads)
        except SingularInnovationError:  # or what an observation beyond all numbers leaves looks like it
            return None
        if not all(np.isfinite(found[name][:, -1:]).all() for name in {"x", "P"} & found.keys()):
            return None  # the verbs say what has become too large
        return found

    def _follows_copies(self) -> bool:
        return all(map(follows_copies, (self, *self.filters)))

    def _set_aside(self) -> Callable[[], None]:
        back = [set_aside(self, self.filters), *map(set_aside, self.filters)]

        def put_back() -> None:
            for one in back:
                one()

        return put_back

    # ------------------------------------------------------------------ reset

    def remember_origin(self) -> None:
        """Keep the current state of the bank and its members; see `Filter.remember_origin`."""
        if "_origin" not in self.__dict__:
            own = {name: value for name, value in self.__dict__.items() if name != "filters"}
            members = [copy.deepcopy(f.__dict__, {id(f): f}) for f in self.filters]
            self._origin = {"own": copy.deepcopy(own, {id(self): self}), "members": members}

    def reset(self) -> None:
        """Return to the state before the first step since construction or the last reset.

        The members, which stay the same objects, are reset as well.
        """
        if "_origin" not in self.__dict__:
            return
        origin, filters = self._origin, self.filters
        self.__dict__.clear()
        self.__dict__.update(origin["own"], filters=filters)
        for f, state in zip(filters, origin["members"], strict=True):
            f.__dict__.clear()
            f.__dict__.update(state)

    def __repr__(self) -> str:
        """Show every public attribute, one below the other."""
        maps = () if self.__dict__.get("_space") is None else ("state_maps",)
        return describe(self, "cbar", "omega", *maps)


def _log(p: FloatArray) -> FloatArray:
    """Logarithm, minus infinity of zero."""
    with np.errstate(divide="ignore"):
        return np.log(p)


def _checked_transition(M: Any, n: int) -> tuple[FloatArray, FloatArray]:
    """Return a copy of a transition matrix, and its logarithm, after checking it."""
    matrix = as_array("M", M, (n, n))
    sums = matrix.sum(axis=1)
    if (matrix < 0.0).any() or np.abs(sums - 1.0).max() > SUM_TOLERANCE:
        raise ParameterError(
            f"M: got {matrix.tolist()}, whose rows sum to {sums.tolist()}, expected probabilities that sum "
            "to 1 in each row"
        )
    return matrix, _log(matrix)


def _observation_dimension(f: Any) -> int:
    """Return how many components an observation of this filter has; filterpy's UKF hides it."""
    for name in ("dim_z", "_dim_z"):
        if hasattr(f, name):
            return int(getattr(f, name))
    return int(np.shape(f.R)[0])


#: What the verbs are, and what they call or read, before anybody changes it.
_VERBS = lookups(IMMEstimator, VERBS)
_HOOKS = lookups(
    IMMEstimator,
    (
        *("_log_weights", "_log_transition", "_set_weights", "_merged", "remember_origin", "cbar", "omega"),
        *("__getattribute__", "__setattr__"),
        *("filters", "mu", "M", "N", "method", "dim_x", "dim_z", "x", "P", "x_prior", "P_prior"),
        *("x_post", "P_post", "likelihood", "mode_log_likelihood", "log_likelihood"),
        *("_log_mu", "_log_M", "_known_mu", "_checked_M", "_log_cbar", "_branches", "_space"),
    ),
)
