"""Values of a known switch, as they are told: one, those of a series, or of many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.many import read_many
from fuzzykf.switching.laws.chain import shares_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.many import ManySeries
    from fuzzykf.results import FilterResult
    from fuzzykf.switching.dynamics.model import SwitchingModel

__all__ = [
    "may_be",
    "read_many_and_switches",
    "read_switch",
    "read_switches",
    "unknown_nodes",
    "with_switch",
]


def read_switch(r: Any, model: SwitchingModel) -> Any:
    """Return one value of the switch: a number, or class weights (K,)."""
    K, takes_weights = model.n_classes, model.takes_weights
    value = _of_weights(as_numbers("r", r).copy(), 1, model)
    if takes_weights and value.size == K:
        return model.class_weights(value.reshape(1, -1))[0]
    if value.size != 1:
        weights = f", class weights ({K},) or a class" if takes_weights else ""
        raise ShapeError(f"r: got shape {value.shape}, expected one value of the switch{weights}")
    shares = model.class_weights(value.reshape(1))
    return shares[0] if takes_weights else float(value.reshape(()))


def read_switches(r: ArrayLike, n: int, model: SwitchingModel) -> FloatArray:
    """Return the values of the switch at ``n`` observations: numbers (n,), or class weights (n, K)."""
    values = _of_weights(as_numbers("r", r).copy(), 2, model)
    values = model.class_weights(values) if model.takes_weights else values.reshape(-1)
    if len(values) != n:
        raise ShapeError(f"r: got {len(values)} values, expected {n}, one per observation")
    return values


def read_many_and_switches(
    zs: Any, r: Any, by: Any, model: SwitchingModel, read: Callable[[Any, Any], ManySeries]
) -> tuple[ManySeries, FloatArray]:
    """Return many series, and their switches (series, n), or (series, n, K) where these are weights.

    Parameters
    ----------
    zs, r, by
        As in `KnownSwitchFilter.filter_many`.
    model : SwitchingModel
    read : callable
        Reads observations alone, given ``zs`` and ``by``.
    """
    K, takes_weights = model.n_classes, model.takes_weights
    if by is None or not hasattr(zs, "columns"):
        many = read(zs, by)
        if r is None:
            raise ShapeError(f"r: got nothing, expected the switches, shape {many.values.shape[:2]}")
        if takes_weights and _axes_of_many(r) == 3:
            return many, many.beside("r", r, K)
        return many, many.beside("r", r)[..., 0]
    names = list(r) if takes_weights and isinstance(r, list | tuple) else [r]
    wanted = (1, K) if takes_weights else (1,)
    known = all(isinstance(name, str) and name in zs.columns and name != by for name in names)
    if not known or len(names) not in wanted or len(set(names)) < len(names):
        columns = f"a column of zs, or {K} of class weights" if takes_weights else "a column of zs"
        raise ParameterError(f"r: got {brief(r)}, expected {columns}, as 'by' is given")
    switches = zs[[*([by] if by in zs.columns else []), *names]]  # as named, whatever their order there
    values = read_many(switches, len(names), by).values
    return read(zs.drop(columns=names), by), values if len(names) > 1 else values[..., 0]


def unknown_nodes(model: SwitchingModel) -> FloatArray | None:
    """Return what results have for nodes: none that stays, but class weights (1, K) show their shape."""
    return np.full((1, model.n_classes), np.nan) if model.takes_weights else None


def with_switch(result: FilterResult, r: FloatArray, model: SwitchingModel) -> FilterResult:
    """Return a result with what was told of the switch."""
    mean = None if model.takes_weights else r
    nodes, weights = unknown_nodes(model), model.class_weights(r)
    return replace(result, nodes=nodes, switch=r, switch_mean=mean, class_weights=weights)


def may_be(value: Any, given: Any) -> bool:
    """Whether a value of the switch is the one that was given before, if any was."""
    return given is None or bool(np.array_equal(value, given))


def _of_weights(r: FloatArray, ndim: int, model: SwitchingModel) -> FloatArray:
    """Return values of the switch, where class weights (K,), (n, K), ... with ``ndim`` axes were given.

    Between two classes that is the share of the second, of a hard switch the number of the class.
    """
    K = model.n_classes
    if model.takes_weights or K == 1 or r.ndim != ndim or r.shape[-1] != K:
        return r
    shares: FloatArray = shares_of(np.atleast_2d(r), K).reshape(r.shape)
    if K == 2:
        between: FloatArray = shares[..., 1]
        return between
    number = shares.argmax(axis=-1)
    if (np.take_along_axis(shares, number[..., None], axis=-1) < 1.0).any():
        raise ParameterError(
            f"r: got {brief(r.tolist())}, expected regimes 0 to {K - 1}, or class weights of 0 and 1"
        )
    regime: FloatArray = number.astype(np.float64)
    return regime


def _axes_of_many(r: Any) -> int:
    """Return how many axes the switches of many series have, in any of the forms that series come in."""
    if hasattr(r, "columns"):
        return 2 + (getattr(r.columns, "nlevels", 1) > 1)
    if hasattr(r, "ndim"):
        return int(r.ndim)
    members = list(r.values()) if isinstance(r, Mapping) else r
    if not isinstance(members, list | tuple):
        return 0
    return 1 + (_axes_of_many(members[0]) if members else 0)
