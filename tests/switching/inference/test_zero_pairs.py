"""Where something is missing pairs of probability zero have no part either: without them all is the same."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FadeLaw, OFSRFilter
from fuzzykf.engine.numpy import gaps, tables

FIELDS = ("x", "P", "x_prior", "P_prior", "mu", "switch", "log_likelihood")
SMOOTHED = ("x", "P", "mu", "switch", "switch_path")
RING = FadeLaw(3, {(0, 1): (0.1, 5), (1, 2): (0.2, 6), (2, 0): (0.15, 4)}, jumps={(0, 2): 0.02})


def fuzzy(law, m, q):
    """A filter of a law on classes whose moments are random."""
    K, d, rng = law.n_classes, m + q, np.random.default_rng(4)
    covariances = np.empty((K, K, 2 * d, 2 * d))
    for i, j in np.ndindex(K, K):
        cross = 0.3 * np.eye(d) + 0.05 * (j + 1) * rng.normal(size=(d, d))
        S, T = (np.eye(d) * (1.0 + 0.2 * k) + 0.2 for k in (i, j))
        covariances[i, j] = np.block([[S, cross.T], [cross, T]])
    model = CGOFMSModel(law, rng.normal(size=(K, d)), covariances, m)
    return lambda: OFSRFilter(model, 3)


def cycle(make_transitions, m, q):
    """A filter of six regimes that follow one another, the first of which is never come back to."""
    P = 0.8 * np.eye(6) + 0.2 * np.roll(np.eye(6), 1, axis=1)
    P[5, 0], P[5, 1] = 0.0, 0.2
    initial = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    model = CGOMSModel.from_transitions(P, *make_transitions(6, m, q, seed=3), dim_x=m, initial=initial)
    return lambda: CGOMSMFilter(model)


def of_order_two():
    """A filter of six regimes that follow one another, whose first tables are others."""
    P = 0.8 * np.eye(6) + 0.2 * np.roll(np.eye(6), 1, axis=1)
    A = np.linspace(0.4, 0.9, 6)[:, None, None] * np.array([[1.0, 0.2], [0.0, 0.8]])
    B, C = np.tile([[1.0, 0.5]], (6, 1, 1)), np.tile(np.eye(2), (6, 1, 1))
    model = CGOMSModel.from_cglssm(P, A, B, C, np.full((6, 1, 1), 0.6), order=2)
    return lambda: CGOMSMFilter(model)


@pytest.fixture(
    params=["order two", "fade", "turning fade", "ring", "ring, two by two", "cycle", "cycle, two by two"]
)
def make(request, make_transitions):
    """Maker of a filter."""
    return {
        "order two": of_order_two,
        "fade": lambda: fuzzy(FadeLaw.between(8, 5), 1, 1),
        "turning fade": lambda: fuzzy(FadeLaw.between(8, 5, turn_back=0.1, jump=0.02), 1, 2),
        "ring": lambda: fuzzy(RING, 1, 1),
        "ring, two by two": lambda: fuzzy(RING, 2, 2),
        "cycle": lambda: cycle(make_transitions, 1, 1),
        "cycle, two by two": lambda: cycle(make_transitions, 2, 2),
    }[request.param]()


def series_of(f, kind):
    """Observations (24, q) with gaps: after an outlier, at the start, at the end, in parts."""
    ys = f.model.simulate(24, np.random.default_rng(2)).y.reshape(24, -1).copy()
    ys[[4, 5, 12]], ys[18:21, 0] = np.nan, np.nan
    if kind == "outliers":
        ys[[3, 11]] *= np.array([[1e3], [1e6]])
    elif kind == "ends":
        ys[0], ys[22:] = np.nan, np.nan
    return ys


@pytest.mark.parametrize("kind", ["usual", "outliers", "ends"])
def test_gaps_are_those_of_all_pairs(make, kind, monkeypatch) -> None:
    found = []
    for all_pairs in (False, True):
        if all_pairs:  # the compiled engine leaves them out of complete steps all the same
            monkeypatch.setattr(gaps, "lay_out", lambda transition: None)
            monkeypatch.setattr(tables, "lay_out", lambda transition: None)
        f = make()
        ys = series_of(f, kind)
        filtered, smoothed, steps = f.filter(ys), f.smooth(ys), []
        f.reset()
        for y in ys:
            f.step(y)
            steps.append(np.concatenate([f.x.ravel(), f.x_prior.ravel(), f.mu]))
        found.append(
            {("filter", name): getattr(filtered, name) for name in FIELDS}
            | {("smooth", name): getattr(smoothed, name) for name in SMOOTHED}
            | {("step", "x, x_prior, mu"): np.array(steps)}
        )
    for name, value in found[1].items():
        size = np.abs(value).max(axis=tuple(range(1, value.ndim)), keepdims=True)
        assert (np.abs(found[0][name] - value) <= 1e-12 * (1e-2 + size)).all(), name


def test_pairs_that_cannot_be_are_left_out_of_gaps() -> None:
    f = fuzzy(FadeLaw.between(8, 5), 1, 1)()
    f.step(0.3)
    step, known = f._next_tables(), f._mixture
    mixture = gaps.pair_mixture(step.in_slots, step.noise_root, known.table, None, known.window, known.root)
    assert step.transition.shape == (8, 8)
    assert mixture.mean.shape == (2, 8, 3)
