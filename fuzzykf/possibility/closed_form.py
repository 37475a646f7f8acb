"""Linear models and the families of shapes that they do not leave, in any dimension.

A membership g^-1(q(x)) of a quadratic form q(x) = (x - m)' P^-1 (x - m) stays one
under linear prediction and update, if the t-norm has the generator g:

===========  ===========================  =====================  =================
family       membership                   t-norm                 generator of q
===========  ===========================  =====================  =================
gaussian     exp(-q/2)                    product                q/2
cauchy       1/(1 + q)                    Hamacher product       q
parabolic    max(0, 1 - q)                Łukasiewicz            q
===========  ===========================  =====================  =================

In each scale the extension principle minimises a sum of quadratic forms, hence

    min over x, w with x' = F x + w  of  |x - m|^2_P + |w|^2_Q  =  |x' - F m|^2_(FPF' + Q)
    |x - m|^2_P + |z - H x|^2_R  =  |x - m+|^2_(P+)  +  c,   c = |z - H m|^2_(HPH' + R)

with m+, P+ those of the Kalman filter.  The families differ in what the division by
the peak g^-1(c) does: nothing for Gauss, P+ (1 + c) for Cauchy, P+ (1 - c) for the
parabola, which is empty if c >= 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine.selected import rts_gains
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import LOG_2PI, RANK_TOLERANCE, symmetrize, whitening

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray, IntArray

__all__ = ["Posterior", "condition", "over_all", "possibility", "predict", "restart", "retrace"]

#: A residual in a direction without spread contradicts it beyond this relative rounding error.
CONTRADICTION = 1e-9


def predict(
    x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray, shift: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Linear prediction, valid for singular F and, as a limit, singular P and Q.

    Parameters
    ----------
    x, P : ndarray, shapes (m,) and (m, m)
    F, Q : ndarray, shape (m, m)
    shift : ndarray, shape (m,)
        Added to F x.

    Notes
    -----
    Layne and Passino (2001), equations (36) and (37); (37) is printed F'PF + Q.
    """
    return F @ x + shift, symmetrize(F @ P @ F.T + Q)


@dataclass(frozen=True)
class Posterior:
    """What `condition` finds.

    Attributes
    ----------
    x, P : ndarray, shapes (m,) and (m, m)
        Center and matrix after the update; None if the two exclude each other.
    y, S, SI, K : ndarray
        Residual (q,), H P H' + R, its (generalised) inverse, gain (m, q).
    surprise : float
        c = y' S^-1 y; infinite where y contradicts a direction without spread.
    log_likelihood : float
        log N(y; 0, S), on the range of S if that is singular.
    """

    x: FloatArray | None
    P: FloatArray | None
    y: FloatArray
    S: FloatArray
    SI: FloatArray
    K: FloatArray
    surprise: float
    log_likelihood: float


def condition(
    x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray, family: str
) -> Posterior:
    """Linear update of a membership of one of the three families.

    Parameters
    ----------
    x, P : ndarray, shapes (m,) and (m, m)
    z : ndarray, shape (q,)
        Observed components only.
    H, R : ndarray, shapes (q, m) and (q, q)
    family : {"gaussian", "cauchy", "parabolic"}

    Notes
    -----
    Layne and Passino (2001), equations (43), where x is misprinted, and (44), written
    in gain form so that singular P and R are admissible.
    """
    y = z - H @ x
    S = symmetrize(H @ P @ H.T + R)
    whiten, null = whitening(S)
    white = whiten @ y
    with np.errstate(over="ignore"):
        surprise = float(white @ white)
    rounding = CONTRADICTION * (np.abs(z) + np.abs(H) @ np.abs(x))
    rounding += 10.0 * np.sqrt(RANK_TOLERANCE * np.diag(S))
    if (np.abs(null @ y) > np.abs(null) @ rounding).any():
        surprise = np.inf
    SI = whiten.T @ whiten
    K = P @ H.T @ SI
    log_determinant = -float(np.linalg.slogdet(whiten @ whiten.T)[1]) if white.size else 0.0
    log_likelihood = -0.5 * (surprise + white.size * LOG_2PI + log_determinant)
    if possibility(surprise, family) <= 0.0 and (family == "parabolic" or np.isinf(surprise)):
        return Posterior(None, None, y, S, SI, K, surprise, log_likelihood)
    A = np.eye(x.size) - K @ H
    factor = {"gaussian": 1.0, "cauchy": 1.0 + surprise, "parabolic": 1.0 - surprise}[family]
    P = symmetrize(A @ P @ A.T + K @ R @ K.T) * factor
    return Posterior(x + K @ y, P, y, S, SI, K, surprise, log_likelihood)


def over_all(
    found: Posterior | None, seen: IntArray, dim_x: int, dim_z: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residual (dim_z,), inverse (dim_z, dim_z) and gain (dim_x, dim_z), zero for what was not seen.

    Parameters
    ----------
    found : Posterior or None
        Of the components seen; None if there are none.
    seen : ndarray of int
    dim_x, dim_z : int
    """
    y, SI, K = np.zeros(dim_z), np.zeros((dim_z, dim_z)), np.zeros((dim_x, dim_z))
    if found is not None:
        y[seen], K[:, seen], SI[np.ix_(seen, seen)] = found.y, found.K, found.SI
    return y, SI, K


def possibility(surprise: float, family: str) -> float:
    """Possibility g^-1(c) of a measurement of surprise c."""
    if family == "gaussian":
        return float(np.exp(-0.5 * surprise))
    if family == "cauchy":
        return 1.0 / (1.0 + surprise)
    if family == "parabolic":
        return max(0.0, 1.0 - surprise)
    raise ParameterError(f"family: got {family!r}, expected 'gaussian', 'cauchy' or 'parabolic'")


def restart(
    x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Forget what the prediction said about H x, and take z for it.

    The limit of the update for a prediction of ever larger spread along P H'; what z
    does not inform keeps its spread.

    Returns
    -------
    x, P : ndarray, or None
        None if the prediction has no spread in some direction of H x.
    """
    S = symmetrize(H @ P @ H.T)
    whiten, null = whitening(S)
    if null.size:
        return None
    G = P @ H.T @ whiten.T @ whiten
    A = np.eye(x.size) - G @ H
    return x + G @ (z - H @ x), symmetrize(A @ P @ A.T + G @ R @ G.T)


def retrace(
    x: FloatArray,
    P: FloatArray,
    x_prior: FloatArray,
    P_prior: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    x_later: FloatArray,
    P_later: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Look back over a linear prediction: the recursion of Rauch, Tung and Striebel.

    The minimum over x' of |x - m|^2_P + |x' - F x|^2_Q - |x' - m'|^2_P' + |x' - m'_s|^2_P's is a
    quadratic form around m + G (m'_s - m') with the matrix P + G (P's - P') G', G = P F' P'^-1, whether
    or not P's is larger than P': it may be for Cauchy, whose spread grows with surprise.

    Parameters
    ----------
    x, P : ndarray, shapes (m,) and (m, m)
        Before the prediction.
    x_prior, P_prior : ndarray
        After it.
    F, Q : ndarray, shape (m, m)
    x_later, P_later : ndarray
        What the whole series says of the state after it.

    Returns
    -------
    x, P : ndarray, shapes (m,) and (m, m)
        What it says of the state before.

    Notes
    -----
    The matrix is written (I - G F) P (I - G F)' + G (P's + Q) G', which cannot become indefinite.

    Examples
    --------
    >>> import numpy as np
    >>> one = np.eye(1)
    >>> x, P = retrace(np.zeros(1), one, np.zeros(1), 2.0 * one, one, one, np.ones(1), one)
    >>> x, P
    (array([0.5]), array([[0.75]]))
    """
    G = rts_gains(P[None], P_prior[None], F[None])[0]
    A = np.eye(x.size) - G @ F
    return x + G @ (x_later - x_prior), symmetrize(A @ P @ A.T + G @ (P_later + Q) @ G.T)
