"""The families of laws: each is found by its kind, and what it says of itself is so."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FadeLaw, FuzzyMarkovLaw, GraphLaw, SwitchChain
from fuzzykf.errors import ParameterError
from fuzzykf.switching import laws
from fuzzykf.switching.laws.base import Law, ParametricLaw
from fuzzykf.switching.laws.integration import Lines
from fuzzykf.switching.laws.registry import LAWS, learned_laws

EXAMPLES = {
    "fmc1": FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    "fmc2": FuzzyMarkovLaw.fmc2(0.12, 0.5, 0.17),
    "free": LAWS["free"](np.arange(1.0, 26.0).reshape(5, 5)),
    "from_density": FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1),
    "fade": FadeLaw.between(4, 10),
    "graph": GraphLaw.from_masses([4, 3, 2], {(0, 1): 1, (2, 1): 0.5}, jumps={(0, 2): 0.1}),
    "chain": LAWS["chain"](FadeLaw.between(4, 10).discretize(3)),
}
#: Fades, or edges, each with cells of its own.
PARTS = dict.fromkeys(LAWS, 1) | {"fade": 2, "graph": 2, "chain": 2}
PARAMETRIC = [kind for kind, law in LAWS.items() if issubclass(law, ParametricLaw)]


@pytest.mark.parametrize("kind", LAWS)
def test_every_law_offers_what_a_law_offers(kind):
    law = EXAMPLES[kind]
    assert type(law) is LAWS[kind] is getattr(laws, LAWS[kind].__name__)
    assert isinstance(law, Law)
    assert law.kind == kind
    chain = law.discretize(3)
    assert isinstance(chain, SwitchChain)
    assert len(chain) == law.n_classes + 3 * PARTS[kind]
    np.testing.assert_allclose(law.harden().sum(), 1.0)
    assert law.p_hard == pytest.approx(chain.initial[chain.atoms].sum(), abs=1e-9)
    drawn = law.sample(50, np.random.default_rng(0), n_nodes=3)
    for row in drawn.reshape(50, -1):
        assert (row == chain.nodes.reshape(len(chain), -1)).all(axis=1).any()
    with pytest.raises(ParameterError, match="n: got -1"):
        law.sample(-1, np.random.default_rng(0), n_nodes=3)


@pytest.mark.parametrize("kind", [k for k in LAWS if k != "from_density"])
def test_laws_come_back_bit_for_bit(kind):
    law = EXAMPLES[kind]
    again = LAWS[kind].from_dict(law.to_dict())
    assert again.to_dict() == law.to_dict()
    for name in ("initial", "transition", "class_weights"):
        np.testing.assert_array_equal(getattr(again.discretize(3), name), getattr(law.discretize(3), name))


@pytest.mark.parametrize("kind", LAWS)
def test_durations_are_those_of_the_chain(kind):
    law, chain = EXAMPLES[kind], EXAMPLES[kind].discretize(3)
    hard = np.flatnonzero(chain.atoms)
    joint = chain.initial[:, None] * chain.transition
    stay = [chain.transition[k, k] for k in hard]
    # the first of the powers of staying that fails, summed
    expected = [sum(p**k for k in range(5000)) for p in stay]
    np.testing.assert_allclose(law.mean_dwell(3), expected, rtol=1e-9)
    between = np.flatnonzero(~chain.atoms)
    begin = joint[np.ix_(hard, between)].sum(axis=0)
    steps, p = 0.0, begin / begin.sum()
    for _ in range(5000):
        steps, p = steps + p.sum(), p @ chain.transition[np.ix_(between, between)]
    # a free law need not be stationary, but the others are
    assert law.mean_fade(3) == pytest.approx(steps, rel=0.2 if kind == "free" else 1e-9)
    np.testing.assert_allclose(law.harden(3).sum(), 1.0)


def test_functions_are_not_written():
    with pytest.raises(ParameterError, match="law: a law given by functions cannot be written to a file"):
        EXAMPLES["from_density"].to_dict()


def test_laws_that_can_be_learned():
    assert learned_laws() == ("fmc1", "fmc2", "free", "fade", "graph")
    assert all(law.by_name(3).discretize(3).n_classes == 2 for law in map(LAWS.get, learned_laws()))
    with pytest.raises(AttributeError, match="FMC9"):
        laws.FMC9  # noqa: B018


# --------------------------------------------------------------------------- free numbers


@pytest.mark.parametrize("kind", PARAMETRIC)
def test_free_numbers_give_the_law_back(kind):
    law = EXAMPLES[kind]
    again = LAWS[kind].from_logits(law.logits())
    for name, value in law.parameters.items():
        assert again.parameters[name] == pytest.approx(value, rel=1e-9), name
    assert law.logits().shape == (law.n_free,)


@pytest.mark.parametrize("kind", PARAMETRIC)
def test_any_numbers_are_a_law(kind):
    rng = np.random.default_rng(0)
    for _ in range(50):
        logits = rng.uniform(-15.0, 15.0, LAWS[kind].n_free)
        law = LAWS[kind].from_logits(logits)
        assert law.discretize(3).initial.sum() == pytest.approx(1.0)
    assert np.isfinite(LAWS[kind].start().logits()).all()


@pytest.mark.parametrize("kind", PARAMETRIC)
@pytest.mark.parametrize("n_nodes", [0, 1, 4])
def test_the_quicker_way_to_the_cells(kind, n_nodes):
    logits, family = EXAMPLES[kind].logits() + 0.1, LAWS[kind]
    plain = ParametricLaw.on_cells.__func__(family, n_nodes)
    np.testing.assert_allclose(family.on_cells(n_nodes)(logits), plain(logits), rtol=1e-9, atol=1e-14)


# --------------------------------------------------------------------------- a law of one's own


class Level(FuzzyMarkovLaw, ParametricLaw):
    """One level wherever the switch is not hard twice; half of what is left stays, half changes."""

    kind = "level"
    n_free = 1

    def __init__(self, level):
        self.level = level
        self.corners = np.full((2, 2), (1.0 - 5.0 * level) / 4.0)

    @property
    def parameters(self):
        return {"level": self.level}

    @property
    def lines(self):
        return Lines(kinks=np.empty(0), breaks=np.array([0.0, 1.0]), order=2)

    def _interior(self, r1, r2):
        return np.full(np.broadcast_shapes(r1.shape, r2.shape), self.level)

    _edge = _interior

    @classmethod
    def start(cls):
        return cls(0.1)

    def logits(self):
        return np.array([np.log(5.0 * self.level / (1.0 - 5.0 * self.level))])

    @classmethod
    def from_logits(cls, logits):
        return cls(float(0.2 / (1.0 + np.exp(-logits[0]))))


def test_a_new_law_is_a_class_and_a_line(fuzzy_model, monkeypatch, tmp_path):
    module = ModuleType("level")
    module.Level = Level
    monkeypatch.setitem(sys.modules, "level", module)
    monkeypatch.setitem(LAWS._places, "level", "level:Level")
    model = CGOFMSModel(Level(0.12), fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    model.save(tmp_path / "model.json")
    assert CGOFMSModel.load(tmp_path / "model.json").law.parameters == {"level": 0.12}
    assert repr(model.law) == "Level(level=0.12)"
    data = model.simulate(400, np.random.default_rng(0))
    known = CGOFMSModel.fit(data.x, data.y, data.r, law="level", form="regression")
    assert known.model.law.level == pytest.approx(0.12, abs=0.03)
    options = {"form": "regression", "n_nodes": 1, "n_starts": 1, "max_iter": 4}
    hidden = CGOFMSModel.fit(data.x[:300], data.y[:300], law="level", **options)
    assert hidden.n_parameters == known.n_parameters
    assert 0.05 < hidden.model.law.level < 0.19
    with pytest.raises(ParameterError, match=r"law: got 'other', expected 'fmc1', .* 'graph' or 'level'"):
        CGOFMSModel.fit(data.x, data.y, law="other")
