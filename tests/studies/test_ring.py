"""How well a ring of three hidden classes is learned, beside a learner that knows the switch.

What the second misses, chance alone does: a rate rests on some thirty departures.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FadeLaw

pytestmark = pytest.mark.study

SEEDS, STEPS, NODES = 10, 3000, 5

#: Rate and mean length of each fade.
RING = {(0, 1): (1 / 20, 10), (1, 2): (1 / 15, 8), (2, 0): (1 / 25, 12)}

#: Where the search begins, with all fades alike.
START = FadeLaw(3, dict.fromkeys(RING, (1 / 20, 15)))


def ring_model():
    """Three classes apart in both components, of which each forgets faster than the one before."""
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    phi = np.array([0.9, 0.6, 0.3])
    a = 0.5 * (phi[:, None] + phi)[:, :, None, None]
    kept = np.broadcast_to(z, (3, 3, 2, 2))
    pairs = np.block([[kept, a * z], [a * z, kept]])
    return CGOFMSModel(FadeLaw(3, RING), [[0.0, 0.0], [2.0, 4.0], [-2.0, 8.0]], pairs, dim_x=1)


def off(model, than):
    """Relative differences (3, 2) of rates and lengths."""
    found, right = (np.array([law[pair] for pair in RING]) for law in (model.law.fades, than))
    return np.abs(found / right - 1.0)


def test_a_ring_of_hidden_classes_is_learned(write_table):
    truth = ring_model()
    rows, hidden, known, apart, weights = [], [], [], [], []
    for seed in range(SEEDS):
        data = truth.simulate(STEPS, np.random.default_rng(seed), n_nodes=NODES)
        fit = CGOFMSModel.fit(data.x, data.y, law=START, n_nodes=NODES)
        told = CGOFMSModel.fit(data.x, data.y, data.r, law=START, n_nodes=NODES)
        assert fit.converged, seed
        hidden.append(off(fit.model, RING))
        known.append(off(told.model, RING))
        apart.append(off(fit.model, told.model.law.fades))
        weights.append(np.abs(fit.class_weights - data.r).mean())
        largest = [errors.max(axis=0) for errors in (hidden[-1], known[-1], apart[-1])]
        rates, lengths = ([f"{one[column]:.0%}" for one in largest] for column in (0, 1))
        rows.append([str(seed), *rates, *lengths, f"{weights[-1]:.3f}"])
    header = ["rate, hidden", "known", "apart", "length, hidden", "known", "apart", "class weights"]
    write_table("ring", ["series", *header], rows)

    rate = np.max(hidden, axis=1)[:, 0]
    assert np.sum(rate <= 0.35) >= SEEDS - 1
    assert (rate <= np.maximum(0.35, np.max(known, axis=1)[:, 0])).all()  # or as far off as chance has it
    assert np.max(apart, axis=1)[:, 0].max() <= 0.20
    assert np.median(np.array(hidden)[:, :, 1]) <= 0.10
    assert np.max(hidden, axis=1)[:, 1].max() <= 0.60
    assert np.max(weights) <= 0.04
