"""The switching state-space model, hard or fuzzy, as users make it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_array, as_choice, as_count, as_numbers, brief, check_covariance
from fuzzykf.immutable import Unassignable
from fuzzykf.io import FILTERS, MODELS, part_from_dict, part_to_dict
from fuzzykf.overrides import VERBS, is_patched
from fuzzykf.reprs import shown, value_text
from fuzzykf.switching.dynamics.model import NODES, SwitchingModel
from fuzzykf.switching.dynamics.registry import FORMS
from fuzzykf.switching.laws.base import Law
from fuzzykf.switching.laws.chain import SAME_VALUE, SwitchChain, check_probabilities, shares_of
from fuzzykf.switching.laws.quadrature import RULES
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.state_space.controls import read_controls
from fuzzykf.switching.state_space.space_form import StateSpaceForm

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike
    from fuzzykf.estimation.result import LikelihoodFit
    from fuzzykf.results import Simulation
    from fuzzykf.switching.state_space.space_system import SpaceSystem

    #: A parameter: for all classes, for each class, or a function of the class weights (K,).
    BySwitch = ArrayLike | Callable[[FloatArray], ArrayLike]

__all__ = ["SwitchingStateSpace"]

#: Where functions of the class weights are looked at besides the classes themselves.
N_PROOF = 16


class SwitchingStateSpace(SwitchingModel):
    """Linear state-space model whose matrices follow an abrupt or gradual switch.

    With w the class weights of the switch at the new time,

        X' = F(w) X + b(w) + B(w) u' + N(0, Q(w)),
        Y' = H(w) X' + d(w) + N(0, R(w)).

    Each parameter is an array shared by all K classes, an array with a leading axis for the classes, which
    is averaged by the class weights, or a function of the class weights (K,).  Use a function where an
    average makes no sense: the average of two rotations is not a rotation.

    Parameters
    ----------
    law : Law, SwitchChain or array_like, shape (K, K)
        Law of the switch (`FuzzyMarkovLaw`, `FadeLaw`, `GraphLaw`, ...), your own chain, or the transition
        probabilities of K hard regimes.  For the last two, ``n_nodes`` is ignored.
    F : array_like, shape (m, m) or (K, m, m), or callable
        Transition matrix of the state.
    H : array_like, shape (q, m) or (K, q, m), or callable
        Observation matrix.
    Q : array_like, shape (m, m) or (K, m, m), or callable
        Covariance of the process noise; may be singular.
    R : array_like, shape (q, q) or (K, q, q), or callable
        Covariance of the measurement noise.
    initial : array_like, shape (K,), optional
        Probabilities of the classes at the first observation.  By default the switch is stationary, and your
        own chain starts from its initial law.
    b : array_like, shape (m,) or (K, m), or callable, optional
        Offset of the state, by default zero.
    d : array_like, shape (q,) or (K, q), or callable, optional
        Offset of the observation, by default zero.
    B : array_like, shape (m, k) or (K, m, k), or callable, optional
        Control matrix.
    x0 : array_like, shape (m,), (m, 1) or (K, m), optional
        Mean of the state at the first observation.  By default the stationary one.
    P0 : array_like, shape (m, m) or (K, m, m), optional
        Covariance of the state at the first observation; by default the stationary one.
    mix : {"linear", "log"}
        How covariances are averaged: linearly, which admits singular ones, or in the logarithm of their
        Cholesky factors, so that noise fades evenly over orders of magnitude.

    Attributes
    ----------
    law : Law or SwitchChain
    initial : ndarray, shape (K,), or None
        As given.
    form : StateSpaceForm
        The parameters at any value of the switch.
    dim_x, dim_z, n_classes : int
    dim_u : int or None
        Number of controls; None without ``B``.

    Raises
    ------
    ShapeError, ParameterError
        If shapes or numbers of classes do not agree, probabilities do not sum to one, or a function returns
        the wrong shape or depends on more than the class weights.
    NotPositiveDefiniteError
        If a covariance is indefinite; the message names the class, or the class weights.
    NotStableError
        If x0 or P0 is omitted and no stationary one exists; the message names the spectral radius.

    Notes
    -----
    The model has no exact filter of bounded cost.  `SwitchingKalmanFilter` approximates it;
    `KnownSwitchFilter` gives the lower bound of the error.  For a law, a stationary x0 or P0 is computed on
    the nodes; between nodes, for `simulate` and a known switch, the nearest default node counts.

    Examples
    --------
    A sensor whose gain fades from 1 to 0.3 and back, over 20 steps:

    >>> import numpy as np
    >>> from fuzzykf import FadeLaw, SwitchingStateSpace
    >>> model = SwitchingStateSpace(
    ...     FadeLaw.between(60, 20),
    ...     F=0.99,
    ...     b=[0.1],
    ...     Q=0.09,
    ...     H=[[[1.0]], [[0.3]]],
    ...     R=0.25,
    ...     x0=[10.0],
    ...     P0=4.0,
    ... )
    >>> model.n_classes, model.dim_x, model.dim_z
    (2, 1, 1)
    >>> truth = model.simulate(100, np.random.default_rng(0))
    >>> truth.x.shape, truth.y.shape, truth.r.shape
    ((100, 1), (100, 1), (100,))
    """

    form: StateSpaceForm

    F, H, Q, R, b, d, B, x0, P0 = (Unassignable("it never changes: make another one") for _ in range(9))

    def __init__(
        self,
        law: Law | SwitchChain | ArrayLike,
        F: BySwitch,
        H: BySwitch,
        Q: BySwitch,
        R: BySwitch,
        *,
        initial: ArrayLike | None = None,
        b: BySwitch | None = None,
        d: BySwitch | None = None,
        B: BySwitch | None = None,
        x0: BySwitch | None = None,
        P0: BySwitch | None = None,
        mix: Literal["linear", "log"] = "linear",
    ) -> None:
        self.law = _as_law(law, initial)
        self.initial = None if initial is None else as_array("initial", initial, (self.law.n_classes,))
        if self.initial is not None:
            check_probabilities("initial", self.initial)
        self.form = StateSpaceForm(self._chain(), F, H, Q, R, b=b, d=d, B=B, x0=x0, P0=P0, mix=mix)
        if isinstance(self.law, Law):
            u, _, there = self.law.reach(N_PROOF)
            for parameter in self.form.parameters.values():
                parameter.at(u[there])
        #: Whether the switch takes values between the classes.
        self.is_fuzzy = not bool(self.form.chain.atoms.all())

    @classmethod
    def from_filters(
        cls,
        filters: Sequence[Any],
        law: Law | SwitchChain | ArrayLike,
        *,
        initial: ArrayLike | None = None,
        mix: Literal["linear", "log"] = "linear",
    ) -> SwitchingStateSpace:
        """Create a model from Kalman filters, one per class, as for filterpy's IMM.

        As for `IMMEstimator`, x and P of each filter belong to the time before the first predict.  The model
        starts at the first observation, so they are predicted once.

        Parameters
        ----------
        filters : sequence of KalmanFilter
            Two or more, from fuzzykf or filterpy; the model takes their F, H, Q, R, B, x and P.
        law : Law, SwitchChain or array_like, shape (K, K)
            Law of the switch between them.
        initial, mix
            As in the constructor.

        Returns
        -------
        SwitchingStateSpace

        Raises
        ------
        ShapeError, ParameterError
            If there are fewer than two filters, or their number is not that of the classes; if a filter
            lacks a matrix, has a fading memory or overrides `predict` or `update`; if shapes do not agree.
        NotPositiveDefiniteError
            If a covariance is indefinite.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import FadeLaw, KalmanFilter, SwitchingStateSpace
        >>> sun = KalmanFilter(1, 1, F=[[0.95]], H=[[1.0]], Q=0.09, R=0.04)
        >>> shadow = KalmanFilter(1, 1, F=[[0.95]], H=[[0.4]], Q=0.09, R=0.36)
        >>> model = SwitchingStateSpace.from_filters([sun, shadow], FadeLaw.between(60, 20))
        >>> model.form.at("H", np.array([0.5, 0.5]))
        array([[0.7]])
        """
        matrices, law = matrices_of(filters), _as_law(law, initial)
        if len(filters) != law.n_classes:
            raise ParameterError(
                f"filters: got {len(filters)}, expected {law.n_classes}, as many as the law has classes"
            )
        return SwitchingStateSpace(law, **matrices, initial=initial, mix=mix)

    # ------------------------------------------------------------------ the switch

    def _chain(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchChain:
        """Return the switch on nodes, beginning as the model says."""
        return chain_on_nodes(self.law, self.initial, self._nodes(n_nodes), rule)

    def _nodes(self, n_nodes: int | None) -> int:
        """Return how many nodes there are between the classes."""
        if n_nodes is not None or isinstance(self.law, SwitchChain):
            return 0 if n_nodes is None else n_nodes
        return self.law.nodes_up_to(NODES)

    @property
    def dim_u(self) -> int | None:
        """Number of controls; None without any."""
        return self.form.dim_u

    @property
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime; for a chain, at the first observation."""
        if isinstance(self.law, SwitchChain):
            return float(self.law.initial[self.law.atoms].sum())
        return self.law.p_hard

    @property
    def takes_weights(self) -> bool:
        """Whether values of the switch are class weights."""
        return self.form.chain.nodes.ndim == 2 or (self.is_fuzzy and not self._lies_between)

    @property
    def _lies_between(self) -> bool:
        """Whether a value r of the switch stands for the class weights (1 - r, r)."""
        chain = self.form.chain
        if chain.nodes.ndim == 2 or self.n_classes != 2:
            return False
        between = np.stack([1.0 - chain.nodes, chain.nodes], axis=-1)
        return bool(np.abs(chain.class_weights - between).max() <= SAME_VALUE)

    def describe_switch(self) -> str:
        """Describe the switch in words.

        Returns
        -------
        str
        """
        if isinstance(self.law, SwitchChain):
            return f"{'fuzzy' if self.is_fuzzy else 'hard'} switch, a chain on {len(self.law)} nodes"
        return f"fuzzy switch, law {self.law.kind}"

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the class weights (..., K) of values of the switch.

        Parameters
        ----------
        r : array_like
            For two classes: numbers in [0, 1].  For a hard switch: regimes 0, ..., K - 1.  For a fuzzy switch
            between more than two classes: class weights (..., K), or classes as a number or a flat array.
            For your own chain: values of its nodes, or class weights.

        Returns
        -------
        ndarray, shape (..., K)
        """
        value, chain = as_numbers("r", r), self.form.chain
        if chain.nodes.ndim == 2 or (self.takes_weights and value.ndim > 1):
            return shares_of(value, self.n_classes)
        if self._lies_between:
            if not ((value >= 0.0) & (value <= 1.0)).all():
                raise ParameterError(f"r: got values from {value.min()} to {value.max()}, expected [0, 1]")
            return np.stack([1.0 - value, value], axis=-1)
        near = np.abs(value[..., None] - chain.nodes) <= SAME_VALUE
        if not near.any(axis=-1).all():
            wrong = value[~near.any(axis=-1)].flat[0]
            raise ParameterError(f"r: got {wrong:.6g}, expected one of the nodes, {value_text(chain.nodes)}")
        shares: FloatArray = chain.class_weights[near.argmax(axis=-1)]
        return shares

    def _sample_switch(self, n: int, rng: np.random.Generator, n_nodes: int | None) -> FloatArray:
        if isinstance(self.law, SwitchChain) or self.initial is not None:
            return self._chain(n_nodes).sample(n, rng)
        return self.law.sample(n, rng, n_nodes)

    def simulate(
        self, n: int, rng: np.random.Generator, n_nodes: int | None = None, us: Any = None
    ) -> Simulation:
        """Simulate switch, states and observations.

        Parameters
        ----------
        n : int
            Number of steps.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Simulate the switch on this many nodes between the classes; see ``law.sample``.  By default, it
            takes any value if the law allows that, else those of the law's default nodes.
        us : array_like, shape (n, k), or (n,) if there is one control, optional
            Controls, as in `SwitchingKalmanFilter.filter`: ``us[n]`` acts on the step to observation n,
            ``us[0]`` is not used, and None in a list means no control.  Random numbers do not depend on
            them.

        Returns
        -------
        Simulation
            ``x`` (n, m), ``y`` (n, q) and ``r`` (n,), or class weights (n, K) for a fuzzy switch between
            more than two classes.

        Raises
        ------
        ShapeError, ParameterError
            If ``us`` has the wrong shape, is not finite, or the model has no ``B``; the generator is then
            unchanged.

        Examples
        --------
        A heater that is switched on, with the same noise:

        >>> import numpy as np
        >>> from fuzzykf import SwitchingStateSpace
        >>> model = SwitchingStateSpace(
        ...     [[0.9, 0.1], [0.1, 0.9]], F=0.5, H=1.0, Q=0.1, R=0.1, B=1.0
        ... )
        >>> on = model.simulate(4, np.random.default_rng(0), us=[0.0, 0.0, 1.0, 1.0])
        >>> off = model.simulate(4, np.random.default_rng(0))
        >>> (on.x - off.x)[:, 0].round(6)
        array([0. , 0. , 1. , 1.5])
        """
        controls = read_controls(us, as_count("n", n), self, begins=True)
        r = self._sample_switch(n, rng, n_nodes)
        return self.form.simulate(self.class_weights(r), r, rng, None if controls is None else controls[0])

    # ------------------------------------------------------------------ learning

    def fit(
        self,
        zs: ManyNumbers | ManySeriesLike,
        xs: ManyNumbers | ManySeriesLike | None = None,
        *,
        free: Mapping[str, Any],
        us: Any = None,
        n_nodes: int | None = None,
        n_starts: int = 1,
        rng: np.random.Generator | None = None,
        max_iter: int = 500,
        tolerance: float = 1e-7,
        progress: bool | None = None,
    ) -> LikelihoodFit[SwitchingStateSpace]:
        """Learn noise, offsets, law and other parameters from observations, by maximum likelihood.

        The search starts from this model, which does not change.  Parameters that are not free are fixed.

        Parameters
        ----------
        zs : array_like, DataFrame, list or mapping
            A series of observations (n, q), or several of any lengths; NaN where missing.
        xs : array_like, list or mapping, optional
            Measured states (n, m), for the same series; NaN where not measured.  They count as
            observations without noise.
        free : mapping of str to object
            Parameters to learn.  For ``Q``, ``R`` and ``P0``: "full" (all entries), "diagonal" (variances),
            ("scale", M) (a multiple of the covariance M), or a boolean mask of entries.  For ``F``, ``H``,
            ``b``, ``d``, ``x0`` and ``B``: "full" or a boolean mask.  A parameter with one value per class
            is learned per class, a shared one stays shared; a mask of a single class applies to all.
            ``"law": True`` frees the parameters of the law, or all nonzero probabilities of a matrix or
            chain, including the initial ones unless they are stationary; they then stay stationary.
        us : optional
            Controls, as in `SwitchingKalmanFilter.filter`; for several series, a list or a mapping.
        n_nodes : int, optional
            Number of nodes between the classes; by default 5, or as many as the law admits.
        n_starts : int
            Number of searches.  The first starts at this model, the others at random points around it.
        rng : numpy.random.Generator, optional
            Needed if ``n_starts`` is above 1.
        max_iter : int
            Largest number of iterations of a search.
        tolerance : float
            Gain in log-likelihood at which a search stops.
        progress : bool, optional
            Whether to show a progress bar.  By default it appears after two seconds in a terminal or
            notebook.

        Returns
        -------
        LikelihoodFit
            With estimates, standard errors, intervals, other maxima, ``summary()``, and ``model``, a new
            model
            with the estimated parameters.  ``occupancy`` is the filtered share of the steps in each class.
            ``warnings`` name what the data do not identify.

        Raises
        ------
        ShapeError, ParameterError, NotPositiveDefiniteError
            If shapes do not agree; if ``free`` is inadmissible: a parameter is a function of the class
            weights,
            or a free variance is zero at the start; if nothing is observed, or the observations have no
            density under this model.

        Notes
        -----
        The likelihood is that of IMM on the nodes.  It is an approximation, better if the noise switches than
        if offsets or gains do, and exact for one class or if the whole state is measured at every step.  Its
        gradient is exact.

        Noise levels, offsets and laws can be learned if the matrices are known.  Unknown gains ``H`` have
        several maxima, also with wrong signs; the scale of a state that is never measured cannot be
        distinguished from that of H and Q.

        Examples
        --------
        A sensor whose noise fades from 0.3 to 3 and back; the search starts at 0.6 and 1.5:

        >>> import numpy as np
        >>> from fuzzykf import FadeLaw, SwitchingStateSpace
        >>> def model(low, high):
        ...     R = np.array([low, high])[:, None, None] ** 2
        ...     return SwitchingStateSpace(
        ...         FadeLaw.between(60, 20),
        ...         F=0.95,
        ...         H=1.0,
        ...         Q=0.09,
        ...         R=R,
        ...         x0=[0.0],
        ...         P0=0.92,
        ...         mix="log",
        ...     )
        >>> ys = model(0.3, 3.0).simulate(300, np.random.default_rng(0)).y
        >>> fit = model(0.6, 1.5).fit(ys, free={"R": "full"}, n_nodes=2)
        >>> {name: round(value**0.5, 1) for name, value in fit.estimates.items()}
        {'R[0][0, 0]': 0.3, 'R[1][0, 0]': 2.9}
        """
        from fuzzykf.switching.learning.state_space.fit import fit_state_space

        options: dict[str, Any] = {"n_starts": n_starts, "rng": rng, "max_iter": max_iter}
        options["tolerance"] = tolerance
        return fit_state_space(self, zs, xs, free=free, us=us, n_nodes=n_nodes, progress=progress, **options)

    # ------------------------------------------------------------------ the way to a filter

    def placed(  # type: ignore[override]
        self, n_nodes: int | None = None, rule: str = "cell"
    ) -> SpaceSystem:
        """Place the model on the nodes of the discretised law.

        Parameters
        ----------
        n_nodes : int, optional
            Number of nodes within each fade or edge; by default 5, or as many as the law admits.  Ignored for
            a chain.
        rule : {"cell", "midpoint", "gauss", "product"}
            Quadrature rule, see `FuzzyMarkovLaw.discretize`; it must give positive probabilities.

        Returns
        -------
        SwitchingSystem
            The argument of `fuzzykf.switching.SwitchingFilter`.
        """
        if isinstance(self.law, SwitchChain):  # what makes no sense is refused all the same
            as_choice("rule", rule, RULES)
            as_count("n_nodes", 0 if n_nodes is None else n_nodes)
        return self.form.placed(self._chain(n_nodes, rule))

    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Return the filter of the model, with the method "imm".

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        SwitchingKalmanFilter
        """
        return FILTERS["SwitchingKalmanFilter"](self, n_nodes=self._nodes(n_nodes), rule=rule)

    def to_exact(self, order: int, n_nodes: int = 5) -> Any:
        """Approximate the model, on the nodes of the switch, by one with an exact filter.

        Given two consecutive nodes, mean and covariance of the new state, the new observation and the
        ``order`` observations before are those of this model; older observations are ignored.  The next
        observation then depends on the latest ones, not on the state.

        Parameters
        ----------
        order : int
            Number of past observations in the equations, from 1 to 64.  A larger order is more accurate.
        n_nodes : int
            Number of nodes within each fade or edge; ignored for a chain.

        Returns
        -------
        CGOMSModel
            Model for `CGOMSMFilter`, whose regimes are the nodes.  `CGOMSModel.closeness` compares it with
            the optimal filter.

        Raises
        ------
        ParameterError
            If ``order`` or ``n_nodes`` is inadmissible, or the model has controls.
        NotStableError, NotPositiveDefiniteError
            If the initial state is to be stationary but no stationary state exists, moments diverge, or the
            covariance of an observation is singular.

        Warns
        -----
        ClosenessWarning
            If the closeness is above 1.25.

        Notes
        -----
        The purpose is an exact likelihood, with filter, smoother and forecasts.  The filter is not more
        accurate than `SwitchingKalmanFilter` on data of this model; in tracking at order 5, its squared
        error is 10 to 80 per cent larger.

        Its smoother uses later observations for the switch only: given the nodes and the observations up to
        n, the state at n is independent of later observations.  `SwitchingKalmanFilter.smooth` uses them for
        the state as well.

        With one node, and an order of at least the length of the series, it is the Kalman filter.

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSMFilter, FadeLaw, SwitchingStateSpace
        >>> model = SwitchingStateSpace(
        ...     FadeLaw.between(60, 20), F=0.9, b=[0.1], Q=0.2, H=[[[1.0]], [[0.3]]], R=0.25
        ... )
        >>> f = CGOMSMFilter(model.to_exact(order=5, n_nodes=2))
        >>> result = f.filter(model.simulate(100, np.random.default_rng(0)).y)
        >>> result.mu.shape, result.class_weights.shape
        ((100, 6), (100, 2))
        """
        form: Any = FORMS["space_on_nodes"]
        form = form.of(self.placed(as_count("n_nodes", n_nodes)), order)
        form.warn_if_far(2)
        chain, made = form.system.chain, MODELS["CGOMSModel"]
        return made._from_form(chain.transition, form, chain.initial)._with_labels(self.labels)

    # ------------------------------------------------------------------ values

    def to_dict(self) -> dict[str, Any]:
        """Return law, parameters and labels as plain values.

        Returns
        -------
        dict

        Raises
        ------
        ParameterError
            If a parameter is a function, which a file cannot hold.
        """
        initial = None if self.initial is None else self.initial.tolist()
        law = _chain_to_dict(self.law) if isinstance(self.law, SwitchChain) else part_to_dict(self.law)
        return {"law": law, "initial": initial} | self.form.to_dict() | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create a model from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        SwitchingStateSpace
        """
        law = dict(values["law"])
        is_chain = law["kind"] == _NODES
        made = SwitchChain(**{k: law[k] for k in _CHAIN}) if is_chain else part_from_dict(law, LAWS)
        names = ("F", "H", "Q", "R", "initial", "b", "d", "B", "x0", "P0", "mix")
        return cls(made, **{name: values[name] for name in names})._labelled_from(values)

    @shown
    def __repr__(self) -> str:
        law = f"<{self.n_classes} regimes>" if isinstance(self.law, SwitchChain) else repr(self.law)
        return f"{type(self).__name__}({law}, dim_x={self.dim_x}, dim_z={self.dim_z}{self._labels_text()})"


#: In files, the kind of a chain that is no law.
_NODES = "nodes"

#: The arguments of a chain, which a file keeps.
_CHAIN = ("nodes", "weights", "initial", "transition", "class_weights")


def _chain_to_dict(chain: SwitchChain) -> dict[str, Any]:
    return {"kind": _NODES} | {name: getattr(chain, name).tolist() for name in _CHAIN}


def _as_law(law: Any, initial: ArrayLike | None) -> Law | SwitchChain:
    """Return a law, or a chain in which a value of the switch has one set of class weights."""
    if isinstance(law, Law):
        return law
    if not isinstance(law, SwitchChain):
        if hasattr(law, "discretize") or isinstance(law, str):
            raise ParameterError(
                f"law: got {brief(law)}, expected a law, a SwitchChain or transition probabilities (K, K)"
            )
        try:
            return SwitchChain.from_classes(law, initial)
        except ParameterError as error:
            message = str(error)
            if not message.startswith("transition"):
                raise
            raise type(error)(f"law{message.removeprefix('transition')}") from None
    for a, b in np.argwhere(np.triu(np.abs(law.keys[:, None] - law.keys) <= SAME_VALUE, 1)):
        if np.abs(law.class_weights[a] - law.class_weights[b]).max() > SAME_VALUE:
            raise ParameterError(
                f"law: the nodes {a} and {b} have the value {law.describe(int(a))}, but not one set of class "
                "weights; expected another value for each"
            )
    return law


def chain_on_nodes(
    law: Law | SwitchChain, initial: FloatArray | None, n_nodes: int, rule: str = "cell"
) -> SwitchChain:
    """Return the switch on nodes, beginning with probabilities of its classes (K,) where they are given.

    Parameters
    ----------
    law : Law or SwitchChain
        A chain has its own nodes.
    initial : ndarray, shape (K,), or None
    n_nodes : int
    rule : str
    """
    chain = law if isinstance(law, SwitchChain) else law.discretize(n_nodes, rule)
    if chain.is_signed:
        got = "law: got a chain" if chain is law else f"rule: got {rule!r}"
        raise ParameterError(
            f"{got}, by which some transition probabilities are negative; expected "
            f"{'others' if chain is law else repr('cell')}"
        )
    if initial is None:
        return chain
    start = np.zeros(len(chain))
    for k in np.flatnonzero(initial):
        nodes = np.flatnonzero(chain.atoms & (chain.class_weights.argmax(axis=1) == k))
        if len(nodes) != 1:
            raise ParameterError(
                f"initial: got {initial[k]:.6g} for class {k}, of which the law has {len(nodes)} nodes, "
                "expected one (give a SwitchChain that begins as it should)"
            )
        start[nodes[0]] = initial[k]
    return SwitchChain(chain.nodes, chain.weights, start, chain.transition, chain.class_weights)


def matrices_of(filters: Sequence[Any]) -> dict[str, Any]:
    """Return the parameters of Kalman filters for each class, and x and P moved to the first observation.

    Parameters
    ----------
    filters : sequence of KalmanFilter
        Of fuzzykf or of filterpy.

    Returns
    -------
    dict
        F, H, Q, R, B, x0 and P0, each with a leading axis for the filters; B is None where no filter has one.
    """
    given: Any = filters
    if not isinstance(given, list | tuple) or len(given) < 2:
        raise ParameterError(f"filters: got {brief(filters)}, expected a list of two or more Kalman filters")
    found: dict[str, list[Any]] = {name: [] for name in ("F", "H", "Q", "R", "B", "x", "P")}
    for k, f in enumerate(given):
        for name in found:
            value = getattr(f, name, None)
            if (value is None and name != "B") or callable(value):
                raise ParameterError(
                    f"filters[{k}]: got a {type(f).__name__} without a matrix {name}, expected a KalmanFilter"
                )
            found[name].append(value)
        if not _has_plain_verbs(f):
            raise ParameterError(
                f"filters[{k}]: got a {type(f).__name__} with a predict or update of its own, expected a "
                "plain KalmanFilter: a model has its matrices alone (IMMEstimator does what it does)"
            )
        if getattr(f, "_alpha_sq", 1.0) != 1.0:
            raise ParameterError(
                f"filters[{k}]: got alpha={f._alpha_sq**0.5:.6g}, expected 1: a model has no fading memory"
            )
    m, q = (int(np.size(given[0].x)), int(np.shape(np.atleast_2d(given[0].H))[0]))
    stacked: dict[str, Any] = {
        "F": _stack("F", found["F"], (m, m)),
        "H": _stack("H", found["H"], (q, m)),
        "Q": _stack("Q", found["Q"], (m, m)),
        "R": _stack("R", found["R"], (q, q)),
        "B": None,
    }
    if any(B is not None for B in found["B"]):
        width = next(np.shape(np.atleast_2d(B))[1] for B in found["B"] if B is not None)
        given_B = [np.zeros((m, width)) if B is None else B for B in found["B"]]
        stacked["B"] = _stack("B", given_B, (m, width))
    F = stacked["F"]
    x, P = _stack("x", [np.ravel(x) for x in found["x"]], (m,)), _stack("P", found["P"], (m, m))
    P = np.array([check_covariance(f"filters[{k}].P", one, (m, m)) for k, one in enumerate(P)])
    moved = F @ P @ np.swapaxes(F, -1, -2) + stacked["Q"]
    return stacked | {"x0": (F @ x[..., None])[..., 0], "P0": 0.5 * (moved + np.swapaxes(moved, -1, -2))}


def _has_plain_verbs(f: Any) -> bool:
    """Whether a filter predicts and updates as those of fuzzykf or filterpy do."""
    if is_patched(f):
        return False
    homes = (next((c.__module__ for c in type(f).__mro__ if name in vars(c)), "") for name in VERBS)
    return all(home.split(".")[0] in ("fuzzykf", "filterpy", "") for home in homes)


def _stack(name: str, values: Sequence[Any], shape: tuple[int, ...]) -> FloatArray:
    """Return matrices of filters with a leading axis; a number is a matrix of one row and column."""
    rows = []
    for k, value in enumerate(values):
        array = as_numbers(f"filters[{k}].{name}", value)
        if array.shape in ((), (1,)) and set(shape) == {1}:
            array = array.reshape(shape)
        if array.shape != shape:
            rest = (
                ", as the first (IMMEstimator takes filters of unequal states, with state_maps)" if k else ""
            )
            raise ShapeError(f"filters[{k}].{name}: got shape {array.shape}, expected {shape}{rest}")
        rows.append(as_array(f"filters[{k}].{name}", array, shape))
    return np.array(rows)
