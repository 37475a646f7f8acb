"""Triangular norms and conorms, with their additive generators.

A t-norm T combines the memberships of things that hold together.  Where it has an
additive generator g (decreasing, g(1) = 0), T(a, b) = g^-1(g(a) + g(b)): sums of
*costs* c = g(membership) take the place of T, and suprema of memberships become
minima of costs.  The estimator works on costs throughout, so that a state 200
standard deviations away has the cost 20000 and not the membership 0.

============  =======================  ==================  =============================
name          T(a, b)                  cost g(membership)  shape that stays itself
============  =======================  ==================  =============================
product       a b                      -log                Gaussian
hamacher      a b / (a + b - a b)      1/membership - 1    Cauchy
lukasiewicz   max(0, a + b - 1)        1 - membership      parabola
min           min(a, b)                -log (no generator)
============  =======================  ==================  =============================

The minimum has no additive generator.  Its cost is -log as well, a mere change of
scale in which costs combine by their maximum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from fuzzykf.engine.selected import from_membership, to_membership
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice, as_flag, as_numbers, as_real, brief, check_broadcast
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.engine.selected import Scale

__all__ = [
    "BOUNDED_SUM",
    "HAMACHER",
    "LUKASIEWICZ",
    "MAX",
    "MIN",
    "PROBABILISTIC_SUM",
    "PRODUCT",
    "TConorm",
    "TNorm",
    "as_t_conorm",
    "as_t_norm",
]


def _hamacher(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b / (a + b - a b), which neither underflows nor cancels in this order."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    either = high + low * (1.0 - high)
    ratio: FloatArray = low * (high / np.where(high > 0.0, either, 1.0))
    return ratio


def _hamacher_sum(membership: FloatArray, axis: int | tuple[int, ...] | None) -> FloatArray:
    """Return s / (1 + s) with s = sum x / (1 - x), and 1 where an x is 1."""
    with np.errstate(divide="ignore", over="ignore"):
        total = np.sum(membership / (1.0 - membership), axis=axis)
    return np.where(np.isfinite(total), total, 1.0) / np.where(np.isfinite(total), 1.0 + total, 1.0)


class _Generated(NamedTuple):
    """What a generator g makes, in closed forms that are exact where sums of costs are rounded.

    Attributes
    ----------
    meet : callable
        g^-1(g(a) + g(b)).
    join : callable
        1 - g^-1(sum of g(1 - x)), along axes.
    family : str
        Name of the shape with memberships g^-1(quadratic form).
    """

    meet: Callable[[FloatArray, FloatArray], FloatArray]
    join: Callable[[FloatArray, int | tuple[int, ...] | None], FloatArray]
    family: Literal["gaussian", "cauchy", "parabolic"]


#: By the scale, which says what the generator is: norms are told apart by it, and never by their names.
_GENERATED: dict[str, _Generated] = {
    "log": _Generated(
        meet=lambda a, b: a * b,
        join=lambda x, axis: np.asarray(1.0 - np.prod(1.0 - x, axis=axis)),
        family="gaussian",
    ),
    "reciprocal": _Generated(meet=_hamacher, join=_hamacher_sum, family="cauchy"),
    "complement": _Generated(
        meet=lambda a, b: np.maximum(0.0, a + b - 1.0),
        join=lambda x, axis: np.minimum(1.0, x.sum(axis=axis)),
        family="parabolic",
    ),
}


def _floats(name: str, value: ArrayLike) -> FloatArray:
    """Return numbers as they are if they are such an array, as the grid asks at every step."""
    given: Any = value
    if isinstance(given, float):
        return np.asarray(given, dtype=np.float64)
    return given if type(given) is np.ndarray and given.dtype == np.float64 else as_numbers(name, given)


def _number(name: str, value: float) -> float:
    """Return one number as it is, as the grid asks at every step."""
    number = value if type(value) is float else as_real(name, value)
    if not -np.inf < number < np.inf:
        raise ParameterError(f"{name}: got {number}, expected a finite number")
    return number


@reprs()
@dataclass(frozen=True)
class TNorm:
    """Triangular norm (t-norm), with its additive generator if it has one.

    The instances are `PRODUCT`, `MIN`, `LUKASIEWICZ` and `HAMACHER`; functions that
    take a t-norm also take its name.  ``scale`` and ``additive`` determine the norm; ``name`` is for display
    only.

    Attributes
    ----------
    name : str
        "product", "min", "lukasiewicz" or "hamacher".
    scale : {"log", "reciprocal", "complement"}
        Scale of the costs.
    additive : bool
        Whether costs combine by their sum (by their maximum otherwise).
    family : str or None
        Name of the shape with memberships g^-1(quadratic form), which linear models
        do not leave: "gaussian", "cauchy" or "parabolic"; None if it is not to be used.

    Raises
    ------
    ParameterError
        If there is no such scale, or if the family is not that of the generator.

    Notes
    -----
    Layne and Passino (2001), equations (3)-(5); the Hamacher product is added.

    Examples
    --------
    >>> float(PRODUCT(0.5, 0.5)), float(LUKASIEWICZ(0.5, 0.75)), float(MIN(0.5, 0.75))
    (0.25, 0.25, 0.5)
    >>> float(HAMACHER(0.5, 0.5).round(4))
    0.3333
    """

    name: str
    scale: Scale
    additive: bool
    family: Literal["gaussian", "cauchy", "parabolic"] | None

    def __post_init__(self) -> None:
        """Check that the scale is known, and that the family is that of the generator."""
        given: Any = self.scale
        if not isinstance(given, str) or given not in _GENERATED:
            allowed = ", ".join(map(repr, _GENERATED))
            raise ParameterError(f"scale: got {self.scale!r}, expected one of {allowed}")
        family = _GENERATED[self.scale].family if as_flag("additive", self.additive) else None
        said: Any = self.family
        if said is not None and not (isinstance(said, str) and said == family):
            allowed = "None" if family is None else f"{family!r} or None"
            raise ParameterError(
                f"family: got {self.family!r}, expected {allowed} with scale={self.scale!r} and "
                f"additive={self.additive}"
            )

    def __call__(self, *memberships: ArrayLike) -> FloatArray:
        """Combine memberships in [0, 1], element by element with broadcasting.

        Parameters
        ----------
        *memberships : array_like
            One or more arrays of memberships.

        Returns
        -------
        ndarray
        """
        values = _memberships(self.name, memberships)
        return reduce(_GENERATED[self.scale].meet if self.additive else np.minimum, values)

    @property
    def generator(self) -> Callable[[ArrayLike], FloatArray] | None:
        """The additive generator g; None for the minimum, which has none."""
        return self.cost if self.additive else None

    def cost(self, membership: ArrayLike) -> FloatArray:
        """Return costs of memberships: 0 for 1, and infinite (Lukasiewicz: 1) for 0.

        Parameters
        ----------
        membership : array_like

        Returns
        -------
        ndarray
            Of the same shape.
        """
        with np.errstate(invalid="ignore"):
            cost = from_membership(_floats("membership", membership), self.scale)
        if np.isnan(cost).any():
            raise ParameterError(f"membership: got {brief(membership)}, expected values in [0, 1]")
        return cost + 0.0  # the logarithm of 1 is not to be -0

    def membership(self, cost: ArrayLike) -> FloatArray:
        """Return memberships of costs: the (pseudo-)inverse of `cost`.

        Parameters
        ----------
        cost : array_like

        Returns
        -------
        ndarray
            Of the same shape.
        """
        with np.errstate(over="ignore"):
            membership = to_membership(_floats("cost", cost), self.scale)
        if (membership == np.inf).any():
            raise ParameterError(f"cost: got {brief(cost)}, expected values of at least 0")
        return membership

    def cost_of_log(self, negative_log: FloatArray) -> FloatArray:
        """Return costs from minus the logarithm of memberships, without underflow.

        Parameters
        ----------
        negative_log : ndarray

        Returns
        -------
        ndarray
            Of the same shape.
        """
        negative_log = _floats("negative_log", negative_log)
        if self.scale == "log":
            return negative_log
        with np.errstate(over="ignore"):
            return np.expm1(negative_log) if self.scale == "reciprocal" else -np.expm1(-negative_log)

    @cached_property
    def combine(self) -> np.ufunc:
        """The function that combines two costs: the sum or the maximum."""
        return np.add if self.additive else np.maximum

    def renormalise(self, cost: FloatArray, best: float) -> FloatArray:
        """Return costs after division of all memberships by that of the cost ``best``.

        For Hamacher and Lukasiewicz this is the factor 1/(1 + c) and 1/(1 - c) that
        widens or narrows the spread after a measurement of surprise c.

        Parameters
        ----------
        cost : ndarray
        best : float
            Smallest cost.

        Returns
        -------
        ndarray
            Of the same shape.
        """
        cost, least = _floats("cost", cost), _number("best", best)
        if not 0.0 <= least < self.impossible:
            raise ParameterError(
                f"best: got {least:g}, expected a cost of at least 0 and below {self.impossible:g}"
            )
        if self.scale == "log":
            return cost - least
        if self.scale == "reciprocal":
            return (cost - least) / (1.0 + least)
        return (cost - least) / (1.0 - least)

    @cached_property
    def impossible(self) -> float:
        """Smallest cost with membership zero."""
        return 1.0 if self.scale == "complement" else np.inf


PRODUCT = TNorm("product", "log", True, "gaussian")
MIN = TNorm("min", "log", False, None)
LUKASIEWICZ = TNorm("lukasiewicz", "complement", True, "parabolic")
HAMACHER = TNorm("hamacher", "reciprocal", True, "cauchy")

_DUALS = {"max": MIN, "probabilistic_sum": PRODUCT, "bounded_sum": LUKASIEWICZ}


@reprs()
@dataclass(frozen=True)
class TConorm:
    """Triangular conorm (t-conorm), which joins memberships of alternatives.

    The instances are `MAX`, `PROBABILISTIC_SUM` and `BOUNDED_SUM`.  Each is the dual
    1 - T(1 - x, 1 - y, ...) of a t-norm.

    Attributes
    ----------
    name : str
        "max", "probabilistic_sum" or "bounded_sum".
    has_continuum_limit : bool
        Whether the conorm of all nodes of a grid has a limit other than 1 as the grid is refined.  Only the
        maximum has one.
    dual : TNorm
        The dual t-norm; may be omitted for the three names above.

    Raises
    ------
    ParameterError
        If ``dual`` is omitted for another name.

    Notes
    -----
    Layne and Passino (2001), equations (6)-(8); (7) and (8) are misprinted there:
    the probabilistic sum is 1 - prod(1 - x_i), the bounded sum min(1, sum x_i).

    Examples
    --------
    >>> (
    ...     float(PROBABILISTIC_SUM([0.5, 0.5])),
    ...     float(BOUNDED_SUM([0.75, 0.5])),
    ...     float(MAX([0.75, 0.5])),
    ... )
    (0.75, 1.0, 0.75)
    """

    name: str
    has_continuum_limit: bool
    dual: TNorm | None = None

    def __post_init__(self) -> None:
        """Look up the dual by the name if it is not given."""
        if self.dual is None:
            if self.name not in _DUALS:
                raise ParameterError(f"dual: got None for {self.name!r}, expected the t-norm of this conorm")
            object.__setattr__(self, "dual", _DUALS[self.name])

    def __call__(self, memberships: ArrayLike, axis: int | tuple[int, ...] | None = None) -> FloatArray:
        """Join memberships along one or several axes (by default, all).

        Parameters
        ----------
        memberships : array_like
            Memberships in [0, 1].
        axis : int or tuple of int, optional

        Returns
        -------
        ndarray
        """
        (value,) = _memberships(self.name, (memberships,))
        try:
            value.sum(axis=axis)
        except (TypeError, ValueError, OverflowError) as error:  # AxisError is the latter
            raise ParameterError(
                f"axis: got {brief(axis)}, expected axes of an array of {value.ndim} dimensions"
            ) from error
        dual = cast("TNorm", self.dual)
        if dual.additive:
            return np.asarray(_GENERATED[dual.scale].join(value, axis))
        return np.asarray(value.max(axis=axis, initial=0.0))


MAX = TConorm("max", True)
PROBABILISTIC_SUM = TConorm("probabilistic_sum", False)
BOUNDED_SUM = TConorm("bounded_sum", False)

_T_NORMS = {norm.name: norm for norm in (PRODUCT, MIN, LUKASIEWICZ, HAMACHER)}
_T_CONORMS = {norm.name: norm for norm in (MAX, PROBABILISTIC_SUM, BOUNDED_SUM)}


def as_t_norm(t_norm: str | TNorm) -> TNorm:
    """Return the t-norm of that name.

    Parameters
    ----------
    t_norm : str or TNorm
        "product", "min", "lukasiewicz" or "hamacher".

    Raises
    ------
    ParameterError
        If there is no t-norm of that name.

    Examples
    --------
    >>> as_t_norm("min").name
    'min'
    """
    if isinstance(t_norm, TNorm):
        return t_norm
    return _T_NORMS[as_choice("t_norm", t_norm, _T_NORMS)]


def as_t_conorm(t_conorm: str | TConorm, *, continuum: bool = False) -> TConorm:
    """Return the conorm of that name.

    Parameters
    ----------
    t_conorm : str or TConorm
        "max", "probabilistic_sum" or "bounded_sum".
    continuum : bool
        Whether the alternatives form a continuum.

    Raises
    ------
    ParameterError
        If there is no such conorm, or if it has no limit on a continuum.

    Examples
    --------
    >>> as_t_conorm("max", continuum=True).name
    'max'
    """
    if not isinstance(t_conorm, TConorm):
        t_conorm = _T_CONORMS[as_choice("t_conorm", t_conorm, _T_CONORMS)]
    if as_flag("continuum", continuum) and not t_conorm.has_continuum_limit:
        raise ParameterError(
            f"t_conorm: {t_conorm.name!r} has no limit on a continuum: under refinement of a grid it joins "
            "ever more alternatives and every membership tends to 1; use 'max' here, and sums only on "
            "finite universes (fuzzykf.possibility.relations)"
        )
    return t_conorm


def _memberships(name: str, values: tuple[ArrayLike, ...]) -> list[FloatArray]:
    """Return the arguments as arrays after checking that they lie in [0, 1]."""
    if not values:
        raise ParameterError(f"{name}: expected at least one membership, got none")
    arrays = [as_numbers(f"{name}: memberships", value) for value in values]
    for array in arrays:
        inside = (array >= 0.0) & (array <= 1.0)
        if not inside.all():
            worst = array[~inside].flat[0]
            raise ParameterError(f"{name}: got the membership {worst:.6g}, expected values in [0, 1]")
    check_broadcast(**{f"memberships[{k}]": array for k, array in enumerate(arrays)})
    return arrays
