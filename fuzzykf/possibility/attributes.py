"""What can be read from, and assigned to, a fuzzy estimator."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.base import Filter
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, check_covariance
from fuzzykf.possibility.beliefs import BoxBelief, GridBelief, QuadraticBelief
from fuzzykf.possibility.memberships import as_membership
from fuzzykf.possibility.representation import FAMILIES, as_box, as_quadratic

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.beliefs import Belief
    from fuzzykf.possibility.closed_form import Posterior
    from fuzzykf.possibility.grid.universe import Universe
    from fuzzykf.possibility.memberships import IntervalMembership, Membership
    from fuzzykf.possibility.norms import TNorm
    from fuzzykf.possibility.representation import Representation

__all__ = ["EstimatorState", "as_map", "as_matrix"]


class EstimatorState(Filter):
    """State of `FuzzyRelationEstimator`: a belief and two noises, behind properties."""

    representation: Representation
    t_norm: TNorm
    possibility: float
    x_prior: Any
    P_prior: Any
    x_post: Any
    P_post: Any
    y: Any
    S: Any
    SI: Any
    K: Any
    _belief: Belief
    _universe: Universe | None
    _process_noise: Membership
    _measurement_noise: Membership

    @property
    def is_closed_form(self) -> bool:
        """Whether the membership is that of a quadratic form, with the attributes of a Kalman filter."""
        return self.representation not in {"interval", "grid"}

    @property
    def x(self) -> Any:
        """Centroid of the membership (dim_x, 1); flat if assigned flat."""
        return self._belief.moments()[0]

    @x.setter
    def x(self, value: ArrayLike) -> None:
        self._require_closed_form("x", "membership")
        x = self._checked_x(value)
        if x.shape != self.x.shape:  # flat or column: everything follows x
            self.x_prior, self.x_post = self.x_prior.reshape(x.shape), self.x_post.reshape(x.shape)
            self.y = self.y.reshape((-1,) if x.ndim == 1 else (-1, 1))
        self._belief = QuadraticBelief(self.representation, x, self.P)

    @property
    def P(self) -> Any:
        """Spread of the membership (dim_x, dim_x)."""
        return self._belief.moments()[1]

    @P.setter
    def P(self, value: ArrayLike) -> None:
        self._require_closed_form("P", "membership")
        self._belief = QuadraticBelief(self.representation, self.x, as_matrix("P", value, self.dim_x))

    @property
    def Q(self) -> Any:
        """Matrix of the process noise in the closed forms, else None."""
        return getattr(self._process_noise, "matrix", None) if self.is_closed_form else None

    @Q.setter
    def Q(self, value: ArrayLike) -> None:
        self._require_closed_form("Q", "process_noise")
        self._process_noise = self._with_matrix("Q", self._process_noise, value)

    @property
    def R(self) -> Any:
        """Matrix of the measurement noise in the closed forms, else None."""
        return getattr(self._measurement_noise, "matrix", None) if self.is_closed_form else None

    @R.setter
    def R(self, value: ArrayLike) -> None:
        self._require_closed_form("R", "measurement_noise")
        self._measurement_noise = self._with_matrix("R", self._measurement_noise, value)

    @property
    def membership(self) -> Membership:
        """Membership of the state; assign one to go on from there."""
        return self._belief.as_membership()

    @membership.setter
    def membership(self, value: Membership | Sequence[Membership | None]) -> None:
        self._belief = self._believe(
            "membership", as_membership("membership", value, self.dim_x, self.t_norm)
        )

    @property
    def process_noise(self) -> Membership:
        """Membership of the process noise; assign one for noise that changes with time."""
        return self._current(self._process_noise)

    @process_noise.setter
    def process_noise(self, value: Membership | Sequence[Membership | None] | None) -> None:
        self._process_noise = self._as_used(
            "process_noise", as_membership("process_noise", value, self.dim_x, self.t_norm)
        )

    @property
    def measurement_noise(self) -> Membership:
        """Membership of the measurement noise; assign one for noise that changes with time."""
        return self._current(self._measurement_noise)

    @measurement_noise.setter
    def measurement_noise(self, value: Membership | Sequence[Membership | None]) -> None:
        self._measurement_noise = self._as_used(
            "measurement_noise", as_membership("measurement_noise", value, self.dim_z, self.t_norm)
        )

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

    # ------------------------------------------------------------------ checks

    def _believe(self, name: str, membership: Membership) -> Belief:
        """Bring a membership into the representation of this estimator."""
        if self._universe is not None:
            return GridBelief.of(name, membership, self.t_norm, self._universe)
        if self.representation == "interval":
            return BoxBelief(self._box(name, membership))
        center, matrix = self._quadratic(name, membership)
        return QuadraticBelief(self.representation, center.reshape(-1, 1).copy(), matrix.copy())

    def _as_used(self, name: str, noise: Membership) -> Membership:
        """Bring a noise membership into the form in which it is used."""
        if self.representation == "interval":
            return self._box(name, noise)
        if self.is_closed_form:
            return FAMILIES[self.representation](*self._quadratic(name, noise))
        return noise

    def _box(self, name: str, membership: Membership) -> IntervalMembership:
        box = as_box(membership)
        if box is None:
            raise ParameterError(f"{name}: this estimator keeps intervals, expected a crisp membership")
        return box

    def _quadratic(self, name: str, membership: Membership) -> tuple[FloatArray, FloatArray]:
        found = as_quadratic(membership, self.representation)
        if found is None:
            raise ParameterError(
                f"{name}: this estimator keeps {self.representation} memberships, expected one of that shape"
            )
        return found

    def _current(self, noise: Membership) -> Membership:
        """Return a noise after edits of its matrix in place, as `Q` and `R` allow them."""
        return self._as_used("noise", noise) if self.is_closed_form else noise

    def _with_matrix(self, name: str, noise: Membership, value: ArrayLike) -> Membership:
        """Return the noise with another matrix."""
        return FAMILIES[self.representation](noise.peak, as_matrix(name, value, noise.dim))

    def _require_closed_form(self, name: str, instead: str) -> None:
        if not self.is_closed_form:
            raise ParameterError(
                f"{name}: has no meaning of its own in the representation {self.representation!r}; "
                f"use {instead}"
            )

    def _checked_x(self, value: ArrayLike) -> FloatArray:
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ShapeError(f"x: expected {self.dim_x} numbers, got {value!r}") from error
        if array.ndim == 0 and self.dim_x == 1:
            array = array.reshape(1, 1)
        if array.shape not in {(self.dim_x,), (self.dim_x, 1)}:
            raise ShapeError(f"x: got shape {array.shape}, expected ({self.dim_x}, 1) or ({self.dim_x},)")
        if not np.isfinite(array).all():
            raise ParameterError(f"x: got {array.ravel().tolist()}, expected finite numbers")
        return array

    # ------------------------------------------------------------------ residual and gain

    def _set_likelihood(self, log_likelihood: float, mahalanobis: float) -> None:
        """Set what only a Gaussian membership, read as a density, has."""
        self.log_likelihood = log_likelihood
        # As in filterpy, a likelihood too small for a float is the smallest one.
        self.likelihood = max(float(np.exp(log_likelihood)), sys.float_info.min)
        self.mahalanobis = mahalanobis

    def _set_gain(self, found: Posterior | None, seen: np.ndarray, S: FloatArray) -> None:
        """Keep residual and gain of an update; those of missing components are zero."""
        y, SI = np.zeros(self.dim_z), np.zeros((self.dim_z, self.dim_z))
        K = np.zeros((self.dim_x, self.dim_z))
        if found is not None:
            y[seen], K[:, seen], SI[np.ix_(seen, seen)] = found.y, found.K, found.SI
        self.y = y if self.x.ndim == 1 else y.reshape(-1, 1)
        self.S, self.SI, self.K = S, SI, K
        if self.representation == "gaussian":
            if found is None:
                self._set_likelihood(0.0, 0.0)
            else:
                self._set_likelihood(found.log_likelihood, float(np.sqrt(found.surprise)))


def as_matrix(name: str, value: ArrayLike, dim: int) -> FloatArray:
    """Check a covariance-like matrix; a number stands for that multiple of the identity.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        Wrong shape; not finite or not symmetric; indefinite.
    """
    array = np.asarray(value, dtype=np.float64)
    return check_covariance(name, array * np.eye(dim) if array.ndim == 0 else array, (dim, dim))


def as_map(name: str, value: Any, shape: tuple[int, int]) -> FloatArray:
    """Check the matrix of a linear map; a number will do for a 1 x 1 matrix.

    Raises
    ------
    ShapeError, ParameterError
        Wrong shape; not finite.
    """
    array = np.asarray(value, dtype=np.float64)
    return as_array(name, array.reshape(1, 1) if array.ndim == 0 and shape == (1, 1) else array, shape)
