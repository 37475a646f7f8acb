"""The experiments of the 2020 paper, made small: their numbers against independent ones."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.experiments import EXPERIMENTS
from fuzzykf.experiments.core import perform, write
from fuzzykf.experiments.paper2020 import hard_covariances, make_law, make_model, mean_squared_errors
from fuzzykf.experiments.paper2020_errors import HARD_FRACTION, NODES

#: Γ of section VI-A as printed, but .12 for .06 in Γ00 and .18 for .14 in Γ01.
GAMMA = [
    [
        [[0.5, 0.3, 0.1, 0.12], [0.3, 1, 0.35, 0.4], [0.1, 0.35, 0.5, 0.3], [0.12, 0.4, 0.3, 1]],
        [[0.5, 0.3, 0.5, 0.18], [0.3, 1, 0.33, 0.6], [0.5, 0.33, 0.75, 0.3], [0.18, 0.6, 0.3, 0.5]],
    ],
    [
        [[0.75, 0.3, 0.1, 0.24], [0.3, 0.5, 0.35, 0.4], [0.1, 0.35, 0.5, 0.3], [0.24, 0.4, 0.3, 1]],
        [[0.75, 0.3, 0.5, 0.18], [0.3, 0.5, 0.33, 0.3], [0.5, 0.33, 0.75, 0.3], [0.18, 0.3, 0.3, 0.5]],
    ],
]


def test_the_covariances_are_the_printed_ones_with_two_corrected_entries() -> None:
    assert hard_covariances() == pytest.approx(np.array(GAMMA))
    # and they pass the check of the constraint
    CGOFMSModel(make_law("FMC1", (0.07, 0.05, 0.16)), [[0, 3], [0, 0]], GAMMA, 1, constraint="check")


def test_the_laws_of_the_table_have_the_shares_that_it_names() -> None:
    for name, piece in HARD_FRACTION.pieces.items():
        share = float(name.split()[1]) / 100
        assert make_law(piece["family"], piece["parameters"]).p_hard == pytest.approx(share, abs=0.006), name


@pytest.fixture(scope="module")
def outcomes():
    """The experiments at a small size; the table at its first column only is not one, so all of it."""
    return {
        name: perform(EXPERIMENTS[name], runs=4, seed=1)
        for name in ("densities", "trajectories", "restoration", "nodes")
    }


def test_the_densities_are_those_of_the_law(outcomes) -> None:
    values = outcomes["densities"].samples["FMC1"]
    eta, delta = 0.21, 0.076
    i, j = 4, 13
    distance = abs(values["at"][i] - values["at"][j])
    assert values["joint"][i, j] == pytest.approx(eta + (delta - eta) * distance)
    assert values["joint"][0, 0] == pytest.approx(0.10)
    far = np.abs(values["at"][:, None] - values["at"]) > 0.2 + 1e-9
    two = outcomes["densities"].samples["FMC2"]["joint"]
    far[0, -1] = far[-1, 0] = False
    assert (two[far] == 0.0).all()
    assert {row.verdict for row in outcomes["densities"].rows if row.printed is not None} == {"reproduced"}


def test_the_share_of_fuzzy_values_after_zero_is_the_corrected_one(outcomes) -> None:
    row = next(row for row in outcomes["trajectories"].rows if "after 0" in row.quantity)
    law = FuzzyMarkovLaw.fmc2(0.15, 0.60, 0.20)
    S = 0.15 + law.beta + 0.12
    assert row.printed == pytest.approx(0.12 / S)
    assert row.verdict == "reproduced with a correction"
    assert abs(row.ours - 0.6 / S) > 10 * row.standard_error  # the printed formula gives 2.2


def test_knowing_the_switch_helps_and_the_hard_filter_is_worse(outcomes) -> None:
    values = outcomes["nodes"].samples["FMC1"]
    known, fuzzy, hard = (values[name].mean() for name in ("known", "state_5", "state_hard"))
    assert known < fuzzy < hard
    assert values["state_9"] == pytest.approx(values["state_5"], abs=2e-3)  # converged
    wrong = [row.quantity for row in outcomes["nodes"].rows if row.verdict == "not reproduced"]
    assert "p_H" in wrong  # .69 is printed, .667 follows from the parameters


def test_errors_are_those_of_the_filter_run_alone(outcomes) -> None:
    # The series shown in the picture, filtered once more by itself.
    values = outcomes["restoration"].samples["FMC2"]
    run = int(values["shown"])
    assert values["fuzzy_unknown"][run] == pytest.approx(np.mean((values["fuzzy_x"] - values["x"]) ** 2))
    assert values["hard_switch"][run] == pytest.approx(np.mean((values["hard_r"] - values["r"]) ** 2))


def test_one_column_of_the_table() -> None:
    # Three runs of the 48 % column: the order of the filters, and the share of hard values.
    piece = dict(HARD_FRACTION.pieces["FMC1 48 % covariance"]) | {"n": 400, "most_learned": 1}
    values = HARD_FRACTION.run(np.random.default_rng(0), 3, **piece)
    assert values["hard_share"].mean() == pytest.approx(0.48, abs=0.05)
    assert values["fuzzy_state"].mean() < values["hard_state"].mean()
    assert values["fuzzy_switch"].mean() < values["hard_switch"].mean()
    assert values["learned_state"].shape == (3,)


def test_without_fuzzy_values_the_fuzzy_and_the_hardened_filter_are_one() -> None:
    piece = dict(HARD_FRACTION.pieces["FMC2 100 % transition"]) | {"n": 200, "most_learned": 1}
    values = HARD_FRACTION.run(np.random.default_rng(0), 2, **piece)
    assert values["fuzzy_state"] == pytest.approx(values["hard_state"], abs=1e-12)


def test_the_error_of_a_run_is_its_mean_squared_error() -> None:
    truth = np.array([[1.0, 2.0], [0.0, 4.0]])
    assert mean_squared_errors(np.zeros((2, 2, 1)), truth).tolist() == [2.5, 8.0]


def test_the_model_of_the_experiments_filters_as_any_other() -> None:
    model = make_model(make_law("FMC2", (0.15, 0.6, 0.2)), "transition")
    y = model.simulate(50, np.random.default_rng(0)).y
    plain = CGOFMSModel(
        FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2),
        [[0.0, 3.0], [0.0, 0.0]],
        hard_covariances(),
        1,
        interpolation="transition",
    )
    found, expected = (OFSRFilter(m, n_nodes=5).filter(y) for m in (model, plain))
    for name in ("x", "P", "mu", "log_likelihood"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize("name", ["densities", "trajectories", "restoration", "nodes"])
def test_pictures_are_drawn(outcomes, name, tmp_path) -> None:
    files = write(outcomes[name], tmp_path)
    assert files[2].stat().st_size > 10_000
    figure = outcomes[name].experiment.draw(outcomes[name].samples)
    for axes in figure.axes:
        assert axes.get_xlabel() or axes.get_ylabel()
        assert axes.has_data()


def test_nodes_have_the_printed_size() -> None:
    assert NODES.pieces["FMC1"] == {"parameters": (0.07, 0.05, 0.16), "n": 300, "most": 9}
