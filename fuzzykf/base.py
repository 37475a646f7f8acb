"""The contract of every filter, and the one place that decides on shapes and missing data.

A filter is an object with a few verbs: `Filter.predict`, `Filter.update`,
`Filter.step` (predict, then update), and for whole series `Filter.filter` and
filterpy's `Filter.batch_filter`.  What it knows is read from attributes:
``x`` of shape (dim_x, 1) and ``P`` of shape (dim_x, dim_x), as in filterpy.
Whole-series results are `FilterResult` objects with arrays of shape
(n, dim_x) and (n, dim_x, dim_x).
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fuzzykf.errors import MissingDependencyError, ParameterError, ShapeError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import pandas as pd

__all__ = ["Filter", "FilterResult", "FloatArray", "as_observation", "as_observations"]

FloatArray: TypeAlias = NDArray[np.float64]


# --------------------------------------------------------------------------- observations


def as_observation(z: ArrayLike | None, dim_z: int) -> FloatArray | None:
    """Turn one observation into a flat vector, or None where all of it is missing.

    Parameters
    ----------
    z : array_like or None
        A scalar (if ``dim_z`` is 1), a flat vector, a row, a column or a list.
        None, or NaN in every component, means missing.  NaN in some components
        means that these are missing.
    dim_z : int
        Number of components.

    Returns
    -------
    ndarray of shape (dim_z,) or None
        A new array; NaN marks missing components.

    Raises
    ------
    ShapeError
        If ``z`` has another shape, or is not numeric.

    Examples
    --------
    >>> as_observation([[1.0], [2.0]], 2)
    array([1., 2.])
    >>> as_observation(float("nan"), 1) is None
    True
    """
    if z is None:
        return None
    if dim_z == 1 and isinstance(z, float) and isfinite(z):  # the usual case in real time
        return np.array([z])
    try:
        value = np.array(z, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"z: expected {dim_z} numbers, got {z!r}") from error
    shape = value.shape
    if not (
        shape in ((dim_z,), (dim_z, 1), (1, dim_z)) or (dim_z == 1 and value.size == 1 and value.ndim <= 2)
    ):
        allowed = f"({dim_z},), ({dim_z}, 1) or (1, {dim_z})"
        if dim_z == 1:
            allowed = "a scalar, (1,) or (1, 1)"
        raise ShapeError(f"z: got shape {shape}, expected {allowed}")
    value = value.reshape(dim_z)
    if all(map(isfinite, value.tolist())):  # a small vector: faster than asking numpy twice
        return value
    if np.isinf(value).any():
        raise ParameterError(f"z: got {value.tolist()}, expected finite numbers (NaN where missing)")
    return None if np.isnan(value).all() else value


def as_observations(zs: Iterable[ArrayLike | None] | ArrayLike, dim_z: int) -> FloatArray:
    """Turn a series of observations into an array, NaN where something is missing.

    Parameters
    ----------
    zs : array_like or iterable
        Shape (n, dim_z) or (n, dim_z, 1); also (n,) if ``dim_z`` is 1.  Lists may
        hold None.  A pandas Series or DataFrame is accepted.
    dim_z : int
        Number of components of one observation.

    Returns
    -------
    ndarray of shape (n, dim_z)
        A new array.

    Raises
    ------
    ShapeError
        If the series, or one of its observations, has another shape.

    Examples
    --------
    >>> as_observations([1.0, None, 3.0], 1)
    array([[ 1.],
           [nan],
           [ 3.]])
    """
    if not isinstance(zs, np.ndarray):
        zs = zs.to_numpy() if hasattr(zs, "to_numpy") else list(zs)  # type: ignore[arg-type]
    if isinstance(zs, list) or zs.dtype == object:
        rows = [as_observation(z, dim_z) for z in zs]
        missing = np.full(dim_z, np.nan)
        return np.array([missing if z is None else z for z in rows]).reshape(len(rows), dim_z)
    try:
        series = np.array(zs, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"zs: expected numbers, got an array of {zs.dtype}") from error
    n = series.shape[0] if series.ndim else -1
    allowed = {(n, dim_z), (n, dim_z, 1), (n, 1, dim_z)}
    if dim_z == 1:
        allowed.add((n,))
    if n < 0 or series.shape not in allowed:
        expected = f"(n, {dim_z}) or (n, {dim_z}, 1)" + (" or (n,)" if dim_z == 1 else "")
        raise ShapeError(f"zs: got shape {series.shape}, expected {expected}")
    series = series.reshape(n, dim_z)
    if np.isinf(series).any():
        row = int(np.flatnonzero(np.isinf(series).any(axis=1))[0])
        raise ParameterError(
            f"zs: observation {row} is {series[row].tolist()}, expected finite numbers (NaN where missing)"
        )
    return series


# --------------------------------------------------------------------------- results


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

    x: FloatArray | None = None
    P: FloatArray | None = None
    x_prior: FloatArray | None = None
    P_prior: FloatArray | None = None
    log_likelihood: FloatArray | None = None
    mu: FloatArray | None = None
    nodes: FloatArray | None = None
    switch: FloatArray | None = None
    switch_mean: FloatArray | None = None
    switch_path: FloatArray | None = None
    z_prior: FloatArray | None = None
    S: FloatArray | None = None
    node_x: FloatArray | None = None
    node_P: FloatArray | None = None
    possibility: FloatArray | None = None
    lower: FloatArray | None = None
    upper: FloatArray | None = None
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


# --------------------------------------------------------------------------- the contract


class Filter(ABC):
    """What every filter of fuzzykf does; subclass it to write your own.

    A subclass implements `predict` and `update`, keeps its estimate in ``x``
    (dim_x, 1) and ``P`` (dim_x, dim_x), the estimate before the latest
    observation in ``x_prior`` and ``P_prior``, and calls `_remember` at the
    beginning of each verb that changes its state.  A probabilistic filter offers
    ``log_likelihood`` of the latest observation.  Everything else is inherited.
    `fuzzykf.testing.check_filter` checks that the contract is kept.

    Attributes
    ----------
    dim_x, dim_z : int
        Number of components of the state and of an observation.
    """

    dim_x: int
    dim_z: int
    x: Any
    P: Any
    x_prior: Any
    P_prior: Any

    @abstractmethod
    def predict(self, *args: Any, **kwargs: Any) -> None:
        """Move the estimate to the time of the next observation."""

    @abstractmethod
    def update(self, z: ArrayLike | None, *args: Any, **kwargs: Any) -> None:
        """Take the observation ``z`` into account; None or NaN means missing."""

    def step(self, z: ArrayLike | None) -> Any:
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.

        Returns
        -------
        ndarray of shape (dim_x, 1)
            The new estimate ``x``.
        """
        self.predict()
        self.update(z)
        return self.x

    def filter(self, zs: Iterable[ArrayLike | None] | ArrayLike) -> FilterResult:
        """Run `step` along a series and collect what it finds.

        Parameters
        ----------
        zs : array_like
            Shape (n, dim_z), or (n,) if ``dim_z`` is 1; None or NaN where missing.

        Returns
        -------
        FilterResult
            Fields ``x``, ``P``, ``x_prior``, ``P_prior`` and, from a probabilistic
            filter, ``log_likelihood``; from a possibilistic one, ``possibility``,
            ``lower`` and ``upper``.
        """
        series = as_observations(zs, self.dim_z)
        n, m = len(series), self.dim_x
        shapes = {
            "x": (n, m),
            "x_prior": (n, m),
            "P": (n, m, m),
            "P_prior": (n, m, m),
            "log_likelihood": (n,),
            "possibility": (n,),
            "lower": (n, m),
            "upper": (n, m),
        }
        collected: dict[str, list[FloatArray]] = {name: [] for name in shapes if hasattr(self, name)}
        for z in series:
            self.step(z)
            for name, values in collected.items():
                values.append(np.array(getattr(self, name), dtype=np.float64))
        arrays = {name: np.array(values).reshape(shapes[name]) for name, values in collected.items()}
        return FilterResult(**arrays, index=getattr(zs, "index", None) if hasattr(zs, "to_numpy") else None)

    def batch_filter(self, zs: Sequence[ArrayLike | None] | ArrayLike) -> tuple[FloatArray, ...]:
        """Filter a series and return filterpy's four arrays.

        Parameters
        ----------
        zs : array_like
            As in `filter`.

        Returns
        -------
        means, covariances, means_p, covariances_p : ndarray
            Shapes (n, dim_x, 1) and (n, dim_x, dim_x): after and before each
            observation.
        """
        result = self.filter(zs)
        x, P, x_prior, P_prior = result.x, result.P, result.x_prior, result.P_prior
        if x is None or P is None or x_prior is None or P_prior is None:
            raise NotImplementedError(f"{type(self).__name__} keeps no x, P, x_prior and P_prior")
        return x[..., None], P, x_prior[..., None], P_prior

    def copy(self) -> Self:
        """Return an independent copy; immutable parts (models, laws) are shared."""
        return copy.deepcopy(self)

    # ------------------------------------------------------------------ reset

    def _remember(self) -> None:
        """Keep the state at the first verb since construction or the last `reset`."""
        if "_origin" not in self.__dict__:
            self._origin: dict[str, Any] = copy.deepcopy(self.__dict__, {id(self): self})

    def reset(self) -> None:
        """Return to the state at the first verb since construction or the last reset."""
        if "_origin" in self.__dict__:
            origin = self._origin
            self.__dict__.clear()
            self.__dict__.update(origin)
