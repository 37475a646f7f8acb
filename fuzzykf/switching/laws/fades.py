"""Fades: a switch that goes from class to class gradually, and in a direction.

A law on the values of the switch alone remembers where it is, not which way it moves; a fade does.
So the law is one of a Markov chain on classes and on the cells of directed fades, and exact filters
stay exact.  A directed fade a -> b has F cells, at the class weights (1 - t) e_a + t e_b with
t = (k - 1/2)/F, k = 1, ..., F.  A step leads

    from class a to the first cell of (a, b)       with the rate of the fade,
    from class a to class b at once                with the probability of that jump,
    from cell k to cell k + 1, from the last to b  with F / length,
    from a cell to the same place of (b, a)        with turn_back,

and otherwise nowhere.
"""

from __future__ import annotations

from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count, as_real, brief
from fuzzykf.immutable import cached_property
from fuzzykf.reprs import shown, value_text
from fuzzykf.switching.laws.base import NODES
from fuzzykf.switching.laws.chain import SwitchChain, balance, closed_classes
from fuzzykf.switching.laws.edges import (
    MOST_CLASSES,
    GraphicLaw,
    Link,
    as_edge,
    as_probability,
    check_cells,
    class_weights,
    entries,
)
from fuzzykf.switching.laws.fade_events import FadeEvents, count_events
from fuzzykf.switching.laws.fade_learner import FadeChain
from fuzzykf.switching.laws.fade_numbers import FadeNumbers
from fuzzykf.texts import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["FadeLaw", "FadeLength"]

#: What probabilities and numbers of cells may miss by rounding.
ROUNDING = 1e-12


class FadeLength(NamedTuple):
    """How many steps a fade lasts, until it has come to a class: its own end, or where it began."""

    mean: float
    std: float


class FadeLaw(GraphicLaw):
    """Law of a switch that fades or jumps from class to class.

    Parameters
    ----------
    n_classes : int
        Number K of classes (hard regimes).
    fades : mapping of (int, int) to (float, float)
        ``{(a, b): (rate, mean_length)}`` for a fade from class a to class b: the probability per step at a
        that it begins, and its mean number of steps, at least 1.  A fade with rate 0 is only entered by
        turning back.
    jumps : mapping of (int, int) to float, optional
        ``{(a, b): p}``: the probability per step at a of a jump from a to b.
    turn_back : float
        Probability per step in a fade of turning back, into the opposite fade at the same place.

    Raises
    ------
    ParameterError
        If the probability of leaving a class exceeds 1, a fade has no opposite fade although
        ``turn_back`` is positive, or the stationary law is not unique.

    Notes
    -----
    The number F of cells of each fade determines the chain.  For ``turn_back = 0``, the mean length of a
    fade does not depend on F; its standard deviation is sqrt(F (1 - F / mean_length)) mean_length / F, which
    is zero for F = ``mean_length``.  F cannot exceed the length, or floor(length (1 - turn_back)) if fades
    turn back.  By default, F is 5, or less if the shortest fade has no room for 5 cells; filters use 5.

    Transient classes have probability zero in the stationary law.

    Examples
    --------
    >>> law = FadeLaw(2, {(0, 1): (0.025, 10), (1, 0): (0.025, 10)})
    >>> round(law.p_hard, 6)
    0.8
    >>> law.discretize(5).transition.shape
    (12, 12)
    >>> law.fade_lengths(5)[0, 1]
    FadeLength(mean=10.0, std=3.1622776601683795)
    """

    kind = "fade"
    learned = True

    def __init__(
        self,
        n_classes: int,
        fades: Mapping[tuple[int, int], tuple[float, float]],
        *,
        jumps: Mapping[tuple[int, int], float] | None = None,
        turn_back: float = 0.0,
    ) -> None:
        K = as_count("n_classes", n_classes, 2, MOST_CLASSES)
        if isinstance(fades, Real):
            raise ParameterError(
                f"fades: got {brief(fades)}, expected a mapping {{(a, b): (rate, mean_length)}}, with the "
                "rate 1 / dwell; FadeLaw.between(dwell, length) makes the symmetric law of two classes"
            )
        self.n_classes = K
        self._fades = tuple(
            (as_edge("fades", pair, K), _rate_and_length(pair, value))
            for pair, value in entries("fades", fades, "{(a, b): (rate, mean_length)}")
        )
        self._jumps = tuple(
            (as_edge("jumps", pair, K), as_probability(f"jumps[{pair}]", value))
            for pair, value in entries("jumps", {} if jumps is None else jumps, "{(a, b): probability}")
        )
        self.turn_back = as_probability("turn_back", turn_back)
        self._check_classes()
        self._check_turns()

    def _check_classes(self) -> None:
        arrows = self._arrows()
        left = arrows.sum(axis=1)
        if (left > 1.0 + ROUNDING).any():
            a = int(left.argmax())
            rates = sum(rate for (start, _), (rate, _) in self._fades if start == a)
            raise ParameterError(
                f"fades, jumps: got rates that sum to {rates:.6g} and jumps that sum to "
                f"{left[a] - rates:.6g} from class {a}, together {left[a]:.6g}; expected at most 1"
            )
        closed = closed_classes(arrows > 0.0)
        if len(closed) > 1:
            parts = " and ".join(map(str, closed))
            raise ParameterError(
                f"fades, jumps: got several parts that are never left, the classes {parts}; expected ways "
                "between the classes that leave one such part, so that the stationary law is unique"
            )

    def _check_turns(self) -> None:
        pairs = [pair for pair, _ in self._fades]
        if self.turn_back > 0.0:
            for a, b in pairs:
                if (b, a) not in pairs:
                    raise ParameterError(
                        f"turn_back: got {self.turn_back:.6g}, but the fade {(a, b)} has no fade {(b, a)} "
                        f"to turn to; expected 0, or {(b, a)} among the fades (its rate may be 0)"
                    )
        for pair, (_, length) in self._fades:
            if 1.0 / length + self.turn_back > 1.0 + ROUNDING:
                raise ParameterError(
                    f"turn_back: got {self.turn_back:.6g}, expected at most {1.0 - 1.0 / length:.6g} for "
                    f"the fade {pair} of length {length:.6g}, which goes on with at least 1 / length a step"
                )

    @classmethod
    def between(cls, dwell: float, length: float, *, jump: float = 0.0, turn_back: float = 0.0) -> Self:
        """Create the symmetric law of two classes.

        Parameters
        ----------
        dwell : float
            Mean number of steps at a class, at least 1.  It is left by a fade or a jump, with total
            probability 1 / dwell per step.
        length : float
            Mean number of steps of a fade, at least 1.
        jump : float
            Probability of a jump per step at a class, at most 1 / dwell.
        turn_back : float
            As for `FadeLaw`.

        Returns
        -------
        FadeLaw

        Examples
        --------
        >>> law = FadeLaw.between(40, 10)
        >>> law.mean_dwell(), round(law.mean_fade(), 9)
        (array([40., 40.]), 10.0)
        """
        steps = as_real("dwell", dwell, "a number of steps")
        if not (steps >= 1.0 and np.isfinite(steps)):
            raise ParameterError(f"dwell: got {steps:.6g}, expected a finite number of steps, at least 1")
        p = as_probability("jump", jump)
        rate = 1.0 / steps - p
        if rate < -ROUNDING:
            raise ParameterError(
                f"jump: got {p:.6g}, expected at most {1.0 / steps:.6g}, 1 / dwell for dwell = {steps:.6g}"
            )
        fade = (max(rate, 0.0), _as_length("length", length))
        jumps = {(0, 1): p, (1, 0): p} if p else {}
        return cls(2, {(0, 1): fade, (1, 0): fade}, jumps=jumps, turn_back=turn_back)

    # ------------------------------------------------------------------ what it was made from

    @property
    def fades(self) -> dict[tuple[int, int], tuple[float, float]]:
        """Rate and mean length of each fade, in the order of their cells."""
        return dict(self._fades)

    @property
    def jumps(self) -> dict[tuple[int, int], float]:
        """Probability of each jump."""
        return dict(self._jumps)

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters of the law by name."""
        return {
            "n_classes": self.n_classes,
            "fades": self.fades,
            "jumps": self.jumps,
            "turn_back": self.turn_back,
        }

    def numbers(self) -> dict[str, float]:
        """Return mean dwell times and the parameters of fades, jumps and turning back, by name.

        Returns
        -------
        dict of str to float
        """
        leave = self._arrows().sum(axis=1)
        named = {f"stay at {k}": 1.0 / p if p else float("inf") for k, p in enumerate(leave.tolist())}
        for (a, b), (rate, length) in self._fades:
            named |= {f"rate {a} to {b}": rate, f"length {a} to {b}": length}
        named |= {f"jump {a} to {b}": p for (a, b), p in self._jumps}
        return named | ({"turn_back": self.turn_back} if self.turn_back else {})

    def to_dict(self) -> dict[str, Any]:
        """Return classes, fades [a, b, rate, length], jumps [a, b, p] and turn_back as plain values.

        Returns
        -------
        dict
        """
        return {
            "n_classes": self.n_classes,
            "fades": [[*pair, *values] for pair, values in self._fades],
            "jumps": [[*pair, p] for pair, p in self._jumps],
            "turn_back": self.turn_back,
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Create a law from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        FadeLaw
        """
        return cls(
            values["n_classes"],
            {(a, b): (rate, length) for a, b, rate, length in values["fades"]},
            jumps={(a, b): p for a, b, p in values["jumps"]},
            turn_back=values["turn_back"],
        )

    def _arrows(self) -> FloatArray:
        """Probability that the switch leaves a for b, by a fade or at once: (K, K)."""
        arrows = np.zeros((self.n_classes, self.n_classes))
        for (a, b), p in self._jumps:
            arrows[a, b] += p
        for (a, b), (rate, _) in self._fades:
            arrows[a, b] += rate
        return arrows

    # ------------------------------------------------------------------ the chain

    def size(self, n_nodes: int) -> int:
        """Return the total number of nodes, for ``n_nodes`` cells per fade.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each fade.

        Returns
        -------
        int
        """
        return self.n_classes + n_nodes * len(self._fades)

    def nodes_up_to(self, most: int) -> int:
        """Return the largest admissible number of cells per fade, at most ``most``.

        Parameters
        ----------
        most : int

        Returns
        -------
        int
        """
        return min([most, *(self._room(length) for _, (_, length) in self._fades)])

    def _room(self, length: float) -> int:
        return int(np.floor(length * (1.0 - self.turn_back) * (1.0 + ROUNDING)))

    def discretize(self, n_nodes: int, rule: str = "cell") -> SwitchChain:
        """Return the chain with a given number of cells per fade.

        Parameters
        ----------
        n_nodes : int
            Number F of cells of each fade.  With 0, a fade is a jump.
        rule : {"cell"}
            The only rule of this law.

        Returns
        -------
        SwitchChain
            Stationary chain.  Its nodes are the K classes, then F cells of each fade in the order of
            ``fades``.

        Raises
        ------
        ParameterError
            If a fade is shorter than ``n_nodes`` steps.

        Examples
        --------
        >>> FadeLaw.between(20, 3).discretize(5)
        Traceback (most recent call last):
            ...
        fuzzykf.errors.ParameterError: n_nodes: got 5, expected n_nodes=3 at most for fade (0, 1) of length 3
        """
        F, K, fades = as_count("n_nodes", n_nodes, 0), self.n_classes, self._fades
        if self.nodes_up_to(F) < F:
            pair, (_, length) = min(fades, key=lambda fade: self._room(fade[1][1]))
            turning = f" that turns back with {self.turn_back:.6g} a step" if self.turn_back else ""
            raise ParameterError(
                f"n_nodes: got {F}, expected n_nodes={self._room(length)} at most for fade {pair} of length "
                f"{length:.6g}{turning}"
            )
        check_cells(F, rule, K, len(fades))
        F = F if fades else 0  # what has no cells has none of any number
        weights = class_weights([pair for pair, _ in fades], F, K)
        measure = np.concatenate([np.ones(K), np.full(len(fades) * F, 1.0 / max(F, 1))])
        nodes = weights[:, 1] if K == 2 else weights
        return SwitchChain(nodes, measure, self._stationary(F), self._transition(F), weights)

    def _transition(self, F: int) -> FloatArray:
        K, fades = self.n_classes, self._fades
        P = np.zeros((K + len(fades) * F,) * 2)
        for (a, b), p in self._jumps:
            P[a, b] += p
        for e, ((a, b), (rate, length)) in enumerate(fades):
            cells = K + e * F + np.arange(F)
            path = np.append(cells, b)
            P[a, path[0]] += rate
            P[cells, path[1:]] = F / length
            if self.turn_back and F:
                P[cells, K + self._back[e] * F + np.arange(F)[::-1]] = self.turn_back
        stay = 1.0 - P.sum(axis=1)
        P[np.diag_indices(len(P))] = np.where(stay > ROUNDING, stay, 0.0)
        normalised: FloatArray = P / P.sum(axis=1, keepdims=True)
        return normalised

    @cached_property
    def _back(self) -> list[int]:
        """Number of the fade back of each fade; only if fades turn back."""
        pairs = [pair for pair, _ in self._fades]
        return [pairs.index((b, a)) for a, b in pairs]

    def _stationary(self, F: int) -> FloatArray:
        """Stationary law: that of the classes, between which fades count as jumps, and what fades add."""
        K = self.n_classes
        arrows, visits = np.zeros((K, K)), np.zeros((K, len(self._fades), F))
        for (a, b), p in self._jumps:
            arrows[a, b] += p
        for e, ((a, b), (rate, length)) in enumerate(self._fades):
            own = self._visits(e, F)
            visits[a, e] += rate * own[:F]
            arrows[a, b] += rate * (own[F - 1] * F / length if F else 1.0)  # or back to where it began
            if self.turn_back:
                visits[a, self._back[e]] += rate * own[F:]
        at = balance(arrows)
        masses = np.concatenate([at, np.tensordot(at, visits, 1).reshape(-1)])
        stationary: FloatArray = masses / masses.sum()
        return stationary

    def _visits(self, e: int, F: int) -> FloatArray:
        """Mean number of steps in each cell, (F,) or (2 F,), of a fade that has begun."""
        moves = self._moves(e, F)
        begin = np.zeros(len(moves))
        begin[:1] = 1.0
        return np.asarray(np.linalg.solve(moves.T, begin), dtype=np.float64)

    def _moves(self, e: int, F: int) -> FloatArray:
        """Identity minus transitions among the cells of a fade and, if it can turn, those of its fade back.

        Written down without a difference from 1, so that long fades lose no digits.
        """
        turning = self.turn_back > 0.0
        moves = np.zeros(((1 + turning) * F,) * 2)
        for part, fade in enumerate((e, self._back[e]) if turning else (e,)):
            step = F / self._fades[fade][1][1]
            cells = part * F + np.arange(F)
            moves[cells, cells] = step + self.turn_back
            moves[cells[:-1], cells[1:]] = -step
            if turning:
                moves[cells, (1 - part) * F + np.arange(F)[::-1]] = -self.turn_back
        return moves

    # ------------------------------------------------------------------ learning

    @classmethod
    def by_name(cls, n_nodes: int) -> Self:
        """Return the initial law of a search, for two classes: mostly fades, some jumps.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each fade.

        Returns
        -------
        FadeLaw
        """
        return cls.between(40.0, max(10.0, 2.0 * n_nodes), jump=0.005, turn_back=0.02)

    def with_numbers(
        self, rates: FloatArray, lengths: FloatArray, jumps: FloatArray, turn_back: float
    ) -> Self:
        """Return a law of the same structure with other parameters.

        Parameters
        ----------
        rates, lengths : ndarray
            One per fade, in their order.
        jumps : ndarray
            One per jump, in their order.
        turn_back : float

        Returns
        -------
        FadeLaw
        """
        fades = {
            pair: (float(rate), float(length))
            for (pair, _), rate, length in zip(self._fades, rates, lengths, strict=True)
        }
        made = {pair: float(p) for (pair, _), p in zip(self._jumps, jumps, strict=True)}
        return type(self)(self.n_classes, fades, jumps=made, turn_back=turn_back)

    def learner(self, n_nodes: int) -> FadeChain:
        """Return the discretised law as expectation-maximisation updates it.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each fade.

        Returns
        -------
        FadeChain
        """
        return FadeChain(self, n_nodes)

    def free_numbers(self, n_nodes: int) -> FadeNumbers:
        """Return the free parameters of the law for gradient ascent.

        Parameters
        ----------
        n_nodes : int
            Number of cells of each fade.

        Returns
        -------
        FadeNumbers
        """
        return FadeNumbers(self, n_nodes)

    def likeliest(self, paths: Sequence[FloatArray], n_nodes: int) -> Self:
        """Return the law of the same structure with the event frequencies of known paths of the switch.

        It does not depend on the number of cells: the mean length of a fade is the average number of steps
        it took.  Events that do not occur in the paths get the weight of one additional step, so that the
        law stays irreducible.

        Parameters
        ----------
        paths : sequence of ndarray, shape (n, K)
            Class weights.
        n_nodes : int

        Returns
        -------
        FadeLaw

        Raises
        ------
        ParameterError
            If the paths contain a fade, jump or turn that the law does not have.
        """
        events = count_events(paths, self.n_classes)
        self._check_events(events)

        def often(number: float, chances: float, before: float) -> float:
            return number / chances if number else before / (chances + 1.0)

        rates, lengths = [], []
        for pair, (rate, length) in self._fades:
            rates.append(often(events.begun.get(pair, 0.0), events.visits[pair[0]], rate))
            way = events.way.get(pair, 0.0)
            lengths.append(max(events.steps[pair] / way, 1.0) if way else length)
        jumps = [often(events.jumped.get(pair, 0.0), events.visits[pair[0]], p) for pair, p in self._jumps]
        turned = often(float(events.turned), sum(events.steps.values()), self.turn_back)
        try:
            return self.with_numbers(np.array(rates), np.array(lengths), np.array(jumps), turned)
        except ParameterError as error:
            raise ParameterError(f"r: does what makes no law of these fades; {error}") from error

    def _check_events(self, events: FadeEvents) -> None:
        for name, seen, there in (
            ("fade", [*events.begun, *events.way], dict(self._fades)),
            ("jump", [*events.jumped], dict(self._jumps)),
        ):
            for pair in seen:
                if pair not in there:
                    listed = ", ".join(map(str, there)) or "none"
                    raise ParameterError(
                        f"r: {name}s from class {pair[0]} to {pair[1]}, expected the {name}s of the law "
                        f"alone: {listed}; give a law that has it"
                    )
        if events.turned and not self.turn_back:
            raise ParameterError(
                f"r: turns back in a fade {counted(events.turned, 'time')}, which turn_back = 0 says is "
                "impossible; expected a law with a positive turn_back"
            )

    # ------------------------------------------------------------------ what follows from it

    def fade_lengths(self, n_nodes: int | None = None) -> dict[tuple[int, int], FadeLength]:
        """Return mean and standard deviation of the length of each fade, in steps.

        Parameters
        ----------
        n_nodes : int, optional
            Number of cells; see the notes of the class.

        Returns
        -------
        dict of (int, int) to FadeLength
            Number of steps until a class is reached, including turns.

        Examples
        --------
        >>> FadeLaw.between(40, 10).fade_lengths(10)[1, 0]  # a step for each cell
        FadeLength(mean=10.0, std=0.0)
        """
        F = self._cells_or_default(n_nodes)
        self.discretize(F)  # the error that says how many cells there can be
        found = {}
        for e, (pair, _) in enumerate(self._fades):
            if not F:
                found[pair] = FadeLength(0.0, 0.0)
                continue
            moves = self._moves(e, F)
            to_end = np.linalg.solve(moves, np.ones(len(moves)))
            mean, square = float(to_end[0]), float((2.0 * np.linalg.solve(moves, to_end) - to_end)[0])
            variance = square - mean**2
            found[pair] = FadeLength(mean, float(np.sqrt(variance)) if variance > ROUNDING * square else 0.0)
        return found

    def _cells_or_default(self, n_nodes: int | None) -> int:
        return self.nodes_up_to(NODES) if n_nodes is None else as_count("n_nodes", n_nodes, 0)

    @property
    def p_hard(self) -> float:
        """Probability that the switch is at a class.

        If fades turn back and opposite fades differ, it depends on the number of cells, and the default
        number counts.
        """
        return float(self.discretize(self.nodes_up_to(NODES)).initial[: self.n_classes].sum())

    def harden(self, n_nodes: int | None = None) -> FloatArray:
        """Return the joint probabilities of two consecutive hard regimes.

        A cell counts as the nearest class, the middle cell as the class that is being left.

        Parameters
        ----------
        n_nodes : int, optional
            Number of cells; see the notes of the class.

        Returns
        -------
        ndarray, shape (K, K)

        Examples
        --------
        >>> FadeLaw.between(40, 10).harden().round(6)
        array([[0.49, 0.01],
               [0.01, 0.49]])
        """
        F, K = self._cells_or_default(n_nodes), self.n_classes
        chain = self.discretize(F)
        nearer = [np.where(2 * np.arange(F) < F, a, b) for (a, b), _ in self._fades]  # 2 k < F: t <= 1/2
        shares = np.eye(K)[np.concatenate([np.arange(K), *nearer]).astype(int)]
        joint: FloatArray = shares.T @ (chain.initial[:, None] * chain.transition) @ shares
        return joint

    def sample(self, n: int, rng: np.random.Generator, n_nodes: int | None = None) -> FloatArray:
        """Draw ``n`` consecutive values of the stationary chain.

        Parameters
        ----------
        n : int
            Number of values.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Number of cells; see the notes of the class.

        Returns
        -------
        ndarray, shape (n,) or (n, K)
            For two classes, the weight of class 1; otherwise all class weights.

        Examples
        --------
        >>> import numpy as np
        >>> FadeLaw.between(2, 2).sample(8, np.random.default_rng(1))
        array([0.25, 0.75, 1.  , 0.75, 0.25, 0.  , 0.25, 0.75])
        """
        return self.discretize(self._cells_or_default(n_nodes)).sample(n, rng)

    def links(self) -> list[Link]:
        """Return the fades and jumps, for plots.

        Returns
        -------
        list of Link
        """
        fades = [
            Link(pair, f"{rate:.3g}, {length:.3g} steps", gradual=True)
            for pair, (rate, length) in self._fades
        ]
        return fades + [Link(pair, f"{p:.3g}", gradual=False) for pair, p in self._jumps]

    @shown
    def __repr__(self) -> str:
        text = f"FadeLaw({self.n_classes}, {_pairs_text(self.fades)}"
        if self._jumps:
            text += f", jumps={_pairs_text(self.jumps)}"
        return f"{text}, turn_back={value_text(self.turn_back)})" if self.turn_back else f"{text})"


def _pairs_text(values: dict[tuple[int, int], Any]) -> str:
    listed = ", ".join(f"{pair}: {value_text(value)}" for pair, value in [*values.items()][:4])
    return f"{{{listed}{', ...' if len(values) > 4 else ''}}}"


def _as_length(name: str, value: Any) -> float:
    length = as_real(name, value, "a number of steps")
    if not (length >= 1.0 and np.isfinite(length)):
        raise ParameterError(f"{name}: got {length:.6g}, expected a finite number of steps, at least 1")
    return length


def _rate_and_length(pair: Any, value: Any) -> tuple[float, float]:
    name = f"fades[{pair}]"
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise ParameterError(f"{name}: got {brief(value)}, expected a pair (rate, mean_length)")
    return as_probability(f"{name}, rate", value[0]), _as_length(f"{name}, mean length", value[1])
