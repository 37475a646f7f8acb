"""Moments of the state in the long run, given each node of the switch.

With p the stationary law of the nodes, T their transition matrix and beta_ij = p_i T_ij / p_j the
probability of node i before node j,

    mbar_j = sum_i beta_ij m_i,    m_j = F_j mbar_j + b_j,
    P_j = F_j sum_i beta_ij [P_i + (m_i - mbar_j)(m_i - mbar_j)'] F_j' + Q_j,

two linear systems.  They have a solution that is a law if the spectral radius of the second, the growth of
second moments a step, is below one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.gaussian import symmetrize
from fuzzykf.immutable import cached_property

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["LongRun", "LongRunGradient"]


class LongRunGradient(NamedTuple):
    """Derivatives by the arguments of `LongRun`, each of the shape of that."""

    p: FloatArray
    transition: FloatArray
    F: FloatArray
    b: FloatArray
    Q: FloatArray


class LongRun:
    """The state in the long run.

    Parameters
    ----------
    p : ndarray, shape (M,)
        Stationary; nodes without mass are left out, and have mean zero and covariance one.
    transition : ndarray, shape (M, M)
    F, b, Q : ndarray, shapes (M, m, m), (M, m), (M, m, m)
    """

    def __init__(
        self, p: FloatArray, transition: FloatArray, F: FloatArray, b: FloatArray, Q: FloatArray
    ) -> None:
        self._there = np.flatnonzero(p > 0.0)
        mass, arrows = p[self._there], transition[np.ix_(self._there, self._there)]
        self._before = mass[:, None] * arrows / mass
        self._F, self._b, self._Q = F[self._there], b[self._there], Q[self._there]
        self._mass, self._size = mass, F.shape[:2]

    @cached_property
    def radius(self) -> float:
        """Growth of the second moments a step: they settle if it is below one."""
        return float(np.abs(np.linalg.eigvals(self._operator)).max())

    @cached_property
    def _operator(self) -> FloatArray:
        """The linear part of the equation of second moments, on the upper triangles of P_i (N, N)."""
        M, m, _ = self._F.shape
        rows, columns = np.triu_indices(m)
        whole = np.zeros((m, m, len(rows)))  # from an upper triangle to the matrix
        whole[rows, columns, range(len(rows))] = whole[columns, rows, range(len(rows))] = 1.0
        twice = np.einsum("jab,jcd,bdt->jact", self._F, self._F, whole)[:, rows, columns]
        operator: FloatArray = np.einsum("ij,jst->jsit", self._before, twice).reshape(M * len(rows), -1)
        return operator

    @cached_property
    def mean_radius(self) -> float:
        """Growth of the means a step: they settle if it is below one, as it is where `radius` is."""
        return float(np.abs(np.linalg.eigvals(self._moved)).max())

    @cached_property
    def _moved(self) -> FloatArray:
        """The linear part of the equation of means, (N, N)."""
        M, m, _ = self._F.shape
        moved: FloatArray = np.einsum("ij,jab->jaib", self._before, self._F).reshape(M * m, M * m)
        return moved

    @cached_property
    def mean(self) -> FloatArray:
        """Mean of the state given each node, (M, m)."""
        M, m, _ = self._F.shape
        found = np.linalg.solve(np.eye(M * m) - self._moved, self._b.reshape(-1))
        mean = np.zeros(self._size)
        mean[self._there] = found.reshape(M, m)
        return mean

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the state given each node, (M, m, m)."""
        M, m, _ = self._F.shape
        mean = self.mean[self._there]
        off = mean[:, None] - np.einsum("ij,ia->ja", self._before, mean)  # (i, j)
        spread = np.einsum("ij,ija,ijb->jab", self._before, off, off)
        noise = symmetrize(self._F @ spread @ np.swapaxes(self._F, -1, -2) + self._Q)
        rows, columns = np.triu_indices(m)
        found = np.linalg.solve(np.eye(len(self._operator)) - self._operator, noise[:, rows, columns].ravel())
        covariance = np.broadcast_to(np.eye(m), (*self._size, m)).copy()
        part = np.empty((M, m, m))
        part[:, rows, columns] = part[:, columns, rows] = found.reshape(M, -1)
        covariance[self._there] = part
        return covariance

    def pull_back(self, by_mean: FloatArray, by_covariance: FloatArray | None = None) -> LongRunGradient:
        """Return the derivatives by the arguments of what has these by the moments.

        The linear systems are differentiated, and solved once more with their operators transposed.

        Parameters
        ----------
        by_mean : ndarray, shape (M, m)
        by_covariance : ndarray, shape (M, m, m), optional
            Symmetric; without it covariances need not settle.
        """
        there, M, m = self._there, len(self._there), self._size[1]
        before, F, back = self._before, self._F, np.swapaxes(self._F, -1, -2)
        mean, g = self.mean[there], by_mean[there]
        mixed = np.einsum("ij,ia->ja", before, mean)
        by_F, by_Q, by_before = (np.zeros(one.shape) for one in (F, F, before))
        if by_covariance is not None:
            off = mean[:, None] - mixed
            spread = self.covariance[there][:, None] + off[..., :, None] * off[..., None, :]
            rows, columns = np.triu_indices(m)
            twice = np.where(rows == columns, 1.0, 2.0)
            known = (by_covariance[there][:, rows, columns] * twice).ravel()
            found = np.linalg.solve(np.eye(len(known)) - self._operator.T, known).reshape(M, -1) / twice
            by_Q[:, rows, columns] = by_Q[:, columns, rows] = found
            inside = back @ by_Q @ F
            by_F = 2.0 * by_Q @ F @ np.einsum("ij,ijab->jab", before, spread)
            by_before = np.einsum("jab,ijab->ij", inside, spread)
            # what a mean adds to the spread about a mixed mean; that of the mixed mean itself vanishes
            g = g + 2.0 * np.einsum("ij,jab,ijb->ia", before, inside, off)
        by_b = np.linalg.solve(np.eye(M * m) - self._moved.T, g.ravel()).reshape(M, m)
        by_F = by_F + by_b[:, :, None] * mixed[:, None, :]
        by_before = by_before + mean @ (back @ by_b[..., None])[..., 0].T
        own = by_before * before
        by_p = (own.sum(axis=1) - own.sum(axis=0)) / self._mass
        by_transition = by_before * self._mass[:, None] / self._mass
        return LongRunGradient(
            self._whole(by_p),
            self._whole(self._whole(by_transition).T).T,
            *(self._whole(one) for one in (by_F, by_b, by_Q)),
        )

    def _whole(self, part: Any) -> FloatArray:
        """Return rows for all nodes, of zero for those without mass."""
        whole = np.zeros((self._size[0], *part.shape[1:]))
        whole[self._there] = part
        return whole
