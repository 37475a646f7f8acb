"""The base of the switching filters: state, checks, calls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.base import Filter, FilterResult, as_observation, as_observations
from fuzzykf.errors import SequenceError
from fuzzykf.gaussian import mixture_moments
from fuzzykf.io import decode, encode
from fuzzykf.switching import recursion

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.recursion import NodeState
    from fuzzykf.switching.tables import InitialLaw, PairTables, SwitchingSystem

__all__ = ["MISSING", "SwitchingFilter"]

MISSING = (
    "{}: missing observations (None or NaN, or a second predict in a row) are not supported by switching "
    "filters yet; filter the stretches between gaps separately"
)


class SwitchingFilter(Filter):
    """Exact recursive filter of a switching system.

    `OFSRFilter` and `CGOMSMFilter` make the system from a model.  Use this class
    for a system of your own: any object with `initial` and `pair_tables`.

    The first observation belongs to the initial law: there are no dynamics before it,
    and a predict before the first update only shows that law.  After an update, the next
    one needs a predict; a second predict in a row stands for a missing observation.

    Parameters
    ----------
    system : SwitchingSystem

    Attributes
    ----------
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x)
        Mean and covariance of the state given the observations so far; after `predict`,
        of the next state.
    x_prior, P_prior : ndarray
        The same before the latest observation was seen.
    mu : ndarray, shape (M,)
        Probability of each node of the switch; sums to one.
    nodes : ndarray, shape (M,)
        Values of the switch at the nodes.
    switch, switch_mean : float
        Estimate of the switch by its posterior marginal (MPM), and its posterior mean.
    log_likelihood : float
        Log-density of the latest observation given the earlier ones; 0 before any.
    y, S : ndarray, shapes (dim_z, 1) and (dim_z, dim_z)
        Innovation of the latest observation and its covariance.
    nis, mahalanobis : float
        Normalised innovation squared, y' S^-1 y, and its square root.
    """

    def __init__(self, system: SwitchingSystem) -> None:
        self._system = system
        self.dim_x, self.dim_z = system.dim_x, system.dim_z
        self._start()

    def _start(self) -> None:
        self._n = 0  # observations taken
        self._predicted = False
        self._state: NodeState | None = None
        self._window = np.empty(0)
        self._z: FloatArray | None = None
        self._log_likelihood = 0.0
        # state, window and tables from which the latest observation was predicted
        self._before: tuple[NodeState, FloatArray, PairTables] | None = None

    def reset(self) -> None:
        """Return to the initial law, before any observation."""
        self._start()

    # ------------------------------------------------------------------ for files

    def _export_state(self) -> dict[str, Any]:
        """Return the state as plain values that `_import_state` restores bit for bit."""
        before = None
        if self._before is not None:
            state, window, _ = self._before
            before = {"state": _plain(state), "window": window.tolist()}
        return {
            "n": self._n,
            "predicted": self._predicted,
            "state": None if self._state is None else _plain(self._state),
            "window": self._window.tolist(),
            "z": encode(self._z),
            "log_likelihood": self._log_likelihood,
            "before": before,
        }

    def _import_state(self, values: dict[str, Any]) -> None:
        self._n, self._predicted = int(values["n"]), bool(values["predicted"])
        self._state = None if values["state"] is None else _from_plain(values["state"])
        self._window, self._z = decode(values["window"], 1), decode(values["z"], 1)
        self._log_likelihood = float(values["log_likelihood"])
        self._before = None
        if values["before"] is not None:
            tables = self._system.pair_tables(self._n - 2)
            before = values["before"]
            self._before = (_from_plain(before["state"]), decode(before["window"], 1), tables)

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        return self._system.initial()

    def _next_tables(self) -> PairTables:
        return self._system.pair_tables(self._n - 1)

    # ------------------------------------------------------------------ verbs

    def predict(self) -> None:
        """Move to the time of the next observation.

        Before the first observation this shows the initial law and may be repeated.

        Raises
        ------
        NotImplementedError
            If the observation of the current time has not been given: missing
            observations are not supported yet.
        """
        if self._predicted and self._n > 0:
            raise NotImplementedError(MISSING.format("predict"))
        self._predicted = True

    def update(self, z: ArrayLike | None) -> None:
        """Take the observation ``z`` into account.

        Parameters
        ----------
        z : array_like
            Scalar (if dim_z is 1), or shape (dim_z,), (dim_z, 1) or (1, dim_z).

        Raises
        ------
        SequenceError
            If no `predict` came since the last update.
        NotImplementedError
            If ``z``, or a part of it, is missing.
        ShapeError, ParameterError
            If ``z`` has a wrong shape or is infinite.
        """
        if self._n > 0 and not self._predicted:
            raise SequenceError(
                "update: called twice without a predict in between; a switching filter takes one observation "
                "per time (use step, or stack simultaneous measurements into one z)"
            )
        y = as_observation(z, self.dim_z)
        if y is None or (self.dim_z > 1 and np.isnan(y).any()):
            raise NotImplementedError(MISSING.format("update"))
        before: tuple[NodeState, FloatArray, PairTables] | None
        if self._state is None:
            state, log_likelihood = recursion.first_observation(self._initial_law(), y)
            before = None
        else:
            tables = self._next_tables()
            state, log_likelihood = recursion.advance(tables, self._state, self._window, y)
            before = (self._state, self._window, tables)
        self._accept(state, log_likelihood, y, before)

    def _accept(
        self,
        state: NodeState,
        log_likelihood: float,
        y: FloatArray,
        before: tuple[NodeState, FloatArray, PairTables] | None,
    ) -> None:
        self._state, self._log_likelihood, self._before = state, log_likelihood, before
        order = self._system.order
        self._window = y if order == 1 else np.concatenate([y, self._window])[: order * self.dim_z]
        self._z = y
        self._n += 1
        self._predicted = False

    def filter(self, zs: Iterable[ArrayLike | None] | ArrayLike) -> FilterResult:
        """Filter a whole series from the initial law on.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``mu``, ``nodes``, ``switch``,
            ``switch_mean`` and ``log_likelihood``.  The filter stays at the last
            observation, so that `step` continues.

        Raises
        ------
        NotImplementedError
            If observations are missing.
        """
        ys = as_observations(zs, self.dim_z)
        if np.isnan(ys).any():
            raise NotImplementedError(MISSING.format("filter"))
        index = getattr(zs, "index", None) if hasattr(zs, "to_numpy") else None
        return self._filter_complete(ys, index)

    def _filter_complete(self, ys: FloatArray, index: Any) -> FilterResult:
        trial = self.copy()
        trial.reset()
        states, log_likelihood, priors = trial._run(ys)
        self.__dict__.update(trial.__dict__)
        m = self.dim_x
        mu = recursion.node_probabilities(states)
        x, P = mixture_moments(mu, *recursion.node_moments(states, m))
        chain = self._system.chain
        return FilterResult(
            x=x,
            P=P,
            x_prior=priors[0],
            P_prior=priors[1],
            mu=mu,
            nodes=chain.nodes,
            switch=recursion.most_likely_switch(chain, mu),
            switch_mean=mu @ chain.nodes,
            log_likelihood=log_likelihood,
            index=index,
        )

    def _run(self, ys: FloatArray) -> tuple[NodeState, FloatArray, tuple[FloatArray, FloatArray]]:
        """Filter ``ys`` from the start; all node states, log-likelihoods and prior moments."""
        n, m, M = len(ys), self.dim_x, len(self._system.chain)
        table = np.empty((n, 1 + m + m * m, M))
        signs = np.ones((n, M)) if self._system.chain.is_signed else None
        log_likelihood = np.empty(n)
        x_prior, P_prior = np.empty((n, m)), np.empty((n, m, m))
        steady = self._system.steady_from
        k = 0
        while k < n and (steady is None or k <= max(steady, 0)):
            self.predict()
            x_prior[k], P_prior[k] = self.x_prior[:, 0], self.P_prior
            self.update(ys[k])
            assert self._state is not None
            table[k] = self._state.table
            if signs is not None and self._state.sign is not None:
                signs[k] = self._state.sign
            log_likelihood[k] = self._log_likelihood
            k += 1
        if k < n:
            assert self._state is not None
            tables = self._next_tables()
            windows = _windows(ys, self._system.order)[k - 1 : n - 1]
            rest, log_likelihood[k:] = recursion.advance_all(tables, self._state, windows, ys[k:])
            table[k:] = rest.table
            if signs is not None:
                signs[k:] = 1.0 if rest.sign is None else rest.sign
            states = recursion.NodeState(table, signs)
            for start in range(k, n, _CHUNK):
                stop = min(start + _CHUNK, n)
                part = _slice(states, slice(start - 1, stop - 1))
                x_prior[start:stop], P_prior[start:stop] = recursion.predict_state(
                    tables, part, windows[start - k : stop - k]
                )
            before = (_slice(states, n - 2), windows[-1], tables)
            self._n = n - 1
            if self._system.order > 1:
                self._window = windows[-1]
            self._accept(_slice(states, n - 1), float(log_likelihood[-1]), ys[-1].copy(), before)
        return recursion.NodeState(table, signs), log_likelihood, (x_prior, P_prior)

    # ------------------------------------------------------------------ what users read

    def _prior(self) -> tuple[FloatArray, FloatArray]:
        """Moments of the state before the latest observation, or of the next one after predict."""
        m = self.dim_x
        if not self._prior_is_known():
            return np.full(m, np.nan), np.full((m, m), np.nan)
        source = self._before
        if self._predicted and self._state is not None:
            source = (self._state, self._window, self._next_tables())
        if source is None:
            law = self._initial_law()
            return mixture_moments(law.probability, law.mean[:, :m], law.covariance[:, :m, :m])
        state, window, tables = source
        return recursion.predict_state(tables, state, window)

    def _prior_is_known(self) -> bool:
        return True

    @property
    def x(self) -> FloatArray:
        """Estimate of the state, (dim_x, 1)."""
        if self._state is None or self._predicted:
            return self._prior()[0][:, None]
        means = self._state.table[1 : 1 + self.dim_x]
        mean: FloatArray = means.dot(recursion.node_probabilities(self._state))
        return mean[:, None]

    @property
    def P(self) -> FloatArray:
        """Covariance of the state, (dim_x, dim_x)."""
        if self._state is None or self._predicted:
            return self._prior()[1]
        return recursion.posterior_moments(self._state, self.dim_x)[1]

    @property
    def x_prior(self) -> FloatArray:
        """Estimate before the latest observation, (dim_x, 1)."""
        return self._prior()[0][:, None]

    @property
    def P_prior(self) -> FloatArray:
        """Covariance before the latest observation, (dim_x, dim_x)."""
        return self._prior()[1]

    @property
    def nodes(self) -> FloatArray:
        """Values of the switch at the nodes, (M,)."""
        return self._system.chain.nodes

    @property
    def mu(self) -> FloatArray:
        """Probability of each node of the switch, (M,)."""
        if self._state is None:
            return self._initial_law().probability.copy()
        if self._predicted:
            return recursion.predict_probabilities(self._next_tables(), self._state)
        return recursion.node_probabilities(self._state)

    @property
    def switch(self) -> float:
        """Most likely value of the switch, by the MPM rule of the paper."""
        return float(recursion.most_likely_switch(self._system.chain, self.mu))

    @property
    def switch_mean(self) -> float:
        """Posterior mean of the switch."""
        return float(self.mu @ self.nodes)

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones."""
        return self._log_likelihood

    @property
    def z(self) -> FloatArray | None:
        """The latest observation, (dim_z, 1)."""
        return None if self._z is None else self._z[:, None].copy()

    def _innovation(self) -> tuple[FloatArray, FloatArray]:
        q, m = self.dim_z, self.dim_x
        if self._z is None:
            return np.zeros(q), np.zeros((q, q))
        if self._before is None:
            law = self._initial_law()
            mean, covariance = mixture_moments(law.probability, law.mean[:, m:], law.covariance[:, m:, m:])
        else:
            state, window, tables = self._before
            mean, covariance = recursion.predict_observation(tables, state, window)
        return self._z - mean, covariance

    @property
    def y(self) -> FloatArray:
        """Innovation of the latest observation, (dim_z, 1)."""
        return self._innovation()[0][:, None]

    @property
    def S(self) -> FloatArray:
        """Covariance of the innovation, (dim_z, dim_z): that of the predictive mixture."""
        return self._innovation()[1]

    @property
    def nis(self) -> float:
        """Normalised innovation squared, y' S^-1 y; 0 before any observation."""
        if self._z is None:
            return 0.0
        y, S = self._innovation()
        return float(y @ np.linalg.solve(S, y))

    @property
    def mahalanobis(self) -> float:
        """Square root of `nis`, under filterpy's name."""
        return float(np.sqrt(self.nis))


#: Observations whose prior moments are computed at once.
_CHUNK = 512


def _slice(states: NodeState, where: Any) -> NodeState:
    sign = None if states.sign is None else states.sign[where]
    return recursion.NodeState(states.table[where], sign)


def _plain(state: NodeState) -> dict[str, Any]:
    return {"table": state.table.tolist(), "sign": encode(state.sign)}


def _from_plain(values: dict[str, Any]) -> NodeState:
    return recursion.NodeState(decode(values["table"], 2), decode(values["sign"], 1))


def _windows(ys: FloatArray, order: int) -> FloatArray:
    """Return the windows (y_n, y_{n-1}, ...) of full length, one row per n; NaN before the start."""
    n, q = ys.shape
    windows = np.full((n, order, q), np.nan)
    for lag in range(min(order, n)):
        windows[lag:, lag] = ys[: n - lag]
    return windows.reshape(n, order * q)
