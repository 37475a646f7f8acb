"""What a fit returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import is_whole
from fuzzykf.switching.learning.choice import bic

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.dynamics.simulation import Simulation

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
    bic_of_forms : dict
        BIC of each form of the Gaussian part that was learned; with ``form="auto"`` the
        model has the one of the least.
    """

    model: M
    log_likelihood: float
    n_parameters: int
    n_observations: int
    trace: FloatArray = field(repr=False)
    converged: bool
    warnings: tuple[str, ...] = ()
    switch_mean: Any = field(default=None, repr=False)
    bic_of_forms: dict[str, float] = field(default_factory=dict)
    refit: Callable[[Simulation], FitResult[M]] | None = field(default=None, repr=False)

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 k - 2 log L; smaller is better."""
        return 2.0 * self.n_parameters - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's information criterion, k log n - 2 log L; smaller is better."""
        return bic(self.n_parameters, self.n_observations, self.log_likelihood)

    def bootstrap(self, n_replicates: int, rng: np.random.Generator) -> list[FitResult[M]]:
        """Simulate from the model and learn again, to see how well parameters are known.

        Parameters
        ----------
        n_replicates : int
            Number of simulated series, each as long as the training data together.
        rng : numpy.random.Generator

        Returns
        -------
        list of FitResult
            Learned in the same way.  The spread of a parameter over their models estimates its
            standard error.  Where the switch is hidden, each search begins at the simulated one,
            so that the regimes keep their names.
        """
        if not is_whole(n_replicates) or n_replicates < 1:
            raise ParameterError(f"n_replicates: got {n_replicates!r}, expected a whole number of at least 1")
        if not isinstance(rng, np.random.Generator):
            raise ParameterError(f"rng: got {type(rng).__name__}, expected a numpy.random.Generator")
        if self.refit is None:
            raise ParameterError("bootstrap: this result was not made by a fit")
        model: Any = self.model
        return [self.refit(model.simulate(self.n_observations, rng)) for _ in range(int(n_replicates))]
