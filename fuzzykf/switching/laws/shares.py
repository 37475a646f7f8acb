"""Arguments and free numbers of the families whose mass is shared out among a few parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_array

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["ROUNDING", "as_number", "beta_of", "logits_of", "softmax"]

#: A mass or a density may be negative by this much through rounding; it then counts as zero.
ROUNDING = 1e-12

#: No share of a law from which a search begins is less: the logits of nothing are infinite.
LEAST_SHARE = 1e-4


def as_number(name: str, value: float) -> float:
    """Return a finite number."""
    return float(as_array(name, value, ()))


def beta_of(alpha: float, bound: float, purpose: str) -> float:
    """Beta from alpha and alpha + beta; zero where rounding makes it negative."""
    beta = bound - alpha
    if alpha < 0.0 or beta < -ROUNDING:
        raise ParameterError(
            f"alpha: got {alpha:.6g}, expected a number in [0, {max(bound, 0.0):.6g}], so that {purpose}"
        )
    return max(beta, 0.0)


def softmax(logits: FloatArray) -> FloatArray:
    """Map k numbers to k + 1 positive ones that sum to one; the first logit is zero."""
    full = np.concatenate([[0.0], logits])
    weights = np.exp(full - full.max())
    shares: FloatArray = weights / weights.sum()
    return shares


def logits_of(*shares: float) -> FloatArray:
    """Map k + 1 shares of one to the k numbers of which they are the softmax."""
    least = np.maximum(np.array(shares), LEAST_SHARE)
    logits: FloatArray = np.log(least[1:] / least[0])
    return logits
