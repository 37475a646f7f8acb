"""The fuzzy model of the 2020 paper: a Gaussian system whose switch moves on [0, 1].

Models are immutable values, and valid: what is wrong with parameters is said when
the model is built.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_choice, as_numbers, check_covariance
from fuzzykf.io import FILTERS, part_from_dict, part_to_dict
from fuzzykf.reprs import shown
from fuzzykf.switching.dynamics.forms import (
    CovarianceForm,
    GaussianForm,
    RegressionForm,
    TransitionForm,
)
from fuzzykf.switching.dynamics.registry import FORMS
from fuzzykf.switching.laws.chain import shares_of, value_of
from fuzzykf.switching.laws.chains import as_law
from fuzzykf.switching.laws.registry import LAWS
from fuzzykf.switching.models.base import NODES, SwitchingModel
from fuzzykf.switching.models.hard import CGOMSModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import FitResult
    from fuzzykf.switching.dynamics.features import WindowFeatures
    from fuzzykf.switching.dynamics.placed import StationarySystem
    from fuzzykf.switching.laws.base import Law
    from fuzzykf.switching.laws.chain import SwitchChain

__all__ = ["CGOFMSModel"]

#: The noise of a fuzzy model is proved at the hard values and at so many values between.
N_PROOF = 16


class CGOFMSModel(SwitchingModel):
    """Conditionally Gaussian observed fuzzy Markov switching model.

    The switch R moves between regimes, abruptly or gradually: on [0, 1] for two regimes, on the edges of
    a graph for more.  Given the switch, (X, Y) is a Gaussian Markov chain and Y alone is Markov, so that X
    can be filtered exactly.

    Parameters
    ----------
    law : FuzzyMarkovLaw, FadeLaw, or another law of K classes
        Law of the switch.
    means : array_like, shape (K, d)
        Mean of Z = (X, Y) in each regime, d = dim_x + dim_z; linear in between.
    covariances : array_like, shape (K, K, 2d, 2d)
        Covariance of (Z_n, Z_n+1) for each pair of regimes; rows X1, Y1, X2, Y2.
    dim_x : int
        Number m of components of the state; the others are observed.
    interpolation : {"covariance", "transition"}
        Quantity that is bilinear between the regimes: the covariances, or the transition matrix
        and the symmetric square root of the noise covariance.
    constraint : {"project", "check"}
        The blocks Cov(Y2, X1) are determined by the others: "project" sets them, "check" raises an error
        if they are wrong.

    Raises
    ------
    ShapeError, ParameterError, NotPositiveDefiniteError
        If shapes, symmetry or the shared blocks are wrong, or if the noise covariance of
        a pair of values of the switch is indefinite; the message names the pair and the eigenvalue.  The
        constructor checks the hard values and a grid of values in between; a filter checks its nodes.

    References
    ----------
    Bouyahia, Derrode, Pieczynski (2020), sections III and V, with the corrections of
    the theory pages.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FadeLaw
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])  # covariance of (X, Y), in both regimes
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FadeLaw.between(dwell=40, length=10),
    ...     means=[[0.0, 3.0], [0.0, 0.0]],
    ...     covariances=np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> model.dim_x, model.dim_z
    (1, 1)
    >>> model.simulate(100, np.random.default_rng(0)).x.shape
    (100, 1)
    """

    is_fuzzy = True
    form: GaussianForm

    def __init__(
        self,
        law: Law,
        means: ArrayLike,
        covariances: ArrayLike,
        dim_x: int,
        *,
        interpolation: Literal["covariance", "transition"] = "covariance",
        constraint: Literal["project", "check"] = "project",
    ) -> None:
        as_choice("interpolation", interpolation, ("covariance", "transition"))
        form = CovarianceForm(means, covariances, dim_x, constraint)
        self._build(law, form if interpolation == "covariance" else _transition_form(form))

    @classmethod
    def from_regressions(
        cls,
        law: Law,
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
        """Create a model from regression coefficients for each pair of regimes.

        For each pair (i, j) of hard values of (r_n, r_n+1), and bilinear in between::

            Y' = Ayy Y + Ny + N(0, Qyy)
            X' = Axx X + H Y + G Y' + c + N(0, C)

        No stationarity is assumed, and all covariances are positive definite by construction.  Models are
        learned in this form.

        Parameters
        ----------
        law : FuzzyMarkovLaw, FadeLaw, or another law of K classes
        Ayy, Ny, Qyy : array_like, shapes (K, K, q, q), (K, K, q), (K, K, q, q)
        Axx, H, G, c, C : array_like, shapes (K, K, m, m), (K, K, m, q), (K, K, m, q), \
(K, K, m), (K, K, m, m)
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Law of the first (X, Y) in each regime.

        Returns
        -------
        CGOFMSModel
        """
        form = RegressionForm(
            Ayy=Ayy, Ny=Ny, Qyy=Qyy, Axx=Axx, H=H, G=G, c=c, C=C, means=means, covariances=covariances
        )
        return cls._from_form(law, form)

    @classmethod
    def _from_form(cls, law: Law, form: GaussianForm) -> Self:
        model = cls.__new__(cls)
        model._build(law, form)
        return model

    def _build(self, law: Law, form: GaussianForm) -> None:
        law = as_law(law)
        if law.n_classes != form.n_classes:
            raise ParameterError(
                f"means: got those of {form.n_classes} regimes, expected {law.n_classes}, "
                "as many as the law has"
            )
        self.law, self.form = law, form
        self._prove_noise()

    @classmethod
    def fit(
        cls,
        x: ArrayLike | Sequence[ArrayLike],
        y: ArrayLike | Sequence[ArrayLike],
        r: ArrayLike | Sequence[ArrayLike] | None = None,
        *,
        law: str | Law | SwitchChain = "fmc1",
        form: Literal["auto", "regression", "covariance"] = "auto",
        n_nodes: int | None = None,
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
    ) -> FitResult[CGOFMSModel]:
        """Learn a model from measured states and observations.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.  A row without ``y``
            splits the series.  Rows in which ``x`` is missing, wholly or partly, are used as well (see
            Notes).  Several series are passed as lists.  The model stores column names and time step of
            pandas tables (``labels``).
        r : array_like, shape (n,) or (n, K), or list of these, optional
            Values of the switch in [0, 1]; for more than two classes, class weights or numbers of
            classes (n,).  Omit it if the switch is hidden: it is then learned, too.
        law : {"fmc1", "fmc2", "free", "fade", "graph"}, or a law
            Family of the law for two classes; "free" is any Markov chain on the nodes.  Or a law of any
            number of classes: its structure (fades, jumps, edges, turning back) is kept, and its
            parameters are the start of the search if the switch is hidden.  A `SwitchChain` means any chain
            with the same nonzero transitions.
        form : {"auto", "regression", "covariance"}
            Form of the Gaussian part.  "regression" does not assume stationarity.
            "covariance" is that of the paper, with fewer parameters, for one state and one
            observation; it uses only rows in which both are measured.  "auto" learns both if possible and
            keeps the one with the smaller BIC; it does not try "covariance" if an x is missing, and rejects
            it if its estimate lies on the bound of positive definiteness.
        n_nodes : int, optional
            Number of nodes between two classes (of each fade or edge) for a hidden switch.  The cost of an
            iteration is proportional to the number of possible transitions between nodes.  By default 5, or
            as many as the fades of the law have room for.  A learned fade is not shorter than its nodes.
        n_starts : int
            Number of initial guesses of a hidden switch; the best are iterated to convergence.
            Beyond 4, they are drawn at random.
        max_iter : int
            Largest number of iterations.
        tolerance : float
            Stop when an iteration gains less than this in log-likelihood per observation.
        rng : numpy.random.Generator, optional
            Needed if ``n_starts`` is above 4.
        state_feedback : bool
            Whether the state may depend on the previous state.  If not, ``Axx`` is zero: given the switch,
            the state depends on the latest two observations only, its filtered distribution is an exact
            mixture rather than matched in mean and covariance, and the filter cannot drift.  Without
            feedback the filter is often more accurate, because a model learned from measured states relies
            on the previous state, which a filter does not know.  Feedback needs two consecutive rows of x,
            no feedback only one.
        objective : {"joint", "filter"}
            Objective to maximise.  "joint": the likelihood of (x, y).  "filter": the log-density of the
            measured states under the filter, starting from the joint fit.  The last fifth of the states
            is used for validation: it determines the number of iterations and how much the state noise is
            widened.  The joint fit is kept unless the gain is larger than its standard error and the
            training states score better, too; see ``training`` of the result.  "filter" needs a hidden
            switch and the regression form.
        order : int
            Number of lagged observations in the equations; short for
            ``features=WindowFeatures(order=...)``.
        inputs : array_like, shape (n, k) or (n,), or list of these, optional
            Known variables: clock, calendar, controls.  They act linearly on the new observation and the new
            state, for each pair of regimes, and on the log-odds of the transitions (the latter not if ``r``
            of a fuzzy switch is given).  Pass them to the filter as ``us``.
        features : WindowFeatures or "auto", optional
            Features of the latest observations.  "auto" tries several and keeps those with the best score on
            validation rows (``score_of_features`` of the result); it needs ``objective="filter"``, because
            the joint likelihood grows with every feature.
        progress : bool, optional
            Whether to show a progress bar (needs rich).  By default one appears after two seconds if
            standard error is a terminal, or in a notebook.

        Returns
        -------
        FitResult
            With ``model``, ``log_likelihood``, ``trace``, ``warnings`` and ``summary()``.

        Raises
        ------
        ParameterError
            If ``x`` is missing or has too few values (the state equation cannot be identified from y alone);
            if an argument is inadmissible; if series differ in names or time step.

        Notes
        -----
        With ``r``, parameters maximise the complete-data likelihood.  Without, they are found by
        expectation-maximisation on the nodes, where the likelihood is exact.  Data are standardised
        internally.  A larger likelihood does not imply a smaller filter error: compare models on held-out
        data.

        If ``x`` is measured in some rows only, the likelihood of a step is p(y' | y), times p(x' | x, y, y')
        if x' is measured and, with ``state_feedback``, x is measured as well.  ``log_likelihood`` is the
        product of these factors: with feedback, the first x after a gap is given.  Whether x is missing may
        depend on y, but not on x.

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

        return fit_fuzzy_model(
            x,
            y,
            r,
            law=law,
            form=form,
            n_nodes=n_nodes,
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

    def _prove_noise(self) -> None:
        u, possible, there = self.law.reach(N_PROOF)

        def describe(index: tuple[int, ...]) -> str:
            before, after = (value_of(u[k]) for k in index)
            return f"pair r_n = {before}, r_n+1 = {after}"

        self.form.pairs(u[:, None], u[None, :], describe, possible)
        self.form.marginal(u[there])

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the class weights (..., K) of values of the switch.

        Parameters
        ----------
        r : array_like
            For two regimes: numbers in [0, 1], of any shape.  For more: class weights (..., K), or regimes
            0, ..., K - 1 as a number or a flat array.

        Returns
        -------
        ndarray, shape (..., K)
        """
        value = as_numbers("r", r)
        if self.n_classes > 2:
            return shares_of(value, self.n_classes)
        if not ((value >= 0.0) & (value <= 1.0)).all():
            raise ParameterError(f"r: got values from {value.min()} to {value.max()}, expected [0, 1]")
        return np.stack([1.0 - value, value], axis=-1)

    @property
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime."""
        return self.law.p_hard

    def describe_switch(self) -> str:
        """Describe the switch in words.

        Returns
        -------
        str
        """
        return f"fuzzy switch, law {self.law.kind}"

    def named_parameters(self) -> dict[str, float]:
        """Return the parameters of the law, and the resulting share of hard values.

        Returns
        -------
        dict of str to float
        """
        return self.law.numbers() | {"p_hard": float(self.p_hard)}

    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> StationarySystem:
        """Place the model on the nodes of the discretised law.

        Parameters
        ----------
        n_nodes : int, optional
            Number of nodes strictly between two classes.  By default 5, or as many as fades have room for,
            or those on which a free law was learned.
        rule : {"cell", "midpoint", "gauss", "product"}
            Quadrature rule, see `FuzzyMarkovLaw.discretize`.

        Returns
        -------
        SwitchingSystem
            The argument of `fuzzykf.switching.SwitchingFilter`.
        """
        return self.form.placed(self.law.discretize(self._nodes(n_nodes), rule))

    def _nodes(self, n_nodes: int | None) -> int:
        return self.law.nodes_up_to(NODES) if n_nodes is None else n_nodes

    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Return the exact filter of the model.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        OFSRFilter
        """
        return FILTERS["OFSRFilter"](self, self._nodes(n_nodes), rule)

    def harden(self, n_nodes: int | None = None) -> CGOMSModel:
        """Return the corresponding model with hard regimes.

        The law of the switch is integrated over the four quadrants; the Gaussian part of the hard
        pairs does not change.

        Parameters
        ----------
        n_nodes : int, optional
            Harden the chain on this many nodes instead; see `FuzzyMarkovLaw.harden`.

        Returns
        -------
        CGOMSModel
        """
        joint = self.law.harden(n_nodes)
        initial = joint.sum(axis=1)
        rows = np.where(initial[:, None] > 0.0, joint, initial)  # what follows a regime that never is
        transition = rows / rows.sum(axis=1, keepdims=True)
        hard = CGOMSModel._from_form(transition, self.form, initial / initial.sum())
        return hard._with_labels(self.labels)

    def _sample_switch(self, n: int, rng: np.random.Generator, n_nodes: int | None) -> FloatArray:
        return self.law.sample(n, rng, n_nodes)

    def to_dict(self) -> dict[str, Any]:
        """Return law, parameters and labels as plain values.

        Returns
        -------
        dict
        """
        parts = {"law": part_to_dict(self.law), "form": part_to_dict(self.form)}
        return parts | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create a model from the output of `to_dict`.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        CGOFMSModel
        """
        form = part_from_dict(values["form"], FORMS)
        return cls._from_form(part_from_dict(values["law"], LAWS), form)._labelled_from(values)

    @shown
    def __repr__(self) -> str:
        sizes = f"dim_x={self.dim_x}, dim_z={self.dim_z}"
        return f"CGOFMSModel({self.law!r}, {sizes}, form={self.form.kind!r}{self._labels_text()})"


def _transition_form(form: CovarianceForm) -> TransitionForm:
    """Compute A and Q at the hard pairs; in between these are interpolated, not the covariances."""
    u = np.eye(form.n_classes)
    A, Q = form.transition(u[:, None], u[None, :])
    check_covariance("covariances (noise of the hard pairs)", Q, Q.shape)
    return TransitionForm(A, Q, form.means, form.stationary, form.dim_x)
