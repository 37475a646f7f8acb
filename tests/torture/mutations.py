"""Files that have been tampered with: what can be saved, and how its document or its bytes are changed."""

from __future__ import annotations

import json
import warnings

import numpy as np

from fuzzykf import (
    CauchyMembership,
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FadeLaw,
    FuzzyMarkovLaw,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    OFSRFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import SupportWarning
from fuzzykf.possibility.memberships import JointMembership
from fuzzykf.switching import CGLSSM
from fuzzykf.switching.laws.cells import CellLaw

__all__ = ["changed", "reader", "things", "use"]

LINEAR = {
    "transition": [[0.9, 0.1], [0.2, 0.8]],
    "A": [[[0.9]], [[0.5]]],
    "B": [[[1.0]], [[1.0]]],
    "C": [[[0.3]], [[1.0]]],
    "D": [[[0.5]], [[0.5]]],
}


def covariance_model(law):
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    return CGOFMSModel(law, [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1)


def regressions(K):
    one = np.full((K, K, 1, 1), 0.5)
    parts = {
        "Ayy": one,
        "Ny": one[..., 0],
        "Qyy": one,
        "Axx": one,
        "H": one,
        "G": one,
        "c": one[..., 0],
        "C": one,
    }
    return parts | {"means": np.zeros((K, 2)), "covariances": np.broadcast_to(np.eye(2), (K, 2, 2))}


def possibilistic(state, noise, error, **options):
    """Return an estimator of a state that is not negative, by much."""
    return FuzzyRelationEstimator(
        1,
        1,
        H=1.0,
        state=state,
        process_noise=noise,
        measurement_noise=error,
        constraint=(-0.5, np.inf),
        **options,
    )


def things():
    """Return one of each kind of thing that can be saved, by name."""
    rng = np.random.default_rng(0)
    fmc1, fmc2 = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    fuzzy, banded = covariance_model(fmc1), covariance_model(fmc2)
    free = covariance_model(CellLaw(rng.random((5, 5))))
    hard = CGOMSModel.from_regressions([[0.9, 0.1], [0.2, 0.8]], **regressions(2))
    steady = CGOMSModel.from_cglssm(**LINEAR, order=2)
    moving = CGOMSModel.from_cglssm(**LINEAR, mode="time_varying", initial_probability=[1.0, 0.0])
    fades = FadeLaw.between(10, 4, jump=0.02)
    space = SwitchingStateSpace(fades, F=[[[0.9]], [[0.5]]], H=1.0, Q=0.2, R=0.4, B=[[1.0]], initial=[1, 0])
    found = {
        "fmc1": fuzzy,
        "fmc2": banded,
        "free": free,
        "regressions": CGOFMSModel.from_regressions(fmc1, **regressions(2)),
        "hard": fuzzy.harden(),
        "hard regressions": hard,
        "steady": steady,
        "moving": moving,
        "labelled": fuzzy.labelled(states=["load"], units={"load": "GW"}, step=np.timedelta64(1, "h")),
        "CGLSSM": CGLSSM(**LINEAR),
        "space": space,
        "fresh": OFSRFilter(fuzzy, 3),
    }
    filters = {
        "complete": OFSRFilter(fuzzy, 3, "midpoint"),
        "signed": OFSRFilter(banded, 12, "product"),
        "hard filter": CGOMSMFilter(hard),
        "steady filter": CGOMSMFilter(steady),
        "moving filter": CGOMSMFilter(moving),
        "space filter": SwitchingKalmanFilter(space, method="gpb2", n_nodes=3),
        "estimator": FuzzyRelationEstimator(1, 1, H=1.0, t_norm="hamacher"),
        "box": possibilistic(*[IntervalMembership(-1.0, 1.0)] * 3),
        "grid": possibilistic(
            GaussianMembership(0.0, 1.0),
            GaussianMembership(0.0, 1.0).cut(0.1),
            JointMembership([CauchyMembership(0.0, 1.0)], "product"),
            points=11,
        ),
    }
    for name, f in filters.items():
        f.filter(rng.normal(size=70 if name == "moving filter" else 5))
    gap = CGOMSMFilter(steady)
    gap.filter([0.1, 0.2, np.nan])
    return found | filters | {"gap": gap}


VALUES = (
    None, True, False, 0, 1, -1, 2, 2.7, 7, 10**5, 10**400, -(2**63), 1e308, -1e308, 1e-320,
    "", "text", "1.0", [], [[]], {}, [1.0], [None], {"kind": "fmc1"}, [[1.0, 2.0], [3.0]],
)  # fmt: skip


PIECES = (b"0", b"9", b"-", b"e", b".", b",", b"NaN", b"1e999", b'"')


def places(value, at=()):
    """Yield the way to every part of a document."""
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*at, key)
        if isinstance(part, dict | list):
            yield from places(part, (*at, key))


def at(document, way):
    for key in way:
        document = document[key]
    return document


def change_values(text, rng):
    document = json.loads(text)
    for _ in range(int(rng.integers(1, 4))):
        ways = list(places(document))
        *above, key = ways[rng.integers(len(ways))]
        parent, what = at(document, above), rng.integers(6)
        if what == 0:
            del parent[key]
        elif what == 1:
            parent[key] = json.loads(json.dumps(at(document, ways[rng.integers(len(ways))])))
        elif what == 2 and isinstance(parent[key], int | float):
            parent[key] = parent[key] * float(rng.choice([-1.0, 0.0, 1e-9, 1 + 1e-12, 10.0, 1e9]))
        elif what == 3:
            parent[key] = [parent[key]]
        elif what == 4 and isinstance(parent[key], list) and parent[key]:
            parent[key] = parent[key] + parent[key][:1]
        else:
            parent[key] = VALUES[rng.integers(len(VALUES))]
        if not document:
            break
    return json.dumps(document).encode()


def change_bytes(text, rng):
    content = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 4))):
        start = int(rng.integers(len(content)))
        stop, what = start + int(rng.integers(1, 40)), rng.integers(6)
        if what == 0:
            content[start] ^= 1 << int(rng.integers(8))
        elif what == 1:
            del content[start:stop]
        elif what == 2:
            content[start:start] = content[start:stop]
        elif what == 3:
            content[start:start] = bytes(
                rng.choice([b"0", b"9", b"-", b"e", b".", b",", b"NaN", b"1e999", b'"'])
            )
        elif what == 4:
            content[start:start] = (b"[" if rng.integers(2) else b'{"a":') * int(rng.integers(1, 3000))
        else:
            del content[start:]
        if not content:
            break
    return bytes(content)


def use(thing):
    """Do with it what it is for."""
    if isinstance(thing, CGLSSM):
        thing.simulate(3, np.random.default_rng(0))
        return
    f = thing.filter() if hasattr(thing, "simulate") else thing
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SupportWarning)  # a grid of other numbers may be too coarse
        f.step(0.3 if f.dim_z == 1 else np.zeros(f.dim_z))
        f.filter(np.zeros((3, f.dim_z)))


def changed(text, k, rng):
    """Return the content of a file, tampered with: its bytes, or its values."""
    return (change_values if k % 2 else change_bytes)(text, rng)


def reader(thing):
    """Return the function that reads what the thing wrote."""
    return io.load_model if type(thing).__name__ in io.MODELS else io.load_filter
