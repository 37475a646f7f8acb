"""The two Gaussian parts that can be learned, as the expectation-maximisation sees them.

An estimate answers three questions: the densities of transitions (as whitened rows),
the maximisation given weighted second moments, and the form in the units of the data.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from fuzzykf.switching.dynamics.forms import GaussianForm, RegressionForm
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.switching.learning.regression import (
    Cells,
    Evidence,
    Regression,
    fit_regression,
    prior_cells,
    ridge,
)

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.learning.data import Scale, TrainingData
    from fuzzykf.switching.learning.further import Further

__all__ = [
    "GaussianEstimate",
    "MemorylessEstimate",
    "RegressionEstimate",
    "pair_cells",
    "positions",
    "regime_moments",
    "row_cells",
    "single_cells",
    "transition_vectors",
]


def transition_vectors(data: TrainingData) -> FloatArray:
    """Rows v = (1, y, y', x, x', what `Further` has) of all transitions; x is zero where it is not known."""
    m = data.dim_x
    z = _filled(data)
    now, then = z[data.before], z[data.after]
    one = np.ones((len(now), 1))
    further = () if data.further is None else data.further.columns
    return np.concatenate([one, now[:, m:], then[:, m:], now[:, :m], then[:, :m], *further], axis=1)


def positions(m: int, q: int, window: tuple[int, int] = (0, 0)) -> dict[str, list[int]]:
    """Positions of the parts of v.

    Parameters
    ----------
    m, q : int
        Components of the state and of an observation.
    window : tuple of int
        How many numbers ``common`` and ``own`` of `WindowFeatures` have.
    """
    common, own = window
    sizes = {"one": 1, "y": q, "y'": q, "x": m, "x'": m, "common": common, "own y": own, "own y'": own}
    bounds = np.cumsum([0, *sizes.values()]).tolist()
    return {name: list(range(*at)) for name, at in zip(sizes, pairwise(bounds), strict=True)}


def _filled(data: TrainingData) -> FloatArray:
    """Put zeros in the place of states that are not known, which no moment of the state reads."""
    return data.z if data.is_complete else np.nan_to_num(data.z, nan=0.0)


def pair_cells(before: FloatArray, after: FloatArray, v: FloatArray) -> Cells:
    """One cell per transition, from the shares (n, K) of the switch before and after it."""
    shares = (before[:, :, None] * after[:, None, :]).reshape(len(v), -1)
    return Cells(shares, np.ones(len(v)), v[:, :, None] * v[:, None, :])


def row_cells(shares: FloatArray, data: TrainingData) -> Evidence:
    """One cell of (1, x, y) per row, with the shares (N, K) of the switch in it."""
    z = _filled(data)
    w = np.concatenate([np.ones((len(z), 1)), z], axis=1)
    return Evidence.of(Cells(shares, np.ones(len(w)), w[:, :, None] * w[:, None, :]), data.known)


def single_cells(weights: FloatArray, shares: FloatArray, data: TrainingData) -> Evidence:
    """Cells of the law of Z given the switch: weights (N, M) of nodes with shares (M, K)."""
    z = _filled(data)
    w = np.concatenate([np.ones((len(z), 1)), z], axis=1)

    def cells(weights: FloatArray, w: FloatArray) -> Cells:
        f = w.shape[1]
        total = weights.sum(axis=0)
        moment = (weights.T @ (w[:, :, None] * w[:, None, :]).reshape(-1, f * f)).reshape(-1, f, f)
        return Cells(shares, total, moment / np.where(total > 0.0, total, 1.0)[:, None, None])

    every = cells(weights, w)
    return Evidence(every, every if data.is_complete else cells(weights[data.known], w[data.known]))


class GaussianEstimate(ABC):
    """A Gaussian part on the way, in standard units.

    Attributes
    ----------
    prior : Evidence
        What each pair of regimes is taken to have seen before the data.
    """

    dim_x: int
    dim_z: int
    n_classes: int
    prior: Evidence

    @classmethod
    @abstractmethod
    def start(
        cls,
        cells: Evidence,
        single: Evidence,
        m: int,
        q: int,
        proof: FloatArray,
        window: tuple[int, int] = (0, 0),
    ) -> Self:
        """Estimate from cells of pairs of regimes and of single regimes.

        ``proof`` (p, K * K) holds the shares of pairs at which the model has to be valid, ``window`` the
        sizes of `WindowFeatures`.
        """

    @abstractmethod
    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened rows of pairs: log p(z' | z, pair) = k - |W v|^2 / 2.

        The first q rows are those of the observation: with `observation_constant` in the place of k they
        give log p(y' | y, pair).

        Parameters
        ----------
        shares : ndarray, shape (p, K * K)
            Shares of the pairs of regimes in p pairs.

        Returns
        -------
        W : ndarray, shape (p, q + m, f)
        k : ndarray, shape (p,)
        """

    @abstractmethod
    def observation_constant(self, shares: FloatArray) -> FloatArray:
        """Return k, (p,), of the observation alone."""

    def log_likelihood(self, cells: Evidence) -> float:
        """Sum of log p(y' | y, pair) and log p(x' | x, y, y', pair) over their cells."""
        if cells.is_complete:
            W, constant = self.rows(cells.state.shares)
            return _expected(cells.state, W, constant)
        q = self.dim_z
        observation, state = cells
        W, constant = self.rows(state.shares)
        of_state = _expected(state, W[:, q:], constant - self.observation_constant(state.shares))
        W, _ = self.rows(observation.shares)
        return of_state + _expected(observation, W[:, :q], self.observation_constant(observation.shares))

    @property
    def log_prior(self) -> float:
        """Log-density of the prior, but for a constant."""
        return self.log_likelihood(self.prior)

    @abstractmethod
    def maximise(self, cells: Evidence) -> Self:
        """Return an estimate of larger expected likelihood, prior included, given the moments of pairs."""

    @property
    @abstractmethod
    def vector(self) -> FloatArray:
        """All parameters, as one vector in which straight lines make sense."""

    @abstractmethod
    def at(self, vector: FloatArray) -> Self | None:
        """Return the estimate with these parameters, or None where there is no model."""

    @abstractmethod
    def form(self, single: Evidence, scale: Scale) -> GaussianForm:
        """Return the form in the units of the data; ``single`` holds the moments of regimes."""

    @property
    @abstractmethod
    def n_parameters(self) -> int:
        """Number of free parameters."""


def _expected(cells: Cells, W: FloatArray, constant: FloatArray) -> float:
    quadratic = np.einsum("pij,pjk,pik->p", W, cells.moment, W, optimize=True)
    return float(cells.weight @ (constant - 0.5 * quadratic))


class RegressionEstimate(GaussianEstimate):
    """The regression form: y' on (y, 1, phi), then x' on (x, y, y', 1, psi), see `WindowFeatures`."""

    #: Whether x' depends on x.
    state_feedback: ClassVar[bool] = True

    def __init__(
        self,
        observation: Regression,
        state: Regression,
        prior: Evidence,
        window: tuple[int, int] = (0, 0),
    ) -> None:
        self.observation, self.state, self.prior, self.window = observation, state, prior, window
        self.dim_z, self.dim_x = observation.beta.shape[1], state.beta.shape[1]
        self.n_classes = round(len(observation.beta) ** 0.5)

    @classmethod
    def start(
        cls,
        cells: Evidence,
        single: Evidence,
        m: int,
        q: int,
        proof: FloatArray,
        window: tuple[int, int] = (0, 0),
    ) -> Self:
        """Estimate from cells, by maximum likelihood; valid everywhere by construction."""
        prior = cells.each(prior_cells)
        return cls(*cls._both(cells.joined(prior), (m, q), window, (None, None), 100), prior, window)

    def maximise(self, cells: Evidence) -> Self:
        """Take a few rounds of the maximisation."""
        before = (self.observation, self.state)
        both = self._both(cells.joined(self.prior), (self.dim_x, self.dim_z), self.window, before, 3)
        return type(self)(*both, self.prior, self.window)

    @property
    def log_prior(self) -> float:
        """Log-density of the prior, that of inputs and features included, but for a constant."""
        drawn = ridge(self.observation.beta, self.n_drawn) + ridge(self.state.beta, self.n_drawn)
        return super().log_prior + drawn

    @property
    def n_drawn(self) -> int:
        """How many coefficients of each target have a ridge."""
        return sum(self.window)

    def with_prior(self, prior: Evidence) -> Self:
        """Return the same regressions with another prior."""
        return type(self)(self.observation, self.state, prior, self.window)

    def widened(self, window: tuple[int, int]) -> Self:
        """Return the same estimate with inputs and features that have no effect yet."""
        n, f = sum(window), window[0] + 2 * window[1]

        def wider(fit: Regression) -> Regression:
            return fit._replace(beta=np.pad(fit.beta, ((0, 0), (0, 0), (0, n))))

        prior = self.prior.each(
            lambda cells: cells._replace(moment=np.pad(cells.moment, ((0, 0), (0, f), (0, f))))
        )
        return type(self)(wider(self.observation), wider(self.state), prior, window)

    def with_regressions(self, observation: Regression, state: Regression) -> Self:
        """Return an estimate of these regressions with the same prior."""
        return type(self)(observation, state, self.prior, self.window)

    @property
    def vector(self) -> FloatArray:
        """Coefficients, factors and log-variances of both regressions."""
        return np.concatenate([part.ravel() for part in (*self.observation, *self.state)])

    def at(self, vector: FloatArray) -> Self:
        """Return the estimate with these parameters; any are valid."""
        parts = (*self.observation, *self.state)
        pieces = np.split(vector, np.cumsum([part.size for part in parts])[:-1])
        new = [piece.reshape(part.shape) for piece, part in zip(pieces, parts, strict=True)]
        return self.with_regressions(Regression(*new[:3]), Regression(*new[3:]))

    def rows(self, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whiten the residuals of both regressions."""
        m, q = self.dim_x, self.dim_z
        common, own = self.window
        f = 1 + 2 * q + 2 * m + common + 2 * own
        blocks = []
        constant = np.full(len(shares), -0.5 * (m + q) * np.log(2.0 * np.pi))
        for fit, (target, regressors) in zip(
            (self.observation, self.state), self._equations((m, q), self.window), strict=True
        ):
            B, t, p = fit.beta.shape
            beta = (shares @ fit.beta.reshape(B, -1)).reshape(-1, t, p)
            T, g = (shares @ fit.T.reshape(B, -1)).reshape(-1, t, t), shares @ fit.g
            residual = np.zeros((len(shares), t, f))
            residual[:, range(t), target] = 1.0
            residual[:, :, regressors] -= beta
            blocks.append((T @ residual) * np.exp(-0.5 * g)[..., None])
            constant -= 0.5 * g.sum(axis=1)
        return np.concatenate(blocks, axis=1), constant

    def observation_constant(self, shares: FloatArray) -> FloatArray:
        """Return k, (p,), of the observation alone."""
        constant: FloatArray = -0.5 * (
            self.dim_z * np.log(2.0 * np.pi) + (shares @ self.observation.g).sum(axis=1)
        )
        return constant

    def form(self, single: Evidence, scale: Scale) -> RegressionForm:
        """Return the form in the units of the data."""
        return RegressionForm(**self._regressions(single, scale))

    def driven_form(
        self, single: Evidence, scale: Scale, further: Further, tilt: FloatArray | None
    ) -> InputForm:
        """Return the form with inputs and features in the units of the data.

        Parameters
        ----------
        single, scale
            As in `form`.
        further : Further
            What the units of inputs and features are.
        tilt : ndarray, shape (K, k), or None
            How inputs, in standard units, act on the transitions.
        """
        found = self._regressions(single, scale)
        m, k, width = self.dim_x, len(further.inputs), self.n_drawn
        for name, offset, fit, std in (
            ("By", "Ny", self.observation, scale.std[m:]),
            ("Bx", "c", self.state, scale.std[:m]),
        ):
            beta = fit.beta[..., fit.beta.shape[-1] - width :]
            found[name] = self._table(beta) * std[:, None] / further.std
            found[offset] = found[offset] - found[name] @ further.mean
        further.uncentred(found["Ayy"], found["Ny"], found["By"])
        further.uncentred(found["G"], found["c"], found["Bx"])
        return InputForm(
            **found,
            features=further.features,
            inputs=further.inputs,
            tilt=None if tilt is None else tilt / further.std[:k],
            centre=further.mean[:k],
        )

    def _table(self, a: FloatArray) -> FloatArray:
        """Bring what pairs of regimes have, (K * K, ...), to (K, K, ...)."""
        return a.reshape(self.n_classes, self.n_classes, *a.shape[1:])

    def _regressions(self, single: Evidence, scale: Scale) -> dict[str, FloatArray]:
        """Return what `RegressionForm` takes."""
        m, q, K = self.dim_x, self.dim_z, self.n_classes
        means, covariances = regime_moments(single, m, q)
        mx, my, sx, sy = scale.mean[:m], scale.mean[m:], scale.std[:m], scale.std[m:]
        observation, state, table = self.observation, self.state, self._table
        Ayy = table(observation.beta[..., :q]) * sy[:, None] / sy
        Ny = table(observation.beta[..., q]) * sy + my - Ayy @ my
        p = m if self.state_feedback else 0
        Axx = np.zeros((K, K, m, m))
        Axx[..., :p] = table(state.beta[..., :p])
        Axx *= sx[:, None] / sx
        H = table(state.beta[..., p : p + q]) * sx[:, None] / sy
        G = table(state.beta[..., p + q : p + 2 * q]) * sx[:, None] / sy
        c = table(state.beta[..., p + 2 * q]) * sx + mx - Axx @ mx - (H + G) @ my
        return {
            "Ayy": Ayy,
            "Ny": Ny,
            "Qyy": table(observation.covariance) * sy[:, None] * sy,
            "Axx": Axx,
            "H": H,
            "G": G,
            "c": c,
            "C": table(state.covariance) * sx[:, None] * sx,
            "means": means * scale.std + scale.mean,
            "covariances": covariances * scale.std[:, None] * scale.std,
        }

    @property
    def n_parameters(self) -> int:
        """Number of free parameters."""
        m, q, K = self.dim_x, self.dim_z, self.n_classes
        d = m + q
        of_y, of_x = (len(regressors) for _, regressors in self._equations((m, q), self.window))
        pair = q * of_y + q * (q + 1) // 2 + m * of_x + m * (m + 1) // 2
        return K * K * pair + K * (d + d * (d + 1) // 2)

    @classmethod
    def _equations(
        cls, sizes: tuple[int, int], window: tuple[int, int]
    ) -> tuple[tuple[list[int], list[int]], tuple[list[int], list[int]]]:
        """Positions in v of targets and regressors, of the observation and of the state."""
        at = positions(*sizes, window)
        state = (at["x"] if cls.state_feedback else []) + at["y"] + at["y'"] + at["one"]
        return (
            (at["y'"], at["y"] + at["one"] + at["common"] + at["own y"]),
            (at["x'"], state + at["common"] + at["own y'"]),
        )

    @classmethod
    def _both(
        cls,
        cells: Evidence,
        sizes: tuple[int, int],
        window: tuple[int, int],
        start: tuple[Regression | None, Regression | None],
        n_rounds: int,
    ) -> tuple[Regression, Regression]:
        """Regressions of the observation and of the state."""
        of_y, of_x = cls._equations(sizes, window)
        how: Any = {"n_drawn": sum(window), "n_rounds": n_rounds}
        return (
            fit_regression(cells.observation, *of_y, start[0], **how),
            fit_regression(cells.state, *of_x, start[1], **how),
        )


def regime_moments(single: Evidence, m: int, q: int) -> tuple[FloatArray, FloatArray]:
    """Means (K, d) and covariances (K, d, d) of Z = (X, Y) in each regime, with a weak prior.

    Where some states are missing the likelihood factors into that of all observations and the regression of
    the states that are known on theirs, x = B y + c + C: each part is maximised by itself, and

        E X = B E Y + c,    Cov(X, Y) = B Cov(Y),    Cov(X) = C + B Cov(Y) B'.

    So which rows have a state may depend on the observation without a bias.

    References
    ----------
    T. W. Anderson, "Maximum likelihood estimates for a multivariate normal distribution when some
    observations are missing", Journal of the American Statistical Association 52 (1957).
    """
    cells = single.joined(single.each(prior_cells))
    x, y = list(range(1, 1 + m)), list(range(1 + m, 1 + m + q))
    if single.is_complete:
        both = fit_regression(cells.state, x + y, [0])
        return both.beta[..., 0], both.covariance
    observation, state = fit_regression(cells.observation, y, [0]), fit_regression(cells.state, x, [*y, 0])
    mean_y, S_yy = observation.beta[..., 0], observation.covariance
    B, c = state.beta[..., :q], state.beta[..., q]
    S_xy = B @ S_yy
    mean = np.concatenate([(B @ mean_y[..., None])[..., 0] + c, mean_y], axis=1)
    S_xx = state.covariance + S_xy @ np.swapaxes(B, 1, 2)
    return mean, np.block([[S_xx, S_xy], [np.swapaxes(S_xy, 1, 2), S_yy]])


class MemorylessEstimate(RegressionEstimate):
    """The regression form with Axx = 0: x' on (y, y', 1).

    Given the switch the state then depends on observations alone, and the law of it that a filter finds, a
    mixture over the latest two nodes, is exact.
    """

    state_feedback = False
