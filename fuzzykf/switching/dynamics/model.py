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
        """Say in words how the switch moves."""

    def named_parameters(self) -> dict[str, float]:
        """Return the parameters of the law of the switch by name, as far as they have names."""
        return {}

    def regime_means(self) -> FloatArray:
        """Return the mean of the first (X, Y) in each regime: (K, dim_x + dim_z)."""
        return self.form.marginal(np.eye(self.n_classes))[0]

    @property
    def takes_weights(self) -> bool:
        """Whether values of the switch are class weights: those of a fuzzy one between more than two."""
        return self.is_fuzzy and self.n_classes > 2

    @abstractmethod
    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the shares of the regimes in values of the switch: (..., K)."""

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
        """Return the same model with other names; what is not given stays as it is.

        A filter of the model takes the observations from a table by their names, and refuses rows that are
        farther apart, or nearer, than a step.  `fit` finds names and step in tables of pandas.

        Parameters
        ----------
        states, observations : sequence of str, optional
            Names of the components; None forgets them.
        units : mapping of str to str, optional
            Units by name.  Those that stay go with the components, if these get other names.
        step : numpy.timedelta64 or timedelta, optional
            How far rows are apart.

        Returns
        -------
        SwitchingModel
            Of the same class.

        Raises
        ------
        ParameterError, ShapeError
            If there are more or fewer names than components, see also `fuzzykf.labels.Labels`.

        Examples
        --------
        >>> import numpy as np
        >>> import pandas as pd
        >>> from fuzzykf import CGOMSModel
        >>> pair = np.kron([[1.0, 0.5], [0.5, 1.0]], np.eye(3))
        >>> model = CGOMSModel([[1.0]], np.zeros((1, 3)), pair[None, None], dim_x=1)
        >>> model = model.labelled(states=["load"], observations=["t", "h"], units={"load": "GW"})
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
        """Whether the model, on its nodes, has an exact filter, in words.

        Where it has none, by how much the condition is missed, and at which pair of regimes, is said of a
        model made by `CGOMSModel.from_pairwise`.
        """
        return self.form.exactness(self.placed().chain).words

    @abstractmethod
    def placed(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Place the dynamics on the nodes of the switch.

        Parameters
        ----------
        n_nodes : int, optional
            Nodes strictly between the regimes: by default 5, or those on which a free law was
            learned.  A model of hard regimes has nothing in
            between: it is placed on its regimes, exactly, whatever is asked for.
        rule : {"cell", "midpoint", "gauss", "product"}
            How the nodes stand for the values between, see `FuzzyMarkovLaw.discretize`.

        Returns
        -------
        SwitchingSystem
            What `fuzzykf.switching.SwitchingFilter` takes.
        """

    def on_nodes(self, n_nodes: int | None = None, rule: str = "cell") -> SwitchingSystem:
        """Return `placed`, of which this is the older name."""
        return self.placed(n_nodes, rule)

    def along(self, r: FloatArray, start: int = 0) -> KnownPath:
        """Return the model along a known path of the switch, as the recursion takes it.

        Parameters
        ----------
        r : ndarray, shape (n,) or (n, K)
            Values of the switch.
        start : int
            Index of the observation to which the first of them belongs.
        """
        return self.form.along(self.class_weights(r), r, start)

    @abstractmethod
    def filter(self, n_nodes: int | None = None, rule: str = "cell") -> Any:
        """Make the filter of the model.

        Parameters
        ----------
        n_nodes, rule
            As in `placed`.

        Returns
        -------
        SwitchingFilter
            Before any observation: the exact filter, where there is one.
        """

    # ------------------------------------------------------------------ data and pictures

    def simulate(
        self, n: int, rng: np.random.Generator, n_nodes: int | None = None, us: Any = None
    ) -> Simulation:
        """Draw a series of switches, states and observations.

        Parameters
        ----------
        n : int
            Number of steps.
        rng : numpy.random.Generator
        n_nodes : int, optional
            Nodes between the regimes that the switch moves on; see ``law.sample``.  By default
            any value between them, where the law has such, else as many as the law says.  A model of
            hard regimes has nothing in between.
        us : array_like, shape (n, k), or (n,) if there is one input, optional
            Inputs, of a model that has them; ``us[0]`` is not used.  Where they act on the switch, it moves
            on nodes.

        Returns
        -------
        Simulation
            ``.x`` (n, m), ``.y`` (n, q) and ``.r`` (n,): values in [0, 1] of a fuzzy
            switch, regimes 0, ..., K - 1 of a hard one; class weights (n, K) of a fuzzy one between
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
