"""Dynamics with inputs and features: pairs, the switch, files, simulation, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw, KnownSwitchFilter
from fuzzykf.errors import NumericalRangeError, ParameterError, ShapeError
from fuzzykf.switching import SwitchingFilter
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.switching.dynamics.tilt import log_totals, tilted_transition

TRANSITION = [[0.8, 0.2], [0.3, 0.7]]
EVERYTHING = WindowFeatures(order=2, blocks=(2,), hinges=[[-0.5, 0.5]], products=True)


def covariance(rng, *shape):
    a = 0.4 * rng.normal(size=(*shape, shape[-1]))
    return a @ np.swapaxes(a, -1, -2) + 0.3 * np.eye(shape[-1])


def parameters(features, m=1, q=1, k=2, *, tilt=True, seed=0, K=2):
    rng = np.random.default_rng(seed)
    width = sum(features.sizes(q, k))
    return {
        "By": 0.4 * rng.normal(size=(K, K, q, width)),
        "Bx": 0.5 * rng.normal(size=(K, K, m, width)),
        "features": features,
        "inputs": [f"in{j}" for j in range(k)],
        "tilt": rng.normal(size=(K, k)) if tilt else None,
        "centre": rng.normal(size=k) if tilt else None,
        "Ayy": 0.4 * rng.normal(size=(K, K, q, q)),
        "Ny": rng.normal(size=(K, K, q)),
        "Qyy": covariance(rng, K, K, q),
        "Axx": 0.4 * rng.normal(size=(K, K, m, m)),
        "H": rng.normal(size=(K, K, m, q)),
        "G": rng.normal(size=(K, K, m, q)),
        "c": rng.normal(size=(K, K, m)),
        "C": covariance(rng, K, K, m),
        "means": rng.normal(size=(K, m + q)),
        "covariances": covariance(rng, K, m + q),
    }


def hard(features=EVERYTHING, **options):
    return CGOMSModel._from_form(TRANSITION, InputForm(**parameters(features, **options)), [0.4, 0.6])


def fuzzy(features=EVERYTHING, **options):
    law = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return CGOFMSModel._from_form(law, InputForm(**parameters(features, **options)))


# ---------------------------------------------------------------- pairs


def test_means_of_a_step_are_those_of_plain_sums():
    given = parameters(EVERYTHING, m=2)
    system = fuzzy(m=2).placed(2)
    rng = np.random.default_rng(1)
    past, u, new = rng.normal(size=(EVERYTHING.n_past, 1)), rng.normal(size=2), rng.normal(size=1)
    tables = system.driven_tables(past, np.zeros(1), u)
    window = tables.window(past[0], new)
    common = [*u, past[1, 0], (past[2, 0] + past[3, 0]) / 2]
    before, after = ([max(y + 0.5, 0.0), max(y - 0.5, 0.0), u[0] * y, u[1] * y] for y in (past[0, 0], new[0]))
    shares = system.chain.class_weights
    for i, j in ((0, 0), (1, 3), (3, 2)):
        mean_y, mean_x = np.zeros(1), np.zeros(2)
        for a in range(2):
            for b in range(2):
                weight = shares[i, a] * shares[j, b]
                mean_y += weight * (given["Ayy"][a, b] @ past[0] + given["Ny"][a, b])
                mean_y += weight * given["By"][a, b] @ [*common, *before]
                mean_x += weight * (given["H"][a, b] @ past[0] + given["G"][a, b] @ new + given["c"][a, b])
                mean_x += weight * given["Bx"][a, b] @ [*common, *after]
        got = tables.pairs.Ayy[i, j] @ window + tables.pairs.Ny[i, j]
        np.testing.assert_allclose(got, mean_y, atol=1e-13)
        got = tables.pairs.H[i, j] @ window + tables.pairs.G[i, j] @ new + tables.pairs.c[i, j]
        np.testing.assert_allclose(got, mean_x, atol=1e-13)


# ---------------------------------------------------------------- inputs that act on the switch


@pytest.mark.parametrize("make", [hard, fuzzy])
def test_at_the_centre_the_switch_has_the_law_of_the_model(make):
    system = make().placed()
    np.testing.assert_allclose(system.at(system.form.centre).transition, system.chain.transition, rtol=1e-14)


def test_inputs_weight_the_nodes_that_are_reached():
    system = fuzzy().placed(3)
    u, shares = np.array([0.7, -1.2]), system.chain.class_weights
    got = system.at(u).transition
    for i, row in enumerate(system.chain.transition):
        push = [np.exp(shares[j] @ system.form.tilt @ (u - system.form.centre)) for j in range(5)]
        np.testing.assert_allclose(got[i], row * push / (row @ push), rtol=1e-13)
    np.testing.assert_allclose(got.sum(axis=1), 1.0, rtol=1e-15)


def test_a_node_that_cannot_be_reached_takes_nothing_from_the_others():
    # against the weight of node 2, to which nothing leads, all others are zero in double precision
    transition = np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0], [0.25, 0.25, 0.5]])
    weight = np.array([0.0, 1.0, 5000.0])
    odds = np.e / (1.0 + np.e)
    expected = [[1.0 - odds, odds, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(tilted_transition(transition, weight), expected, rtol=1e-13)
    totals = [np.log(0.5 + 0.5 * np.e), 0.0, 5000.0 + np.log(0.5)]
    np.testing.assert_allclose(log_totals(transition, weight), totals, rtol=1e-13)
    both = log_totals(transition, np.array([weight, [0.1, 0.2, 0.3]]))
    np.testing.assert_allclose(both[0], totals, rtol=1e-13)
    np.testing.assert_allclose(both[1], np.log(transition @ np.exp([0.1, 0.2, 0.3])), rtol=1e-13)


def test_inputs_beyond_all_numbers_are_refused():
    form = InputForm(**{**parameters(EVERYTHING), "tilt": [[0.0, 0.0], [10.0, 10.0]]})
    f = CGOMSModel._from_form(TRANSITION, form, [0.4, 0.6]).filter()
    f.step(0.0)
    before = f.to_dict()
    with pytest.raises(NumericalRangeError, match=r"inputs: got \[1e\+308, 1e\+308\]"):
        f.step(0.0, [1e308, 1e308])
    assert f.to_dict() == before


# ---------------------------------------------------------------- what is refused


def test_a_known_path_has_no_place_for_inputs():
    with pytest.raises(ParameterError, match=r"model: got one with inputs .*KnownSwitchFilter"):
        KnownSwitchFilter(hard())
    with pytest.raises(ParameterError, match="model: got one with inputs"):
        hard().along(np.zeros(3))


def test_a_plain_switching_filter_refuses_the_system():
    with pytest.raises(ParameterError, match="system: got one with inputs or features"):
        SwitchingFilter(hard().placed())


def test_negative_weights_are_refused():
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    model = CGOFMSModel._from_form(law, InputForm(**parameters(EVERYTHING)))
    assert law.discretize(8, "product").is_signed
    with pytest.raises(ParameterError, match="rule: got one that gives nodes negative weights"):
        model.placed(8, "product")


@pytest.mark.parametrize(
    ("changed", "error", "words"),
    [
        ({"By": np.zeros((2, 2, 1, 3))}, ShapeError, "By: got shape"),
        ({"Bx": np.full((2, 2, 1, 8), np.nan)}, ParameterError, "Bx: .* nan, expected finite"),
        ({"features": 3}, ParameterError, "features: got 3, expected WindowFeatures or a mapping"),
        ({"features": WindowFeatures(hinges=2)}, ParameterError, "features: got .*, expected knots of 1"),
        ({"inputs": "ab"}, ParameterError, "inputs: got 'ab', expected a sequence of names"),
        ({"inputs": ["a", "a"]}, ParameterError, "inputs: got 'a' twice, expected names that differ"),
        ({"tilt": np.zeros((3, 2))}, ShapeError, "tilt: got shape"),
        ({"centre": [np.inf, 0.0]}, ParameterError, "centre: .* inf, expected finite"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(changed, error, words):
    with pytest.raises(error, match=words):
        InputForm(**{**parameters(EVERYTHING), **changed})


# ---------------------------------------------------------------- files


@pytest.mark.parametrize("make", [hard, fuzzy])
@pytest.mark.parametrize("features", [WindowFeatures(), EVERYTHING], ids=repr)
def test_a_model_comes_back_from_its_file(make, features, tmp_path):
    model = make(features)
    model.save(tmp_path / "model.json")
    again = type(model).load(tmp_path / "model.json")
    assert again.form.to_dict() == model.form.to_dict()
    assert again.form.inputs == ("in0", "in1")
    us = np.random.default_rng(2).normal(size=(9, 2))
    ys = np.random.default_rng(3).normal(size=9)
    np.testing.assert_array_equal(again.filter().filter(ys, us=us).x, model.filter().filter(ys, us=us).x)


def test_a_table_of_a_model_names_inputs_and_features():
    table = hard()._repr_html_()
    assert "in0, in1" in table
    assert "WindowFeatures(order=2, blocks=(2,), hinges=2, products=True)" in table


# ---------------------------------------------------------------- simulation


def test_a_simulation_is_that_of_a_plain_loop_with_the_same_numbers():
    model, n = hard(m=2), 40
    given = parameters(EVERYTHING, m=2)
    us = np.random.default_rng(4).normal(size=(n, 2))
    got = model.simulate(n, np.random.default_rng(5), us=us)

    rng = np.random.default_rng(5)
    uniforms, noise = rng.random(n), rng.standard_normal((n, 3))
    P, tilt, centre = np.array(TRANSITION), given["tilt"], given["centre"]
    r = [int(uniforms[0] > 0.4)]
    for k in range(1, n):
        push = np.exp(tilt @ (us[k] - centre)) * P[r[-1]]
        r.append(int(uniforms[k] > push[0] / push.sum()))
    assert got.r.tolist() == r
    np.testing.assert_array_equal(got.r, got.r.astype(int))
    x, y = [got.x[0]], [got.y[0, 0]]  # the first time has no dynamics
    for k in range(1, n):
        lag = [y[max(k - j, 0)] for j in range(1, 5)]
        common = [*us[k], lag[1], (lag[2] + lag[3]) / 2]
        pair = r[k - 1], r[k]

        def own(value, u=us[k]):
            return [max(value + 0.5, 0.0), max(value - 0.5, 0.0), u[0] * value, u[1] * value]

        value = given["Ayy"][*pair, 0, 0] * lag[0] + given["Ny"][*pair, 0]
        value += given["By"][*pair, 0] @ [*common, *own(lag[0])]
        y.append(value + np.sqrt(given["Qyy"][*pair, 0, 0]) * noise[k, 2])
        mean = given["Axx"][*pair] @ got.x[k - 1] + given["H"][*pair, :, 0] * lag[0]
        mean += (
            given["G"][*pair, :, 0] * y[k] + given["c"][*pair] + given["Bx"][*pair] @ [*common, *own(y[k])]
        )
        values, vectors = np.linalg.eigh(given["C"][*pair])  # its symmetric root
        x.append(mean + vectors @ (np.sqrt(values) * (vectors.T @ noise[k, :2])))
    np.testing.assert_allclose(got.y[:, 0], y, rtol=1e-9)
    np.testing.assert_allclose(got.x, x, rtol=1e-9)


@pytest.mark.parametrize("make", [hard, fuzzy])
def test_simulated_data_score_best_under_their_own_inputs(make):
    # us[n] belongs to observation n: inputs that are a step early or late explain less
    model = make(WindowFeatures())
    us = np.random.default_rng(6).normal(size=(200, 2))
    y = model.simulate(200, np.random.default_rng(7), us=us).y
    score = {
        shift: model.filter().filter(y, us=np.roll(us, shift, axis=0)).log_likelihood.sum()
        for shift in (-1, 0, 1)
    }
    assert score[0] > max(score[-1], score[1]) + 20.0


def test_without_an_effect_inputs_leave_the_simulation_as_it_is():
    options = parameters(WindowFeatures(), tilt=False)
    plain = {
        name: options[name]
        for name in options
        if name not in {"By", "Bx", "features", "inputs", "tilt", "centre"}
    }
    options.update(By=0 * options["By"], Bx=0 * options["Bx"])
    model = CGOMSModel._from_form(TRANSITION, InputForm(**options), [0.4, 0.6])
    other = CGOMSModel.from_regressions(TRANSITION, **plain, initial=[0.4, 0.6])
    us = np.random.default_rng(8).normal(size=(20, 2))
    y = other.simulate(20, np.random.default_rng(9)).y
    a, b = model.filter().filter(y, us=us), other.filter().filter(y)
    for name in ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12, atol=1e-12)
    assert (
        model.simulate(20, np.random.default_rng(9), us=us).r.tolist()
        == other.simulate(20, np.random.default_rng(9)).r.tolist()
    )


@pytest.mark.parametrize(
    ("us", "words"),
    [
        (None, "us: missing; the model has the inputs in0, in1"),
        (np.zeros((4, 2)), r"us: got shape \(4, 2\), expected \(5, 2\)"),
        (np.full((5, 2), np.nan), "us: row 1 is .* expected finite"),
    ],
)
def test_simulation_has_to_be_told_inputs(us, words):
    with pytest.raises(ParameterError, match=words):
        hard().simulate(5, np.random.default_rng(0), us=us)
