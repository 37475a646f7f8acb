"""T-norms and conorms obey their axioms; costs are another scale for the same thing."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf.errors import ParameterError
from fuzzykf.possibility.norms import (
    BOUNDED_SUM,
    HAMACHER,
    LUKASIEWICZ,
    MAX,
    MIN,
    PROBABILISTIC_SUM,
    PRODUCT,
    TConorm,
    TNorm,
    as_t_conorm,
    as_t_norm,
)

NORMS = [PRODUCT, MIN, LUKASIEWICZ, HAMACHER]
SCALES = ("log", "reciprocal", "complement")
#: The same, and every other that can be made, under names that say nothing.
OWN = [
    TNorm("mine", scale, additive, None)
    for scale in ("log", "reciprocal", "complement")
    for additive in (1, 0)
]
unit = st.floats(0.0, 1.0)


@pytest.mark.parametrize("norm", [*NORMS, *OWN], ids=lambda n: f"{n.name}-{n.scale}-{n.additive}")
@given(a=unit, b=unit, c=unit)
@settings(max_examples=25, deadline=None)
def test_axioms(norm, a, b, c):
    # commutative, associative, neutral element 1, monotone: the definition of a t-norm
    assert norm(a, b) == pytest.approx(norm(b, a), abs=1e-15)
    assert norm(norm(a, b), c) == pytest.approx(norm(a, norm(b, c)), abs=1e-12)
    assert norm(a, b, c) == pytest.approx(norm(norm(a, b), c), abs=1e-15)
    assert norm(a, 1.0) == pytest.approx(a, abs=1e-15)
    assert norm(a, min(b, c)) <= norm(a, max(b, c)) + 1e-15
    assert 0.0 <= norm(a, b) <= min(a, b) + 1e-15


@pytest.mark.parametrize(
    ("norm", "value"),
    [(PRODUCT, 0.3), (MIN, 0.5), (LUKASIEWICZ, 0.1), (HAMACHER, 0.3 / 0.8)],
    ids=lambda v: getattr(v, "name", ""),
)
def test_textbook_values(norm, value):
    assert norm(0.5, 0.6) == pytest.approx(value)
    assert norm(0.0, 0.0) == 0.0


@pytest.mark.parametrize("norm", [*NORMS, *OWN], ids=lambda n: f"{n.name}-{n.scale}-{n.additive}")
@given(values=st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=4))
@settings(max_examples=25, deadline=None)
def test_costs_combine(norm, values):
    # T(a, b, ...) = g^-1(g(a) + g(b) + ...), the definition of an additive generator; else the largest cost
    costs = norm.cost(values)
    assert norm.membership(norm.combine.reduce(costs)) == pytest.approx(norm(*values), abs=1e-12)
    assert norm.membership(sum(costs) if norm.additive else max(costs)) == pytest.approx(
        norm(*values), abs=1e-12
    )
    assert norm.cost_of_log(-np.log(values)) == pytest.approx(costs, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("norm", [PRODUCT, HAMACHER], ids=lambda n: n.name)
@pytest.mark.parametrize("a", [1e-8, 1e-100, 1e-150])
@pytest.mark.parametrize("b", [1e-9, 0.3, 1.0])
def test_tiny_memberships_are_those_of_the_generator(norm, a, b):
    # relative to themselves: sums of -log lose eps * |log|
    assert norm.membership(norm.cost(a) + norm.cost(b)) == pytest.approx(norm(a, b), rel=1e-12, abs=0.0)


def test_hamacher_neither_underflows_nor_loses_the_neutral_element():
    assert HAMACHER(1e-200, 1e-200) == pytest.approx(5e-201, rel=1e-12, abs=0.0)
    assert HAMACHER(0.1, 1.0) == HAMACHER(1.0, 0.1) == 0.1
    assert HAMACHER(0.0, 1e-300) == 0.0


@pytest.mark.parametrize("norm", [*NORMS, *OWN], ids=lambda n: f"{n.name}-{n.scale}-{n.additive}")
def test_closed_forms_are_exact(norm):
    # by their own algebra, not by logarithms: 0, 1 and ties come out to the bit
    values = np.array([0.0, 0.1, 0.3, 1 / 3, 0.7, 1.0])
    np.testing.assert_array_equal(norm(values, 0.0), np.zeros(6))
    if norm.scale == "complement" and norm.additive:
        np.testing.assert_array_equal(
            norm(values, values[::-1]), np.maximum(0.0, values + values[::-1] - 1.0)
        )
    else:
        np.testing.assert_array_equal(norm(values, 1.0), values)
    if not norm.additive:
        np.testing.assert_array_equal(norm(values, values[::-1]), np.minimum(values, values[::-1]))
    elif norm.scale == "log":
        np.testing.assert_array_equal(norm(values, values[::-1]), values * values[::-1])


@pytest.mark.parametrize("norm", NORMS, ids=lambda n: n.name)
def test_a_name_means_nothing(norm):
    own = TNorm("mine", norm.scale, norm.additive, norm.family)
    values = np.linspace(0.0, 1.0, 7)
    np.testing.assert_array_equal(own(values[:, None], values), norm(values[:, None], values))
    assert TNorm("mine", "log", True, "gaussian")(0.5, 0.5) == 0.25
    assert TNorm("min", "reciprocal", True, "cauchy")(0.5, 0.5) == HAMACHER(0.5, 0.5)


def test_norms_that_contradict_themselves_are_refused():
    with pytest.raises(ParameterError, match=r"scale: got 'root', expected one of 'log', 'reciprocal', "):
        TNorm("mine", "root", True, None)
    with pytest.raises(ParameterError, match=r"family: got 'cauchy', expected 'gaussian' or None with"):
        TNorm("mine", "log", True, "cauchy")
    with pytest.raises(ParameterError, match=r"family: got 'gaussian', expected None with scale"):
        TNorm("mine", "log", False, "gaussian")


def test_minimum_has_no_generator_but_a_scale():
    assert MIN.generator is None
    assert MIN.membership(MIN.combine(MIN.cost(0.4), MIN.cost(0.7))) == pytest.approx(0.4)


@pytest.mark.parametrize("norm", NORMS, ids=lambda n: n.name)
@given(best=st.floats(0.05, 1.0), part=st.floats(0.1, 1.0))
@settings(max_examples=25, deadline=None)
def test_renormalise_divides_by_the_peak(norm, best, part):
    cost = norm.renormalise(norm.cost(best * part), float(norm.cost(best)))
    assert norm.membership(cost) == pytest.approx(part, abs=1e-12)


@pytest.mark.parametrize("norm", NORMS, ids=lambda n: n.name)
def test_zero_membership_is_impossible(norm):
    assert norm.cost(0.0) == norm.impossible
    assert norm.membership(norm.impossible) == 0.0


def test_conorms():
    assert MAX([0.2, 0.7, 0.4]) == 0.7
    assert PROBABILISTIC_SUM([0.2, 0.5]) == pytest.approx(0.2 + 0.5 - 0.1)
    assert BOUNDED_SUM([0.2, 0.5]) == pytest.approx(0.7)
    assert BOUNDED_SUM([0.8, 0.5]) == 1.0
    np.testing.assert_allclose(MAX([[0.2, 0.7], [0.4, 0.1]], axis=0), [0.4, 0.7])


CONORMS = [MAX, PROBABILISTIC_SUM, BOUNDED_SUM, TConorm("mine", False, HAMACHER)]


@pytest.mark.parametrize("conorm", CONORMS, ids=lambda n: n.name)
@given(values=st.lists(st.lists(unit, min_size=3, max_size=3), min_size=1, max_size=4))
@settings(max_examples=25, deadline=None)
def test_conorms_are_the_duals(conorm, values):
    # S(a, b, ...) = 1 - T(1 - a, 1 - b, ...)
    rows = np.array(values)
    np.testing.assert_allclose(conorm(rows, axis=0), 1.0 - conorm.dual(*(1.0 - rows)), rtol=0.0, atol=1e-12)
    assert conorm(rows) == pytest.approx(1.0 - conorm.dual(*(1.0 - rows.ravel())), abs=1e-12)


def test_a_conorm_of_another_name_needs_its_dual():
    with pytest.raises(ParameterError, match=r"dual: got None for 'mine', expected the t-norm of this"):
        TConorm("mine", False)
    values = [0.25, 0.5]
    assert TConorm("mine", True, MIN)(values) == 0.5
    assert TConorm("mine", False, PRODUCT)(values) == 0.625
    assert TConorm("mine", False, LUKASIEWICZ)(values) == 0.75
    assert TConorm("mine", False, HAMACHER)(values) == pytest.approx((0.75 - 0.25) / (1 - 0.125))
    assert TConorm("mine", False, HAMACHER)([0.5, 1.0]) == 1.0
    assert TConorm("max", True) == MAX


def test_bounded_sum_is_not_the_printed_formula():
    # (8) is printed max{1, x_1, ..}, which would be 1 whatever the arguments
    assert BOUNDED_SUM([0.1, 0.1]) == pytest.approx(0.2)


def test_sums_saturate_under_refinement():
    # the reason for refusing them on a continuum: the same set, sampled ever finer, tends to 1
    values = [PROBABILISTIC_SUM(np.full(n, 0.1)) for n in (1, 10, 100)]
    assert values == sorted(values)
    assert values[-1] > 0.9999


@pytest.mark.parametrize("conorm", ["probabilistic_sum", "bounded_sum", BOUNDED_SUM])
def test_sums_are_refused_on_a_continuum(conorm):
    with pytest.raises(ParameterError, match="no limit on a continuum"):
        as_t_conorm(conorm, continuum=True)
    assert not as_t_conorm(conorm).has_continuum_limit


def test_unknown_names_are_refused():
    with pytest.raises(ParameterError, match=r"t_norm: got 'sum', expected one of 'product'"):
        as_t_norm("sum")
    with pytest.raises(ParameterError, match=r"t_conorm: got 'min', expected 'max'"):
        as_t_conorm("min")


@pytest.mark.parametrize("bad", [-0.1, 1.1, np.nan])
def test_values_outside_the_unit_interval_are_refused(bad):
    with pytest.raises(ParameterError, match=r"expected values in \[0, 1\]"):
        PRODUCT(bad, 0.5)
    with pytest.raises(ParameterError, match=r"expected values in \[0, 1\]"):
        MAX([bad, 0.5])


def test_copies_are_the_same_norm():
    # an estimator that was copied or pickled must go on recognising its norm
    for norm in [*NORMS, *CONORMS]:
        assert copy.deepcopy(norm) == norm == pickle.loads(pickle.dumps(norm))
