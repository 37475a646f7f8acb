"""A repair, asked for by name, of covariances whose noise is indefinite.

After the constraint of the model has been imposed, the noise of a pair is positive
semi-definite if and only if no partial correlation of X_1 and X_2 given (Y_1, Y_2)
exceeds one.  Estimates from real data may break this.  Shrinking Cov(X_2, X_1) towards
zero can fail; towards the value at which that partial covariance vanishes it cannot,
at the hard pairs themselves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError
from fuzzykf.gaussian import check_definite
from fuzzykf.switching.dynamics.forms import CovarianceForm
from fuzzykf.switching.laws.base import Law
from fuzzykf.switching.models.fuzzy import CGOFMSModel
from fuzzykf.switching.models.hard import CGOMSModel

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray

__all__ = ["Repair", "shrink_covariances"]

#: Halvings of the interval in which the factor lies.
_HALVINGS = 40


class Repair(NamedTuple):
    """Covariances that make a model, and how far they are from those given.

    Attributes
    ----------
    covariances : ndarray, shape (K, K, 2d, 2d)
    factor : float
        1 if nothing had to be changed; 0 if X_1 and X_2 had to be made independent given
        (Y_1, Y_2).
    """

    covariances: FloatArray
    factor: float


def shrink_covariances(
    switch: Law | ArrayLike, means: ArrayLike, covariances: ArrayLike, dim_x: int
) -> Repair:
    """Shrink Cov(X_2, X_1) just as far as a valid model needs.

    In every pair, a = Cov(X_2, X_1) becomes a0 + s (a - a0) with
    a0 = Cov(X_2, Y) Cov(Y)^-1 Cov(Y, X_1), Y = (Y_1, Y_2), and the largest s in [0, 1] for
    which the model is valid.

    Parameters
    ----------
    switch : a law of two classes, or array_like, shape (K, K)
        The law of a `CGOFMSModel`, or the transition matrix of a `CGOMSModel`.
    means, covariances, dim_x
        As in the models.

    Returns
    -------
    Repair
        ``.covariances`` and ``.factor``.

    Raises
    ------
    NotPositiveDefiniteError
        If the model is not valid even for s = 0.
    ParameterError, ShapeError
        As from the models.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.2 * z], [0.2 * z, z]])
    >>> pair[0, 2] = pair[2, 0] = 0.99
    >>> means, law = np.zeros((2, 2)), FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    >>> repair = shrink_covariances(law, means, np.broadcast_to(pair, (2, 2, 4, 4)), 1)
    >>> round(repair.factor, 3)
    0.798
    >>> model = CGOFMSModel(law, means, repair.covariances, 1)
    """
    form = CovarianceForm(means, covariances, dim_x, "project")
    m, d = form.dim_x, form.means.shape[1]
    seen = np.r_[m:d, d + m : 2 * d]
    check_definite(
        form.covariances[..., seen[:, None], seen],
        lambda k: f"covariances: Cov(Y_1, Y_2) of the pair {tuple(map(int, k))}",
        strict=True,
    )
    given, target = form.covariances, _independent(form)

    def mixed(s: float) -> FloatArray:
        return target + s * (given - target)

    def check(s: float) -> None:
        if isinstance(switch, Law):
            CGOFMSModel(switch, means, mixed(s), dim_x)
        else:
            CGOMSModel(switch, means, mixed(s), dim_x, initial=_anything(switch))

    def valid(s: float) -> bool:
        try:
            check(s)
        except NotPositiveDefiniteError:
            return False
        return True

    if valid(1.0):
        return Repair(given, 1.0)
    check(0.0)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if valid(middle) else (low, middle)
    return Repair(mixed(low), low)


def _anything(transition: ArrayLike) -> FloatArray:
    """Return an initial distribution for a check that does not depend on it."""
    K = np.shape(transition)[0] if np.ndim(transition) == 2 else 0
    if K == 0:
        raise ParameterError(f"switch: got {transition!r}, expected a FuzzyMarkovLaw or a transition matrix")
    return np.full(K, 1.0 / K)


def _independent(form: CovarianceForm) -> FloatArray:
    """Return the covariances with X_1 and X_2 independent given (Y_1, Y_2)."""
    m, d = form.dim_x, form.means.shape[1]
    gamma = form.covariances.copy()
    first, second = slice(0, m), slice(d, d + m)
    y1, y2 = slice(m, d), slice(d + m, 2 * d)
    # what the constraint makes of Cov(Y_2, X_1)
    Ayy = np.swapaxes(np.linalg.solve(gamma[..., y1, y1], np.swapaxes(gamma[..., y2, y1], -1, -2)), -1, -2)
    y2x1 = Ayy @ gamma[..., y1, first]
    y = np.r_[m:d, d + m : 2 * d]
    Syy = gamma[..., y[:, None], y]
    yx1 = np.concatenate([gamma[..., y1, first], y2x1], axis=-2)
    a0 = gamma[..., second, y] @ np.linalg.solve(Syy, yx1)
    gamma[..., second, first] = a0
    gamma[..., first, second] = np.swapaxes(a0, -1, -2)
    return gamma
