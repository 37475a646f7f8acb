"""IMM and GPB2: state-space models on the nodes of a switch, whether that is hard or fuzzy.

A state-space model has no exact filter of bounded cost: what is known of the state at a node is a mixture
over all ways that led there.  Both methods merge it to mean and covariance, IMM before each step (Blom and
Bar-Shalom, 1988), in node form:

    c_j = sum_i mu_i T_ij,    x0_j, P0_j = the moments of the mixture of (x_i, P_i) by mu_i T_ij / c_j,
    predict and update with the parameters of node j,    mu'_j proportional to c_j p(y' | j),

and GPB2 after it (Chang and Athans, 1978), in pair form: every pair (i, j) is predicted and updated, and
those that end in j are merged by mu_i T_ij p(y' | i, j).  GPB2 is exact for two observations and costs more,
as many times as there are ways to a node.  With one node both are the Kalman filter.

The arithmetic is that of `fuzzykf.engine.numpy.nodes`.  Parts that are missing of an observation are left
out, in any pattern; the state is X alone at all times, as the past of Y says nothing beside it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, cast, final

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.fixed_lag import Nodes
from fuzzykf.gaussian import check_definite, mixture_moments
from fuzzykf.many import over_threads
from fuzzykf.switching.dynamics.nodes import joint_moments
from fuzzykf.switching.dynamics.pairs import Ahead
from fuzzykf.switching.inference.method import Known, Method, Smoothed, out_of_range, tables_to
from fuzzykf.switching.inference.mixture import Mixture, Source
from fuzzykf.switching.inference.series import Trajectory, allocate, shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.nodes import NodeLaw, NodeSystem, NodeTables
    from fuzzykf.switching.inference.series import Stand

__all__ = ["GPB2", "IMM", "OnNodes"]


@final
class OnNodes(Method):
    """Approximate filtering of state-space models on the nodes of a switch; see `Method`.

    Parameters
    ----------
    name : str
        Under which this module holds it.
    every_pair : bool
        Whether it is GPB2, and not IMM.
    """

    def __init__(self, name: str, every_pair: bool) -> None:
        self.name, self.every_pair = name, every_pair

    def __repr__(self) -> str:
        return self.name

    @property
    def streams(self) -> bool:
        """Whether the engine may take steps by itself: always, there are no subclasses."""
        return True

    def __reduce__(self) -> str | tuple[Any, ...]:
        return self.name  # there is one alone, whoever copies or pickles it

    def first(self, law: NodeLaw, y: FloatArray) -> tuple[Mixture, float]:  # type: ignore[override]
        """Condition the law of (r_1, X_1) on y_1, (q,), NaN where missing; nothing moves before it."""
        try:
            table, value = engine.first_node_step(law.kernel, law.table[None], y[None])
        except np.linalg.LinAlgError as error:
            raise _singular(law.probability, law.covariance, y) from error
        return _checked(table, value, y)

    def advance(  # type: ignore[override]
        self, tables: NodeTables, mixture: Mixture, y: FloatArray, width: int
    ) -> tuple[Mixture, float]:
        """Take the next observation, (q,), NaN where missing, into account.

        Parameters
        ----------
        tables : NodeTables
        mixture : Mixture
        y : ndarray, shape (q,)
        width : int
            Length of the window after it, which is 0.

        Returns
        -------
        mixture, log_likelihood
            The log-likelihood is that of the parts that are there; 0 if none is.
        """
        try:
            table, value = engine.node_step(tables.kernel, self.every_pair, mixture.table[None], y[None])
        except np.linalg.LinAlgError as error:
            mu, *moments = engine.before_node_step(tables.kernel, mixture.table[None])
            _, joint = joint_moments(moments[0][0], moments[1][0], tables.H, tables.d, tables.R)
            raise _singular(mu[0], joint, y) from error
        return _checked(table, value, y)

    def ahead(self, tables: NodeTables, mixture: Mixture) -> Ahead:  # type: ignore[override]
        """Moments of (X', Y') and the probabilities of the nodes before Y' is seen."""
        m = tables.F.shape[-1]
        mu, x, P = engine.before_node_step(tables.kernel, mixture.table[None])
        joint = joint_moments(x[0], P[0], tables.H, tables.d, tables.R)
        mean, covariance = mixture_moments(mu[0], *joint)
        return Ahead(mu[0], mean[:m], covariance[:m, :m], mean[m:], covariance[m:, m:])

    def run(  # type: ignore[override]
        self,
        system: NodeSystem,
        ys: FloatArray,
        names: tuple[str, ...],
        *,
        states: bool | Literal["nodes"] = False,
        stand: Stand | None = None,
    ) -> Trajectory:
        """Filter a series (n, q), see `fuzzykf.switching.inference.series.filter_one`."""
        found, before, last = self._filter(system, ys[None], names, bool(states), stand)
        fields = {name: values[0] for name, values in found.items()}
        n = (0 if stand is None else stand.n + stand.skips) + len(ys)  # observations after it
        if not len(ys):
            return Trajectory(fields, {}, None if stand is None else stand.mixture, None)
        source = None
        if n > 1:
            origin = 0 if stand is None else stand.origin
            source = Source(_mixture(before[0]), cast("Any", system.pair_tables(n - 2 - origin)))
        return Trajectory(fields, {}, _mixture(last[0]), source)

    def smooth(  # type: ignore[override]
        self, system: NodeSystem, trajectory: Trajectory, ys: FloatArray, by_density: bool = True
    ) -> Smoothed:
        """Estimate every state of a filtered series from all of it.

        Parameters
        ----------
        system : NodeSystem
        trajectory : Trajectory
            What the filter knew, its states included.
        ys : ndarray, shape (n, q)
            NaN where missing.
        by_density : bool
            Whether the weights have the density of the next state, and not Kim's.
        """
        table, m = trajectory.fields["table"], system.dim_x
        if not len(ys):
            return Smoothed(table[:, 0], *engine.node_moments(table, m), np.empty(0, dtype=np.intp))
        kernel = engine.pack_nodes(
            engine.NodeSpace(*system.steps(0, len(ys))), _logs(system.chain.transition)
        )
        found, path = engine.smooth_nodes(kernel, table, ys, by_density)
        if not engine.is_in_range(found).all():
            raise out_of_range(ys[np.nanargmax(np.abs(ys).max(axis=1, where=~np.isnan(ys), initial=0.0))])
        return Smoothed(np.exp(found[:, 0]), *engine.node_moments(found, m), path)

    def known_along(  # type: ignore[override]
        self, system: NodeSystem, trajectory: Trajectory, ys: FloatArray
    ) -> list[Known]:
        """Return what was known after each observation of a series (n, q)."""
        table = trajectory.fields["table"]
        steps = tables_to(cast("Any", system), len(ys))
        return [Known(Mixture(one, _NONE), *step) for one, *step in zip(table, steps, ys, strict=True)]

    def look_back(  # type: ignore[override]
        self, system: NodeSystem, states: Sequence[Known], by_density: bool = True
    ) -> Nodes:
        """Estimate what was known after some observations in a row from all of them; see `smooth`."""
        table = np.array([one.mixture.table for one in states])
        if len(states) > 1:
            steps: list[Any] = [one.tables for one in states[1:]]
            kernel = steps[0].kernel
            if any(one is not steps[0] for one in steps):
                spaces = [one.space for one in (steps[0], *steps)]  # that to the first is not gone back
                space = engine.NodeSpace(*(np.concatenate(one, axis=1) for one in zip(*spaces, strict=True)))
                kernel = engine.pack_nodes(space, steps[0].log_transition)
            ys = np.array([one.y for one in states])
            table, _ = engine.smooth_nodes(kernel, table, ys, by_density)
            if not engine.is_in_range(table).all():
                raise out_of_range(states[-1].y)
        return Nodes(np.exp(table[:, 0]), *engine.node_moments(table, system.dim_x))

    def run_many(  # type: ignore[override]
        self,
        system: NodeSystem,
        series: FloatArray,
        names: tuple[str, ...],
        threads: int = 1,
        stand: Stand | None = None,
    ) -> dict[str, FloatArray]:
        """Filter series (s, n, q) side by side, see `fuzzykf.switching.inference.series.filter_many`."""
        wanted = [name for name in names if name != "class_weights"]
        if "class_weights" in names:
            wanted += ["mu", "switch_mean"]
        found, _, _ = self._filter(system, series, tuple(dict.fromkeys(wanted)), False, stand, threads)
        return shown(system.chain, found, names)

    def _filter(
        self,
        system: NodeSystem,
        series: FloatArray,
        names: tuple[str, ...],
        states: bool,
        stand: Stand | None,
        threads: int = 1,
    ) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
        """Filter series (s, n, q) and return fields (s, n, ...), and the states before and after the last."""
        if not (len(series) and series.shape[1]):  # nothing to begin with, and no way of a known switch
            return allocate(cast("Any", system), series.shape[:2], names, states), _NONE, _NONE
        lead = 0 if stand is None else int(stand.skips)
        if lead:  # the observation of the time in between is missing
            series = np.concatenate([np.full_like(series[:, :1], np.nan), series], axis=1)
        out = allocate(cast("Any", system), series.shape[:2], names, states)
        begin = system.initial().table if stand is None else stand.mixture.table
        table = np.repeat(begin[None], len(series), axis=0)
        chain = system.chain
        switch = chain.keys, chain.weights, chain.atoms, chain.ranking
        start = 0 if stand is None else stand.n - stand.origin
        steps = system.steps(start, series.shape[1])
        log_transition = _logs(chain.transition)

        def several(rows: slice) -> tuple[FloatArray, FloatArray]:
            space = engine.NodeSpace(*(one[rows] if len(one) > 1 else one for one in steps))
            kernel = engine.pack_nodes(space, log_transition)
            part = {name: values[rows] for name, values in out.items()}
            return engine.filter_nodes(
                kernel, self.every_pair, table[rows], stand is None, series[rows], part, switch
            )

        try:
            found = over_threads(several, len(series), threads)
        except np.linalg.LinAlgError as error:
            self._walk(system, series, stand)  # says which node it is
            raise NotPositiveDefiniteError(_SINGULAR) from error
        before, last = (np.concatenate(parts) for parts in zip(*found, strict=True))
        _check_range(out, last, series)
        return {name: values[:, lead:] for name, values in out.items()}, before, last

    def _walk(self, system: NodeSystem, series: FloatArray, stand: Stand | None) -> None:
        """Filter series step by step, for the errors of steps alone."""
        for ys in series:
            mixture = None if stand is None else stand.mixture
            for k, y in enumerate(ys, 0 if stand is None else stand.n - stand.origin):
                if mixture is None:
                    mixture, _ = self.first(system.initial(), y)
                else:
                    mixture, _ = self.advance(system.pair_tables(k - 1), mixture, y, 0)


_NONE = np.empty(0)

#: Said where the pair of nodes is not found, of which S is singular.
_SINGULAR = "S = H P H' + R: expected a positive definite matrix, got one that is not (to rounding error)"


def _logs(p: FloatArray) -> FloatArray:
    """Logarithms of probabilities, minus infinity of zero."""
    with np.errstate(divide="ignore"):
        return np.log(p)


def _mixture(table: FloatArray) -> Mixture:
    return Mixture(table.copy(), np.empty(0))


def _checked(table: FloatArray, log_likelihood: FloatArray, y: FloatArray) -> tuple[Mixture, float]:
    """Return a state that has been proved to be numbers."""
    if not (log_likelihood[0] > engine.FARTHEST and engine.is_in_range(table[0])):
        raise out_of_range(y)
    return Mixture(table[0], np.empty(0)), float(log_likelihood[0])


def _check_range(out: dict[str, FloatArray], last: FloatArray, series: FloatArray) -> None:
    """Raise unless states and fields of series (s, n, q) are numbers, which NaN and infinity are not."""
    fits = engine.is_in_range(last)
    for name, limit in {"x": engine.LARGEST_MEAN, "P": np.finfo(np.float64).max}.items():
        if name in out:
            fits &= (np.abs(out[name]) <= limit).reshape(len(fits), -1).all(axis=1)
    if "log_likelihood" in out:
        fits &= (out["log_likelihood"] > engine.FARTHEST).all(axis=1)
    if not fits.all():
        seen = np.where(np.isnan(series), 0.0, series)[int(fits.argmin())]
        raise out_of_range(seen[np.abs(seen).max(axis=1).argmax()])


def _singular(p: FloatArray, covariance: FloatArray, y: FloatArray) -> NotPositiveDefiniteError:
    """Say at which node what is there of an observation (q,) has no density.

    Parameters
    ----------
    p : ndarray, shape (M,)
        Probabilities of the nodes.
    covariance : ndarray, shape (M, m + q, m + q)
        Of (X, Y) given each.
    """
    seen = np.flatnonzero(~np.isnan(y)) - y.size  # from the end, where Y stands
    try:
        check_definite(
            covariance[:, seen[:, None], seen],
            lambda k: f"S = H P H' + R at the node {k[0]}",
            strict=True,
            where=p > 0.0,
        )
    except NotPositiveDefiniteError as error:
        return error
    return NotPositiveDefiniteError(_SINGULAR)


#: Interacting multiple models: merged before each step.
IMM = OnNodes("IMM", every_pair=False)

#: Generalised pseudo-Bayes of second order: merged after each pair was updated.
GPB2 = OnNodes("GPB2", every_pair=True)
