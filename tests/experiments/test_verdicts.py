"""Verdicts: right numbers pass at the stated rate, wrong ones fail, and the reason is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fuzzykf.errors import ParameterError
from fuzzykf.experiments.verdicts import (
    LEVEL,
    claim,
    exact,
    judge,
    measured,
    printed_mean,
    printed_sample,
    printed_wins,
    wins_claim,
)


def verdict(finding):
    return judge([finding])[0].verdict


@pytest.mark.parametrize(
    ("printed", "ours", "expected"),
    [
        ("0.69", 0.6949, "reproduced"),
        ("0.69", 0.6667, "not reproduced"),
        ("0.690", 0.6949, "not reproduced"),  # one digit more leaves less room
        ("1.5e-3", 0.00154, "reproduced"),
        ("1.5e-3", 0.00156, "not reproduced"),
        ("12", 12.4, "reproduced"),
    ],
)
def test_a_number_without_chance_has_to_agree_to_the_last_printed_digit(printed, ours, expected) -> None:
    assert verdict(exact("q", printed=printed, ours=ours)) == expected


def test_a_printed_mean_is_judged_by_students_t_with_the_errors_of_both_sides() -> None:
    samples = np.array([1.0, 2.0, 4.0, 5.0, 6.0])
    finding = printed_mean("q", samples, printed="9.00", printed_runs=20)
    distance = 9.0 - 0.005 - samples.mean()
    scale = samples.std(ddof=1) * np.sqrt(1 / 5 + 1 / 20)
    assert finding.p_value == pytest.approx(2 * stats.t.sf(distance / scale, df=4))
    assert finding.standard_error == pytest.approx(stats.sem(samples))


def test_a_printed_number_without_an_error_of_its_own_is_the_usual_test_of_one_sample() -> None:
    samples = np.random.default_rng(0).normal(size=30)
    finding = printed_mean("q", samples, printed="0.500000000000")
    assert finding.p_value == pytest.approx(stats.ttest_1samp(samples, 0.5).pvalue, rel=1e-6)


def test_runs_that_do_not_scatter_and_differ_are_not_reproduced() -> None:
    assert verdict(printed_mean("q", [1.0, 1.0], printed="2.0", printed_runs=5)) == "not reproduced"
    assert verdict(printed_mean("q", [1.0, 1.0], printed="1.0", printed_runs=5)) == "reproduced"


def test_right_papers_of_many_rows_are_called_right_as_often_as_said() -> None:
    # 300 papers of 10 true means each, of 20 runs; ours of 15. About 10 % of them may be found wrong.
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(300):
        papers, ours = rng.normal(size=(10, 20)).mean(axis=1), rng.normal(size=(10, 15))
        findings = [
            printed_mean(str(k), ours[k], printed=f"{papers[k]:.9f}", printed_runs=20) for k in range(10)
        ]
        wrong += any(row.verdict == "not reproduced" for row in judge(findings, level=0.1))
    assert stats.binomtest(wrong, 300, 0.1).pvalue > 1e-3


def test_a_wrong_number_among_right_ones_is_found() -> None:
    rng = np.random.default_rng(2)
    findings = [printed_mean(str(k), rng.normal(size=50), printed="0.0", printed_runs=50) for k in range(10)]
    findings.append(printed_mean("wrong", rng.normal(size=50), printed="2.0", printed_runs=50))
    assert [row.quantity for row in judge(findings) if row.verdict == "not reproduced"] == ["wrong"]


def test_a_claim_needs_evidence_in_its_direction() -> None:
    gains = np.random.default_rng(3).normal(1.0, 1.0, 40)
    assert verdict(claim("q", gains)) == "reproduced"
    assert verdict(claim("q", -gains)) == "not reproduced"
    assert verdict(claim("q", gains - gains.mean())) == "not reproduced"
    assert claim("q", gains).p_value == pytest.approx(
        stats.ttest_1samp(gains, 0, alternative="greater").pvalue
    )


def test_shares_of_won_runs_are_compared_by_fishers_exact_test() -> None:
    finding = printed_wins("q", 1000, 2000, printed=(15, 20))
    assert finding.p_value == pytest.approx(stats.fisher_exact([[1000, 1000], [15, 5]]).pvalue)
    assert (finding.printed, finding.ours) == (0.75, 0.5)
    assert verdict(printed_wins("q", 200, 2000, printed=(15, 20))) == "not reproduced"


def test_the_level_is_shared_among_the_tests_and_not_with_what_is_only_measured() -> None:
    doubtful = claim("q", [0.9, 1.0, 1.1, -0.5, 2.0])
    assert LEVEL / 2 < doubtful.p_value < LEVEL
    assert judge([doubtful, measured("m", [1.0, 2.0])])[0].verdict == "reproduced"
    assert judge([doubtful, exact("e", printed="1", ours=1.0)])[0].verdict == "not reproduced"


def test_a_note_tells_the_correction_or_the_reason() -> None:
    right = judge([exact("q", printed="1", ours=1.0, correction="a stray inverse", reason="-")])[0]
    assert (right.verdict, right.note) == ("reproduced with a correction", "a stray inverse")
    wrong = judge([exact("q", printed="1", ours=2.0, correction="a stray inverse", reason="a misprint")])[0]
    assert (wrong.verdict, wrong.note) == ("not reproduced", "a misprint")
    unexplained = judge([claim("q", [-1.0, -2.0, -3.0])])[0]
    assert unexplained.note == "not established at the level of the experiment (one-sided t: p = 1)"
    assert judge([measured("q", [1.0, 2.0])])[0].verdict == "not printed"


@pytest.mark.parametrize("samples", [[1.0], [], [1.0, np.nan], [[1.0, 2.0]]])
def test_samples_that_do_not_tell_their_scatter_are_refused(samples) -> None:
    with pytest.raises(ParameterError, match="samples: of 'q'"):
        measured("q", samples)


def test_printed_runs_are_compared_with_ours_as_samples() -> None:
    rng = np.random.default_rng(4)
    ours, printed = rng.exponential(size=500), rng.exponential(size=20)
    finding = printed_sample("q", ours, printed=printed)
    assert finding.p_value == pytest.approx(stats.ks_2samp(ours, printed).pvalue)
    assert (finding.printed, finding.ours) == (np.median(printed), np.median(ours))
    lower, upper = finding.interval
    assert np.mean(ours < lower) == pytest.approx(0.5 - 1.96 * 0.5 / np.sqrt(500), abs=0.006)
    assert np.mean(ours <= upper) == pytest.approx(0.5 + 1.96 * 0.5 / np.sqrt(500), abs=0.006)
    assert verdict(printed_sample("q", ours, printed=10.0 * printed)) == "not reproduced"


def test_of_samples_a_run_may_be_infinite_but_not_undefined() -> None:
    assert printed_sample("q", [1.0, 2.0, np.inf], printed=[1.0, 2.0]).ours == 2.0
    assert printed_sample("q", [1.0, 2.0, np.inf], printed=[1.0, 2.0]).interval is None  # of three runs
    with pytest.raises(ParameterError, match="samples: of 'q'"):
        printed_sample("q", [1.0, np.nan], printed=[1.0, 2.0])


def test_more_than_half_has_to_be_shown() -> None:
    finding = wins_claim("q", 60, 100)
    assert finding.p_value == pytest.approx(stats.binom.sf(59, 100, 0.5))
    assert (finding.kind, finding.ours) == ("claim", 0.6)
    assert verdict(wins_claim("q", 80, 100)) == "reproduced"
    assert verdict(wins_claim("q", 50, 100)) == "not reproduced"
