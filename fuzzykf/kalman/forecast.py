"""Forecasts of the Kalman filters and their banks: a copy that predicts on and on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import merge_modes
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count
from fuzzykf.kalman.arguments import as_matrix, as_square, as_state
from fuzzykf.kalman.linearization import linearize_observation, observation_functions
from fuzzykf.observations import check_ahead
from fuzzykf.results import FilterResult

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from fuzzykf.arrays import FloatArray

    #: Mean (q,) and covariance (q, q) of the observation that a filter expects.
    Expected = tuple[FloatArray, FloatArray]

__all__ = ["expected_linear", "expected_mixture", "expected_nonlinear", "forecast"]

#: Longest forecast: all of its steps are kept.
MOST_STEPS = 1_000_000


def forecast(
    f: Any,
    steps: int,
    given: Mapping[str, Any],
    moves: Callable[[int], Sequence[Mapping[str, Any]]],
    expected: Callable[[Any, int], Expected | None],
) -> FilterResult:
    """Move a copy of a filter ahead, and collect what it expects.

    Parameters
    ----------
    f : Filter
        It stays where it is.
    steps : int
    given : mapping of str to object
        What has a value for each step, by the names of the arguments.
    moves : callable
        Of the checked number of steps; returns the keyword arguments of `predict` at each.
    expected : callable
        Of the copy after its prediction and the number of the step: mean and covariance of the
        observation, or None if nobody knows how it comes about.
    """
    steps = as_count("steps", steps, 1, MOST_STEPS)
    index = f._index_ahead(steps)
    check_ahead(index, steps, given)
    rows, observations = [], []
    with f._lent() as ahead:
        for k, arguments in enumerate(moves(steps)):
            ahead.predict(**arguments)
            rows.append((np.array(ahead.x, dtype=np.float64).ravel(), np.array(ahead.P, dtype=np.float64)))
            observations.append(expected(ahead, k))
    x, P = (np.array(column) for column in zip(*rows, strict=True))
    known = [one for one in observations if one is not None]
    if len(known) < steps:
        return FilterResult(x=x, P=P, index=index)
    z_prior, S = (np.array(column) for column in zip(*known, strict=True))
    return FilterResult(x=x, P=P, z_prior=z_prior, S=S, index=index)


def expected_linear(f: Any, _step: int = 0) -> Expected:
    """Return H x and H P H' + R."""
    n = np.size(f.x)
    H = as_matrix("H", f.H, (f.dim_z, n))
    S = H @ as_square("P", f.P, n) @ H.T + as_square("R", f.R, f.dim_z)
    return H @ np.ravel(as_state(f.x, n)), 0.5 * (S + S.T)


def expected_nonlinear(f: Any, arguments: Mapping[str, Any]) -> Expected | None:
    """Return h(x) and H P H' + R with H the Jacobian of h at x; None if the filter has no h."""
    if f.hx is None:
        if arguments:
            raise ParameterError(f"hx: got the arguments {', '.join(arguments)}, but the filter has no hx")
        return None
    x = as_state(f.x, f.dim_x)
    functions = observation_functions((f.hx, f.HJacobian), (None, None), x.shape, (), (), arguments)
    z, H = linearize_observation(*functions, x, f.residual)
    S = H @ as_square("P", f.P, f.dim_x) @ H.T + as_square("R", f.R, z.size)
    return z.ravel(), 0.5 * (S + S.T)


def expected_mixture(filters: Sequence[Any], weights: FloatArray) -> Expected | None:
    """Return mean and covariance of what the members of a bank expect; None if one cannot say."""
    found = [_expected(f) for f in filters]
    known = [one for one in found if one is not None]
    if len(known) < len(found):
        return None
    means, covariances = (np.array(column) for column in zip(*known, strict=True))
    merged: Expected = merge_modes(weights, means, covariances)
    return merged


def _expected(f: Any) -> Expected | None:
    """Return what one member expects, if it says how: by h and its Jacobian, or by a matrix H."""
    if all(hasattr(f, name) for name in ("hx", "HJacobian", "residual")):
        return expected_nonlinear(f, {})
    return expected_linear(f) if all(hasattr(f, name) for name in ("H", "R", "dim_z")) else None
