"""From series of observations to the parameters of a Kalman filter under which they are likeliest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.estimation.free import read_free
from fuzzykf.estimation.result import maximum_likelihood
from fuzzykf.gaussian import as_flag
from fuzzykf.kalman.arguments import as_covariance, as_matrix
from fuzzykf.kalman.controls import (
    check_rows,
    control_matrix,
    control_width,
    read_controls,
    takes_columns,
)
from fuzzykf.kalman.learning.problem import LinearProblem, VerbProblem, place
from fuzzykf.kalman.linear_series import model_of
from fuzzykf.many import ManySeries, read_many
from fuzzykf.observations import as_observations, check_aligned, index_of
from fuzzykf.progress import progress_bar
from fuzzykf.sequel import warn_of_steps

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.estimation.free import FreeNumbers
    from fuzzykf.estimation.result import LikelihoodFit
    from fuzzykf.kalman.gaussian_filter import GaussianFilter
    from fuzzykf.kalman.learning.problem import Problem

__all__ = ["fit_filter"]

#: What is free unless somebody says.
USUAL = {"Q": "full", "R": "diagonal"}


def fit_filter(
    f: Any,
    zs: Any,
    *,
    free: Mapping[str, Any] | None,
    us: Any = None,
    progress: bool | None = None,
    fx_args: Any = None,
    hx_args: Any = None,
    **options: Any,
) -> LikelihoodFit[Any]:
    """See `KalmanFilter.fit` and `ExtendedKalmanFilter.fit`."""
    if progress is not None:
        progress = as_flag("progress", progress)
    if not f._follows_copies():
        f.copy()  # says why there is none, before the work
    given = {"fx_args": fx_args, "hx_args": hx_args}
    many = _read(zs, f.dim_z, us, given)
    if np.isnan(many.values).all():
        raise ParameterError(f"zs: got {many.values.shape[1]} rows without an observation, expected some")
    if getattr(f, "alpha", 1.0) != 1.0:
        raise ParameterError(
            f"alpha: got {f.alpha}, expected 1; a filter that forgets has no likelihood of its own"
        )
    problem = _problem(f, many, us, given, USUAL if free is None else free)
    learn = _Learn(f, int((~np.isnan(many.values)).any(axis=-1).sum()))
    with progress_bar(None, progress) as tell:
        iterations = count(1)
        return learn(problem, tick=lambda: tell(f"learning, {next(iterations)} iterations"), **options)


@dataclass(frozen=True)
class _Learn:
    """Learns a filter; a class, since closures cannot be pickled."""

    filter: GaussianFilter
    n_observations: int

    def __call__(self, problem: Problem, **options: Any) -> LikelihoodFit[Any]:
        prepare = options.pop("prepare", problem.prepared)
        found = maximum_likelihood(
            problem.log_likelihood,
            problem.free,
            partial(_built, self.filter),
            self.n_observations,
            prepare=prepare,
            **options,
        )
        options = {name: options[name] for name in ("max_iter", "tolerance") if name in options}
        return replace(found, replicate=_Replicate(self, problem, found.numbers, options))


@dataclass(frozen=True)
class _Replicate:
    """Draws series from what was learned, and learns from them."""

    learn: _Learn
    problem: Problem
    numbers: FloatArray
    options: Mapping[str, Any]

    def __call__(self, rng: np.random.Generator) -> LikelihoodFit[Any]:
        problem = self.problem.simulated(self.numbers, rng)
        begin = np.where(np.isneginf(self.numbers), problem.free.start, self.numbers)
        return self.learn(problem, prepare=partial(_instead, begin), **self.options)


def _instead(begin: FloatArray, _: FloatArray) -> FloatArray:
    return begin


def _built(f: GaussianFilter, values: Mapping[str, FloatArray]) -> GaussianFilter:
    """Return a copy of a filter with these values, which stands before the series."""
    model = f.copy()
    for name in ("_origin", "_sequel"):
        model.__dict__.pop(name, None)
    place(model, values)
    return model


# --------------------------------------------------------------------------- series


def _read(zs: Any, dim_z: int, us: Any, given: Mapping[str, Any]) -> ManySeries:
    """Return one series, or several, side by side."""
    if hasattr(zs, "__iter__") and not hasattr(zs, "__len__") and not hasattr(zs, "to_numpy"):
        zs = list(zs)
    try:
        one = as_observations(zs, dim_z)
    except (ShapeError, ParameterError) as error:
        try:
            many = read_many(zs, dim_z)
        except (ShapeError, ParameterError) as other:
            raise (other if _looks_like_many(zs, dim_z) else error) from None
        check_rows(many, **{name: table for name, table in given.items() if table is not None})
        return many
    if isinstance(us, Mapping):
        raise ParameterError("us: got a mapping, expected the controls of one series")
    check_aligned(zs=zs, us=us, **given)
    if given["fx_args"] is None:
        warn_of_steps(index_of(zs))
    return ManySeries(one[None], index=index_of(zs))


def _looks_like_many(zs: Any, dim_z: int) -> bool:
    """Whether an error should speak of several series: of what is in them."""
    if isinstance(zs, Mapping) or getattr(zs, "ndim", 0) == 3:
        return True
    if not (isinstance(zs, list | tuple) and zs):
        return False
    first = zs[0]
    try:
        return index_of(first) is not None or np.ndim(first) > (0 if dim_z == 1 else 1)
    except ValueError:  # lists of unequal lengths
        return True


def _lengths(many: ManySeries) -> IntArray:
    series, n = many.values.shape[:2]
    return np.full(series, n) if many.lengths is None else many.lengths


# --------------------------------------------------------------------------- problems


def _problem(f: Any, many: ManySeries, us: Any, given: Mapping[str, Any], free: Any) -> Problem:
    """Return the log-likelihood of a filter, by its exact gradient if its verbs are its own."""
    is_linear = hasattr(f, "_is_plain")
    B = control_matrix(f.B, f.dim_x) if us is not None and getattr(f, "fx", None) is None else None
    controls = None
    if B is not None:
        found = read_controls(us, many, B.shape[1]).numbers(many.values.shape[:2], B.shape[1])
        controls = np.nan_to_num(found.values[None] if found.is_shared else found.values)  # beyond an end
    numbers = _free_numbers(f, free, B, controls)
    if is_linear and f._is_plain():
        return LinearProblem(model_of(f), B, many.values, _lengths(many), controls, numbers)
    arguments = [{name: value for name, value in given.items() if value is not None} for _ in many.values]
    if us is not None:
        controls = read_controls(us, many, control_width([f]))
        own = controls.of(slice(None), many.values.shape[:2], takes_columns([f]))
        arguments = [{**one, **more} for one, more in zip(arguments, own, strict=True)]
    series = [one[:n] for one, n in zip(many.values, _lengths(many), strict=True)]
    return VerbProblem(f, series, arguments, numbers)


def _free_numbers(f: Any, free: Any, B: FloatArray | None, us: FloatArray | None) -> FreeNumbers:
    """Return the free numbers of a filter, from its attributes as they are."""
    d, m = f.dim_x, f.dim_z
    x, P = f._state()
    values = {
        "Q": as_covariance("Q", f.Q, d),
        "R": as_covariance("R", f.R, m),
        "x": x.ravel(),
        "P": as_covariance("P", P, d),
    }
    if getattr(f, "fx", None) is None:
        values["F"] = as_matrix("F", f.F, (d, d))
    if hasattr(f, "H"):
        values["H"] = as_matrix("H", f.H, (m, d))
    if B is not None:
        values["B"] = B
    elif isinstance(free, Mapping) and "B" in free:
        raise ParameterError("free: got 'B', but without controls us nothing is known of it")
    state = np.maximum(np.sqrt(np.diagonal(values["P"])), np.sqrt(np.diagonal(values["Q"])))
    sizes = {"x": np.maximum(np.sqrt(np.diagonal(values["P"])), np.abs(values["x"]))}
    if B is not None and us is not None:
        told = np.abs(us).max(axis=tuple(range(us.ndim - 1)), initial=0.0)
        sizes["B"] = np.maximum(state[:, None] / np.where(told > 0.0, told, np.inf), np.abs(B))
    return read_free(free, values, covariances=("Q", "R", "P"), vectors=("x",), sizes=sizes)
