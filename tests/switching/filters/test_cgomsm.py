"""The filter of hard regimes: what it takes."""

from __future__ import annotations

import pytest

from fuzzykf import CGOMSMFilter
from fuzzykf.errors import ParameterError


def test_it_takes_a_hard_model(fuzzy_model):
    with pytest.raises(ParameterError, match="model: got CGOFMSModel, expected a CGOMSModel"):
        CGOMSMFilter(fuzzy_model)


def test_a_model_makes_it(hard_model):
    f = hard_model.filter()
    assert type(f) is CGOMSMFilter
    assert f.model is hard_model


def test_there_are_no_nodes_between_hard_regimes(hard_model):
    assert hard_model.filter(7).nodes.tolist() == [0.0, 1.0, 2.0]
    assert hard_model.placed(7, "midpoint") is hard_model.placed() is hard_model.on_nodes()
