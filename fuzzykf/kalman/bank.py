"""Banks of filters: all members moved or updated at once where they are alike, else one by one."""

from __future__ import annotations

import copy
from math import isnan, log
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import Filter
from fuzzykf.engine.selected import correct_bank, move_bank
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError, as_square, as_state, control_term
from fuzzykf.kalman.extended import ExtendedKalmanFilter
from fuzzykf.kalman.kalman_filter import KalmanFilter
from fuzzykf.kalman.series import unchanged_on_error
from fuzzykf.overrides import follows_copies, is_patched

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.kalman.state_maps import CommonSpace

__all__ = [
    "check_possible",
    "clone",
    "control_terms",
    "fading",
    "linear_model",
    "member_states",
    "predict_members",
    "put_innovations",
    "put_moments",
    "put_state",
    "seen_of",
    "skip_members",
    "update_members",
]


def linear_model(filters: Sequence[Any], names: Sequence[str]) -> dict[str, FloatArray] | None:
    """Stack matrices of the members, (K, ...); None unless all are plain Kalman filters of one shape.

    A subclass may do anything in its verbs, and so may one object with a verb or an ``inv`` of the user's.
    """
    if not all(type(f) is KalmanFilter and f._is_plain() for f in filters):
        return None
    n, m = filters[0].dim_x, filters[0].dim_z
    shapes = {"F": (n, n), "Q": (n, n), "H": (m, n), "R": (m, m)}
    model = {}
    for name in names:
        try:
            stack = np.array([getattr(f, name) for f in filters], dtype=np.float64)
        except (TypeError, ValueError):
            return None
        if stack.shape[1:] != shapes[name]:
            return None
        model[name] = stack
    return model


def fading(filters: Sequence[Any]) -> FloatArray | float:
    """Stack alpha^2 of plain Kalman filters, (K, 1, 1); 1 if no memory fades."""
    values = [f._alpha_sq for f in filters]
    return 1.0 if values == [1.0] * len(values) else np.array(values)[:, None, None]


def member_states(filters: Sequence[Any], space: CommonSpace | None = None) -> tuple[FloatArray, FloatArray]:
    """Stack the states of the members, (K, n) and (K, n, n), in the space that they have in common."""
    if space is not None:
        return space.states(filters)
    n = np.size(filters[0].x)
    try:
        xs = np.array([f.x for f in filters], dtype=np.float64).reshape(-1, n)
        Ps = np.array([f.P for f in filters], dtype=np.float64)
    except ValueError:
        Ps = np.empty(0)
    if Ps.shape == (len(filters), n, n) and len(xs) == len(filters):
        return xs, Ps
    shapes = [np.shape(f.x) for f in filters]
    if any(shape != shapes[0] for shape in shapes):
        unequal = len({np.size(f.x) for f in filters}) > 1
        raise ShapeError(
            f"filters: x has shapes {shapes}, expected the same for all members"
            + (", or state_maps into a common space" if unequal else "")
        )
    xs = np.array([as_state(f.x, n).reshape(n) for f in filters])
    return xs, np.array([as_square(f"filters[{k}].P", f.P, n) for k, f in enumerate(filters)])


def predict_members(
    filters: Sequence[Any], xs: FloatArray, Ps: FloatArray, u: Any, space: CommonSpace | None = None
) -> tuple[FloatArray, FloatArray]:
    """Predict every member from the moments given, and return the predicted moments.

    All are in the common space if there is one; each member moves in its own.

    An error leaves the members as they were; so do all functions of this module.
    """
    model = None if space is not None else linear_model(filters, ("F", "Q"))
    if model is None:
        with unchanged_on_error(*filters):
            for k, (f, x, P) in enumerate(zip(filters, xs, Ps, strict=True)):
                if space is not None:
                    x, P = space.to_member(k, x, P)
                f.x, f.P = x.reshape(np.shape(f.x) or (1, 1)).copy(), P.copy()
                f.predict() if u is None else f.predict(u)
            return member_states(filters, space)
    terms = control_terms(filters, u)
    xs, Ps = move_bank(xs, Ps, model["F"], model["Q"], fading(filters))
    if terms is not None:
        xs = xs + terms
    form = np.shape(filters[0].x) or (1, 1)
    for f, x, P in zip(filters, xs.reshape(len(xs), *form), Ps, strict=True):
        f._set_prior(x, P)
    return xs, Ps


def control_terms(filters: Sequence[Any], u: Any) -> FloatArray | None:
    """Stack B u of plain Kalman filters, (K, n); None if there is no control."""
    if u is None:
        return None
    like = np.reshape(filters[0].x, np.shape(filters[0].x) or (1, 1))
    terms = [np.broadcast_to(control_term(f.B, u, like), like.shape) for f in filters]
    return np.reshape(terms, (len(terms), -1))


def update_members(
    filters: Sequence[Any],
    z: FloatArray,
    log_prior: FloatArray | None = None,
    space: CommonSpace | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update every member with the flat observation z; return log-likelihoods and moments.

    With the logs of the prior weights given, it is an error if z has no density in
    any mode that has a weight.  The moments are in the common space if there is one.
    """
    model = None if space is not None else linear_model(filters, ("H", "R"))
    if model is None:
        with unchanged_on_error(*filters):
            log_likelihood = np.array([_update_member(k, f, z) for k, f in enumerate(filters)])
            check_possible(z, log_likelihood, log_prior)
            return log_likelihood, *member_states(filters, space)
    xs, Ps = member_states(filters)
    try:
        *innovation, xs, Ps, log_likelihood = correct_bank(xs, Ps, z, model["H"], model["R"], seen_of(z))
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    check_possible(z, log_likelihood, log_prior)
    put_innovations(filters, (xs, Ps), z, [*innovation, log_likelihood])
    return log_likelihood, xs, Ps


def seen_of(z: FloatArray) -> np.ndarray | None:
    """Which components of an observation were seen; None if all were."""
    return np.logical_not(np.isnan(z)) if any(map(isnan, z.tolist())) else None


def put_innovations(
    filters: Sequence[Any], moments: Sequence[FloatArray], z: FloatArray, innovation: Sequence[FloatArray]
) -> None:
    """Make an update with the flat observation z that of plain members.

    ``moments`` are xs and Ps, ``innovation`` has y, S, SI, K and the log-likelihood, each with a leading axis
    for the members.
    """
    (xs, Ps), (y, S, SI, K, log_likelihood) = moments, innovation
    column = np.ndim(filters[0].x) != 1
    states, residuals, value = (xs[..., None], y[..., None], z[:, None]) if column else (xs, y, z)
    members = zip(filters, states, Ps, residuals, S, SI, K, log_likelihood.tolist(), strict=True)
    for f, state, P, residual, S_f, SI_f, K_f, log_likelihood_f in members:
        f._set_innovation(state, P, value.copy(), residual, S_f, SI_f, K_f)
        f._log_likelihood = log_likelihood_f


def put_state(filters: Sequence[Any], state: dict[str, FloatArray], z: FloatArray) -> None:
    """Make the state after a series, whose last observation is z, that of plain members."""
    for k, f in enumerate(filters):
        x, P, x_prior, P_prior = (state[name][k] for name in ("xs", "Ps", "xs_prior", "Ps_prior"))
        innovation = tuple(state[name][k] for name in ("y", "S", "SI", "K")) if "y" in state else None
        f._end_series((x_prior, P_prior), (x, P), z, innovation)
        if not np.isnan(z).all():
            f._log_likelihood = float(state["own"][k])


def check_possible(z: FloatArray, log_likelihood: FloatArray, log_prior: FloatArray | None) -> None:
    """Raise an error if all weights vanish."""
    if log_prior is not None and not max((log_likelihood + log_prior).tolist()) > -np.inf:
        raise ParameterError(f"z: got {z.tolist()}, to which no mode gives a positive density")


def _update_member(k: int, f: Any, z: FloatArray) -> float:
    """Update one member of any kind and return its log-likelihood."""
    if isinstance(f, Filter):
        f.update(z)
    elif np.isnan(z).any():
        raise ParameterError(
            f"z: got {z.tolist()}, but filter {k} ({type(f).__module__}.{type(f).__qualname__}) does not "
            "know missing components; expected all of z, or None"
        )
    else:
        f.update(z.copy() if np.ndim(f.x) == 1 else z[:, None].copy())
    if hasattr(f, "log_likelihood"):
        return float(f.log_likelihood)
    likelihood = float(f.likelihood)
    return log(likelihood) if likelihood > 0.0 else -np.inf


def skip_members(filters: Sequence[Any]) -> None:
    """Update every member without an observation."""
    with unchanged_on_error(*filters):
        for f in filters:
            f.update(None)


def put_moments(f: Any, when: str, x: FloatArray, P: FloatArray) -> None:
    """Make x (n,) and P the estimate of one member, and that after the latest "prior" or "post"."""
    x = x.reshape(f.x.shape)
    f.x, f.P = x.copy(), P.copy()
    if hasattr(f, f"x_{when}"):
        setattr(f, f"x_{when}", x.copy())
        setattr(f, f"P_{when}", P.copy())


def clone(f: Any) -> Any:
    """Return a copy whose verbs leave the original alone.

    The verbs of this package write into no array that anybody else holds, so that a
    shallow copy will do; of others nothing is known.

    Raises
    ------
    ParameterError
        If a function that may know the original alone stands in place of a verb.
    """
    if not follows_copies(f):
        raise ParameterError(
            f"filters: a {type(f).__name__} has a function in place of its predict or update, and "
            "method='gpb2' works with copies, on which it need not act; expected a method of the filter: "
            "types.MethodType(function, filter)"
        )
    shallow = type(f) in {KalmanFilter, ExtendedKalmanFilter} and not is_patched(f)
    return copy.copy(f) if shallow else copy.deepcopy(f)
