"""What the measurements of a fuzzy estimator show of its state, and where its noise can take it.

`observability` asks how possible it is that two initial states show the same measurements,

    chi_n(a, b) = sup over z of T(Pi(z_1, ..., z_n | a), Pi(z_1, ..., z_n | b)) ,

which never grows with n; `controllability` how possible it is that the noise leads from one state to another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_count, as_numbers, as_real, brief, check_definite, whitening
from fuzzykf.possibility import gramians
from fuzzykf.possibility.around import LocalObservability, observe_around
from fuzzykf.possibility.estimator import FuzzyRelationEstimator
from fuzzykf.possibility.mapping import as_map
from fuzzykf.possibility.memberships import JointMembership, TriangularMembership
from fuzzykf.possibility.representation import as_box, as_quadratic
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.memberships import Membership
    from fuzzykf.possibility.norms import TNorm

__all__ = ["Controllability", "LocalObservability", "Observability", "controllability", "observability"]

#: Bisections for a possibility that a linear program decides level by level.
BISECTIONS = 40

#: More measurements than anybody asks for.
MOST = 10_000


class Linear(NamedTuple):
    """The model of an estimator.

    Its noises have matrices (of a closed family), or cuts that are boxes; the others are None.
    """

    F: FloatArray
    H: FloatArray
    t_norm: TNorm
    process: Membership
    measurement: Membership
    Q: FloatArray | None
    R: FloatArray | None

    @property
    def scale(self) -> float:
        """Cost of a quadratic form of one."""
        return 0.5 if self.t_norm.family == "gaussian" else 1.0


@reprs("verdict", "level", "rank", "widths")
@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of the initial state of a linear model, from `observability`.

    Attributes
    ----------
    level : float
        Two states count as distinguished if the possibility that they give the same measurements is lower.
    gramian : ndarray, shape (m, m), or None
        W in chi = g^-1((a - b)' W (a - b) / 2) after n measurements; None for bounded noise.
    rank : int
        Number of observable directions.
    unobservable : ndarray, shape (m - rank, m)
        Unobservable directions.
    widths : ndarray, shape (n, m)
        Largest |a_i - b_i| of states that 1, ..., n measurements need not distinguish; may be infinite.
    components : int
        Number of connected parts of the set of states that are not distinguished from a given one; 1 for a
        linear model.

    Examples
    --------
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.possibility import observability
    >>> observability(
    ...     FuzzyRelationEstimator(dim_x=1, dim_z=1, H=1.0, Q=1.0), 3
    ... ).is_observable
    True
    """

    level: float
    gramian: FloatArray | None
    rank: int
    unobservable: FloatArray
    widths: FloatArray
    components: int
    model: Linear

    #: What is counted, and what the widths are of, on pictures.
    counted: ClassVar[str] = "measurements"
    meaning: ClassVar[str] = "undecided"

    @property
    def is_observable(self) -> bool:
        """Whether every direction is observable."""
        return self.rank == int(self.widths.shape[1])

    @property
    def verdict(self) -> str:
        """The result in words."""
        n, m = self.widths.shape
        times = f"{n} measurement{'s' if n > 1 else ''}"
        if self.is_observable:
            return (
                f"observable: states that {times} leave undecided at level {self.level:g} differ by at most "
                f"{_numbers(self.widths[-1])}"
            )
        return (
            f"not observable: {times} show{'s' if n == 1 else ''} {self.rank} of {m} directions, and "
            f"nothing of {_directions(self.unobservable)}"
        )

    def chi(self, a: ArrayLike, b: ArrayLike) -> float:
        """Possibility that two initial states give the same measurements.

        Parameters
        ----------
        a, b : array_like, shape (m,) or (m, 1)

        Returns
        -------
        float

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator
        >>> est = FuzzyRelationEstimator(1, 1)
        >>> est.H = 1.0
        >>> round(observability(est, 1).chi(0.0, 1.0), 4)
        0.7788
        """
        model, n = self.model, self.widths.shape[0]
        m = model.F.shape[0]
        difference = _point("a", a, m) - _point("b", b, m)
        if self.gramian is not None:
            cost = model.scale * max(float(difference @ self.gramian @ difference), 0.0) / 2.0
            return float(model.t_norm.membership(cost))

        def undecided(level: float) -> bool:
            w, v = _width(model.process, level), _width(model.measurement, level)
            return gramians.can_differ(model.F, model.H, w, v, n, difference)

        return _highest(undecided)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw how the widths shrink with the number of measurements.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_widths`: label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.widths import plot_widths

        return plot_widths(self, ax, **options)


@reprs("verdict", "level", "rank", "widths")
@dataclass(frozen=True, eq=False)
class Controllability:
    """Controllability by the process noise, from `controllability`.

    Attributes
    ----------
    level : float
    gramian : ndarray, shape (m, m), or None
        Matrix of the membership of the state after n predictions from a known one; None for bounded noise.
    rank : int
        Number of controllable directions.
    uncontrollable : ndarray, shape (m - rank, m)
        Uncontrollable directions d: d' x does not depend on the noise.
    center : ndarray, shape (m,)
        State of largest membership after n predictions.
    widths : ndarray, shape (n, m)
        Largest deviation from the most possible state at that level, after 1, ..., n predictions.

    Examples
    --------
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.possibility import controllability
    >>> controllability(
    ...     FuzzyRelationEstimator(dim_x=1, dim_z=1, H=1.0, Q=1.0), 3
    ... ).is_controllable
    True
    """

    level: float
    gramian: FloatArray | None
    rank: int
    uncontrollable: FloatArray
    center: FloatArray
    widths: FloatArray
    model: Linear

    counted: ClassVar[str] = "predictions"
    meaning: ClassVar[str] = "reached"

    @property
    def is_controllable(self) -> bool:
        """Whether the noise reaches every direction."""
        return self.rank == int(self.widths.shape[1])

    @property
    def verdict(self) -> str:
        """The result in words."""
        n, m = self.widths.shape
        times = f"{n} prediction{'s' if n > 1 else ''}"
        if self.is_controllable:
            return (
                f"controllable: at level {self.level:g} the noise of {times} leads up to "
                f"{_numbers(self.widths[-1])} away"
            )
        return (
            f"not controllable: the noise of {times} reaches {self.rank} of {m} directions, and not "
            f"{_directions(self.uncontrollable)}"
        )

    def possibility(self, b: ArrayLike) -> float:
        """Possibility that the noise leads to a state.

        Parameters
        ----------
        b : array_like, shape (m,) or (m, 1)

        Returns
        -------
        float
            0 for unreachable states.

        Examples
        --------
        >>> from fuzzykf import FuzzyRelationEstimator
        >>> est = FuzzyRelationEstimator(1, 1)
        >>> round(controllability(est, 2).possibility(1.0), 4)
        0.7788
        """
        model, n = self.model, self.widths.shape[0]
        end = _point("b", b, self.center.size)
        way = end - self.center
        if self.gramian is not None:
            whiten, null = whitening(self.gramian)
            off = np.abs(null) @ (np.abs(end) + np.abs(self.center))
            if (np.abs(null @ way) > 1e-9 * off).any():
                return 0.0
            return float(model.t_norm.membership(model.scale * float(((whiten @ way) ** 2).sum())))

        def reached(level: float) -> bool:
            lower, upper = model.process.support(level)
            peak = model.process.peak
            return gramians.can_reach(model.F, lower - peak, upper - peak, n, way)

        return _highest(reached)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw how the widths grow with the number of predictions.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_widths`: label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.widths import plot_widths

        return plot_widths(self, ax, **options)


def observability(
    est: FuzzyRelationEstimator, n: int, level: float = 0.5, x: ArrayLike | None = None
) -> Observability | LocalObservability:
    """Determine how well n measurements identify the state at the first of them.

    Parameters
    ----------
    est : FuzzyRelationEstimator
        Either with a linear model and noises of a closed family, crisp noises or, for the minimum, noises
        whose cuts are boxes; its current membership then does not matter.  Or on a grid with any model;
        states between ``lower`` and ``upper`` are considered.  It does not change.  A ``constraint`` of
        later steps is ignored.
    n : int
        Number of measurements.
    level : float
        In ]0, 1]: two states are distinguished if the possibility that they give the same measurements is
        lower.  For noises with a single peak, level 1 is classical observability.
    x : array_like, shape (m,) or (m, 1), optional
        State to distinguish from others, by default that of the estimator.  It does not matter for a linear
        model.

    Returns
    -------
    Observability
        For a linear model.
    LocalObservability
        For other models, on a grid: states not distinguished from ``x`` by its most possible measurements.
        Its widths are smaller than those over all measurements: by 1/sqrt(2) in the closed families, by 1/2
        for bounded noise.

    Raises
    ------
    ParameterError, ShapeError
        If an argument is inadmissible; if the model is not linear, or its noises have other shapes, and the
        estimator is not on a grid; if the measurement noise is zero in some direction; if ``x`` is outside
        the grid.

    Notes
    -----
    For the closed families chi = g^-1((a - b)' W (a - b) / 2) with W <- H' R^-1 H + F' W (I + Q W)^-1 F, once
    per measurement.  For bounded noise and the minimum, a linear program finds the largest differences d_0
    with |d_(k+1) - F d_k| and |H d_k| within the widths of the cuts.  In both cases, all widths are finite if
    and only if the classical rank condition holds.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.possibility import observability
    >>> est = FuzzyRelationEstimator(2, 1)
    >>> est.F, est.H, est.Q = (
    ...     np.array([[1.0, 1.0], [0.0, 1.0]]),
    ...     np.array([[1.0, 0.0]]),
    ...     0.0,
    ... )
    >>> print(observability(est, 1).verdict)
    not observable: 1 measurement shows 1 of 2 directions, and nothing of [0, 1]
    >>> print(observability(est, 10).verdict)
    observable: states that 10 measurements leave undecided at level 0.5 differ by at most 0.979 and 0.183
    """
    est = _estimator(est)
    n, level, m = as_count("n", n, 1, most=MOST), _level(level), est.dim_x
    around = None if x is None else _point("x", x, m)
    model = _linear(est, "observability")
    if isinstance(model, ParameterError):
        if est.representation == "grid":
            return observe_around(est, n, level, around)
        raise model
    spaces = [gramians.row_space(gramians.observability_matrix(model.F, model.H, k)) for k in range(1, m + 1)]
    spaces += spaces[-1:] * max(n - m, 0)
    if model.Q is None or model.R is None:
        w, v = _width(model.process, level), _width(model.measurement, level)
        W = None
        widths = [gramians.bounded_widths(model.F, model.H, w, v, k + 1, spaces[k][1]) for k in range(n)]
    else:
        check_definite(model.R, lambda _: "measurement_noise", strict=True)
        tables = gramians.information(model.F, model.H, model.Q, model.R, n)
        bound = 2.0 * float(model.t_norm.cost(level)) / model.scale
        widths = [gramians.widths_in(tables[k], *spaces[k], bound) for k in range(n)]
        W = tables[-1]
    seen, unseen = spaces[n - 1]
    return Observability(level, W, seen.shape[1], unseen, np.array(widths), 1, model)


def controllability(
    est: FuzzyRelationEstimator, n: int, level: float = 0.5, x: ArrayLike | None = None
) -> Controllability:
    """Determine where the process noise of n predictions can move a known state (linear models).

    Parameters
    ----------
    est : FuzzyRelationEstimator
        As for `observability`, but only its process noise matters.
    n : int
        Number of predictions.
    level : float
        Level of the widths, in ]0, 1].
    x : array_like, shape (m,) or (m, 1), optional
        Initial state; by default zero.

    Returns
    -------
    Controllability

    Raises
    ------
    ParameterError, ShapeError
        As from `observability`.

    Notes
    -----
    The Gramian is the matrix of n predictions of a `SingletonMembership`; the possibility of reaching b is
    g^-1(|b - F^n x|^2) in that metric.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import FuzzyRelationEstimator
    >>> from fuzzykf.possibility import controllability
    >>> est = FuzzyRelationEstimator(2, 1)
    >>> est.F, est.Q = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.0, 1.0])
    >>> print(controllability(est, 1).verdict)
    not controllable: the noise of 1 prediction reaches 1 of 2 directions, and not [1, 0]
    >>> print(controllability(est, 2).verdict)
    controllable: at level 0.5 the noise of 2 predictions leads up to 1.18 and 1.67 away
    """
    est = _estimator(est)
    n, level = as_count("n", n, 1, most=MOST), _level(level)
    model = _linear(est, "controllability", measured=False)
    if isinstance(model, ParameterError):
        raise model
    F, m = model.F, model.F.shape[0]
    center = np.zeros(m) if x is None else _point("x", x, m)
    if model.Q is not None:
        spread = _root(model.Q)
        tables = gramians.reachable(F, model.Q, n)
        bound = float(model.t_norm.cost(level)) / model.scale
        widths = np.sqrt(bound * np.diagonal(tables, axis1=1, axis2=2))
        W = tables[-1]
    else:
        half = 0.5 * _width(model.process, level)
        spread, W, widths, power = np.diag(half), None, np.empty((n, m)), np.eye(m)
        for k in range(n):  # the exact bounds of a sum of boxes
            widths[k] = (widths[k - 1] if k else 0.0) + np.abs(power) @ half
            power = F @ power
    for _ in range(n):
        center = F @ center + model.process.peak
    seen, unseen = gramians.row_space(gramians.observability_matrix(F.T, spread.T, n))
    return Controllability(level, W, seen.shape[1], unseen, center, widths, model)


def _estimator(est: Any) -> FuzzyRelationEstimator:
    if not isinstance(est, FuzzyRelationEstimator):
        raise ParameterError(f"est: got {brief(est)}, expected a FuzzyRelationEstimator")
    return est


def _linear(est: Any, name: str, *, measured: bool = True) -> Linear | ParameterError:
    """Return the model of an estimator, or the error for one that is of no kind that can be judged."""
    for function in ("fx", "hx") if measured else ("fx",):
        if getattr(est, function) is not None:
            return ParameterError(
                f"{function}: got a function, expected a linear model, which {name} can judge"
            )
    d, q, norm = est.dim_x, est.dim_z, est.t_norm
    F = as_map("F", est.F, (d, d))
    H = as_map("H", est.H, (q, d)) if measured else np.zeros((q, d))
    process, measurement = est.process_noise, est.measurement_noise
    family = norm.family
    found = [None if family is None else as_quadratic(noise, family) for noise in (process, measurement)]
    Q, R = (None if one is None else one[1] for one in found)
    if Q is not None and (R is not None or not measured):
        return Linear(F, H, norm, process, measurement, Q, R)
    noises = {"process_noise": process, "measurement_noise": measurement}
    for role, noise in noises.items():
        if (measured or role == "process_noise") and not _has_boxes(noise, norm):
            return ParameterError(
                f"{role}: got {noise!r}, which {name} cannot judge under the t-norm {norm.name!r}; expected "
                f"noises all of the family {family or 'of none'!r}, all crisp, or of boxes under the minimum"
            )
    return Linear(F, H, norm, process, measurement, None, None)


def _has_boxes(noise: Membership, t_norm: TNorm) -> bool:
    """Whether all cuts of a noise are boxes, and what combines of them has the cut that combines of these."""
    if as_box(noise) is not None:
        return True
    if t_norm.additive:
        return False
    joint = isinstance(noise, JointMembership) and not noise.t_norm.additive
    return noise.dim == 1 or joint or isinstance(noise, TriangularMembership)


def _width(noise: Membership, level: float) -> FloatArray:
    """Widths of a cut."""
    lower, upper = noise.support(level)
    return upper - lower


def _highest(holds: Any) -> float:
    """Return the highest level at which something holds that holds the less the higher the level."""
    if holds(1.0):
        return 1.0
    low, high = 0.0, 1.0
    if not holds(np.finfo(float).tiny):
        return 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _root(matrix: FloatArray) -> FloatArray:
    """Return a factor L of L L', with as many columns as there are directions with spread."""
    whiten, _ = whitening(matrix)
    root: FloatArray = matrix @ whiten.T
    return root


def _level(level: float) -> float:
    value = as_real("level", level, "a number in ]0, 1]")
    if not 0.0 < value <= 1.0:
        raise ParameterError(f"level: got {level}, expected a number in ]0, 1]")
    return value


def _point(name: str, value: ArrayLike, dim: int) -> FloatArray:
    point = as_numbers(name, value)
    if point.size != dim or point.shape not in {(), (dim,), (dim, 1)}:
        raise ShapeError(f"{name}: got shape {point.shape}, expected ({dim},) or ({dim}, 1)")
    return as_array(name, point.ravel(), (dim,))


def _numbers(values: FloatArray) -> str:
    *first, last = (f"{value:.3g}" for value in values)
    return f"{', '.join(first)} and {last}" if first else last


def _directions(vectors: FloatArray) -> str:
    """Return unit vectors in words, the largest component of each positive."""
    told = []
    for vector in vectors:
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        told.append("[" + ", ".join(f"{round(value, 3) + 0.0:g}" for value in vector) + "]")
    return " and ".join(told)
