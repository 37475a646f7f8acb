"""Comparing what was measured with what was printed, by tests that are said aloud.

A paper prints means of a few runs, without their spread.  The spread is taken from the
runs made here, for both sides, and the rounding of the print is granted.  The tests of
one experiment share its level by Bonferroni's rule, so that an experiment that is
entirely right is called so with probability 1 - `LEVEL` at least.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

__all__ = [
    "LEVEL",
    "Finding",
    "Row",
    "claim",
    "exact",
    "judge",
    "measured",
    "printed_mean",
    "printed_sample",
    "printed_wins",
    "wins_claim",
]

#: Probability with which an experiment that is right in all its rows is found wrong in one.
LEVEL = 0.05


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One quantity: what was printed, what was measured, and how well they agree.

    Attributes
    ----------
    quantity : str
    printed : float or None
        None if the paper prints no number.
    ours : float
    standard_error : float or None
        Of ``ours``; None if nothing in it is random.
    kind : {"agreement", "claim", "measured"}
        "agreement": a number was printed, and the test looks for a difference.  "claim": the
        paper says that something is so, and the test looks for evidence.  "measured": the
        paper says nothing.
    p_value : float or None
        Of the test.
    test : str
        Its name.
    correction : str
        What was corrected before it could be measured.
    reason : str
        Known reason for which it cannot be reproduced.
    interval : (float, float) or None
        Of 95 % for ``ours``, where the standard error does not tell it.
    """

    quantity: str
    ours: float
    printed: float | None = None
    standard_error: float | None = None
    kind: Literal["agreement", "claim", "measured"] = "measured"
    p_value: float | None = None
    test: str = ""
    correction: str = ""
    reason: str = ""
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Row(Finding):
    """A finding with its verdict.

    Attributes
    ----------
    verdict : str
        "reproduced", "reproduced with a correction", "not reproduced", or "not printed".
    """

    verdict: str

    @property
    def note(self) -> str:
        """Which correction, or why not."""
        return {"reproduced with a correction": self.correction, "not reproduced": self.reason}.get(
            self.verdict, ""
        )


def judge(findings: Sequence[Finding], level: float = LEVEL) -> list[Row]:
    """Give each finding its verdict.

    Parameters
    ----------
    findings : sequence of Finding
        All those of one experiment.
    level : float
        Shared by the tests among them: each has its share ``level / number of tests``.

    Returns
    -------
    list of Row

    Examples
    --------
    >>> [
    ...     row.verdict
    ...     for row in judge(
    ...         [exact("p", printed="0.69", ours=2 / 3), measured("q", [1.0, 2.0])]
    ...     )
    ... ]
    ['not reproduced', 'not printed']
    """
    tested = [f for f in findings if f.p_value is not None]
    share = level / max(len(tested), 1)
    rows = []
    for finding in findings:
        verdict = "not printed"
        reason = finding.reason
        if finding.p_value is not None:
            small = finding.p_value < share
            if small == (finding.kind == "claim"):
                verdict = "reproduced with a correction" if finding.correction else "reproduced"
            else:
                verdict = "not reproduced"
                reason = reason or _why_not(finding)
        rows.append(Row(**(vars(finding) | {"reason": reason}), verdict=verdict))
    return rows


def _why_not(finding: Finding) -> str:
    if finding.kind == "claim":
        return f"not established at the level of the experiment ({finding.test}: p = {finding.p_value:.2g})"
    if finding.test == "equal to the last printed digit":
        return f"it is {finding.ours:.4g}"
    return f"differs ({finding.test}: p = {finding.p_value:.2g})"


# --------------------------------------------------------------------------- findings


def measured(quantity: str, samples: ArrayLike) -> Finding:
    """Return the mean of runs of which the paper says nothing."""
    mean, error = _mean(quantity, samples)
    return Finding(quantity=quantity, ours=mean, standard_error=error)


def exact(quantity: str, *, printed: str, ours: float, correction: str = "", reason: str = "") -> Finding:
    """Compare a number in which nothing is random with its print, to the last printed digit.

    Parameters
    ----------
    quantity : str
    printed : str
        As in the paper: ".69" grants half a unit of the second decimal.
    ours : float
    correction, reason : str
        See `Finding`.
    """
    agrees = abs(ours - float(printed)) <= _rounding(printed) * (1.0 + 1e-9)
    return Finding(
        quantity=quantity,
        printed=float(printed),
        ours=ours,
        kind="agreement",
        p_value=1.0 if agrees else 0.0,
        test="equal to the last printed digit",
        correction=correction,
        reason=reason,
    )


def printed_mean(
    quantity: str,
    samples: ArrayLike,
    *,
    printed: str,
    printed_runs: int | None = None,
    correction: str = "",
    reason: str = "",
) -> Finding:
    """Compare the mean of runs with a printed number, or a printed mean of other runs.

    Student's t: the difference, less the rounding of the print, in units of
    s sqrt(1/n + 1/n'), where s is the standard deviation of our n runs and n' = ``printed_runs``.

    Parameters
    ----------
    quantity : str
    samples : array_like, shape (n,)
        One number per run.
    printed : str
        As in the paper.
    printed_runs : int, optional
        Runs that the paper has averaged; by default what is printed has no error of its own.
    correction, reason : str
        See `Finding`.
    """
    from scipy import stats

    mean, error = _mean(quantity, samples)
    n = np.size(samples)
    distance = max(0.0, abs(mean - float(printed)) - _rounding(printed))
    scale = error * np.sqrt(1.0 + (0.0 if printed_runs is None else n / printed_runs))
    with np.errstate(divide="ignore"):  # runs that do not scatter, and differ
        p_value = 2.0 * float(stats.t.sf(np.divide(distance, scale), n - 1)) if distance > 0.0 else 1.0
    return Finding(
        quantity=quantity,
        printed=float(printed),
        ours=mean,
        standard_error=error,
        kind="agreement",
        p_value=p_value,
        test="two-sided t",
        correction=correction,
        reason=reason,
    )


def printed_wins(
    quantity: str, wins: int, runs: int, *, printed: tuple[int, int], correction: str = "", reason: str = ""
) -> Finding:
    """Compare a share of won runs with a printed count, by Fisher's exact test.

    The interval is Wilson's.

    Parameters
    ----------
    quantity : str
    wins, runs : int
        Ours.
    printed : (int, int)
        The paper's wins and runs.
    correction, reason : str
        See `Finding`.
    """
    from scipy import stats

    share = wins / runs
    wilson = stats.binomtest(wins, runs).proportion_ci(method="wilson")
    table = [[wins, runs - wins], [printed[0], printed[1] - printed[0]]]
    return Finding(
        quantity=quantity,
        printed=printed[0] / printed[1],
        ours=share,
        standard_error=float(np.sqrt(share * (1.0 - share) / runs)),
        kind="agreement",
        p_value=float(stats.fisher_exact(table).pvalue),
        test="Fisher's exact test",
        correction=correction,
        reason=reason,
        interval=(float(wilson.low), float(wilson.high)),
    )


def printed_sample(
    quantity: str, samples: ArrayLike, *, printed: ArrayLike, correction: str = "", reason: str = ""
) -> Finding:
    """Compare runs with printed runs, one by one: the Kolmogorov-Smirnov test of two samples.

    Medians are told, with an interval by order statistics: what is compared this way has
    heavy tails, and may be infinite in a few runs.

    Parameters
    ----------
    quantity : str
    samples, printed : array_like, shapes (n,) and (n',)
        One number per run.
    correction, reason : str
        See `Finding`.
    """
    from scipy import stats

    values, others = (np.asarray(given, dtype=np.float64) for given in (samples, printed))
    if values.ndim != 1 or values.size < 2 or np.isnan(values).any():
        raise ParameterError(f"samples: of {quantity!r}: expected at least two numbers, one per run")
    bounds = stats.quantile_test(values, p=0.5).confidence_interval(0.95)
    return Finding(
        quantity=f"{quantity}, median",
        printed=float(np.median(others)),
        ours=float(np.median(values)),
        interval=(float(bounds.low), float(bounds.high)) if np.isfinite(bounds).all() else None,
        kind="agreement",
        p_value=float(stats.ks_2samp(values, others).pvalue),
        test="Kolmogorov-Smirnov",
        correction=correction,
        reason=reason,
    )


def claim(quantity: str, samples: ArrayLike, *, correction: str = "", reason: str = "") -> Finding:
    """Look for evidence that something said in words is positive on average: one-sided t.

    Parameters
    ----------
    quantity : str
    samples : array_like, shape (n,)
        One number per run, for instance the error of a rival less that of the filter.
    correction, reason : str
        See `Finding`.
    """
    from scipy import stats

    mean, error = _mean(quantity, samples)
    score = np.inf * np.sign(mean) if error == 0.0 else mean / error
    return Finding(
        quantity=quantity,
        ours=mean,
        standard_error=error,
        kind="claim",
        p_value=1.0 if mean <= 0.0 else float(stats.t.sf(score, np.size(samples) - 1)),
        test="one-sided t",
        correction=correction,
        reason=reason,
    )


def wins_claim(quantity: str, wins: int, runs: int, *, correction: str = "", reason: str = "") -> Finding:
    """Look for evidence that more than half of all runs are won: one-sided binomial test.

    Parameters
    ----------
    quantity : str
    wins, runs : int
    correction, reason : str
        See `Finding`.
    """
    from scipy import stats

    test = stats.binomtest(wins, runs, 0.5, alternative="greater")
    share = wins / runs
    return Finding(
        quantity=quantity,
        ours=share,
        standard_error=float(np.sqrt(share * (1.0 - share) / runs)),
        kind="claim",
        p_value=float(test.pvalue),
        test="one-sided binomial",
        correction=correction,
        reason=reason,
    )


def _mean(quantity: str, samples: ArrayLike) -> tuple[float, float]:
    values = np.asarray(samples, dtype=np.float64)
    if values.ndim != 1 or values.size < 2 or not np.isfinite(values).all():
        raise ParameterError(f"samples: of {quantity!r}: expected at least two finite numbers, one per run")
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(values.size))


def _rounding(printed: str) -> float:
    """Return half a unit of the last printed digit."""
    mantissa, _, exponent = printed.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)
