"""The verbs of filters, with the kinds of their arguments."""

from __future__ import annotations

import numpy as np
import specimens
from calls_arguments import (
    Kind,
    array,
    choice,
    count,
    covariance,
    fixed,
    listed,
    maybe,
    observation,
    probabilities,
    real,
    series,
    stochastic,
)
from calls_verbs import Verb, assign, verb

__all__ = [
    "KINDS_OF_NODES",
    "bank_verbs",
    "extended_verbs",
    "kalman_verbs",
    "known_verbs",
    "possibility_verbs",
    "switching_verbs",
]


KEEP = maybe(choice("x", ["x", "P"], ("log_likelihood",), ["mu"], [], ["nonsense"]))
KINDS_OF_NODES = choice("cell", "midpoint", "gauss", "product")


def common(q: int, **extra: Kind) -> list[Verb]:
    """Return the verbs of every filter; ``extra`` is needed beside the data."""
    many = Kind(lambda rng: rng.normal(size=(rng.integers(1, 4), rng.integers(0, 5), q)))
    return [
        *[verb("step", z=observation(q), **{k: v for k, v in extra.items() if k == "u"})] * 3,
        *[verb("update", z=observation(q))] * 2,
        *[verb("filter", zs=series(q), **extra)] * 2,
        verb("batch_filter", zs=series(q, 1), **extra),
        verb("filter_many", zs=many, keep=KEEP),
        verb("reset"),
        verb("copy"),
    ]


def switching_verbs(q: int) -> list[Verb]:
    """Return the verbs of a filter with a hidden switch."""
    return [
        *common(q),
        verb("predict"),
        verb("smooth", zs=series(q), keep_nodes=maybe(choice(True, False))),
        verb("filter", zs=series(q), keep_nodes=choice(True, False)),
        verb("forecast", steps=count(1, 5)),
        verb("filter_many", zs=array(2, 3, q), threads=count(1, 2)),
        verb("save", path=fixed("file:filter.json")),
        verb("to_dict"),
    ]


def known_verbs(q: int) -> list[Verb]:
    """Return the verbs of a filter with a known switch."""
    r, rs = maybe(choice(0.0, 1.0, 1)), choice(np.zeros(4), np.array([0.0, 1.0, 1.0, 0.0]))
    return [
        *[verb("step", z=observation(q), r=r)] * 3,
        verb("predict", r=r),
        verb("update", z=observation(q), r=r),
        *[verb(name, zs=series(q, 4, 4), r=rs) for name in ("filter", "smooth", "batch_filter")],
        verb("filter_many", zs=array(2, 4, q), keep=KEEP, r=rs),
        verb("forecast", steps=count(1, 5)),
        verb("reset"),
    ]


def kalman_verbs(q: int) -> list[Verb]:
    """Return the verbs of a Kalman filter of two components."""
    u, F, H, B = maybe(array(1, 1)), array(2, 2), array(q, 2), array(2, 1)
    Q, R = covariance(2), covariance(q)
    per_step = [maybe(listed(kind, 4, 4)) for kind in (F, Q, H, R, B, array(1, 1))]
    names = ("Fs", "Qs", "Hs", "Rs", "Bs", "us")
    return [
        *common(q),
        *[verb("predict", u=u, B=maybe(B), F=maybe(F), Q=maybe(Q))] * 2,
        verb("update", z=observation(q), R=maybe(R), H=maybe(H)),
        verb("update_correlated", z=observation(q), R=maybe(R), H=maybe(H)),
        verb(
            "update_sequential",
            start=count(0, q - 1),
            z_i=array(1),
            R_i=maybe(covariance(1)),
            H_i=maybe(array(1, 2)),
        ),
        verb("predict_steadystate", u=u, B=maybe(B)),
        verb("update_steadystate", z=observation(q)),
        verb("get_prediction", u=u, B=maybe(B), F=maybe(F), Q=maybe(Q)),
        verb("get_update", z=observation(q)),
        verb("log_likelihood_of", infinite=True, z=observation(q)),
        verb("measurement_of_state", x=array(2, 1)),
        verb("residual_of", z=array(q, 1)),
        verb("test_matrix_dimensions", z=maybe(array(q, 1)), H=maybe(H), R=maybe(R), F=maybe(F), Q=maybe(Q)),
        verb("smooth", zs=series(q), us=maybe(fixed(None))),
        verb("filter", zs=series(q, 4, 4), us=listed(array(1, 1), 4, 4)),
        verb("filter_many", zs=array(2, 4, q), us=maybe(array(4, 1))),
        verb(
            "rts_smoother",
            Xs=array(4, 2, 1),
            Ps=covariance(4, 2),
            Fs=maybe(listed(F, 4, 4)),
            Qs=maybe(listed(Q, 4, 4)),
        ),
        verb(
            "batch_filter",
            zs=series(q, 4, 4),
            update_first=maybe(choice(True, False)),
            **dict(zip(names, per_step, strict=True)),
        ),
        *[
            assign(name, kind)
            for name, kind in zip("xPFQRHB", (array(2, 1), covariance(2), F, Q, R, H, B), strict=True)
        ],
        assign("alpha", real(1.0, 1.2)),
    ]


def extended_verbs() -> list[Verb]:
    """Return the verbs of an extended Kalman filter."""
    see = {"HJacobian": maybe(fixed(specimens.distance_jacobian)), "Hx": maybe(fixed(specimens.distance))}
    return [
        *common(1),
        verb("predict", u=maybe(real(-1, 1))),
        verb("predict_x", u=maybe(real(-1, 1))),
        verb("update", z=observation(1), R=maybe(covariance(1)), residual=maybe(fixed(np.subtract)), **see),
        verb("predict_update", z=observation(1), args=maybe(fixed(())), u=maybe(real(-1, 1)), **see),
        verb("filter", zs=series(1, 3, 3), us=maybe(array(3)), hx_args=maybe(fixed([{}, None, {}]))),
        verb("smooth", zs=series(1)),
        *[
            assign(name, kind)
            for name, kind in zip(
                "xPQR", (array(2, 1), covariance(2), covariance(2), covariance(1)), strict=True
            )
        ],
    ]


def bank_verbs() -> list[Verb]:
    """Return the verbs of a bank of filters."""
    u = array(1, 1)
    return [
        *common(1),
        verb("predict", u=maybe(u)),
        verb("filter", zs=series(1, 3, 3), us=listed(u, 3, 3)),
        assign("mu", probabilities(2)),
        assign("M", stochastic(2)),
        assign("x", array(2, 1)),
    ]


def possibility_verbs(noise: Kind) -> list[Verb]:
    """Return the verbs of a possibilistic estimator."""
    return [
        *common(1),
        verb("predict", u=maybe(fixed(None)), Q=maybe(covariance(1)), F=maybe(array(1, 1))),
        verb("update", z=observation(1), R=maybe(covariance(1)), H=maybe(array(1, 1))),
        verb("smooth", zs=series(1)),
        verb("defuzzify", method=choice("centroid", "mean_of_maximum", "peak")),
        *[assign(name, noise) for name in ("membership", "process_noise", "measurement_noise")],
        *[assign(name, kind) for name, kind in zip("xPQR", (array(1, 1), *[covariance(1)] * 3), strict=True)],
    ]
