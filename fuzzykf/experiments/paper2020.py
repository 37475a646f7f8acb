"""The simulated model of the 2020 paper, section VI, and what its experiments share.

Bouyahia, Derrode, Pieczynski, "Filtering in Gaussian linear systems with fuzzy
switches", IEEE Transactions on Fuzzy Systems 28 (2020).  Where the paper is misprinted
the corrected value is used; the theory pages list the corrections.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from fuzzykf.switching import CGOFMSModel, FuzzyMarkovLaw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = [
    "CORRECTED",
    "FMC1",
    "FMC2",
    "Series",
    "hard_covariances",
    "make_law",
    "make_model",
    "mean_squared_errors",
    "simulate_many",
]

#: What every simulation of the paper needs before it can be run.
CORRECTED = "Cov(Y2, X1) = b c / var(Y) in Γ00 and Γ01 and at every pair (r1, r2); (45) without its inverse"

#: Parameters of Figures 2 to 4: (alpha, delta, eta) and (alpha, gamma, delta).
FMC1, FMC2 = (0.10, 0.076, 0.21), (0.15, 0.60, 0.20)

#: Means of (X, Y) at the hard values 0 and 1.
_MEANS = ((0.0, 3.0), (0.0, 0.0))

#: Var X, Cov(X, Y), Var Y at the hard values 0 and 1.
_MARGINS = ((0.5, 0.3, 1.0), (0.75, 0.3, 0.5))

#: Cov(X2, X1), Cov(X2, Y1), Cov(Y2, Y1) by (i, j).
_CROSS = (((0.1, 0.35, 0.4), (0.5, 0.33, 0.6)), ((0.1, 0.35, 0.4), (0.5, 0.33, 0.3)))


class Series(NamedTuple):
    """Simulated series, side by side."""

    x: FloatArray  # (runs, n)
    y: FloatArray  # (runs, n)
    r: FloatArray  # (runs, n)


def hard_covariances() -> FloatArray:
    """Return the covariances Gamma_ij of section VI-A, (2, 2, 4, 4), with d = b c / var(Y)."""
    gamma = np.empty((2, 2, 4, 4))
    for i, j in np.ndindex(2, 2):
        a, e, c = _CROSS[i][j]
        (vx, b, vy), (vx2, b2, vy2) = _MARGINS[i], _MARGINS[j]
        K = np.array([[a, e], [b * c / vy, c]])
        gamma[i, j] = np.block([[np.array([[vx, b], [b, vy]]), K.T], [K, np.array([[vx2, b2], [b2, vy2]])]])
    return gamma


def make_law(family: str, parameters: Sequence[float]) -> FuzzyMarkovLaw:
    """Return the law "FMC1" (alpha, delta, eta) or "FMC2" (alpha, gamma, delta)."""
    if family == "FMC1":
        return FuzzyMarkovLaw.fmc1(*parameters)
    return FuzzyMarkovLaw.fmc2(*parameters)


def make_model(
    law: FuzzyMarkovLaw, interpolation: Literal["covariance", "transition"] = "covariance"
) -> CGOFMSModel:
    """Return the model of section VI-A with a law of the switch."""
    return CGOFMSModel(law, _MEANS, hard_covariances(), dim_x=1, interpolation=interpolation)


def simulate_many(model: CGOFMSModel, runs: int, n: int, rng: np.random.Generator) -> Series:
    """Draw ``runs`` series of ``n`` steps."""
    drawn = [model.simulate(n, rng) for _ in range(runs)]
    return Series(
        np.stack([one.x[:, 0] for one in drawn]),
        np.stack([one.y[:, 0] for one in drawn]),
        np.stack([one.r for one in drawn]),
    )


def mean_squared_errors(estimate: ArrayLike, truth: FloatArray) -> FloatArray:
    """Return the mean squared error of each run, (runs,)."""
    errors = np.asarray(estimate, dtype=np.float64).reshape(truth.shape) - truth
    mse: FloatArray = np.mean(errors**2, axis=1)
    return mse
