"""What a fit returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

if TYPE_CHECKING:
    from fuzzykf.base import FloatArray

__all__ = ["FitResult"]

M = TypeVar("M")


@dataclass(frozen=True, eq=False)
class FitResult(Generic[M]):
    """A learned model and how it was found.

    Attributes
    ----------
    model : CGOFMSModel or CGOMSModel
        In the units of the data.
    log_likelihood : float
        Log-density of the training data (x, y) under the model, in their units.
    n_parameters : int
        Free parameters.
    n_observations : int
        Times at which x and y were both measured.
    trace : ndarray
        The objective after each iteration.
    converged : bool
    warnings : tuple of str
        What the data cannot support.
    """

    model: M
    log_likelihood: float
    n_parameters: int
    n_observations: int
    trace: FloatArray
    converged: bool
    warnings: tuple[str, ...] = field(default=())

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 k - 2 log L; smaller is better."""
        return 2.0 * self.n_parameters - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's information criterion, k log n - 2 log L; smaller is better."""
        return float(np.log(self.n_observations)) * self.n_parameters - 2.0 * self.log_likelihood
