"""The estimator looks back: what each state is given the whole series.

In costs, backwards by conditioning (the residuum of the t-norm):

    gamma_n(x) = min over x' of [ c_n(x) + c_W(x' - f(x)) - c'_(n+1)(x') + gamma_(n+1)(x') ]

with c_n of the filter, c' of its prediction, and gamma_N = c_N.  An update changes nothing on the way
back: it speaks of the same state.  What a restart forgot is not told of what came after it.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fuzzykf.base import FilterResult
from fuzzykf.engine.selected import CUT
from fuzzykf.errors import EmptyIntersectionError, ParameterError, SupportWarning
from fuzzykf.gaussian import as_real
from fuzzykf.overrides import attributes_of
from fuzzykf.possibility import closed_form
from fuzzykf.possibility.beliefs import GridBelief, QuadraticBelief
from fuzzykf.possibility.constraint import is_crisp, narrowed
from fuzzykf.possibility.grid.backward import Message, before_prediction, before_update, kept, smoothed
from fuzzykf.possibility.grid.noise import decompose
from fuzzykf.possibility.intervals import boxes
from fuzzykf.possibility.intervals.path import Broken, contract_path
from fuzzykf.possibility.mapping import matrix_of
from fuzzykf.possibility.representation import required_quadratic
from fuzzykf.possibility.trail import Trail

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import TypeAlias

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Lattice
    from fuzzykf.possibility.intervals.box import Box
    from fuzzykf.possibility.series import ToldSeries
    from fuzzykf.possibility.trail import Node

    #: x (d,), P (d, d), lower and upper bounds (d,).
    Estimate: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

__all__ = ["MEMORY", "smooth_series"]

#: What a smoothed series has of the filter.
OF_FILTER = ("possibility", "log_likelihood")

#: How much memory the lattices of a series take by default, in bytes, and how many there must be room for.
MEMORY, LATTICES = 2.0**30, 16

#: Reciprocals of smaller memberships are left out: costs so large are not known to better than by 1, and the
#: way back takes their differences.
LEAST = 1e-4

#: A least cost of a smoothed state may be off by this, for the errors of a grid.
OFF = 0.1


class WayBack(Protocol):
    """How a representation goes from one node to the one before."""

    def last(self, node: Node) -> Any:
        """Return what is known of the node if nothing is known of later ones."""

    def back(self, node: Node, known: Any) -> Any:
        """Return what is known of the node before a prediction or update."""

    def estimate(self, node: Node, known: Any) -> tuple[Any, Estimate]:
        """Return what is known, mended as `on_empty` says if it is impossible; x, P and bounds of it."""


def smooth_series(est: Any, series: ToldSeries, memory: float) -> FilterResult:
    """Filter a series and look back; the estimator ends at the last observation.

    Parameters
    ----------
    est : FuzzyRelationEstimator
    series : ToldSeries
    memory : float
        See `FuzzyRelationEstimator.smooth`.

    Returns
    -------
    FilterResult
    """
    room = _room(est, memory)
    before = attributes_of(est)
    try:
        est.remember_origin()  # with the belief of before, and not one that is tracked
        if est.representation == "grid":
            trail = Trail(est, copies=False, room=room, size=_bytes_of)
        else:
            trail = Trail(est, copies=est.is_closed_form)
        forward = est._filter_noting(
            series.zs, trail.note, told=series.steps, uneven=series.uneven, fields=OF_FILTER
        )
        trail.stop()
        x, P, lower, upper = _look_back(trail, est)
        lower, upper = narrowed(lower, upper, est._constraint)
    except BaseException:
        est.__dict__.clear()
        est.__dict__.update(before)
        raise
    return FilterResult(
        x=x,
        P=P,
        lower=lower,
        upper=upper,
        possibility=forward.possibility,
        log_likelihood=forward.log_likelihood,
        index=forward.index,
        coords=forward.coords,
    )


def _room(est: Any, memory: float) -> float:
    """Check a bound of memory."""
    room = as_real("memory", memory, "a number of bytes")
    least = 0.0 if est._universe is None else LATTICES * 8.0 * float(np.prod(est._universe.points))
    if not room >= least:
        raise ParameterError(
            f"memory: got {room:g} bytes, expected at least {least:g}: {LATTICES} lattices of this grid"
        )
    return room


def _bytes_of(node: Node) -> float:
    """Return how much memory the lattices of a node take."""
    beliefs = (node.belief, node.prior)
    return float(sum(one.lattice.cost.nbytes for one in beliefs if one is not None))


def _way_back(est: Any, trail: Trail) -> WayBack:
    if est.is_closed_form:
        return QuadraticWayBack(est.on_empty)
    if est.representation == "interval":
        return BoxWayBack(est.on_empty, trail)
    return GridWayBack(est.on_empty)


def _look_back(trail: Trail, est: Any) -> tuple[FloatArray, ...]:
    """Return x (n, d), P (n, d, d), lower and upper (n, d), from the last step to the first."""
    n, d = len(trail.ends), est.dim_x
    x, P, lower, upper = np.empty((n, d)), np.empty((n, d, d)), np.empty((n, d)), np.empty((n, d))
    if n == 0:
        return x, P, lower, upper
    way, node = _way_back(est, trail), trail.ends[-1]
    trail.recall(node)
    known = way.last(node)
    for k in range(n - 1, -1, -1):
        while node is not trail.ends[k]:
            if node.before is None:
                raise trail.broken(k + 1)
            trail.recall(node.before)
            trail.recall(node)
            # A restart knows nothing of before, so that nothing after it tells of before.
            known = way.last(node.before) if node.verb == "restart" else way.back(node, known)
            trail.release(node)
            node = node.before
        known, (x[k], P[k], lower[k], upper[k]) = way.estimate(node, known)
    return x, P, lower, upper


def contradiction(on_empty: str, lower: Sequence[float], upper: Sequence[float]) -> None:
    """Do what `on_empty` says where later measurements leave nothing of a state.

    Raises
    ------
    EmptyIntersectionError
        If it says "raise".
    """
    if on_empty == "raise":
        raise EmptyIntersectionError(
            f"zs: later measurements exclude every state within {list(lower)} and {list(upper)}, which is "
            "what earlier ones leave; on_empty='keep' looks back from there anew"
        )


class QuadraticWayBack:
    """The recursion of Rauch, Tung and Striebel, on the matrices of any closed family.

    What is known of a node is a `QuadraticBelief`.

    Parameters
    ----------
    on_empty : str
    """

    def __init__(self, on_empty: str) -> None:
        self.on_empty = on_empty

    def last(self, node: Node) -> QuadraticBelief:
        """Return the belief of the filter."""
        belief: QuadraticBelief = node.belief
        return belief

    def back(self, node: Node, known: QuadraticBelief) -> QuadraticBelief:
        """Return what is known before a verb."""
        if node.verb != "predict" or node.before is None:
            return known
        past: QuadraticBelief = node.before.belief
        _, Q = required_quadratic("noise", node.noise, past.family)
        x, P = closed_form.retrace(
            past.x.ravel(),
            past.P,
            node.belief.x.ravel(),
            node.belief.P,
            matrix_of(node.mapping),
            Q,
            known.x.ravel(),
            known.P,
        )
        return QuadraticBelief(past.family, x, P)

    def estimate(self, node: Node, known: QuadraticBelief) -> tuple[QuadraticBelief, Estimate]:
        """Return center, matrix and bounds; what the filter excludes stays excluded."""
        (low, high), (least, most) = known.bounds(), node.belief.bounds()
        lower, upper = np.maximum(low, least), np.minimum(high, most)
        if (lower > upper).any():
            contradiction(self.on_empty, least.tolist(), most.tolist())
            return self.estimate(node, self.last(node))
        return known, (known.x.ravel(), known.P, lower, upper)


class BoxWayBack:
    """Boxes that go back and forth over the whole series at once.

    What is known of a node is a `Box`.

    Parameters
    ----------
    on_empty : str
    trail : Trail
        Of a whole series.
    """

    def __init__(self, on_empty: str, trail: Trail) -> None:
        nodes = trail.nodes()
        cuts = {k for k, node in enumerate(nodes) if node.verb == "restart"}
        while True:
            try:
                found = contract_path(nodes, cuts)
                break
            except Broken as broken:
                box = nodes[broken.place - 1].belief.box
                contradiction(on_empty, box.lower.tolist(), box.upper.tolist())
                cuts.add(broken.place)
        self.known: dict[Node, Box] = dict(zip(nodes, found, strict=True))

    def last(self, node: Node) -> Box:
        """Return what is left of the box of the filter."""
        return self.known[node]

    def back(self, node: Node, known: Box) -> Box:
        """Return what is left before a verb."""
        return known if node.before is None else self.known[node.before]

    def estimate(self, node: Node, known: Box) -> tuple[Box, Estimate]:
        """Return the center, that of a uniform density for P, and bounds."""
        x, P = boxes.moments(known.lower, known.upper)
        return known, (x, P, known.lower, known.upper)


class GridWayBack:
    """Messages on lattices; what is known of a node is a `Message` on the axes of its belief.

    Parameters
    ----------
    on_empty : str
    """

    def __init__(self, on_empty: str) -> None:
        self.on_empty = on_empty
        self.noted: set[str] = set()
        self.noise: Any = None  # as it was decomposed last
        self.prior: Lattice | None = None  # the prediction on the axes of the latest update

    def last(self, node: Node) -> Message:
        """Return the message of no measurements."""
        return Message.nothing(node.belief.lattice)

    def back(self, node: Node, known: Message) -> Message:
        """Return the message before a verb."""
        if node.before is None:
            return known
        source: GridBelief = node.before.belief
        if node.verb == "predict":
            if self.noise is None or self.noise.membership is not node.noise:
                self.noise = decompose(node.noise, source.lattice.t_norm)
            predicted = self._on(known, node.belief.lattice)
            if predicted is node.belief.lattice:  # after an update it has been done
                known = kept(predicted, known, _most(source))
            return before_prediction(
                source.lattice, known, node.mapping, self.noise, source.universe, predicted
            )
        if _adds_nothing(node):
            self.prior = node.belief.lattice
            return known
        known = known.on(node.belief.lattice.axes)
        lattice, self.prior = node.belief.lattice, node.prior.lattice
        message = before_update(lattice, known, self.prior, node.possibility, _most(source))
        if node.before.verb == "predict" or _adds_nothing(node.before):
            return message
        return message.on(source.lattice.axes)

    def _on(self, known: Message, lattice: Lattice) -> Lattice | None:
        """Return the prediction on the axes of a message."""
        for one in (lattice, self.prior):
            if one is not None and all(map(np.array_equal, one.axes, known.axes)):
                return one
        return None

    def estimate(self, node: Node, known: Message) -> tuple[Message, Estimate]:
        """Return centroid, spread and bounds."""
        belief: GridBelief = node.belief
        here = known.on(belief.lattice.axes)  # a prediction may have been refined by its update
        found = smoothed(belief.lattice, here)
        if found is None:
            contradiction(self.on_empty, *(bound.tolist() for bound in belief.bounds()))
            return self.estimate(node, self.last(node))
        lattice, normalised = found
        known = normalised if here is known else known
        notes = [*lattice.notes(follows=belief.universe.domain is None), *_cut_off(lattice, belief)]
        for note in notes + _lost_digits(belief.lattice, here):
            self._warn(note)
        result = GridBelief(lattice, belief.universe)
        x, P = result.moments()
        return known, (x.ravel(), P, *result.bounds())

    def _warn(self, note: str) -> None:
        """Warn, once a series."""
        if note not in self.noted:
            self.noted.add(note)
            warnings.warn(f"smooth: {note}", SupportWarning, stacklevel=6)


def _most(belief: GridBelief) -> float:
    """Up to what cost a state counts on the way back, given all measurements."""
    universe, t_norm = belief.universe, belief.lattice.t_norm
    if t_norm.scale != "reciprocal":
        return np.inf
    least = float(t_norm.cost(LEAST))
    return least if universe.domain is not None else min(least, universe.limit)


def _adds_nothing(node: Node) -> bool:
    """Whether a node is a box on a lattice that ends with it, so that no message goes beyond."""
    if node.verb != "constrain" or not is_crisp(node.noise) or node.belief.universe.domain is not None:
        return False
    return node.possibility == 1.0 or bool(node.belief.lattice.t_norm.scale == "log")


def _lost_digits(lattice: Lattice, message: Message) -> list[str]:
    """Warn where the least cost is not 0: errors of large reciprocals pass for possible states."""
    if lattice.t_norm.scale != "reciprocal":
        return []
    with np.errstate(invalid="ignore"):
        least = float(np.nanmin(lattice.cost + message.cost))
    if least > -OFF:
        return []
    return [
        f"measurements that hardly agree, and memberships with steep tails: under the t-norm "
        f"{lattice.t_norm.name!r} a grid of {lattice.cost.ndim} dimensions cannot tell what is unlikely from "
        "what is impossible on the way back, and the smoothed states are wrong (choose t_norm='product', or "
        "Cauchy memberships)"
    ]


def _cut_off(lattice: Lattice, belief: GridBelief) -> list[str]:
    """Warn where later measurements draw a state to the edge of what the filter kept of it."""
    universe, t_norm = belief.universe, lattice.t_norm
    if universe.domain is not None or universe.bounded:
        return []
    most = float(t_norm.cost(np.sqrt(t_norm.membership(universe.limit))))
    for k in lattice.free:
        for end in (0, -1):
            side = (slice(None),) * k + (end,)
            edge = lattice.cost[side]
            if (
                edge.min() < most
                and ((edge < most) & (belief.lattice.cost[side] >= CUT * universe.limit)).any()
            ):
                return [
                    "later measurements draw states to the edge of what the filter kept; what it left out "
                    "does not come back (choose a smaller floor)"
                ]
    return []
