"""The number of regimes has two names, wherever it is an argument."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOMSModel
from fuzzykf.comparison import LearningPart
from fuzzykf.comparison.candidates.switching import hard_candidate, learn_hard
from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning import fit_hard_model

RNG = np.random.default_rng(0)
X, Y = RNG.normal(size=(60, 1)), RNG.normal(size=(60, 1))
FAST = {"form": "regression", "n_starts": 1, "max_iter": 1, "tolerance": 1e-2, "rng": None}
LOUD = FAST | {"progress": None}
PART = LearningPart(x=X, y=Y, max_iter=1, tolerance=1e-2)

#: Whatever takes a number of regimes, and the number that it took.
TAKERS = {
    "CGOMSModel.fit": lambda **given: CGOMSModel.fit(X, Y, **FAST, **given).model.n_classes,
    "fit_hard_model": lambda **given: (
        fit_hard_model(X, Y, None, progress=None, **FAST, **given).model.n_classes
    ),
    "LearningPart.hard": lambda **given: PART.hard(**given).model.n_classes,
    "learn_hard": lambda **given: learn_hard(PART, **given).fit.model.n_classes,
    "hard_candidate": lambda **given: int(hard_candidate(**given).name.removeprefix("hard")),
}

#: What is given, and the number or the error that it stands for.
GIVEN = [
    ({"n_switches": 2}, 2),
    ({"n_regimes": 2}, 2),
    ({"n_regimes": np.int64(3)}, 3),
    ({"n_switches": 3, "n_regimes": 3}, 3),
    ({"n_switches": None, "n_regimes": 1}, 1),
    ({"n_switches": 2, "n_regimes": 3}, "n_switches, n_regimes: got 2 and 3, two names of the number"),
    ({"n_switches": 0}, "n_switches: got 0, expected a whole number of at least 1"),
    ({"n_regimes": 0}, "n_regimes: got 0, expected a whole number of at least 1"),
    ({"n_regimes": 2.5}, "n_regimes: got 2.5"),
    ({"n_regimes": "2"}, "n_regimes: got '2'"),
]


@pytest.mark.parametrize("name", TAKERS)
@pytest.mark.parametrize(("given", "expected"), GIVEN)
def test_two_names_of_one_number(name, given, expected):
    if isinstance(expected, int):
        assert TAKERS[name](**given) == expected
    else:
        with pytest.raises(ParameterError) as caught:
            TAKERS[name](**given)
        assert str(caught.value).startswith(expected)


@pytest.mark.parametrize("name", TAKERS)
def test_without_a_number(name):
    if name in ("CGOMSModel.fit", "fit_hard_model"):
        assert TAKERS[name]() == 2
    else:
        with pytest.raises(ParameterError, match="n_regimes: missing"):
            TAKERS[name]()


def test_a_switch_that_is_refused_is_told_of_regimes():
    with pytest.raises(ParameterError, match=r"r: expected regimes 0 to 1 \(n_regimes = 2\)"):
        CGOMSModel.fit(X, Y, np.full(60, 2.0), form="regression")
