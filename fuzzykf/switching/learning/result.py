"""What a fit returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from fuzzykf.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Callable

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
        What the iterations raise: the log-likelihood of each stretch of data given its first
        (x, y), in standard units, plus the logarithm of a weak prior.
    converged : bool
    warnings : tuple of str
        What the data cannot support.
    switch_mean : ndarray or pandas Series, shape (n,)
        Posterior mean of the switch along the training data (the switch itself, if it was
        given); NaN where x or y is missing.  Several series follow one another.
    """

    model: M
    log_likelihood: float
    n_parameters: int
    n_observations: int
    trace: FloatArray
    converged: bool
    warnings: tuple[str, ...] = ()
    switch_mean: Any = None
    refit: Callable[..., FitResult[M]] | None = field(default=None, repr=False)

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 k - 2 log L; smaller is better."""
        return 2.0 * self.n_parameters - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's information criterion, k log n - 2 log L; smaller is better."""
        return float(np.log(self.n_observations)) * self.n_parameters - 2.0 * self.log_likelihood

    def bootstrap(self, n_replicates: int, rng: np.random.Generator) -> list[FitResult[M]]:
        """Simulate from the model and learn again, to see how well parameters are known.

        Parameters
        ----------
        n_replicates : int
            Number of simulated series, each as long as the training data.
        rng : numpy.random.Generator

        Returns
        -------
        list of FitResult
            Learned with a hidden switch; the spread of a parameter over their models
            estimates its standard error.
        """
        if n_replicates < 1:
            raise ParameterError(f"n_replicates: got {n_replicates}, expected at least 1")
        if self.refit is None:
            raise ParameterError("bootstrap: this result was not made by a fit")
        found = []
        for _ in range(n_replicates):
            data = self.model.simulate(self.n_observations, rng)  # type: ignore[attr-defined]
            found.append(self.refit(data.x, data.y, rng))
        return found
