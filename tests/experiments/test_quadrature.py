"""The quadrature experiment, made small: the orders of convergence that theory tells."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2020_quadrature import QUADRATURE


@pytest.fixture(scope="module")
def samples():
    """Two short series of each law, against a reference of 40 nodes."""
    small = {"n": 60, "reference": 40, "nodes": (5, 7, 10, 20)}
    return {
        name: QUADRATURE.run(np.random.default_rng(0), 2, **(dict(piece) | small))
        for name, piece in QUADRATURE.pieces.items()
    }


@pytest.mark.parametrize("rule", ["midpoint", "cell"])
def test_on_a_continuous_density_twice_the_nodes_are_a_quarter_of_the_error(samples, rule) -> None:
    values = samples["FMC1"]
    ratio = values[f"{rule} 10"].mean() / values[f"{rule} 20"].mean()
    assert 3.5 < ratio < 4.5


def test_on_a_density_that_jumps_midpoints_are_of_first_order_and_cells_better(samples) -> None:
    values = samples["FMC2"]
    assert values["midpoint 10"].mean() / values["midpoint 20"].mean() < 3.0
    assert values["cell 20"].mean() < 0.3 * values["midpoint 20"].mean()


def test_product_integration_converges_spectrally(samples) -> None:
    values = samples["FMC1"]
    assert values["product 7"].mean() < 0.05 * values["midpoint 7"].mean()
    assert values["product 20"].mean() < 1e-12


def test_the_cost_counts_pairs(samples) -> None:
    assert int(samples["FMC1"]["cell 10 pairs"]) == 144
    assert int(samples["FMC2"]["midpoint 10 pairs"]) < 0.5 * 144  # most pairs of FMC2 are impossible


def test_as_an_experiment_it_writes_its_table_and_picture(samples, tmp_path) -> None:
    outcome = perform(QUADRATURE, runs=2)
    rows = {row.quantity: row for row in outcome.rows}
    assert rows["FMC1: cost of a step with 20 nodes / with 10"].ours == pytest.approx((22 / 12) ** 2)
    # three nodes are too few for the five panels of FMC2
    assert "FMC2, product: rms error of 3 nodes" not in rows
    assert "FMC2, product: rms error of 5 nodes" in rows
    assert write(outcome, tmp_path)[2].stat().st_size > 10_000
