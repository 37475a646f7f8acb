"""The way back of a bank of Kalman filters.

A bank of plain Kalman filters is a state-space model on as many nodes as it has modes, with F, B, Q, H and R
of the mode arrived at.  What it knows of its modes after each observation is smoothed backward by
`fuzzykf.engine.numpy.nodes_backward.smooth_nodes`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import ParameterError
from fuzzykf.fixed_lag import Nodes, over_windows
from fuzzykf.gaussian import as_choice
from fuzzykf.hindsight import warn_of_hindsight
from fuzzykf.kalman import bank
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError, as_matrix, as_square, check_in_range
from fuzzykf.kalman.controls import control_moves
from fuzzykf.kalman.kalman_filter import KalmanFilter
from fuzzykf.kalman.series import (
    as_result,
    empty_fields,
    field_shapes,
    unchanged_on_error,
    whole_verb,
)
from fuzzykf.kalman.smoothing import check_motion
from fuzzykf.observations import as_observations, check_aligned

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.results import FilterResult

__all__ = ["BankWayBack", "Known", "can_look_back", "check_members", "smooth_bank"]


#: By what part of the largest number of its kind what a bank found may differ from what its modes lead to.
_ROUNDING = 1e-6


class Known(NamedTuple):
    """What a bank knows of its modes after an observation, and how they came there."""

    table: FloatArray  # (1 + n + n*n, N): logarithms of mu, means, covariances
    space: engine.NodeSpace  # of the step to it, (1, 1, N, ...)
    z: FloatArray  # (m,): what it took of the observation, NaN where missing


class BankWayBack:
    """The `fuzzykf.fixed_lag.WayBack` of a bank of Kalman filters.

    Parameters
    ----------
    imm : IMMEstimator

    Raises
    ------
    ParameterError
        As from `check_members`.
    """

    def __init__(self, imm: Any) -> None:
        check_members(imm, "FixedLag")
        self.filter = imm

    def standing(self) -> Any:
        """Return the numbers of mu, of x and P of the modes, and whether the bank has predicted."""
        xs, Ps = bank.member_states(self.filter.filters)
        mu = np.asarray(self.filter.mu)
        return mu.tobytes(), xs.tobytes(), Ps.tobytes(), self.filter._log_cbar is None

    def unchanged_on_error(self) -> unchanged_on_error:
        """Return a context that puts the attributes of the bank and of its members back."""
        return unchanged_on_error(self.filter, *self.filter.filters)

    def step(self, z: Any, told: dict[str, Any]) -> Known:
        """Do a step; ``told`` is u of `predict`."""
        imm, u = self.filter, told.pop("u", None)
        check_members(imm, "step")
        before, log_M = _table_of(imm), imm._log_transition()
        if u is None and not told and imm._is_plain():
            space = _space_of(imm.filters)
            imm.step(z)
        else:
            imm.predict(**({} if u is None else {"u": u}))
            space = _space_of(imm.filters, u)
            check_step(imm, None, before, space, log_M)
            imm.update(z, **told)
            return _known(imm, None, before, space, log_M, as_observations([z], imm.dim_z)[0])
        return Known(_table_of(imm), space, as_observations([z], imm.dim_z)[0])

    def look_back(self, states: Sequence[Known]) -> Nodes:
        """Go back over some states in a row."""
        return Nodes(*look_back(states, self.filter._log_transition())[:3])


def smooth_bank(imm: Any, zs: Any, us: Any, weights: Any, lag: int | None = None) -> FilterResult:
    """Do `IMMEstimator.smooth`, or with a lag `IMMEstimator.smooth_lag`, whose parameters these are."""
    by_density = as_choice("weights", weights, ("density", "kim")) == "density"
    check_members(imm, "smooth" if lag is None else "smooth_lag")

    def back(states: Sequence[Known]) -> Nodes:
        return Nodes(*look_back(states, imm._log_transition(), by_density)[:3])

    with whole_verb(imm, *imm.filters):
        stored, states = _forward(imm, zs, us)
        mu, x, P, path = stored["mu"], stored["x"], stored["P"], np.empty(0, dtype=np.intp)
        if states and lag is None:
            mu, xs, Ps, path = look_back(states, imm._log_transition(), by_density)
            x, P = engine.merge_modes(mu, xs, Ps)
        elif states and lag is not None:
            mu, xs, Ps = over_windows(back, states, lag)
            x, P = engine.merge_modes(mu, xs, Ps)
        check_in_range(x=x, P=P)
        forward = as_result(imm, stored, zs)
    modes = np.arange(imm.N, dtype=np.float64)
    smoothed = replace(
        forward,
        **{"x": x, "P": P, "x_prior": None, "P_prior": None, "mu": mu, "nodes": modes},
        **{"switch": modes[mu.argmax(axis=1)], "switch_path": modes[path] if lag is None else None},
    )
    warn_of_hindsight(stored, smoothed, level=4)
    return smoothed


def can_look_back(imm: Any) -> bool:
    """Whether a bank is a state-space model on nodes, see `check_members`."""
    try:
        check_members(imm, "smooth")
    except ParameterError:
        return False
    return True


def check_members(imm: Any, verb: str) -> None:
    """Raise unless a bank is a state-space model on nodes; the way back knows of nothing else.

    Raises
    ------
    ParameterError
        Names the member, and what it is that the model does not have.
    """
    for k, f in enumerate(imm.filters):
        if type(f) is not KalmanFilter:
            raise ParameterError(
                f"{verb}: filters[{k}] is a {type(f).__module__}.{type(f).__qualname__}, expected a "
                "fuzzykf.KalmanFilter: the way back knows linear members alone, and no verbs of a subclass"
            )
        if not f._is_plain():
            raise ParameterError(
                f"{verb}: filters[{k}] has a predict, update or inv of its own, which the way back does not "
                "know; expected those of KalmanFilter"
            )
        if f.alpha != 1.0:
            raise ParameterError(
                f"{verb}: filters[{k}].alpha is {f.alpha}, expected 1: fading memory belongs to no model "
                "on which a bank could look back"
            )
        if imm.state_maps is not None and imm.state_maps[k] is not None:
            raise ParameterError(
                f"{verb}: filters[{k}] has a map in state_maps, expected none: the way back goes through one "
                "space, in which every filter moves"
            )


def look_back(
    states: Sequence[Known], log_transition: FloatArray, by_density: bool = True
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Estimate what a bank knew after some observations in a row from all of them.

    Parameters
    ----------
    states : sequence of n Known
    log_transition : ndarray, shape (N, N)
    by_density : bool
        Whether weights have the density of the next state, and not Kim's.

    Returns
    -------
    mu, xs, Ps : ndarray, shapes (n, N), (n, N, d) and (n, N, d, d)
    path : ndarray of int, shape (n,)
        The most likely one.
    """
    table = np.array([one.table for one in states])
    if len(states) > 1:
        spaces = {id(one.space): one.space for one in states[1:]}  # the step to the first is not gone back
        parts = [*spaces.values()] if len(spaces) == 1 else [one.space for one in states]
        space = engine.NodeSpace(*(np.concatenate(one, axis=1) for one in zip(*parts, strict=True)))
        zs = np.array([one.z for one in states])
        table, path = engine.smooth_nodes(engine.pack_nodes(space, log_transition), table, zs, by_density)
    else:
        path = table[:, 0].argmax(axis=1)
    d = states[0].space.F.shape[-1]
    return np.exp(table[:, 0]), *engine.node_moments(table, d), path


# --------------------------------------------------------------------------- on the way forward


def _forward(imm: Any, zs: Any, us: Any) -> tuple[dict[str, FloatArray], list[Known]]:
    """Filter a series, and keep what is known of the modes after each observation."""
    check_aligned(zs=zs, us=us)
    series = as_observations(zs, imm.dim_z)
    if not (us is None and len(series) and imm._log_cbar is None and imm._is_plain()):
        return _by_verbs(imm, series, control_moves(us, len(series), imm.filters))
    begin, space, log_M = _table_of(imm), _space_of(imm.filters), imm._log_transition()
    stored = imm._collect(series, None)
    out = {"table": np.empty((1, len(series), *begin.shape))}
    modes = np.arange(imm.N)
    ends = np.ones(imm.N, dtype=np.intp)
    ends[-1] = 2
    switch = modes.astype(np.float64), np.ones(imm.N), np.ones(imm.N, dtype=np.bool_), np.array([modes, ends])
    kernel, every_pair = engine.pack_nodes(space, log_M), imm.method != "imm"
    try:
        engine.filter_nodes(kernel, every_pair, begin[None], False, series[None], out, switch)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    return stored, [Known(table, space, z) for table, z in zip(out["table"][0], series, strict=True)]


def _by_verbs(
    imm: Any, series: FloatArray, moves: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, FloatArray], list[Known]]:
    """Filter a series by the verbs, which somebody may have changed; F, B and Q are those of each time."""
    shapes, states = field_shapes(imm.dim_x, imm.N), []
    stored = empty_fields(shapes, shapes, len(series))
    for k, z in enumerate(series):
        before, log_M = _table_of(imm), imm._log_transition()
        imm.predict(**moves[k])
        space = _space_of(imm.filters, moves[k].get("u"))
        check_step(imm, k, before, space, log_M)
        imm.update(z)
        states.append(_known(imm, k, before, space, log_M, z))
        for name, values in stored.items():
            values[k] = np.reshape(getattr(imm, name), shapes[name])
    return stored, states


def check_step(
    imm: Any, k: int | None, before: FloatArray, space: engine.NodeSpace, log_M: FloatArray
) -> None:
    """Refuse to smooth where a predict of somebody else's did something that the way back does not know."""
    found = engine.before_node_step(engine.pack_nodes(space, log_M), before[None])
    mu, xs, Ps = (one[0] for one in found)
    x, P = engine.merge_modes(mu, xs, Ps)
    check_motion(imm, k, x.reshape(imm._form), P, "M and F, Q and B of its filters")
    for j in np.flatnonzero(mu > 0.0):  # the moments of a mode that cannot be are anything
        check_motion(imm.filters[j], k, xs[j].reshape(imm._form), Ps[j], "M and F, Q and B of the bank")


def _known(
    imm: Any, k: int | None, before: FloatArray, space: engine.NodeSpace, log_M: FloatArray, z: FloatArray
) -> Known:
    """Return what a bank knows after an update, which somebody may have changed to take another observation.

    Raises
    ------
    ParameterError
        If it has neither taken the one that reached its filters nor left it out.
    """
    seen = _space_of(imm.filters)  # an update may set H and R
    space = space._replace(H=seen.H, R=seen.R)
    table, kernel = _table_of(imm), engine.pack_nodes(space, log_M)
    reached = as_observations([imm.filters[0].z], imm.dim_z)[0]  # the latest that a filter was given
    for taken in (reached, np.full_like(z, np.nan)):
        try:
            (expected,), _ = engine.node_step(kernel, imm.method != "imm", before[None], taken[None])
        except np.linalg.LinAlgError:
            continue
        if _same(imm, table, expected):
            return Known(table, space, taken)
    step = "" if k is None else f" {k}"
    raise ParameterError(
        f"smooth: update of this {type(imm).__name__} has neither taken observation{step}, {z.tolist()}, as "
        "its filters do with their H and R, nor left it out; the way back knows of nothing else: let update "
        "pass on what it is given or None, or override smooth as well"
    )


def _same(imm: Any, table: FloatArray, expected: FloatArray) -> bool:
    """Whether two tables of a bank say the same of the modes that can be, up to rounding."""
    there = expected[0] > np.log(_ROUNDING)
    same = True
    for rows in (slice(0, 1), slice(1, 1 + imm.dim_x), slice(1 + imm.dim_x, None)):
        got, wanted = (
            np.exp(one[rows]) if rows.start == 0 else one[rows][:, there] for one in (table, expected)
        )
        same &= bool((np.abs(got - wanted) <= _ROUNDING * np.abs(wanted).max(initial=0.0)).all())
    return same


def _table_of(imm: Any) -> FloatArray:
    """Return what a bank knows of its modes now, (1 + n + n*n, N)."""
    xs, Ps = bank.member_states(imm.filters)
    log_mu = imm._log_weights() if imm._log_cbar is None else imm._log_cbar
    return np.concatenate([np.maximum(log_mu, engine.LOG_ZERO)[None], xs.T, Ps.reshape(imm.N, -1).T])


def _space_of(filters: Sequence[Any], u: Any = None) -> engine.NodeSpace:
    """Return what plain Kalman filters say of a step now, (1, 1, N, ...)."""
    n, m = filters[0].dim_x, filters[0].dim_z
    F, H = (
        np.array([as_matrix(f"filters[{k}].{name}", getattr(f, name), shape) for k, f in enumerate(filters)])
        for name, shape in (("F", (n, n)), ("H", (m, n)))
    )
    Q, R = (
        np.array([as_square(f"filters[{k}].{name}", getattr(f, name), size) for k, f in enumerate(filters)])
        for name, size in (("Q", n), ("R", m))
    )
    terms = bank.control_terms(filters, u)
    b = np.zeros((len(filters), n)) if terms is None else terms
    parts = F, b, Q, H, np.zeros((len(filters), m)), R
    return engine.NodeSpace(*(one[None, None] for one in parts))
