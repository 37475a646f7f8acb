"""Generalised pseudo-Bayes of second order: one filter for each pair of modes.

Between a prediction and its update, pairs of plain Kalman filters are moments alone (`PairMoments`), those
of any others are copies of the filters (`PairBranches`).  What is assigned to a filter meanwhile, say R for
the observation that comes, counts for all pairs that end in its mode.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fuzzykf.engine.selected import correct_bank, given_mode, merge_pairs, move_bank, weigh_pairs
from fuzzykf.kalman.arguments import SINGULAR, SingularInnovationError
from fuzzykf.kalman.bank import (
    check_possible,
    clone,
    control_terms,
    fading,
    linear_model,
    member_states,
    predict_members,
    put_innovations,
    put_moments,
    seen_of,
    update_members,
)
from fuzzykf.kalman.pair_moments import PairMoments
from fuzzykf.kalman.series import unchanged_on_error
from fuzzykf.overrides import VERBS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.kalman.state_maps import CommonSpace

    #: log_mu (N,), log-likelihood of z, those of the modes (N,), merged xs (N, n) and Ps (N, n, n).
    Updated: TypeAlias = tuple[FloatArray, float, FloatArray, FloatArray, FloatArray]

__all__ = ["PairBranches", "predict_pairs", "update_pairs"]

#: What is bound to one object.
_BOUND = (*VERBS, "get_prediction")


def predict_pairs(
    filters: Sequence[Any],
    weights: tuple[FloatArray, FloatArray],
    moments: tuple[FloatArray, FloatArray],
    u: Any,
    space: CommonSpace | None = None,
) -> tuple[PairMoments | PairBranches, FloatArray, FloatArray]:
    """Predict from every mode with every filter, and merge what leads to the same mode.

    Parameters
    ----------
    filters : sequence of filters
        The bank; it is given the merged moments.
    weights : tuple of ndarray, shapes (N, N)
        log P(mode i before, mode j now), and P(i | j).
    moments : tuple of ndarray, shapes (N, n) and (N, n, n)
        Of the modes before.
    u : object
        Control.
    space : CommonSpace, optional
        That of moments that are given and returned, if the members do not have it all.

    Returns
    -------
    pairs : PairMoments or PairBranches
        For `update_pairs`.
    xs, Ps : ndarray
        Merged moments.
    """
    log_joint, omega = weights
    model = None if space is not None else linear_model(filters, ("F", "Q"))
    if model is None:
        branches = PairBranches(filters, log_joint, space)
        return branches, *branches.predict(filters, omega, *moments, u)
    terms = control_terms(filters, u)
    xs, Ps = (value[:, None] for value in moments)
    xs, Ps = move_bank(xs, Ps, model["F"], model["Q"], fading(filters))
    if terms is not None:
        xs = xs + terms
    _check_pairs(filters, xs, Ps)
    merged_xs, merged_Ps = merge_pairs(omega, xs, Ps)
    for f, x, P in zip(filters, merged_xs, merged_Ps, strict=True):
        f._set_prior(x.reshape(np.shape(f.x) or (1, 1)).copy(), P.copy())
    return PairMoments(log_joint, xs, Ps, merged_xs, merged_Ps), merged_xs, merged_Ps


def update_pairs(pairs: PairMoments | PairBranches, filters: Sequence[Any], z: FloatArray) -> Updated:
    """Update every pair with z, and merge what ends in the same mode.

    Returns
    -------
    log_mu : ndarray, shape (N,)
    total : float
        Log-likelihood of z.
    modes : ndarray, shape (N,)
        Log-likelihood of z in each mode.
    xs, Ps : ndarray
        Merged moments; they are left in ``filters`` too.
    """
    if isinstance(pairs, PairBranches):
        return pairs.update(filters, z)
    xs, Ps = (
        np.where((own == merged).all(axis=axes, keepdims=True), of_pairs, own)
        for own, merged, of_pairs, axes in zip(
            member_states(filters), pairs[3:], pairs[1:3], (-1, (-2, -1)), strict=True
        )
    )
    model = linear_model(filters, ("H", "R"))
    if model is None:
        return PairBranches(filters, pairs.log_joint).put(xs, Ps).update(filters, z)
    try:
        *innovation, xs, Ps, log_likelihood = correct_bank(xs, Ps, z, model["H"], model["R"], seen_of(z))
    except np.linalg.LinAlgError as error:
        raise SingularInnovationError(SINGULAR) from error
    _check_pairs(filters, xs, Ps)
    weights, found = _weigh(pairs.log_joint, log_likelihood, xs, Ps, z)
    likeliest = weights.argmax(axis=0), np.arange(len(weights))
    own = [value[likeliest] for value in (*innovation, log_likelihood)]
    put_innovations(filters, found[3:], z, own)
    return found


def _own(value: Any) -> Any:
    """Return a copy of an array, and anything else as it is."""
    return value.copy() if isinstance(value, np.ndarray) else value


def _check_pairs(filters: Sequence[Any], xs: FloatArray, Ps: FloatArray) -> None:
    """Raise unless the moments of all pairs (i, j) are made of numbers."""
    if not (np.isfinite(xs).all() and np.isfinite(Ps).all()):
        for of_mode in zip(xs, Ps, strict=True):
            for f, x, P in zip(filters, *of_mode, strict=True):
                f._check(x, P)


def _weigh(
    log_joint: FloatArray, log_likelihood: FloatArray, xs: FloatArray, Ps: FloatArray, z: FloatArray
) -> tuple[FloatArray, Updated]:
    """Return the weights (i, j) of the pairs within each mode, and what `update_pairs` does."""
    check_possible(z, log_likelihood.ravel(), log_joint.ravel())
    weights, log_mu, total, log_modes = weigh_pairs(log_joint, log_likelihood)
    modes = given_mode(log_modes, np.logaddexp.reduce(log_joint, axis=0))
    return weights, (log_mu, float(total), modes, *merge_pairs(weights, xs, Ps))


class PairBranches:
    """Copies of a bank between a prediction and its update, one for each mode before.

    Parameters
    ----------
    filters : sequence of filters
        The bank.
    log_joint : ndarray, shape (N, N)
        log P(mode i before, mode j now) at the time of the prediction.
    space : CommonSpace, optional
        As in `predict_pairs`.
    """

    def __init__(
        self, filters: Sequence[Any], log_joint: FloatArray, space: CommonSpace | None = None
    ) -> None:
        self.banks = [[clone(f) for f in filters] for _ in filters]
        self.log_joint, self.space = log_joint, space
        self._remember(filters)

    def _remember(self, filters: Sequence[Any]) -> None:
        """Keep what the filters hold; of arrays the numbers, for they may be written into."""
        self.held = [{name: _own(value) for name, value in vars(f).items()} for f in filters]

    def predict(
        self, filters: Sequence[Any], omega: FloatArray, xs: FloatArray, Ps: FloatArray, u: Any
    ) -> tuple[FloatArray, FloatArray]:
        """Do `predict_pairs`, and return the merged moments."""
        n = len(filters)
        pairs = [
            predict_members(
                members, np.repeat(x[None], n, axis=0), np.repeat(P[None], n, axis=0), u, self.space
            )
            for members, x, P in zip(self.banks, xs, Ps, strict=True)
        ]
        xs, Ps = merge_pairs(omega, *(np.array(moments) for moments in zip(*pairs, strict=True)))
        for j, f in enumerate(filters):
            put_moments(f, "prior", *self._of_member(j, xs[j], Ps[j]))
        self._remember(filters)
        return xs, Ps

    def put(self, xs: FloatArray, Ps: FloatArray) -> PairBranches:
        """Make the moments of the pairs (i, j) those of the copies."""
        for members, *of_mode in zip(self.banks, xs, Ps, strict=True):
            for f, x, P in zip(members, *of_mode, strict=True):
                put_moments(f, "prior", x, P)
        return self

    def update(self, filters: Sequence[Any], z: FloatArray) -> Updated:
        """Do `update_pairs`."""
        with unchanged_on_error(*(f for members in self.banks for f in members)):
            for j, f in enumerate(filters):
                self._assign(j, f)
            updated = [update_members(members, z, space=self.space) for members in self.banks]
            log_likelihood, xs, Ps = (np.array(values) for values in zip(*updated, strict=True))
            weights, found = _weigh(self.log_joint, log_likelihood, xs, Ps, z)
        *_, xs, Ps = found
        for j, f in enumerate(filters):
            kept = ("x_prior", "P_prior", *_BOUND)
            prior = {name: value for name, value in f.__dict__.items() if name in kept}
            f.__dict__.update(self.banks[int(np.argmax(weights[:, j]))][j].__dict__)
            f.__dict__.update(prior)
            put_moments(f, "post", *self._of_member(j, xs[j], Ps[j]))
        return found

    def _assign(self, j: int, f: Any) -> None:
        """Give what was assigned to filter j, or written into it, since the prediction to its copies."""
        for name, value in vars(f).items():
            before = self.held[j].get(name, _BOUND)
            if name in _BOUND or value is before:
                continue
            if isinstance(value, np.ndarray) and np.array_equal(value, before):
                continue
            for members in self.banks:
                vars(members[j])[name] = _own(value)

    def _of_member(self, j: int, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (x, P) if self.space is None else self.space.to_member(j, x, P)
