"""The most likely path of the switch is the best of all, also where the last observations are missing."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fuzzykf import CGOMSMFilter, KnownSwitchFilter


@pytest.mark.parametrize("missing", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_is_the_best_of_all_paths(missing, seed, hard_model) -> None:
    # a path is worth its probability times the density of what was observed, given that path
    chain = hard_model.on_nodes().chain
    n = 4
    y = hard_model.simulate(n, np.random.default_rng(seed)).y
    y[n - missing :] = np.nan
    seen = y[: n - missing]
    density = {
        path: KnownSwitchFilter(hard_model).filter(seen, np.array(path, dtype=float)).log_likelihood.sum()
        for path in itertools.product(range(3), repeat=len(seen))
    }
    best, highest = None, -np.inf
    for path in itertools.product(range(3), repeat=n):
        moves = np.log(chain.transition[path[:-1], path[1:]]).sum()
        score = np.log(chain.initial[path[0]]) + moves + density[path[: len(seen)]]
        if score > highest:
            best, highest = path, score
    np.testing.assert_array_equal(CGOMSMFilter(hard_model).smooth(y).switch_path, best)
