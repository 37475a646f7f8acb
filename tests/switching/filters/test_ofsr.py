"""The filter of a fuzzy switch: what it takes."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FadeLaw, FuzzyMarkovLaw, GraphLaw, OFSRFilter, engine
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.cells import CellLaw


def test_it_takes_a_fuzzy_model(hard_model):
    with pytest.raises(ParameterError, match="model: got CGOMSModel, expected a CGOFMSModel"):
        OFSRFilter(hard_model)


def test_options(fuzzy_model):
    f = OFSRFilter(fuzzy_model)
    assert (f.n_nodes, f.rule) == (5, "cell")
    assert OFSRFilter(fuzzy_model, 0).nodes.tolist() == [0.0, 1.0]
    for n_nodes in (-1, 2.5, None):
        with pytest.raises(ParameterError, match=r"n_nodes: got .*, expected a whole number of at least 0"):
            OFSRFilter(fuzzy_model, n_nodes)
    with pytest.raises(ParameterError, match="rule: got 'best', expected one of"):
        OFSRFilter(fuzzy_model, 5, "best")


def test_a_model_makes_it(fuzzy_model):
    f = fuzzy_model.filter()
    assert type(f) is OFSRFilter
    assert (f.model, f.n_nodes, f.rule) == (fuzzy_model, 5, "cell")
    f = fuzzy_model.filter(3, rule="midpoint")
    assert (f.n_nodes, f.rule) == (3, "midpoint")


def test_a_free_law_has_nodes_of_its_own(fuzzy_model):
    law = CellLaw(np.eye(5) + 0.1)
    model = CGOFMSModel(law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    assert model.filter().n_nodes == 3
    assert len(model.placed(3).chain) == 5
    with pytest.raises(ParameterError, match="expected 3 and 'cell'"):
        model.filter(5)


def test_fades_have_cells_of_their_own(fuzzy_model):
    form = fuzzy_model.form
    model = CGOFMSModel(FadeLaw.between(40, 10), form.means, form.covariances, 1)
    f = OFSRFilter(model)
    assert (f.n_nodes, len(f.nodes)) == (5, 12)
    np.testing.assert_array_equal(f.nodes[:2], [0.0, 1.0])
    assert f.switch_mean == pytest.approx(0.5)
    short = CGOFMSModel(FadeLaw.between(40, 3), form.means, form.covariances, 1)
    with pytest.raises(ParameterError, match=r"n_nodes=3 at most for fade \(0, 1\) of length 3"):
        OFSRFilter(short)
    assert set(short.simulate(2000, np.random.default_rng(0)).r) == {0.0, 1.0, *OFSRFilter(short, 3).nodes}
    assert set(short.simulate(2000, np.random.default_rng(0), 1).r) == {0.0, 0.5, 1.0}
    # a middle cell is of the class that is left, and there is one only for odd numbers
    np.testing.assert_allclose(short.harden(2).transition, short.harden().transition, rtol=1e-12)
    assert repr(model).startswith("CGOFMSModel(FadeLaw(2, {(0, 1): (0.025, 10.0), ")


def test_it_takes_laws_of_two_classes(fuzzy_model):
    form = fuzzy_model.form
    ring = FadeLaw(3, {(0, 1): (0.1, 5), (1, 2): (0.1, 5), (2, 0): (0.1, 5)})
    with pytest.raises(
        ParameterError, match="means: got those of 2 regimes, expected 3, as many as the law has"
    ):
        CGOFMSModel(ring, form.means, form.covariances, 1)
    with pytest.raises(ParameterError, match="law: got str, expected a FuzzyMarkovLaw or another law"):
        CGOFMSModel("fade", form.means, form.covariances, 1)


def test_fades_tell_where_a_switch_is_going(fuzzy_model):
    # on ramps the filter of the directed law beats that of a law that knows no direction
    form, errors = fuzzy_model.form, {}
    truth = CGOFMSModel(FadeLaw.between(40, 10), form.means, form.covariances, 1)
    data = truth.simulate(4000, np.random.default_rng(1), 10)
    for name, law in {"fades": truth.law, "symmetric": FuzzyMarkovLaw.fmc2(0.35, 0.25, 0.2)}.items():
        result = OFSRFilter(CGOFMSModel(law, form.means, form.covariances, 1)).filter(data.y)
        errors[name] = np.mean((result.switch_mean - data.r) ** 2)
    assert errors["fades"] < 0.8 * errors["symmetric"]


def test_a_graph_of_two_classes_is_filtered_as_its_law(fuzzy_model, tmp_path):
    law, form = fuzzy_model.law, fuzzy_model.form
    graph = GraphLaw(2, [(0, 1)], law.corners, parameters=[(law.eta, law.delta)])
    model = CGOFMSModel(graph, form.means, form.covariances, 1)
    y = model.simulate(60, np.random.default_rng(0)).y
    model.save(tmp_path / "model.json")
    for one in (model, CGOFMSModel.load(tmp_path / "model.json")):
        found, expected = OFSRFilter(one).smooth(y), OFSRFilter(fuzzy_model).smooth(y)
        for name in ("x", "P", "switch_mean", "log_likelihood"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, err_msg=name)
        np.testing.assert_allclose(found.switch, expected.switch, atol=1e-15)


def test_many_series_take_little_memory_beyond_input_and_output(fuzzy_model):
    # 10,000 series of 1,000 are 80 MB: a copy of them, or of a field, would be felt
    f = OFSRFilter(fuzzy_model, 5)
    ys = np.random.default_rng(1).normal(1.5, 1.5, (400, 200, 1))
    f.filter_many(ys[:2])
    tracemalloc.start()
    try:
        result = f.filter_many(ys)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    kept = sum(values.nbytes for values in (result.x, result.P, result.log_likelihood))
    beyond = (peak - kept) / ys.nbytes
    most = 0.75 if engine.info().name == "compiled" else 3.5  # NumPy keeps a step of all series
    assert beyond < most
