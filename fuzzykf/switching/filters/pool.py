"""A pool of filters: the mixture, with fixed weights, of what several filters say.

The law of the state is sum_k w_k p_k(x_n | y_1..n) and that of the next observation
sum_k w_k p_k(y_n | y_1..n-1), with p_k the laws of member k: a linear opinion pool.  The weights stay as
they are.  Bayes' rule would move them to the member under which the observations are likeliest, soon to
that one alone; and that says little of which member tells the state best.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from operator import length_hint
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.base import USUAL_FIELDS, Filter, FilterResult, check_keep
from fuzzykf.errors import FileFormatError, ParameterError, SequenceError
from fuzzykf.gaussian import as_flag, as_numbers, brief, logsumexp, mixture_moments
from fuzzykf.immutable import keeps
from fuzzykf.io import FILTERS, Document, decode, encode, flag, whole
from fuzzykf.labels import check_many, labels_of, match_series
from fuzzykf.many import read_many
from fuzzykf.overrides import ACCESS, VERBS, is_patched, lookups, overrides
from fuzzykf.registry import either
from fuzzykf.reprs import shown
from fuzzykf.results import FitResult
from fuzzykf.switching.dynamics.model import SwitchingModel
from fuzzykf.switching.filters.switching_filter import SwitchingFilter
from fuzzykf.switching.filters.told_members import inputs_of, told_of_members
from fuzzykf.texts import listed

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Sequence

    from fuzzykf.arrays import FloatArray, ManyNumbers, ManySeriesLike, Numbers
    from fuzzykf.labels import Labels
    from fuzzykf.many import ManySeries

__all__ = ["FilterPool", "pool_models"]

#: Sums of weights may miss one by this much.
ROUNDING = 1e-9

#: Fields of many series, and what each of them is computed from.
STORED = {
    **dict.fromkeys(("x", "P", "mu", "node_x", "node_P"), ("x", "P")),
    **dict.fromkeys(("x_prior", "P_prior"), ("x_prior", "P_prior")),
    "log_likelihood": ("log_likelihood",),
}

#: What is read after each step.
SHOWN = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")


@keeps("members", "weights")
class FilterPool(Filter, Document):
    """Mixture of several filters of the same state, with fixed weights.

    Parameters
    ----------
    filters : sequence of Filter
        Filters with a log-likelihood, of the same state and observation.  The pool works on copies, reset by
        `Filter.reset`.
    weights : array_like, shape (K,), optional
        Positive and with the sum 1; by default all equal.

    Attributes
    ----------
    members : tuple of Filter
    weights : ndarray, shape (K,)
    x, P : ndarray, shapes (dim_x, 1) and (dim_x, dim_x)
        Mean and covariance of the mixture: P is the mean of the covariances of the members, plus the
        covariance of their means.
    x_prior, P_prior : ndarray
        Mean and covariance before the latest observation.
    mu, nodes : ndarray, shape (K,)
        Weights and numbers of the members, as in `FilterResult`.
    log_likelihood : float
        Log-density of the latest observation given the earlier ones: log sum_k w_k p_k(y_n | y_1..n-1).

    Raises
    ------
    ParameterError
        If an element is not a filter or has no log-likelihood, dimensions or names of the observations
        differ, or weights are inadmissible.

    See Also
    --------
    fuzzykf.IMMEstimator : Weights that depend on the observations.

    Notes
    -----
    Because the weights are fixed, the pool is not a Bayesian mixture of models.  The log score of its state
    density is never below the weighted mean of the log scores of its members.

    Like a switching filter, a pool starts each series from the beginning unless ``resume`` is set, and takes
    one observation per step; the first observation always follows one predict.

    Examples
    --------
    >>> from fuzzykf import FilterPool, KalmanFilter
    >>> still, moving = (KalmanFilter(1, 1, F=[[F]], H=[[1.0]]) for F in (1.0, 2.0))
    >>> pool = FilterPool([still, moving])
    >>> pool.step(3.0).round(3)
    array([[2.25]])
    >>> [round(f.x.item(), 3) for f in pool.members]
    [2.0, 2.5]
    """

    members: tuple[Any, ...]
    weights: FloatArray

    def __init__(self, filters: Sequence[Filter], weights: Numbers = None) -> None:
        self.members = tuple(one.copy() for one in _as_filters(filters))
        self.weights = _as_weights(weights, len(self.members))
        self.dim_x, self.dim_z = self.members[0].dim_x, self.members[0].dim_z
        self._labels = _labels(self.members)
        self._guarded = False
        self.reset()

    def reset(self) -> None:
        """Return to the initial state, before any observation."""
        for member in self.members:
            member.reset()
        self._n, self._predicted = 0, False
        self.__dict__.pop("_sequel", None)

    # ------------------------------------------------------------------ verbs

    def predict(self, **told: Any) -> None:
        """Move to the time of the next observation.

        Before the first observation, this may be repeated.  Later, two predicts in a row mean that the
        observation in between is missing.

        Parameters
        ----------
        **told
            Further arguments of ``predict`` of each member, such as a control ``u``.
        """
        if self._predicted and self._n == 0:
            return
        with self._as_it_was_on_error():
            for member, own in told_of_members(self.members, told):
                member.predict(**own)
        self._n += self._predicted
        self._predicted = True

    def update(self, z: Numbers, **told: Any) -> None:
        """Take the observation ``z`` into account.

        Parameters
        ----------
        z : array_like or None
            None if it is missing, NaN for a missing component, as far as the members allow.
        **told
            Further arguments of ``update`` of each member.

        Raises
        ------
        SequenceError
            If `predict` was not called since the last update.
        ShapeError, ParameterError
            As from the members; the pool is then unchanged.
        """
        if self._n > 0 and not self._predicted:
            raise SequenceError(
                "update: called twice without a predict in between; a pool takes one observation per time"
            )
        with self._as_it_was_on_error():
            for member in self.members:
                if not self._predicted:
                    member.predict()
                member.update(z, **told)
        self._n, self._predicted = self._n + 1, False

    def step(self, z: Numbers, **told: Any) -> FloatArray:
        """Predict, then update with ``z``.

        Parameters
        ----------
        z : array_like or None
            The observation; None or NaN where missing.
        **told
            Further arguments of ``predict`` of each member.

        Returns
        -------
        ndarray, shape (dim_x, 1)
            The new estimate ``x``.
        """
        with self._as_it_was_on_error():
            if self._predicted or told or not self._is_plain():
                self.predict(**told)
                self.update(z)
            else:  # a step of a member may be much faster than its verbs
                for member in self.members:
                    member.step(z)
                self._n += 1
        return self.x

    @contextmanager
    def _as_it_was_on_error(self) -> Iterator[None]:
        if self._guarded:  # by the verb that has called this one
            yield
            return
        put_back = self._kept()
        self._guarded = True
        try:
            yield
        except BaseException:
            put_back()
            raise
        finally:
            self._guarded = False

    def _kept(self) -> Callable[[], None]:
        """Return what puts the state of now back."""
        members, own = [_kept(one) for one in self.members], self.__dict__.copy()

        def put_back() -> None:
            for one in members:
                one()
            self.__dict__.clear()
            self.__dict__.update(own)

        return put_back

    def _is_plain(self) -> bool:
        """Whether nobody has changed a verb of the pool, or what is read after it."""
        return not (overrides(type(self), _OWN) or is_patched(self))

    # ------------------------------------------------------------------ series

    def filter(
        self, zs: ManyNumbers, *, keep_nodes: bool = False, resume: bool = False, **told: Any
    ) -> FilterResult:
        """Filter a series, from its beginning or, with ``resume``, from the current state.

        Parameters
        ----------
        zs : array_like
            A series, as for the members.
        keep_nodes : bool
            Store a component for each node of each switching filter; by default one per member.
        resume : bool
            Continue from the current state, as `step` would.
        **told
            Further arguments of ``filter`` of each member, such as ``us``.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood`` and the mixture: weights ``mu``,
            the member that each belongs to (``nodes``), ``node_x`` and ``node_P``.
            `FilterResult.interval` returns its quantiles.

        Raises
        ------
        ShapeError, ParameterError
            As from the members; the pool is then unchanged.
        """
        keep_nodes, resume = as_flag("keep_nodes", keep_nodes), as_flag("resume", resume)
        zs = list(zs) if isinstance(zs, Iterator) else zs  # there are several to read it
        with self._as_it_was_on_error():
            if not resume:
                self.reset()
            if not self._is_plain():
                return self._by_verbs(zs, keep_nodes, resume, told)
            if self._n == 0 and self._predicted and length_hint(zs, 1):
                self.reset()  # the first observation of a series comes with its own predict
            results = [
                one.filter(zs, resume=True, **(_BY_NODE if keep_nodes and _has_nodes(one) else {}), **own)
                for one, own in told_of_members(self.members, told)
            ]
            n = len(results[0])
            self._n += n + (self._predicted and n > 0)
            self._predicted = self._predicted and n == 0
        fields = {name: self._mixed(results, name) for name in SHOWN if name != "mu"}
        components = _components(self.weights, results, keep_nodes)
        first = results[0]
        return FilterResult(**fields, **components, index=first.index, coords=first.coords)

    def _by_verbs(
        self, zs: ManyNumbers, keep_nodes: bool, resume: bool, told: dict[str, Any]
    ) -> FilterResult:
        """Filter a series by the verbs, which somebody has changed."""
        if told or keep_nodes:
            raise ParameterError(
                f"filter: got {', '.join(told) or 'keep_nodes'}, but the predict or update of this pool was "
                "changed by somebody; expected observations alone"
            )
        means: list[FloatArray] = []
        covariances: list[FloatArray] = []

        def note() -> None:
            x, P = self._now("x", 1), self._now("P", 2)
            means.append(x)
            covariances.append(P)

        zs = match_series(zs, self._labels, self.dim_z)
        found = self._filter_noting(zs, note, resume=resume)
        shape = len(found), len(self.members), self.dim_x
        node_x, node_P = np.reshape(means, shape), np.reshape(covariances, (*shape, self.dim_x))
        return replace(found, node_x=node_x, node_P=node_P)

    def filter_many(
        self,
        zs: ManySeriesLike,
        keep: Iterable[str] = USUAL_FIELDS,
        *,
        us: FloatArray | None = None,
        by: Hashable | None = None,
        resume: bool = False,
    ) -> FilterResult:
        """Filter many series, each as `filter` does; the pool itself does not change.

        Parameters
        ----------
        zs, by, resume
            As in `Filter.filter_many`.
        keep : sequence of str
            Fields to store, from ``x``, ``P``, ``x_prior``, ``P_prior``, ``log_likelihood``,
            and ``mu``, ``node_x``, ``node_P``: with these, `FilterResult.interval` returns quantiles of the
            mixture.
        us : ndarray, shape (n, k) or (series, n, k), optional
            Inputs of members with inputs, the same for all series or one set per series.

        Returns
        -------
        FilterResult
            The fields in ``keep``, each with a leading axis for the series; NaN beyond the end of a series
            that is shorter than others.
        """
        if not self._is_plain() and us is None:
            return super().filter_many(zs, keep, by=by, resume=resume)
        names = check_keep(keep, tuple(STORED))
        wanted = tuple(dict.fromkeys(source for name in names for source in STORED[name]))
        anew = not as_flag("resume", resume) or self._n == 0
        many = self._read_many(zs, by)
        inputs = None if us is None else as_numbers("us", us)

        def several(series: FloatArray, rows: Any) -> dict[str, FloatArray]:
            results = []
            told = inputs_of(inputs, rows, series.shape[1])
            for member, own in told_of_members(self.members, told):
                spare = member.copy()
                if anew:
                    spare.reset()
                results.append(spare.filter_many(series, keep=wanted, resume=True, **own))
            return {name: self._mixed(results, name) for name in names}

        return many.filtered(several, self.nodes if "mu" in names else None)

    def _read_many(self, zs: Any, by: Any) -> ManySeries:
        if by is None:  # with a key each series is looked at by itself
            check_many(zs, self._labels)
        named = partial(match_series, labels=self._labels, dim_z=self.dim_z)
        return read_many(zs, self.dim_z, by, named if self._labels else None)

    def forecast(self, steps: int, **told: Any) -> FilterResult:
        """Forecast states and observations; the pool does not change.

        Parameters
        ----------
        steps : int
            Number of steps after the latest observation.
        **told
            Further arguments of ``forecast`` of each member, such as ``us``.

        Returns
        -------
        FilterResult
            With ``x``, ``P``, ``z_prior``, ``S`` of the mixture and, for the quantiles of
            `FilterResult.interval`, the mixture of one component for each member: ``mu``, ``nodes``,
            ``node_x`` and ``node_P``.

        Raises
        ------
        SequenceError
            If `predict` was called since the latest observation.
        ParameterError
            If a member has no forecast; as from the members.
        """
        if self._predicted:
            raise SequenceError(
                "forecast: predict was called since the latest observation; expected it before"
            )
        for member in self.members:
            if not hasattr(member, "forecast"):
                raise ParameterError(f"forecast: a member is {_a(member)}, which has none")
        results = [one.forecast(steps, **own) for one, own in told_of_members(self.members, told)]
        moments = {name: self._mixed(results, name) for name in ("x", "P", "z_prior", "S")}
        return FilterResult(**moments, **_components(self.weights, results), index=results[0].index)

    # ------------------------------------------------------------------ what users read

    def _mixed(self, results: Sequence[FilterResult], name: str) -> FloatArray:
        """Return a field of the mixture from results of the members."""
        if name == "log_likelihood":
            return self._pooled([one.log_likelihood for one in results])
        if name in _MOMENTS:
            mean, covariance = _MOMENTS[name]
            found = mixture_moments(
                self.weights,
                np.stack([getattr(one, mean) for one in results], axis=-2),
                np.stack([getattr(one, covariance) for one in results], axis=-3),
            )
            return found[0] if name == mean else found[1]
        if name == "mu":
            return np.broadcast_to(self.weights, (*results[0].shape, len(self.members))).copy()
        return np.stack([getattr(one, name[-1]) for one in results], axis=-2 if name == "node_x" else -3)

    def _pooled(self, log_likelihoods: Sequence[Any]) -> FloatArray:
        """Return log sum_k w_k p_k from log p_k."""
        return logsumexp(np.log(self.weights) + np.stack(log_likelihoods, axis=-1))

    def _now(self, name: str, axes: int) -> FloatArray:
        """Return a mean (K, m), or a covariance (K, m, m), of each member."""
        return np.array([np.reshape(getattr(one, name), (self.dim_x,) * axes) for one in self.members])

    @property
    def x(self) -> FloatArray:
        """Mean of the state, (dim_x, 1)."""
        return (self.weights @ self._now("x", 1))[:, None]

    @property
    def P(self) -> FloatArray:
        """Covariance of the state, (dim_x, dim_x)."""
        return mixture_moments(self.weights, self._now("x", 1), self._now("P", 2))[1]

    @property
    def x_prior(self) -> FloatArray:
        """Mean before the latest observation, (dim_x, 1)."""
        return (self.weights @ self._now("x_prior", 1))[:, None]

    @property
    def P_prior(self) -> FloatArray:
        """Covariance before the latest observation, (dim_x, dim_x)."""
        return mixture_moments(self.weights, self._now("x_prior", 1), self._now("P_prior", 2))[1]

    @property
    def mu(self) -> FloatArray:
        """The weights, (K,)."""
        return self.weights.copy()

    @property
    def nodes(self) -> FloatArray:
        """The numbers of the members, (K,)."""
        return np.arange(len(self.members), dtype=np.float64)

    @property
    def log_likelihood(self) -> float:
        """Log-density of the latest observation given the earlier ones; 0 before any."""
        if self._n == 0:
            return 0.0
        return float(self._pooled([one.log_likelihood for one in self.members]))

    def _position(self) -> int:
        return self._n

    def _passed_since(self, position: int) -> int:
        return self._n - position

    @shown
    def __repr__(self) -> str:
        ahead = ", predicted one step ahead" if self._predicted and self._n else ""
        names = (
            f"{weight:.3g} {type(one).__name__}"
            for weight, one in zip(self.weights, self.members, strict=True)
        )
        return (
            f"{type(self).__name__}(dim_x={self.dim_x}, dim_z={self.dim_z}): {len(self.members)} members, "
            f"observations seen: {self._n}{ahead}\n  members: {listed(list(names), 6)}"
        )

    # ------------------------------------------------------------------ files

    @property
    def _can_be_saved(self) -> bool:
        """Whether each member is a filter that files know, so that `save` can be called."""
        return all(
            one._can_be_saved if isinstance(one, FilterPool) else type(one).__name__ in FILTERS
            for one in self.members
        )

    def to_dict(self) -> dict[str, Any]:
        """Return weights, members and their states as plain values.

        Returns
        -------
        dict
        """
        if not self._can_be_saved:
            kinds = [type(one).__name__ for one in self.members]
            raise ParameterError(
                f"save: got a pool of {listed(kinds)}, expected members that can be saved: {either(FILTERS)}"
            )
        members = [{"kind": type(one).__name__, "filter": one.to_dict()} for one in self.members]
        return {
            "weights": encode(self.weights),
            "n": self._n,
            "predicted": self._predicted,
            "members": members,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create a pool from the output of `to_dict`, in the same state.

        Parameters
        ----------
        values : mapping
            The output of `to_dict`.

        Returns
        -------
        FilterPool
        """
        members = tuple(FILTERS[one["kind"]].from_dict(one["filter"]) for one in values["members"])
        n, predicted = whole("n", values["n"]), flag("predicted", values["predicted"])
        for one in members:
            if (one._n, one._predicted) != (n, predicted):
                raise FileFormatError(
                    f"members: got one after {one._n} observations, predicted {one._predicted}, in a pool "
                    f"after {n}, predicted {predicted}"
                )
        pool = cls(members, decode(values["weights"], 1))
        pool.__dict__["members"], pool._n, pool._predicted = members, n, predicted
        return pool


def pool_models(models: Sequence[Any], weights: Numbers = None) -> FilterPool:
    """Create a pool of the filters of several models, with fixed weights.

    Models learned in different ways have different errors, so a pool tends to be better than most members,
    and none has to be chosen.

    Parameters
    ----------
    models : sequence of models, results of ``fit``, or filters
        Models, whose ``filter()`` is used, or filters.
    weights : array_like, shape (K,), optional
        Positive and with the sum 1; by default all equal.

    Returns
    -------
    FilterPool

    Raises
    ------
    ParameterError
        As from `FilterPool`.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, pool_models
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.broadcast_to(np.block([[z, 0.8 * z], [0.8 * z, z]]), (2, 2, 4, 4))
    >>> fuzzy = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc1(0.1, 0.1, 0.1), [[0.0, 0.0], [4.0, 3.0]], pair, dim_x=1
    ... )
    >>> pool = pool_models([fuzzy, fuzzy.harden()])
    >>> result = pool.filter(fuzzy.simulate(50, np.random.default_rng(0)).y)
    >>> result.node_x.shape, result.interval(0.9)[0].shape
    ((50, 2, 1), (50, 1))
    """
    if not _is_sequence(models):
        raise ParameterError(f"models: got {brief(models)}, expected a sequence of models and filters")
    found = [one.model if isinstance(one, FitResult) else one for one in models]
    return FilterPool([one.filter() if isinstance(one, SwitchingModel) else one for one in found], weights)


# --------------------------------------------------------------------------- parts

#: Which two fields each of these is computed with.
_MOMENTS = {name: pair for pair in (("x", "P"), ("x_prior", "P_prior"), ("z_prior", "S")) for name in pair}

_BY_NODE = {"keep_nodes": True}


def _components(
    weights: FloatArray, results: Sequence[FilterResult], by_nodes: bool = False
) -> dict[str, FloatArray]:
    """Return the mixture as fields: its components are nodes of members, where they are told, or members."""
    mu, x, P = [], [], []
    for weight, one in zip(weights, results, strict=True):
        by_node = by_nodes and one.node_x is not None
        mu.append(weight * (one.mu if by_node else np.ones((len(one.x), 1))))
        x.append(one.node_x if by_node else one.x[:, None])
        P.append(one.node_P if by_node else one.P[:, None])
    nodes = np.repeat(np.arange(len(mu), dtype=np.float64), [one.shape[1] for one in mu])
    parts = {"mu": mu, "node_x": x, "node_P": P}
    return {"nodes": nodes} | {name: np.concatenate(one, axis=1) for name, one in parts.items()}


def _has_nodes(one: Any) -> bool:
    return isinstance(one, SwitchingFilter | FilterPool)


def _kept(one: Any) -> Callable[[], None]:
    """Return what puts a member back; a switching filter need not copy for that, nor a pool of such."""
    put_back: Callable[[], None] = one._kept() if _has_nodes(one) else one._set_aside()
    return put_back


def _is_sequence(given: Any) -> bool:
    return (
        hasattr(given, "__len__") and hasattr(given, "__getitem__") and not isinstance(given, str | Mapping)
    )


def _a(one: Any) -> str:
    name = one.__name__ if isinstance(one, type) else type(one).__name__
    return f"the class {name}" if isinstance(one, type) else f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _as_filters(given: Any) -> Sequence[Filter]:
    """Return what was given if it can be pooled."""
    if not _is_sequence(given) or not len(given):
        raise ParameterError(f"filters: got {brief(given)}, expected a sequence of one filter at least")
    for k, one in enumerate(given):
        if not isinstance(one, Filter):
            remedy = " (pool_models takes models)" if isinstance(one, SwitchingModel) else ""
            raise ParameterError(f"filters[{k}]: got {_a(one)}, expected a filter{remedy}")
        if not hasattr(one, "log_likelihood"):
            raise ParameterError(
                f"filters[{k}]: got {_a(one)}, which has no log_likelihood; expected filters with a density"
            )
        sizes, expected = ((f.dim_x, f.dim_z) for f in (one, given[0]))
        if sizes != expected:
            raise ParameterError(
                f"filters[{k}]: got dim_x={sizes[0]}, dim_z={sizes[1]}, expected those of the first one, "
                f"dim_x={expected[0]}, dim_z={expected[1]}"
            )
    return list(given)


def _as_weights(given: Any, K: int) -> FloatArray:
    if given is None:
        return np.full(K, 1.0 / K)
    weights = as_numbers("weights", given)
    if weights.shape != (K,) or not (weights > 0.0).all() or not abs(weights.sum() - 1.0) <= ROUNDING:
        raise ParameterError(
            f"weights: got {brief(given)}, expected {K} positive numbers, one for each member, that sum to 1"
        )
    normed: FloatArray = weights / weights.sum()
    return normed


def _labels(members: Sequence[Any]) -> Labels:
    """Return what the members know of the names of the observations: they have to be of one mind."""
    found = [one._labels if isinstance(one, FilterPool) else labels_of(one) for one in members]
    known = [(one, one.observations) for one in found if one.observations is not None]
    for _, names in known[1:]:
        if names != known[0][1]:
            raise ParameterError(
                f"filters: got some that observe {listed(known[0][1])} and some that observe "
                f"{listed(names)}, expected the same names in the same order"
            )
    return known[0][0] if known else labels_of(None)


#: What the verbs are, and what is read after each, before anybody changes it.
_OWN = lookups(FilterPool, (*VERBS, *ACCESS, *SHOWN))
