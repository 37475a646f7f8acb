"""The model of K hard regimes (CGOMSM): a Gaussian system with a Markov switch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.switching.chain import SwitchChain
from fuzzykf.switching.forms import CovarianceForm, GaussianForm, RegressionForm, TransitionForm
from fuzzykf.switching.model_base import SwitchingModel
from fuzzykf.switching.systems import StationarySystem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning import FitResult
    from fuzzykf.switching.simulation import Simulation

__all__ = ["CGOMSModel"]


class CGOMSModel(SwitchingModel):
    """Conditionally Gaussian observed Markov switching model with K hard regimes.

    Parameters
    ----------
    transition : array_like, shape (K, K)
        ``transition[i, j]`` is the probability of regime j after regime i.
    means : array_like, shape (K, d)
        Mean of Z = (X, Y) in each regime, d = dim_x + dim_z.
    covariances : array_like, shape (K, K, 2d, 2d)
        Covariance of (Z_n, Z_n+1) for each pair of regimes; rows X1, Y1, X2, Y2.
    dim_x : int
        Number of components of the state.
    initial : array_like, shape (K,), optional
        Probability of the first regime; the stationary one by default.
    constraint : {"project", "check"}
        As in `CGOFMSModel`.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If something is wrong with shapes, probabilities or covariances.  Noise is
        checked at the pairs of positive probability.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSModel
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.1, 0.9]], [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1
    ... )
    >>> model.n_classes
    2
    """

    def __init__(
        self,
        transition: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        *,
        initial: ArrayLike | None = None,
        constraint: Literal["project", "check"] = "project",
    ) -> None:
        self._build(transition, CovarianceForm(means, covariances, dim_x, constraint), initial)

    @classmethod
    def from_transitions(
        cls,
        transition: ArrayLike,
        A: ArrayLike,
        Q: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        *,
        initial: ArrayLike | None = None,
    ) -> CGOMSModel:
        """Make a model from Z' - M(j) = A (Z - M(i)) + N(0, Q) for each pair (i, j) of regimes.

        Parameters
        ----------
        transition : array_like, shape (K, K)
        A, Q : array_like, shape (K, K, d, d)
            The lower left blocks of A, from X to Y', are zero.
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Moments of Z in each regime.
        dim_x : int
        initial : array_like, shape (K,), optional
        """
        return cls._from_form(transition, TransitionForm(A, Q, means, covariances, dim_x), initial)

    @classmethod
    def from_regressions(
        cls,
        transition: ArrayLike,
        *,
        Ayy: ArrayLike,
        Ny: ArrayLike,
        Qyy: ArrayLike,
        Axx: ArrayLike,
        H: ArrayLike,
        G: ArrayLike,
        c: ArrayLike,
        C: ArrayLike,
        means: ArrayLike,
        covariances: ArrayLike,
        initial: ArrayLike | None = None,
    ) -> CGOMSModel:
        """Make a model from the regressions of each pair of K regimes.

        Parameters are those of `CGOFMSModel.from_regressions`, with leading shape
        (K, K), or (K,) for ``means`` and ``covariances``.
        """
        form = RegressionForm(
            Ayy=Ayy, Ny=Ny, Qyy=Qyy, Axx=Axx, H=H, G=G, c=c, C=C, means=means, covariances=covariances
        )
        return cls._from_form(transition, form, initial)

    @classmethod
    def _from_form(
        cls, transition: ArrayLike, form: GaussianForm, initial: ArrayLike | None = None
    ) -> CGOMSModel:
        model = cls.__new__(cls)
        model._build(transition, form, initial)
        return model

    def _build(self, transition: ArrayLike, form: GaussianForm, initial: ArrayLike | None) -> None:
        chain = SwitchChain.from_classes(transition, initial)
        if len(chain) != form.n_classes:
            raise ParameterError(
                f"transition: got {len(chain)} regimes, expected {form.n_classes}, as many as rows of means"
            )
        self.form = form
        self._system = StationarySystem(chain, form)

    @classmethod
    def fit(
        cls,
        x: ArrayLike | Sequence[ArrayLike],
        y: ArrayLike | Sequence[ArrayLike],
        r: ArrayLike | Sequence[ArrayLike] | None = None,
        *,
        n_switches: int = 2,
        form: Literal["regression"] = "regression",
    ) -> FitResult[CGOMSModel]:
        """Learn a model from data in which the state was measured as well.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.
        r : array_like, shape (n,), or list of these
            Regimes 0, ..., n_switches - 1.
        n_switches : int
            Number K of regimes.
        form : {"regression"}
            Form of the Gaussian part, see `from_regressions`.

        Returns
        -------
        FitResult
            With ``.model``, ``.log_likelihood`` and ``.warnings``.
        """
        from fuzzykf.switching.learning import fit_hard_model

        return fit_hard_model(x, y, r, n_switches=n_switches, form=form)

    @property
    def transition(self) -> FloatArray:
        """Transition probabilities of the switch, (K, K)."""
        return self._system.chain.transition

    @property
    def initial(self) -> FloatArray:
        """Probabilities of the first regime, (K,)."""
        return self._system.chain.initial

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the one-hot shares of regimes 0, 1, ..., K - 1: (..., K)."""
        value = np.asarray(r, dtype=np.float64)
        if not np.isin(value, np.arange(self.n_classes)).all():
            raise ParameterError(f"r: expected regimes 0 to {self.n_classes - 1}, got {np.unique(value)[:5]}")
        one_hot: FloatArray = np.eye(self.n_classes)[value.astype(int)]
        return one_hot

    def on_nodes(self) -> StationarySystem:
        """Return the model on its regimes, as the recursion takes it."""
        return self._system

    def simulate(self, n: int, rng: np.random.Generator) -> Simulation:
        """Draw a series of switches, states and observations.

        Parameters
        ----------
        n : int
            Number of steps.
        rng : numpy.random.Generator

        Returns
        -------
        Simulation
            ``.x`` (n, m), ``.y`` (n, q) and ``.r`` (n,), regimes as 0, ..., K - 1.
        """
        from fuzzykf.switching.simulation import sample_classes, simulate_path

        r = sample_classes(self._system.chain, n, rng)
        return simulate_path(self.form, r, self.class_weights(r), rng)

    def __repr__(self) -> str:
        return (
            f"CGOMSModel(n_classes={self.n_classes}, dim_x={self.dim_x}, dim_z={self.dim_z}, "
            f"form={self.form.kind!r})"
        )
