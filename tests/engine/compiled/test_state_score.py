"""The compiled score of states, and its gradient, are those of NumPy, for systems of any kind."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from fuzzykf.engine.numpy import state_score as twin

core = pytest.importorskip(
    "fuzzykf.engine.compiled.state_score", reason="the compiled core has not been built"
)

SIZES = [(1, 1), (2, 1), (9, 1), (2, 2), (5, 3), (3, 6)]
KINDS = ("plain", "gaps", "sparse", "outlier", "impossible", "one row")
NAN = np.nan


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.3 * np.eye(shape[-1])


def arguments(size, kind):
    M, m = size
    rng = np.random.default_rng(10 * M + m)
    pairs = list(product(range(M), repeat=2))
    if kind == "sparse":
        pairs = [pairs[k] for k in rng.permutation(len(pairs))[: 1 + len(pairs) // 2]]
    T, P = (0 if kind == "one row" else 12), len(pairs)
    A = rng.normal(size=(P, m, m))
    A *= 0.8 / np.linalg.norm(A, 2, axis=(-2, -1), keepdims=True)
    weight, xs = rng.normal(size=(T, P)), rng.normal(size=(T + 1, m))
    first = twin.MixtureLaw(rng.normal(size=M), rng.normal(size=(M, m)), definite(rng, M, m))
    if kind == "gaps":
        xs[[0, 4, 5, 12]] = xs[7, 0] = NAN
    elif kind == "sparse":
        weight[:, 0] = -np.inf
        if M > 1:
            first = first._replace(log_p=np.where(np.arange(M) == 0, -np.inf, first.log_p))
    elif kind == "outlier":
        weight[6] = -1e4 * rng.random(P)
        xs[3] = 1e3
    elif kind == "impossible":
        weight[9] = -np.inf
    moves = twin.PairMoves(weight, rng.normal(size=(T, P, m)), A, definite(rng, P, m))
    return np.array(pairs, dtype=np.intp).T, moves, first, xs


def flat(found):
    return [found.log_density, found.log_likelihood, *found.moves, *found.first]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", SIZES)
def test_both_engines_agree(size, kind) -> None:
    given = arguments(size, kind)
    for alpha in (0.0, 0.1):
        expected = flat(twin.score_gradient(*given, alpha))
        for one, other in zip(flat(core.score_gradient(*given, alpha)), expected, strict=True):
            assert one.shape == other.shape
            size_of = np.abs(np.nan_to_num(other)).max(initial=1.0)
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12 * size_of)
    for one, other in zip(core.score_states(*given), twin.score_states(*given), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_both_refuse_alike() -> None:
    nodes, moves, first, xs = arguments((2, 2), "plain")
    for engine in (core, twin):
        with pytest.raises(ValueError, match=r"^C: got shape \(4, 2\), expected \(4, 2, 2\)"):
            engine.score_states(nodes, moves._replace(C=moves.C[..., 0]), first, xs)
        with pytest.raises(np.linalg.LinAlgError):
            engine.score_states(nodes, moves._replace(C=-9.0 * moves.C), first, xs)


def test_arguments_stay_as_they_were() -> None:
    nodes, moves, first, xs = arguments((3, 2), "gaps")
    copies = [np.array(one) for one in (*moves, *first, xs)]
    core.score_gradient(nodes, moves, first, xs, 0.1)
    for one, copy in zip((*moves, *first, xs), copies, strict=True):
        np.testing.assert_array_equal(one, copy)
