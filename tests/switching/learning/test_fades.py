"""Learning laws of fades and of more than two classes: structure kept, numbers found, names that agree."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from fuzzykf import CGOFMSModel, FadeLaw, GraphLaw, OFSRFilter
from fuzzykf.errors import ParameterError, ShapeError

RING = FadeLaw(3, {(0, 1): (1 / 12, 6), (1, 2): (1 / 9, 6), (2, 0): (1 / 15, 7)})
START = FadeLaw(3, {(0, 1): (0.1, 9), (1, 2): (0.1, 9), (2, 0): (0.1, 9)})
QUICK = {"n_nodes": 3, "n_starts": 2, "max_iter": 15, "form": "regression"}


def model_of(law):
    """Classes that lie far apart in y, and whose states have memories of other lengths."""
    K = law.n_classes
    means = np.stack([np.resize([0.0, 2.0, -2.0], K), 6.0 * np.arange(K)], axis=1)
    memory = np.linspace(0.9, 0.3, K)
    z = np.array([[1.0, 0.5], [0.5, 1.0]])
    pairs = np.empty((K, K, 4, 4))
    for i, j in np.ndindex(K, K):
        a = 0.5 * (memory[i] + memory[j])
        pairs[i, j] = np.block([[z, a * z], [a * z, z]])
    return CGOFMSModel(law, means, pairs, 1)


@pytest.fixture(scope="module")
def ring():
    return model_of(RING).simulate(700, np.random.default_rng(0), n_nodes=3)


@pytest.fixture(scope="module")
def learned(ring):
    return CGOFMSModel.fit(ring.x, ring.y, law=START, **QUICK)


def test_a_ring_of_three_hidden_classes(ring, learned):
    known = CGOFMSModel.fit(ring.x, ring.y, ring.r, law=START, n_nodes=3)
    for pair, (rate, length) in known.model.law.fades.items():
        # of about 20 fades: what is hidden is found, what chance does is the same for both
        found = learned.model.law.fades[pair]
        assert found[0] == pytest.approx(rate, rel=0.25), pair
        assert found[1] == pytest.approx(length, abs=2.0), pair
    assert np.abs(learned.class_weights - ring.r).mean() < 0.04
    assert learned.switch_mean is None
    assert learned.n_parameters == known.n_parameters
    np.testing.assert_allclose(learned.occupancy, ring.r.mean(axis=0), atol=0.05)
    assert "FadeLaw" in learned.model.describe_switch() or "fade" in learned.model.describe_switch()


def test_the_trace_never_falls(learned):
    assert (np.diff(learned.trace) >= -1e-7 * abs(learned.trace[0])).all()


def test_what_was_learned_filters(ring, learned, tmp_path):
    learned.model.save(tmp_path / "ring.json")
    again = CGOFMSModel.load(tmp_path / "ring.json")
    found = OFSRFilter(again, 3).filter(ring.y)
    truth = OFSRFilter(model_of(RING), 3).filter(ring.y)
    own, best = (float(np.mean((one.x - ring.x) ** 2)) for one in (found, truth))
    assert own < 1.1 * best


def test_regimes_are_named_in_the_order_of_y(ring):
    # the law tells the places of a ring apart, not where it begins: the smallest y is class 0
    for x, y in ((ring.x, -ring.y), (-ring.x, -ring.y)):
        law = FadeLaw(3, {(b, a): v for (a, b), v in START.fades.items()})
        found = CGOFMSModel.fit(x, y, law=law, **{**QUICK, "max_iter": 8})
        assert (np.diff(found.model.regime_means()[:, 1]) > 0.0).all()
        np.testing.assert_allclose(found.class_weights[:, ::-1].mean(axis=0), ring.r.mean(axis=0), atol=0.06)


def test_numbers_to_begin_with_name_the_classes(ring):
    # class 2 is said to stay longest and class 1 shortest, as it is
    start = FadeLaw(3, {(1, 0): (1 / 12, 6), (0, 2): (1 / 9, 6), (2, 1): (1 / 15, 7)})
    found = CGOFMSModel.fit(ring.x, ring.y, law=start, **QUICK)
    names = [1, 0, 2]  # of the classes of the ring
    assert np.abs(found.class_weights[:, names] - ring.r).mean() < 0.05


def test_known_switches_are_weights_or_labels(ring):
    hard = ring.r.argmax(axis=1)
    law = FadeLaw(3, {}, jumps={(a, b): 0.1 for a in range(3) for b in range(3) if a != b})
    labels = CGOFMSModel.fit(ring.x, ring.y, hard, law=law)
    weights = CGOFMSModel.fit(ring.x, ring.y, np.eye(3)[hard], law=law)
    assert labels.log_likelihood == weights.log_likelihood
    stays = np.mean(hard[1:][hard[:-1] == 0] == 0)
    left = sum(p for (a, _), p in labels.model.law.jumps.items() if a == 0)
    assert left == pytest.approx(
        1.0 - stays, abs=1e-3
    )  # that to 2, which is never seen, has a share of a step
    with pytest.raises(
        ShapeError, match="r: series 0 has 2 columns, expected one of regimes, or the weights"
    ):
        CGOFMSModel.fit(ring.x, ring.y, ring.r[:, :2], law=START)
    with pytest.raises(ParameterError, match="r: got 3, expected regimes 0 to 2"):
        CGOFMSModel.fit(ring.x, ring.y, hard + 1, law=START)


def test_series_with_gaps_are_learned_as_stretches(ring):
    y, r = ring.y.copy(), ring.r.copy()
    y[300:310] = np.nan
    r[500, 1] = np.nan
    known = CGOFMSModel.fit(ring.x, y, r, law=START, n_nodes=3)
    assert known.n_observations == 689
    assert np.isnan(known.class_weights[305]).all()
    parts = [slice(0, 300), slice(310, 500), slice(501, None)]
    several = CGOFMSModel.fit(*([v[part] for part in parts] for v in (ring.x, y, r)), law=START, n_nodes=3)
    assert several.log_likelihood == pytest.approx(known.log_likelihood, rel=1e-12)
    assert several.model.law.fades == known.model.law.fades


def test_tables_get_tables(ring):
    index = pd.date_range("2024-01-01", periods=700, freq="h")
    x, y = (pd.DataFrame(v, index, [name]) for v, name in ((ring.x, "load"), (ring.y, "t")))
    found = CGOFMSModel.fit(x, y, ring.r, law=START, n_nodes=3)
    assert list(found.class_weights.columns) == ["class_weights0", "class_weights1", "class_weights2"]
    assert found.class_weights.index.equals(index)


def test_the_bootstrap_learns_the_same_way(learned):
    (again,) = learned.bootstrap(1, np.random.default_rng(0))
    assert again.model.law.fades.keys() == RING.fades.keys()
    assert again.n_parameters == learned.n_parameters


def test_a_chain_of_which_the_arrows_alone_are_known(ring, learned):
    start = START.discretize(3)
    found = CGOFMSModel.fit(ring.x, ring.y, law=start, **QUICK)
    assert np.abs(found.class_weights - ring.r).mean() < 0.05
    assert found.log_likelihood > learned.log_likelihood - 2.0  # it contains the law of fades
    assert ((found.model.law.chain.transition > 0.0) <= (start.transition > 0.0)).all()
    assert found.n_parameters == learned.n_parameters + 6  # every cell has a probability of its own


def test_a_graph_of_three_classes():
    truth = GraphLaw.from_masses([0.4, 0.3, 0.2], {(0, 1): 0.06, (1, 2): 0.04})
    data = model_of(truth).simulate(700, np.random.default_rng(0), n_nodes=3)
    start = GraphLaw.from_masses([1, 1, 1], {(0, 1): 1, (1, 2): 1})
    found = CGOFMSModel.fit(data.x, data.y, law=start, **QUICK)
    known = CGOFMSModel.fit(data.x, data.y, data.r, law=start, n_nodes=3)
    np.testing.assert_allclose(found.model.law.class_masses, known.model.law.class_masses, atol=0.05)
    np.testing.assert_allclose(found.model.law.edge_masses, known.model.law.edge_masses, atol=0.05)
    assert np.abs(found.class_weights - data.r).mean() < 0.06


def test_fades_of_two_classes_by_name():
    truth = model_of(FadeLaw.between(15, 8))
    data = truth.simulate(700, np.random.default_rng(1), n_nodes=3)
    found = CGOFMSModel.fit(data.x, data.y, law="fade", **QUICK)
    known = CGOFMSModel.fit(data.x, data.y, data.r, law="fade", n_nodes=3)
    for pair, (rate, length) in known.model.law.fades.items():
        assert found.model.law.fades[pair][0] == pytest.approx(rate, rel=0.25), pair
        assert found.model.law.fades[pair][1] == pytest.approx(length, abs=1.5), pair
        assert found.model.law.jumps[pair] < 0.003
    assert found.model.law.turn_back < 0.02
    # shares of values are summed over directions before anything is shown
    assert np.sqrt(np.mean((found.switch_mean - data.r) ** 2)) < 0.1


def test_notes_of_a_known_switch(ring):
    noisy = np.clip(ring.r[:, 0] + np.random.default_rng(0).normal(0, 0.02, len(ring.r)), 0.0, 1.0)
    found = CGOFMSModel.fit(ring.x, ring.y, noisy, law="fade")
    assert any("which may be noise" in note for note in found.warnings)
    labels = ring.r.argmax(axis=1)
    ways = {(a, b): 0.1 for a in range(3) for b in range(3) if a != b}
    law = FadeLaw(3, START.fades, jumps=ways)
    notes = CGOFMSModel.fit(ring.x, ring.y, labels, law=law).warnings
    assert "r has no fade from 0 to 1; its length is that of the given law" in notes


def test_pairs_that_a_law_does_not_have_are_not_missed(ring):
    # a ring has no step from class 1 to class 0
    found = CGOFMSModel.fit(ring.x, ring.y, ring.r, law=START)
    assert not any("pair of regimes (1, 0)" in note for note in found.warnings)


def test_fades_that_are_as_short_as_their_nodes(ring):
    start = FadeLaw(3, {pair: (rate, 12.0) for pair, (rate, _) in START.fades.items()})
    found = CGOFMSModel.fit(ring.x, ring.y, law=start, **{**QUICK, "n_nodes": 9, "max_iter": 6})
    assert all(length >= 9.0 for _, length in found.model.law.fades.values())
    assert any("cannot be shorter than n_nodes = 9 steps" in note for note in found.warnings)


def test_a_short_law_takes_as_many_nodes_as_it_has_room_for(ring):
    short = FadeLaw(3, {pair: (rate, 3.0) for pair, (rate, _) in START.fades.items()})
    found = CGOFMSModel.fit(ring.x, ring.y, ring.r, law=short)  # whose r fades for about 6 steps
    assert found.model.law.fades[0, 1][1] > 4.0
    model = model_of(short)
    assert len(model.filter().nodes) == 12  # not 5 nodes each
    with pytest.raises(ParameterError, match="n_nodes: got 5, expected n_nodes=3 at most"):
        OFSRFilter(model)


def test_a_switch_that_never_comes_back_is_noted():
    # each series fades once from 0 to 1, far apart in y
    rng = np.random.default_rng(0)
    r = [np.clip((np.arange(120) - start) / 8.0, 0.0, 1.0) for start in (30, 50, 70)]
    x = [rng.normal(size=120) + 4.0 * one for one in r]
    y = [rng.normal(size=120) + 6.0 * one for one in r]
    for switch in (r, None):
        found = CGOFMSModel.fit(
            x, y, switch, law="fade", n_nodes=3, n_starts=1, max_iter=12, form="regression"
        )
        assert any("hardly ever returns to regime 0" in note for note in found.warnings)
        assert found.model.law.fades[1, 0][0] > 0.0  # one more step at 1, in which it left as in the start
        assert found.log_likelihood / found.n_observations > -4.0


def test_what_more_than_two_classes_cannot_be_learned_with(ring):
    with pytest.raises(ParameterError, match="form: 'covariance' can be learned for a fuzzy switch between"):
        CGOFMSModel.fit(ring.x, ring.y, law=START, form="covariance", n_nodes=3)
    with pytest.raises(ParameterError, match="n_nodes: got 12, expected n_nodes=9 at most for fade"):
        CGOFMSModel.fit(ring.x, ring.y, law=START, n_nodes=12)
