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

    A switch R moves between regimes, abruptly or gradually: on [0, 1] between two, on the edges of
    a graph between more.  Given the switch, (X, Y) is a Gaussian Markov chain in which Y alone is
    Markov too, so that X can be filtered exactly.

    Parameters
    ----------
    law : FuzzyMarkovLaw, FadeLaw, or another law of K classes
        Law of the switch.
    means : array_like, shape (K, d)
        Mean of Z = (X, Y) in each regime, d = dim_x + dim_z; linear in between.
    covariances : array_like, shape (K, K, 2d, 2d)
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
        """Make a model from the regressions of each pair of regimes.

        Per pair (i, j) of hard values of (r_n, r_n+1), and bilinear in between::

            Y' = Ayy Y + Ny + N(0, Qyy)
            X' = Axx X + H Y + G Y' + c + N(0, C)

        Nothing is assumed stationary, and positive definiteness holds everywhere by
        construction.  It is the form to learn in.

        Parameters
        ----------
        law : FuzzyMarkovLaw, FadeLaw, or another law of K classes
        Ayy, Ny, Qyy : array_like, shapes (K, K, q, q), (K, K, q), (K, K, q, q)
        Axx, H, G, c, C : array_like, shapes (K, K, m, m), (K, K, m, q), (K, K, m, q), \
(K, K, m), (K, K, m, m)
        means, covariances : array_like, shapes (K, d) and (K, d, d)
            Law of the first (X, Y) in each regime.
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
        """Learn a model from data in which the state was measured as well.

        Parameters
        ----------
        x, y : array_like, or list of these
            States (n, m) and observations (n, q), or (n,); NaN where missing.  A row in which ``y`` is
            missing ends a stretch.  Rows without ``x``, or with some components of it, are learned from too
            (see Notes).  Several series are given as lists.  The model remembers the names of tables of
            pandas, and how far their rows are apart (`labels`).
        r : array_like, shape (n,) or (n, K), or list of these, optional
            Values of the switch in [0, 1]; between more than two classes their weights, or numbers of
            classes (n,).  If it is hidden, it is learned too.
        law : {"fmc1", "fmc2", "free", "fade", "graph"}, or a law
            Family of the law of a switch between two classes; "free" is any Markov chain on the nodes.
            Or a law of any number of classes, whose structure is kept (which fades, jumps or edges there
            are, and whether fades turn back) and whose numbers are where a search for a hidden switch
            begins; a `SwitchChain`, any chain with the same arrows.
        form : {"auto", "regression", "covariance"}
            Form of the Gaussian part.  "regression" assumes nothing stationary;
            "covariance" is that of the paper, with fewer parameters, for one state and one
            observation.  "auto" learns in both, where both can be, and takes the one of
            smaller BIC; a covariance form that positive definiteness bounds is not taken.  "covariance" is
            learned from the rows in which x and y are measured, without the others, and "auto" does not
            try it where an x is missing.
        n_nodes : int, optional
            Nodes between two classes (of each fade, or edge) on which a hidden switch is learned; the cost of
            an iteration grows as the square of all nodes, or as the number of steps between them that are
            possible.  By default 5, or as many as fades of the law have room for.  No fade is learned to be
            shorter than its nodes.
        n_starts : int
            Guesses of a hidden switch to begin from; the best ones go on to convergence.
            More than 4 are drawn at random.
        max_iter : int
            Largest number of iterations.
        tolerance : float
            Gain in log-likelihood per observation and iteration at which to stop.
        rng : numpy.random.Generator, optional
            For more than 4 starts.
        state_feedback : bool
            Whether the state may depend on the one before it.  Without, ``Axx`` is zero: given the switch
            the state depends on the latest two observations alone, the law of it that the filter finds is
            exact and not matched in mean and covariance, and the filter cannot drift.  A state that is
            learned from measurements of itself tends to lean on the one before, which the filter does not
            see: on data without a memory of their own beyond that of the observations this filters better.
            It is learned from single rows of x; a state that depends on the one before needs two in a row.
        objective : {"joint", "filter"}
            What is raised.  "joint": the likelihood of (x, y).  "filter": the log-density that the filter
            gives the states that were measured, from the joint fit on; the last fifth of them is kept back,
            and decides for how long, by how much the noise of the state is widened, and whether the joint
            fit stays, as it does unless the difference is larger than its standard error and the states
            that were learned from score better, too: see ``.training`` of the result.  For a hidden switch,
            in the regression form.
        order : int
            How many observations before a step have coefficients of their own: short for
            ``features=WindowFeatures(order=...)``.
        inputs : array_like, shape (n, k) or (n,), or list of these, optional
            What is known at all times: clock, calendar, control.  Inputs act linearly on the new observation
            and the new state, in each pair of regimes, and on the log-odds of transitions (not where ``r`` is
            given for a fuzzy switch).  The filter is told them as ``us``.
        features : WindowFeatures or "auto", optional
            A map of the latest observations, see `WindowFeatures`.  "auto" learns with each of a few maps and
            takes the one whose filter scores best on the states kept back (``.score_of_features`` of the
            result); it needs ``objective="filter"``, as the joint likelihood rises with every feature.
        progress : bool, optional
            Whether to show a progress bar (needs rich).  By default one appears after two seconds if
            standard error is a terminal, or in a notebook.

        Returns
        -------
        FitResult
            With ``.model``, ``.log_likelihood``, ``.trace``, ``.warnings``, ...

        Raises
        ------
        ParameterError
            If ``x`` is missing (the parameters of the state are not identifiable from y
            alone) or measured too seldom, or a parameter or the data are inadmissible; if several series
            have other names, or steps of other lengths.

        Notes
        -----
        With ``r``: complete-data maximum likelihood on all transitions, hard and fuzzy.
        Without: expectation-maximisation on the nodes, where (R, Z) is a hidden Markov
        chain and the likelihood is exact.  Data are standardised inside.  A larger
        likelihood need not mean a smaller filter error: compare models on held-out data.

        Where ``x`` is measured in some rows only, a step is p(y' | y) of the pair of classes, times
        p(x' | x, y, y') where x' is measured and, with ``state_feedback``, x is as well.  So all rows of y
        tell of the switch and the observation.  ``log_likelihood`` is that of y and of each x with such a
        factor, the first x after a gap being given; without ``state_feedback`` it is that of all that was
        measured.  Which rows have a state may depend on y, but not on x.

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
        """Return the shares of the regimes in values of the switch: (..., K).

        Parameters
        ----------
        r : array_like
            Numbers in [0, 1] between two regimes, of any shape.  Between more, class weights (..., K), or
            a number or a flat array of regimes 0, ..., K - 1.
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
        """Say in words how the switch moves."""
        return f"fuzzy switch, law {self.law.kind}"

    def named_parameters(self) -> dict[str, float]:
        """Return the numbers that make the law, and the share of hard values that follows from them."""
        return self.law.numbers() | {"p_hard": float(self.p_hard)}

    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> StationarySystem:
        """Place the model on the nodes of the discretised law.

        Parameters
        ----------
        n_nodes : int, optional
            Nodes strictly between two classes.  By default 5, or as many as fades have room for, or those
            on which a free law was learned.
        rule : {"cell", "midpoint", "gauss", "product"}
            See `FuzzyMarkovLaw.discretize`.
        """
        return self.form.placed(self.law.discretize(self._nodes(n_nodes), rule))

    def _nodes(self, n_nodes: int | None) -> int:
        return self.law.nodes_up_to(NODES) if n_nodes is None else n_nodes

    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Make the filter of the model.

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
        """Return the model of abrupt switches that is nearest in law.

        The law is integrated over the four quadrants; the Gaussian part of the hard
        pairs stays as it is.

        Parameters
        ----------
        n_nodes : int, optional
            Harden the chain on so many nodes instead; see `law.harden`.
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
        """Return law, Gaussian form and labels as plain values."""
        parts = {"law": part_to_dict(self.law), "form": part_to_dict(self.form)}
        return parts | self._labels_to_dict()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a model from what `to_dict` returned."""
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
