"""What the models that are learned share; their base stands below, where state-space models find it, too."""

from __future__ import annotations

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count
from fuzzykf.switching.dynamics.model import NODES, SwitchingModel

__all__ = ["NODES", "SwitchingModel", "given_regimes"]


def given_regimes(n_switches: int | None, n_regimes: int | None, default: int | None = None) -> int:
    """Return the number of regimes, which has two names: a switch takes as many values as there are regimes.

    Parameters
    ----------
    n_switches, n_regimes : int, optional
        The older name, and the one that says what is counted.
    default : int, optional
        Without either.

    Raises
    ------
    ParameterError
        If it is no whole number of at least 1, given twice and different, or missing without a default.

    Examples
    --------
    >>> given_regimes(None, 3), given_regimes(3, 3), given_regimes(None, None, 2)
    (3, 3, 2)
    """
    names = {"n_switches": n_switches, "n_regimes": n_regimes}
    given = {name: as_count(name, value, 1) for name, value in names.items() if value is not None}
    if len(set(given.values())) > 1:
        raise ParameterError(
            f"n_switches, n_regimes: got {n_switches} and {n_regimes}, two names of the number of regimes; "
            "expected one of them"
        )
    if given:
        return next(iter(given.values()))
    if default is None:
        raise ParameterError("n_regimes: missing; expected the number of regimes")
    return default
