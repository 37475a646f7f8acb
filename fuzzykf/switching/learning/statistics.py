"""What rows say of the parameters, in few numbers, so that learning can go on without the rows.

The maximisation step needs no more than expected transitions and weighted second moments
(`fuzzykf.switching.learning.em`).  Of rows that are gone these are kept as the last expectation step found
them, and discounted as they grow old.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fuzzykf.switching.laws.learners import ChainFamily, FreeChain
from fuzzykf.switching.learning.em import Counts, Estimate, Posterior, cells_of
from fuzzykf.switching.learning.gaussians import RegressionEstimate, single_cells
from fuzzykf.switching.learning.regression import Evidence, merged

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray
    from fuzzykf.switching.laws.base import Law
    from fuzzykf.switching.learning.data import TrainingData

__all__ = ["Learned", "Statistics", "hard_start"]


@dataclass(frozen=True)
class Statistics:
    """Sufficient statistics of the complete data, in expectation.

    Attributes
    ----------
    counts : Counts
        Expected transitions and beginnings.
    steps : Evidence
        Moments of v = (1, y, y', x, x') of each pair of nodes.
    rows : Evidence
        Moments of (1, x, y) of each node.
    """

    counts: Counts
    steps: Evidence
    rows: Evidence

    @classmethod
    def of(cls, posterior: Posterior, shares: FloatArray, data: TrainingData) -> Statistics:
        """Take those that an expectation step found; ``shares`` (M, K) are those of the nodes."""
        counts = Counts(posterior.pairs, posterior.first)
        return cls(counts, cells_of(posterior, shares), single_cells(posterior.gamma, shares, data))

    def discounted(self, factor: float) -> Statistics:
        """Let all rows count by a factor in [0, 1]."""
        pairs, first = self.counts
        steps, rows = (
            part.each(lambda cells: cells._replace(weight=factor * cells.weight))
            for part in (self.steps, self.rows)
        )
        return Statistics(Counts(factor * pairs, factor * first), steps, rows)

    def joined(self, other: Statistics) -> Statistics:
        """Add those of other rows."""
        pairs, first = (a + b for a, b in zip(self.counts, other.counts, strict=True))
        steps, rows = self.steps.joined(other.steps), self.rows.joined(other.rows)
        return Statistics(Counts(pairs, first), steps.each(merged), rows.each(merged))


@dataclass(frozen=True)
class Learned:
    """What learning goes on from; all of it can be pickled, as chains cannot.

    Attributes
    ----------
    law : Law or None
        At which the first search began; None for hard regimes.
    n_nodes : int
        Of a fuzzy switch.
    numbers : ndarray
        Free numbers of the chain.
    gaussian : RegressionEstimate
        Its prior is the one of the first fit.
    statistics : Statistics
    tilt : ndarray, shape (K, k), or None
        How inputs act on the transitions.  What earlier rows say of it is not kept.
    """

    law: Law | None
    n_nodes: int
    numbers: FloatArray
    gaussian: RegressionEstimate
    statistics: Statistics
    tilt: FloatArray | None = None

    @classmethod
    def of(
        cls,
        law: Law | None,
        n_nodes: int,
        estimate: Estimate,
        posterior: Posterior,
        shares: FloatArray,
        data: TrainingData,
    ) -> Learned | None:
        """Keep what a search found with a hidden switch; nothing of a form that is no regression."""
        if not isinstance(estimate.gaussian, RegressionEstimate):
            return None
        statistics = Statistics.of(posterior, shares, data)
        numbers = estimate.chain.vector
        return cls(law, n_nodes, numbers, estimate.gaussian, statistics, estimate.tilt)

    @property
    def chain(self) -> ChainFamily:
        """The chain of these numbers, with the prior of the first search."""
        start = hard_start(self.gaussian.n_classes) if self.law is None else self.law.learner(self.n_nodes)
        found = start.at(self.numbers)
        assert found is not None  # a search stays where there are chains
        return found

    def start(self, before: Statistics) -> Estimate:
        """Return where a search goes on whose data join statistics of earlier rows.

        To the regressions these are a prior: what each pair of nodes has seen before the data.
        """
        gaussian = self.gaussian.with_prior(self.gaussian.prior.joined(before.steps))
        return Estimate(self.chain, gaussian, self.tilt)

    def moved(self, estimate: Estimate, statistics: Statistics) -> Learned:
        """Return what was learned since, with the prior of the first fit in its place again."""
        assert isinstance(estimate.gaussian, RegressionEstimate)
        gaussian = estimate.gaussian.with_prior(self.gaussian.prior)
        return replace(
            self,
            numbers=estimate.chain.vector,
            gaussian=gaussian,
            statistics=statistics,
            tilt=estimate.tilt,
        )


def hard_start(K: int) -> FreeChain:
    """Return the chain of K hard regimes at which a search begins: they mostly stay."""
    return FreeChain(np.eye(K), (0.8 * np.eye(K) + 0.2 / K) / K)
