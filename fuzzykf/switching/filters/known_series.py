"""Series of a known switch: what stands before them, their paths, and many of them side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.errors import NumericalRangeError, ParameterError
from fuzzykf.switching.filters.inputs import NOTHING, Inputs, Told
from fuzzykf.switching.filters.known_inputs import led, read_each_along
from fuzzykf.switching.filters.known_values import may_be, read_switches
from fuzzykf.switching.inference.known_paths import SIDE_BY_SIDE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.model import SwitchingModel
    from fuzzykf.switching.dynamics.pairs import PairTables
    from fuzzykf.switching.dynamics.placed import KnownPath
    from fuzzykf.switching.inference.series import Stand

__all__ = [
    "GIVEN_ONCE",
    "NEVER_GIVEN",
    "Before",
    "filter_side_by_side",
    "path_of",
    "rivals_of",
    "tables_between",
]

NEVER_GIVEN = "r: the value of the switch at the missing observation was never given"
GIVEN_ONCE = "r: got {} after {}; the switch is given once per observation"


class Before(NamedTuple):
    """What a filter knows before a series that goes on from where it stands; by default the series begins."""

    n: int = 0  # observations taken
    predicted: bool = False  # whether it has moved since
    r: Any = None  # value of the switch at the latest of them
    r_next: Any = None  # at the next one, None if it is not known yet
    told: Told = NOTHING  # of the step there

    def values(self, r: FloatArray) -> list[Any]:
        """Return the values of the switch that stand before those of a series, (n,) or (n, K).

        Raises
        ------
        ParameterError
            If another one was given before, or none of an observation that was skipped.
        """
        if self.n == 0:
            if len(r) and not may_be(r[0], self.r_next):
                raise ParameterError(GIVEN_ONCE.format(r[0], self.r_next))
            return []
        if self.predicted and self.r_next is None:
            raise ParameterError(NEVER_GIVEN)
        return [self.r] if self.r_next is None else [self.r, self.r_next]


def path_of(
    model: SwitchingModel,
    r: FloatArray,
    us: FloatArray | None,
    looks: Mapping[str, Any],
    before: Before,
) -> tuple[Any, Inputs]:
    """Return the path of one series, from where the filter stands on, and what is told along the series.

    Parameters
    ----------
    model : SwitchingModel
    r : ndarray, shape (n,) or (n, K)
        Values of the switch at its observations.
    us : ndarray, shape (1, n, k), or None
        The controls that lead to them.
    looks : mapping of str to object
        "Rs" and "Hs" as they were given; None or left out where they were not.
    before : Before
    """
    told = _told_along(model, model.class_weights(r)[None], us, looks)
    values = before.values(r)
    path: Any = model.along(np.concatenate([values, r]) if values else r, start=before.n - 1 if values else 0)
    driven = _led(model, told, values, before, len(r))
    return path if _is_silent(driven) else path.driven(*driven), told


def filter_side_by_side(
    model: SwitchingModel,
    series: FloatArray,
    r: FloatArray,
    us: FloatArray | None,
    looks: Mapping[str, Any],
    before: Before,
    stand: Stand | None,
) -> dict[str, FloatArray] | None:
    """Filter series (s, n, q) of one length; None where each has to go alone.

    Parameters
    ----------
    model, looks, before
        As in `path_of`.
    series : ndarray, shape (s, n, q)
        NaN where missing; s and n of at least one.
    r : ndarray, shape (s, n) or (s, n, K)
        Values of the switch, as they were given.
    us : ndarray, shape (s, n, k), or None
        Here s may be 1, where all series share the controls.
    stand : Stand or None
        Where the filter stands, None at the beginning.

    Returns
    -------
    dict of str to ndarray, shape (s, n, ...), or None
        All fields that a filter of a known switch shows.
    """
    s, n, q = series.shape
    r = np.array([read_switches(one, n, model) for one in r])
    shares = np.array([model.class_weights(one) for one in r])
    told = _told_along(model, shares, us, looks)
    before_each = [before.values(one) for one in r]
    values = before_each[0]  # the same for all
    path_r, path_shares = r, shares
    if values:
        begin = np.array(values)
        path_r, path_shares = (
            np.concatenate([np.broadcast_to(first, (s, *first.shape)), each], axis=1)
            for first, each in ((begin, r), (model.class_weights(begin), shares))
        )
    paths = model.form.along_many(path_shares, path_r)
    if paths is None:
        return None
    driven = _led(model, told, values, before, n)
    if not _is_silent(driven):
        paths = paths.driven(*driven)
    skipped = 0 if stand is None else int(stand.skips)  # an observation, which is missing
    ys = np.concatenate([np.full((s, skipped, q), np.nan), series], axis=1)
    try:
        found = SIDE_BY_SIDE[model.form.known_method](paths, ys, stand)
    except (np.linalg.LinAlgError, NumericalRangeError):
        return None  # the series in which it goes wrong says where, when it goes alone
    known = {"mu": np.ones((s, n, 1)), "switch": r, "class_weights": shares}
    if not model.takes_weights:
        known["switch_mean"] = r
    return {name: one[:, skipped:] for name, one in found.items()} | known


def tables_between(
    model: SwitchingModel, n: int, before: Any, after: Any, u: FloatArray | None
) -> PairTables | None:
    """Return the tables of the step to observation ``n`` between two values; None to the first of all."""
    if not n:
        return None
    path: Any = model.along(np.array([before, after]), start=n - 1)
    tables: PairTables = (path if u is None else path.driven(np.stack([0.0 * u, u])[None])).pair_tables(0)
    return tables


def rivals_of(path: KnownPath) -> str:
    """Name the filters that find the switch of the model of a path."""
    return "an OFSRFilter or a CGOMSMFilter" if path.mix is None else "a SwitchingKalmanFilter"


def _told_along(
    model: SwitchingModel, shares: FloatArray, us: FloatArray | None, looks: Mapping[str, Any]
) -> Inputs:
    """Return what is told along series whose switches have these shares (s, n, K)."""
    own = model.along(np.empty(0))
    seen = (read_each_along(name, looks.get(name), shares, own, model.form) for name in ("Hs", "Rs"))
    return Inputs(us, *seen)


def _led(model: SwitchingModel, told: Inputs, values: list[Any], before: Before, n: int) -> Inputs:
    """Return what is told along series of ``n`` observations, and of the values of the switch before them."""
    return led(told, model.class_weights(np.array(values)), model.form, before.told, n) if values else told


def _is_silent(told: Inputs) -> bool:
    return all(one is None for one in told)
