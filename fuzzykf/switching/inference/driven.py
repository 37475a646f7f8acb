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
    from fuzzykf.switching.dynamics.pairs import Ahead
    from fuzzykf.switching.inference.method import Method
    from fuzzykf.switching.inference.series import Stand

__all__ = ["Onward", "along", "expected", "filter_stretch", "first_expected", "starting_past"]

#: Steps whose pairs of nodes are held at once.
_CHUNK = 1024


def starting_past(y: FloatArray, n_past: int) -> FloatArray:
    """Return what stands for observations before the first one, which is ``y``: zero where it is missing."""
    return np.repeat(np.nan_to_num(y)[None], n_past, axis=0)


def expected(method: Method, tables: Any, mixture: Any, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return an observation (q,) and variances of zero, or what was expected of parts that are missing."""
    missing = np.isnan(y)
    if not missing.any():
        return y, np.zeros(y.size)
    law = method.ahead(tables, mixture)
    return np.where(missing, law.z, y), np.where(missing, np.diagonal(law.S), 0.0)


def first_expected(system: InputSystem, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Do the same for the first observation."""
    law, missing = system.initial().ahead(system.dim_x), np.isnan(y)
    return np.where(missing, law.z, y), np.where(missing, np.diagonal(law.S), 0.0)


def along(
    method: Method,
    system: InputSystem,
    ys: FloatArray,
    us: FloatArray,
    past: FloatArray | None = None,
    spread: FloatArray | None = None,
    stand: Stand | None = None,
) -> tuple[DrivenSystem, FloatArray, FloatArray]:
    """Return the system along a series (n, q), NaN where missing; the series without gaps, and variances.

    Parameters
    ----------
    method : Method
    system : InputSystem
    ys, us : ndarray, shapes (n, q) and (n, k)
    past : ndarray, shape (n_past, q), optional
        Observations before the first, the latest first, where a filter goes on.
    spread : ndarray, shape (q,), optional
        Variance of the latest of them.
    stand : Stand, optional
        Where it stands then: the series begins with what it has skipped.
    """
    n_past, origin, q = system.features.n_past, 0 if stand is None else stand.n, system.dim_z
    full, spreads = ys.copy(), np.zeros_like(ys)
    holes = np.flatnonzero(np.isnan(ys).any(axis=1))
    if past is None:
        if len(ys):
            full[0], spreads[0] = first_expected(system, ys[0])
        lead = starting_past(full[0] if len(ys) else np.zeros(q), n_past)
    else:
        lead = past[::-1]
    before = np.zeros(q) if spread is None else spread
    if holes.size and (holes[-1] > 0 or stand is not None):
        _fill(method, system, ys, us, lead, before, full, spreads, int(holes[-1]), stand)
    return DrivenSystem(system, full, spreads, us, lead, before, origin), full, spreads


def _fill(
    method: Method,
    system: InputSystem,
    ys: FloatArray,
    us: FloatArray,
    lead: FloatArray,
    before: FloatArray,
    full: FloatArray,
    spreads: FloatArray,
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
        tables = system.driven_tables(past, spreads[k - 1] if k else before, us[k])
        full[k], spreads[k] = expected(method, tables, mixture, y)
        given: Any = tables.with_next(full[k], spreads[k])
        seen = k + 1 + (0 if stand is None else stand.n)
        mixture, _ = method.advance(given, mixture, y, min(seen, system.order) * y.size)


def filter_stretch(
    system: DrivenSystem,
    tables: Any,
    table: FloatArray,
    ys: FloatArray,
    start: int,
    stop: int,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Filter complete observations start, ..., stop - 1 of one series (1, n, q); only kernels differ.

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
    new, kernels = ys[0, start:stop], system.kernels(start + shift, stop + shift)
    if kernels is None:
        ones = np.ones((stop - start, 1))
        rows = np.concatenate([ones, known, own, new], axis=1)
        found, _, log_likelihood = engine.run(tables.kernel, table[0], None, rows)
    else:  # inputs act on the switch
        found, log_likelihood = np.empty((stop - start, *table[0].shape)), np.empty(stop - start)
        now, windows = table[0], np.concatenate([known, own], axis=1)
        for k, kernel in enumerate(kernels):
            now, _, log_likelihood[k] = engine.step(kernel, now, None, windows[k], new[k])
            found[k] = now
    both = np.concatenate([table, found])
    switch = chain.keys, chain.weights, chain.atoms, chain.ranking
    engine.summarise(out, slice(start, stop), both[None, 1:], None, log_likelihood[None], switch)
    if "x_prior" in out or "P_prior" in out:
        for a in range(0, stop - start, _CHUNK):
            part = slice(a, min(a + _CHUNK, stop - start))
            window = np.concatenate([known[part], np.zeros_like(own[part])], axis=1)
            x, P = _before(system, tables, both[:-1][part], window, m, start + shift + a)
            for name, values in (("x_prior", x), ("P_prior", P)):
                if name in out:
                    out[name][0, start + part.start : start + part.stop] = values
    return both[None, -2], both[None, -1]


@engine.QUIET
def _before(
    system: DrivenSystem, tables: Any, states: FloatArray, window: FloatArray, m: int, first: int
) -> tuple[FloatArray, FloatArray]:
    """Moments of X' before Y' is seen: features of Y' have the normal law of its mean and covariance."""
    p = engine.probabilities(states)
    x, P = engine.node_moments(states, m)
    Axx, H, G, c, C, Ayy, Ny, Qyy = tables.pairs
    weight = p[:, :, None] * system.transitions(first, len(p))
    mean_y = np.einsum("ijqw,nw->nijq", Ayy, window) + Ny
    n, q = len(p), Qyy.shape[-1]
    level: FloatArray = np.broadcast_to(c, (n, *c.shape))
    if tables.reads_next:
        flat = weight.reshape(n, -1), mean_y.reshape(n, -1, q)
        z, S = mixture_moments(*flat, np.broadcast_to(Qyy.reshape(1, -1, q, q), (n, flat[1].shape[1], q, q)))
        law = system.linearised(z, np.diagonal(S, axis1=-2, axis2=-1), first)
        B = H[..., H.shape[-1] - law.level.shape[-1] :]
        G = G + np.einsum("ijao,noq->nijaq", B, law.slope)
        level = c + np.einsum("ijao,no->nija", B, law.level)
        C = C + np.einsum("ijao,nop,ijbp->nijab", B, law.left, B, optimize=True)
    mean = np.einsum("ijab,nib->nija", Axx, x) + np.einsum("ijaw,nw->nija", H, window)
    mean += (G @ mean_y[..., None])[..., 0] + level
    covariance = Axx @ P[:, :, None] @ np.swapaxes(Axx, -1, -2) + C + G @ Qyy @ np.swapaxes(G, -1, -2)
    whole = (n, -1)
    return mixture_moments(weight.reshape(whole), mean.reshape(*whole, m), covariance.reshape(*whole, m, m))


class Onward:
    """A system ahead of what was observed, in which what is expected takes the place of observations.

    Parameters
    ----------
    system : InputSystem
    past : ndarray, shape (n_past, q), or None
        Observations before, the latest first; None if there is none.
    spread : ndarray, shape (q,)
        Variance of the latest of them.
    us : ndarray, shape (n, k)
        Inputs of the steps ahead.
    origin : int
        Number of the first of them.
    """

    def __init__(
        self,
        system: InputSystem,
        past: FloatArray | None,
        spread: FloatArray,
        us: FloatArray,
        origin: int,
    ) -> None:
        self.chain, self.dim_x, self.dim_z, self.order = (
            system.chain,
            system.dim_x,
            system.dim_z,
            system.order,
        )
        self._system, self._past, self._spread, self._us, self._origin = system, past, spread, us, origin

    def initial(self) -> Any:
        """Return the law of (r_1, Z_1)."""
        return self._system.initial()

    def pair_tables(self, n: int) -> Any:
        """Return the tables of the step from observation ``n``."""
        assert self._past is not None  # a first time comes before
        return self._system.driven_tables(self._past, self._spread, self._us[n + 1 - self._origin])

    def expects(self, law: Ahead) -> None:
        """Let what is expected stand for the next observation."""
        self._spread = np.diagonal(law.S).copy()
        if self._past is None:
            self._past = starting_past(law.z, self._system.features.n_past)
        else:
            self._past = np.concatenate([law.z[None], self._past[:-1]])
