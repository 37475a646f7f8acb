"""A method of one's own: three functions are enough for all verbs but `smooth`."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.switching import EXACT, Method, Mixture, SwitchingFilter
from fuzzykf.switching.inference.series import SHOWN
from fuzzykf.testing import check_filter
from fuzzykf.testing.case import Case


class Plain(Method):
    """What EXACT does, without its whole series."""

    def first(self, law, y):
        return EXACT.first(law, y)

    def advance(self, tables, mixture, y, width):
        return EXACT.advance(tables, mixture, y, width)

    def ahead(self, tables, mixture):
        return EXACT.ahead(tables, mixture)


@pytest.fixture(params=["fuzzy", "signed", "pair", "order 3"])
def model(request, fuzzy_model, hard_model, make_transitions):
    from fuzzykf import CGOMSModel

    if request.param == "fuzzy":
        return fuzzy_model.placed(3)
    if request.param == "signed":
        return fuzzy_model.placed(5, rule="product")
    if request.param == "pair":  # two observations at a time
        A, Q, means, Sigma = make_transitions(2, 1, 2, seed=3)
        return CGOMSModel.from_transitions([[0.8, 0.2], [0.3, 0.7]], A, Q, means, Sigma, 1).placed()
    scalars = [[[0.9]], [[0.5]]], [[[1.0]], [[0.7]]], [[[0.4]], [[1.0]]], [[[0.5]], [[0.8]]]
    return CGOMSModel.from_cglssm([[0.9, 0.1], [0.2, 0.8]], *scalars, order=3).placed()


@pytest.fixture
def ys(model):
    return np.random.default_rng(4).normal(size=(30, model.dim_z))


@pytest.mark.parametrize("missing", [False, True])
def test_step_by_step_is_what_the_engine_does_at_once(model, ys, missing) -> None:
    if missing:
        ys[[0, 7, 8, 20]] = np.nan
    plain, exact = SwitchingFilter(model, Plain()).filter(ys), SwitchingFilter(model).filter(ys)
    for name in SHOWN:
        np.testing.assert_allclose(
            getattr(plain, name), getattr(exact, name), rtol=1e-9, atol=1e-9, err_msg=name
        )


def test_many_series_step_by_step(model, ys) -> None:
    many = np.stack([ys, 2.0 * ys, ys[::-1]])
    plain, exact = (SwitchingFilter(model, how).filter_many(many, SHOWN) for how in (Plain(), EXACT))
    for name in SHOWN:
        np.testing.assert_allclose(
            getattr(plain, name), getattr(exact, name), rtol=1e-9, atol=1e-9, err_msg=name
        )


def test_the_verbs_go_on_after_a_series(model, ys) -> None:
    f = SwitchingFilter(model, Plain())
    f.filter(ys[:20])
    g = SwitchingFilter(model)
    g.filter(ys[:20])
    np.testing.assert_allclose(f.forecast(3).S, g.forecast(3).S, rtol=1e-9)
    np.testing.assert_allclose(f.step(ys[20]), g.step(ys[20]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(pickle.loads(pickle.dumps(f)).P, g.P, rtol=1e-9)


def test_a_method_without_a_smoother_passes_the_checks_of_filters(fuzzy_model) -> None:
    zs = 0.5 * np.sin(1.3 * np.arange(6))  # as few as will do
    report = check_filter(lambda: SwitchingFilter(fuzzy_model.placed(3), Plain()), zs)
    assert "smooth" in report.not_applicable
    assert Case(lambda: SwitchingFilter(fuzzy_model.placed(3)), zs).why_not("smooth") is None


def test_without_a_smoother_there_is_none(model, ys) -> None:
    with pytest.raises(ParameterError, match="smooth: the method Plain has no smoother"):
        SwitchingFilter(model, Plain()).smooth(ys)


@pytest.mark.parametrize("name", ["first", "advance", "ahead"])
def test_what_a_subclass_of_exact_replaces_is_honoured_by_whole_series(fuzzy_model, name) -> None:
    def shifted(self, *arguments):
        found = getattr(EXACT, name)(*arguments)
        if name == "ahead":
            return found._replace(x=found.x + 0.25)
        mixture, value = found
        table = mixture.table.copy()
        table[1] += 0.25
        return Mixture(table, mixture.window), value

    method = type("Shifted", (type(EXACT),), {name: shifted})()
    system, ys = fuzzy_model.placed(3), [0.3, 1.0, -0.5, 2.0]
    whole = SwitchingFilter(system, method).filter(ys)
    many = SwitchingFilter(system, method).filter_many([ys, ys], ("x", "x_prior"))
    f = SwitchingFilter(system, method)
    for n, z in enumerate(ys):
        f.step(z)
        np.testing.assert_allclose(whole.x[n], f.x[:, 0], rtol=1e-12)
        np.testing.assert_allclose(whole.x_prior[n], f.x_prior[:, 0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(many.x[1], whole.x, rtol=1e-12)
    np.testing.assert_allclose(many.x_prior[1], whole.x_prior, rtol=1e-12, atol=1e-15)
    exact = SwitchingFilter(system).filter(ys)
    assert np.abs(whole.x_prior - exact.x_prior).max() > 0.01
