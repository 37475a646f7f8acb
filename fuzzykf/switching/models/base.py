"""What the switching models share: a Gaussian form, files, and value semantics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fuzzykf.immutable import Immutable
from fuzzykf.io import Document
from fuzzykf.switching.dynamics.forms import GaussianForm
from fuzzykf.switching.dynamics.placed import KnownPath

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.state_space.converted import ConvertedPath, ConvertedSystem

__all__ = ["SwitchingModel"]


class SwitchingModel(Immutable, Document):
    """What the fuzzy and the hard model share: a Gaussian form, files, and value semantics."""

    form: GaussianForm | ConvertedSystem

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

    def class_weights(self, r: ArrayLike) -> FloatArray:
        """Return the shares of the regimes in values of the switch: (..., K)."""
        raise NotImplementedError

    def along(self, r: FloatArray, start: int = 0) -> KnownPath | ConvertedPath:
        """Return the model along a known path of the switch, as the recursion takes it.

        Parameters
        ----------
        r : ndarray, shape (n,)
            Values of the switch.
        start : int
            Index of the observation to which the first of them belongs.
        """
        shares = self.class_weights(r)
        if isinstance(self.form, GaussianForm):
            return KnownPath(self.form, shares, r)
        return self.form.along(r, start)

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

        model: Any = self
        return plot_model(model, ax, **options)
