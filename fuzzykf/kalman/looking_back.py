"""How a Kalman filter looks back over its latest states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.base import FilterResult
from fuzzykf.engine.selected import predict_linear
from fuzzykf.fixed_lag import Nodes, as_lag, over_windows
from fuzzykf.kalman import linear_series
from fuzzykf.kalman.arguments import as_matrix, as_square, check_in_range, control_term
from fuzzykf.kalman.series import as_result, unchanged_on_error, whole_verb
from fuzzykf.kalman.smoothing import check_motion, smooth_moments
from fuzzykf.kalman.step_arguments import motion_over, own_matrix, read_series

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fuzzykf.arrays import FloatArray

__all__ = ["LinearWayBack", "smooth_lag"]


class Known(NamedTuple):
    """What a Kalman filter knows after an observation, and how the state came there."""

    x: FloatArray  # (d,)
    P: FloatArray  # (d, d)
    x_prior: FloatArray
    P_prior: FloatArray
    F: FloatArray  # (d, d)
    noise: FloatArray  # (d, d), that of fading memory included


class LinearWayBack:
    """The `fuzzykf.fixed_lag.WayBack` of a Kalman filter.

    Parameters
    ----------
    f : KalmanFilter
    """

    def __init__(self, f: Any) -> None:
        self.filter = f

    def standing(self) -> Any:
        """Return the numbers of x and P."""
        return np.asarray(self.filter.x).tobytes(), np.asarray(self.filter.P).tobytes()

    def unchanged_on_error(self) -> unchanged_on_error:
        """Return a context that puts the attributes back."""
        return unchanged_on_error(self.filter)

    def step(self, z: Any, told: dict[str, Any]) -> Known:
        """Do a step; ``told`` are u, F, Q and dt of `predict`, R and H of `update`."""
        f = self.filter
        d, u = f.dim_x, told.pop("u", None)
        x, P = f._state()
        F, Q, dt = (told.pop(name, None) for name in ("F", "Q", "dt"))
        if dt is not None:
            F, Q = motion_over(f, dt, F, Q)
        if u is F is Q is None and not told and f._is_plain():
            F, Q = own_matrix(f, "F"), own_matrix(f, "Q")
            f.step(z)
        else:
            f.predict(**{name: one for name, one in (("u", u), ("F", F), ("Q", Q)) if one is not None})
            F = as_matrix("F", f.F if F is None else F, (d, d))
            Q = as_square("Q", f.Q if Q is None else Q, d)
            expected, covariance = predict_linear(x, P, F, Q, f._alpha_sq)
            expected = expected + control_term(f.B, u, x)
            check_motion(f, None, expected, covariance, "F, Q, B, alpha and u")
            f.update(z, **told)
        noise = Q if f._alpha_sq == 1.0 else Q + (f._alpha_sq - 1.0) * F.dot(P).dot(F.T)
        return Known(f.x.reshape(d), f.P, f.x_prior.reshape(d), f.P_prior, F.copy(), noise.copy())

    def look_back(self, states: Sequence[Known]) -> Nodes:
        """Go back over some states in a row as Rauch, Tung and Striebel."""
        return look_back(states)


def look_back(states: Sequence[Known]) -> Nodes:
    """Go back over some states in a row, one at least."""
    x, P, x_prior, P_prior, F, noise = map(np.array, zip(*states, strict=True))
    x, P = smooth_moments(x, P, x_prior, P_prior, F, noise, 1.0)
    check_in_range(x=x, P=P)
    return Nodes(np.ones((len(x), 1)), x[:, None], P[:, None])


def smooth_lag(f: Any, zs: Any, lag: Any, told: Mapping[str, Any]) -> FilterResult:
    """Do `KalmanFilter.smooth_lag`; ``told`` are its arguments for the steps."""
    lag = as_lag(lag)
    series, steps = read_series(f, zs, told)
    with whole_verb(f):
        stored, Fs, noise = linear_series.forward_and_motions(f, series, steps)
        x, P = stored["x"], stored["P"]
        if len(series):
            fields = *(stored[name] for name in ("x", "P", "x_prior", "P_prior")), Fs, noise
            states = [Known(*row) for row in zip(*fields, strict=True)]
            x, P = (one[:, 0] for one in over_windows(look_back, states, lag)[1:])
        forward = as_result(f, stored, zs, steps.uneven)
    return FilterResult(
        x=x, P=P, log_likelihood=forward.log_likelihood, index=forward.index, coords=forward.coords
    )
