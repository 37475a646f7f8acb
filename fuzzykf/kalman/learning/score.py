"""The log-likelihood of a linear filter, and its exact gradient with respect to the arrays of the filter.

By Fisher's identity the gradient is the expectation, given all observations, of that of the density of states
and observations together.  It needs the smoothed states, their covariances, and those of neighbours.  Written
in the scaled states r_k = (P_k^-)^-1 (xs_k - x_k^-) of the smoother, no covariance of the model is inverted,
so that Q, R and P may be singular.
"""

from __future__ import annotations

from math import isqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.engine.selected import filter_linear, gain_stack
from fuzzykf.kalman.series import empty_fields, field_shapes

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.kalman.linear_series import LinearModel

__all__ = ["Score", "log_likelihood", "score"]


class Score(NamedTuple):
    """Gradients of a log-likelihood of series together, each of the shape of its array.

    Those by covariances are symmetric, and count each entry for itself.

    Attributes
    ----------
    x, P, F, Q, H, R : ndarray
    terms : ndarray, shape (series, n, dim_x)
        By the terms B u.
    """

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray
    H: FloatArray
    R: FloatArray
    terms: FloatArray


def log_likelihood(
    model: LinearModel, zs: FloatArray, terms: FloatArray | None
) -> tuple[float, dict[str, FloatArray]]:
    """Return the log-likelihood of series, each of which starts at x and P, and what the filter found.

    Parameters
    ----------
    model : LinearModel
        Without fading memory.
    zs : ndarray, shape (series, n, dim_z)
        NaN where missing.
    terms : ndarray, shape (series or 1, n, dim_x), or None
        The terms B u.

    Returns
    -------
    value : float
    stored : dict of ndarray
        ``x``, ``P``, ``x_prior``, ``P_prior`` and ``log_likelihood``, (series, n, ...).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance of a residual is singular.
    """
    x, P, F, Q, H, R, _ = model
    shapes = field_shapes(len(P))
    stored = empty_fields(shapes, shapes, *zs.shape[:2])
    for k, series in enumerate(zs):
        own = None if terms is None else terms[k if len(terms) > 1 else 0]
        out = {name: values[k] for name, values in stored.items()}
        filter_linear(x.ravel(), P, series, F, Q, H, R, 1.0, own, out)
    return float(stored["log_likelihood"].sum()), stored


def score(model: LinearModel, zs: FloatArray, stored: dict[str, FloatArray]) -> Score:
    """Return the gradient of `log_likelihood`, of what that has stored.

    With S_k, K_k, y_k of the update and G_k = F (I - K_k H), backwards from r = 0, N = 0:

     r_k = H' S_k^-1 y_k + G_k' r_{k+1},  N_k = H' S_k^-1 H + G_k' N_{k+1} G_k,
     rho_k = F' r_{k+1},  M_k = F' N_{k+1} F,  xs_k = x_k + P_k rho_k,
     e_k = S_k^-1 y_k - K_k' rho_k,  D_k = S_k^-1 + K_k' M_k K_k,

    and, in sums over k, d/dQ = (r_k r_k' - N_k) / 2, d/dR = (e_k e_k' - D_k) / 2,
    d/dF = r_k xs_{k-1}' - N_k F P_{k-1}, d/dH = e_k xs_k' - K_k' (I - M_k P_k), d/d(B u_k) = r_k, and at the
    start d/dx = rho_0, d/dP = (rho_0 rho_0' - M_0) / 2.

    Parameters
    ----------
    model, zs
        As in `log_likelihood`.
    stored : dict of ndarray

    Returns
    -------
    Score

    Raises
    ------
    numpy.linalg.LinAlgError
        If the covariance of a residual is singular.

    References
    ----------
    S. J. Koopman, N. Shephard, Exact score for time series models in state space form, Biometrika 79
    (1992), 823-826: the gradients by Q and R.
    """
    x0, P0, F, _, H, R, _ = model
    x0 = x0.ravel()
    seen = ~np.isnan(zs)
    y = np.where(seen, zs - stored["x_prior"] @ H.T, 0.0)
    _, SI, K, _ = gain_stack(stored["P_prior"], H, R, None if seen.all() else seen)
    scaled = (SI @ y[..., None])[..., 0]
    G = F @ (np.eye(len(P0)) - K @ H)
    r, N = _backwards(scaled @ H, H.T @ SI @ H, G)

    # of the start, and after each update but the last, from which nothing comes
    rho, M = np.zeros_like(r), np.zeros_like(N)
    rho[:, :-1], M[:, :-1] = r[:, 1:] @ F, F.T @ N[:, 1:] @ F
    rho0, M0 = r[:, 0] @ F, F.T @ N[:, 0] @ F
    smoothed = stored["x"] + (stored["P"] @ rho[..., None])[..., 0]
    before = np.concatenate([(x0 + rho0 @ P0)[:, None], smoothed[:, :-1]], axis=1)
    P_before = np.concatenate([np.broadcast_to(P0, (len(zs), 1, *P0.shape)), stored["P"][:, :-1]], axis=1)
    e = scaled - (K.mT @ rho[..., None])[..., 0]
    D = SI + K.mT @ M @ K
    lost = K.mT @ (np.eye(len(P0)) - M @ stored["P"])
    return Score(
        x=rho0.sum(axis=0),
        P=0.5 * (_outer(rho0[:, None], rho0[:, None]) - M0.sum(axis=0)),
        F=_outer(r, before) - (N @ F @ P_before).sum(axis=(0, 1)),
        Q=0.5 * (_outer(r, r) - N.sum(axis=(0, 1))),
        H=_outer(e, smoothed) - lost.sum(axis=(0, 1)),
        R=0.5 * (_outer(e, e) - D.sum(axis=(0, 1))),
        terms=r,
    )


def _backwards(own: FloatArray, own_N: FloatArray, G: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return r (series, n, d) and N (series, n, d, d) by their recursions.

    Both are affine, so that blocks of about sqrt(n) steps are gone through at once, each as if nothing came
    from behind it, and what does come is added: Phi' r, Phi' N Phi, with Phi the product of G to the block's
    end.
    """
    series, n, d = own.shape
    length = isqrt(n) + 1
    blocks = -(-n // length)

    def cut(array: FloatArray) -> FloatArray:
        """Bring to (length, series, blocks, ...), with steps after the end from which nothing comes."""
        whole = np.zeros((series, blocks * length, *array.shape[2:]))
        whole[:, :n] = array
        parts = whole.reshape(series, blocks, length, *array.shape[2:])
        return np.ascontiguousarray(np.moveaxis(parts, 2, 0))

    def joined(parts: FloatArray) -> FloatArray:
        back = np.moveaxis(parts, 0, 2)
        return back.reshape(series, blocks * length, *back.shape[3:])[:, :n]

    r, N, G = cut(own[..., None]), cut(own_N), cut(G)
    Phi = G.copy()
    for k in range(length - 2, -1, -1):
        before = G[k].mT
        r[k] += before @ r[k + 1]
        N[k] += before @ N[k + 1] @ G[k]
        Phi[k] = Phi[k + 1] @ G[k]
    r_behind, N_behind = np.zeros((series, blocks, d, 1)), np.zeros((series, blocks, d, d))
    for b in range(blocks - 2, -1, -1):
        through = Phi[0, :, b + 1]
        r_behind[:, b] = r[0, :, b + 1] + through.mT @ r_behind[:, b + 1]
        N_behind[:, b] = N[0, :, b + 1] + through.mT @ N_behind[:, b + 1] @ through
    r += Phi.mT @ r_behind
    N += Phi.mT @ N_behind @ Phi
    return joined(r)[..., 0], joined(N)


def _outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the sum of a_k b_k' over series and steps."""
    product: FloatArray = a.reshape(-1, a.shape[-1]).T @ b.reshape(-1, b.shape[-1])
    return product
