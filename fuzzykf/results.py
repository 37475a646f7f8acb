"""What comes out: results of filters and smoothers, of simulation, of learning.

The fields of a `FilterResult` are listed once, here, with what each of them holds along which
axes; whoever allocates, collects, stores, tabulates or describes fields reads that list.
"""

from __future__ import annotations

import dataclasses
import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import (
    as_choice,
    as_count,
    as_real,
    brief,
    check_generator,
    mixture_quantile,
    normal_quantile,
)
from fuzzykf.reprs import WIDTH, cut, html_table, reprs, shown, shown_html, value_text
from fuzzykf.summaries import summarise_fit
from fuzzykf.tables import as_dataframe, as_dataset, bounds_as_frames, coords_of, is_pandas
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

    from fuzzykf.arrays import FloatArray, IntArray
    from fuzzykf.summaries import FitSummary

__all__ = [
    "FIELDS",
    "FilterResult",
    "FilterTraining",
    "FitResult",
    "ResultField",
    "Simulation",
    "bic",
    "field_shapes",
]

M = TypeVar("M")


# --------------------------------------------------------------------------- the list of fields


class ResultField(NamedTuple):
    """Description of a field of `FilterResult`.

    Attributes
    ----------
    axes : tuple of str
        Names of its axes, among "step", "state", "node", "class" and "observation"; the second axis of
        a covariance is "state_column" or "observation_column".
    description : str
        One line, without a full stop.
    spread : str or None
        The field that holds its covariance.
    streamed : bool
        Whether a filter has it as an attribute of the same name after each step.

    Examples
    --------
    >>> from fuzzykf.results import ResultField
    >>> ResultField(("step", "state"), "mean of the state", spread="P").spread
    'P'
    """

    axes: tuple[str, ...]
    description: str
    spread: str | None = None
    streamed: bool = True


def _field(axes: str, description: str, *, spread: str | None = None, streamed: bool = True) -> Any:
    known = ResultField(tuple(axes.split()), description, spread, streamed)
    return field(default=None, metadata={"field": known})


def _fields_of(cls: type[Any]) -> dict[str, ResultField]:
    return {one.name: one.metadata["field"] for one in dataclasses.fields(cls) if "field" in one.metadata}


def _documented(cls: type[M]) -> type[M]:
    """Write the list of fields into the docstring of a class, in place of the word FIELDS."""
    sizes = {"step": "n", "state": "dim_x", "observation": "dim_z", "node": "M", "class": "K"}
    lines = []
    for name, known in _fields_of(cls).items():
        shape = ", ".join(sizes[axis.removesuffix("_column")] for axis in known.axes)
        lines.append(f"    {name} : ndarray, shape ({shape}{',' if len(known.axes) == 1 else ''})\n")
        lines.append(f"        {known.description[0].upper()}{known.description[1:]}.\n")
    cls.__doc__ = (cls.__doc__ or "").replace("    FIELDS\n", "".join(lines))  # no docstring under -OO
    return cls


# --------------------------------------------------------------------------- filters and smoothers


@_documented
@dataclass(frozen=True, kw_only=True, eq=False)
class FilterResult:
    """Estimates of a filter or smoother for every step of a series.

    The filter determines which fields are set; the others are None.  Results
    of many series have a leading axis (series, ...).

    Attributes
    ----------
    FIELDS
    index : object or None
        Index of the filtered data, from pandas or xarray; a list if it differs between series.
    names : sequence or None
        Names of the series, if there are many and they have names.
    lengths : ndarray of int, shape (series,), or None
        Lengths of the series, if they differ; shorter ones are padded with NaN.
    coords : tuple or None
        Dimensions and coordinates of series and steps, if a DataArray was filtered; `to_xarray` restores
        them.

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
    x: FloatArray | Any = _field(
        "step state", "mean of the state given the observations so far (a smoother: all of them)", spread="P"
    )
    P: FloatArray | Any = _field("step state state_column", "covariance of the state given the same")
    x_prior: FloatArray | Any = _field(
        "step state", "mean of the state given the earlier observations", spread="P_prior"
    )
    P_prior: FloatArray | Any = _field("step state state_column", "covariance given the earlier observations")
    lower: FloatArray | Any = _field("step state", "least state that is possible (possibilistic filters)")
    upper: FloatArray | Any = _field("step state", "greatest state that is possible (possibilistic filters)")
    mu: FloatArray | Any = _field("step node", "probability of each node (or class, or mode) of the switch")
    nodes: FloatArray | Any = _field(
        "node",
        "values of the switch that the columns of mu belong to; class weights (M, K) of more than two",
        streamed=False,
    )
    class_weights: FloatArray | Any = _field(
        "step class", "expected share of each class (hard regime) in the value of the switch"
    )
    switch: FloatArray | Any = _field(
        "step", "value of the switch of largest posterior marginal (MPM); class weights as nodes"
    )
    switch_mean: FloatArray | Any = _field("step", "posterior mean of the switch")
    switch_path: FloatArray | Any = _field(
        "step", "most likely path of the switch as a whole (smoothers)", streamed=False
    )
    possibility: FloatArray | Any = _field(
        "step", "possibility of the observation given the earlier ones (possibilistic filters)"
    )
    log_likelihood: FloatArray | Any = _field(
        "step", "logarithm of the density of the observation given the earlier ones"
    )
    z_prior: FloatArray | Any = _field(
        "step observation", "mean of the observation (forecasts)", spread="S", streamed=False
    )
    S: FloatArray | Any = _field(
        "step observation observation_column", "covariance of the observation (forecasts)", streamed=False
    )
    node_x: FloatArray | Any = _field(
        "step node state", "mean of the state given each node, if asked for", streamed=False
    )
    node_P: FloatArray | Any = _field(
        "step node state state_column",
        "covariance of the state given each node, if asked for",
        streamed=False,
    )
    index: Any = None
    names: Any = None
    lengths: IntArray | Any = None
    coords: Any = None

    @property
    def is_many(self) -> bool:
        """Whether the result holds many series, along a leading axis."""
        return len(self.shape) > 1

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of steps, (n,), or of series and steps, (series, n)."""
        for name, known in FIELDS.items():
            shape = getattr(getattr(self, name), "shape", None)
            if known.axes[0] == "step" and isinstance(shape, tuple) and shape:
                return shape[: 1 + len(shape) - len(self._axes(name))]
        return (0,)

    def _axes(self, name: str) -> tuple[str, ...]:
        """Return the axes of a field, with that of a value of the switch between more than two classes."""
        axes = FIELDS[name].axes
        return (*axes, "class") if name in _VALUES and np.ndim(self.nodes) == 2 else axes

    def __len__(self) -> int:
        """Return the length of the leading axis: steps, or series."""
        for name, known in FIELDS.items():
            value = getattr(self, name)
            if value is not None and known.axes[0] == "step":
                return len(value)
        return 0

    def interval(self, level: float = 0.9) -> tuple[Any, Any]:
        """Return the central interval of every component of the state.

        With ``node_x`` and ``node_P`` (``keep_nodes=True``) the bounds are quantiles of a mixture of
        normal distributions, one per node; otherwise of a single normal distribution with mean ``x``
        and covariance ``P``.  Both are approximations: given its node, the state is itself a mixture,
        of which the filter keeps mean and covariance only.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        lower, upper : ndarray, same shape as ``x``
            DataFrames, if the result is of one series with a pandas index.

        Raises
        ------
        ParameterError
            If ``level`` is not between 0 and 1, or the result has no ``x`` and ``P``.
        """
        bounds = self.bounds(level)
        if self.is_many or not is_pandas(self.index):
            return bounds
        return bounds_as_frames(*bounds, self.index)

    def bounds(self, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of `interval` as arrays, even if there is a pandas index.

        Parameters
        ----------
        level : float
            Nominal coverage, between 0 and 1.

        Returns
        -------
        lower, upper : ndarray, same shape as ``x``

        Raises
        ------
        ParameterError
            As from `interval`.
        """
        if not 0.0 < as_real("level", level, "a number between 0 and 1") < 1.0:
            raise ParameterError(f"level: got {level}, expected a number between 0 and 1")
        if self.x is None or self.P is None:
            raise ParameterError("interval: the result holds no x and P (see 'keep')")
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
        """Draw the state with its band, and the switch as a shaded strip, or as areas of class weights.

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

    def to_dataframe(self, index: Any = None, *, level: float | None = None) -> pd.DataFrame:
        """Return the result as a pandas DataFrame, one row per step.

        Each scalar field is a column.  Each vector field is a column such as ``x``, or ``x0``, ``x1``, ...
        for several components, followed by its standard deviation (``x_std``) if the covariance is known.
        Many series are stacked, with rows labelled by series and step.

        Parameters
        ----------
        index : sequence, optional
            Index of the rows of a series; by default that of the filtered data, else 0, 1, ...
        level : float, optional
            Add the bounds of the `interval` of this level, ``x_lower`` and ``x_upper``.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        MissingDependencyError
            If pandas is not installed.
        ParameterError
            If ``index`` has the wrong length; with ``level``, as from `interval`.
        """
        bounds = None if level is None else self.bounds(level)
        return as_dataframe(self, FIELDS, index, bounds)

    def to_xarray(self) -> xr.Dataset:
        """Return the result as an xarray Dataset, with one variable per field.

        The dimensions are the steps (named like the index, else ``time`` or ``step``), ``state``, ``node``,
        and so on; see `fuzzykf.results.ResultField`.  Many series add a first dimension, named like their
        names (else ``series``).  Index, series names and nodes of the switch are coordinates; indexes that
        differ between series form a two-dimensional coordinate, ``time_of_series``.  A filtered DataArray
        keeps its dimensions and coordinates.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingDependencyError
            If xarray is not installed.
        ParameterError
            If the index or a coordinate has the name of a field or of another dimension.

        Examples
        --------
        >>> import numpy as np
        >>> FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1))).to_xarray().P.dims
        ('step', 'state', 'state_column')
        """
        return as_dataset(self, FIELDS)

    def one(self, name: Any) -> FilterResult:
        """Return the result of a single series.

        Parameters
        ----------
        name : hashable
            Name of the series, or its number if the series have no names.

        Returns
        -------
        FilterResult
            Up to the end of the series, with its index.

        Raises
        ------
        ParameterError
            If the result holds one series only, or none of that name.

        Examples
        --------
        >>> from fuzzykf import KalmanFilter
        >>> found = KalmanFilter(1, 1, H=[[1.0]]).filter_many({"a": [1.0, 2.0], "b": [3.0]})
        >>> found.one("b").x.round(2)
        array([[2.]])
        """
        if not self.is_many:
            raise ParameterError("one: the result is of one series")
        count, n = self.shape
        names = list(range(count)) if self.names is None else list(self.names)
        if name not in names:
            raise ParameterError(
                f"name: got {brief(name)}, expected one of {listed([str(k) for k in names])}"
            )
        k = names.index(name)
        end = n if self.lengths is None else int(self.lengths[k])
        fields = {
            field: value if FIELDS[field].axes[0] != "step" or value is None else value[k, :end]
            for field, value in ((field, getattr(self, field)) for field in FIELDS)
        }
        return FilterResult(**fields, index=self.index[k] if isinstance(self.index, list) else self.index)

    def with_coords(self, zs: Any, axes: int = 1) -> FilterResult:
        """Return the result with the coordinates of a filtered DataArray; other data change nothing.

        Parameters
        ----------
        zs : object
            The filtered data.
        axes : int
            Number of its dimensions that count series and steps.

        Returns
        -------
        FilterResult
        """
        coords = coords_of(zs, axes)
        return self if coords is None else dataclasses.replace(self, coords=coords)

    @shown
    def __repr__(self) -> str:
        arrays = ", ".join(f"{name} {size}".replace(" ", _UNBROKEN) for name, size in self._sizes())
        lines = textwrap.wrap(f"{self._title()}: {arrays}" if arrays else self._title(), WIDTH, **_INDENT)
        lines = [line.replace(_UNBROKEN, " ") for line in lines]
        ends = _ends(self.index)
        return "\n".join([*lines, f"  index: {ends}"] if ends else lines)

    @shown_html
    def _repr_html_(self) -> str:
        rows = [(name, size, FIELDS[name].description) for name, size in self._sizes()]
        ends = _ends(self.index)
        notes = [f"index: {ends}"] if ends else []
        return html_table(self._title(), ("field", "shape", "what it is"), rows, notes)

    def _sizes(self) -> list[tuple[str, str]]:
        """Return the fields that are filled, and their shapes as text."""
        found = ((name, getattr(self, name)) for name in FIELDS)
        return [(name, _size(value)) for name, value in found if value is not None]

    def _title(self) -> str:
        *many, n = self.shape
        steps = f"{'up to ' if self.lengths is not None else ''}{n} steps"
        return f"{type(self).__name__} of " + (f"{many[0]} series of {steps}" if many else steps)


#: Fields that hold values of the switch at each step.
_VALUES = ("switch", "switch_path")

#: What stands for a space at which a line is not broken.
_UNBROKEN = "\0"

#: How further lines of a repr begin.
_INDENT: Any = {"subsequent_indent": "  ", "break_long_words": False, "break_on_hyphens": False}


def _size(value: Any) -> str:
    shape = getattr(value, "shape", None)
    return str(shape) if isinstance(shape, tuple) else value_text(value)


def _ends(index: Any) -> str:
    """Return the first and the last entry of an index; nothing where it has none that can be shown."""
    try:
        n = len(index)
        return f"{cut(str(index[0]), 40)} to {cut(str(index[n - 1]), 40)} ({n} entries)" if n else ""
    except Exception:  # no index, or one of somebody else that does as it likes
        return ""


#: The fields of `FilterResult` that hold arrays, in its order.
FIELDS = _fields_of(FilterResult)


def field_shapes(names: Iterable[str], **sizes: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of each field at one step.

    Parameters
    ----------
    names : iterable of str
    **sizes : int
        Sizes of the axes: ``state``, ``node``, ``class``, ``observation``.

    Returns
    -------
    dict of str to tuple of int

    Examples
    --------
    >>> field_shapes(("x", "P", "log_likelihood"), state=2)
    {'x': (2,), 'P': (2, 2), 'log_likelihood': ()}
    """
    sizes = {axis: as_count(axis, size) for axis, size in sizes.items()}
    given: Any = names
    if not hasattr(given, "__iter__"):
        raise ParameterError(f"names: got {brief(names)}, expected names of fields")
    names = tuple(names)
    for name in names:
        as_choice("names", name, FIELDS)
    return {
        name: tuple(sizes[axis.removesuffix("_column")] for axis in FIELDS[name].axes if axis != "step")
        for name in names
    }


# --------------------------------------------------------------------------- simulation


@reprs()
class Simulation(NamedTuple):
    """States, observations and switch of a simulated series.

    Attributes
    ----------
    x : ndarray, shape (n, m)
        States.
    y : ndarray, shape (n, q)
        Observations.
    r : ndarray, shape (n,) or (n, K)
        Values of the switch; class weights between more than two classes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import SwitchingStateSpace
    >>> model = SwitchingStateSpace(
    ...     [[0.9, 0.1], [0.1, 0.9]], F=0.5, H=1.0, Q=0.1, R=[[[0.1]], [[4.0]]]
    ... )
    >>> x, y, r = model.simulate(100, np.random.default_rng(0))
    >>> x.shape, y.shape, r.shape
    ((100, 1), (100, 1), (100,))
    """

    x: FloatArray
    y: FloatArray
    r: FloatArray


# --------------------------------------------------------------------------- learning


#: More than anybody counts.
MOST = 1 << 62


def bic(n_parameters: int, n_observations: int, log_likelihood: float) -> float:
    """Schwarz's information criterion, k log n - 2 log L; smaller is better.

    Parameters
    ----------
    n_parameters : int
        Number k of free parameters.
    n_observations : int
        Number n of observations.
    log_likelihood : float
        Maximum of log L.

    Returns
    -------
    float

    Examples
    --------
    >>> from fuzzykf.results import bic
    >>> round(bic(2, 100, -140.0), 2)
    289.21
    """
    k = as_count("n_parameters", n_parameters, most=MOST)
    n = as_count("n_observations", n_observations, 1, most=MOST)
    return float(np.log(n)) * k - 2.0 * as_real("log_likelihood", log_likelihood)


@reprs()
@dataclass(frozen=True)
class FilterTraining:
    """Outcome of learning with ``objective="filter"``.

    Attributes
    ----------
    kept : {"filter", "joint"}
        Fit that the model comes from.
    score_joint, score_filter : float
        Mean log-density of the states in the validation rows, per state and in the units of the data, under
        the filter of each fit.  Both learned from the earlier rows; ``score_filter`` is the best of the
        iterations that start from the joint fit.
    standard_error : float
        Standard error of the difference of the scores.  The joint fit is kept unless the difference is larger
        and the states of the training rows score better, too.
    n_iterations : int
        Number of iterations with the best score.
    inflation : float
        Factor by which the covariance of the state noise was widened.
    n_kept_back : int
        Number of states in the validation rows.
    trace : tuple of float
        Objective at each iteration on all rows, per state and in standard units; empty if the joint fit
        is kept.
    note : str
        Why the earlier rows are not sufficient, if so; then the joint fit is kept, and there are no scores.

    Examples
    --------
    >>> FilterTraining("filter", -0.61, -0.25, 0.02, 35, 1.25, 700).kept
    'filter'
    """

    kept: str
    score_joint: float
    score_filter: float
    standard_error: float
    n_iterations: int
    inflation: float
    n_kept_back: int
    trace: tuple[float, ...] = ()
    note: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Generic[M]):
    """Learned model, with its likelihood, history and warnings.

    Attributes
    ----------
    model : object
        The learned model, in the units of the data.
    log_likelihood : float
        Log-density of the training data (x, y) under the model, in their units; if x is missing in some
        rows, of the measured values (see `CGOFMSModel.fit`).
    n_parameters : int
        Number of free parameters.
    n_observations : int
        Number of steps used: those at which y was measured (in the covariance form, x as well).
    trace : ndarray
        Objective at each iteration: the log-likelihood of each stretch of data given its first
        (x, y), in standard units, plus the logarithm of a weak prior.
    converged : bool
        Whether the iterations ended because the gain fell below the tolerance.
    warnings : tuple of str
        Parts of the model that the data do not support.
    switch_mean : ndarray or pandas Series, shape (n,)
        Posterior mean of the switch along the training data (the switch itself, if it was
        given); NaN at steps that were not used.  Several series are concatenated.  None for a
        fuzzy switch between more than two classes.
    class_weights : ndarray or pandas DataFrame, shape (n, K)
        Posterior shares of the regimes, likewise.
    bic_of_forms : dict
        BIC of each form of the Gaussian part that was tried; with ``form="auto"`` the
        model has the form with the smallest.
    occupancy : ndarray, shape (K,), or None
        Share of the rows in each regime, by the posterior of the switch.
    training : FilterTraining or None
        With ``objective="filter"``: whether the joint fit was kept, and the scores of both fits on
        validation rows.
    score_of_features : dict
        With ``features="auto"``: the log score of the filter with each feature map on validation rows; the
        model has the best one.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSModel
    >>> rng = np.random.default_rng(0)
    >>> r = (np.arange(400) // 50) % 2
    >>> y = 4.0 * r + rng.normal(size=400)
    >>> fit = CGOMSModel.fit(0.5 * y + rng.normal(size=400), y, r, form="regression")
    >>> print(str(fit.summary())[:19])
    CGOMSModel, learned
    >>> fit.occupancy
    array([0.5, 0.5])
    """

    model: M
    log_likelihood: float
    n_parameters: int
    n_observations: int
    trace: FloatArray = field(repr=False)
    converged: bool
    warnings: tuple[str, ...] = ()
    switch_mean: Any = field(default=None, repr=False)
    class_weights: Any = field(default=None, repr=False)
    bic_of_forms: dict[str, float] = field(default_factory=dict)
    refit: Callable[[Simulation], FitResult[M]] | None = field(default=None, repr=False)
    occupancy: FloatArray | None = field(default=None, repr=False)
    training: FilterTraining | None = None
    continuation: Callable[..., FitResult[M]] | None = field(default=None, repr=False)
    score_of_features: dict[str, float] = field(default_factory=dict)

    @property
    def aic(self) -> float:
        """Akaike's information criterion, 2 k - 2 log L; smaller is better."""
        return 2.0 * self.n_parameters - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Schwarz's information criterion, k log n - 2 log L; smaller is better."""
        return bic(self.n_parameters, self.n_observations, self.log_likelihood)

    def summary(self) -> FitSummary:
        """Return a summary: parameters, data, fit and warnings.

        Standard errors are not included; see `bootstrap`.

        Returns
        -------
        FitSummary
            Prints as plain text; in a notebook it is a table.
        """
        return summarise_fit(self)

    @shown
    def __repr__(self) -> str:
        return repr(self.summary())

    @shown_html
    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()

    def update(self, x: Any, y: Any, *, forget: float = 1.0, inputs: Any = None) -> FitResult[M]:
        """Update the model with new rows, so that it follows changes of the system.

        The result stores the sufficient statistics of the earlier rows: expected transitions and weighted
        second moments.  They are discounted by ``forget`` for each new row and added to those of the new
        rows.  Expectation-maximisation starts from the current parameters and estimates the switch in the
        new rows only, so the cost of a call does not depend on the earlier rows.

        Parameters
        ----------
        x, y : array_like, or list of these
            New rows, in the original units, as in `CGOFMSModel.fit`; NaN where missing.  At least two
            consecutive rows with ``y`` are needed; ``x`` may be missing in all.  Columns of tables are
            matched by name.  Each call starts a new series: the step from the last earlier row to the first
            new one is not used.
        forget : float
            Factor on the weight of earlier rows for each new row, in ]0, 1].  With 1 nothing is forgotten;
            ``0.5 ** (1 / h)`` means a half-life of h rows.  Rows with missing values and rows of every
            series count; the rows of one call have the same weight.
        inputs : array_like, or list of these, optional
            Inputs of the new rows, if the fit had inputs.  Their effect on the transitions is not updated.
            With window features, each call loses the rows whose window starts before it, so pass long
            stretches.

        Returns
        -------
        FitResult
            A new result; this one does not change.  Names and structure of the model are the same.
            Likelihood, number of observations, shares of the regimes and trace are those of the new rows;
            ``warnings`` are about all rows, by weight.  It can be updated again, but not bootstrapped.

        Raises
        ------
        ParameterError
            If ``forget`` is out of range or leaves too little data; if the model was not learned with a
            hidden switch, the regression form and ``objective="joint"``; or if a value is far outside the
            range of the first data.
        ShapeError
            If the number of columns differs from that of the fit.

        See Also
        --------
        fuzzykf.CGOFMSModel.fit, fuzzykf.CGOMSModel.fit

        Notes
        -----
        With ``forget=1`` the result is close to a fit on all rows; only the switch in earlier rows is not
        estimated again.  Regimes and transitions that no longer occur are forgotten, so choose a half-life in
        which each occurs.  The statistics are part of the result and its pickle, but not of a saved model.

        References
        ----------
        O. Cappé, E. Moulines, "On-line expectation-maximization algorithm for latent data models", Journal
        of the Royal Statistical Society B 71 (2009).

        Examples
        --------
        >>> import numpy as np
        >>> from fuzzykf import CGOMSModel
        >>> rng = np.random.default_rng(0)
        >>> y = rng.normal(size=600)
        >>> offset = np.repeat([0.0, 1.0], 300)  # comes up half-way
        >>> x = offset + 0.5 * y + 0.1 * rng.normal(size=600)
        >>> fit = CGOMSModel.fit(x[:300], y[:300], n_regimes=1, state_feedback=False)
        >>> for forget in (1.0, 0.5 ** (1 / 50)):
        ...     model = fit.update(x[300:], y[300:], forget=forget).model
        ...     print(round(model.form.table.c.item(), 1))
        0.5
        1.0
        """
        if self.continuation is None:
            raise ParameterError(
                f"update: this result, of a {type(self.model).__name__}, holds no statistics to go on from; "
                "expected one of CGOFMSModel.fit or CGOMSModel.fit, with the switch hidden"
            )
        return self.continuation(x, y, forget, inputs)

    def bootstrap(self, n_replicates: int, rng: np.random.Generator) -> list[FitResult[M]]:
        """Parametric bootstrap: simulate from the learned model and fit again.

        Parameters
        ----------
        n_replicates : int
            Number of simulated series, each as long as all training data together.
        rng : numpy.random.Generator

        Returns
        -------
        list of FitResult
            Learned in the same way.  The standard deviation of a parameter over their models estimates its
            standard error.  If the switch is hidden, each search starts from the simulated one,
            so that the regimes keep their order.
        """
        n_replicates = as_count("n_replicates", n_replicates, 1)
        check_generator(rng)
        if self.refit is None:
            raise ParameterError("bootstrap: this result was not made by a fit (or it was updated)")
        model: Any = self.model
        us = getattr(self.refit, "us", None)
        told = {} if us is None else {"us": us}
        return [self.refit(model.simulate(self.n_observations, rng, **told)) for _ in range(n_replicates)]
