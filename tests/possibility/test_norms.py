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
    as_t_conorm,
    as_t_norm,
)

NORMS = [PRODUCT, MIN, LUKASIEWICZ, HAMACHER]
unit = st.floats(0.0, 1.0)


@pytest.mark.parametrize("norm", NORMS, ids=lambda n: n.name)
@given(a=unit, b=unit, c=unit)
@settings(max_examples=50, deadline=None)
def test_axioms(norm, a, b, c):
    # commutative, associative, neutral element 1, monotone: the definition of a t-norm
    assert norm(a, b) == pytest.approx(norm(b, a), abs=1e-15)
    assert norm(norm(a, b), c) == pytest.approx(norm(a, norm(b, c)), abs=1e-12)
    assert norm(a, b, c) == pytest.approx(norm(norm(a, b), c), abs=1e-15)
    assert norm(a, 1.0) == pytest.approx(a, abs=1e-15)
    assert norm(a, min(b, c)) <= norm(a, max(b, c)) + 1e-15


@pytest.mark.parametrize(
    ("norm", "value"),
    [(PRODUCT, 0.3), (MIN, 0.5), (LUKASIEWICZ, 0.1), (HAMACHER, 0.3 / 0.8)],
    ids=lambda v: getattr(v, "name", ""),
)
def test_textbook_values(norm, value):
    assert norm(0.5, 0.6) == pytest.approx(value)
    assert norm(0.0, 0.0) == 0.0


@pytest.mark.parametrize("norm", [PRODUCT, LUKASIEWICZ, HAMACHER], ids=lambda n: n.name)
@given(a=st.floats(1e-6, 1.0), b=st.floats(1e-6, 1.0))
@settings(max_examples=50, deadline=None)
def test_generator_adds(norm, a, b):
    # T(a, b) = g^-1(g(a) + g(b)), the definition of an additive generator
    g = norm.generator
    assert norm.membership(g(a) + g(b)) == pytest.approx(norm(a, b), abs=1e-12)
    assert norm.membership(norm.combine(g(a), g(b))) == pytest.approx(norm(a, b), abs=1e-12)
    assert norm.cost_of_log(-np.log(a)) == pytest.approx(g(a), rel=1e-9, abs=1e-12)


def test_minimum_has_no_generator_but_a_scale():
    assert MIN.generator is None
    assert MIN.membership(MIN.combine(MIN.cost(0.4), MIN.cost(0.7))) == pytest.approx(0.4)


@pytest.mark.parametrize("norm", NORMS, ids=lambda n: n.name)
@given(best=st.floats(0.05, 1.0), part=st.floats(0.1, 1.0))
@settings(max_examples=50, deadline=None)
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
    with pytest.raises(ParameterError, match=r"t_conorm: got 'min', expected one of 'max'"):
        as_t_conorm("min")


@pytest.mark.parametrize("bad", [-0.1, 1.1, np.nan])
def test_values_outside_the_unit_interval_are_refused(bad):
    with pytest.raises(ParameterError, match=r"expected values in \[0, 1\]"):
        PRODUCT(bad, 0.5)
    with pytest.raises(ParameterError, match=r"expected values in \[0, 1\]"):
        MAX([bad, 0.5])


def test_copies_are_the_same_norm():
    # an estimator that was copied or pickled must go on recognising its norm
    for norm in NORMS:
        assert copy.deepcopy(norm) == norm == pickle.loads(pickle.dumps(norm))
