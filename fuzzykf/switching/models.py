"""The models of the 2020 paper: conditionally Gaussian, observed, with a Markov switch.

Models are immutable values, and valid: what is wrong with parameters is said when
the model is built.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import check_covariance
from fuzzykf.switching.chain import SwitchChain
from fuzzykf.switching.forms import CovarianceForm, GaussianForm, RegressionForm, TransitionForm
from fuzzykf.switching.laws import FuzzyMarkovLaw
from fuzzykf.switching.systems import StationarySystem

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.learning import FitResult
    from fuzzykf.switching.simulation import Simulation

__all__ = ["CGOFMSModel", "CGOMSModel"]

#: The noise of a fuzzy model is proved at the hard values and at so many values between.
N_PROOF = 16


class _SwitchingModel:
    """What the fuzzy and the hard model share: a Gaussian form, and value semantics."""

    form: GaussianForm

    @property
    def dim_x(self) -> int:
        """Number m of components of the state."""
        return self.form.dim_x

    @property
    def dim_z(self) -> int:
        """Number q of components of an observation."""
        return self.form.dim_z

    @property
    def n_classes(self) -> int:
        """Number K of hard regimes."""
        return self.form.n_classes

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model to a JSON file, atomically.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        ParameterError
            If the model holds functions (a law made by `FuzzyMarkovLaw.from_density`).
        """
        from fuzzykf.io import save_model

        save_model(self, path)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a model that `save` has written.

        Raises
        ------
        FileFormatError
            If the file is damaged, foreign, of another version, or holds another model.
        """
        from fuzzykf.io import load_model

        return load_model(path, cls)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self


class CGOFMSModel(_SwitchingModel):
    """Conditionally Gaussian observed fuzzy Markov switching model.

    A switch R moves on [0, 1] between two regimes, abruptly or gradually.  Given the
    switch, (X, Y) is a Gaussian Markov chain in which Y alone is Markov too, so that X
    can be filtered exactly.

    Parameters
    ----------
    law : FuzzyMarkovLaw
        Law of the switch.
    means : array_like, shape (2, d)
        Mean of Z = (X, Y) in either regime, d = dim_x + dim_z; linear in between.
    covariances : array_like, shape (2, 2, 2d, 2d)
        Covariance of (Z_n, Z_n+1) for each pair of regimes; rows X1, Y1, X2, Y2.
    dim_x : int
        Number of components of the state; the others are observed.
    interpolation : {"covariance", "transition"}
        What is bilinear between the regimes: the covariances, or the transition matrix
        and the symmetric root of the noise covariance.
    constraint : {"project", "check"}
        The entries Cov(Y2, X1) are not free: "project" sets them, whatever is given;
        "check" refuses covariances in which they are off.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes, symmetry or the shared blocks are wrong, or if the noise covariance of
        a pair of values of the switch is indefinite (which pair, which eigenvalue).  It
        is proved at the hard values and on a grid of values in between; every filter
        proves it again at its own nodes.

    References
    ----------
    Bouyahia, Derrode, Pieczynski (2020), sections III and V, with the corrections of
    the theory pages.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])  # covariance of (X, Y), in both regimes
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    ...     means=[[0.0, 3.0], [0.0, 0.0]],
    ...     covariances=np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> model.dim_x, model.dim_z
    (1, 1)
    >>> model.simulate(100, np.random.default_rng(0)).x.shape
    (100, 1)
    """

    def __init__(
        self,
        law: FuzzyMarkovLaw,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        *,
        interpolation: Literal["covariance", "transition"] = "covariance",
        constraint: Literal["project", "check"] = "project",
    ) -> None:
        if interpolation not in ("covariance", "transition"):
            raise ParameterError(
                f"interpolation: got {interpolation!r}, expected 'covariance' or 'transition'"
            )
        form: GaussianForm = CovarianceForm(means, covariances, dim_x, constraint)
        if interpolation == "transition":
            form = _transition_form(form)
        self._build(law, form)

    @classmethod
    def from_regressions(
        cls,
        law: FuzzyMarkovLaw,
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
    ) -> CGOFMSModel:
        """Make a model from the regressions of each pair of regimes.

        Per pair (i, j) of hard values of (r_n, r_n+1), and bilinear in between::

            Y' = Ayy Y + Ny + N(0, Qyy)
            X' = Axx X + H Y + G Y' + c + N(0, C)

        Nothing is assumed stationary, and positive definiteness holds everywhere by
        construction.  It is the form to learn in.

        Parameters
        ----------
        law : FuzzyMarkovLaw
        Ayy, Ny, Qyy : array_like, shapes (2, 2, q, q), (2, 2, q), (2, 2, q, q)
        Axx, H, G, c, C : array_like, shapes (2, 2, m, m), (2, 2, m, q), (2, 2, m, q), \
(2, 2, m), (2, 2, m, m)
        means, covariances : array_like, shapes (2, d) and (2, d, d)
            Law of the first (X, Y) in either regime.
        """
        form = RegressionForm(
            Ayy=Ayy, Ny=Ny, Qyy=Qyy, Axx=Axx, H=H, G=G, c=c, C=C, means=means, covariances=covariances
        )
        return cls._from_form(law, form)

    @classmethod
    def _from_form(cls, law: FuzzyMarkovLaw, form: GaussianForm) -> Self:
        model = cls.__new__(cls)
        model._build(law, form)
        return model

    def _build(self, law: FuzzyMarkovLaw, form: GaussianForm) -> None:
        if not isinstance(law, FuzzyMarkovLaw):
            raise ParameterError(f"law: got {type(law).__name__}, expected a FuzzyMarkovLaw")
        if form.n_classes != 2:
            raise ParameterError(f"means: got {form.n_classes} regimes, expected 2 for a fuzzy switch")
        self.law, self.form = law, form
        self._prove_noise()

    @classmethod
    def fit(
        cls,
        x: ArrayLike | Sequence[ArrayLike],
        y: ArrayLike | Sequence[ArrayLike],
        r: ArrayLike | Sequence[ArrayLike] | None = None,
        *,
        law: Literal["fmc1", "fmc2"] = "fmc1",
        form: Literal["regression"] = "regression",
        n_nodes: int = 5,
        rule: str = "cell",
    ) -> FitResult[CGOFMSModel]:
        """Learn a model from data in which the state was measured as well.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.  Several
            series are given as lists.
        r : array_like, shape (n,), or list of these
            Values of the switch in [0, 1].
        law : {"fmc1", "fmc2"}
            Family of the law of the switch.
        form : {"regression"}
            Form of the Gaussian part, see `from_regressions`.
        n_nodes : int
            Nodes on which the log-likelihood is computed.
        rule : str
            Rule of the discretisation, see `FuzzyMarkovLaw.discretize`.

        Returns
        -------
        FitResult
            With ``.model``, ``.log_likelihood`` and ``.warnings``.

        Notes
        -----
        Complete-data maximum likelihood on all transitions, hard and fuzzy.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw
        >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
        >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
        >>> truth = CGOFMSModel(
        ...     FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
        ...     [[0.0, 3.0], [0.0, 0.0]],
        ...     np.broadcast_to(pair, (2, 2, 4, 4)),
        ...     dim_x=1,
        ... )
        >>> data = truth.simulate(500, np.random.default_rng(0))
        >>> fit = CGOFMSModel.fit(data.x, data.y, data.r)
        >>> bool(abs(fit.model.law.p_hard - truth.law.p_hard) < 0.1)
        True
        """
        from fuzzykf.switching.learning import fit_fuzzy_model

        return fit_fuzzy_model(x, y, r, law=law, form=form, n_nodes=n_nodes, rule=rule)

    def _prove_noise(self) -> None:
        r = np.concatenate([[0.0], (np.arange(N_PROOF) + 0.5) / N_PROOF, [1.0]])
        u = self.class_weights(r)

        def describe(index: tuple[int, ...]) -> str:
            return f"pair r_n = {r[index[0]]:.6g}, r_n+1 = {r[index[1]]:.6g}"

        self.form.pairs(u[:, None], u[None, :], describe, self.law.joint_density(r[:, None], r) > 0.0)

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the shares of the two regimes in values of the switch: (..., 2)."""
        value = np.asarray(r, dtype=np.float64)
        if not ((value >= 0.0) & (value <= 1.0)).all():
            raise ParameterError(f"r: got values from {value.min()} to {value.max()}, expected [0, 1]")
        return np.stack([1.0 - value, value], axis=-1)

    def on_nodes(self, n_nodes: int = 5, rule: str = "cell") -> StationarySystem:
        """Place the model on the nodes of the discretised law.

        Parameters
        ----------
        n_nodes : int
            Nodes strictly between 0 and 1; the cost of a step grows as (n_nodes + 2)^2.
        rule : {"cell", "midpoint", "gauss", "product"}
            See `FuzzyMarkovLaw.discretize`.
        """
        return StationarySystem(self.law.discretize(n_nodes, rule), self.form)

    def harden(self) -> CGOMSModel:
        """Return the model of abrupt switches that is nearest in law.

        The law is integrated over the four quadrants; the Gaussian part of the hard
        pairs stays as it is.
        """
        joint = self.law.harden()
        initial = joint.sum(axis=1)
        return CGOMSModel._from_form(joint / initial[:, None], self.form, initial / initial.sum())

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
            ``.x`` (n, m), ``.y`` (n, q) and ``.r`` (n,).
        """
        from fuzzykf.switching.simulation import simulate_path

        r = self.law.sample(n, rng)
        return simulate_path(self.form, r, self.class_weights(r), rng)

    def __repr__(self) -> str:
        return f"CGOFMSModel({self.law!r}, dim_x={self.dim_x}, dim_z={self.dim_z}, form={self.form.kind!r})"


class CGOMSModel(_SwitchingModel):
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
                f"transition: got {len(chain)} regimes, expected {form.n_classes}, the number of rows of means"
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


def _transition_form(form: CovarianceForm) -> TransitionForm:
    """Compute A and Q at the hard pairs; in between these are interpolated, not the covariances."""
    u = np.eye(form.n_classes)
    A, Q = form.transition(u[:, None], u[None, :])
    check_covariance("covariances (noise of the hard pairs)", Q, Q.shape)
    return TransitionForm(A, Q, form.means, form.stationary, form.dim_x)
