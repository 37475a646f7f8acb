"""The filter of a fuzzy switch: what it takes."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, OFSRFilter
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
