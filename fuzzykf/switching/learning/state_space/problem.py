"""The log-likelihood of a switching state-space model as a function of its free numbers.

It is that of IMM on the nodes.  The engine differentiates it by the parameters at each node, by the
transition matrix and by the law of the first node and state; from there the chain rule leads on: through the
stationary law of the first state, through the mixing of the classes to what was given for each, and through
the tables of the chain to the numbers of the law.

Components of the state that are measured are observations without an error: rows of H that are those of the
identity, without noise.  So the likelihood is the joint one of what was measured and observed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import FuzzykfError, ParameterError
from fuzzykf.estimation.free import FreeNumbers, read_free
from fuzzykf.gaussian import brief
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.law_numbers import ByTables, ChainNumbers
from fuzzykf.switching.learning.state_space.data import SpaceData, SpaceSeries
from fuzzykf.switching.state_space.model import SwitchingStateSpace, chain_on_nodes
from fuzzykf.switching.state_space.space_form import StateSpaceForm
from fuzzykf.switching.state_space.space_system import SpaceSystem
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from fuzzykf.arrays import FloatArray
    from fuzzykf.estimation.blocks import Block

__all__ = ["SpaceProblem", "read_free_numbers"]

COVARIANCES, VECTORS = ("Q", "R", "P0"), ("b", "d", "x0")

#: What may be free, in the order of the constructor.
PARAMETERS = ("F", "H", "Q", "R", "b", "d", "B", "x0", "P0")


def read_free_numbers(model: SwitchingStateSpace, free: Any, n_nodes: int, data: SpaceData) -> FreeNumbers:
    """Return the free numbers of a model, whose changes are large or small beside the data.

    Raises
    ------
    ParameterError, ShapeError, NotPositiveDefiniteError
        As `SwitchingStateSpace.fit` says.
    """
    known = [*PARAMETERS, "law"]
    if not isinstance(free, Mapping) or not free:
        raise ParameterError(
            f"free: got {brief(free)}, expected a dict of what is to be learned, of {listed(known)}"
        )
    held = model.form.parameters
    for key, what in free.items():
        if key not in known:
            raise ParameterError(f"free: got {brief(key)}, expected one of {listed(known)}")
        if key == "law":
            if what is not True:
                raise ParameterError(f"free['law']: got {brief(what)}, expected True")
        elif key not in held:
            why = "there are no controls" if key == "B" else "the first state has its stationary law"
            raise ParameterError(
                f"free: got {key!r}, but the model has no {key}: {why}; give it one to start"
            )
        elif held[key].function is not None:
            raise ParameterError(
                f"free: got {key!r}, which is a function of the class weights in this model, expected an "
                "array, or one for each class"
            )
    values = {
        name: one.values if len(one.values) > 1 else one.values[0]
        for name, one in held.items()
        if one.function is None
    }
    arrays = {key: what for key, what in free.items() if key != "law"}
    blocks: dict[str, Block] = {}
    if arrays:
        sizes = _sizes(model.dim_x, values, data)
        blocks |= read_free(arrays, values, covariances=COVARIANCES, vectors=VECTORS, sizes=sizes).blocks
    if "law" in free:
        law = model.law
        blocks["law"] = ChainNumbers(law) if isinstance(law, SwitchChain) else law.free_numbers(n_nodes)
    return FreeNumbers({key: blocks[key] for key in free})


def _sizes(m: int, values: dict[str, FloatArray], data: SpaceData) -> dict[str, FloatArray]:
    """Return how large offsets, starts and gains may be, in the units of what they belong to."""
    c = data.measured.size
    seen = _size(one.ys[:, c:] for one in data.series)
    state = np.zeros(m)
    for name in ("Q", "P0"):
        if name in values:
            variances = np.diagonal(values[name], axis1=-2, axis2=-1)
            state = np.maximum(state, np.sqrt(variances).reshape(-1, state.size).max(axis=0))
    if c:
        state[data.measured] = np.maximum(state[data.measured], _size(one.ys[:, :c] for one in data.series))
    known = {"d": seen, "b": state, "x0": state}
    controls = [one.us for one in data.series if one.us is not None]
    if controls and "B" in values:
        told = _size(controls)
        known["B"] = state[:, None] / np.where(told > 0.0, told, np.inf)
    return {name: np.maximum(size, np.abs(values[name])) for name, size in known.items() if name in values}


def _size(parts: Iterable[FloatArray]) -> FloatArray:
    """Root mean squares of columns, 0 of what is never seen."""
    rows = np.concatenate([*parts])
    largest = np.nanmax(np.abs(rows), axis=0, initial=0.0)
    unit = np.where(largest > 0.0, largest, 1.0)
    there = np.maximum((~np.isnan(rows)).sum(axis=0), 1)
    size: FloatArray = unit * np.sqrt(np.nansum((rows / unit) ** 2, axis=0) / there)
    return size


class SpaceProblem:
    """A model, what is free of it, and series.

    Parameters
    ----------
    model : SwitchingStateSpace
        Whose parameters are held where they are not free.
    n_nodes : int
    data : SpaceData
    free : FreeNumbers
        Of parameters by their names, and of ``law``.
    """

    def __init__(self, model: SwitchingStateSpace, n_nodes: int, data: SpaceData, free: FreeNumbers) -> None:
        self.model, self.n_nodes, self.data, self.free = model, n_nodes, data, free
        self._given = {
            name: one.function or (one.values if len(one.values) > 1 else one.values[0])
            for name, one in model.form.parameters.items()
        }

    def model_of(self, values: Mapping[str, Any]) -> SwitchingStateSpace:
        """Return the model with these values of what is free."""
        law, given = self._parts(values)
        initial = None if isinstance(law, SwitchChain) else self.model.initial
        made = SwitchingStateSpace(law, **given, initial=initial, mix=self._mix)
        return made._with_labels(self.model.labels)

    @property
    def _mix(self) -> Any:
        return self.model.form.mix

    def _parts(self, values: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        arrays = {name: value for name, value in values.items() if name != "law"}
        return values.get("law", self.model.law), self._given | arrays

    def _placed(self, values: Mapping[str, Any]) -> SpaceSystem:
        law, given = self._parts(values)
        initial = None if isinstance(law, SwitchChain) else self.model.initial
        chain = chain_on_nodes(law, initial, self.n_nodes)
        return SpaceSystem(chain, StateSpaceForm(chain, **given, mix=self._mix))

    # ------------------------------------------------------------------ the engine

    def _kernels(self, system: SpaceSystem) -> Iterator[tuple[Any, SpaceSeries]]:
        """Return the kernel of each series, with rows for what is measured."""
        F, b, Q, H, d, R = system.tables.space
        measured, (q, m) = self.data.measured, H.shape[-2:]
        c, M = len(measured), len(system.chain)
        if c:
            rows = np.broadcast_to(np.eye(m)[measured], (1, 1, M, c, m))
            noise = np.zeros((1, 1, M, c + q, c + q))
            noise[..., c:, c:] = R
            H, d, R = np.concatenate([rows, H], axis=-2), np.pad(d, [(0, 0)] * 3 + [(c, 0)]), noise
        kernel = None
        for one in self.data.series:
            own = b
            if one.us is not None and system.B is not None:
                own = b + np.einsum("mak,nk->nma", system.B, one.us)
                kernel = None
            if kernel is None:
                space = engine.NodeSpace(F, own, Q, H, d, R)
                kernel = engine.pack_nodes(space, system.tables.log_transition)
            yield kernel, one
            if one.us is not None:
                kernel = None

    def scored(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Return the log-likelihood of all series, and its gradient.

        Raises
        ------
        FuzzykfError
            If there is no model of these numbers.
        numpy.linalg.LinAlgError
            If the covariance of an observation is singular.
        """
        system = self._placed(self.free.values(numbers))
        total, c = 0.0, len(self.data.measured)
        sums: dict[str, Any] = dict.fromkeys((*"FbQHdR", "initial", "transition", "mean", "covariance"), 0.0)
        if system.B is not None:
            sums["B"] = np.zeros(system.B.shape)
        for kernel, one in self._kernels(system):
            found = engine.node_gradient(kernel, system.first.table, one.ys)
            total += found.log_likelihood
            for name, by in found.space._asdict().items():
                sums[name] += by.sum(axis=(0, 1))
            if one.us is not None and "B" in sums:
                sums["B"] += np.einsum("nma,nk->mak", found.space.b[0], one.us)
            for name, by in (
                ("initial", found.probability),
                ("transition", found.transition),
                ("mean", found.mean),
                ("covariance", found.covariance),
            ):
                sums[name] += by
        if not np.isfinite(total):
            return -np.inf, np.full(numbers.shape, np.nan)
        sums["H"], sums["d"], sums["R"] = sums["H"][:, c:], sums["d"][:, c:], sums["R"][:, c:, c:]
        return total, self.free.gradient(numbers, self._by_values(system, sums))

    def _by_values(self, system: SpaceSystem, sums: dict[str, Any]) -> dict[str, Any]:
        """Return the gradients by what is free, from those at the nodes."""
        chain, form = system.chain, system.form
        assert isinstance(form, StateSpaceForm)
        first = form.pull_back(chain, sums["mean"], sums["covariance"])
        by_nodes = sums | {name: sums.get(name, 0.0) + one for name, one in first.values.items()}
        there = chain.reachable
        found: dict[str, Any] = {}
        for name in self.free.blocks:
            if name == "law":
                by_initial = sums["initial"] + first.initial
                if self.model.initial is not None and not isinstance(self.model.law, SwitchChain):
                    by_initial = np.zeros(len(chain))  # given: it does not move with the law
                found[name] = ByTables(chain, by_initial, sums["transition"] + first.transition)
                continue
            parameter = form.parameters[name]
            by = parameter.pull_back(chain.class_weights[there], by_nodes[name][there])
            found[name] = by if len(parameter.values) > 1 else by[0]
        return found

    def log_likelihood(self, numbers: FloatArray) -> tuple[float, FloatArray]:
        """Return the log-likelihood, minus infinity where there is none, and its gradient."""
        try:
            with np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore"):
                return self.scored(numbers)
        except (FuzzykfError, ArithmeticError, np.linalg.LinAlgError):
            return -np.inf, np.full(numbers.shape, np.nan)

    def check_start(self) -> None:
        """Raise an error that says what is wrong, if there is no log-likelihood at the start."""
        try:
            self.scored(self.free.start)
        except np.linalg.LinAlgError as error:
            if len(self.data.measured):
                raise ParameterError(
                    "xs: got measured states of which some follow, in this model, from others and from the "
                    "observations without an error, so that they have no density; expected noise in them (Q "
                    "or R), or fewer measured components"
                ) from error
            raise ParameterError(
                "R: got a model in which some of what is observed follows from the rest without an error, so "
                "that it has no density; expected noise in each observation"
            ) from error

    # ------------------------------------------------------------------ what else is asked

    def visits(self, numbers: FloatArray) -> FloatArray:
        """Return how many steps are expected in each class, (K,), each given the observations up to then."""
        system = self._placed(self.free.values(numbers))
        M = len(system.chain)
        order = np.array([np.arange(M), np.full(M, 2)])  # an estimate of the switch is not asked for
        switch = np.arange(M, dtype=np.float64), np.ones(M), np.ones(M, dtype=bool), order
        mass = np.zeros(M)
        for kernel, one in self._kernels(system):
            out = {"mu": np.empty((1, len(one.ys), M)), "log_likelihood": np.empty((1, len(one.ys)))}
            engine.filter_nodes(kernel, False, system.first.table[None], True, one.ys[None], out, switch)
            mass += out["mu"][0].sum(axis=0)
        steps: FloatArray = mass @ system.chain.class_weights
        return steps

    def simulated(self, numbers: FloatArray, rng: np.random.Generator) -> SpaceProblem:
        """Return the problem with series drawn from the model of these numbers, with the same gaps."""
        model, series = self.model_of(self.free.values(numbers)), []
        for ys, us in self.data.series:
            truth = model.simulate(len(ys), rng, self.n_nodes, us)
            drawn = np.concatenate([truth.x[:, self.data.measured], truth.y], axis=1)
            drawn[np.isnan(ys)] = np.nan
            series.append(SpaceSeries(drawn, us))
        return SpaceProblem(self.model, self.n_nodes, SpaceData(tuple(series), self.data.measured), self.free)
