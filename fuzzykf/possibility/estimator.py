"""The fuzzy dynamic model state estimator of Layne and Passino, as a filter."""

from __future__ import annotations

import sys
import warnings
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.base import Filter, as_observation
from fuzzykf.errors import ParameterError, SupportWarning
from fuzzykf.gaussian import as_choice, is_whole
from fuzzykf.possibility.beliefs import QuadraticBelief, believe, nothing_explains
from fuzzykf.possibility.closed_form import over_all
from fuzzykf.possibility.mapping import Mapping, as_map, control
from fuzzykf.possibility.memberships.derived import as_membership
from fuzzykf.possibility.norms import as_t_conorm, as_t_norm
from fuzzykf.possibility.representation import (
    FAMILIES,
    as_center,
    as_matrix,
    as_used,
    choose,
    required_quadratic,
    universe_of,
)
from fuzzykf.possibility.smoother import MEMORY, smooth_series
from fuzzykf.reprs import shown, value_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray, IntArray, ManyNumbers, Numbers
    from fuzzykf.base import FilterResult
    from fuzzykf.possibility.closed_form import Posterior
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TConorm, TNorm
    from fuzzykf.possibility.protocol import Belief, Outcome

__all__ = ["FuzzyRelationEstimator"]

#: The components of a measurement that is missing.
NONE_SEEN = np.zeros(0, dtype=np.intp)


class FuzzyRelationEstimator(Filter):
    """Recursive state estimation with membership functions in place of densities.

    The membership mu of the state x is propagated by the extension principle and
    updated by conditioning on the measurement z:

    - predict: mu'(x') = sup of T(mu(x), mu_W(w)) over all x, w with x' = f(x) + w;
    - update: mu+(x) = T(mu(x), mu_V(z - h(x))), divided by its peak.

    With Gaussian memberships and the product it is the Kalman filter, with intervals
    a guaranteed bound, with anything else a function on a grid.

    Parameters
    ----------
    dim_x, dim_z : int
        Number of components of the state and of a measurement.
    dim_u : int
        Number of components of the control u, as in filterpy; not needed.
    fx, hx : callable, optional
        Dynamics f and measurement h: take arrays (..., dim_x), return (..., dim_x) and
        (..., dim_z).  Keyword arguments of `predict` reach fx (and fx_inverse,
        fx_interval) only, those of `update` hx (and hx_interval) only.  By default
        the model is linear, with the matrices ``F`` and ``H``.
    fx_inverse : callable, optional
        Inverse of fx on arrays (..., dim_x); NaN where there is no pre-image.  Grids
        work without it, but slower.
    fx_interval, hx_interval : callable, optional
        Interval extensions: map vectors (lower, upper) to bounds of the image of that box.
    state : Membership or sequence of scalar Membership, optional
        Of the state at the start.
    process_noise, measurement_noise : Membership, or sequence of (Membership or None), optional
        One membership of dimension dim_x or dim_z, or one scalar membership, or None
        for no noise, per component.  Without process_noise there is none.  Linear
        models of the closed forms below may leave out any membership: as in filterpy,
        it is then the one of center zero and unit matrix.
    t_norm : {"product", "min", "lukasiewicz", "hamacher"} or TNorm
        Combines memberships.
    t_conorm : {"max"}
        Joins alternatives; other conorms have no limit on a continuum and are refused.
    on_empty : {"raise", "keep", "reset"}
        If prediction and measurement exclude each other: raise
        `EmptyIntersectionError`; keep the prediction; or restart from the measurement
        alone.  The possibility of the measurement is then 0.
    points : int or sequence of int, optional
        Nodes of the grid per axis, by default 401, 101 or 41 in 1, 2 or 3 dimensions.
    domain : sequence of (lo, hi), optional
        A fixed universe.  By default the grid moves and refines with the live region.
    floor : float, optional
        States of a smaller membership are left out by a moving grid.  By default
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
        Centroid and spread: second central moments of the membership, for the closed
        forms its matrix.  Assignable in the closed forms.
    x_prior, P_prior, x_post, P_post : ndarray
        Copies from before and after the latest update.
    F, H, B : ndarray or None
        Matrices of a linear model.
    Q, R : ndarray or None
        Matrices of the noise in the closed forms.
    y, S, SI, K : ndarray
        Residual, its matrix and inverse, gain (closed forms).
    log_likelihood, likelihood, mahalanobis : float
        Of the latest z; only for "gaussian".
    possibility : float
        Possibility of the latest z, in [0, 1]: one minus the surprise.
    z : ndarray
        The latest measurement, as a column.

    Raises
    ------
    ParameterError, ShapeError
        Whatever is inadmissible is named.

    Warns
    -----
    SupportWarning
        If possible states leave a grid at an edge, or a grid is too coarse.

    Notes
    -----
    Layne and Passino, Fuzzy Sets and Systems 122 (2001) 45-72: equations (24) and (28),
    the latter with the joint relation of x and z instead of a Cartesian product.
    For all t-norms but the product and the minimum, the result depends on the order of
    several measurements of one instant.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FuzzyRelationEstimator, GaussianMembership, IntervalMembership
    >>> est = FuzzyRelationEstimator(2, 1)
    >>> est.F, est.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    >>> est.step(1.5).round(3).tolist(), est.representation
    ([[1.125], [0.375]], 'gaussian')

    >>> walk = FuzzyRelationEstimator(
    ...     1, 1, state=IntervalMembership(0.0, 0.0), process_noise=IntervalMembership(-3.0, 3.0),
    ...     measurement_noise=IntervalMembership(-0.5, 0.5), hx=lambda x: 0.0005 * x**3,
    ... )
    >>> _ = walk.step(0.1)
    >>> walk.membership
    IntervalMembership(lower=[-3.], upper=[3.])

    >>> curve = FuzzyRelationEstimator(
    ...     1, 1, fx=lambda x: x + 0.5 * np.sin(x), hx=lambda x: x**2 / 4,
    ...     state=GaussianMembership(0.5, 1.0), process_noise=GaussianMembership(0.0, 0.05),
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
        state: Membership | Sequence[Membership | None] | None = None,
        process_noise: Membership | Sequence[Membership | None] | None = None,
        measurement_noise: Membership | Sequence[Membership | None] | None = None,
        t_norm: str | TNorm = "product",
        t_conorm: str | TConorm = "max",
        on_empty: Literal["raise", "keep", "reset"] = "raise",
        points: int | Sequence[int] | None = None,
        domain: Sequence[Sequence[float]] | None = None,
        floor: float | None = None,
    ) -> None:
        for name, value in (("dim_x", dim_x), ("dim_z", dim_z)):
            if not is_whole(value) or value < 1:
                raise ParameterError(f"{name}: got {value!r}, expected a whole number of at least 1")
        as_choice("on_empty", on_empty, ("raise", "keep", "reset"))
        if fx is None and (fx_inverse is not None or fx_interval is not None):
            raise ParameterError(
                "fx: got None, expected the function that belongs to fx_inverse or fx_interval"
            )
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
        self.F = np.eye(self.dim_x) if fx is None else None
        self.H = np.zeros((self.dim_z, self.dim_x)) if hx is None else None
        self.B = None
        self._process_noise = self._as_used("process_noise", choice.process_noise, self.dim_x)
        self._measurement_noise = self._as_used("measurement_noise", choice.measurement_noise, self.dim_z)
        on_grid = choice.representation == "grid"
        self._universe = universe_of(choice, self.t_norm, points, domain, floor) if on_grid else None
        self._belief = believe("state", choice.state, choice.representation, self.t_norm, self._universe)
        self.possibility = 1.0
        self.z: Any = np.full((self.dim_z, 1), None, dtype=object)
        self.x_prior, self.P_prior = self._estimate()
        self.x_post, self.P_post = self._estimate()
        if self.is_closed_form:
            self._set_gain(None, NONE_SEEN, np.zeros((self.dim_z, self.dim_z)))
        if self.representation == "gaussian":
            self._set_likelihood(float(np.log(sys.float_info.min)), 0.0)

    # ------------------------------------------------------------------ the verbs

    def predict(
        self,
        u: Numbers = None,
        B: Numbers = None,
        F: Numbers = None,
        Q: Numbers = None,
        **fx_arguments: Any,
    ) -> None:
        """Move the membership to the time of the next measurement.

        Parameters
        ----------
        u, B : array_like, optional
            Linear models: control vector and its matrix (by default ``B``).
        F, Q : array_like, optional
            Linear models: matrices for this step only; Q in the closed forms.
        **fx_arguments
            With fx, everything that is given reaches fx as a keyword argument.

        Raises
        ------
        ParameterError, ShapeError
            fx returned a wrong shape, or NaN at a possible state; bad matrices.
        SupportLostError
            All states have left the domain.
        """
        noise = self._process_noise
        if self.fx is None:
            _refuse_arguments("predict", fx_arguments, "fx")
            matrix = as_map("F", self.F if F is None else F, (self.dim_x, self.dim_x))
            shift = control(u, self.B if B is None else B, self.dim_x)
            move = Mapping("F", self.dim_x, self.dim_x, matrix=matrix, shift=shift)
            if Q is not None:
                noise = self._with_matrix("Q", noise, Q)
        else:
            given = {k: v for k, v in (("u", u), ("B", B), ("F", F), ("Q", Q)) if v is not None}
            move = Mapping(
                "fx",
                self.dim_x,
                self.dim_x,
                function=self.fx,
                inverse=self.fx_inverse,
                interval=self.fx_interval,
                arguments={**given, **fx_arguments},
            )
        outcome = self._belief.predict(move, noise)
        _warn(outcome)
        self.remember_origin()
        assert outcome.belief is not None
        self._belief = outcome.belief
        self.x_prior, self.P_prior = self._estimate()

    def update(
        self,
        z: Numbers,
        R: Numbers = None,
        H: Numbers = None,
        **hx_arguments: Any,
    ) -> None:
        """Take a measurement into account.

        Parameters
        ----------
        z : array_like or None
            None or NaN where missing, also in part.
        R, H : array_like, optional
            Linear models: matrices for this measurement only; R in the closed forms.
        **hx_arguments
            With hx, everything that is given reaches hx as a keyword argument.

        Raises
        ------
        EmptyIntersectionError
            No state is both possible and consistent with z (see ``on_empty``);
            `UnreachableMeasurementError` if no state whatever is consistent with it.
        ParameterError, ShapeError
            z or what hx returned is inadmissible; bad matrices.
        """
        value = as_observation(z, self.dim_z)
        if value is None:
            self._skip()
            return
        seen = np.flatnonzero(~np.isnan(value))
        noise, S = self._measurement_noise, np.zeros((self.dim_z, self.dim_z))
        if self.hx is None:
            _refuse_arguments("update", hx_arguments, "hx")
            matrix = as_map("H", self.H if H is None else H, (self.dim_z, self.dim_x))
            measure = Mapping("H", self.dim_x, self.dim_z, matrix=matrix, components=seen)
            if R is not None:
                noise = self._with_matrix("R", noise, R)
            if self.is_closed_form:
                S = matrix @ self.P @ matrix.T + required_quadratic("R", noise, self.representation)[1]
        else:
            given = {k: v for k, v in (("R", R), ("H", H)) if v is not None}
            measure = Mapping(
                "hx",
                self.dim_x,
                self.dim_z,
                function=self.hx,
                interval=self.hx_interval,
                arguments={**given, **hx_arguments},
                components=seen,
            )
        observed = noise if seen.size == self.dim_z else noise.project(seen.tolist())
        outcome = self._belief.update(measure, observed, value[seen])
        belief = outcome.belief or self._resolve(outcome, measure, observed, value[seen])
        _warn(outcome)
        self._learn(belief, outcome.possibility, value.reshape(-1, 1))
        if self.is_closed_form:
            self._set_gain(outcome.posterior, seen, S)

    def _skip(self) -> None:
        """Let a missing measurement pass: nothing is learned from it."""
        self._learn(self._belief, 1.0, np.full((self.dim_z, 1), None, dtype=object))
        if self.is_closed_form:
            self._set_gain(None, NONE_SEEN, np.zeros((self.dim_z, self.dim_z)))

    def _resolve(self, outcome: Outcome, measure: Mapping, noise: Membership, z: FloatArray) -> Belief:
        """Do what `on_empty` says when nothing is left."""
        if self.on_empty == "keep":
            return self._belief
        note = ""
        if self.on_empty == "reset":
            restarted = self._belief.restart(measure, noise, z)
            if restarted is not None:
                return restarted
            note = "; nor does it bound the state, so that there is nothing to restart from"
        raise nothing_explains(z, measure, self._belief, outcome, note)

    def _learn(self, belief: Belief, possibility: float, z: Any) -> None:
        """Keep what an update has found."""
        self.remember_origin()
        self._belief, self.possibility, self.z = belief, possibility, z
        self.x_post, self.P_post = self._estimate()

    def _estimate(self) -> tuple[Any, Any]:
        """Copy x and P."""
        x, P = self._belief.moments()
        return x.copy(), P.copy()

    def _set_likelihood(self, log_likelihood: float, mahalanobis: float) -> None:
        """Set what only a Gaussian membership, read as a density, has."""
        self.log_likelihood = log_likelihood
        # As in filterpy, a likelihood too small for a float is the smallest one.
        self.likelihood = max(float(np.exp(log_likelihood)), sys.float_info.min)
        self.mahalanobis = mahalanobis

    def _set_gain(self, found: Posterior | None, seen: IntArray, S: FloatArray) -> None:
        """Keep residual and gain of an update; those of missing components are zero."""
        y, self.SI, self.K = over_all(found, seen, self.dim_x, self.dim_z)
        self.y, self.S = y if self.x.ndim == 1 else y.reshape(-1, 1), S
        if self.representation == "gaussian":
            if found is None:
                self._set_likelihood(0.0, 0.0)
            else:
                self._set_likelihood(found.log_likelihood, float(np.sqrt(found.surprise)))

    # ------------------------------------------------------------------ the way back

    def smooth(self, zs: ManyNumbers, *, memory: float = MEMORY) -> FilterResult:
        """Filter a series, and look back: what each state is given the whole of it.

        Parameters
        ----------
        zs : array_like
            As in `filter`, which predicts first; the estimator ends at the last observation.
        memory : float
            On a grid, how many bytes the lattices that are kept for the way back may take; by default
            2^30.  If there are more, some are made again.

        Returns
        -------
        FilterResult
            ``x``, ``P``, ``lower`` and ``upper`` given the whole series; ``possibility`` and, of Gaussian
            memberships, ``log_likelihood`` are those of the filter.

        Raises
        ------
        EmptyIntersectionError
            As from `filter`; if later measurements exclude what earlier ones leave, and ``on_empty`` is
            "raise".  Otherwise such a state is what the filter knew, and the way back begins there anew.
            What "keep" skipped forward is skipped backward; what "reset" forgot is not told of what came
            after.
        ParameterError, ShapeError
            As from `filter`; if a verb of a subclass assigns the membership, which the way back could not
            follow; if ``memory`` is less than 16 lattices.

        Warns
        -----
        SupportWarning
            As from `filter`; if later measurements draw states to the edge of what the filter kept, which a
            smaller ``floor`` would widen.

        Notes
        -----
        With Gaussian memberships and the product it is the smoother of Rauch, Tung and Striebel.  Its
        recursion holds for the other closed families too.  For Łukasiewicz it is that of quadratic forms
        that are not cut at zero, so that what the filter excludes is excluded from ``lower`` and ``upper``.
        Intervals and boxes are contracted, back over the prediction and, in several dimensions, forth again
        until nothing is gained: every trajectory that explains all measurements stays within the bounds,
        and those of a scalar are exact.  On a grid it is a convolution with the reflected noise, looked up
        at the image of each node; for the minimum, which has no residuum, the membership of a state is the
        minimum of what earlier and what later measurements say, divided by its peak.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator
        >>> est = FuzzyRelationEstimator(1, 1)
        >>> est.H = 1.0
        >>> est.smooth([1.0, None, 2.0]).x.ravel().round(3).tolist()
        [0.909, 1.273, 1.636]
        """
        return smooth_series(self, zs, memory)

    # ------------------------------------------------------------------ the state

    @property
    def is_closed_form(self) -> bool:
        """Whether the membership is that of a quadratic form, with the attributes of a Kalman filter."""
        return self.representation not in {"interval", "grid"}

    @property
    def x(self) -> Any:
        """Centroid of the membership (dim_x, 1); flat if assigned flat."""
        return self._belief.moments()[0]

    @x.setter
    def x(self, value: Numbers) -> None:
        self._require_closed_form("x", "membership")
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
        self._require_closed_form("P", "membership")
        self._belief = QuadraticBelief(self.representation, self.x, as_matrix("P", value, self.dim_x))

    @property
    def membership(self) -> Membership:
        """Membership of the state; assign one to go on from there."""
        return self._belief.as_membership()

    @membership.setter
    def membership(self, value: Membership | Sequence[Membership | None]) -> None:
        given = as_membership("membership", value, self.dim_x, self.t_norm)
        self._belief = believe("membership", given, self.representation, self.t_norm, self._universe)

    @property
    def lower(self) -> FloatArray:
        """Lower bounds (dim_x,) of the states that are possible at all (grid: above the floor)."""
        return self._belief.bounds()[0]

    @property
    def upper(self) -> FloatArray:
        """Upper bounds (dim_x,) of the states that are possible at all (grid: above the floor)."""
        return self._belief.bounds()[1]

    def defuzzify(self, method: Literal["centroid", "mean_of_maximum", "peak"] = "centroid") -> FloatArray:
        """Turn the membership into one state.

        Parameters
        ----------
        method : {"centroid", "mean_of_maximum", "peak"}
            The centre of gravity is the robust choice.  The mean of the likeliest nodes
            of a grid cannot be finer than its cells; the peak is that of a parabola
            through the best node and its neighbours.

        Returns
        -------
        ndarray, shape (dim_x, 1)

        Raises
        ------
        ParameterError
            If there is no such method.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator, TriangularMembership
        >>> est = FuzzyRelationEstimator(
        ...     1, 1, state=TriangularMembership(0.0, 0.0, 3.0), points=301,
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
        if method == "peak":
            return self._belief.peak().reshape(-1, 1)
        raise ParameterError(f"method: got {method!r}, expected 'centroid', 'mean_of_maximum' or 'peak'")

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
        self._process_noise = self._with_matrix("Q", self._process_noise, value)

    @property
    def R(self) -> Any:
        """Matrix of the measurement noise in the closed forms, else None."""
        return getattr(self._measurement_noise, "matrix", None) if self.is_closed_form else None

    @R.setter
    def R(self, value: Numbers) -> None:
        self._measurement_noise = self._with_matrix("R", self._measurement_noise, value)

    @property
    def process_noise(self) -> Membership:
        """Membership of the process noise; assign one for noise that changes with time."""
        return self._current(self._process_noise)

    @process_noise.setter
    def process_noise(self, value: Membership | Sequence[Membership | None] | None) -> None:
        self._process_noise = self._as_used("process_noise", value, self.dim_x)

    @property
    def measurement_noise(self) -> Membership:
        """Membership of the measurement noise; assign one for noise that changes with time."""
        return self._current(self._measurement_noise)

    @measurement_noise.setter
    def measurement_noise(self, value: Membership | Sequence[Membership | None]) -> None:
        self._measurement_noise = self._as_used("measurement_noise", value, self.dim_z)

    def _as_used(self, name: str, value: Any, dim: int) -> Membership:
        """Bring what a user gives for a noise into the form in which it is used."""
        return as_used(name, as_membership(name, value, dim, self.t_norm), self.representation)

    def _current(self, noise: Membership) -> Membership:
        """Return a noise after edits of its matrix in place, as `Q` and `R` allow them."""
        return as_used("noise", noise, self.representation) if self.is_closed_form else noise

    def _with_matrix(self, name: Literal["Q", "R"], noise: Membership, value: Numbers) -> Membership:
        """Return the noise with another matrix."""
        self._require_closed_form(name, "process_noise" if name == "Q" else "measurement_noise")
        return FAMILIES[self.representation](noise.peak, as_matrix(name, value, noise.dim))

    def _require_closed_form(self, name: str, instead: str) -> None:
        if not self.is_closed_form:
            raise ParameterError(
                f"{name}: has no meaning of its own in the representation {self.representation!r}; "
                f"use {instead}"
            )

    @shown
    def __repr__(self) -> str:
        head = (
            f"{type(self).__name__}(dim_x={self.dim_x}, dim_z={self.dim_z}): representation "
            f"{self.representation!r}, t-norm {self.t_norm.name!r}"
        )
        parts = {
            "state": self._belief,
            "process noise": self._process_noise,
            "measurement noise": self._measurement_noise,
        }
        return "\n".join([head, *(f"  {name}: {value_text(part, 80)}" for name, part in parts.items())])


def _refuse_arguments(verb: str, arguments: dict[str, Any], function: str) -> None:
    if arguments:
        raise TypeError(
            f"{verb}() got an unexpected keyword argument {next(iter(arguments))!r}; "
            f"only {function} could use it"
        )


def _warn(outcome: Outcome) -> None:
    for note in outcome.notes:
        warnings.warn(note, SupportWarning, stacklevel=3)
