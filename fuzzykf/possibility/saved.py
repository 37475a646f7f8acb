"""An estimator as plain values of a file, with all it knows, and back bit for bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.io import decode, encode, number, whole
from fuzzykf.possibility.beliefs import BoxBelief, GridBelief, QuadraticBelief
from fuzzykf.possibility.grid.lattice import Lattice, Universe
from fuzzykf.possibility.memberships import IntervalMembership, files
from fuzzykf.reprs import value_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.possibility.norms import TNorm
    from fuzzykf.possibility.protocol import Belief

__all__ = ["from_values", "to_values"]

E = TypeVar("E")

FUNCTIONS = ("fx", "hx", "fx_inverse", "fx_interval", "hx_interval")

#: No grid of a file has more nodes.
MOST_NODES = 1e8

#: What the latest verbs found, besides the belief: matrices (of any number of axes) and numbers.
FOUND = ("x_prior", "P_prior", "x_post", "P_post", "y", "S", "SI", "K")
NUMBERS = ("possibility", "log_likelihood", "likelihood", "mahalanobis")


def to_values(est: Any) -> dict[str, Any]:
    """Return an estimator as plain values.

    Raises
    ------
    ParameterError
        If it, or one of its memberships, holds functions: names them.
    """
    held = [
        f"{name} ({value_text(getattr(est, name))})" for name in FUNCTIONS if getattr(est, name) is not None
    ]
    if held:
        raise ParameterError(
            f"{', '.join(held)}: a file cannot hold functions, as it holds values and never code; expected a "
            "linear model (F, H), or pickle, which keeps functions that can be imported"
        )
    constraint, universe = est._constraint, est._universe
    return {
        "dim_x": est.dim_x,
        "dim_z": est.dim_z,
        "dim_u": est.dim_u,
        "representation": est.representation,
        "t_norm": files.norm_to_values(est.t_norm),
        "t_conorm": est.t_conorm.name,
        "on_empty": est.on_empty,
        "F": _array_to_values(est.F),
        "H": None if est.H is est._blank_H and not np.any(est.H) else _array_to_values(est.H),
        "B": _array_to_values(est.B),
        "process_noise": files.to_values("process_noise", est._process_noise),
        "measurement_noise": files.to_values("measurement_noise", est._measurement_noise),
        "constraint": None if constraint is None else files.to_values("constraint", constraint),
        "universe": None if universe is None else _universe_to_values(universe),
        "belief": _belief_to_values(est._belief),
        "found": {name: _array_to_values(getattr(est, name)) for name in FOUND if hasattr(est, name)},
        "numbers": {name: _finite(getattr(est, name)) for name in NUMBERS if hasattr(est, name)},
        "z": [None if one is None else float(one) for one in np.ravel(est.z)],
    }


def from_values(cls: type[E], values: Mapping[str, Any]) -> E:
    """Make an estimator of a class from what `to_values` returned."""
    dim_x, dim_z = (whole(name, values[name], 1) for name in ("dim_x", "dim_z"))
    t_norm, on_grid = files.norm_from_values(values["t_norm"]), values["universe"] is not None
    universe = _universe_from_values(values["universe"], dim_x) if on_grid else None
    belief = _belief_from_values(values["belief"], dim_x, t_norm, universe)
    make: Any = cls
    est = make(
        dim_x,
        dim_z,
        values["dim_u"],
        state=belief.as_membership(),
        process_noise=files.from_values(values["process_noise"]),
        measurement_noise=files.from_values(values["measurement_noise"]),
        t_norm=t_norm,
        t_conorm=values["t_conorm"],
        on_empty=values["on_empty"],
        points=None if universe is None else list(universe.points),
        F=_array_from_values(values["F"]),
        H=_array_from_values(values["H"]),
        B=_array_from_values(values["B"]),
        constraint=None if values["constraint"] is None else files.from_values(values["constraint"]),
    )
    if est.representation != values["representation"]:
        raise FileFormatError(
            f"representation: got {values['representation']!r}, expected {est.representation!r}"
        )
    # The constructor has checked that they go together; as they were, they are put into its place.
    est._universe, est._belief = universe, belief
    for name, value in values["found"].items():
        _set(est, name, FOUND, _array_from_values(value))
    for name, value in values["numbers"].items():
        _set(est, name, NUMBERS, -np.inf if value is None else number(value))
    z = [None if one is None else number(one) for one in values["z"]]
    missing = None in z
    est.z = np.array(z, dtype=object if missing else np.float64).reshape(dim_z, 1)
    made: E = est
    return made


def _set(est: Any, name: str, known: tuple[str, ...], value: Any) -> None:
    """Set what a verb found, of the shape that it has in a new estimator; a column may be flat."""
    shape = np.shape(getattr(est, name, 0.0))
    flat = shape[:1] if shape[1:] == (1,) else shape
    if name not in known or np.shape(value) not in (shape, flat) or (shape and value is None):
        text = f"of shape {shape}" if name in known else f"one of {', '.join(known)}"
        raise FileFormatError(f"{name}: got {value_text(value)}, expected {text}")
    setattr(est, name, value)


def _finite(value: float) -> float | None:
    return None if np.isinf(value) else float(value)


def _array_to_values(value: Any) -> Any:
    """Return an array of one or two axes as lists, a number as it is."""
    return None if value is None else encode(np.asarray(value, dtype=np.float64))


def _array_from_values(values: Any) -> Any:
    """Return a finite array of one or two axes, or a number."""
    if values is None:
        return None
    if not isinstance(values, list):
        return number(values)
    array = decode(values, 2 if values and isinstance(values[0], list) else 1)
    if not np.isfinite(array).all():
        raise FileFormatError("expected finite numbers")
    return array


# --------------------------------------------------------------------------- the belief


def _belief_to_values(belief: Belief) -> dict[str, Any]:
    if isinstance(belief, QuadraticBelief):
        return {"kind": "quadratic", "family": belief.family, "x": encode(belief.x), "P": encode(belief.P)}
    if isinstance(belief, BoxBelief):
        return {"kind": "box", "lower": encode(belief.box.lower), "upper": encode(belief.box.upper)}
    assert isinstance(belief, GridBelief)
    cost = belief.lattice.cost.ravel()
    return {
        "kind": "grid",
        "axes": [axis.tolist() for axis in belief.lattice.axes],
        "cost": [None if one == np.inf else one for one in cost.tolist()],
    }


def _belief_from_values(
    values: Mapping[str, Any], dim_x: int, t_norm: TNorm, universe: Universe | None
) -> QuadraticBelief | BoxBelief | GridBelief:
    kind = values["kind"]
    if kind == "quadratic":
        x, P = _array_from_values(values["x"]), decode(values["P"], 2)
        if x.shape not in {(dim_x,), (dim_x, 1)} or values["family"] != t_norm.family:
            raise FileFormatError(f"belief: got {value_text(x)} of the family {values['family']!r}")
        return QuadraticBelief(values["family"], x, P)
    if kind == "box":
        return BoxBelief(IntervalMembership(decode(values["lower"], 1), decode(values["upper"], 1)))
    if kind != "grid" or universe is None:
        raise FileFormatError(
            f"belief: got {kind!r}, expected 'quadratic', 'box' or, with a universe, 'grid'"
        )
    axes = tuple(decode(axis, 1) for axis in values["axes"])
    cost = decode(values["cost"], 1)
    cost = np.where(np.isnan(cost), np.inf, cost).reshape([axis.size for axis in axes])
    _check_lattice(axes, cost, t_norm, universe)
    return GridBelief(Lattice(axes, cost, t_norm), universe)


def _check_lattice(axes: tuple[FloatArray, ...], cost: FloatArray, t_norm: TNorm, universe: Universe) -> None:
    """Raise unless costs on axes are those of a belief."""
    for axis, points in zip(axes, universe.points, strict=True):
        steps = np.diff(axis)
        even = (
            np.allclose(steps, steps.mean(), rtol=1e-6, atol=1e-9 * np.abs(axis).max())
            if steps.size
            else True
        )
        if axis.size not in (1, points) or not np.isfinite(axis).all() or (steps <= 0.0).any() or not even:
            raise FileFormatError(f"axes: expected {points} even steps, or one node")
    if not (cost >= 0.0).all() or not (cost < t_norm.impossible).any():
        raise FileFormatError("cost: expected numbers of at least 0, and a state that is possible")


def _universe_to_values(universe: Universe) -> dict[str, Any]:
    return {
        "points": list(universe.points),
        "domain": None if universe.domain is None else universe.domain.tolist(),
        "limit": universe.limit,
        "bounded": universe.bounded,
    }


def _universe_from_values(values: Mapping[str, Any], dim_x: int) -> Universe:
    points = tuple(whole("points", one, 5) for one in values["points"])
    domain, limit, bounded = decode(values["domain"], 2), number(values["limit"]), values["bounded"]
    sound = len(points) == dim_x <= 3 and 0.0 < limit < np.inf and isinstance(bounded, bool)
    sound = sound and float(np.prod(np.array(points, dtype=np.float64))) <= MOST_NODES
    if domain is not None:
        sound = sound and domain.shape == (dim_x, 2) and np.isfinite(domain).all()
        sound = sound and bool((domain[:, 0] < domain[:, 1]).all())
    if not sound:
        raise FileFormatError("universe: expected points and a domain of each component, and a floor")
    return Universe(points, domain, limit, bounded)
