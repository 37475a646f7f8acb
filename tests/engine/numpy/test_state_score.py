"""The score of states by a filter: against all paths, and its gradient against differences."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from fuzzykf.engine.numpy.state_score import MixtureLaw, PairMoves, score_gradient, score_states

NAN = np.nan


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.3 * np.eye(shape[-1])


def case_of(rng, M=3, m=2, T=6, pairs=None):
    nodes = np.array(list(product(range(M), repeat=2)) if pairs is None else pairs).T
    P = nodes.shape[1]
    A = rng.normal(size=(P, m, m))
    A *= 0.8 / np.linalg.norm(A, 2, axis=(-2, -1), keepdims=True)
    moves = PairMoves(rng.normal(size=(T, P)), rng.normal(size=(T, P, m)), A, definite(rng, P, m))
    first = MixtureLaw(rng.normal(size=M), rng.normal(size=(M, m)), definite(rng, M, m))
    return nodes, moves, first, rng.normal(size=(T + 1, m))


def objective(nodes, moves, first, xs, alpha=0.3):
    density, likelihood = score_states(nodes, moves, first, xs)
    return np.nansum(density) + alpha * likelihood.sum()


def slope(nodes, moves, first, xs, name, change):
    """Derivative along a change of one parameter, by extrapolated differences."""

    def at(h):
        parts = moves._asdict() | {f"first_{key}": value for key, value in first._asdict().items()}
        parts[name] = parts[name] + h * change
        law = MixtureLaw(*(parts[f"first_{key}"] for key in first._fields))
        return objective(nodes, PairMoves(*(parts[key] for key in moves._fields)), law, xs)

    def of(h):
        return (at(h) - at(-h)) / (2.0 * h)

    return (4.0 * of(1e-4) - of(2e-4)) / 3.0


CASES = {
    "vector": {},
    "scalar": {"m": 1, "M": 4},
    "one node": {"M": 1},
    "few pairs": {"pairs": [(0, 0), (0, 1), (1, 1), (1, 2), (2, 0)]},
    "a node is left for good": {"pairs": [(0, 0), (0, 1), (1, 1)], "M": 2},
    "a node is never reached": {"pairs": [(0, 0), (0, 1), (1, 0)], "M": 3},
}


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize("measured", ["all", "some", "none"])
def test_a_gradient_is_the_limit_of_differences(kind, measured) -> None:
    rng = np.random.default_rng(3)
    nodes, moves, first, xs = case_of(rng, **CASES[kind])
    if kind == "few pairs":
        first = first._replace(log_p=np.array([0.0, -np.inf, -1.0]))
    xs[{"all": [], "some": [0, 2, 5], "none": range(7)}[measured]] = NAN
    found = score_gradient(nodes, moves, first, xs, 0.3)
    density, likelihood = score_states(nodes, moves, first, xs)
    np.testing.assert_array_equal(found.log_density, density)
    np.testing.assert_array_equal(found.log_likelihood, likelihood)
    by = found.moves._asdict() | {f"first_{key}": value for key, value in found.first._asdict().items()}
    values = moves._asdict() | {f"first_{key}": value for key, value in first._asdict().items()}
    for name, value in values.items():
        for _ in range(4):
            change = rng.normal(size=value.shape)
            if name in ("C", "first_covariance"):
                change = 0.5 * (change + change.mT)
            expected = slope(nodes, moves, first, xs, name, change)
            assert (by[name] * change).sum() == pytest.approx(expected, rel=1e-7, abs=1e-8), name


def test_without_feedback_and_one_way_in_the_density_is_that_over_all_paths() -> None:
    # with A = 0, and means that depend on the new node alone, nodes are all there is to know
    rng = np.random.default_rng(4)
    M, T, m = 3, 5, 2
    nodes, moves, first, xs = case_of(rng, M, m, T)
    by_node = rng.normal(size=(T, M, m))
    C = definite(rng, M, m)
    moves = PairMoves(moves.log_weight, by_node[:, nodes[1]], 0.0 * moves.A, C[nodes[1]])
    density, likelihood = score_states(nodes, moves, first, xs)
    w = moves.log_weight.reshape(T, M, M)
    for n in range(1, T + 1):
        paths = list(product(range(M), repeat=n + 1))
        of_path = np.array([first.log_p[p[0]] + sum(w[k, p[k], p[k + 1]] for k in range(n)) for p in paths])
        of_x = [multivariate_normal.logpdf(xs[n], by_node[n - 1, p[-1]], C[p[-1]]) for p in paths]
        assert density[n] == pytest.approx(logsumexp(of_path + of_x) - logsumexp(of_path), rel=1e-12)
        assert likelihood[: n + 1].sum() == pytest.approx(logsumexp(of_path), rel=1e-12)


def test_one_node_is_a_linear_recursion() -> None:
    rng = np.random.default_rng(5)
    nodes, moves, first, xs = case_of(rng, M=1)
    x, P = first.mean[0], first.covariance[0]
    density, likelihood = score_states(nodes, moves, first, xs)
    for n in range(1, len(xs)):
        x = moves.A[0] @ x + moves.offset[n - 1, 0]
        P = moves.A[0] @ P @ moves.A[0].T + moves.C[0]
        assert density[n] == pytest.approx(multivariate_normal.logpdf(xs[n], x, P), rel=1e-12)
    np.testing.assert_allclose(likelihood, [first.log_p[0], *moves.log_weight[:, 0]], rtol=1e-14)


def test_far_observations_and_impossible_ones() -> None:
    rng = np.random.default_rng(6)
    nodes, moves, first, xs = case_of(rng)
    far = moves._replace(log_weight=moves.log_weight - 1e6)
    for name, by in score_gradient(nodes, far, first, xs, 0.0).moves._asdict().items():
        expected = getattr(score_gradient(nodes, moves, first, xs, 0.0).moves, name)
        np.testing.assert_allclose(by, expected, rtol=1e-6, atol=1e-8)  # digits of a log-weight of 1e6
    weights = moves.log_weight.copy()
    weights[3] = -np.inf
    found = score_gradient(nodes, moves._replace(log_weight=weights), first, xs, 0.1)
    assert np.isnan(found.log_density).all()
    assert all(np.isnan(one).all() for one in (*found.moves, *found.first))


def test_shapes_are_checked() -> None:
    nodes, moves, first, xs = case_of(np.random.default_rng(7))
    with pytest.raises(ValueError, match=r"^xs: got shape \(6, 2\), expected \(7, 2\)"):
        score_states(nodes, moves, first, xs[1:])
    with pytest.raises(ValueError, match=r"^nodes: got 0 to 3, expected 0 to 2"):
        score_states(nodes + (nodes == 2), moves, first, xs)
