"""Laws on graphs: their cells against integrals and the laws of two classes, masses, samples, errors."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import dblquad

from fuzzykf import FuzzyMarkovLaw, GraphLaw, SwitchChain
from fuzzykf.errors import ParameterError, ShapeError
from fuzzykf.switching.laws.registry import LAWS


def reference():
    """The path 0 - 1 - 2 of the reference numbers: corners in proportion to given ones, normalised."""
    parameters = [(0.06, 0.03), (0.05, 0.02)]
    corners = np.array([[0.2, 0.02, 0.0], [0.02, 0.15, 0.01], [0.0, 0.01, 0.1]])
    left = 1.0 - sum(8 * eta / 3 + 7 * delta / 3 for eta, delta in parameters)
    return GraphLaw(3, [(0, 1), (1, 2)], corners * left / corners.sum(), parameters=parameters)


TRIANGLE = GraphLaw.from_masses(
    [3.0, 2.5, 4.0],
    {(0, 1): 0.9, (2, 1): 0.6, (0, 2): 0.7},
    jumps={(0, 1): 0.1, (1, 2): 0.05},
    family="band",
    shape=0.3,
    crossings={((0, 1), (1, 2)): (0.05, 0.25), ((0, 2), (0, 1)): (0.03, 0.4)},
)
STAR = GraphLaw.from_masses(
    [1.0, 2.0, 1.5, 3.0], {(0, 1): 0.5, (2, 0): 0.4, (0, 3): 0.9}, jumps={(1, 3): 0.2}
)
LAWS_HERE = {
    "reference": reference(),
    "triangle": TRIANGLE,
    "star": STAR,
    "two classes": GraphLaw.from_masses([5.0, 2.0], {(0, 1): 1.5}, family="band", shape=0.2),
}


@pytest.fixture(params=LAWS_HERE)
def law(request):
    return LAWS_HERE[request.param]


def joint_of(chain):
    return chain.initial[:, None] * chain.transition


# --------------------------------------------------------------------------- cells


def test_reference_numbers() -> None:
    law = reference()
    np.testing.assert_allclose(law.class_masses, [0.2995098, 0.2882353, 0.1622549], atol=5e-8)
    np.testing.assert_allclose(law.edge_masses, [0.14, 0.11], rtol=1e-12)
    assert law.p_hard == pytest.approx(0.75, abs=1e-12)
    np.testing.assert_allclose(law.harden()[0], [0.29762255, 0.07188725, 0.0], atol=5e-9)
    np.testing.assert_allclose(law.harden(5)[0], [0.29719, 0.07232, 0.0], atol=5e-6)
    np.testing.assert_allclose(law.harden(4), law.harden(), rtol=1e-12)


@pytest.mark.parametrize("F", [0, 1, 4, 5])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize(
    ("other", "family", "pair"),
    [
        (FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), "linear", (0.16, 0.05)),
        (FuzzyMarkovLaw.fmc1(0.3, 0.08, 0.01), "linear", (0.01, 0.08)),
        (FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2), "band", (0.6, 0.2)),
        (FuzzyMarkovLaw.fmc2(0.1, 0.3, 0.47), "band", (0.3, 0.47)),
        (FuzzyMarkovLaw.fmc2(0.12, 3.0, 0.03), "band", (3.0, 0.03)),
    ],
)
def test_two_classes_are_the_laws_of_the_paper(other, family, pair, flip, F) -> None:
    edge = (1, 0) if flip else (0, 1)
    law = GraphLaw(2, [edge], other.corners, family=family, parameters=[pair])
    chain, expected = law.discretize(F), other.discretize(F)
    order = np.array([0, *(range(F + 1, 1, -1) if flip else range(2, F + 2)), 1])
    np.testing.assert_allclose(joint_of(chain)[np.ix_(order, order)], joint_of(expected), atol=1e-13)
    for name in ("nodes", "weights", "initial", "class_weights"):
        np.testing.assert_allclose(getattr(chain, name)[order], getattr(expected, name), atol=1e-13)
    np.testing.assert_allclose(law.harden(), other.harden(), atol=1e-13)
    np.testing.assert_allclose(law.mean_dwell(), other.mean_dwell(), rtol=1e-10)
    assert law.mean_fade() == pytest.approx(other.mean_fade(), rel=1e-10)
    assert law.p_hard == pytest.approx(other.p_hard, abs=1e-13)
    if family == "band":  # what lies off the band is impossible, not 1e-17
        np.testing.assert_array_equal(
            chain.transition[np.ix_(order, order)] == 0.0, expected.transition < 1e-15
        )


def test_corners_of_two_classes_need_not_be_equal() -> None:
    corners = [[0.4, 0.02], [0.02, 0.06]]
    law = GraphLaw(2, [(0, 1)], corners, parameters=[(0.1, 0.1)])
    other = FuzzyMarkovLaw.from_density(corners, 0.1, 0.1)
    order = [0, 2, 3, 4, 1]
    np.testing.assert_allclose(
        law.discretize(3).transition[np.ix_(order, order)], other.discretize(3).transition
    )
    np.testing.assert_allclose(law.class_masses, [0.52, 0.18], rtol=1e-12)


@pytest.mark.parametrize("F", [1, 3, 4])
def test_cells_add_up(law, F) -> None:
    K, E = law.n_classes, len(law.edges)
    fine, coarse = joint_of(law.discretize(4 * F)), joint_of(law.discretize(F))
    to_coarse = np.zeros((len(fine), len(coarse)))
    to_coarse[range(K), range(K)] = 1.0
    to_coarse[K + np.arange(4 * F * E), K + np.arange(4 * F * E) // 4] = 1.0
    np.testing.assert_allclose(to_coarse.T @ fine @ to_coarse, coarse, atol=1e-15)
    np.testing.assert_allclose(coarse, coarse.T, atol=1e-16)
    np.testing.assert_allclose(coarse.sum(axis=1)[:K], law.class_masses, rtol=1e-12)
    np.testing.assert_allclose(coarse.sum(axis=1)[K:].reshape(E, F).sum(axis=1), law.edge_masses, rtol=1e-12)
    assert coarse.sum() == pytest.approx(1.0, abs=1e-14)


def test_crossings_are_integrals() -> None:
    # between the edges (0, 1) and (2, 1), which meet at 1: from the end of one to the end of the other
    F, h = 5, 0.2
    ((kappa, width), (other_kappa, other_width)) = TRIANGLE.crossings.values()
    joint = joint_of(TRIANGLE.discretize(F))
    first, second, third = (3 + e * F + np.arange(F) for e in range(3))

    def area(k, j, w):
        """Of the pairs (u, v) of the k-th and j-th cells from the vertex with u + v <= w."""

        def bound(u):
            return max(min((j + 1) * h, w - u), j * h)

        return dblquad(lambda v, u: 1.0, k * h, (k + 1) * h, j * h, bound, epsabs=1e-10)[0]

    for k in range(3):
        for j in range(3):
            # both edges end at class 1; of the others both begin at class 0
            expected = kappa * area(k, j, width)
            assert joint[first[F - 1 - k], second[F - 1 - j]] == pytest.approx(expected, abs=1e-6)
            expected = other_kappa * area(k, j, other_width)
            assert joint[third[k], first[j]] == pytest.approx(expected, abs=1e-6)
    assert (joint[np.ix_(second, third)] == 0.0).all()
    assert (joint[np.ix_(first, second)] > 0.0).sum() == 3  # .25 reaches into the second cells


def test_a_chain_knows_where_its_nodes_are(law) -> None:
    F, K = 3, law.n_classes
    chain = law.discretize(F)
    assert isinstance(chain, SwitchChain)
    np.testing.assert_array_equal(chain.atoms, np.arange(len(chain)) < K)
    np.testing.assert_allclose(chain.weights, [1.0] * K + [1 / 3] * F * len(law.edges))
    np.testing.assert_array_equal(chain.nodes, chain.class_weights[:, 1] if K == 2 else chain.class_weights)
    for e, (a, b) in enumerate(law.edges):
        for k in range(F):
            expected = np.zeros(K)
            expected[[a, b]] = 1 - (k + 0.5) / F, (k + 0.5) / F
            np.testing.assert_allclose(chain.class_weights[K + e * F + k], expected, atol=1e-15)


# --------------------------------------------------------------------------- masses


def test_a_law_is_made_from_masses() -> None:
    p, m = np.array([3.0, 2.5, 4.0]), np.array([0.9, 0.6, 0.7])
    total = p.sum() + m.sum()
    np.testing.assert_allclose(TRIANGLE.class_masses, p / total, rtol=1e-12)
    np.testing.assert_allclose(TRIANGLE.edge_masses, m / total, rtol=1e-12)
    np.testing.assert_allclose(TRIANGLE.corners[[0, 1, 0], [1, 2, 2]], np.array([0.1, 0.05, 0.0]) / total)
    F = 4
    joint = joint_of(TRIANGLE.discretize(F))
    blocks = [3 + e * F + np.arange(F) for e in range(3)]
    assert joint[np.ix_(blocks[0], blocks[1])].sum() == pytest.approx(0.05 / total, rel=1e-12)
    assert joint[np.ix_(blocks[0], blocks[2])].sum() == pytest.approx(0.03 / total, rel=1e-12)
    # any unit of mass gives the same law
    once, again = (GraphLaw.from_masses(u * np.array([3, 3, 2]), {(0, 1): 1.5 * u}) for u in (1.0, 7.0))
    np.testing.assert_allclose(once.discretize(3).transition, again.discretize(3).transition, atol=1e-15)
    # densities: linear ones with delta / eta, by default 1/2
    for options, ratio in (({}, 0.5), ({"shape": 0.0}, 0.0), ({"shape": 2.0}, 2.0)):
        ((eta, delta),) = GraphLaw.from_masses([3, 3], {(0, 1): 1}, **options).parameters["parameters"]
        assert delta == pytest.approx(ratio * eta)
    ((_, width),) = GraphLaw.from_masses([3, 3], {(0, 1): 1}, family="band").parameters["parameters"]
    assert width == 0.2


def test_how_hard_a_law_has_to_be() -> None:
    # no class stays: 3/8 of linear densities that fall to nothing, 1/3 of the narrowest bands
    eta = 3 / 8
    assert GraphLaw(2, [(0, 1)], np.zeros((2, 2)), parameters=[(eta, 0.0)]).p_hard == pytest.approx(3 / 8)
    w = 1e-6
    law = GraphLaw(2, [(0, 1)], np.zeros((2, 2)), family="band", parameters=[(1 / (w * (6 - w)), w)])
    assert law.p_hard == pytest.approx(1 / 3, abs=1e-6)


def test_a_law_without_edges_is_a_hard_chain() -> None:
    corners = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.2]])
    law = GraphLaw(3, [], corners, parameters=[])
    np.testing.assert_allclose(law.discretize(4).transition, corners / corners.sum(axis=1, keepdims=True))
    np.testing.assert_allclose(law.harden(), corners)
    assert np.isnan(law.mean_fade())
    path = law.sample(500, np.random.default_rng(0))
    assert set(path.max(axis=1)) == {1.0}


# --------------------------------------------------------------------------- samples


def cells_of(law, path, F):
    """Numbers of the nodes of a chain of F cells that values lie in."""
    K = law.n_classes
    u = np.stack([1.0 - path, path], axis=1) if path.ndim == 1 else path
    np.testing.assert_allclose(u.sum(axis=1), 1.0, atol=1e-15)
    numbers = u.argmax(axis=1)
    for e, (a, b) in enumerate(law.edges):
        on = (u[:, a] > 0.0) & (u[:, b] > 0.0)
        numbers[on] = K + e * F + np.minimum((u[on, b] * F).astype(int), F - 1)
    return numbers


@pytest.mark.parametrize("n_nodes", [None, 3])
def test_samples_follow_the_law(law, n_nodes) -> None:
    F, n = 3, 40_000
    chain = law.discretize(F)
    at = cells_of(law, law.sample(n, np.random.default_rng(4), n_nodes), F)
    joint, seen = joint_of(chain), np.zeros((len(chain), len(chain)))
    np.add.at(seen, (at[:-1], at[1:]), 1.0 / (n - 1))
    np.testing.assert_allclose(seen, joint, atol=0.02)
    assert (seen[joint == 0.0] == 0.0).all()
    rows = np.flatnonzero(chain.initial > 0.02)
    assert rows.size > 3
    given_row = seen[rows] / seen[rows].sum(axis=1, keepdims=True)
    np.testing.assert_allclose(given_row, chain.transition[rows], atol=0.05)


def test_first_values_are_stationary() -> None:
    F, n = 4, 3000
    for law in (TRIANGLE, STAR):
        rng = np.random.default_rng(6)
        first = np.concatenate([law.sample(1, rng) for _ in range(n)])
        at = cells_of(law, first, F)
        chain = law.discretize(F)
        seen = np.bincount(at, minlength=len(chain)) / n
        np.testing.assert_allclose(seen, chain.initial, atol=4.5 * np.sqrt(chain.initial.max() / n))


def test_samples_within_cells_follow_finer_cells() -> None:
    # positions on the edges, not only their cells
    F, n = 12, 60_000
    at = cells_of(TRIANGLE, TRIANGLE.sample(n, np.random.default_rng(9)), F)
    seen = np.bincount(at, minlength=3 + 3 * F) / n
    np.testing.assert_allclose(seen[3:], TRIANGLE.discretize(F).initial[3:], atol=0.0025)


# --------------------------------------------------------------------------- symmetries


@st.composite
def graph_laws(draw):
    K = draw(st.integers(2, 4))
    pairs = [(a, b) for b in range(K) for a in range(b)]
    chosen = sorted(draw(st.sets(st.sampled_from(pairs), min_size=1)))
    mass = st.floats(0.01, 0.3)
    family = draw(st.sampled_from(["linear", "band"]))
    crossings = {}
    if family == "band" and len(chosen) > 1 and set(chosen[0]) & set(chosen[1]):
        crossings[chosen[0], chosen[1]] = (
            draw(st.sampled_from([0.0, 0.001, 0.009])),
            draw(st.floats(0.05, 0.5)),
        )
    return GraphLaw.from_masses(
        [draw(st.floats(1.2, 4.0)) for _ in range(K)],
        {edge: draw(mass) for edge in chosen},
        jumps={(0, K - 1): draw(st.sampled_from([0.0, 0.001, 0.1]))},
        family=family,
        shape=draw(st.floats(0.05, 0.5)),
        crossings=crossings,
    )


@settings(max_examples=20, deadline=None)
@given(law=graph_laws(), data=st.data())
def test_other_names_of_the_classes_mirror_everything(law, data) -> None:
    K, F = law.n_classes, data.draw(st.integers(0, 6))
    order = data.draw(st.permutations(range(K)))
    to = np.array(order)
    corners = np.empty((K, K))
    corners[np.ix_(to, to)] = law.corners

    def new(edge):
        return (order[edge[0]], order[edge[1]])

    other = GraphLaw(
        K,
        [new(edge) for edge in law.edges],
        corners,
        family=law.family,
        parameters=law.parameters["parameters"],
        crossings={(new(e), new(f)): value for (e, f), value in law.crossings.items()},
    )
    chain, mirrored = law.discretize(F), other.discretize(F)
    at = np.concatenate([order, np.arange(K, len(chain))])
    np.testing.assert_allclose(mirrored.transition[np.ix_(at, at)], chain.transition, atol=1e-14)
    np.testing.assert_allclose(mirrored.initial[at], chain.initial, atol=1e-14)
    np.testing.assert_array_equal(mirrored.class_weights[np.ix_(at, to)], chain.class_weights)
    np.testing.assert_allclose(other.harden()[np.ix_(to, to)], law.harden(), atol=1e-14)
    np.testing.assert_allclose(other.mean_dwell()[to], law.mean_dwell(), rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(law=graph_laws(), F=st.integers(0, 7))
def test_every_law_is_a_reversible_chain(law, F) -> None:
    chain = law.discretize(F)
    joint = joint_of(chain)
    assert (joint >= 0.0).all()
    np.testing.assert_allclose(joint, joint.T, atol=1e-15)
    np.testing.assert_allclose(chain.initial @ chain.transition, chain.initial, atol=1e-14)
    if law.family == "band" and F:  # what is impossible is zero, and not what rounding leaves of it
        distance = np.abs(np.subtract.outer(range(F), range(F)))
        for e, (_, width) in enumerate(law.parameters["parameters"]):
            at = law.n_classes + e * F + np.arange(F)
            off = (distance - 1) / F >= width - 1e-13
            np.testing.assert_array_equal(joint[np.ix_(at, at)] == 0.0, off)


# --------------------------------------------------------------------------- values, files, errors


def test_files_copies_and_reprs(law) -> None:
    again = LAWS["graph"].from_dict(json.loads(json.dumps(law.to_dict())))
    for one in (again, pickle.loads(pickle.dumps(law))):
        assert one.to_dict() == law.to_dict()
        np.testing.assert_array_equal(one.discretize(3).transition, law.discretize(3).transition)
    for change in (lambda: law.corners.fill(0.0), lambda: law.class_masses.fill(0.0)):
        with pytest.raises(ValueError, match="read-only"):
            change()
    assert repr(law).startswith(f"GraphLaw({law.n_classes}, [(0, 1)")
    assert ("crossings of 2 pairs" in repr(law)) == (law is TRIANGLE)


ONE = [[0.2, 0.1], [0.1, 0.2]]
PATH = {"n_classes": 3, "edges": [(0, 1), (1, 2)], "corners": np.eye(3) / 3}
BAND = PATH | {"family": "band", "parameters": [(0.1, 0.2), (0.1, 0.2)]}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_classes": 1}, "n_classes: got 1, expected a whole number of at least 2"),
        ({"edges": 3}, "edges: got 3, expected a list of pairs"),
        (
            {"edges": [(0, 1), (0, 3)]},
            r"edges: got \(0, 3\), expected a pair \(a, b\) of different classes among 0 to",
        ),
        ({"edges": [(0, 1), (1, 0)]}, "edges: got the edge between 1 and 0 twice, expected each edge once"),
        ({"corners": np.eye(2) / 2}, r"corners: got shape \(2, 2\), expected \(3, 3\)"),
        ({"corners": np.eye(3) - 0.1}, "corners: got -0.1, expected masses, which are not negative"),
        (
            {"corners": np.triu(np.ones((3, 3)))},
            r"corners: got 1 at \(0, 1\) and 0 at \(1, 0\), expected a symmetric",
        ),
        ({"family": "fmc1"}, "family: got 'fmc1', expected 'linear' or 'band'"),
        (
            {"parameters": [(0.1, 0.2)]},
            r"parameters: got an array of shape \(1, 2\), expected a pair \(gamma, width\)",
        ),
        ({"parameters": (0.1, 0.2)}, r"parameters: got an array of shape \(2,\), .* for each of 2 edges"),
        ({"parameters": "many"}, "parameters: expected an array of numbers, got"),
        ({"parameters": [(np.nan, 0.2)] * 2}, r"parameters: entry \(0, 0\) is nan"),
        (
            {"parameters": [(0.1, 0.2), (-0.1, 0.2)]},
            r"parameters, edge \(1, 2\), gamma: got -0.1, expected a density",
        ),
        (
            {"parameters": [(0.1, 0.6), (0.1, 0.2)]},
            r"parameters, edge \(0, 1\), width: got 0.6, .* in \]0, 0.5\]",
        ),
        (
            {"parameters": [(0.1, 0.0), (0.1, 0.2)]},
            r"edge \(0, 1\), width: got 0, expected a half width in \]0, 0.5\]",
        ),
        (
            {"family": "linear", "parameters": [(0.1, 0.2), (0.1, -0.2)]},
            r"parameters, edge \(1, 2\), delta: got -0.2, expected a density, which is not negative",
        ),
        ({}, r"sum to 1.232 \(corners 1, edges 0.232\), expected 1; GraphLaw.from_masses normalises"),
        (
            {"crossings": {((0, 1), (1, 2)): (0.5, 0.2)}},
            r"sum to 1.252 \(corners 1, edges 0.232, crossings 0.02\), expected 1",
        ),
        ({"crossings": [1]}, r"crossings: got \[1\], expected a mapping"),
        ({"crossings": {(0, 1): (0.1, 0.2)}}, r"crossings\[\(0, 1\)\]: got 0, expected a pair \(a, b\)"),
        ({"crossings": {3: (0.1, 0.2)}}, r"crossings: got 3, expected a pair of edges"),
        (
            {"crossings": {((0, 1), (0, 2)): (0.1, 0.2)}},
            r"\(0, 2\) is none of the edges \[\(0, 1\), \(1, 2\)\]",
        ),
        ({"crossings": {((0, 1), (1, 0)): (0.1, 0.2)}}, "twice, or an edge and itself, expected two edges"),
        ({"crossings": {((0, 1), (1, 2)): 0.1}}, "got 0.1, expected a pair of numbers, the second a width"),
        ({"crossings": {((0, 1), (1, 2)): (-0.1, 0.2)}}, "kappa: got -0.1, expected a density"),
        (
            {"crossings": {((0, 1), (1, 2)): (0.1, 0.7)}},
            r"width: got 0.7, expected a half width in \]0, 0.5\]",
        ),
        (
            {"family": "linear", "crossings": {((0, 1), (1, 2)): (0.1, 0.2)}},
            "expected none for the family 'linear', only for 'band'",
        ),
    ],
)
def test_what_is_wrong_is_said(arguments, message) -> None:
    with pytest.raises((ParameterError, ShapeError), match=message):
        GraphLaw(**(BAND | arguments))


def test_edges_without_a_common_class_do_not_cross() -> None:
    with pytest.raises(ParameterError, match="expected edges with a class in common, past which"):
        GraphLaw(
            4,
            [(0, 1), (2, 3)],
            np.eye(4) / 4,
            family="band",
            parameters=[(0.1, 0.2)] * 2,
            crossings={((0, 1), (2, 3)): (0.1, 0.2)},
        )


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (([1.0], {}), {}, "vertices, their number: got 1, expected a whole number of at least 2"),
        (([1.0, -1.0], {}), {}, "vertices: got -1, expected masses"),
        (([0.0, 0.0], {}), {}, "vertices, edges: got masses that sum to 0, expected a positive sum"),
        (([1, 1], [(0, 1)]), {}, r"edges: got \[\(0, 1\)\], expected a mapping \{\(a, b\): mass\}"),
        (([1, 1], {(0, 1): -1}), {}, r"edges\[\(0, 1\)\]: got -1, expected a mass, which is not negative"),
        (([1, 1], {(0, 1): 1, (1, 0): 1}), {}, "edges: got the edge between 1 and 0 twice"),
        (([1, 1], {(0, 1): 1}), {"jumps": {(0, 1): np.inf}}, r"jumps\[\(0, 1\)\]: got inf, expected a mass"),
        (
            ([1, 1], {(0, 1): 1}),
            {"jumps": {(0, 1): 0.1, (1, 0): 0.1}},
            "jumps: got those between 1 and 0 twice",
        ),
        (([1, 1], {(0, 1): 1}), {"family": "wide"}, "family: got 'wide', expected 'linear' or 'band'"),
        (([1, 1], {(0, 1): 1}), {"shape": -1}, "shape: got -1, expected delta / eta, which is not negative"),
        (
            ([1, 1], {(0, 1): 1}),
            {"shape": 1, "family": "band"},
            r"shape, width: got 1, expected a half width",
        ),
        (
            ([1.0, 0.1], {(0, 1): 1.0}),
            {},
            "vertices: got a mass of 0.1 for class 1, expected at least 0.321429, which leaves it in a step",
        ),
        (
            ([3, 3, 3], {(0, 1): 0.1, (1, 2): 0.4}),
            {"family": "band", "crossings": {((0, 1), (1, 2)): (0.2, 0.3)}},
            r"edges\[\(0, 1\)\]: got a mass of 0.1, expected at least 0.2, which crosses from it to other",
        ),
    ],
)
def test_masses_that_are_no_law(arguments, options, message) -> None:
    with pytest.raises((ParameterError, ShapeError), match=message):
        GraphLaw.from_masses(*arguments, **options)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda law: law.discretize(-1), "n_nodes: got -1, expected a whole number of at least 0"),
        (
            lambda law: law.discretize(400),
            "n_nodes: got 400 for each of 3 edges or fades, expected at most 333",
        ),
        (
            lambda law: law.discretize(3, "gauss"),
            "rule: got 'gauss', expected 'cell', the one rule of laws on graphs",
        ),
        (lambda law: law.sample(3, 0), "rng: got int, expected a numpy.random.Generator"),
        (lambda law: law.sample(-1, np.random.default_rng(0)), "n: got -1"),
    ],
)
def test_what_a_law_is_asked_wrongly(call, message) -> None:
    with pytest.raises(ParameterError, match=message):
        call(TRIANGLE)
