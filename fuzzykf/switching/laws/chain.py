"""A Markov chain of the switch on finitely many nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_count, as_numbers, check_generator
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "SwitchChain",
    "balance",
    "closed_classes",
    "hardened",
    "rank",
    "shares_of",
    "starts_stationary",
    "stationary_back",
    "stationary_distribution",
    "value_of",
]

#: Rows of probabilities have to sum to one within this.
SUM_TOLERANCE = 1e-9

#: How far probabilities may be from stationary ones by rounding.
STATIONARY = 1e-9

#: Values of the switch that are nearer than this are one value.
SAME_VALUE = 1e-12

#: Longest series that can be drawn: its random numbers alone take 16 gigabytes.
MOST_DRAWS = 10**9


@reprs()
@dataclass(frozen=True, eq=False)
class SwitchChain:
    """A stationary Markov chain on the nodes of a switch.

    Filters are exact for such a chain; the approximation of a fuzzy law is in its discretisation.

    Parameters
    ----------
    nodes : array_like, shape (M,) or (M, K)
        Values of the switch at the nodes: numbers, or class weights for more than two classes.  Several nodes
        may share a value, like the two directions of a fade.
    weights : array_like, shape (M,)
        Measure of each node: 1 for a hard regime (an atom), the quadrature weight in between.  Density is
        mass divided by weight.
    initial : array_like, shape (M,)
        Probability of each node at the first observation.
    transition : array_like, shape (M, M)
        ``transition[i, j]`` is the probability of node j after node i; rows sum to one.  Product integration
        may give small negative entries.
    class_weights : array_like, shape (M, K), optional
        Class weights of the nodes; rows sum to one.  By default (1 - r, r) for numbers r, or the nodes
        themselves.

    Raises
    ------
    ShapeError, ParameterError
        If shapes do not agree or probabilities do not sum to one.

    Examples
    --------
    >>> chain = SwitchChain([0.0, 1.0], [1.0, 1.0], [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]])
    >>> len(chain)
    2
    """

    nodes: FloatArray
    weights: FloatArray
    initial: FloatArray
    transition: FloatArray
    class_weights: FloatArray
    # by which engines name values (M,): these themselves, or numbers of nodes; they follow from the nodes
    keys: FloatArray = field(repr=False)

    def __init__(
        self,
        nodes: ArrayLike,
        weights: ArrayLike,
        initial: ArrayLike,
        transition: ArrayLike,
        class_weights: ArrayLike | None = None,
    ) -> None:
        two = as_numbers("nodes", nodes).ndim == 2
        values = as_array("nodes", nodes, (None, None) if two else (None,))
        M = len(values)
        if M == 0:
            raise ShapeError("nodes: got none, expected at least one")
        table = as_array("transition", transition, (M, M))
        measure = as_array("weights", weights, (M,))
        if (measure <= 0.0).any():
            raise ParameterError(f"weights: got {measure.min():.6g}, expected positive numbers")
        start = as_array("initial", initial, (M,))
        check_probabilities("initial", start)
        excess = np.abs(table.sum(axis=1) - 1.0)
        if (excess > SUM_TOLERANCE).any():
            row = int(np.argmax(excess))
            raise ParameterError(f"transition: row {row} sums to {table[row].sum():.9g}, expected 1")
        if class_weights is None and values.ndim == 2:
            class_weights = values
        if class_weights is None:
            if (values < 0.0).any() or (values > 1.0).any():
                raise ParameterError("nodes: expected values in [0, 1] where no class_weights are given")
            shares = np.stack([1.0 - values, values], axis=1)
        else:
            shares = as_array("class_weights", class_weights, (M, None))
            for k, row_shares in enumerate(shares):
                check_probabilities(f"class_weights[{k}]", row_shares)
        for name, array in (
            ("nodes", values),
            ("weights", measure),
            ("initial", start),
            ("transition", table),
            ("class_weights", shares),
            ("keys", values if values.ndim == 1 else np.arange(M, dtype=np.float64)),
        ):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def from_classes(cls, transition: ArrayLike, initial: ArrayLike | None = None) -> SwitchChain:
        """Create the chain of K hard regimes 0, 1, ..., K - 1.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i.
        initial : array_like, shape (K,), optional
            By default the stationary distribution.

        Returns
        -------
        SwitchChain

        Raises
        ------
        ShapeError, ParameterError
            If ``transition`` is empty, not square, or not row-stochastic.
        """
        table = as_array("transition", transition, (None, None))
        if table.shape[0] == 0 or table.shape[0] != table.shape[1]:
            raise ShapeError(f"transition: got shape {table.shape}, expected (K, K) with K of at least 1")
        for row, probabilities in enumerate(table):
            check_probabilities(f"transition[{row}]", probabilities)
        K = table.shape[0]
        start = stationary_distribution(table) if initial is None else as_array("initial", initial, (K,))
        return cls(np.arange(K, dtype=np.float64), np.ones(K), start, table, np.eye(K))

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.nodes)

    @property
    def n_classes(self) -> int:
        """Number K of hard regimes."""
        return int(self.class_weights.shape[1])

    def values(self, keys: FloatArray) -> FloatArray:
        """Return the values of the switch for keys, as the engine returns them.

        Parameters
        ----------
        keys : ndarray
            Values for two classes, else indices of nodes.

        Returns
        -------
        ndarray, shape (...) or (..., K)
        """
        return keys if self.nodes.ndim == 1 else self.nodes[keys.astype(np.intp)]

    def describe(self, k: int) -> str:
        """Return the value of the switch at a node as text.

        Parameters
        ----------
        k : int
            Index of the node.

        Returns
        -------
        str
        """
        return f"{self.nodes[k]:.6g}" if self.nodes.ndim == 1 else value_of(self.nodes[k])

    @cached_property
    def atoms(self) -> BoolArray:
        """Which nodes are hard regimes, as a boolean array of shape (M,)."""
        hard: BoolArray = np.isclose(self.class_weights.max(axis=1), 1.0, rtol=0.0, atol=1e-15)
        return hard

    @cached_property
    def ranking(self) -> IntArray:
        """Order in which nodes are searched for the most likely value of the switch, (2, M)."""
        found = rank(self.nodes, np.where(self.atoms[:, None], False, self.class_weights > 0.0))
        found.flags.writeable = False
        return found

    def by_value(self, mu: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Sum probabilities over the nodes that share a value.

        Parameters
        ----------
        mu : array_like, shape (..., M)
            Probabilities of the nodes.

        Returns
        -------
        values : ndarray, shape (V,) or (V, K)
            Distinct values: numbers increasing, class weights in the order of the nodes.
        masses : ndarray, shape (..., V)
            Their probabilities.

        Examples
        --------
        >>> from fuzzykf import FadeLaw
        >>> chain = FadeLaw.between(40, 10).discretize(2)
        >>> values, masses = chain.by_value(chain.initial)
        >>> values, masses.round(3)
        (array([0.  , 0.25, 0.75, 1.  ]), array([0.4, 0.1, 0.1, 0.4]))
        """
        p = as_numbers("mu", mu)
        if p.ndim == 0 or p.shape[-1] != len(self):
            raise ShapeError(f"mu: got shape {p.shape}, expected (..., {len(self)})")
        first = _first_of_equals(np.round(self.nodes.reshape(len(self), -1) / SAME_VALUE))
        kept = np.unique(first)
        if self.nodes.ndim == 1:
            kept = kept[np.argsort(self.nodes[kept], kind="stable")]
        masses: FloatArray = p @ (first[:, None] == kept).astype(np.float64)
        return self.nodes[kept], masses

    @cached_property
    def reachable(self) -> BoolArray:
        """Which nodes can be reached, as a boolean array of shape (M,)."""
        there = self.initial > 0.0
        while True:
            more = there | (self.transition[there] != 0.0).any(axis=0)
            if (more == there).all():
                return there
            there = more

    @cached_property
    def is_signed(self) -> bool:
        """Whether some entries of the transition matrix are negative."""
        return bool((self.transition < 0.0).any())

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw ``n`` consecutive values of the switch.

        Parameters
        ----------
        n : int
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape (n,)
            Values of the switch.
        """
        check_generator(rng)
        n = as_count("n", n, most=MOST_DRAWS)
        uniforms = rng.random(n)
        cumulative = np.cumsum(self.transition, axis=1)
        below = np.cumsum(self.initial)
        path = np.empty(n, dtype=np.intp)
        for k in range(n):
            # the last sum may miss 1 by rounding
            path[k] = min(int(np.searchsorted(below, uniforms[k] * below[-1], side="right")), len(self) - 1)
            below = cumulative[path[k]]
        values: FloatArray = self.nodes[path]
        return values

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


def value_of(weights: FloatArray) -> str:
    """Return a value of the switch, given by its class weights, as a message shows it."""
    return f"{weights[1]:.6g}" if len(weights) == 2 else f"({', '.join(f'{u:.6g}' for u in weights)})"


def shares_of(r: FloatArray, n_classes: int) -> FloatArray:
    """Return class weights (..., K) of a switch between K > 2 classes.

    Parameters
    ----------
    r : ndarray, shape (..., K), or (n,) or ()
        Class weights, or numbers of classes.
    n_classes : int

    Raises
    ------
    ShapeError, ParameterError
        If they are neither.

    Examples
    --------
    >>> import numpy as np
    >>> shares_of(np.array([2.0, 0.0]), 3)
    array([[0., 0., 1.],
           [1., 0., 0.]])
    """
    if r.ndim < 2:
        if not ((r == np.floor(r)) & (r >= 0) & (r < n_classes)).all():
            wrong = r[~((r == np.floor(r)) & (r >= 0) & (r < n_classes))].flat[0]
            raise ParameterError(
                f"r: got {wrong:.6g}, expected regimes 0 to {n_classes - 1}, or class weights of shape (n, K)"
            )
        return np.eye(n_classes)[r.astype(np.intp)]
    if r.shape[-1] != n_classes:
        raise ShapeError(f"r: got shape {r.shape}, expected class weights (n, {n_classes}) or regimes (n,)")
    off = ~((r >= 0.0).all(axis=-1) & (np.abs(r.sum(axis=-1) - 1.0) <= SUM_TOLERANCE))
    if off.any():
        first = value_of(r[off][0])
        raise ParameterError(f"r: got the class weights {first}, expected some of at least 0 that sum to 1")
    return r


def check_probabilities(name: str, p: FloatArray) -> None:
    """Raise a ParameterError unless the vector ``p`` is a probability distribution."""
    if (p < 0.0).any() or (p > 1.0 + SUM_TOLERANCE).any():
        worst = p[np.argmax(np.abs(p - 0.5))]
        raise ParameterError(f"{name}: got {worst:.6g}, expected probabilities in [0, 1]")
    if abs(p.sum() - 1.0) > SUM_TOLERANCE:
        raise ParameterError(f"{name}: sums to {p.sum():.9g}, expected 1")


def rank(nodes: FloatArray, between: BoolArray) -> IntArray:
    """Put nodes in the order in which the most likely value of the switch is looked for.

    The values come in strata: those between the same classes, and last all hard ones.  The rule
    takes the stratum of largest mass, in it the value of largest density or mass.

    Parameters
    ----------
    nodes : ndarray, shape (M,) or (M, K)
        Values of the switch; nodes of one value add up.
    between : ndarray of bool, shape (M, K)
        Between which classes each lies; none for a hard value.

    Returns
    -------
    ndarray of int, shape (2, M)
        Numbers of the nodes, and for each 1 if it is the last of its value, 2 if it is the last of its
        stratum as well, else 0.  The first of equals counts: so values come as they stand, hard ones
        backwards.

    Examples
    --------
    >>> import numpy as np
    >>> r = np.array([0.0, 1.0, 0.25, 0.75, 0.25, 0.75])  # the two directions of a fade
    >>> rank(r, np.stack([(r > 0) & (r < 1)] * 2, axis=1))
    array([[2, 4, 3, 5, 1, 0],
           [0, 1, 0, 2, 1, 2]])
    """
    values = np.round(nodes.reshape(len(nodes), -1) / SAME_VALUE)
    value, stratum = _first_of_equals(values), _first_of_equals(between)
    hard = ~between.any(axis=1)
    order = np.lexsort(
        (np.arange(len(nodes)), np.where(hard, -value, value), np.where(hard, len(nodes), stratum))
    )
    ends = np.ones(len(nodes), dtype=np.intp)
    next_value, next_stratum = (np.append(a[order][1:] != a[order][:-1], True) for a in (value, stratum))
    ends[~(next_value | next_stratum)] = 0
    ends[next_stratum] = 2
    return np.stack([order.astype(np.intp), ends])


def _first_of_equals(rows: np.ndarray) -> IntArray:
    """Return for each row the number of the first that is equal to it."""
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    numbers: IntArray = first[which.reshape(-1)]
    return numbers


def hardened(chain: SwitchChain) -> FloatArray:
    """Return the joint probabilities (K, K) of the classes that two consecutive nodes are nearest to.

    What lies in the middle between classes is shared out among them.
    """
    u = chain.class_weights
    nearest = np.isclose(u, u.max(axis=1, keepdims=True), rtol=0.0, atol=SAME_VALUE)
    shares = nearest / nearest.sum(axis=1, keepdims=True)
    joint: FloatArray = shares.T @ (chain.initial[:, None] * chain.transition) @ shares
    return joint


def closed_classes(arrows: BoolArray) -> list[list[int]]:
    """Return the sets of states of a chain that lead to one another, and nowhere else.

    Parameters
    ----------
    arrows : ndarray of bool, shape (K, K)
        Whether a state leads to another in one step.

    Examples
    --------
    >>> import numpy as np
    >>> closed_classes(
    ...     np.array([[False, True, False], [True, False, False], [True, False, True]])
    ... )
    [[0, 1]]
    """
    K = len(arrows)
    there = arrows | np.eye(K, dtype=bool)
    for _ in range(K.bit_length()):  # paths of twice the length
        there = there.astype(np.float64) @ there > 0.0
    closed = (there <= there.T).all(axis=1)  # whatever it leads to leads back
    firsts = dict.fromkeys(int(there[k].argmax()) for k in np.flatnonzero(closed))
    return [np.flatnonzero(there[k]).tolist() for k in firsts]


def stationary_distribution(transition: FloatArray) -> FloatArray:
    """Stationary distribution of a row-stochastic matrix.

    Raises
    ------
    ParameterError
        If the chain falls into several closed parts, so that the distribution is not
        unique and an initial one has to be given.

    Examples
    --------
    >>> import numpy as np
    >>> stationary_distribution(np.array([[0.9, 0.1], [0.3, 0.7]])).round(3)
    array([0.75, 0.25])
    """
    K = transition.shape[0]
    system = np.vstack([transition.T - np.eye(K), np.ones(K)])
    if np.linalg.matrix_rank(system[:-1]) < K - 1:
        raise ParameterError(
            "initial: has to be given, since the transition matrix has several closed classes and no "
            "unique stationary distribution"
        )
    solution = np.linalg.lstsq(system, np.append(np.zeros(K), 1.0), rcond=None)[0]
    positive = np.where(solution > 1e-14, solution, 0.0)
    distribution: FloatArray = positive / positive.sum()
    return distribution


def stationary_back(p: FloatArray, transition: FloatArray, by_p: FloatArray) -> FloatArray:
    """Return the gradient by the transition matrix of what has one by its stationary distribution.

    From p = p T and p 1 = 1, with Z = (I - T + 1 p)^-1: dp = p dT Z.

    Parameters
    ----------
    p : ndarray, shape (K,)
    transition : ndarray, shape (K, K)
    by_p : ndarray, shape (K,)

    Returns
    -------
    ndarray, shape (K, K)

    Examples
    --------
    >>> import numpy as np
    >>> T = np.array([[0.9, 0.1], [0.3, 0.7]])  # p = (.3, .1) / .4
    >>> gradient = stationary_back(stationary_distribution(T), T, np.array([1.0, 0.0]))
    >>> round(float(gradient[0, 1] - gradient[0, 0]), 9)  # -.3 / .4^2
    -1.875
    """
    gradient: FloatArray = p[:, None] * np.linalg.solve(np.eye(len(p)) - transition + p, by_p)
    return gradient


def starts_stationary(chain: SwitchChain) -> bool:
    """Whether a chain begins in its stationary law, to rounding."""
    p = chain.initial
    return bool(np.abs(p @ chain.transition - p).max() <= STATIONARY)


def balance(arrows: FloatArray) -> FloatArray:
    """Stationary distribution of a chain from the probabilities of its moves alone, to the last digits.

    The elimination of Grassmann, Taksar and Heyman subtracts nothing, so that rates of 1e-12 beside others
    are no less exact.

    Parameters
    ----------
    arrows : ndarray, shape (K, K)
        Probabilities of leaving the row for the column; the diagonal is not looked at.  They have one
        closed class, see `closed_classes`; what leads there has no mass.

    Examples
    --------
    >>> import numpy as np
    >>> balance(np.array([[0.0, 1e-12], [3e-12, 0.0]]))
    array([0.75, 0.25])
    """
    (closed,) = closed_classes(arrows > 0.0)
    rates = arrows[np.ix_(closed, closed)].copy()
    for k in range(len(closed) - 1, 0, -1):
        rates[:k, k] /= rates[k, :k].sum()
        rates[:k, :k] += rates[:k, k, None] * rates[k, :k]
    masses = np.ones(len(closed))
    for k in range(1, len(closed)):
        masses[k] = masses[:k] @ rates[:k, k]
        masses[: k + 1] /= masses[: k + 1].sum()
    distribution = np.zeros(len(arrows))
    distribution[closed] = masses
    return distribution
