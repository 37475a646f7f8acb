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
        """Make a model from Z' = A_k Z + offset_k + N(0, noise_k), k the regime of arrival, Z = (X, Y).

        In blocks A = [[Axx, Axy], [Ayx, Ayy]]: where Ayx is not zero the state acts on the next
        observation, and filtering need not be exact.  The model is made all the same; `exactness` says which
        kind it is of.  If it is exact, `CGOMSMFilter` takes it; `SwitchingKalmanFilter` takes any.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i.
        A : array_like, shape (K, d, d)
            How Z moves to each regime; d = dim_x + dim_z.
        noise : array_like, shape (K, d, d)
            Covariance of its noise; may be singular, but for the block of Y.
        offset : array_like, shape (K, d), optional
            By default zero.
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
        """Make a model with an exact filter near a switching state-space model (CGLSSM).

        The state-space model is, with j the regime of the new time and U, V standard normal,

            X' = A_j X + C_j U,    Y' = B_j X' + D_j V.

        It has no exact filter of bounded cost.  The model made here (a CMSHLM) has one, and an
        exact likelihood and smoother.  It agrees with the given one in the law of the regimes
        and, given those of two consecutive times, in the covariance of the new state and
        observation and the ``order`` observations before; what older ones say, it forgets.

        Parameters
        ----------
        transition : array_like, shape (K, K)
            ``transition[i, j]`` is the probability of regime j after regime i; K of at least 1.
        A, B : array_like, shapes (K, m, m) and (K, q, m)
        C, D : array_like, shapes (K, m, s) and (K, q, t)
            Factors of the covariances C C' and D D' of the noises, not covariances.
        initial_probability : array_like, shape (K,), optional
            Probability of the regimes at the first observation; the stationary one by default.
        initial_covariance : array_like, shape (K, m, m), optional
            Covariance of X given the regime, at the first observation; the stationary one by
            default.  Its mean is zero.
        construction : {"gain", "markov_x", "clip"}
            The equation of the state.  "gain": the new observation corrects the state as in
            a Kalman filter; exists always.  "markov_x": that of the paper, X is a Markov chain;
            its filter has no feedback, and it exists only if Var(X' | Y, Y') - A_j Var(X | Y) A_j'
            is positive semi-definite.  "clip": as near to that as existence allows.
        noise : {"pair", "averaged"}
            One noise covariance per pair of regimes, or one per new regime, averaged over those
            before, as (23) of the paper is printed.
        order : int
            How many past observations a step conditions on, at most 64; above 1 with "gain" only.  The
            model gets nearer with each, see `closeness`, at little cost.
        mode : {"stationary", "time_varying"}
            Whether regimes and state start in their stationary law, or as given, so that each
            step has a table of its own.

        Raises
        ------
        ShapeError, ParameterError
            If shapes do not agree, probabilities do not sum to one, an option is unknown, or, in
            mode "stationary", what is given as initial is not stationary.
        NotStableError
            In mode "stationary", if the second moments of X do not settle; the message names
            the spectral radius.
        NotPositiveDefiniteError
            If the covariance of an observation given the past is singular, or the
            construction does not exist; the message names the regimes, the step and the
            eigenvalue.  In mode "time_varying" the first ``order + K`` steps are proved here (100 with
            "markov_x"), the others as soon as they are reached.

        Warns
        -----
        ClosenessWarning
            If `closeness` is above 1.25: a mean squared error a quarter larger than it could be.

        Notes
        -----
        On data of the given model, which `cglssm` keeps, the filter is not better than
        `IMMEstimator`: that one approximates the posterior of the right model, this one is
        exact for a model nearby.  After Pieczynski et al. (TAIMA 2013), (14)-(23), corrected.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSMFilter, CGOMSModel
        >>> matrices = {
        ...     "A": [[[0.98]], [[0.5]]], "B": [[[1.0]], [[1.0]]],
        ...     "C": [[[0.2]], [[1.0]]], "D": [[[0.5]], [[0.5]]],
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
        """Learn a model from data in which the state was measured as well.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.  As in `CGOFMSModel.fit`:
            rows of ``y`` without ``x`` are learned from as well.
        r : array_like, shape (n,), or list of these, optional
            Regimes 0, ..., n_regimes - 1; learned too if they are hidden.
        n_regimes : int
            Number K of regimes; 2 unless said otherwise.
        n_switches : int
            Another name of ``n_regimes``: the switch takes so many values.
        form, n_starts, max_iter, tolerance, state_feedback, objective, order, inputs, features, rng, progress
            As in `CGOFMSModel.fit`.

        Returns
        -------
        FitResult
            With ``.model``, ``.log_likelihood``, ``.trace``, ``.warnings``, ...; where states are missing the
            likelihood is that of `CGOFMSModel.fit`.

        Raises
        ------
        ParameterError
            As from `CGOFMSModel.fit`; or if both names of the number of regimes are given, and differ.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSModel
        >>> rng = np.random.default_rng(0)
        >>> r = (np.arange(400) // 50) % 2
        >>> y = 4.0 * r + rng.normal(size=400)
        >>> fit = CGOMSModel.fit(0.5 * y + rng.normal(size=400), y, r, n_regimes=2, form="regression")
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
        """Return the one-hot shares of regimes 0, 1, ..., K - 1: (..., K).

        Where `SwitchingStateSpace.to_exact` made the model, its regimes are nodes, with class weights.
        """
        value = as_numbers("r", r)
        if not np.isin(value, np.arange(self.n_classes)).all():
            raise ParameterError(f"r: expected regimes 0 to {self.n_classes - 1}, got {np.unique(value)[:5]}")
        shares: FloatArray = self._system.chain.class_weights[value.astype(int)]
        return shares

    @property
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime: one; of a model made by `to_exact`, at first."""
        chain = self._system.chain
        return 1.0 if chain.atoms.all() else float(chain.initial[chain.atoms].sum())

    def describe_switch(self) -> str:
        """Say in words how the switch moves."""
        if not self._system.chain.atoms.all():
            return f"fuzzy switch, a chain on {self.n_classes} nodes"
        if self.n_classes == 1:
            return "1 hard regime, which stays"
        stays = ", ".join(f"{p:.3g}" for p in self.transition.diagonal())
        return f"{self.n_classes} hard regimes, which stay with probability {stays}"

    def named_parameters(self) -> dict[str, float]:
        """Return the transition probabilities; of many regimes only those of staying."""
        K = self.n_classes
        pairs = [(i, j) for i in range(K) for j in range(K) if i == j or K <= MOST_PAIRED]
        return {f"p({i}, {j})": float(self.transition[i, j]) for i, j in pairs}

    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Return the model on its regimes, as the recursion takes it.

        Parameters
        ----------
        n_nodes, rule
            For models whose switch has values between the regimes; this one is placed
            exactly without them, whatever is asked for.
        """
        if n_nodes is not None and not (is_whole(n_nodes) and n_nodes >= 0):
            raise ParameterError(f"n_nodes: got {n_nodes!r}, expected a whole number of at least 0")
        as_choice("rule", rule, RULES)
        return self._system

    def jointly(self, n_nodes: int | None = None, rule: str = "cell") -> JointSystem:
        """Return a pairwise model on its regimes with all of (X, Y) for a state: any such model has that.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

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
        """Make the filter of the model.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`: a hard model has no need of them.

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
        """The state-space model from which `from_cglssm` made this one, or None."""
        given: CGLSSM | None = self.form.cglssm
        return given

    def closeness(self, weights: ArrayLike | None = None) -> float:
        """Compare the filter of a converted model (`from_cglssm`, `to_exact`) with the optimal one.

        Both are told the regimes and run on data of the state-space model; the optimal one is
        then the Kalman filter.  No simulation: `fuzzykf.switching.state_space.closeness` has the recursions.

        Parameters
        ----------
        weights : array_like, shape (m,), optional
            Weights of the squared errors of the components of the state, for components
            of different units; all one by default.

        Returns
        -------
        float
            Mean squared error of this model's filter in the long run, divided by that
            of the Kalman filter; at best 1.  Of a time-varying model in which the ratio
            does not settle, after 256 observations.

        Raises
        ------
        ParameterError
            If the model was not converted, or ``weights`` are negative or all zero;
            likewise if a time-varying model ceases to exist before the ratio has settled.

        Examples
        --------
        >>> from fuzzykf import CGOMSModel
        >>> matrices = {"A": [[[0.9]]], "B": [[[1.0]]], "C": [[[0.5]]], "D": [[[1.0]]]}
        >>> [round(CGOMSModel.from_cglssm([[1.0]], **matrices, order=k).closeness(), 4) for k in (1, 2, 5)]
        [1.0286, 1.0034, 1.0]
        """
        return self.form.closeness(np.ones(self.dim_x) if weights is None else weights)

    def to_dict(self) -> dict[str, Any]:
        """Return chain, Gaussian form and labels as plain values."""
        return {
            "transition": self.transition.tolist(),
            "initial": self.initial.tolist(),
            "form": part_to_dict(self.form),
        } | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a model from what `to_dict` returned."""
        form = part_from_dict(values["form"], FORMS)
        return cls._from_form(values["transition"], form, values["initial"])._labelled_from(values)

    @shown
    def __repr__(self) -> str:
        return (
            f"CGOMSModel(n_classes={self.n_classes}, dim_x={self.dim_x}, dim_z={self.dim_z}, "
            f"form={self.form.kind!r}{self._labels_text()})"
        )
