"""How a switching filter looks back: over a whole series, or over its latest states."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from fuzzykf.base import as_observations, index_of
from fuzzykf.errors import ParameterError
from fuzzykf.fixed_lag import over_windows
from fuzzykf.gaussian import as_flag
from fuzzykf.sequel import warn_of_steps
from fuzzykf.switching.inference.method import Known, Method, Smoothed
from fuzzykf.switching.inference.series import FOUND, check_explained, smoothed_result

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

    from fuzzykf.arrays import FloatArray
    from fuzzykf.fixed_lag import Nodes
    from fuzzykf.results import FilterResult
    from fuzzykf.switching.inference.series import Trajectory

__all__ = ["SwitchingWayBack", "smooth_series", "smooth_trajectory"]


class SwitchingWayBack:
    """The `fuzzykf.fixed_lag.WayBack` of a switching filter.

    Parameters
    ----------
    f : SwitchingFilter

    Raises
    ------
    ParameterError
        If its method cannot look back.
    """

    def __init__(self, f: Any) -> None:
        if getattr(type(f._method), "look_back", Method.look_back) is Method.look_back:
            raise ParameterError(
                f"f: got a {type(f).__name__} by the method {f._method!r}, which cannot look back; expected "
                "a method that has known_along and look_back"
            )
        self.filter = f

    def standing(self) -> Any:
        """Return how many observations were taken, and whether the filter has predicted since."""
        return self.filter._n, self.filter._predicted and self.filter._n > 0

    def unchanged_on_error(self) -> AbstractContextManager[None]:
        """Return a context that puts the state back."""
        found: AbstractContextManager[None] = self.filter._as_it_was_on_error()
        return found

    def step(self, z: Any, told: dict[str, Any]) -> Known:
        """Do a step; ``told`` are the arguments of `step` beside the observation."""
        f, n = self.filter, self.filter._n + (self.filter._predicted and self.filter._n > 0)
        f.step(z, **told)
        if f._n != n + 1 or f._predicted or f._mixture is None:
            raise ParameterError(
                f"step: this {type(f).__name__} has taken {f._n - n} observations in place of one; the "
                "way back knows of no other motion: let predict and update do no more than pass on other "
                "observations"
            )
        return Known(f._mixture, None if f._before is None else f._before.tables, f._z.copy())

    def look_back(self, states: Sequence[Known]) -> Nodes:
        """Go back over some states in a row by the method of the filter."""
        found: Nodes = self.filter._method.look_back(self.filter._system, states)
        return found


def smooth_trajectory(
    method: Any, system: Any, trajectory: Trajectory, ys: FloatArray, lag: int | None, **options: Any
) -> Smoothed:
    """Estimate every state of a filtered series from all of it, or from what came ``lag`` steps later."""
    if lag is None or not len(ys):
        found: Smoothed = method.smooth(system, trajectory, ys, **options)
        return found if lag is None else found._replace(path=None)
    states = method.known_along(system, trajectory, ys)
    return Smoothed(*over_windows(partial(method.look_back, system, **options), states, lag), None)


def smooth_series(f: Any, zs: Any, keep_nodes: Any, lag: int | None = None) -> FilterResult:
    """Do `SwitchingFilter.smooth`, or with a lag `SwitchingFilter.smooth_lag`, whose parameters these are."""
    zs = f._named(zs)
    ys, index = as_observations(zs, f.dim_z), index_of(zs)
    keep_nodes = as_flag("keep_nodes", keep_nodes)
    with f._as_it_was_on_error():
        walked = None
        if not f._is_plain():
            walked, ys = f._by_verbs(ys)
        fields = ("log_likelihood",) if walked is None else FOUND
        trajectory = f._method.run(f._system, ys, fields, states=True)
        if walked is not None:
            check_explained(type(f).__name__, walked, trajectory)
        smoothed = smooth_trajectory(f._method, f._system, trajectory, ys, lag)
        if walked is None:
            f._adopt(trajectory, ys)
    if index is not None:
        f._follow(index)
        warn_of_steps(index)
    result = smoothed_result(f._system.chain, trajectory, smoothed, keep_nodes, index)
    return result.with_coords(zs) if hasattr(zs, "coords") else result
