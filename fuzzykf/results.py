"""What filters and smoothers return for whole series."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fuzzykf.errors import MissingDependencyError, ParameterError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray

__all__ = ["FilterResult"]


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterResult:
    """What a filter or smoother found along a whole series.

    Which fields are filled depends on the filter; the others are None.  Results
    of many series carry a leading axis (series, ...).

    Attributes
    ----------
    x, P : ndarray, shapes (n, dim_x) and (n, dim_x, dim_x)
        Mean and covariance of the state given the observations up to each step
        (for a smoother: given all of them).
    x_prior, P_prior : ndarray
        The same before the observation of that step was seen.
    log_likelihood : ndarray, shape (n,)
        Logarithm of the density of each observation given the earlier ones.
    mu : ndarray, shape (n, M)
        Probability of each node (or class, or mode) of the switch.
    nodes : ndarray, shape (M,)
        The values of the switch that the columns of `mu` belong to.
    switch, switch_mean : ndarray, shape (n,)
        Estimate of the switch by the maximum of its posterior marginal, and its
        posterior mean.
    switch_path : ndarray, shape (n,)
        The most likely path of the switch as a whole (smoothers).
    z_prior, S : ndarray, shapes (n, dim_z) and (n, dim_z, dim_z)
        Predicted observations and their covariances (forecasts).
    node_x, node_P : ndarray, shapes (n, M, dim_x) and (n, M, dim_x, dim_x)
        Mean and covariance of the state given each node, if asked for.
    possibility : ndarray, shape (n,)
        Possibility of each observation (possibilistic filters).
    lower, upper : ndarray, shape (n, dim_x)
        Bounds of the states that are possible at all (possibilistic filters).
    index : object or None
        The index of the pandas object that was filtered.

    Examples
    --------
    >>> import numpy as np
    >>> result = FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1)))
    >>> len(result)
    3
    >>> lower, upper = result.interval(0.95)
    >>> upper[0].round(2)
    array([1.96])
    """

    # "| Any" and not "| None": code that filters and reads x should not have to narrow it first
    x: FloatArray | Any = None
    P: FloatArray | Any = None
    x_prior: FloatArray | Any = None
    P_prior: FloatArray | Any = None
    log_likelihood: FloatArray | Any = None
    mu: FloatArray | Any = None
    nodes: FloatArray | Any = None
    switch: FloatArray | Any = None
    switch_mean: FloatArray | Any = None
    switch_path: FloatArray | Any = None
    z_prior: FloatArray | Any = None
    S: FloatArray | Any = None
    node_x: FloatArray | Any = None
    node_P: FloatArray | Any = None
    possibility: FloatArray | Any = None
    lower: FloatArray | Any = None
    upper: FloatArray | Any = None
    index: Any = None

    #: Fields whose leading axis is not time.
    _static: ClassVar[frozenset[str]] = frozenset({"nodes", "index"})

    def __len__(self) -> int:
        """Return the length of the leading axis: steps, or series."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and field.name not in self._static:
                return len(value)
        return 0

    def interval(self, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Central interval of every state component.

        With `node_x` and `node_P` (``keep_nodes=True``) its ends are quantiles of the
        mixture of normal laws, one per node; else those of one normal law with the
        moments `x` and `P`.  Both are approximations: given its node the state is
        itself a mixture, of which only mean and covariance are carried.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        lower, upper : ndarray of the shape of `x`

        Raises
        ------
        ParameterError
            If ``level`` is outside ]0, 1[, or the result holds no `x` and `P`.
        """
        if not 0.0 < level < 1.0:
            raise ParameterError(f"level: got {level}, expected a number between 0 and 1")
        if self.x is None or self.P is None:
            raise ParameterError("interval: the result holds no x and P (see 'keep')")
        from fuzzykf.gaussian import mixture_quantile, normal_quantile

        tail = 0.5 * (1.0 - level)
        if self.node_x is not None and self.node_P is not None and self.mu is not None:
            std = np.sqrt(np.diagonal(self.node_P, axis1=-2, axis2=-1))
            weights = self.mu[..., None]
            return (
                mixture_quantile(tail, weights, self.node_x, std),
                mixture_quantile(1.0 - tail, weights, self.node_x, std),
            )
        half = normal_quantile(1.0 - tail) * np.sqrt(np.diagonal(self.P, axis1=-2, axis2=-1))
        return self.x - half, self.x + half

    def plot(self, ax: Axes | None = None, **options: Any) -> Axes:
        """Draw the state with its band, and the switch as a shaded strip.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.
        **options
            See `fuzzykf.plotting.plot_result`: component, level, truth, label, unit.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from fuzzykf.plotting.results import plot_result

        return plot_result(self, ax, **options)

    def to_dataframe(self, index: Any = None) -> pd.DataFrame:
        """Return the result of one series as a pandas DataFrame, one row per step.

        Columns are ``x`` and ``x_std`` (``x0``, ``x0_std``, ... for several
        components), the same for ``x_prior``, then ``lower``, ``upper``,
        ``switch``, ``switch_mean``, ``possibility``, ``log_likelihood``, as far as
        the result holds them.

        Parameters
        ----------
        index : sequence, optional
            Index of the rows; by default the index of the filtered pandas object,
            else 0, 1, ...

        Raises
        ------
        MissingDependencyError
            If pandas is not installed.
        ParameterError
            If the result holds many series.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingDependencyError("to_dataframe needs pandas: pip install 'fuzzykf[cli]'") from error
        columns: dict[str, FloatArray] = {}
        for name in ("x", "x_prior"):
            mean = getattr(self, name)
            covariance = getattr(self, name.replace("x", "P"))
            if mean is None:
                continue
            if mean.ndim != 2:
                raise ParameterError(
                    f"to_dataframe: the result holds many series (x has shape {mean.shape}); select one"
                )
            columns.update(_component_columns(name, mean))
            if covariance is not None:
                std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
                columns.update(_component_columns(name, std, "_std"))
        for name in ("lower", "upper"):
            bound = getattr(self, name)
            if bound is not None:
                columns.update(_component_columns(name, bound))
        for name in ("switch", "switch_mean", "possibility", "log_likelihood"):
            value = getattr(self, name)
            if value is not None:
                columns[name] = value
        return pd.DataFrame(columns, index=self.index if index is None else index)


def _component_columns(name: str, values: FloatArray, suffix: str = "") -> dict[str, FloatArray]:
    m = values.shape[1]
    return {f"{name}{'' if m == 1 else k}{suffix}": values[:, k] for k in range(m)}
