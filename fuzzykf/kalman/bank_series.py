"""Whole series through a bank of filters, all members at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import filter_bank, filter_bank_many
from fuzzykf.errors import ParameterError
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman.bank import fading, linear_model, member_states
from fuzzykf.kalman.series import empty_fields, field_shapes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["filter_many", "filter_one", "whole_model"]


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
    names: Iterable[str],
) -> dict[str, FloatArray]:
    """Return the fields named for many series (series, n, m).

    ``model`` is `whole_model` of the filters; ``weights`` are the logarithms of mu and M;
    ``every_pair`` filters once for each pair of modes (GPB2).
    """
    xs, Ps = member_states(filters)
    out = empty_fields(names, field_shapes(xs.shape[1], len(xs)), *series.shape[:2])
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            lost = filter_bank_many(xs, Ps, *weights, series, model, every_pair, out)
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    if lost.any():
        raise ParameterError(
            f"zs: series {int(lost.argmax())} has an observation that no mode gives a positive density"
        )
    return out
