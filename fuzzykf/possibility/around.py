"""What the measurements of a nonlinear model show around one state, on a grid.

A state x_1 = x that moves and is measured with the likeliest noise shows z_1, ..., z_n.  The way back,
without any normalisation, gives the possibility of these measurements for every other start,

    b_n = c_V(z_n - h),   b_k(a) = c_V(z_k - h(a)) + min over a' of b_(k+1)(a') + c_W(a' - f(a)) ,

and the starts of a level are those that x cannot be told from by what x itself is likeliest to show.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import label as pieces_of

from fuzzykf.errors import ParameterError, SupportWarning
from fuzzykf.possibility.beliefs import GridBelief
from fuzzykf.possibility.grid.backward import Message, before_prediction
from fuzzykf.possibility.grid.noise import decompose
from fuzzykf.possibility.mapping import Mapping, as_map
from fuzzykf.possibility.memberships import GridMembership, IntervalMembership
from fuzzykf.reprs import reprs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.grid.lattice import Lattice
    from fuzzykf.possibility.memberships import Membership

__all__ = ["LocalObservability", "observe_around"]

#: Into how many parts steps are cut to find the ends of a set, by number of dimensions.
PARTS = {1: 8, 2: 4, 3: 2}


@reprs("verdict", "level", "widths", "components")
@dataclass(frozen=True, eq=False)
class LocalObservability:
    """Local observability of a nonlinear model around one state, from `observability`.

    Attributes
    ----------
    level : float
        A state counts as distinguished from ``x`` if the most possible measurements of ``x`` are less
        possible for it.
    x : ndarray, shape (m,)
    widths : ndarray, shape (n, m)
        Largest |a_i - x_i| of states a that 1, ..., n measurements do not distinguish from ``x``; infinite if
        they reach the edge of the grid.
    components : ndarray of int, shape (n,)
        Number of connected parts of the set of these states.
    membership : GridMembership
        Possibility of the n measurements of ``x`` for each state.
    """

    level: float
    x: FloatArray
    widths: FloatArray
    components: np.ndarray
    membership: GridMembership

    @property
    def is_observable(self) -> bool:
        """Whether the set of states that are not distinguished is bounded and connected."""
        return bool(self.components[-1] == 1 and np.isfinite(self.widths[-1]).all())

    @property
    def verdict(self) -> str:
        """The result in words."""
        n, pieces = len(self.widths), int(self.components[-1])
        what = f"states that {n} measurement{'s' if n > 1 else ''} of {_shown(self.x)} do not tell from it"
        if self.is_observable:
            return f"observable: at level {self.level:g} {what} are within {_shown(self.widths[-1])} of it"
        reasons = [f"are {pieces} pieces"] if pieces > 1 else []
        open_ = np.flatnonzero(np.isinf(self.widths[-1]))
        if open_.size:
            names = ", ".join(f"x{k}" for k in open_)
            reasons.append(f"reach the edge of the states considered in {names}")
        return f"not observable: at level {self.level:g} {what} {' and '.join(reasons)}"

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw how possible the measurements of ``x`` are for other states.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_membership`: components, level, label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.memberships import plot_membership

        return plot_membership(self.membership, ax, **{"estimate": self.x, **options})


def observe_around(est: Any, n: int, level: float, x: FloatArray | None) -> LocalObservability:
    """Ask what n measurements show around a state.

    Parameters
    ----------
    est : FuzzyRelationEstimator
        On a grid; the states considered are those within its ``lower`` and ``upper``.
    n : int
    level : float
    x : ndarray, shape (m,), or None
        By default that of the estimator.

    Raises
    ------
    ParameterError
        If ``x`` is none of the states considered.
    """
    norm, universe, noise, error = est.t_norm, est._universe, est.process_noise, est.measurement_noise
    x = np.ravel(est.x) if x is None else x
    lower, upper = est.lower, est.upper
    if ((x < lower) | (x > upper)).any():
        raise ParameterError(
            f"x: got {x.tolist()}, expected a state within {lower.tolist()} and {upper.tolist()}, those that "
            "are considered (assign a wider membership)"
        )
    move, measure = _mappings(est)
    belief = GridBelief.of("state", IntervalMembership(lower, upper), norm, universe)
    lattices, seen, place, notes = [], [], x, set()
    for k in range(n):
        if k:
            outcome = belief.predict(move, noise)
            notes.update(outcome.notes)
            assert isinstance(outcome.belief, GridBelief)
            belief, place = outcome.belief, move(place[None])[0] + noise.peak
        lattices.append(belief.lattice)
        seen.append(_seen(belief.lattice, measure, error, measure(place[None])[0] + error.peak))
    for note in notes:
        warnings.warn(f"observability: {note}", SupportWarning, stacklevel=3)
    parts = decompose(noise, norm)
    widths, components = np.empty((n, x.size)), np.empty(n, dtype=np.intp)
    for last in range(n):
        cost = seen[last]
        for k in range(last - 1, -1, -1):
            message = Message(lattices[k + 1].axes, cost)
            message = before_prediction(lattices[k], message, move, parts, universe)
            cost = norm.combine(seen[k], message.cost)
        if not norm.membership(np.maximum(cost, 0.0)).any():
            raise ParameterError(
                f"points: got {list(cost.shape)} nodes over the states considered, too coarse for the "
                f"measurement noise: none shows what x does in {last + 1} measurements; "
                "expected more, or a narrower membership of the state"
            )
        widths[last], components[last] = _cut(lattices[0].axes, cost, float(norm.cost(level)), x)
    values = norm.membership(np.maximum(cost, 0.0))
    membership = GridMembership(lattices[0].axes, values, normalise=True)
    return LocalObservability(level, x, widths, components, membership)


def _mappings(est: Any) -> tuple[Mapping, Mapping]:
    """Return the maps f and h of an estimator."""
    d, q = est.dim_x, est.dim_z
    if est.fx is None:
        move = Mapping("F", d, d, matrix=as_map("F", est.F, (d, d)))
    else:
        move = Mapping("fx", d, d, function=est.fx, inverse=est.fx_inverse)
    if est.hx is None:
        return move, Mapping("H", d, q, matrix=as_map("H", est.H, (q, d)))
    return move, Mapping("hx", d, q, function=est.hx)


def _seen(lattice: Lattice, measure: Mapping, error: Membership, z: FloatArray) -> FloatArray:
    """Costs of a measurement at the nodes, infinite where it is impossible."""
    live = lattice.live(np.inf)
    value = measure.on_grid(lattice.axes, live)
    cost = error.cost(np.where(np.isfinite(value), z - value, np.inf), lattice.t_norm)
    return np.where(live & (cost < lattice.t_norm.impossible), cost, np.inf)


def _cut(
    axes: tuple[FloatArray, ...], cost: FloatArray, limit: float, x: FloatArray
) -> tuple[FloatArray, int]:
    """Largest distances (d,) from x of the states of no more than a cost, and the number of their pieces.

    Ends are sought between the nodes; next to a state that is impossible, outwards.  What is next to x
    counts as not told from it: a grid knows no less.
    """
    parts = PARTS[len(axes)]
    fine = tuple(np.linspace(a[0], a[-1], parts * (a.size - 1) + 1) if a.size > 1 else a for a in axes)
    axes, cost = fine, Message(axes, cost).on(fine).cost
    limit = max(limit, _around(axes, cost, x))
    kept = cost <= limit
    distances = np.zeros(len(axes))
    for k, axis in enumerate(axes):
        if axis.size == 1:
            continue
        profile = cost.min(axis=tuple(m for m in range(cost.ndim) if m != k))
        there = np.flatnonzero(profile <= limit)
        if there.size == 0:
            continue
        if there[0] == 0 or there[-1] == axis.size - 1:
            distances[k] = np.inf
            continue
        for inner, outer in ((there[0], there[0] - 1), (there[-1], there[-1] + 1)):
            rise = profile[outer] - profile[inner]
            part = (limit - profile[inner]) / rise if np.isfinite(rise) else 1.0
            end = axis[inner] + part * (axis[outer] - axis[inner])
            distances[k] = max(distances[k], abs(end - x[k]))
    return distances, int(pieces_of(kept, structure=np.ones((3,) * kept.ndim))[1])


def _around(axes: tuple[FloatArray, ...], cost: FloatArray, x: FloatArray) -> float:
    """Largest finite cost of the nodes around a state, two on either side."""
    window = []
    for axis, value in zip(axes, x, strict=True):
        above = int(np.searchsorted(axis, value, "right"))
        window.append(slice(max(above - 2, 0), above + 2))
    here = cost[tuple(window)]
    return float(here[np.isfinite(here)].max(initial=0.0))


def _shown(values: FloatArray) -> str:
    return "[" + ", ".join(f"{value:.3g}" for value in values) + "]"
