"""The model of K hard regimes (CGOMSM): a Gaussian system with a Markov switch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice, as_numbers, is_whole
from fuzzykf.io import FILTERS, part_from_dict, part_to_dict
from fuzzykf.reprs import shown
from fuzzykf.switching.dynamics.forms import CovarianceForm, RegressionForm, TransitionForm
from fuzzykf.switching.dynamics.pairwise import PairwiseForm
from fuzzykf.switching.dynamics.registry import FORMS
from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.quadrature import RULES
from fuzzykf.switching.models.base import SwitchingModel
from fuzzykf.switching.state_space.cglssm import CGLSSM
from fuzzykf.switching.state_space.closeness import warn_if_far
from fuzzykf.switching.state_space.converted_form import ConvertedForm

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FitResult
    from fuzzykf.switching.dynamics.base import Dynamics
    from fuzzykf.switching.dynamics.features import WindowFeatures
    from fuzzykf.switching.dynamics.joint import JointSystem
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.state_space.converted import Construction, Mode, Noise

__all__ = ["CGOMSModel"]

#: Regimes of which every transition probability has a name.
MOST_PAIRED = 2


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
        If shapes, probabilities or covariances are wrong.  Noise covariances are checked for pairs
        of positive probability.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSModel
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.1, 0.9]],
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     1,
    ... )
    >>> model.n_classes
    2
    """

    is_fuzzy = False

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
        """Create a model from Z' - M(j) = A (Z - M(i)) + N(0, Q) for each pair (i, j) of regimes.

        Parameters
        ----------
        transition : array_like, shape (K, K)
        A, Q : array_like, shape (K, K, d, d)
            The lower left blocks of A, from X to Y', are zero.
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Moments of Z in each regime.
        dim_x : int
        initial : array_like, shape (K,), optional

        Returns
        -------
        CGOMSModel
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
        """Create a model from regression coefficients for each pair of regimes.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i.
        Ayy, Ny, Qyy, Axx, H, G, c, C : array_like, shapes (K, K, ...)
            As in `CGOFMSModel.from_regressions`.
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Law of the first (X, Y) in each regime.
        initial : array_like, shape (K,), optional
            Probability of the first regime; the stationary one by default.

        Returns
        -------
        CGOMSModel
        """
        form = RegressionForm(
            Ayy=Ayy, Ny=Ny, Qyy=Qyy, Axx=Axx, H=H, G=G, c=c, C=C, means=means, covariances=covariances
        )
        return cls._from_form(transition, form, initial)

    @classmethod
    def from_pairwise(
        cls,
        transition: ArrayLike,
        A: ArrayLike,
        *,
        noise: ArrayLike,
        offset: ArrayLike | None = None,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        initial: ArrayLike | None = None,
    ) -> CGOMSModel:
        """Create a model from Z' = A_k Z + offset_k + N(0, noise_k), with k the new regime and Z = (X, Y).

        In blocks, A = [[Axx, Axy], [Ayx, Ayy]].  If Ayx is not zero, the state acts on the next
        observation, and there may be no exact filter; `exactness` tells.  `CGOMSMFilter` accepts exact
        models only, `SwitchingKalmanFilter` any.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i.
        A : array_like, shape (K, d, d)
            Transition matrix of Z to each regime; d = dim_x + dim_z.
        noise : array_like, shape (K, d, d)
            Noise covariance; may be singular, except for the block of Y.
        offset : array_like, shape (K, d), optional
            Offset of Z; by default zero.
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Law of the first Z in each regime.
        dim_x : int
            Number of components of the state.
        initial : array_like, shape (K,), optional
            Probability of the first regime; the stationary one by default.

        Returns
        -------
        CGOMSModel

        Raises
        ------
        ShapeError, ParameterError
            If shapes do not agree, or probabilities do not sum to one.
        NotPositiveDefiniteError
            If a covariance is indefinite, or that of an observation singular; the message names the argument,
            the regime and the eigenvalue.

        Examples
        --------
        A state that leaves nothing behind, once it was seen: X' follows what was observed of Y'.

        >>> from fuzzykf import CGOMSModel
        >>> model = CGOMSModel.from_pairwise(
        ...     [[0.9, 0.1], [0.2, 0.8]],
        ...     A=[[[0.5, 0.1], [1.0, 0.2]], [[0.4, 0.0], [0.8, 0.3]]],
        ...     noise=[[[1.0, 0.5], [0.5, 1.0]]] * 2,
        ...     means=[[0.0, 0.0], [0.0, 3.0]],
        ...     covariances=[[[1.0, 0.0], [0.0, 1.0]]] * 2,
        ...     dim_x=1,
        ... )
        >>> model.exactness
        'exact: A_yx[k] Abar[j] = 0 for every regime k that may follow a regime j'
        """
        form = PairwiseForm(A, noise=noise, offset=offset, means=means, covariances=covariances, dim_x=dim_x)
        return cls._from_form(transition, form, initial)

    @classmethod
    def from_cglssm(
        cls,
        transition: ArrayLike,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike,
        *,
        initial_probability: ArrayLike | None = None,
        initial_covariance: ArrayLike | None = None,
        construction: Construction = "gain",
        noise: Noise = "pair",
        order: int = 1,
        mode: Mode = "stationary",
    ) -> CGOMSModel:
        """Approximate a switching state-space model (CGLSSM) by a model with an exact filter.

        The state-space model is, with j the new regime and U, V standard normal,

            X' = A_j X + C_j U,    Y' = B_j X' + D_j V.

        It has no exact filter of bounded cost.  The approximation (a CMSHLM) has an exact filter,
        likelihood and smoother.  The law of the regimes is the same and, given two consecutive regimes, so
        is the joint covariance of the new state, the new observation and the ``order`` observations before.
        Older observations are ignored.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i; K of at least 1.
        A, B : array_like, shapes (K, m, m) and (K, q, m)
        C, D : array_like, shapes (K, m, s) and (K, q, t)
            Factors of the noise covariances C C' and D D'.
        initial_probability : array_like, shape (K,), optional
            Probability of the regimes at the first observation; the stationary one by default.
        initial_covariance : array_like, shape (K, m, m), optional
            Covariance of X given the regime, at the first observation; the stationary one by
            default.  Its mean is zero.
        construction : {"gain", "markov_x", "clip"}
            State equation.  "gain": the new observation corrects the state as in
            a Kalman filter; always exists.  "markov_x": X is a Markov chain, as in the paper;
            the filter has no feedback, and the model exists only if Var(X' | Y, Y') - A_j Var(X | Y) A_j'
            is positive semi-definite.  "clip": the closest existing model to "markov_x".
        noise : {"pair", "averaged"}
            One noise covariance per pair of regimes, or one per new regime, averaged over the previous
            regimes as in equation (23) of the paper.
        order : int
            Number of past observations in the equations, at most 64; above 1 with "gain" only.  A larger
            order is more accurate, at little cost; see `closeness`.
        mode : {"stationary", "time_varying"}
            Whether regimes and state start in their stationary law, or as given; coefficients then
            depend on time.

        Returns
        -------
        CGOMSModel

        Raises
        ------
        ShapeError, ParameterError
            If shapes do not agree, probabilities do not sum to one, an option is unknown, or, in
            mode "stationary", the initial law is not stationary.
        NotStableError
            In mode "stationary", if the second moments of X do not converge; the message names
            the spectral radius.
        NotPositiveDefiniteError
            If the covariance of an observation given the past is singular, or the
            construction does not exist; the message names the regimes, the step and the
            eigenvalue.  In mode "time_varying", the first ``order + K`` steps (100 with "markov_x") are
            checked here, the others when they are reached.

        Warns
        -----
        ClosenessWarning
            If `closeness` is above 1.25, that is, the mean squared error is 25 % above the optimum.

        Notes
        -----
        On data of the state-space model, the filter is not more accurate than `IMMEstimator`, which
        approximates the posterior of the right model; this one is exact for an approximate model.  The
        attribute `cglssm` keeps the state-space model.  After Pieczynski et al. (TAIMA 2013), (14)-(23),
        corrected.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSMFilter, CGOMSModel
        >>> matrices = {
        ...     "A": [[[0.98]], [[0.5]]],
        ...     "B": [[[1.0]], [[1.0]]],
        ...     "C": [[[0.2]], [[1.0]]],
        ...     "D": [[[0.5]], [[0.5]]],
        ... }
        >>> model = CGOMSModel.from_cglssm([[0.95, 0.05], [0.10, 0.90]], **matrices, order=3)
        >>> truth = model.cglssm.simulate(200, np.random.default_rng(0))
        >>> CGOMSMFilter(model).filter(truth.y).x.shape
        (200, 1)
        """
        cglssm = CGLSSM(
            transition,
            A,
            B,
            C,
            D,
            initial_probability=initial_probability,
            initial_covariance=initial_covariance,
        )
        form = ConvertedForm(cglssm, construction, noise, order, mode)
        warn_if_far(form.system)
        return cls._from_form(cglssm.transition, form, cglssm.initial_probability)

    @classmethod
    def _from_form(cls, transition: ArrayLike, form: Dynamics, initial: ArrayLike | None = None) -> Self:
        model = cls.__new__(cls)
        model._build(transition, form, initial)
        return model

    def _build(self, transition: ArrayLike, form: Dynamics, initial: ArrayLike | None) -> None:
        chain = SwitchChain.from_classes(transition, initial)
        if len(chain) != form.n_classes:
            raise ParameterError(
                f"transition: got {len(chain)} regimes, expected {form.n_classes}, as many as rows of means"
            )
        self.form = form
        self._system: SwitchingSystem = form.placed(chain)

    @classmethod
    def fit(
        cls,
        x: ArrayLike | Sequence[ArrayLike],
        y: ArrayLike | Sequence[ArrayLike],
        r: ArrayLike | Sequence[ArrayLike] | None = None,
        *,
        n_switches: int | None = None,
        n_regimes: int | None = None,
        form: Literal["auto", "regression", "covariance"] = "auto",
        n_starts: int = 4,
        max_iter: int = 500,
        tolerance: float = 1e-6,
        state_feedback: bool = True,
        objective: Literal["joint", "filter"] = "joint",
        order: int = 1,
        inputs: Any = None,
        features: WindowFeatures | Literal["auto"] | None = None,
        rng: np.random.Generator | None = None,
        progress: bool | None = None,
    ) -> FitResult[CGOMSModel]:
        """Learn a model from measured states and observations.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.  Rows of ``y``
            without ``x`` are used as well, see `CGOFMSModel.fit`.
        r : array_like, shape (n,), or list of these, optional
            Regimes 0, ..., n_regimes - 1.  Omit it if they are hidden: they are then learned, too.
        n_regimes : int
            Number K of regimes, by default 2.
        n_switches : int
            Another name of ``n_regimes``.
        form, n_starts, max_iter, tolerance, state_feedback, objective, order, inputs, features, rng, progress
            As in `CGOFMSModel.fit`.

        Returns
        -------
        FitResult
            With ``model``, ``log_likelihood``, ``trace``, ``warnings`` and ``summary()``.

        Raises
        ------
        ParameterError
            As from `CGOFMSModel.fit`; if ``n_regimes`` and ``n_switches`` differ.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSModel
        >>> rng = np.random.default_rng(0)
        >>> r = (np.arange(400) // 50) % 2
        >>> y = 4.0 * r + rng.normal(size=400)
        >>> fit = CGOMSModel.fit(
        ...     0.5 * y + rng.normal(size=400), y, r, n_regimes=2, form="regression"
        ... )
        >>> fit.model.n_classes
        2
        """
        from fuzzykf.switching.learning import fit_hard_model

        return fit_hard_model(
            x,
            y,
            r,
            n_switches=n_switches,
            n_regimes=n_regimes,
            form=form,
            n_starts=n_starts,
            max_iter=max_iter,
            tolerance=tolerance,
            state_feedback=state_feedback,
            objective=objective,
            order=order,
            inputs=inputs,
            features=features,
            rng=rng,
            progress=progress,
        )

    @property
    def transition(self) -> FloatArray:
        """Transition probabilities of the switch, (K, K)."""
        return self._system.chain.transition

    @property
    def initial(self) -> FloatArray:
        """Probabilities of the first regime, (K,)."""
        return self._system.chain.initial

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the class weights (..., K) of regimes 0, ..., K - 1: one for the regime, else zero.

        In a model made by `SwitchingStateSpace.to_exact`, regimes are nodes, with class weights of their own.

        Parameters
        ----------
        r : array_like of int
            Regimes.

        Returns
        -------
        ndarray, shape (..., K)
        """
        value = as_numbers("r", r)
        if not np.isin(value, np.arange(self.n_classes)).all():
            raise ParameterError(f"r: expected regimes 0 to {self.n_classes - 1}, got {np.unique(value)[:5]}")
        shares: FloatArray = self._system.chain.class_weights[value.astype(int)]
        return shares

    @property
    def p_hard(self) -> float:
        """Probability of a hard regime: one, except in a model made by `SwitchingStateSpace.to_exact`."""
        chain = self._system.chain
        return 1.0 if chain.atoms.all() else float(chain.initial[chain.atoms].sum())

    def describe_switch(self) -> str:
        """Describe the switch in words.

        Returns
        -------
        str
        """
        if not self._system.chain.atoms.all():
            return f"fuzzy switch, a chain on {self.n_classes} nodes"
        if self.n_classes == 1:
            return "1 hard regime, which stays"
        stays = ", ".join(f"{p:.3g}" for p in self.transition.diagonal())
        return f"{self.n_classes} hard regimes, which stay with probability {stays}"

    def named_parameters(self) -> dict[str, float]:
        """Return the transition probabilities by name; for many regimes only the diagonal.

        Returns
        -------
        dict of str to float
        """
        K = self.n_classes
        pairs = [(i, j) for i in range(K) for j in range(K) if i == j or K <= MOST_PAIRED]
        return {f"p({i}, {j})": float(self.transition[i, j]) for i, j in pairs}

    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Return the system that a filter takes.

        Parameters
        ----------
        n_nodes, rule
            Ignored: a hard switch has no values between the regimes.

        Returns
        -------
        SwitchingSystem
        """
        if n_nodes is not None and not (is_whole(n_nodes) and n_nodes >= 0):
            raise ParameterError(f"n_nodes: got {n_nodes!r}, expected a whole number of at least 0")
        as_choice("rule", rule, RULES)
        return self._system

    def jointly(self, n_nodes: int | None = None, rule: str = "cell") -> JointSystem:
        """Return the system of a pairwise model in which the whole of (X, Y) is the state.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        SwitchingSystem

        Raises
        ------
        ParameterError
            If the model was not made by `from_pairwise`.
        """
        self.placed(n_nodes, rule)  # what makes no sense is refused
        if not isinstance(self.form, PairwiseForm):
            raise ParameterError(
                f"model: got a CGOMSModel of the form {self.form.kind!r}, expected a SwitchingStateSpace, or "
                "a model made by CGOMSModel.from_pairwise"
            )
        return self.form.jointly(self._system.chain)

    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Return the exact filter of the model.

        Parameters
        ----------
        n_nodes, rule
            Ignored, as in `placed`.

        Returns
        -------
        CGOMSMFilter

        Raises
        ------
        ParameterError
            If the model has no exact filter, see `exactness`.
        """
        self.placed(n_nodes, rule)  # what makes no sense is refused
        return FILTERS["CGOMSMFilter"](self)

    def _sample_switch(self, n: int, rng: np.random.Generator, n_nodes: int | None) -> FloatArray:
        chain, numbers = self._system.chain, np.arange(self.n_classes)  # of nodes, which may share a value
        own = SwitchChain(numbers, chain.weights, chain.initial, chain.transition, chain.class_weights)
        return own.sample(n, rng)

    @property
    def cglssm(self) -> CGLSSM | None:
        """State-space model from which `from_cglssm` made this model, or None."""
        given: CGLSSM | None = self.form.cglssm
        return given

    def closeness(self, weights: ArrayLike | None = None) -> float:
        """Compare the filter of a converted model with the optimal filter.

        The model comes from `from_cglssm` or `SwitchingStateSpace.to_exact`.  Both filters know the regimes
        and run on data of the state-space model, for which the optimal filter is the Kalman filter.  The
        errors are computed by recursions, without simulation.

        Parameters
        ----------
        weights : array_like, shape (m,), optional
            Weights of the squared errors of the state components; by default all one.

        Returns
        -------
        float
            Asymptotic mean squared error of this model's filter, divided by that of the Kalman filter;
            1 is optimal.  For a time-varying model whose ratio does not converge, the value after 256
            observations.

        Raises
        ------
        ParameterError
            If the model was not converted, or ``weights`` are negative or all zero;
            if a time-varying model ceases to exist before the ratio converges.

        Examples
        --------
        >>> from fuzzykf import CGOMSModel
        >>> matrices = {"A": [[[0.9]]], "B": [[[1.0]]], "C": [[[0.5]]], "D": [[[1.0]]]}
        >>> [
        ...     round(CGOMSModel.from_cglssm([[1.0]], **matrices, order=k).closeness(), 4)
        ...     for k in (1, 2, 5)
        ... ]
        [1.0286, 1.0034, 1.0]
        """
        return self.form.closeness(np.ones(self.dim_x) if weights is None else weights)

    def to_dict(self) -> dict[str, Any]:
        """Return chain, parameters and labels as plain values.

        Returns
        -------
        dict
        """
        return {
            "transition": self.transition.tolist(),
            "initial": self.initial.tolist(),
            "form": part_to_dict(self.form),
        } | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create a model from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        CGOMSModel
        """
        form = part_from_dict(values["form"], FORMS)
        return cls._from_form(values["transition"], form, values["initial"])._labelled_from(values)

    @shown
    def __repr__(self) -> str:
        return (
            f"CGOMSModel(n_classes={self.n_classes}, dim_x={self.dim_x}, dim_z={self.dim_z}, "
            f"form={self.form.kind!r}{self._labels_text()})"
        )
