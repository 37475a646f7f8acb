"""What chains with negative weights (the rule 'product') must not make of a law.

Sums over paths hold with signs as they do without.  What comes of them is refused where it is no law.
"""

from __future__ import annotations

from math import isqrt
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.engine import selected as engine
from fuzzykf.errors import QuadratureError

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["check_signed", "check_signed_moments", "too_coarse"]

#: Largest total of negative masses that a rule with negative weights may produce.
NEGATIVE_MASS = 1e-2

#: How far below zero rounding may take a variance, as a part of what it is the difference of.
ROUNDING = 1e-10


def too_coarse(what: str) -> QuadratureError:
    """Return what is said of a rule with negative weights whose interpolant has what no law has."""
    return QuadratureError(
        "the rule 'product', whose weights may be negative, is too coarse for this law and these "
        f"observations: its interpolant has {what}; use more nodes or the rule 'cell'"
    )


def check_signed(table: FloatArray, sign: FloatArray) -> None:
    """Refuse a state (..., 1 + e + e*e, M) that weights of both signs have made no law.

    Its probabilities may be negative by a little; its moments must be numbers, and no variance negative by
    more than rounding.
    """
    e = (isqrt(4 * table.shape[-2] - 3) - 1) // 2
    check_signed_moments(engine.probabilities(table, sign), *engine.node_moments(table, e))


def check_signed_moments(p: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Refuse probabilities (..., M), means (..., M, e) and covariances of nodes that are no law."""
    negative = np.maximum(-p, 0.0).sum(axis=-1)
    if not (negative <= NEGATIVE_MASS).all():  # NaN where the total is not positive
        worst = f"a negative mass of {np.max(negative):.3g} (at most {NEGATIVE_MASS} is tolerated)"
        raise too_coarse("no positive mass" if np.isnan(negative).any() else worst)
    with np.errstate(over="ignore", invalid="ignore"):  # what comes of it is looked at
        within = np.diagonal(covariance, axis1=-2, axis2=-1)
        # from the likeliest on, as the moments of the mixture are taken
        off = mean - np.take_along_axis(mean, p.argmax(axis=-1)[..., None, None], axis=-2)
        between = (off - p[..., None, :] @ off) ** 2
        variance = (p[..., None] * (within + between)).sum(axis=-2)
        size = (np.abs(p)[..., None] * (np.abs(within) + between)).sum(axis=-2)
    if not (variance >= -ROUNDING * size).all():
        raise too_coarse(f"a variance of {variance.min():.3g}")
