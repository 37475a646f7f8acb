"""Whole series through a bank of filters, all members at once."""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf import engine
from fuzzykf.engine.selected import filter_bank, filter_bank_many
from fuzzykf.errors import ParameterError
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman.bank import fading, linear_model, member_states
from fuzzykf.kalman.series import empty_fields, field_shapes
from fuzzykf.many import as_stored, over_threads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["filter_many", "filter_one", "whole_model"]

_DOUBLE = np.dtype(np.float64)

#: How many numbers in double precision are there at once where fewer digits are stored.
BLOCK = 1 << 20


def whole_model(filters: Sequence[Any]) -> dict[str, FloatArray] | None:
    """Stack all that plain Kalman filters of one shape are made of, (K, ...); None for any others."""
    model = linear_model(filters, ("F", "Q", "H", "R"))
    return None if model is None else model | {"alpha_sq": np.asarray(fading(filters))}


def filter_one(
    filters: Sequence[Any], series: FloatArray, weights: tuple[FloatArray, FloatArray], every_pair: bool
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]] | None:
    """Do predict and update for a series (n, m).

    ``weights`` are the logarithms of mu and M; ``every_pair`` filters once for each pair of modes (GPB2).

    Returns
    -------
    stored : dict of ndarray
        What a bank can tell about a series.
    state : dict of ndarray
        What is left of it, see `fuzzykf.engine.numpy.imm.filter_bank`.
        None instead of both if the filters are not alike, or one of them fails.
    """
    model = whole_model(filters)
    if model is None:
        return None
    xs, Ps = member_states(filters)
    shapes = field_shapes(xs.shape[1], len(xs))
    stored = empty_fields(shapes, shapes, len(series))
    state = filter_bank(xs, Ps, *weights, series, model, every_pair, stored)
    return None if state is None else (stored, state)


def filter_many(
    filters: Sequence[Any],
    model: dict[str, FloatArray],
    series: FloatArray,
    weights: tuple[FloatArray, FloatArray],
    every_pair: bool,
    names: Sequence[str],
    dtype: np.dtype[Any] = _DOUBLE,
    threads: int = 1,
) -> dict[str, FloatArray]:
    """Return the fields named for many series (series, n, m), as numbers of this type.

    ``model`` is `whole_model` of the filters; ``weights`` are the logarithms of mu and M;
    ``every_pair`` filters once for each pair of modes (GPB2).
    ``threads`` share the series in the compiled engine.
    """
    threads = threads if engine.info().name == "compiled" else 1  # NumPy keeps its lock
    xs, Ps = member_states(filters)
    shapes, (s, n) = field_shapes(xs.shape[1], len(xs)), series.shape[:2]
    out = empty_fields(names, shapes, s, n, dtype=dtype)
    size = n * sum(prod(shapes[name]) for name in names)
    each = max(s, 1) if dtype == _DOUBLE else max(1, BLOCK // max(size, 1))
    for begin in range(0, s, each):
        rows = slice(begin, begin + each)
        part = {name: values[rows] for name, values in out.items()}
        doubles = part if dtype == _DOUBLE else empty_fields(names, shapes, len(series[rows]), n)
        block = series[rows]

        def several(
            mine: slice, block: FloatArray = block, out: dict[str, FloatArray] = doubles
        ) -> np.ndarray:
            own = {name: values[mine] for name, values in out.items()}
            with np.errstate(over="ignore", invalid="ignore"):  # each thread has its own
                return filter_bank_many(xs, Ps, *weights, block[mine], model, every_pair, own)

        try:
            lost = np.concatenate(over_threads(several, len(block), threads))
        except np.linalg.LinAlgError as error:
            raise SingularInnovationError(SINGULAR) from error
        if lost.any():
            which = begin + int(lost.argmax())
            raise ParameterError(
                f"zs: series {which} has an observation that no mode gives a positive density"
            )
        if dtype != _DOUBLE:
            for name, values in as_stored(doubles, dtype).items():
                part[name][...] = values
    return out
