"""Whole series of systems with inputs and features: gaps filled in, and complete stretches at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.gaussian import mixture_moments
from fuzzykf.switching.dynamics.inputs import DrivenSystem

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.inputs import InputSystem
    from fuzzykf.switching.inference.method import Method
    from fuzzykf.switching.inference.series import Stand

__all__ = ["Onward", "along", "expected", "filter_stretch", "starting_past"]

#: Steps whose pairs of nodes are held at once.
_CHUNK = 1024


def starting_past(y: FloatArray, n_past: int) -> FloatArray:
    """Return what stands for observations before the first one, which is ``y``: zero where it is missing."""
    return np.repeat(np.nan_to_num(y)[None], n_past, axis=0)


def expected(method: Method, tables: Any, mixture: Any, y: FloatArray) -> FloatArray:
    """Return an observation (q,), or what was expected of the parts that are missing."""
    missing = np.isnan(y)
    return np.where(missing, method.ahead(tables, mixture).z, y) if missing.any() else y


def along(
    method: Method,
    system: InputSystem,
    ys: FloatArray,
    us: FloatArray,
    past: FloatArray | None = None,
    stand: Stand | None = None,
) -> tuple[DrivenSystem, FloatArray]:
    """Return the system along a series (n, q), NaN where missing, and the series without gaps.

    Parameters
    ----------
    method : Method
    system : InputSystem
    ys, us : ndarray, shapes (n, q) and (n, k)
    past : ndarray, shape (n_past, q), optional
        Observations before the first, the latest first, where a filter goes on.
    stand : Stand, optional
        Where it stands then: the series begins with what it has skipped.
    """
    n_past, origin = system.features.n_past, 0 if stand is None else stand.n
    full = ys.copy()
    holes = np.flatnonzero(np.isnan(ys).any(axis=1))
    if past is None:
        law = system.initial()
        if len(ys) and np.isnan(ys[0]).any():
            full[0] = np.where(np.isnan(ys[0]), law.ahead(system.dim_x).z, ys[0])
        lead = starting_past(full[0] if len(ys) else np.zeros(system.dim_z), n_past)
    else:
        lead = past[::-1]
    if holes.size and (holes[-1] > 0 or stand is not None):
        _fill(method, system, ys, us, lead, full, int(holes[-1]), stand)
    return DrivenSystem(system, full, us, lead, origin), full


def _fill(
    method: Method,
    system: InputSystem,
    ys: FloatArray,
    us: FloatArray,
    lead: FloatArray,
    full: FloatArray,
    last: int,
    stand: Stand | None,
) -> None:
    """Put what was expected in the place of what is missing, up to observation ``last``; in place."""
    n_past = system.features.n_past
    mixture: Any = None if stand is None else stand.mixture
    for k in range(last + 1):
        y = ys[k]
        if mixture is None:
            mixture, _ = method.first(system.initial(), y)
            continue
        past = np.concatenate([lead, full[:k]])[-1 : -n_past - 1 : -1]
        tables = system.driven_tables(past, us[k])
        full[k] = expected(method, tables, mixture, y)
        given: Any = tables.filled(full[k])
        mixture, _ = method.advance(given, mixture, y, y.size)


def filter_stretch(
    system: DrivenSystem,
    tables: Any,
    table: FloatArray,
    ys: FloatArray,
    start: int,
    stop: int,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Filter complete observations start, ..., stop - 1 of one series (1, n, q) whose tables are constant.

    Parameters
    ----------
    system : DrivenSystem
    tables : DrivenTables
        Of the first of these steps.
    table : ndarray, shape (1, 1 + m + m*m, M)
        The state before.
    ys, start, stop, out
        As in `fuzzykf.engine.numpy.series.filter_series`.

    Returns
    -------
    before, last : ndarray, shape (1, 1 + m + m*m, M)
        The states after the last two observations.
    """
    chain, m, shift = system.chain, system.dim_x, tables.number - start
    known, own = system.windows(start + shift, stop + shift)
    before, new = ys[0, start - 1 : stop - 1], ys[0, start:stop]
    ones = np.ones((stop - start, 1))
    found, _, log_likelihood = engine.run(
        tables.kernel, table[0], None, np.concatenate([ones, before, known, own, new], axis=1)
    )
    both = np.concatenate([table, found])
    switch = chain.keys, chain.weights, chain.atoms, chain.ranking
    engine.summarise(out, slice(start, stop), both[None, 1:], None, log_likelihood[None], switch)
    if "x_prior" in out or "P_prior" in out:
        for a in range(0, stop - start, _CHUNK):
            part = slice(a, min(a + _CHUNK, stop - start))
            window = np.concatenate([before[part], known[part], np.zeros_like(own[part])], axis=1)
            x, P = _before(system, tables, both[:-1][part], window, m, start + shift + a)
            for name, values in (("x_prior", x), ("P_prior", P)):
                if name in out:
                    out[name][0, start + part.start : start + part.stop] = values
    return both[None, -2], both[None, -1]


@engine.QUIET
def _before(
    system: DrivenSystem, tables: Any, states: FloatArray, window: FloatArray, m: int, first: int
) -> tuple[FloatArray, FloatArray]:
    """Moments of X' before Y' is seen: features of Y' are those of its mean."""
    p = engine.probabilities(states)
    x, P = engine.node_moments(states, m)
    Axx, H, G, c, C, Ayy, Ny, Qyy = tables.pairs
    weight = (p[:, :, None] * tables.transition).reshape(len(p), -1)
    mean_y = np.einsum("ijqw,nw->nijq", Ayy, window) + Ny
    if tables.reads_next:
        z = np.einsum("nij,nijq->nq", weight.reshape(mean_y.shape[:-1]), mean_y)
        own = system.own(z, first)
        window = np.concatenate([window[:, : window.shape[1] - own.shape[1]], own], axis=1)
    mean = np.einsum("ijab,nib->nija", Axx, x) + np.einsum("ijaw,nw->nija", H, window)
    mean += np.einsum("ijaq,nijq->nija", G, mean_y) + c
    covariance = Axx @ P[:, :, None] @ np.swapaxes(Axx, -1, -2) + C + G @ Qyy @ np.swapaxes(G, -1, -2)
    flat = (len(p), -1)
    return mixture_moments(weight, mean.reshape(*flat, m), covariance.reshape(*flat, m, m))


class Onward:
    """A system ahead of what was observed, in which what is expected takes the place of observations.

    Parameters
    ----------
    system : InputSystem
    past : ndarray, shape (n_past, q), or None
        Observations before, the latest first; None if there is none.
    us : ndarray, shape (n, k)
        Inputs of the steps ahead.
    origin : int
        Number of the first of them.
    """

    order: int = 1

    def __init__(self, system: InputSystem, past: FloatArray | None, us: FloatArray, origin: int) -> None:
        self.chain, self.dim_x, self.dim_z = system.chain, system.dim_x, system.dim_z
        self._system, self._past, self._us, self._origin = system, past, us, origin

    def initial(self) -> Any:
        """Return the law of (r_1, Z_1)."""
        return self._system.initial()

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``."""
        assert self._past is not None  # a first time comes before
        return self._system.driven_tables(self._past, self._us[n + 1 - self._origin])

    def expects(self, z: FloatArray) -> None:
        """Let what is expected stand for the next observation."""
        if self._past is None:
            self._past = starting_past(z, self._system.features.n_past)
        else:
            self._past = np.concatenate([z[None], self._past[:-1]])
