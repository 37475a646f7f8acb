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
    """Turn a crisp value into a fuzzy set around it.

    Parameters
    ----------
    point : array_like, shape (d,)
    kind : {"singleton", "gaussian"}
    covariance : array_like, shape (d, d), optional
        Spread of a Gaussian.

    Raises
    ------
    ParameterError
        If the kind is unknown, or a Gaussian has no covariance (a singleton has one).

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
        Where the map takes them.
    universe : array_like, shape (m,) or (m, d)
        Elements of the universe of the images.
    nearest : bool
        Take each image for the nearest element of the universe.  On a discretised
        continuum that leaves holes (elements without a pre-image, impossible for ever)
        and loses motion slower than a cell; `FuzzyRelationEstimator` does neither.
    t_conorm : str or TConorm
        Joins the memberships of all elements with the same image.

    Returns
    -------
    ndarray, shape (m,)
        Zero where there is no pre-image.

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
    """A rule of a fuzzy model: if X, U and W are in these fuzzy sets, then X' is in this one.

    Parameters
    ----------
    antecedents : tuple of Membership
        Fuzzy sets of the state, the input (if there is one) and the disturbance.
    consequent : Membership
        Fuzzy set of the next state.

    Notes
    -----
    Layne and Passino (2001), equations (14)-(17) and (21).
    """

    antecedents: tuple[Membership, ...]
    consequent: Membership

    def relation(self, universes: Sequence[ArrayLike], t_norm: str | TNorm = "product") -> FloatArray:
        """Cartesian product of the fuzzy sets of the rule on finite universes.

        Parameters
        ----------
        universes : sequence of array_like
            One for each antecedent, then that of the next state.
        t_norm : str or TNorm

        Raises
        ------
        ShapeError
            If there are more or fewer universes than fuzzy sets.
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
    """A fuzzy dynamic model as the union of rules.

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
        """Make one rule for each combination of elements: state, input, disturbance.

        Parameters
        ----------
        f : callable
            f(x, w) or f(x, u, w) of single elements.
        *elements : array_like, shapes (n,) or (n, d)
            Elements around which the rules are placed, for each argument of f.
        antecedent, consequent : callable
            Fuzzify an element, and what f makes of it; `fuzzify` by default.
        t_norm, t_conorm : str or TNorm, TConorm
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
        """Union of the relations of all rules on finite universes.

        Parameters
        ----------
        universes : sequence of array_like
            Of the state, the input (if there is one), the disturbance, the next state.

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
        """Memberships of the next state: the composition of the product of the sets with the relation.

        Parameters
        ----------
        sets : sequence of array_like
            Memberships of the elements of all universes but the last.
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
