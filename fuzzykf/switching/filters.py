"""The filters of the switching models, as users meet them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.base import FilterResult, as_observations
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.switching.chain import SwitchChain
from fuzzykf.switching.filter_base import MISSING, SwitchingFilter
from fuzzykf.switching.fuzzy_model import CGOFMSModel
from fuzzykf.switching.hard_model import CGOMSModel
from fuzzykf.switching.systems import known_pair
from fuzzykf.switching.tables import InitialLaw

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike

    from numpy.typing import ArrayLike

    from fuzzykf.base import FloatArray
    from fuzzykf.switching.tables import PairTables

__all__ = ["CGOMSMFilter", "KnownSwitchFilter", "OFSRFilter"]


class _SavedFilter(SwitchingFilter):
    """A filter that knows its model and can be written to a file."""

    model: CGOFMSModel | CGOMSModel

    def _options(self) -> dict[str, Any]:
        """Arguments of the constructor beside the model."""
        return {}

    def save(self, path: str | PathLike[str]) -> None:
        """Write model and state to a JSON file, atomically; `load` resumes bit for bit.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        ParameterError
            If the model holds functions (a law made by `FuzzyMarkovLaw.from_density`).
        """
        from fuzzykf.io import save_filter

        save_filter(self, path)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a filter that `save` has written, in the state it was in.

        Raises
        ------
        FileFormatError
            If the file is damaged, foreign, of another version, or holds another filter.
        """
        from fuzzykf.io import load_filter

        return load_filter(path, cls)


class OFSRFilter(_SavedFilter):
    """Optimal fuzzy switching recursive filter (2020 paper, section IV).

    Exact for the Markov chain on ``n_nodes + 2`` nodes that stands for the fuzzy law.

    Parameters
    ----------
    model : CGOFMSModel
    n_nodes : int
        Number F of nodes between the hard values 0 and 1.  The cost of a step grows as
        (F + 2)^2: 49 pairs at F = 5, 144 at F = 10.  The error falls as F^-2 for FMC1 and
        as F^-1 for FMC2; 5 is enough in most cases.
    rule : {"cell", "midpoint", "gauss", "product"}
        How the law is discretised, see `FuzzyMarkovLaw.discretize`.

    See Also
    --------
    fuzzykf.switching.filter_base.SwitchingFilter : Verbs and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> f = OFSRFilter(model, n_nodes=5)
    >>> f.step(2.5).shape, f.mu.shape
    ((1, 1), (7,))
    >>> result = f.filter(model.simulate(50, np.random.default_rng(0)).y)
    >>> result.x.shape, result.switch.shape
    ((50, 1), (50,))
    """

    def __init__(self, model: CGOFMSModel, n_nodes: int = 5, rule: str = "cell") -> None:
        if not isinstance(model, CGOFMSModel):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOFMSModel")
        self.model, self.n_nodes, self.rule = model, n_nodes, rule
        super().__init__(model.on_nodes(n_nodes, rule))

    def _options(self) -> dict[str, Any]:
        return {"n_nodes": int(self.n_nodes), "rule": self.rule}


class CGOMSMFilter(_SavedFilter):
    """Exact recursive filter for K hard regimes.

    Parameters
    ----------
    model : CGOMSModel

    See Also
    --------
    fuzzykf.switching.filter_base.SwitchingFilter : Verbs and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSMFilter, CGOMSModel
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.1, 0.9]], [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1
    ... )
    >>> f = CGOMSMFilter(model)
    >>> f.step(2.5).shape, f.switch
    ((1, 1), 0.0)
    """

    def __init__(self, model: CGOMSModel) -> None:
        if not isinstance(model, CGOMSModel):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOMSModel")
        self.model = model
        super().__init__(model.on_nodes())


class _KnownPath:
    """Stands in for a system whose tables come one by one, with the switch."""

    order: int = 1
    steady_from: int | None = None

    def __init__(self, model: CGOFMSModel | CGOMSModel) -> None:
        self.chain = SwitchChain([0.0], [1.0], [1.0], [[1.0]])
        self.dim_x, self.dim_z = model.dim_x, model.dim_z

    def initial(self) -> InitialLaw:
        raise NotImplementedError  # pragma: no cover - the filter knows better

    def pair_tables(self, n: int) -> PairTables:
        raise NotImplementedError  # pragma: no cover - the filter knows better


class KnownSwitchFilter(SwitchingFilter):
    """Exact filter for a switch that is known: the best that any filter can do.

    Parameters
    ----------
    model : CGOFMSModel or CGOMSModel

    Notes
    -----
    The value of the switch goes with each observation: to `predict`, or to `update`.
    Without it at `predict`, ``x_prior`` and ``P_prior`` are NaN.

    See Also
    --------
    fuzzykf.switching.filter_base.SwitchingFilter : Verbs and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, KnownSwitchFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> truth = model.simulate(50, np.random.default_rng(0))
    >>> KnownSwitchFilter(model).filter(truth.y, truth.r).x.shape
    (50, 1)
    """

    def __init__(self, model: CGOFMSModel | CGOMSModel) -> None:
        if not isinstance(model, (CGOFMSModel, CGOMSModel)):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOFMSModel or CGOMSModel")
        self.model = model
        super().__init__(_KnownPath(model))

    def _start(self) -> None:
        super()._start()
        self._r = np.nan  # value of the switch at the latest observation
        self._r_next: float | None = None  # at the next one, once known
        self._told_at_predict = False

    # ------------------------------------------------------------------ tables

    def _initial_law(self) -> InitialLaw:
        value = self._r if self._r_next is None else self._r_next
        mean, covariance = self.model.form.marginal(self.model.class_weights([value]))
        return InitialLaw(np.ones(1), mean, covariance)

    def _next_tables(self) -> PairTables:
        if self._r_next is None:
            raise ParameterError("r: the value of the switch at the next observation is not known yet")
        u = self.model.class_weights([self._r, self._r_next])
        label = f"known pair r_n = {self._r:.6g}, r_n+1 = {self._r_next:.6g}"
        return known_pair(self.model.form, u[0], u[1], label)

    def _prior_is_known(self) -> bool:
        return self._told_at_predict

    # ------------------------------------------------------------------ verbs

    def predict(self, r: float | None = None) -> None:
        """Move to the time of the next observation.

        Parameters
        ----------
        r : float, optional
            Value of the switch at that time; else it has to come with `update`.

        Raises
        ------
        ParameterError
            If ``r`` is not a value of the switch, or was given before.
        """
        value = None if r is None else self._checked(r)
        super().predict()
        if value is not None:
            self._r_next = value
        self._told_at_predict = self._r_next is not None

    def update(self, z: ArrayLike | None, r: float | None = None) -> None:
        """Take an observation into account.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float, optional
            Value of the switch at its time, unless given to `predict`.

        Raises
        ------
        ParameterError
            If ``r`` was given to `predict` as well, or to neither.
        """
        given = self._r_next
        if r is not None:
            self._r_next = self._checked(r)
        elif given is None:
            raise ParameterError(
                "r: missing; the value of the switch has to be given to predict or to update (use an "
                "OFSRFilter or a CGOMSMFilter if it is not known)"
            )
        try:
            super().update(z)
        except Exception:
            self._r_next = given
            raise
        if not self._before:
            self._told_at_predict = self._told_at_predict and given is not None
        assert self._r_next is not None
        self._r, self._r_next = self._r_next, None

    def step(self, z: ArrayLike | None, r: float | None = None) -> FloatArray:
        """Predict, then update with ``z``, at the value ``r`` of the switch.

        Parameters
        ----------
        z : array_like
            The observation.
        r : float
            Value of the switch at its time.

        Returns
        -------
        ndarray, shape (dim_x, 1)
        """
        if r is None:
            raise ParameterError("r: missing; expected the value of the switch at this observation")
        now = self._n, self._predicted, self._r_next, self._told_at_predict
        self.predict(r)
        try:
            self.update(z)
        except Exception:
            self._n, self._predicted, self._r_next, self._told_at_predict = now
            raise
        return self.x

    def _checked(self, r: float) -> float:
        if self._r_next is not None:
            raise ParameterError(f"r: got {r} after {self._r_next}; the switch is given once per observation")
        value = np.asarray(r, dtype=np.float64)
        if value.size != 1:
            raise ShapeError(f"r: got shape {value.shape}, expected one value of the switch")
        self.model.class_weights(value.reshape(1))
        return float(value.reshape(()))

    def filter(  # type: ignore[override]
        self, zs: Iterable[ArrayLike | None] | ArrayLike, r: ArrayLike
    ) -> FilterResult:
        """Filter a whole series with its switches, from the initial law on.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1.
        r : array_like, shape (n,)
            Values of the switch.

        Returns
        -------
        FilterResult
        """
        ys = as_observations(zs, self.dim_z)
        if np.isnan(ys).any():
            raise NotImplementedError(MISSING.format("filter"))
        switches = np.asarray(r, dtype=np.float64).reshape(-1)
        if switches.shape != (len(ys),):
            raise ShapeError(f"r: got {switches.size} values, expected {len(ys)}, one per observation")
        self.model.class_weights(switches)
        trial = self.copy()
        trial.reset()
        n, m = len(ys), self.dim_x
        x, P, log_likelihood = np.empty((n, m)), np.empty((n, m, m)), np.empty(n)
        x_prior, P_prior = np.empty((n, m)), np.empty((n, m, m))
        for k in range(n):
            x[k] = trial.step(ys[k], float(switches[k]))[:, 0]
            P[k], log_likelihood[k] = trial.P, trial.log_likelihood
            x_prior[k], P_prior[k] = trial.x_prior[:, 0], trial.P_prior
        self.__dict__.update(trial.__dict__)
        return FilterResult(
            x=x,
            P=P,
            x_prior=x_prior,
            P_prior=P_prior,
            switch=switches,
            switch_mean=switches,
            log_likelihood=log_likelihood,
            index=getattr(zs, "index", None) if hasattr(zs, "to_numpy") else None,
        )

    # ------------------------------------------------------------------ what users read

    @property
    def nodes(self) -> FloatArray:
        """The known value of the switch, (1,); NaN before it is known."""
        if self._predicted or self._n == 0:
            return np.array([np.nan if self._r_next is None else self._r_next])
        return np.array([self._r])

    @property
    def mu(self) -> FloatArray:
        """Its probability, which is one."""
        return np.ones(1)

    @property
    def switch(self) -> float:
        """The known value of the switch."""
        return float(self.nodes[0])
