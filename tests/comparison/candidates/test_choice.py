"""What is chosen inside of the rows to learn on is judged on all blocks, and on nothing that was learned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from fuzzykf import FuzzykfError
from fuzzykf.comparison import Estimates, Learned, LearningPart
from fuzzykf.comparison.candidates.choice import choose, rolling_blocks
from fuzzykf.comparison.scores import standard_error
from fuzzykf.errors import MissingDependencyError


class Level(Learned):
    """Answers a level for blocks that begin in one half of the rows, and another in the other."""

    def __init__(self, part, early, late, std):
        self.rows, self.early, self.late, self.std = len(part), early, late, std

    def restore(self, before, zs):
        assert len(before) == self.rows  # judged on the rows just after those that were learned on
        level = self.early if self.rows < 500 else self.late
        return Estimates(mean=np.full((len(zs), 1), level), std=np.full((len(zs), 1), self.std))

    def stepper(self):
        raise NotImplementedError


@pytest.fixture
def part():
    x = np.random.default_rng(0).normal(size=(600, 1))
    return LearningPart(x=x, y=x)


OPTIONS = {"steady": (0.2, 0.2, 1.0), "last": (3.0, 0.0, 1.0), "bold": (0.0, 0.0, 0.2)}


def learn(part, option):
    return Level(part, *OPTIONS[option])


def test_blocks_cut_the_second_half_and_all_of_them_count(part) -> None:
    assert rolling_blocks(601) == ((300, 401), (401, 501), (501, 601))
    # The last block alone would choose "last"; all together choose "steady", or by error alone "bold".
    assert choose(part, ["steady", "last"], learn, by="log score").best == "steady"
    assert choose(part, [*OPTIONS], learn, by="log score").best == "steady"
    assert choose(part, [*OPTIONS], learn, by="squared error").best == "bold"


def test_scores_and_lead_are_those_of_the_definitions(part) -> None:
    found = choose(part, [*OPTIONS], learn, by="log score")
    x, scale = part.x[300:, 0], part.x.std()
    level = {"steady": np.full(300, 0.2), "last": np.repeat([3.0, 3.0, 0.0], 100), "bold": np.zeros(300)}
    each = {
        name: norm.logpdf(x / scale, mean / scale, OPTIONS[name][2] / scale) for name, mean in level.items()
    }
    np.testing.assert_allclose(found.log_score, [each[name].mean() for name in OPTIONS])
    expected = [np.sqrt(np.mean((x - level[name]) ** 2)) / scale for name in OPTIONS]
    np.testing.assert_allclose(found.rmse, expected)
    second = max(("last", "bold"), key=lambda name: each[name].mean())
    assert found.lead == pytest.approx((each["steady"] - each[second]).mean())
    assert found.lead_error == pytest.approx(standard_error(each["steady"] - each[second]))
    np.testing.assert_array_equal(found.errors[:, 0], x - 0.2)
    told = found.told("level")
    assert told.startswith("level: steady (chosen from steady, last, bold on 3 rolling blocks by log score: ")
    assert f"with {second}, difference {found.lead:.2g} ± {found.lead_error:.2g}, a significant diff" in told


def test_a_draw_is_said_to_be_one_and_rows_without_a_state_do_not_count(part) -> None:
    OPTIONS["same"] = OPTIONS["steady"]
    try:
        found = choose(part, ["steady", "same"], learn, by="squared error")
    finally:
        del OPTIONS["same"]
    assert (found.best, found.lead) == ("steady", 0.0)
    assert "not a significant difference" in found.told("level")
    part.x[350:450] = np.nan
    missing = choose(part, [*OPTIONS], learn, by="squared error")
    assert missing.rmse[2] == pytest.approx(np.sqrt(np.nanmean(part.x[300:] ** 2)) / np.nanstd(part.x))
    part.x[300:] = np.nan
    with pytest.raises(FuzzykfError, match="the state is missing in all of the last 300 rows to learn on"):
        choose(part, [*OPTIONS], learn, by="squared error")


def test_what_fails_is_told_and_a_missing_package_is_not_swallowed(part) -> None:
    def partly(rows, option):
        if option == "bold" and len(rows) > 450:
            raise FuzzykfError("not so bold")
        return learn(rows, option)

    found = choose(part, [*OPTIONS], partly, by="squared error")
    assert found.tried == ("steady", "last")
    assert found.told("level").endswith("; bold could not be learned: not so bold)")
    with pytest.raises(FuzzykfError, match=r"^not so bold$"):
        choose(part, ["bold"], partly, by="squared error")

    def lacking(rows, option):
        raise MissingDependencyError("pip install it")

    with pytest.raises(MissingDependencyError, match="pip install it"):
        choose(part, [*OPTIONS], lacking, by="squared error")
