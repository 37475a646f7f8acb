"""The most likely path of the switch is the best of all, also where the last observations are missing."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, CGOMSModel, KnownSwitchFilter

#: Regimes that change so often that the best path is not simply that of the best nodes.
OFTEN = [[0.5, 0.3, 0.2], [0.35, 0.4, 0.25], [0.3, 0.3, 0.4]]


@pytest.mark.parametrize(
    ("missing", "seed"), [(0, 0), (0, 1), (1, 0), (1, 15), (2, 8), (2, 12), (3, 2), (3, 6), (3, 9)]
)
def test_it_is_the_best_of_all_paths(missing, seed, make_transitions) -> None:
    # a path is worth its probability times the density of what was observed, given that path
    model = CGOMSModel.from_transitions(OFTEN, *make_transitions(3, 2, 1, seed=5), dim_x=2)
    chain = model.placed().chain
    n = 4
    y = model.simulate(n, np.random.default_rng(seed)).y
    y[n - missing :] = np.nan
    seen = y[: n - missing]
    density = {
        path: KnownSwitchFilter(model).filter(seen, np.array(path, dtype=float)).log_likelihood.sum()
        for path in itertools.product(range(3), repeat=len(seen))
    }
    best, highest = None, -np.inf
    for path in itertools.product(range(3), repeat=n):
        moves = np.log(chain.transition[path[:-1], path[1:]]).sum()
        score = np.log(chain.initial[path[0]]) + moves + density[path[: len(seen)]]
        if score > highest:
            best, highest = path, score
    np.testing.assert_array_equal(CGOMSMFilter(model).smooth(y).switch_path, best)
