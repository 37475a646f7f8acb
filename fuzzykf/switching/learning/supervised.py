"""Learning from (x, y, r): complete-data maximum likelihood in the regression form.

All transitions count, hard and fuzzy, each with the shares of its own switch values.
The paper (section VII) uses the hard pairs only, which is far less accurate and needs
every hard pair to occur.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.forms import RegressionForm
from fuzzykf.switching.fuzzy_model import CGOFMSModel
from fuzzykf.switching.hard_model import CGOMSModel
from fuzzykf.switching.learning.law import count_transitions, fit_law
from fuzzykf.switching.learning.likelihood import log_likelihood
from fuzzykf.switching.learning.regression import Cells, Regression, fit_regression
from fuzzykf.switching.learning.result import FitResult

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning.data import Scale, TrainingData

__all__ = ["fit_fuzzy", "fit_hard", "form_from_regressions", "positions", "transition_vectors"]

#: A regime, or a pair, with less than this many observations is reported.
SCARCE = 5.0


def transition_vectors(data: TrainingData) -> FloatArray:
    """Rows v = (1, y, y', x, x') of all transitions."""
    m = data.dim_x
    now, then = data.z[data.before], data.z[data.after]
    one = np.ones((len(now), 1))
    return np.concatenate([one, now[:, m:], then[:, m:], now[:, :m], then[:, :m]], axis=1)


def positions(m: int, q: int) -> dict[str, list[int]]:
    """Positions of the parts of v."""
    return {
        "one": [0],
        "y": list(range(1, 1 + q)),
        "y'": list(range(1 + q, 1 + 2 * q)),
        "x": list(range(1 + 2 * q, 1 + 2 * q + m)),
        "x'": list(range(1 + 2 * q + m, 1 + 2 * q + 2 * m)),
    }


def form_from_regressions(
    observation: Regression, state: Regression, first: Regression, scale: Scale, m: int, K: int
) -> RegressionForm:
    """Assemble a form, in the units of the data.

    Parameters
    ----------
    observation : Regression
        y' on (y, 1).
    state : Regression
        x' on (x, y, y', 1).
    first : Regression
        (x, y) on 1.
    """
    q = observation.beta.shape[1]
    mx, my, sx, sy = scale.mean[:m], scale.mean[m:], scale.std[:m], scale.std[m:]

    def table(a: FloatArray) -> FloatArray:
        return a.reshape(K, K, *a.shape[1:])

    Ayy = table(observation.beta[..., :q]) * sy[:, None] / sy
    Ny = table(observation.beta[..., q]) * sy + my - Ayy @ my
    Axx = table(state.beta[..., :m]) * sx[:, None] / sx
    H = table(state.beta[..., m : m + q]) * sx[:, None] / sy
    G = table(state.beta[..., m + q : m + 2 * q]) * sx[:, None] / sy
    c = table(state.beta[..., m + 2 * q]) * sx + mx - Axx @ mx - (H + G) @ my
    return RegressionForm(
        Ayy=Ayy,
        Ny=Ny,
        Qyy=table(observation.covariance) * sy[:, None] * sy,
        Axx=Axx,
        H=H,
        G=G,
        c=c,
        C=table(state.covariance) * sx[:, None] * sx,
        means=first.beta[..., 0] * scale.std + scale.mean,
        covariances=first.covariance * scale.std[:, None] * scale.std,
    )


def n_regression_parameters(m: int, q: int, K: int) -> int:
    """Free parameters of a regression form."""
    d = m + q
    pair = q * (q + 1) + q * (q + 1) // 2 + m * (m + 2 * q + 1) + m * (m + 1) // 2
    return K * K * pair + K * (d + d * (d + 1) // 2)


def _fit_form(data: TrainingData, shares: FloatArray) -> RegressionForm:
    m = data.dim_x
    q = data.z.shape[1] - m
    K = shares.shape[1]
    v = transition_vectors(data)
    pair_shares = (shares[data.before][:, :, None] * shares[data.after][:, None, :]).reshape(len(v), -1)
    cells = Cells(pair_shares, np.ones(len(v)), v[:, :, None] * v[:, None, :])
    at = positions(m, q)
    observation = fit_regression(cells, at["y'"], at["y"] + at["one"])
    state = fit_regression(cells, at["x'"], at["x"] + at["y"] + at["y'"] + at["one"])
    w = np.concatenate([np.ones((len(data.z), 1)), data.z], axis=1)
    single = Cells(shares, np.ones(len(w)), w[:, :, None] * w[:, None, :])
    first = fit_regression(single, list(range(1, w.shape[1])), [0])
    return form_from_regressions(observation, state, first, data.scale, m, K)


def scarcity(shares: FloatArray, data: TrainingData) -> list[str]:
    """Say which regimes and pairs of regimes the data hardly visit."""
    found = []
    K = shares.shape[1]
    visits = shares.sum(axis=0)
    pairs = shares[data.before].T @ shares[data.after]
    for k in range(K):
        if visits[k] < SCARCE:
            found.append(f"the regime {k} is hardly visited (a total share of {visits[k]:.3g} observations)")
    for i in range(K):
        for j in range(K):
            if min(visits[i], visits[j]) >= SCARCE and pairs[i, j] < SCARCE:
                found.append(
                    f"the pair of regimes ({i}, {j}) hardly occurs (a total share of {pairs[i, j]:.3g} "
                    "steps); its parameters follow the others"
                )
    return found


def fit_fuzzy(data: TrainingData, law: str, n_nodes: int, rule: str) -> FitResult[CGOFMSModel]:
    """Learn a fuzzy model from (x, y, r)."""
    assert data.r is not None
    if not ((data.r >= 0.0) & (data.r <= 1.0)).all():
        raise ParameterError(f"r: got values from {data.r.min()} to {data.r.max()}, expected [0, 1]")
    shares = np.stack([1.0 - data.r, data.r], axis=1)
    fitted = fit_law(law, data.r[data.before], data.r[data.after])
    notes = scarcity(shares, data)
    hard = float(np.isin(data.r, (0.0, 1.0)).mean())
    if law == "fmc1" and hard < 0.375:
        notes.append(
            f"the switch is hard in {hard:.3g} of the data, but FMC1 cannot go below 3/8; consider 'fmc2'"
        )
    model = CGOFMSModel._from_form(fitted, _fit_form(data, shares))
    value = log_likelihood(model.on_nodes(n_nodes, rule), data)
    m, q = model.dim_x, model.dim_z
    return FitResult(
        model=model,
        log_likelihood=value,
        n_parameters=n_regression_parameters(m, q, 2) + 3,
        n_observations=len(data.z),
        trace=np.array([value]),
        converged=True,
        warnings=tuple(notes),
    )


def fit_hard(data: TrainingData, n_switches: int) -> FitResult[CGOMSModel]:
    """Learn a model of hard regimes from (x, y, r)."""
    assert data.r is not None
    if not np.isin(data.r, np.arange(n_switches)).all():
        raise ParameterError(
            f"r: expected regimes 0 to {n_switches - 1} (n_switches = {n_switches}), got "
            f"{np.unique(data.r)[:5].tolist()}"
        )
    shares = np.eye(n_switches)[data.r.astype(int)]
    counts = count_transitions(data.r[data.before], data.r[data.after], n_switches)
    notes = scarcity(shares, data)
    left = counts.sum(axis=1)
    for k in np.flatnonzero(left == 0.0):
        notes.append(
            f"the regime {k} is never left or stayed in; every regime is taken as equally likely after"
        )
    transition = np.where(left[:, None] > 0.0, counts / np.maximum(left, 1.0)[:, None], 1.0 / n_switches)
    visits = shares.sum(axis=0)
    model = CGOMSModel._from_form(transition, _fit_form(data, shares), visits / visits.sum())
    value = log_likelihood(model.on_nodes(), data)
    m, q = model.dim_x, model.dim_z
    return FitResult(
        model=model,
        log_likelihood=value,
        n_parameters=n_regression_parameters(m, q, n_switches) + n_switches * (n_switches - 1),
        n_observations=len(data.z),
        trace=np.array([value]),
        converged=True,
        warnings=tuple(notes),
    )
