"""From a law to a chain: each rule against its definition."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.integrate
from numpy.polynomial import Polynomial

from fuzzykf import FuzzyMarkovLaw
from fuzzykf.errors import ParameterError
from fuzzykf.switching.laws.quadrature import RULES, panel_bounds

FMC1 = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
FMC2 = FuzzyMarkovLaw.fmc2(alpha=0.15, gamma=0.6, delta=0.2)


@pytest.mark.parametrize("law", [FMC1, FMC2])
@pytest.mark.parametrize("rule", ["midpoint", "gauss"])
def test_point_rules_by_definition(law, rule):
    F = 8
    chain = law.discretize(F, rule)
    if rule == "midpoint":
        x, w = (np.arange(F) + 0.5) / F, np.full(F, 1 / F)
    else:
        x, w = np.polynomial.legendre.leggauss(F)
        x, w = (x + 1) / 2, w / 2
    np.testing.assert_allclose(chain.nodes, np.r_[0, x, 1], rtol=1e-14)
    np.testing.assert_allclose(chain.weights, np.r_[1, w, 1], rtol=1e-14)
    J = np.array([[W * V * law.joint_density(a, b) for b, V in zip(chain.nodes, chain.weights, strict=True)]
                  for a, W in zip(chain.nodes, chain.weights, strict=True)])  # fmt: skip
    J /= J.sum()
    np.testing.assert_allclose(chain.initial, J.sum(axis=1), rtol=1e-13)
    np.testing.assert_allclose(chain.transition, J / J.sum(axis=1)[:, None], rtol=1e-13)


@pytest.mark.parametrize("n_nodes", [0, 1, 2, 5, 7, 10])
def test_cell_rule_keeps_the_probability_of_the_hard_values(n_nodes):
    for law in (FMC1, FMC2):
        chain = law.discretize(n_nodes, "cell")
        if n_nodes:
            assert chain.initial[[0, -1]].sum() == pytest.approx(law.p_hard, abs=1e-14)
            joint = chain.initial[:, None] * chain.transition
            np.testing.assert_allclose(joint[np.ix_([0, -1], [0, -1])], law.corners, atol=1e-14)
            x, w = chain.nodes[1:-1], chain.weights[1:-1]
            np.testing.assert_allclose(x, (np.arange(n_nodes) + 0.5) / n_nodes)
            np.testing.assert_allclose(w, 1 / n_nodes)


@pytest.mark.parametrize("rule", RULES)
def test_no_nodes_between(rule):
    chain = FMC1.discretize(0, rule)
    np.testing.assert_array_equal(chain.nodes, [0.0, 1.0])
    joint = FMC1.corners / FMC1.corners.sum()
    np.testing.assert_allclose(chain.initial, [0.5, 0.5])
    np.testing.assert_allclose(chain.transition, joint / joint.sum(axis=1)[:, None])


def test_default_is_cell():
    np.testing.assert_array_equal(FMC2.discretize(5).transition, FMC2.discretize(5, "cell").transition)


# --------------------------------------------------------------------------- nodes and the band


def band(delta):
    """FMC2 with a band that has half of the mass."""
    return FuzzyMarkovLaw.fmc2(0.15, 0.5 / (delta * (6.0 - delta)), delta)


@pytest.mark.parametrize("rule", ["midpoint", "gauss"])
@pytest.mark.parametrize("delta", [0.05, 0.1, 0.2, 0.3, 0.45])
def test_nodes_further_apart_than_the_band_are_refused(rule, delta):
    # and no others: allowed chains go from every node to its neighbours
    law, refused = band(delta), []
    for F in range(1, 45):
        gauss = (np.polynomial.legendre.leggauss(F)[0] + 1) / 2
        x = (np.arange(F) + 0.5) / F if rule == "midpoint" else gauss
        spacing = np.diff([0.0, *x, 1.0]).max()
        if spacing > delta + 1e-9:
            refused.append(F)
            with pytest.raises(ParameterError, match=f"n_nodes: got {F} with rule='{rule}', whose") as error:
                law.discretize(F, rule)
            told = re.search(
                r"nodes (\S+) and (\S+) are (\S+) apart, .* only (\S+) wide.*least (\d+) nodes",
                str(error.value),
            )
            left, right, apart, width = (float(v) for v in told.groups()[:4])
            assert right - left == pytest.approx(apart, abs=2e-4)
            assert delta < apart <= spacing * 1.001
            assert width == pytest.approx(delta, rel=1e-3)
            law.discretize(int(told[5]), rule)  # the number that it names is enough
        else:
            chain = law.discretize(F, rule)
            assert (np.diagonal(chain.transition, 1) > 0.0).all()
            assert (np.diagonal(chain.transition, -1) > 0.0).all()
    assert refused


@pytest.mark.parametrize("rule", ["midpoint", "gauss"])
def test_a_band_of_any_density_is_found(rule):
    # by its values: a triangle over the differences, with nothing beyond .25
    def hat(a, b):
        return np.maximum(0.0, 1.0 - 4.0 * np.abs(a - b))

    law = FuzzyMarkovLaw.from_density(
        [[0.2, 0.0], [0.0, 0.2]],
        lambda k, r: 0.8 * hat(k, r),
        lambda a, b: 0.2 / (0.25 - 1 / 48) * hat(a, b),
        kinks=[0.0, 0.25],
    )
    with pytest.raises(ParameterError, match=r"n_nodes: got 3 .*only 0\.25 wide, .*rule='cell', or at least"):
        law.discretize(3, rule)
    law.discretize(12, rule)
    law.discretize(3, "cell")


@pytest.mark.parametrize("rule", ["midpoint", "gauss"])
@pytest.mark.parametrize("F", [1, 2, 3, 9])
def test_laws_that_do_not_move_between_are_not_mistaken_for_bands(rule, F):
    # two halves that the switch does not cross, and laws without fuzzy values: nothing is lost there
    halves = FuzzyMarkovLaw.from_density(
        [[0.2, 0.05], [0.05, 0.2]], 0.0, lambda a, b: np.where((a < 0.5) == (b < 0.5), 1.0, 0.0), kinks=[0.0]
    )
    for law in (halves, FMC1, FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0), FuzzyMarkovLaw.fmc2(0.3, 0.0, 0.2)):
        assert len(law.discretize(F, rule)) == F + 2


def test_the_default_rule_takes_any_number_of_nodes():
    for F in range(12):
        chain = band(0.05).discretize(F)
        assert (np.diagonal(chain.transition, 1) > 0.0).all()


# --------------------------------------------------------------------------- product integration


def test_panels():
    np.testing.assert_array_equal(panel_bounds(FMC1), [0.0, 1.0])
    np.testing.assert_allclose(panel_bounds(FMC2), [0, 0.2, 0.4, 0.6, 0.8, 1], atol=1e-12)
    # {k delta} and {1 - k delta}
    law = FuzzyMarkovLaw.fmc2(0.12, 0.5, 0.17)
    expected = sorted({round(v, 9) for k in range(6) for v in (k * 0.17, 1 - k * 0.17)} | {0.0, 1.0})
    np.testing.assert_allclose(panel_bounds(law), expected, atol=1e-9)


@pytest.mark.parametrize(("law", "F"), [(FMC1, 3), (FMC1, 5), (FMC2, 5), (FMC2, 12)])
def test_product_by_definition(law, F):
    # T_ij = (W_j / W_i) int p(r, r_j) l_i(r) dr / p(r_i) with Lagrange polynomials on the panels
    chain = law.discretize(F, "product")
    bounds = panel_bounds(law)
    T = np.empty((F + 2, F + 2))
    for i, (node, weight) in enumerate(zip(chain.nodes, chain.weights, strict=True)):
        marginal = float(law.marginal_density(node))
        if i in (0, F + 1):
            T[i] = chain.weights * law.joint_density(node, chain.nodes) / marginal
            continue
        panel = np.searchsorted(bounds, node) - 1
        low, high = bounds[panel], bounds[panel + 1]
        others = [x for x in chain.nodes[1:-1] if low < x < high and x != node]
        lagrange = Polynomial.fromroots(others) if others else Polynomial([1.0])
        lagrange = lagrange / lagrange(node)
        for j, (target, W) in enumerate(zip(chain.nodes, chain.weights, strict=True)):
            points = [p for p in (target, target - 0.2, target + 0.2) if low < p < high]
            integral = scipy.integrate.quad(
                lambda r, target=target, lagrange=lagrange: float(law.joint_density(r, target)) * lagrange(r),
                low, high, points=points or None, epsabs=1e-14,
            )[0]  # fmt: skip
            T[i, j] = W / weight * integral / marginal
    if law is FMC1:  # resolved by its nodes: rows sum to one by themselves
        np.testing.assert_allclose(T.sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(chain.transition, T / T.sum(axis=1)[:, None], atol=1e-11)
    pi = chain.weights * law.marginal_density(chain.nodes)
    np.testing.assert_allclose(chain.initial, pi / pi.sum(), rtol=1e-13)


def test_product_counts_nodes_in_total():
    # five panels of equal length share twelve nodes: 3, 3, 2, 2, 2
    chain = FMC2.discretize(12, "product")
    assert len(chain) == 14
    counts, _ = np.histogram(chain.nodes[1:-1], panel_bounds(FMC2))
    assert sorted(counts) == [2, 2, 2, 3, 3]
    assert chain.weights[1:-1].sum() == pytest.approx(1.0, rel=1e-14)
    assert FMC2.discretize(20, "product").is_signed


def test_product_needs_a_node_on_each_panel():
    with pytest.raises(ParameterError, match="n_nodes: got 4, expected at least 5 for the rule 'product'"):
        FMC2.discretize(4, "product")
    assert len(FMC2.discretize(5, "product")) == 7


def test_product_needs_finitely_many_panels():
    law = FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1, kinks=[1e-4 * np.pi])
    with pytest.raises(ParameterError, match="rule: 'product' needs a law whose kinks divide"):
        law.discretize(5, "product")


# --------------------------------------------------------------------------- odd laws, bad input


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    "law",
    [
        FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0),
        FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0),
        FuzzyMarkovLaw.fmc1(0.0, 0.0, 0.0),
        FuzzyMarkovLaw.fmc2(0.3, 0.0, 0.2),
    ],
)
def test_nodes_without_mass(law, rule):
    # rows of nodes that are never reached are still probabilities, and nothing leads there
    chain = law.discretize(6, rule)
    np.testing.assert_allclose(chain.initial[[0, -1]], 0.5)
    assert (chain.initial[1:-1] == 0.0).all()
    np.testing.assert_allclose(chain.transition[1:-1], np.broadcast_to(chain.initial, (6, 8)), atol=1e-15)
    np.testing.assert_allclose(chain.transition.sum(axis=1), 1.0)
    assert (chain.transition[np.ix_([0, -1], range(1, 7))] == 0.0).all()
    np.testing.assert_allclose(chain.transition[np.ix_([0, -1], [0, -1])], 2 * law.corners, atol=1e-15)


def test_a_law_without_mass_on_the_nodes():
    law = FuzzyMarkovLaw.fmc1(0.0, 0.0, 3 / 8)  # beta = 0: with no nodes between nothing is left
    with pytest.raises(ParameterError, match="n_nodes: the law has no mass on the 0 nodes"):
        FuzzyMarkovLaw.from_density([[0.0, 0.0], [0.0, 0.0]], 0.25, 0.0).discretize(0)
    assert law.discretize(1).initial.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("n_nodes", [-1, 1.5, True, None, np.nan, np.inf, "five", [5]])
def test_bad_n_nodes(n_nodes):
    with pytest.raises(ParameterError, match=r"n_nodes: got .*, expected a whole number of at least 0"):
        FMC1.discretize(n_nodes)


@pytest.mark.parametrize("n_nodes", [3, 3.0, np.int64(3), np.float32(3)])
def test_whole_numbers_of_any_type(n_nodes):
    assert len(FMC1.discretize(n_nodes)) == 5


def test_bad_rule():
    with pytest.raises(
        ParameterError, match="rule: got 'simpson', expected one of 'cell', 'midpoint', 'gauss', 'product'"
    ):
        FMC1.discretize(5, "simpson")
