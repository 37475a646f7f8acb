"""The tables of the switching recursion in the layout of the NumPy kernels."""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fuzzykf.engine.numpy.slots import Slots, lay_out, node_index

if TYPE_CHECKING:
    from fuzzykf.arrays import BoolArray, FloatArray, IntArray

__all__ = ["DEAD", "LOG_ZERO", "Kernel", "Summary", "pack"]

#: Stand-in for log 0: sums of a few stay finite, and exp of it is zero.  What is not zero, the density
#: of an observation 1e153 standard deviations off, say, is larger.
LOG_ZERO = -1e307

#: Below this a logarithm stands for a probability of zero, not for a small one.
DEAD = 0.5 * LOG_ZERO

_HALF_LOG_2PI = 0.5 * log(2.0 * np.pi)

#: Up to so large the matrix from nodes to pairs, (pairs, nodes), is faster than indices, for a scalar state.
_FEW = 16**3


class FewNodes(NamedTuple):
    """Ways between nodes and pairs as matrices, for a scalar state."""

    mix: FloatArray  # (3 p, 3 M1): a state, as seen by the p pairs
    whole: FloatArray  # (4 p, 1 + w + q + 3 M1): rows and mix at once
    spread: FloatArray  # (p, M2): a quantity of j, as seen by the pairs
    sums: FloatArray  # (2 p, 2 M2): sums over i of two quantities


class Kernel(NamedTuple):
    """Tables of one step in the layout of the kernels; pairs stand in slots, see `Slots`, j fastest.

    With u = (1, w, y') the first q ``depth`` M2 entries of ``rows @ u`` are the whitened
    innovations of y' divided by sqrt(2), the other m ``depth`` M2 are H w + G y' + c.
    """

    shape: tuple[int, int, int, int]  # M1, M2, m, q
    depth: int  # number of slots of each column: M1, or fewer
    slots: Slots | None  # of the pairs of positive probability; None if all have one
    nodes: tuple[Any, ...]  # see `node_index`
    log_scale: FloatArray  # (depth M2,): log P_ij and the constants of the Gaussian density
    sign: FloatArray | None  # (M1, M2): sign of P_ij, if some are negative
    rows: FloatArray  # ((q + m) depth M2, 1 + w + q)
    Axx: FloatArray  # (depth, M2, m, m)
    C: FloatArray  # (depth, M2, m, m)
    ones: FloatArray  # (depth,)
    few: FewNodes | None  # for a scalar state and few nodes


def pack(
    transition: FloatArray,
    factor: FloatArray,
    Axx: FloatArray,
    H: FloatArray,
    G: FloatArray,
    c: FloatArray,
    C: FloatArray,
    Ayy: FloatArray,
    Ny: FloatArray,
) -> Kernel:
    """Bring the tables of a step into the layout of the kernels.

    ``factor`` holds the lower Cholesky factors of Qyy; the others are as in
    `fuzzykf.switching.dynamics.pairs.PairCoefficients`, with leading shape (M1, M2).
    """
    M1, M2 = transition.shape
    m, q = Axx.shape[-1], factor.shape[-1]
    slots, source = lay_out(transition), np.repeat(np.arange(M1), M2)
    if slots is not None:
        source = slots.source.ravel()
        transition = slots.probabilities(transition)
        factor, Axx, H, G, c, C, Ayy, Ny = (slots.take(a) for a in (factor, Axx, H, G, c, C, Ayy, Ny))
    identity = np.broadcast_to(np.eye(q), (*transition.shape, q, q))
    innovation = np.concatenate([-Ny[..., None], -Ayy, identity], axis=-1)
    white = np.linalg.solve(factor, innovation) * np.sqrt(0.5)
    offset = np.concatenate([c[..., None], H, G], axis=-1)
    width = white.shape[-1]
    rows = np.concatenate(
        [np.moveaxis(white, 2, 0).reshape(-1, width), np.moveaxis(offset, 2, 0).reshape(-1, width)]
    )
    log_det = np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)
    with np.errstate(divide="ignore"):
        log_transition = np.maximum(np.log(np.abs(transition)), LOG_ZERO)
    log_scale = (log_transition - log_det - q * _HALF_LOG_2PI).reshape(-1)
    few = None
    if m == 1 and q == 1 and source.size * max(M1, M2) <= _FEW and (transition >= 0.0).all():
        pick = np.eye(M1)[source]
        few = _pack_few(log_scale, rows, Axx.reshape(-1, 1), C.reshape(-1), pick, M2)
    return Kernel(
        shape=(M1, M2, m, q),
        depth=len(transition),
        slots=slots,
        nodes=node_index(slots),
        log_scale=log_scale,
        sign=np.sign(transition) if (transition < 0.0).any() else None,
        rows=rows,
        Axx=np.ascontiguousarray(Axx),
        C=np.ascontiguousarray(C),
        ones=np.ones(len(transition)),
        few=few,
    )


def _pack_few(
    log_scale: FloatArray, rows: FloatArray, a: FloatArray, C: FloatArray, pick: FloatArray, M2: int
) -> FewNodes:
    """``pick`` (p, M1) is a quantity of i, as seen by the pairs."""
    (p, M1), width = pick.shape, rows.shape[1]
    spread = np.tile(np.eye(M2), (p // M2, 1))
    zero = np.zeros_like(pick)
    mix = np.block([[pick, zero, zero], [zero, a * pick, zero], [zero, zero, a * a * pick]])
    constants = np.zeros((3 * p, width))
    constants[:p, 0], constants[p : 2 * p], constants[2 * p :, 0] = log_scale, rows[p:], C
    innovations = np.concatenate([rows[:p], np.zeros((p, 3 * M1))], axis=1)
    whole = np.concatenate([innovations, np.concatenate([constants, mix], axis=1)])
    sums = np.kron(np.eye(2), spread).astype(np.float64)
    return FewNodes(mix, np.ascontiguousarray(whole), spread, sums)


class Summary:
    """What the moments before an observation and the estimate of the switch need.

    Parameters
    ----------
    kernel : Kernel
    transition : ndarray, shape (M1, M2)
    offset : ndarray, shape (1 + w, M1 M2 m)
        From (1, w) to the part of the mean of X' that observations make, per pair.
    twice : ndarray, shape (M1 m m, m m)
        From p_i P_i to its share of the sum of P_ij Axx P_i Axx'.
    noise : ndarray, shape (M1, m m)
        From p_i to its share of the noise of X'.
    nodes, weights : ndarray, shape (M2,)
        Values of the switch, and the measure of each node.
    atoms : ndarray of bool, shape (M2,)
        Which nodes are values of positive probability in the law.
    ranking : ndarray of int, shape (2, M2)
        How the nodes are looked through for the most likely value of the switch, see `most_likely`.
    """

    def __init__(
        self,
        kernel: Kernel,
        transition: FloatArray,
        offset: FloatArray,
        twice: FloatArray,
        noise: FloatArray,
        nodes: FloatArray,
        weights: FloatArray,
        atoms: BoolArray,
        ranking: IntArray,
    ) -> None:
        self.twice, self.noise, self.switch = twice, noise, (nodes, weights, atoms, ranking)
        M1, M2, m, _ = kernel.shape
        self.nodes, slots, source = kernel.nodes, kernel.slots, np.repeat(np.arange(M1), M2)
        if slots is not None:
            source = slots.source.ravel()
            transition = slots.probabilities(transition)
            offset = offset.reshape(-1, M1 * M2, m)[:, source * M2 + np.tile(np.arange(M2), kernel.depth)]
            offset = offset.reshape(len(offset), -1)
        self.transition, self.offset = transition, offset  # of the slots, as all that follows
        carried = np.zeros((M1, m, source.size, m))
        carried[source, :, np.arange(source.size)] = np.swapaxes(kernel.Axx.reshape(-1, m, m), -1, -2)
        self.carried = carried.reshape(M1 * m, source.size * m)  # x_i to Axx x_i
