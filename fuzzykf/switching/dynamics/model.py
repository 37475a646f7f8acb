"""What the switching models share: dynamics, files, value semantics, and the way to a filter."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.gaussian import as_count, brief, check_generator
from fuzzykf.immutable import Immutable
from fuzzykf.io import Document
from fuzzykf.labels import NO_LABELS, Labels
from fuzzykf.reprs import html_table, reprs, shown_html, value_text
from fuzzykf.switching.dynamics.driven_simulation import sample_nodes, simulate_driven
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.switching.dynamics.told_inputs import told_inputs

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from datetime import timedelta

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.dynamics.base import Dynamics
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.dynamics.placed import KnownPath

__all__ = ["NODES", "SwitchingModel"]

#: Nodes between the hard values of a fuzzy switch, unless told otherwise.
NODES = 5


@reprs("n_classes", "dim_x", "dim_z")
class SwitchingModel(Immutable, Document):
    """A switch and dynamics.

    The law of the switch becomes a chain on nodes, the dynamics are placed on the chain,
    and a filter takes what was placed: the same way for every model.

    Attributes
    ----------
    form : Dynamics
        What state and observation do, given the switch.
    labels : fuzzykf.labels.Labels
        What is remembered of the data that the model was learned on: names of states and observations, their
        units, the length of a step; empty where there is nothing.  See `labelled`.
    """

    #: Whether the switch takes values between the regimes, of which ``n_nodes`` stand for all.
    is_fuzzy: bool
    form: Dynamics
    labels: Labels = NO_LABELS

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

    # ------------------------------------------------------------------ the switch

    @property
    @abstractmethod
    def p_hard(self) -> float:
        """Probability that the switch is in a hard regime."""

    @abstractmethod
    def describe_switch(self) -> str:
        """Describe the switch in words.

        Returns
        -------
        str
        """

    def named_parameters(self) -> dict[str, float]:
        """Return the named parameters of the law of the switch.

        Returns
        -------
        dict of str to float
        """
        return {}

    def regime_means(self) -> FloatArray:
        """Return the mean of the first (X, Y) in each regime, (K, dim_x + dim_z).

        Returns
        -------
        ndarray, shape (K, dim_x + dim_z)
        """
        return self.form.marginal(np.eye(self.n_classes))[0]

    @property
    def takes_weights(self) -> bool:
        """Whether values of the switch are class weights: a fuzzy switch between more than two regimes."""
        return self.is_fuzzy and self.n_classes > 2

    @abstractmethod
    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the class weights (..., K) of values of the switch."""

    @abstractmethod
    def _sample_switch(self, n: int, rng: np.random.Generator, n_nodes: int | None) -> FloatArray:
        """Draw ``n`` consecutive values of the switch."""

    # ------------------------------------------------------------------ names

    def labelled(
        self,
        *,
        states: Iterable[str] | Literal["keep"] | None = "keep",
        observations: Iterable[str] | Literal["keep"] | None = "keep",
        units: Mapping[str, str] | Literal["keep"] | None = "keep",
        step: np.timedelta64 | timedelta | Literal["keep"] | None = "keep",
    ) -> Self:
        """Return the same model with other names, units or time step.

        A filter of the model selects the columns of a table by these names, and rejects rows that are not one
        step apart.  `fit` takes names and step from pandas tables.

        Parameters
        ----------
        states, observations : sequence of str, optional
            Names of the components; None removes them.
        units : mapping of str to str, optional
            Units by name.  Units that are not given stay with their component.
        step : numpy.timedelta64 or timedelta, optional
            Time between rows.

        Returns
        -------
        SwitchingModel
            Of the same class.

        Raises
        ------
        ParameterError, ShapeError
            If the number of names differs from that of the components; see also `fuzzykf.labels.Labels`.

        Examples
        --------
        >>> import numpy as np
        >>> import pandas as pd
        >>> from fuzzykf import CGOMSModel
        >>> pair = np.kron([[1.0, 0.5], [0.5, 1.0]], np.eye(3))
        >>> model = CGOMSModel([[1.0]], np.zeros((1, 3)), pair[None, None], dim_x=1)
        >>> model = model.labelled(
        ...     states=["load"], observations=["t", "h"], units={"load": "GW"}
        ... )
        >>> frame = pd.DataFrame({"h": [1.0, 2.0], "t": [3.0, 4.0]})
        >>> found = model.filter().filter(frame)
        >>> bool((found.x == model.filter().filter(frame[["t", "h"]].to_numpy()).x).all())
        True
        """
        old = self.labels
        names = Labels(_kept(states, old.states), _kept(observations, old.observations))
        sizes = (("states", names.states, self.dim_x), ("observations", names.observations, self.dim_z))
        for argument, given, size in sizes:
            if given is not None and len(given) != size:
                raise ShapeError(
                    f"{argument}: got {len(given)} names, expected {size}, one for each component"
                )
        rest = _kept(units, old.units_as(names)), _kept(step, old.step)
        return self._with_labels(Labels(names.states, names.observations, *rest))

    def _with_labels(self, labels: Labels) -> Self:
        model = type(self).__new__(type(self))
        for name, value in {**self.__dict__, "labels": labels}.items():
            setattr(model, name, value)
        return model

    def _labels_to_dict(self) -> dict[str, Any]:
        """Return the part of the document that holds the labels; nothing if there are none."""
        return {"labels": self.labels.to_dict()} if self.labels else {}

    def _labelled_from(self, values: Mapping[str, Any]) -> Self:
        """Return the model with the labels of a document, which older ones do not have."""
        if "labels" not in values:
            return self
        found = Labels.from_dict(values["labels"])
        return self.labelled(
            states=found.states, observations=found.observations, units=found.units, step=found.step
        )

    def _labels_text(self) -> str:
        """Return the names as the end of a repr."""
        names = {"states": self.labels.states, "observations": self.labels.observations}
        return "".join(f", {key}={value_text(value)}" for key, value in names.items() if value is not None)

    # ------------------------------------------------------------------ the way to a filter

    @property
    def exactness(self) -> str:
        """Whether the model has an exact filter, in words.

        If a model made by `CGOMSModel.from_pairwise` has none, this names the pair of regimes that violates
        the condition, and by how much.
        """
        return self.form.exactness(self.placed().chain).words

    @abstractmethod
    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Place the dynamics on the nodes of the switch.

        Parameters
        ----------
        n_nodes : int, optional
            Number of nodes strictly between the regimes: by default 5, or those on which a free law was
            learned.  Ignored for hard regimes.
        rule : {"cell", "midpoint", "gauss", "product"}
            Quadrature rule, see `FuzzyMarkovLaw.discretize`.

        Returns
        -------
        SwitchingSystem
            The argument of `fuzzykf.switching.SwitchingFilter`.
        """

    def on_nodes(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Older name of `placed`.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        SwitchingSystem
        """
        return self.placed(n_nodes, rule)

    def along(self, r: FloatArray, start: int = 0) -> KnownPath:
        """Return the dynamics along a known path of the switch.

        Parameters
        ----------
        r : ndarray, shape (n,) or (n, K)
            Values of the switch.
        start : int
            Index of the observation that belongs to ``r[0]``.

        Returns
        -------
        KnownPath
        """
        return self.form.along(self.class_weights(r), r, start)

    @abstractmethod
    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Return a filter of the model.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        SwitchingFilter
            The exact filter, if there is one; before the first observation.
        """

    # ------------------------------------------------------------------ data and pictures

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
            Simulate the switch on this many nodes between the regimes; see ``law.sample``.  By default, it
            takes any value if the law allows that, else those of the law's default nodes.  Ignored for hard
            regimes.
        us : array_like, shape (n, k), or (n,) if there is one input, optional
            Inputs, if the model has inputs; ``us[0]`` is not used.  If they act on the switch, it is
            simulated on nodes.

        Returns
        -------
        Simulation
            ``x`` (n, m), ``y`` (n, q) and ``r`` (n,).  ``r`` holds values in [0, 1] for a fuzzy switch
            between
            two regimes, 0, ..., K - 1 for hard regimes, and class weights (n, K) for a fuzzy switch between
            more than two.
        """
        if isinstance(self.form, InputForm):
            return self._simulate_driven(n, rng, n_nodes, us)
        if us is not None:
            raise ParameterError(f"us: got {brief(us)}, but the model has no inputs; expected None")
        r = self._sample_switch(n, rng, n_nodes)
        return self.form.simulate(self.class_weights(r), r, rng)

    def _simulate_driven(self, n: int, rng: np.random.Generator, n_nodes: int | None, us: Any) -> Simulation:
        system: Any = self.placed(n_nodes)
        check_generator(rng)
        told = told_inputs("us", us, as_count("n", n, 0), system, True)
        if system.push is None:
            r = self._sample_switch(n, rng, n_nodes)
        else:
            path = sample_nodes(system, told, rng)
            r = system.chain.nodes[path] if self.is_fuzzy else path.astype(np.float64)
        return simulate_driven(system.form, r, self.class_weights(r), told, rng)

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw mean and spread of state and observation for every value of the switch.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_model`: component, labels, units.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.laws import plot_model

        return plot_model(self, ax, **options)

    @shown_html
    def _repr_html_(self) -> str:
        rows = [
            ("regimes", str(self.n_classes)),
            ("switch", self.describe_switch()),
            *self.labels.facts(self.dim_x, self.dim_z),
            ("form", self.form.kind),
            *self.form.facts(),
        ]
        return html_table(type(self).__name__, (), rows)


def _kept(given: Any, old: Any) -> Any:
    return old if isinstance(given, str) and given == "keep" else given
