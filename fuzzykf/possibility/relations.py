"""Fuzzy sets and relations on finite universes: rules, composition, the extension principle.

A fuzzy dynamic model x' = f(x, u, w) can be built in two ways (Layne and Passino,
section 2.1).  A *rule base* is the union of the relations of rules "if X is X_i and W is
W_i then X' is X'_i", and predicts by composition.  The *extension principle* carries the
memberships along f itself.  With singleton fuzzification of all elements the two agree;
`FuzzyRelationEstimator` does the second, on a continuum.

Universes are arrays of elements: (n,) numbers or (n, d) vectors.  Fuzzy sets are arrays
of memberships (n,), relations arrays with one axis per universe.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.possibility.memberships import GaussianMembership, Membership, SingletonMembership
from fuzzykf.possibility.norms import TConorm, TNorm, as_t_conorm, as_t_norm
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = [
    "Rule",
    "RuleBase",
    "cartesian_product",
    "compose",
    "extend",
    "fuzzify",
    "intersection",
    "union",
]


def as_sequence(name: str, value: Any) -> list[Any]:
    """Return the elements of a sequence as a list."""
    try:
        return list(value)
    except TypeError as error:
        raise ShapeError(f"{name}: got {brief(value)}, expected a sequence of arrays") from error


def fuzzify(
    point: ArrayLike,
    kind: Literal["singleton", "gaussian"] = "singleton",
    covariance: ArrayLike | None = None,
) -> Membership:
    """Return a fuzzy set around a crisp value.

    Parameters
    ----------
    point : array_like, shape (d,)
    kind : {"singleton", "gaussian"}
    covariance : array_like, shape (d, d), optional
        Spread; for "gaussian" only.

    Returns
    -------
    Membership

    Raises
    ------
    ParameterError
        If the kind is unknown, or ``covariance`` is missing for "gaussian" or given for "singleton".

    Notes
    -----
    Layne and Passino (2001), equations (19) and (20); the sign in (20) is misprinted.

    Examples
    --------
    >>> fuzzify(1.0)(1.0), round(fuzzify(0.0, "gaussian", 1.0)(1.0), 4)
    (1.0, 0.6065)
    """
    given: Any = kind
    named = isinstance(given, str)
    if named and kind == "singleton" and covariance is None:
        return SingletonMembership(point)
    if named and kind == "gaussian" and covariance is not None:
        return GaussianMembership(point, covariance)
    raise ParameterError(
        f"kind, covariance: got {brief(kind)} with covariance {brief(covariance)}, expected 'singleton' "
        "without one or 'gaussian' with one"
    )


def union(*sets: ArrayLike, t_conorm: str | TConorm = "max") -> FloatArray:
    """Union of fuzzy sets or relations on the same universe.

    Notes
    -----
    Layne and Passino (2001), equation (9).

    Examples
    --------
    >>> union([0.0, 0.5], [0.2, 0.1])
    array([0.2, 0.5])
    """
    return as_t_conorm(t_conorm)(np.stack([as_numbers("sets", s) for s in sets]), axis=0)


def intersection(*sets: ArrayLike, t_norm: str | TNorm = "min") -> FloatArray:
    """Intersection of fuzzy sets or relations on the same universe.

    Notes
    -----
    Layne and Passino (2001), equation (10).

    Examples
    --------
    >>> intersection([0.0, 0.5], [0.2, 0.1])
    array([0. , 0.1])
    """
    return as_t_norm(t_norm)(*sets)


def cartesian_product(*sets: ArrayLike, t_norm: str | TNorm = "product") -> FloatArray:
    """Cartesian product of fuzzy sets: a relation with the axes of all of them.

    Notes
    -----
    Layne and Passino (2001), equation (11).

    Examples
    --------
    >>> cartesian_product([1.0, 0.5], [1.0, 0.2, 0.0])
    array([[1. , 0.2, 0. ],
           [0.5, 0.1, 0. ]])
    """
    norm = as_t_norm(t_norm)
    arrays = [as_numbers("sets", s) for s in sets]
    return reduce(lambda a, b: norm(a.reshape(a.shape + (1,) * b.ndim), b), arrays)


def compose(
    fuzzy_set: ArrayLike,
    relation: ArrayLike,
    *,
    t_norm: str | TNorm = "product",
    t_conorm: str | TConorm = "max",
) -> FloatArray:
    """Sup-T composition of a fuzzy set (or relation) with a relation.

    Parameters
    ----------
    fuzzy_set : array_like, shape (n_1, ..., n_r)
    relation : array_like, shape (n_1, ..., n_r, m_1, ...)
    t_norm, t_conorm : str or TNorm, TConorm

    Returns
    -------
    ndarray, shape (m_1, ...)

    Raises
    ------
    ShapeError
        If the leading axes of the relation are not those of the set.

    Notes
    -----
    Layne and Passino (2001), equation (12).

    Examples
    --------
    >>> compose([1.0, 0.5], [[0.2, 0.9], [1.0, 0.1]])
    array([0.5, 0.9])
    """
    left, right = as_numbers("fuzzy_set", fuzzy_set), as_numbers("relation", relation)
    if right.ndim <= left.ndim or right.shape[: left.ndim] != left.shape:
        raise ShapeError(
            f"relation: got shape {right.shape}, expected ({', '.join(map(str, left.shape))}, ...) "
            "with further axes"
        )
    joint = as_t_norm(t_norm)(left.reshape(left.shape + (1,) * (right.ndim - left.ndim)), right)
    return as_t_conorm(t_conorm)(joint, axis=tuple(range(left.ndim)))


def extend(
    fuzzy_set: ArrayLike,
    images: ArrayLike,
    universe: ArrayLike,
    *,
    nearest: bool = False,
    t_conorm: str | TConorm = "max",
) -> FloatArray:
    """Extension principle on finite universes: carry a fuzzy set along a map.

    Parameters
    ----------
    fuzzy_set : array_like, shape (n_1, ..., n_r)
        Memberships of the elements, or of tuples of elements.
    images : array_like, shape (n_1, ..., n_r) or (n_1, ..., n_r, d)
        Images of the elements under the map.
    universe : array_like, shape (m,) or (m, d)
        Elements of the universe of the images.
    nearest : bool
        Round each image to the nearest element of the universe.  On a discretised continuum, this leaves
        elements without a pre-image, and loses motion slower than a cell; `FuzzyRelationEstimator` avoids
        both.
    t_conorm : str or TConorm
        T-conorm that joins memberships of elements with the same image.

    Returns
    -------
    ndarray, shape (m,)
        Memberships of the images; zero where there is no pre-image.

    Raises
    ------
    ParameterError
        If an image with a positive membership is not in the universe.

    Notes
    -----
    Layne and Passino (2001), equation (13).

    Examples
    --------
    >>> extend([0.5, 1.0, 0.25], [1.0, 0.0, 1.0], [0.0, 1.0, 2.0])
    array([1. , 0.5, 0. ])
    """
    values = as_numbers("fuzzy_set", fuzzy_set).ravel()
    elements = as_numbers("universe", universe)
    if elements.ndim == 0 or elements.size == 0:
        raise ShapeError(f"universe: got shape {elements.shape}, expected (m,) or (m, d)")
    elements = elements.reshape(elements.shape[0], -1)
    points = as_numbers("images", images)
    if points.size != values.size * elements.shape[1]:
        raise ShapeError(
            f"images: got shape {points.shape}, expected one element of dimension {elements.shape[1]} "
            f"for each of {values.size} memberships"
        )
    points = points.reshape(values.size, elements.shape[1])
    conorm, result = as_t_conorm(t_conorm), np.zeros(elements.shape[0])
    distance = np.abs(points[:, None] - elements).max(axis=2)
    found = distance.argmin(axis=1)
    size = np.abs(points).max(axis=1) + np.abs(elements[found]).max(axis=1)
    missing = (distance.min(axis=1) > 1e-9 * size) & (values > 0.0)
    if missing.any() and not nearest:
        k = int(np.argmax(missing))
        raise ParameterError(
            f"images: {points[k].tolist()} has membership {values[k]:.6g} but is not in the universe; "
            "nearest=True takes it for the nearest element"
        )
    for m in np.unique(found):
        result[m] = conorm(values[found == m])
    return result


@reprs()
@dataclass(frozen=True)
class Rule:
    """Rule of a fuzzy model: if X, U and W are in given fuzzy sets, then X' is in another.

    Parameters
    ----------
    antecedents : tuple of Membership
        Fuzzy sets of the state, the input (if there is one) and the disturbance.
    consequent : Membership
        Fuzzy set of the next state.

    Notes
    -----
    Layne and Passino (2001), equations (14)-(17) and (21).

    Examples
    --------
    >>> from fuzzykf import TriangularMembership
    >>> from fuzzykf.possibility import Rule
    >>> near, far = (
    ...     TriangularMembership(-1.0, 0.0, 1.0),
    ...     TriangularMembership(0.0, 1.0, 2.0),
    ... )
    >>> Rule((near, near), far).relation([[0.0], [0.0], [0.5, 1.0]]).ravel()
    array([0.5, 1. ])
    """

    antecedents: tuple[Membership, ...]
    consequent: Membership

    def relation(self, universes: Sequence[ArrayLike], t_norm: str | TNorm = "product") -> FloatArray:
        """Return the Cartesian product of the fuzzy sets on finite universes.

        Parameters
        ----------
        universes : sequence of array_like
            One for each antecedent, then that of the next state.
        t_norm : str or TNorm

        Returns
        -------
        ndarray

        Raises
        ------
        ShapeError
            If the number of universes differs from that of the fuzzy sets.
        """
        sets = (*self.antecedents, self.consequent)
        given = as_sequence("universes", universes)
        if len(given) != len(sets):
            raise ShapeError(f"universes: got {len(given)}, expected {len(sets)}")
        values = [np.atleast_1d(m(u)) for m, u in zip(sets, given, strict=True)]
        return cartesian_product(*values, t_norm=t_norm)


@reprs()
@dataclass(frozen=True)
class RuleBase:
    """Fuzzy dynamic model: the union of rules.

    Parameters
    ----------
    rules : tuple of Rule
    t_norm, t_conorm : str or TNorm, TConorm

    Notes
    -----
    Layne and Passino (2001), equations (21)-(23).

    Examples
    --------
    The random walk x' = x + w on whole numbers, in the two ways:

    >>> import numpy as np
    >>> x, w, x_next = np.arange(-2.0, 3.0), np.arange(-1.0, 2.0), np.arange(-3.0, 4.0)
    >>> base = RuleBase.from_function(lambda x, w: x + w, x, w)
    >>> state, noise = np.array([0.0, 0.5, 1.0, 0.5, 0.0]), np.array([0.4, 1.0, 0.4])
    >>> base.predict([state, noise], [x, w, x_next])
    array([0. , 0.2, 0.5, 1. , 0.5, 0.2, 0. ])
    >>> extend(cartesian_product(state, noise), x[:, None] + w, x_next)
    array([0. , 0.2, 0.5, 1. , 0.5, 0.2, 0. ])
    """

    rules: tuple[Rule, ...]
    t_norm: str | TNorm = "product"
    t_conorm: str | TConorm = "max"

    @classmethod
    def from_function(
        cls,
        f: Callable[..., ArrayLike],
        *elements: ArrayLike,
        antecedent: Callable[[FloatArray], Membership] = fuzzify,
        consequent: Callable[[FloatArray], Membership] = fuzzify,
        t_norm: str | TNorm = "product",
        t_conorm: str | TConorm = "max",
    ) -> RuleBase:
        """Create one rule for each combination of state, input and disturbance.

        Parameters
        ----------
        f : callable
            f(x, w) or f(x, u, w) of single elements.
        *elements : array_like, shapes (n,) or (n, d)
            Elements around which the rules are placed, for each argument of f.
        antecedent, consequent : callable
            Fuzzify an element and its image; by default `fuzzify`.
        t_norm, t_conorm : str or TNorm, TConorm

        Returns
        -------
        RuleBase
        """
        universes = [as_numbers("elements", e) for e in elements]
        rules = tuple(
            Rule(
                tuple(antecedent(value) for value in values),
                consequent(np.asarray(f(*values), dtype=np.float64)),
            )
            for values in product(*universes)
        )
        return cls(rules, t_norm, t_conorm)

    def relation(self, universes: Sequence[ArrayLike]) -> FloatArray:
        """Return the union of the relations of all rules on finite universes.

        Parameters
        ----------
        universes : sequence of array_like
            Of the state, the input (if there is one), the disturbance, the next state.

        Returns
        -------
        ndarray

        Raises
        ------
        ParameterError
            If there are no rules.
        """
        if not self.rules:
            raise ParameterError("rules: got none, expected at least one")
        relations = (rule.relation(universes, self.t_norm) for rule in self.rules)
        return reduce(lambda a, b: union(a, b, t_conorm=self.t_conorm), relations)

    def predict(self, sets: Sequence[ArrayLike], universes: Sequence[ArrayLike]) -> FloatArray:
        """Return the memberships of the next state.

        Parameters
        ----------
        sets : sequence of array_like
            Memberships on all universes but the last.
        universes : sequence of array_like
            As for `relation`.

        Returns
        -------
        ndarray, shape (m,)
        """
        if not as_sequence("sets", sets):
            raise ShapeError("sets: got none, expected the memberships of each universe but the last")
        joint = cartesian_product(*sets, t_norm=self.t_norm)
        return compose(joint, self.relation(universes), t_norm=self.t_norm, t_conorm=self.t_conorm)
