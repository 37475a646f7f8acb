"""The fuzzy dynamic model state estimator of Layne and Passino, as a filter."""

from __future__ import annotations

import sys
import warnings
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.base import USUAL_FIELDS, Filter, as_observation
from fuzzykf.errors import SupportWarning
from fuzzykf.gaussian import as_choice, as_flag
from fuzzykf.io import Document
from fuzzykf.many import read_many
from fuzzykf.observations import is_uneven
from fuzzykf.possibility.arguments import (
    check_given,
    given_maps,
    noise_of_step,
    set_matrices,
    with_noise,
)
from fuzzykf.possibility.beliefs import QuadraticBelief, believe
from fuzzykf.possibility.conjunction import assigned, explained, restrained
from fuzzykf.possibility.constraint import as_constraint, is_crisp, narrowed
from fuzzykf.possibility.describe import describe
from fuzzykf.possibility.gain import residual_matrix, show_gain, show_likelihood, show_no_gain
from fuzzykf.possibility.mapping import motion, sight
from fuzzykf.possibility.memberships.derived import as_membership
from fuzzykf.possibility.norms import as_t_conorm, as_t_norm
from fuzzykf.possibility.representation import (
    as_center,
    as_matrix,
    as_used,
    check_constraint,
    choose,
    no_matrix,
    universe_of,
)
from fuzzykf.possibility.saved import from_values, to_values
from fuzzykf.possibility.series import of_each, read_steps
from fuzzykf.possibility.smoother import MEMORY, smooth_series
from fuzzykf.reprs import shown

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
    from typing import Self, TypeAlias

    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.base import FilterResult
    from fuzzykf.observations import PerStep
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TConorm, TNorm
    from fuzzykf.possibility.protocol import Belief, Outcome

    #: A membership, or one scalar membership or None for each component.
    Memberships: TypeAlias = Membership | Sequence[Membership | None]

__all__ = ["FuzzyRelationEstimator"]


class FuzzyRelationEstimator(Filter, Document):
    """Recursive state estimator with membership functions instead of densities.

    The membership mu of the state x is propagated by the extension principle and
    updated by conditioning on the measurement z:

    - predict: mu'(x') = sup of T(mu(x), mu_W(w)) over all x, w with x' = f(x) + w;
    - update: mu+(x) = T(mu(x), mu_V(z - h(x))), divided by its peak.

    Gaussian memberships with the product t-norm give the Kalman filter, intervals give guaranteed
    bounds, and anything else is computed on a grid.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of a measurement.
    dim_u : int
        Number of components of the control u; for information only, as in filterpy.
    fx, hx : callable, optional
        Dynamics f and measurement function h: map arrays (..., dim_x) to (..., dim_x) and
        (..., dim_z).  Keyword arguments of `predict` are passed to fx, fx_inverse and
        fx_interval, those of `update` to hx and hx_interval.  By default
        the model is linear, with the matrices ``F`` and ``H``.
    fx_inverse : callable, optional
        Inverse of fx on arrays (..., dim_x); NaN where there is no pre-image.  It makes grids faster.
    fx_interval, hx_interval : callable, optional
        Interval extensions: map vectors (lower, upper) to bounds of the image of the box.
    state : Membership or sequence of scalar Membership, optional
        Initial membership of the state.
    process_noise, measurement_noise : Membership, or sequence of (Membership or None), optional
        One membership of dimension dim_x or dim_z, or one scalar membership per component (None for no
        noise).  Without ``process_noise`` there is none.  In the closed forms below, an omitted membership
        has center zero and unit matrix, as in filterpy.
    constraint : Membership, sequence of scalar Membership, or (lower, upper), optional
        Constraint on the state at every step, by default none: a box with bounds of shape (dim_x,) or
        numbers (infinite where open), or any membership.  The initial and each predicted membership are
        combined with it by the t-norm and divided by the peak.  Boxes work with intervals and grids,
        memberships of a closed family with that family, others with grids.  ``on_empty`` applies if it
        excludes a prediction.
    x, P, F, H, Q, R, B : array_like, optional
        Initial values of the attributes of the same names; they are copied.  ``F``, ``B`` and ``H`` replace
        fx and hx; the others are for closed forms only.
    t_norm : {"product", "min", "lukasiewicz", "hamacher"} or TNorm
        T-norm that combines memberships.
    t_conorm : {"max"}
        T-conorm that joins alternatives; no other has a limit on a continuum.
    on_empty : {"raise", "keep", "reset"}
        What to do if prediction and measurement exclude each other: raise
        `EmptyIntersectionError`, keep the prediction, or restart from the measurement alone.  The
        possibility of the measurement is then 0.  The same if the constraint excludes a prediction: raise,
        keep it, or restart from the constraint.
    points : int or sequence of int, optional
        Number of grid nodes per axis, by default 401, 101 or 41 in 1, 2 or 3 dimensions.  A moving grid with
        long tails has up to 8, 4 or 2 times as many, so that at least a tenth covers the likely states.
    domain : sequence of (lo, hi), optional
        Bounds of a fixed grid.  By default the grid moves and adapts its spacing.
    floor : float, optional
        A moving grid omits states with a smaller membership.  By default
        exp(-18), six standard deviations of a Gaussian, or 0.01, ten times the scale,
        if state or process noise is an uncut Cauchy membership.

    Attributes
    ----------
    representation : str
        Chosen at construction, by the first rule that applies:

        1. "grid" if ``points`` or ``domain`` is given;
        2. "interval" if all memberships are crisp (intervals, boxes, points) and the
           functions are linear, monotone in one dimension, or have an interval extension;
        3. "gaussian", "cauchy" or "parabolic" if the model is linear and all
           memberships are of that shape (or points), and the t-norm is the product,
           the Hamacher product or Łukasiewicz's;
        4. "grid" otherwise.
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x)
        Centroid and spread of the membership: its second central moments, or its matrix in the closed
        forms, in which both may be assigned.
    x_prior, P_prior, x_post, P_post : ndarray
        Copies from before and after the latest update.
    F, H, B : ndarray or None
        Matrices of a linear model.  H is initially zero; `update` raises an error until it is set.
    constraint : Membership or None
        May be assigned.  It does not act on x and P that are assigned.
    Q, R : ndarray or None
        Matrices of the noise in the closed forms.
    y, S, SI, K : ndarray
        Residual, its matrix and the inverse, and the gain (closed forms).
    log_likelihood, likelihood, mahalanobis : float
        Fit of the latest z; for "gaussian" only.
    possibility : float
        Possibility of the latest z given the earlier ones, in [0, 1].
    z : ndarray
        The latest measurement, as a column.

    Raises
    ------
    ParameterError, ShapeError
        If an argument is inadmissible; the message names it.

    Warns
    -----
    SupportWarning
        If possible states leave a grid at an edge, or a grid is too coarse.

    Notes
    -----
    Layne and Passino, Fuzzy Sets and Systems 122 (2001) 45-72: equations (24) and (28),
    the latter with the joint relation of x and z instead of a Cartesian product.
    With t-norms other than product and minimum, the result depends on the order of simultaneous
    measurements.

    The closed form for Cauchy memberships and the Hamacher product is not robust: its
    update is linear in z, and an unlikely z increases P and the next gains, so that outliers move x
    further than in a Kalman filter.  For outliers, use a Cauchy ``measurement_noise`` on a grid
    (``points=``), or with a Gaussian state, which implies a grid.

    `save` stores all memberships that are given by numbers; for functions, it raises an error that names
    them.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FuzzyRelationEstimator, GaussianMembership, IntervalMembership
    >>> est = FuzzyRelationEstimator(2, 1, F=[[1.0, 1.0], [0.0, 1.0]], H=[[1.0, 0.0]])
    >>> est.step(1.5).round(3).tolist(), est.representation
    ([[1.125], [0.375]], 'gaussian')

    >>> walk = FuzzyRelationEstimator(
    ...     1,
    ...     1,
    ...     state=IntervalMembership(0.0, 0.0),
    ...     process_noise=IntervalMembership(-3.0, 3.0),
    ...     measurement_noise=IntervalMembership(-0.5, 0.5),
    ...     hx=lambda x: 0.0005 * x**3,
    ... )
    >>> _ = walk.step(0.1)
    >>> walk.membership
    IntervalMembership(lower=[-3.], upper=[3.])
    >>> walk.constraint = 0.0, np.inf
    >>> walk.membership
    IntervalMembership(lower=[0.], upper=[3.])

    >>> curve = FuzzyRelationEstimator(
    ...     1,
    ...     1,
    ...     fx=lambda x: x + 0.5 * np.sin(x),
    ...     hx=lambda x: x**2 / 4,
    ...     state=GaussianMembership(0.5, 1.0),
    ...     process_noise=GaussianMembership(0.0, 0.05),
    ...     measurement_noise=GaussianMembership(0.0, 0.09),
    ... )
    >>> curve.step(0.5).round(2).tolist(), curve.representation
    ([[0.45]], 'grid')
    """

    def __init__(
        self,
        dim_x: int,
        dim_z: int,
        dim_u: int = 0,
        *,
        fx: Callable[..., Any] | None = None,
        hx: Callable[..., Any] | None = None,
        fx_inverse: Callable[..., Any] | None = None,
        fx_interval: Callable[..., Any] | None = None,
        hx_interval: Callable[..., Any] | None = None,
        state: Memberships | None = None,
        process_noise: Memberships | None = None,
        measurement_noise: Memberships | None = None,
        constraint: Memberships | Sequence[Numbers] | None = None,
        x: Numbers = None,
        P: Numbers = None,
        F: Numbers = None,
        H: Numbers = None,
        Q: Numbers = None,
        R: Numbers = None,
        B: Numbers = None,
        t_norm: str | TNorm = "product",
        t_conorm: str | TConorm = "max",
        on_empty: Literal["raise", "keep", "reset"] = "raise",
        points: int | Sequence[int] | None = None,
        domain: Sequence[Sequence[float]] | None = None,
        floor: float | None = None,
    ) -> None:
        check_given(dim_x, dim_z, fx, fx_inverse, fx_interval)
        as_choice("on_empty", on_empty, ("raise", "keep", "reset"))
        self.dim_x, self.dim_z, self.dim_u = int(dim_x), int(dim_z), dim_u
        self.fx, self.hx, self.fx_inverse = fx, hx, fx_inverse
        self.fx_interval, self.hx_interval = fx_interval, hx_interval
        self.t_norm, self.t_conorm = as_t_norm(t_norm), as_t_conorm(t_conorm, continuum=True)
        self.on_empty = on_empty
        choice = choose(
            self.dim_x,
            self.dim_z,
            self.t_norm,
            state=state,
            process_noise=process_noise,
            measurement_noise=measurement_noise,
            nonlinear=fx is not None or hx is not None,
            enclosed=dim_x == 1
            or ((fx is None or fx_interval is not None) and (hx is None or hx_interval is not None)),
            grid=points is not None or domain is not None,
        )
        self.representation = choice.representation
        self.F: Any
        self.H: Any
        self.B: Any
        self.F, self.H, self.B = given_maps(self.dim_x, self.dim_z, fx, hx, F, H, B)
        self._blank_H = self.H if H is None else None  # zeros, as long as nobody has assigned another one
        self._process_noise = self._as_used("process_noise", choice.process_noise, self.dim_x)
        self._measurement_noise = self._as_used("measurement_noise", choice.measurement_noise, self.dim_z)
        on_grid = choice.representation == "grid"
        self._universe = universe_of(choice, self.t_norm, points, domain, floor) if on_grid else None
        self._belief = believe("state", choice.state, choice.representation, self.t_norm, self._universe)
        self._constraint: Membership | None = None
        set_matrices(self, x=x, P=P, Q=Q, R=R)
        self.constraint = constraint
        self.possibility = 1.0
        self.z: Any = np.full((self.dim_z, 1), None, dtype=object)
        self.x_prior, self.P_prior = self._estimate()
        self.x_post, self.P_post = self._estimate()
        self.y: Any
        if self.is_closed_form:
            show_no_gain(self)
        if self.representation == "gaussian":
            show_likelihood(self, float(np.log(sys.float_info.min)), 0.0)

    # ------------------------------------------------------------------ the verbs

    def predict(
        self,
        u: Numbers = None,
        B: Numbers = None,
        F: Numbers = None,
        Q: Numbers | Memberships = None,
        **fx_arguments: Any,
    ) -> None:
        """Move the membership to the time of the next measurement.

        Parameters
        ----------
        u, B : array_like, optional
            Linear models: control and its matrix (by default the attribute ``B``).
        F : array_like, optional
            Linear models: matrix for this step only.
        Q : Membership, sequence of (Membership or None), or array_like, optional
            Process noise of this step only: a membership, as ``process_noise``, or a matrix in the closed
            forms.
        **fx_arguments
            With fx, all arguments except the noise are passed to fx.

        Raises
        ------
        ParameterError, ShapeError
            If fx returns the wrong shape, or NaN at a possible state; if a matrix is inadmissible.
        EmptyIntersectionError
            If the constraint excludes all predicted states (see ``on_empty``).
        SupportLostError
            If all states have left the domain.
        """
        noise = self._process_noise
        if Q is not None:
            noise, Q = noise_of_step(self, "Q", Q)
        move = motion(self, u, B, F, Q, fx_arguments)
        outcome = self._belief.predict(move, noise)
        assert outcome.belief is not None
        _warn(outcome)
        if self._constraint is not None:
            outcome = restrained(outcome.belief, self._constraint, self.on_empty)
            _warn(outcome)
        self.remember_origin()
        assert outcome.belief is not None
        self._belief = outcome.belief
        self.x_prior, self.P_prior = self._estimate()

    def update(
        self,
        z: Numbers,
        R: Numbers | Memberships = None,
        H: Numbers = None,
        **hx_arguments: Any,
    ) -> None:
        """Take a measurement into account.

        Parameters
        ----------
        z : array_like or None
            None if it is missing, NaN for a missing component.
        R : Membership, sequence of (Membership or None), or array_like, optional
            Noise of this measurement only: a membership, as ``measurement_noise``, or a matrix in the closed
            forms.
        H : array_like, optional
            Linear models: matrix for this measurement only.
        **hx_arguments
            With hx, all arguments except the noise are passed to hx.

        Raises
        ------
        EmptyIntersectionError
            If no possible state is consistent with z (see ``on_empty``); `UnreachableMeasurementError` if no
            state at all is.
        ParameterError, ShapeError
            If z, a matrix or the value of hx is inadmissible, or neither H nor hx was set.
        """
        value = as_observation(z, self.dim_z)
        if value is None:
            self._skip()
            return
        seen = np.flatnonzero(~np.isnan(value))
        noise = self._measurement_noise
        if R is not None:
            noise, R = noise_of_step(self, "R", R)
        measure = sight(self, seen, R, H, hx_arguments)
        S = residual_matrix(self, noise, H) if self.is_closed_form else None
        observed = noise if seen.size == self.dim_z else noise.project(seen.tolist())
        outcome = explained(self._belief, measure, observed, value[seen], self._constraint, self.on_empty)
        _warn(outcome)
        assert outcome.belief is not None
        self._learn(outcome.belief, outcome.possibility, value.reshape(-1, 1))
        if S is not None:
            show_gain(self, outcome.posterior, seen, S)

    def _skip(self) -> None:
        """Let a missing measurement pass: nothing is learned from it."""
        self._learn(self._belief, 1.0, np.full((self.dim_z, 1), None, dtype=object))
        if self.is_closed_form:
            show_no_gain(self)

    def _learn(self, belief: Belief, possibility: float, z: Any) -> None:
        """Keep what an update has found."""
        self.remember_origin()
        self._belief, self.possibility, self.z = belief, possibility, z
        self.x_post, self.P_post = self._estimate()

    def _estimate(self) -> tuple[Any, Any]:
        """Copy x and P."""
        x, P = self._belief.moments()
        return x.copy(), P.copy()

    # ------------------------------------------------------------------ whole series

    def filter(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter a series, starting from the current membership.

        The estimator ends at the last observation, so `step` continues the series.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.
        us : sequence of n controls, optional
            Passed to `predict` one by one.  A pandas index must equal that of ``zs``.
        Rs, Qs : sequence of n, optional
            Noise of each measurement and prediction, in any form that `update` and `predict` accept; None in
            a list means that of the estimator.
        Fs, Hs : sequence of n, optional
            Linear models: matrix of each prediction (entry k leads to observation k) and of each measurement.
        fx_args, hx_args : sequence of n dict, optional
            Keyword arguments of each prediction and of each update.
        resume : bool
            Continue the series; the estimator always starts from its current membership, but the times of a
            dated series are then checked as well.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``possibility``, ``lower``, ``upper`` and, for
            Gaussian memberships, ``log_likelihood``.

        Raises
        ------
        ShapeError, ParameterError, EmptyIntersectionError
            As from `predict` and `update`; the estimator is then unchanged.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator, IntervalMembership
        >>> est = FuzzyRelationEstimator(1, 1, H=1.0)
        >>> est.filter([1.0, None, 2.0], Rs=[None, None, 4.0]).x.ravel().round(3).tolist()
        [0.667, 0.667, 1.2]
        >>> bounds = FuzzyRelationEstimator(
        ...     dim_x=1,
        ...     dim_z=1,
        ...     H=1.0,
        ...     state=IntervalMembership(-9.0, 9.0),
        ...     measurement_noise=IntervalMembership(-1.0, 1.0),
        ... )
        >>> found = bounds.filter([1.5, 2.0], Rs=[None, IntervalMembership(-0.25, 0.25)])
        >>> found.lower.ravel().round(2).tolist(), found.upper.ravel().round(2).tolist()
        ([0.5, 1.75], [2.5, 2.25])
        """
        told = {"us": us, "Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "fx_args": fx_args, "hx_args": hx_args}
        series = read_steps(zs, self.dim_z, told)
        return self._filter_noting(series.zs, resume=resume, told=series.steps, uneven=series.uneven)

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = USUAL_FIELDS,
        us: ManySeriesLike | PerStep = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        by: Hashable | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each as `filter` does; the estimator itself does not change.

        Parameters
        ----------
        zs, keep, by
            As in `fuzzykf.Filter.filter_many`; this filter also has ``possibility``, ``lower`` and ``upper``.
        us : array_like, mapping or None
            Controls: the same for all series, or one set per series, as an array (series, n, dim_u) or a
            mapping.
        Rs, Qs, Fs, Hs, fx_args, hx_args, resume
            As in `filter`; the same for every series.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.  Names and index are kept, see `FilterResult.to_dataframe`.

        Raises
        ------
        ShapeError, ParameterError, EmptyIntersectionError
            As from `filter`; if the filter does not have a field in ``keep``.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator
        >>> found = FuzzyRelationEstimator(1, 1, H=1.0).filter_many(
        ...     {"a": [1.0, 2.0], "b": [0.0]}, keep="x"
        ... )
        >>> found.x[..., 0].round(3).tolist()
        [[0.667, 1.5], [0.0, nan]]
        """
        told = {"Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "fx_args": fx_args, "hx_args": hx_args}
        many = read_many(zs, self.dim_z, by, uneven=is_uneven(told))
        more = {"resume": True} if as_flag("resume", resume) else {}
        arguments = of_each(many, us, self.dim_u, told)
        return self._filter_all(many, keep, lambda rows, n: [{**one, **more} for one in arguments(rows, n)])

    def smooth(
        self,
        zs: ManyNumbers,
        us: PerStep | None = None,
        *,
        Rs: PerStep | None = None,
        Qs: PerStep | None = None,
        Fs: PerStep | None = None,
        Hs: PerStep | None = None,
        fx_args: Sequence[Mapping[str, Any] | None] | None = None,
        hx_args: Sequence[Mapping[str, Any] | None] | None = None,
        memory: float = MEMORY,
    ) -> FilterResult:
        """Smooth a series: estimate every state given all measurements.

        Parameters
        ----------
        zs, us, Rs, Qs, Fs, Hs, fx_args, hx_args
            As in `filter`; the estimator ends at the last observation.
        memory : float
            Memory for the grids of the forward pass, in bytes; by default 2^30.  If it is not enough, some
            grids are computed twice.

        Returns
        -------
        FilterResult
            ``x``, ``P``, ``lower`` and ``upper`` given the whole series; ``possibility`` and, for Gaussian
            memberships, ``log_likelihood`` are those of the filter.

        Raises
        ------
        EmptyIntersectionError
            As from `filter`; if later measurements exclude all states that earlier ones admit, and
            ``on_empty``
            is "raise".  Otherwise such a state keeps its filtered membership, and the backward pass restarts
            there.  Measurements that "keep" skipped are skipped backward, too; a "reset" separates the
            passes before and after it.
        ParameterError, ShapeError
            As from `filter`; if a subclass overrides `predict` or `update` and assigns the membership; if
            ``memory`` is less than 16 grids.

        Warns
        -----
        SupportWarning
            As from `filter`; if later measurements move states to the edge of the filter's grid, which a
            smaller ``floor`` makes larger; in several dimensions under Hamacher's t-norm, if conflicting
            measurements and steep tails leave no digits of the differences that smoothing takes.

        Notes
        -----
        With Gaussian memberships and the product, this is the Rauch-Tung-Striebel smoother; the same
        recursion
        holds for the other closed families.  Intervals and boxes are contracted backward and, in several
        dimensions, repeatedly forward and backward: the bounds contain every trajectory that is consistent
        with all measurements, and are exact for a scalar state.  On a grid, the backward pass is a
        convolution with the reflected noise; for the minimum, the smoothed membership is the minimum of the
        forward and the backward one, divided by its peak.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator
        >>> est = FuzzyRelationEstimator(1, 1, H=1.0)
        >>> est.smooth([1.0, None, 2.0]).x.ravel().round(3).tolist()
        [0.909, 1.273, 1.636]
        """
        told = {"us": us, "Rs": Rs, "Qs": Qs, "Fs": Fs, "Hs": Hs, "fx_args": fx_args, "hx_args": hx_args}
        series = read_steps(zs, self.dim_z, told)
        return smooth_series(self, series, memory)

    # ------------------------------------------------------------------ the state

    @property
    def is_closed_form(self) -> bool:
        """Whether the membership is a closed form, with the attributes of a Kalman filter."""
        return self.representation not in {"interval", "grid"}

    @property
    def x(self) -> Any:
        """Centroid of the membership (dim_x, 1); flat if assigned flat."""
        return self._belief.moments()[0]

    @x.setter
    def x(self, value: Numbers) -> None:
        self._require_closed_form("x")
        x = as_center(value, self.dim_x)
        if x.shape != self.x.shape:  # flat or column: everything follows x
            self.x_prior, self.x_post = self.x_prior.reshape(x.shape), self.x_post.reshape(x.shape)
            self.y = self.y.reshape((-1,) if x.ndim == 1 else (-1, 1))
        self._belief = QuadraticBelief(self.representation, x, self.P)

    @property
    def P(self) -> Any:
        """Spread of the membership (dim_x, dim_x)."""
        return self._belief.moments()[1]

    @P.setter
    def P(self, value: Numbers) -> None:
        self._require_closed_form("P")
        self._belief = QuadraticBelief(self.representation, self.x, as_matrix("P", value, self.dim_x))

    @property
    def membership(self) -> Membership:
        """Membership of the state; may be assigned."""
        return self._belief.as_membership()

    @membership.setter
    def membership(self, value: Memberships) -> None:
        given = as_membership("membership", value, self.dim_x, self.t_norm)
        belief = believe("membership", given, self.representation, self.t_norm, self._universe)
        box = self._constraint if self._constraint is None or is_crisp(self._constraint) else None
        self._belief = assigned(belief, box)

    @property
    def lower(self) -> FloatArray:
        """Lower bounds (dim_x,) of the possible states (on a grid: above the floor)."""
        return narrowed(*self._belief.bounds(), self._constraint)[0]

    @property
    def upper(self) -> FloatArray:
        """Upper bounds (dim_x,) of the possible states (on a grid: above the floor)."""
        return narrowed(*self._belief.bounds(), self._constraint)[1]

    def defuzzify(self, method: Literal["centroid", "mean_of_maximum", "peak"] = "centroid") -> FloatArray:
        """Return a point estimate of the state.

        Parameters
        ----------
        method : {"centroid", "mean_of_maximum", "peak"}
            "centroid" is the most robust.  "mean_of_maximum" is the mean of the grid nodes of largest
            membership, so its resolution is a cell; "peak" is that of a parabola through the best node and
            its neighbours.

        Returns
        -------
        ndarray, shape (dim_x, 1)

        Raises
        ------
        ParameterError
            If the method is unknown.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator, TriangularMembership
        >>> est = FuzzyRelationEstimator(
        ...     1,
        ...     1,
        ...     state=TriangularMembership(0.0, 0.0, 3.0),
        ...     points=301,
        ...     measurement_noise=TriangularMembership(-1.0, 0.0, 1.0),
        ... )
        >>> est.defuzzify("centroid").round(3).item(), est.defuzzify("mean_of_maximum").item()
        (1.0, 0.0)
        """
        as_choice("method", method, ("centroid", "mean_of_maximum", "peak"))
        if method == "centroid":
            return np.array(self.x).reshape(-1, 1)
        if method == "mean_of_maximum":
            return self._belief.mean_of_maximum().reshape(-1, 1)
        return self._belief.peak().reshape(-1, 1)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the membership of the state, with the estimate marked.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_estimate`: components, level, truth, label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.memberships import plot_estimate

        return plot_estimate(self, ax, **options)

    # ------------------------------------------------------------------ the noise

    @property
    def Q(self) -> Any:
        """Matrix of the process noise in the closed forms, else None."""
        return getattr(self._process_noise, "matrix", None) if self.is_closed_form else None

    @Q.setter
    def Q(self, value: Numbers) -> None:
        self._process_noise = with_noise("Q", self._process_noise, value, self.representation)

    @property
    def R(self) -> Any:
        """Matrix of the measurement noise in the closed forms, else None."""
        return getattr(self._measurement_noise, "matrix", None) if self.is_closed_form else None

    @R.setter
    def R(self, value: Numbers) -> None:
        self._measurement_noise = with_noise("R", self._measurement_noise, value, self.representation)

    @property
    def process_noise(self) -> Membership:
        """Membership of the process noise; assign a new one if it changes with time."""
        return self._current(self._process_noise)

    @process_noise.setter
    def process_noise(self, value: Memberships | None) -> None:
        self._process_noise = self._as_used("process_noise", value, self.dim_x)

    @property
    def measurement_noise(self) -> Membership:
        """Membership of the measurement noise; assign a new one if it changes with time."""
        return self._current(self._measurement_noise)

    @measurement_noise.setter
    def measurement_noise(self, value: Memberships) -> None:
        self._measurement_noise = self._as_used("measurement_noise", value, self.dim_z)

    def _as_used(self, name: str, value: Any, dim: int) -> Membership:
        """Bring what a user gives for a noise into the form in which it is used."""
        return as_used(name, as_membership(name, value, dim, self.t_norm), self.representation)

    def _current(self, noise: Membership) -> Membership:
        """Return a noise after edits of its matrix in place, as `Q` and `R` allow them."""
        return as_used("noise", noise, self.representation) if self.is_closed_form else noise

    def _require_closed_form(self, name: str) -> None:
        if not self.is_closed_form:
            instead = {"Q": "process_noise", "R": "measurement_noise"}.get(name, "membership")
            raise no_matrix(name, self.representation, instead)

    # ------------------------------------------------------------------ the constraint

    @property
    def constraint(self) -> Membership | None:
        """Constraint on the state at every step, or None; a membership or a box may be assigned.

        The current membership is combined with it at once.
        """
        return self._constraint

    @constraint.setter
    def constraint(self, value: Memberships | Sequence[Numbers] | None) -> None:
        found = None if value is None else as_constraint(value, self.dim_x, self.t_norm)
        if found is not None:
            check_constraint(found, self.representation)
            self._belief = assigned(self._belief, found)
        self._constraint = found

    # ------------------------------------------------------------------ files

    def to_dict(self) -> dict[str, Any]:
        """Return settings and state of the estimator as plain values.

        Returns
        -------
        dict

        Raises
        ------
        ParameterError
            If it, or one of its memberships, holds functions: names them.
        """
        return to_values(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create an estimator from the output of `to_dict`, in the same state.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        FuzzyRelationEstimator
        """
        return from_values(cls, values)

    @shown
    def __repr__(self) -> str:
        return describe(self)


def _warn(outcome: Outcome) -> None:
    for note in outcome.notes:
        warnings.warn(note, SupportWarning, stacklevel=3)
