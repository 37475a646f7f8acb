"""Generalised pseudo-Bayes of second order: one filter for each pair of modes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.engine.selected import given_mode, merge_pairs, weigh_pairs
from fuzzykf.kalman.bank import (
    check_possible,
    clone,
    predict_members,
    put_moments,
    update_members,
)
from fuzzykf.kalman.series import unchanged_on_error
from fuzzykf.overrides import VERBS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fuzzykf.arrays import FloatArray
    from fuzzykf.kalman.state_maps import CommonSpace

__all__ = ["PairBranches"]


class PairBranches:
    """Copies of a bank between a prediction and its update, one for each mode before.

    Parameters
    ----------
    filters : sequence of filters
        The bank.
    log_joint : ndarray, shape (N, N)
        log P(mode i before, mode j now) at the time of the prediction.
    space : CommonSpace, optional
        That of moments that are given and returned, if the members do not have it all.
    """

    def __init__(
        self, filters: Sequence[Any], log_joint: FloatArray, space: CommonSpace | None = None
    ) -> None:
        self.banks = [[clone(f) for f in filters] for _ in filters]
        self.log_joint, self.space = log_joint, space

    def predict(
        self, filters: Sequence[Any], omega: FloatArray, xs: FloatArray, Ps: FloatArray, u: Any
    ) -> tuple[FloatArray, FloatArray]:
        """Predict from every mode with every filter, and merge what leads to the same mode.

        Returns the merged moments, and leaves them in ``filters``.
        """
        n = len(filters)
        pairs = [
            predict_members(
                members, np.repeat(x[None], n, axis=0), np.repeat(P[None], n, axis=0), u, self.space
            )
            for members, x, P in zip(self.banks, xs, Ps, strict=True)
        ]
        xs, Ps = _merge_pairs(omega, pairs)
        for j, f in enumerate(filters):
            put_moments(f, "prior", *self._of_member(j, xs[j], Ps[j]))
        return xs, Ps

    def update(
        self, filters: Sequence[Any], z: FloatArray
    ) -> tuple[FloatArray, float, FloatArray, FloatArray, FloatArray]:
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
        with unchanged_on_error(*(f for members in self.banks for f in members)):
            updated = [update_members(members, z, space=self.space) for members in self.banks]
            log_likelihood = np.array([values for values, _, _ in updated])
            check_possible(z, log_likelihood.ravel(), self.log_joint.ravel())
        weights, log_mu, total, log_modes = weigh_pairs(self.log_joint, log_likelihood)
        log_prior = np.logaddexp.reduce(self.log_joint, axis=0)
        xs, Ps = _merge_pairs(weights, [(x, P) for _, x, P in updated])
        for j, f in enumerate(filters):
            kept = ("x_prior", "P_prior", *VERBS)  # verbs of one object are bound to it
            prior = {name: value for name, value in f.__dict__.items() if name in kept}
            f.__dict__.update(self.banks[int(np.argmax(weights[:, j]))][j].__dict__)
            f.__dict__.update(prior)
            put_moments(f, "post", *self._of_member(j, xs[j], Ps[j]))
        modes = given_mode(log_modes, log_prior)
        return log_mu, float(total), modes, xs, Ps

    def _of_member(self, j: int, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (x, P) if self.space is None else self.space.to_member(j, x, P)


def _merge_pairs(
    weights: FloatArray, pairs: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Merge moments [i][j] over i with the weights (i, j)."""
    xs, Ps = (np.array(moments) for moments in zip(*pairs, strict=True))
    return merge_pairs(weights, xs, Ps)
