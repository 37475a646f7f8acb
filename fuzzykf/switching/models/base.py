"""What the switching models share: dynamics, files, value semantics, and the way to a filter."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import as_count
from fuzzykf.immutable import Immutable
from fuzzykf.io import Document
from fuzzykf.reprs import html_table, reprs, shown_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.results import Simulation
    from fuzzykf.switching.dynamics.base import Dynamics
    from fuzzykf.switching.dynamics.pairs import SwitchingSystem
    from fuzzykf.switching.dynamics.placed import KnownPath

__all__ = ["NODES", "SwitchingModel", "given_regimes"]

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
    """

    #: Whether the switch takes values between the regimes, of which ``n_nodes`` stand for all.
    is_fuzzy: ClassVar[bool]
    form: Dynamics

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

    @abstractmethod
    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the shares of the regimes in values of the switch: (..., K)."""

    @abstractmethod
    def _sample_switch(self, n: int, rng: np.random.Generator) -> FloatArray:
        """Draw ``n`` consecutive values of the switch."""

    # ------------------------------------------------------------------ the way to a filter

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
        r : ndarray, shape (n,)
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
        OFSRFilter or CGOMSMFilter
            The exact filter, before any observation.
        """

    # ------------------------------------------------------------------ data and pictures

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
            ``.x`` (n, m), ``.y`` (n, q) and ``.r`` (n,): values in [0, 1] of a fuzzy
            switch, regimes 0, ..., K - 1 of a hard one.
        """
        r = self._sample_switch(n, rng)
        return self.form.simulate(self.class_weights(r), r, rng)

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
            ("components of the state", str(self.dim_x)),
            ("components of an observation", str(self.dim_z)),
            ("form", self.form.kind),
        ]
        return html_table(type(self).__name__, (), rows)


def given_regimes(n_switches: int | None, n_regimes: int | None, default: int | None = None) -> int:
    """Return the number of regimes, which has two names: a switch takes as many values as there are regimes.

    Parameters
    ----------
    n_switches, n_regimes : int, optional
        The older name, and the one that says what is counted.
    default : int, optional
        Without either.

    Raises
    ------
    ParameterError
        If it is no whole number of at least 1, given twice and different, or missing without a default.

    Examples
    --------
    >>> given_regimes(None, 3), given_regimes(3, 3), given_regimes(None, None, 2)
    (3, 3, 2)
    """
    names = {"n_switches": n_switches, "n_regimes": n_regimes}
    given = {name: as_count(name, value, 1) for name, value in names.items() if value is not None}
    if len(set(given.values())) > 1:
        raise ParameterError(
            f"n_switches, n_regimes: got {n_switches} and {n_regimes}, two names of the number of regimes; "
            "expected one of them"
        )
    if given:
        return next(iter(given.values()))
    if default is None:
        raise ParameterError("n_regimes: missing; expected the number of regimes")
    return default
