"""A conformance check for filters: those of this package, and your own.

`check_filter` plays through what `fuzzykf.base.Filter` promises and says which
promise a filter breaks.  What is checked follows from what the filter offers:
one with a ``log_likelihood`` is asked whether it is that of a density, one with
``mu`` and ``nodes`` whether its modes are probabilities, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_numbers, brief
from fuzzykf.reprs import reprs
from fuzzykf.testing import basics, capabilities, promises  # noqa: F401 - they register their checks
from fuzzykf.testing.case import CHECKS, Case, FilterCheckError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from fuzzykf.base import Filter

__all__ = ["CheckReport", "FilterCheckError", "check_filter"]


@reprs()
@dataclass(frozen=True)
class CheckReport:
    """Checks that `check_filter` ran.

    Attributes
    ----------
    filter : str
        Name of the class that was checked.
    passed : tuple of str
        Names of the checks that ran and passed.
    not_applicable : dict
        Other checks, with the reason why they were not run.

    Examples
    --------
    >>> print(CheckReport("MyFilter", ("shapes", "step"), {"smooth": "no method smooth"}))
    MyFilter: 2 checks passed (shapes, step); not applicable: smooth (no method smooth)
    """

    filter: str
    passed: tuple[str, ...]
    not_applicable: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """One line with all names."""
        text = f"{self.filter}: {len(self.passed)} checks passed ({', '.join(self.passed)})"
        if self.not_applicable:
            reasons = (f"{name} ({reason})" for name, reason in self.not_applicable.items())
            text += f"; not applicable: {', '.join(reasons)}"
        return text


def check_filter(factory: Callable[[], Filter], zs: ArrayLike | None = None) -> CheckReport:
    """Check a filter against the contract of `fuzzykf.base.Filter`.

    Parameters
    ----------
    factory : callable
        Returns a new filter at each call, always in the same state, ready to predict.
    zs : array_like, shape (n, dim_z), optional
        At least six admissible observations; by default ten smooth ones between -1/2 and 1/2.

    Returns
    -------
    CheckReport
        Which checks ran, and which do not apply to this filter.

    Raises
    ------
    FilterCheckError
        At the first check that fails; the message tells what was done, found and expected.  It is an
        AssertionError as well.

    Notes
    -----
    Every filter: ``construction``, ``shapes``, ``covariance``, ``repeatable``, ``step``,
    ``priors``, ``filter``, ``continuation``, ``empty_series``, ``batch_filter``, ``observation_forms``,
    ``bad_observations``, ``input``, ``copy``, ``pickle``, ``saver``, ``reset``, ``refused``,
    ``overrides``, ``resume``; and, unless its ``update(None)`` raises NotImplementedError,
    ``missing``, ``missing_nan``, ``missing_component`` and ``missing_forms``.
    With ``log_likelihood``: ``log_likelihood``, ``density``, ``outlier``.
    With ``mu`` and ``nodes``: ``mode_probabilities``, ``leading_predict``, ``sequence``.
    With ``membership`` and ``possibility``: ``possibility``.
    With the methods of these names: ``filter_many``, ``smooth``, ``save``.

    A filter with ``mu`` and ``nodes`` starts `Filter.filter` from its initial law and takes one
    observation per step; any other continues from its current state.

    Examples
    --------
    >>> from fuzzykf import KalmanFilter
    >>> from fuzzykf.testing import check_filter
    >>> report = check_filter(lambda: KalmanFilter(dim_x=1, dim_z=1, H=[[1.0]]))
    >>> "step" in report.passed, report.not_applicable["mode_probabilities"]
    (True, 'no mu and nodes')
    """
    if not callable(factory):
        raise ParameterError(f"factory: got {brief(factory)}, expected a function that makes a filter")
    case = Case(factory, None if zs is None else as_numbers("zs", zs).copy())
    passed: list[str] = []
    not_applicable: dict[str, str] = {}
    for name, check in CHECKS.items():
        reason = case.why_not(name)
        if reason is not None:
            not_applicable[name] = reason
            continue
        try:
            check(case)
        except FilterCheckError:
            raise
        except Exception as error:
            raise FilterCheckError(
                f"{case.name} fails {name!r}: {type(error).__name__} was raised: {error}"
            ) from error
        passed.append(name)
    return CheckReport(case.name, tuple(passed), not_applicable)
