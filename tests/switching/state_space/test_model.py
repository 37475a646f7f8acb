"""The switching state-space model: parameters in every form, first state, files, and what it refuses."""

from __future__ import annotations

import copy
import pickle

import filterpy.kalman
import numpy as np
import pytest

from fuzzykf import (
    CGLSSM,
    FadeLaw,
    FuzzyMarkovLaw,
    KalmanFilter,
    KnownSwitchFilter,
    SwitchChain,
    SwitchingStateSpace,
    io,
)
from fuzzykf.errors import (
    NotPositiveDefiniteError,
    NotStableError,
    NumericalRangeError,
    ParameterError,
    ShapeError,
)
from fuzzykf.switching import laws

T = [[0.9, 0.1], [0.3, 0.7]]
FADES = FadeLaw.between(40, 10)
FMC1 = FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
RING = FadeLaw(3, {(0, 1): (0.05, 10.0), (1, 2): (0.03, 8.0), (2, 0): (0.06, 6.0)})
LAWS = {"matrix": T, "fades": FADES, "fmc1": FMC1, "chain": FADES.discretize(3)}
LAWS["chain law"] = laws.ChainLaw(LAWS["chain"])

#: Each parameter for two classes, of two states, one observation and one control.
EACH = {
    "F": np.array([[[0.8, 0.3], [0.0, 0.5]], [[0.2, -0.4], [0.1, 0.6]]]),
    "H": np.array([[[1.0, 0.0]], [[0.3, 1.0]]]),
    "Q": np.array([[[0.5, 0.1], [0.1, 0.2]], [[1.0, 0.0], [0.0, 0.0]]]),
    "R": np.array([[[0.3]], [[1.2]]]),
    "b": np.array([[0.1, 0.2], [-0.3, 0.0]]),
    "d": np.array([[0.0], [5.0]]),
    "B": np.array([[[1.0], [0.0]], [[0.0], [2.0]]]),
    "x0": np.array([[1.0, 2.0], [3.0, 4.0]]),
    "P0": np.array([np.eye(2), 2.0 * np.eye(2)]),
}
THREE = {name: value[0] for name, value in EACH.items()}
HALF = np.array([[1.0, 0.0], [0.25, 0.75], [0.0, 1.0]])


def made(law=FADES, **change):
    return SwitchingStateSpace(law, **({**EACH} | change))


# --------------------------------------------------------------------------- forms of parameters


@pytest.mark.parametrize("name", EACH)
@pytest.mark.parametrize("form", ["each", "shared", "function"])
def test_every_parameter_is_shared_or_mixed_or_a_function(name, form):
    mixed = np.einsum("nk,k...->n...", HALF, EACH[name])
    if form == "each":
        given, expected = EACH[name], mixed
    elif form == "shared":
        given, expected = EACH[name][0], np.array([EACH[name][0]] * 3)
    else:
        given, expected = (lambda w: 2.0 * np.tensordot(w, EACH[name], 1)), 2.0 * mixed
    model = made(**{name: given})
    np.testing.assert_allclose(model.form.at(name, HALF), expected, rtol=1e-14)
    # what is given for a class is what it has, to the bit
    np.testing.assert_array_equal(model.form.at(name, HALF[[0, 2]]), expected[[0, 2]])
    system = model.placed(3)
    if name in ("F", "b", "Q", "H", "d", "R"):
        there = getattr(system.tables, name)
        np.testing.assert_array_equal(there, model.form.at(name, system.chain.class_weights))


@pytest.mark.parametrize("name", ["b", "d", "x0"])
def test_vectors_may_be_columns(name):
    column = EACH[name][1][:, None]
    np.testing.assert_array_equal(made(**{name: column}).form.at(name, HALF)[1], EACH[name][1])


@pytest.mark.parametrize("name", ["Q", "R", "P0"])
def test_covariances_are_mixed_in_their_logarithm_if_told_so(name):
    variances = np.array([np.eye(len(EACH[name][0])), 16.0 * np.eye(len(EACH[name][0]))])
    found = made(**{"Q": EACH["Q"][0], name: variances}, mix="log").form.at(name, np.array([0.5, 0.5]))
    np.testing.assert_allclose(found, 4.0 * np.eye(len(found)), rtol=1e-12)


def test_numbers_are_matrices_of_one_row_and_column():
    model = SwitchingStateSpace(T, F=0.9, H=2.0, Q=0.1, R=0.2, b=0.5, d=-1.0)
    found = {name: model.form.at(name, np.array([0.5, 0.5])).tolist() for name in model.form.parameters}
    assert found == {"F": [[0.9]], "b": [0.5], "Q": [[0.1]], "H": [[2.0]], "d": [-1.0], "R": [[0.2]]}
    assert model.dim_u is None


def test_a_function_gets_class_weights_of_its_own():
    def turning(w):
        angle = w[1]
        w[:] = 7.0  # whoever writes into them changes nothing
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    F = made(F=turning).placed(4).tables.F
    np.testing.assert_allclose(np.linalg.det(F), 1.0)  # a rotation at every node, which a mixture is not
    assert (
        np.linalg.det(made(F=np.array([turning(np.eye(2)[k]) for k in range(2)])).placed(4).tables.F[4]) < 0.9
    )


# --------------------------------------------------------------------------- the first state


def test_by_default_the_hard_model_starts_as_the_papers_does():
    matrices = {"A": EACH["F"], "B": EACH["H"], "C": [np.diag([0.5, 1.0])] * 2, "D": [[[0.5]], [[1.0]]]}
    paper = CGLSSM(T, **matrices)
    model = SwitchingStateSpace(T, EACH["F"], EACH["H"], np.diag([0.25, 1.0]), [[[0.25]], [[1.0]]])
    law = model.placed().initial()
    np.testing.assert_allclose(law.probability, paper.initial_probability, rtol=1e-12)
    np.testing.assert_allclose(law.covariance[:, :2, :2], paper.initial_covariance, rtol=1e-11)
    np.testing.assert_array_equal(law.mean, 0.0)


@pytest.mark.parametrize("law", LAWS)
def test_a_stationary_state_stays_as_it_is(law):
    model = made(LAWS[law], x0=None, P0=None)
    system = model.placed(3)
    tables, p = system.tables, system.chain.initial
    mean, P = system.initial().mean[:, :2], system.initial().covariance[:, :2, :2]
    # the moments given each node at the next time, by the law of total covariance
    beta = p[:, None] * tables.transition / p
    second = P + mean[:, :, None] * mean[:, None, :]
    for j in range(len(p)):
        before = np.einsum("i,ia->a", beta[:, j], mean)
        spread = np.einsum("i,iab->ab", beta[:, j], second) - np.outer(before, before)
        np.testing.assert_allclose(tables.F[j] @ before + tables.b[j], mean[j], rtol=1e-9, atol=1e-12)
        expected = tables.F[j] @ spread @ tables.F[j].T + tables.Q[j]
        np.testing.assert_allclose(expected, P[j], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("missing", ["x0", "P0"])
def test_what_is_given_of_the_first_state_stays_and_the_rest_is_stationary(missing):
    both, one = made(x0=None, P0=None).placed(3).initial(), made(**{missing: None}).placed(3).initial()
    given = made().placed(3).initial()
    for name, there in (("x0", one.mean[:, :2]), ("P0", one.covariance[:, :2, :2])):
        expected = both if name == missing else given
        moments = expected.mean[:, :2] if name == "x0" else expected.covariance[:, :2, :2]
        np.testing.assert_allclose(there, moments, rtol=1e-12)


def test_initial_probabilities_are_those_of_the_classes():
    system = made(initial=[0.2, 0.8]).placed(3)
    np.testing.assert_array_equal(system.chain.initial, [0.2, 0.8, *[0.0] * 6])
    np.testing.assert_array_equal(made(T, initial=[0.2, 0.8]).placed().chain.initial, [0.2, 0.8])
    np.testing.assert_array_equal(made(LAWS["chain"], initial=[1, 0]).placed().chain.initial[:2], [1, 0])


def test_between_the_nodes_a_stationary_state_is_that_of_the_nearest():
    model = made(x0=None, P0=None)
    law = model.placed().initial()
    mean, covariance = model.form.state_at(model.class_weights([0.0, 0.12, 1.0]))
    np.testing.assert_allclose(mean[[0, 2]], law.mean[[0, 1], :2], rtol=1e-14)
    np.testing.assert_allclose(covariance[[0, 2]], law.covariance[[0, 1], :2, :2], rtol=1e-14)
    # the cells at .1 of both fades, 0 -> 1 and 1 -> 0, which are equally likely
    there = law.mean[[2, 11], :2]
    np.testing.assert_allclose(mean[1], there.mean(axis=0), rtol=1e-12)
    expected = law.covariance[[2, 11], :2, :2].mean(axis=0) + np.cov(there.T, bias=True)
    np.testing.assert_allclose(covariance[1], expected, rtol=1e-12)


# --------------------------------------------------------------------------- simulation


@pytest.mark.parametrize("law", LAWS)
def test_a_series_without_noise_follows_the_equations(law):
    still = {"Q": np.zeros((2, 2)), "R": [[0.0]], "P0": np.zeros((2, 2))}
    model = made(LAWS[law], **still)
    found = model.simulate(40, np.random.default_rng(4))
    w = model.class_weights(found.r)
    x = np.tensordot(w[0], EACH["x0"], 1)
    for n in range(40):
        F, b, H, d = (np.tensordot(w[n], EACH[name], 1) for name in ("F", "b", "H", "d"))
        x = F @ x + b if n else x
        np.testing.assert_allclose(found.x[n], x, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(found.y[n], H @ x + d, rtol=1e-12, atol=1e-13)
    assert len(np.unique(w[:, 1])) > 1


def test_a_series_depends_on_the_generator_alone_and_begins_as_it_is_told():
    model = made(initial=[0.0, 1.0])
    a, b = (model.simulate(20, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(a.y, b.y)
    assert a.r[0] == 1.0
    assert len(model.simulate(0, np.random.default_rng(0)).x) == 0


def test_the_noise_has_the_covariances_of_the_model():
    # 20,000 draws: ten standard errors of a variance are 10 sqrt(2 / n) = .1 of it
    model = SwitchingStateSpace([[1.0]], np.zeros((2, 2)), np.eye(2), EACH["Q"][0], 0.01 * np.eye(2))
    found = model.simulate(20_000, np.random.default_rng(1))
    np.testing.assert_allclose(np.cov(found.x.T), EACH["Q"][0], atol=0.06)
    np.testing.assert_allclose(np.cov((found.y - found.x).T), 0.01 * np.eye(2), atol=1e-3)


#: Models with controls of every kind.
CONTROLLED = {
    "each": lambda law: made(law),
    "shared": lambda law: made(law, B=[[1.0, 0.0, 2.0], [0.0, -1.0, 0.5]]),
    "function": lambda law: made(law, B=lambda w: [[w[0]], [1.0 + w[1] ** 2]]),
}


@pytest.mark.parametrize("kind", CONTROLLED)
@pytest.mark.parametrize("law", LAWS)
def test_controls_add_what_follows_from_them_along_the_path_and_leave_the_noise(law, kind):
    model, n = CONTROLLED[kind](LAWS[law]), 40
    us = np.random.default_rng(1).normal(size=(n, model.dim_u))
    us[0] = np.nan  # not used
    driven, free = (model.simulate(n, np.random.default_rng(4), us=one) for one in (us, None))
    np.testing.assert_array_equal(driven.r, free.r)
    w = model.class_weights(driven.r)
    x = np.zeros(2)
    for k in range(n):
        F, B, H = (model.form.at(name, w[k]) for name in ("F", "B", "H"))
        x = F @ x + B @ us[k] if k else x
        np.testing.assert_allclose(driven.x[k] - free.x[k], x, atol=1e-12)
        np.testing.assert_allclose(driven.y[k] - free.y[k], H @ x, atol=1e-12)
    assert np.abs(x).max() > 0.01


@pytest.mark.parametrize("law", ["fades", "matrix", "none"])
def test_a_filter_that_is_told_the_controls_is_consistent_on_what_they_moved(law):
    # 1,000 draws of a chi-square of one degree: five standard errors of their mean are 5 sqrt(2 / n) = .22
    n = 1000
    model = made([[1.0]], **{k: v[0] for k, v in EACH.items()}) if law == "none" else made(LAWS[law])
    us = 2.0 * np.sin(0.1 * np.arange(n))
    truth = model.simulate(n, np.random.default_rng(2), us=us)
    w = model.class_weights(truth.r)
    H, d, R = (model.form.at(name, w) for name in ("H", "d", "R"))

    def nis(us):
        found = KnownSwitchFilter(model).filter(truth.y, truth.r, us)
        e = truth.y - (H @ found.x_prior[..., None])[..., 0] - d
        return np.mean(e**2 / (H @ found.P_prior @ np.swapaxes(H, 1, 2) + R)[..., 0])

    assert nis(us) == pytest.approx(1.0, abs=0.22)
    assert nis(None) > 1.5


@pytest.mark.parametrize(
    ("us", "error", "message"),
    [
        (np.zeros((4, 1)), ShapeError, r"us: got shape \(4, 1\), expected \(5, 1\) or \(5,\)"),
        (np.zeros((5, 2)), ShapeError, r"us: got shape \(5, 2\), expected \(5, 1\)"),
        ([0.0, 1.0, np.inf, 0.0, 0.0], ParameterError, r"us: row 2 is \[inf\], expected finite numbers"),
        ("on", ShapeError, "us: expected an array of numbers"),
    ],
)
def test_controls_that_are_refused_draw_nothing(us, error, message):
    rng = np.random.default_rng(0)
    with pytest.raises(error, match=message):
        made().simulate(5, rng, us=us)
    for model in (made(B=None), CGLSSM(T, *([0.5 * np.eye(1)] * 2 for _ in range(4)))):
        with pytest.raises(ParameterError, match=r"us: got .* but the model has no B; expected None"):
            model.simulate(5, rng, us=us)
    assert rng.random() == np.random.default_rng(0).random()


def test_none_in_a_list_of_controls_says_that_none_acts():
    given = made().simulate(4, np.random.default_rng(0), us=[None, 1.0, None, [2.0]])
    same = made().simulate(4, np.random.default_rng(0), us=[5.0, 1.0, 0.0, 2.0])
    np.testing.assert_array_equal(given.y, same.y)


# --------------------------------------------------------------------------- values of the switch


@pytest.mark.parametrize(
    ("law", "values", "expected"),
    [
        (FADES, [0.25, 1.0], [[0.75, 0.25], [0.0, 1.0]]),
        (T, [1, 0], [[0.0, 1.0], [1.0, 0.0]]),
        (RING, [[0.5, 0.5, 0.0], [0.0, 0.0, 1.0]], [[0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]),
        (RING, [2, 0], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        (np.full((3, 3), 1 / 3), [2, 0], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        (SwitchChain([3.0, 7.0], [1, 1], [0.5, 0.5], T, [[0.6, 0.4], [0, 1]]), [7, 3], [[0, 1], [0.6, 0.4]]),
    ],
    ids=["fades", "matrix", "ring", "ring by number", "three regimes", "chain"],
)
def test_values_of_the_switch_are_class_weights(law, values, expected):
    K = np.shape(expected)[1]
    model = SwitchingStateSpace(law, F=0.5 * np.ones((K, 1, 1)), H=1.0, Q=1.0, R=1.0)
    np.testing.assert_allclose(model.class_weights(values), expected)
    assert model.n_classes == K


# --------------------------------------------------------------------------- from filters


def bank(cls, **first):
    filters = []
    for k in range(2):
        f = cls(dim_x=2, dim_z=1)
        for name in ("F", "H", "Q", "R"):
            setattr(f, name, EACH[name][k])
        f.x, f.P = EACH["x0"][k][:, None].copy(), EACH["P0"][k].copy()
        filters.append(f)
    for name, value in first.items():
        setattr(filters[0], name, value)
    return filters


@pytest.mark.parametrize("cls", [KalmanFilter, filterpy.kalman.KalmanFilter])
def test_filters_give_their_matrices_and_are_moved_once(cls):
    filters = bank(cls)
    model = SwitchingStateSpace.from_filters(filters, FADES, initial=[0.5, 0.5])
    for name in ("F", "H", "Q", "R"):
        np.testing.assert_array_equal(model.form.at(name, np.eye(2)), EACH[name])
    for f in filters:
        f.predict()
    np.testing.assert_allclose(model.form.at("x0", np.eye(2)), [f.x.ravel() for f in filters], rtol=1e-14)
    np.testing.assert_allclose(model.form.at("P0", np.eye(2)), [f.P for f in filters], rtol=1e-14)
    assert model.dim_u is None


def test_a_filter_without_controls_is_moved_by_none():
    model = SwitchingStateSpace.from_filters(bank(KalmanFilter, B=np.ones((2, 3))), T)
    np.testing.assert_array_equal(model.form.at("B", np.eye(2)), [np.ones((2, 3)), np.zeros((2, 3))])


def test_flat_states_and_numbers_are_taken_as_filters_take_them():
    filters = [filterpy.kalman.KalmanFilter(1, 1) for _ in range(2)]
    for f in filters:
        f.x, f.F, f.H, f.R, f.P = np.array([2.0]), 0.5, np.array([[1.0]]), 3.0, 4.0
    law = SwitchingStateSpace.from_filters(filters, T).placed().initial()
    np.testing.assert_array_equal(law.mean[:, 0], 1.0)
    np.testing.assert_array_equal(law.covariance[:, 0, 0], 2.0)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        (lambda: bank(KalmanFilter)[:1], r"filters: got \[.*, expected a list of two or more"),
        (lambda: 3, "filters: got 3, expected a list"),
        (lambda: [*bank(KalmanFilter)[:1], object()], r"filters\[1\]: got a object without a matrix F"),
        (lambda: bank(KalmanFilter, alpha=1.1), r"filters\[0\]: got alpha=1.1, expected 1"),
        (lambda: bank(KalmanFilter, F=np.eye(3)), r"filters\[0\].F: got shape \(3, 3\), expected \(2, 2\)"),
        (lambda: bank(filterpy.kalman.KalmanFilter, H=np.full((1, 2), np.nan)), r"filters\[0\].H: entry"),
    ],
)
def test_banks_that_are_refused(filters, message):
    with pytest.raises(ParameterError, match=message):
        SwitchingStateSpace.from_filters(filters(), T)


# --------------------------------------------------------------------------- files and values


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("change", [{}, {"initial": [0.1, 0.9], "B": None}, {"x0": None, "P0": None}])
def test_files_give_it_back_bit_for_bit(law, change, tmp_path):
    model = made(LAWS[law], **change).labelled(states=["a", "b"])
    model.save(tmp_path / "model.json")
    for loaded in (SwitchingStateSpace.load(tmp_path / "model.json"), io.load_model(tmp_path / "model.json")):
        assert loaded.to_dict() == model.to_dict()
        assert type(loaded.law) is type(model.law)
        one, other = model.placed(3), loaded.placed(3)
        for name in ("transition", "F", "b", "Q", "H", "d", "R"):
            np.testing.assert_array_equal(getattr(one.tables, name), getattr(other.tables, name))
        np.testing.assert_array_equal(one.initial().covariance, other.initial().covariance)
        assert loaded.labels.states == ("a", "b")


def test_functions_are_not_written_and_leave_the_file_as_it_was(tmp_path):
    (tmp_path / "model.json").write_text("kept")
    with pytest.raises(ParameterError, match="H: a function cannot be written to a file"):
        made(H=lambda w: EACH["H"][0]).save(tmp_path / "model.json")
    assert (tmp_path / "model.json").read_text() == "kept"


def test_it_never_changes_and_copies_are_itself():
    model = made()
    assert copy.deepcopy(model) is copy.copy(model) is model
    with pytest.raises(AttributeError, match="never changes"):
        model.law = FMC1
    with pytest.raises(ValueError, match="read-only"):
        model.form.parameters["F"].values[:] = 0.0
    twin = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(twin.placed().tables.F, model.placed().tables.F)


def test_it_says_what_it_is():
    assert repr(made(T)) == "SwitchingStateSpace(<2 regimes>, dim_x=2, dim_z=1)"
    assert repr(made(FMC1)) == f"SwitchingStateSpace({FMC1!r}, dim_x=2, dim_z=1)"
    assert "fuzzy switch, law fade" in made()._repr_html_()
    assert "hard switch, a chain on 2 nodes" in made(T)._repr_html_()
    assert made().p_hard == pytest.approx(FADES.p_hard)
    assert made(T).p_hard == pytest.approx(1.0)
    axes = made().plot()
    assert len(axes.lines) == 2


# --------------------------------------------------------------------------- what is refused


def counting():
    calls = iter(range(100))
    return lambda w: np.eye(2) * 0.1 * next(calls)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"law": [[0.9, 0.2], T[1]]}, ParameterError, r"law\[0\]: sums to 1.1"),
        ({"law": np.eye(2)}, ParameterError, "initial: has to be given"),
        ({"law": "fmc1"}, ParameterError, "law: got 'fmc1', expected a law, a SwitchChain or"),
        ({"law": [[1.0, 0.0]]}, ShapeError, r"law: got shape \(1, 2\)"),
        ({"law": RING}, ShapeError, r"F: got 2 of shape \(2, 2\), one for each class, expected 3"),
        ({"initial": [0.5, 0.6]}, ParameterError, "initial: sums to 1.1"),
        ({"initial": [1.0]}, ShapeError, r"initial: got shape \(1,\)"),
        ({"F": np.eye(3)}, ShapeError, r"H: got shape \(2, 1, 2\), expected \(1, 3\)|b: got"),
        ({"F": np.zeros((2, 3))}, ShapeError, r"F: got shape \(2, 3\), expected \(3, 3\)"),
        ({"F": [1.0, 2.0]}, ShapeError, r"F: got shape \(2,\), expected a matrix"),
        ({"F": np.empty((0, 0))}, ShapeError, r"F: got shape \(0, 0\)"),
        ({"H": np.eye(3)}, ShapeError, r"H: got shape \(3, 3\), expected \(3, 2\)"),
        ({"Q": 1.0}, ShapeError, r"Q: got shape \(\), expected \(2, 2\)"),
        ({"Q": [[np.nan, 0], [0, 1]]}, ParameterError, r"Q: entry \(0, 0\) is nan"),
        ({"Q": [[1.0, 0.5], [0.0, 1.0]]}, ParameterError, "Q: expected symmetric"),
        ({"Q": np.diag([1.0, -2.0])}, NotPositiveDefiniteError, "Q: .*the eigenvalue -2"),
        ({"R": [[[1.0]], [[-1.0]]]}, NotPositiveDefiniteError, r"R\[1\]: .*the eigenvalue -1"),
        ({"P0": [np.eye(2), -np.eye(2)]}, NotPositiveDefiniteError, r"P0\[1\]: .*the eigenvalue -1"),
        (
            {"R": lambda w: [[1.0 - 2.0 * w[1]]]},
            NotPositiveDefiniteError,
            r"R at the class weights \(0.\d+, 0.\d+\): .*eigenvalue -|R at the class weights \(0, 1\)",
        ),
        (
            {"Q": EACH["Q"], "mix": "log"},
            NotPositiveDefiniteError,
            "Q: the matrix number 1 is singular",
        ),
        ({"mix": "cubic"}, ParameterError, "mix: got 'cubic', expected 'linear' or 'log'"),
        ({"b": np.zeros(3)}, ShapeError, r"b: got shape \(3,\), expected \(2,\)"),
        ({"d": [0.0, 5.0]}, ShapeError, r"d: got shape \(2,\), expected \(1,\), \(2, 1\) with one for each"),
        ({"B": [1.0, 2.0]}, ShapeError, r"B: got shape \(2,\)"),
        ({"x0": np.zeros((3, 2))}, ShapeError, "x0: got 3 of shape"),
        ({"P0": np.eye(3)}, ShapeError, r"P0: got shape \(3, 3\)"),
        ({"F": lambda w: np.eye(2)[0]}, ShapeError, r"F: got shape \(2,\)"),
        ({"Q": lambda w: np.eye(3)}, ShapeError, r"Q at the class weights \(\d, \d\): got shape \(3, 3\)"),
        (
            {"F": lambda a, b: 0},
            ParameterError,
            r"F at the class weights \(1, 0\): the function raised",
        ),
        ({"Q": lambda a, b: 0}, ParameterError, r"Q at the class weights .*the function raised a TypeError"),
        ({"F": counting()}, ParameterError, "F at the class weights .* when it was called again; expected"),
        ({"F": np.eye(2), "P0": None}, NotStableError, "P0: has to be given, .* by 1 a step"),
        ({"F": 1.1 * np.eye(2), "x0": None}, NotStableError, "x0: has to be given, .* by 1.1 a step"),
        (
            {"law": [[0.5, 0.5], [0.0, 1.0]], "initial": [1.0, 0.0], "x0": None},
            ParameterError,
            "x0: has to be given, since the switch starts at 0, which does not occur in the long run",
        ),
        (
            {"law": np.eye(2), "initial": [0.5, 0.5], "F": np.eye(2), "P0": None},
            NotStableError,
            "P0: has to be given",
        ),
        (
            {"law": SwitchChain([0.5, 0.5], [1, 1], [0.5, 0.5], T, np.eye(2))},
            ParameterError,
            "law: the nodes 0 and 1 have the value 0.5, but not one set of class weights",
        ),
        (
            {"law": SwitchChain([0.2, 0.7], [1, 1], [0.5, 0.5], T), "initial": [1.0, 0.0]},
            ParameterError,
            "initial: got 1 for class 0, of which the law has 0 nodes",
        ),
    ],
)
def test_what_is_refused(change, error, message):
    given = {"law": FADES} | change
    with pytest.raises(error, match=message):
        made(**given)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda model: model.placed(11), "n_nodes: got 11, expected n_nodes=10 at most"),
        (lambda model: model.placed(3, "gauss"), "rule: got 'gauss'"),
        (lambda model: made(T).placed(-1), "n_nodes: got -1"),
        (lambda model: made(T).placed(3, "corner"), "rule: got 'corner'"),
        (lambda model: model.class_weights([0.5, 1.5]), "r: got values from 0.5 to 1.5"),
        (lambda model: made(np.full((3, 3), 1 / 3), **THREE).class_weights([3]), "r: got 3, expected one of"),
        (lambda model: model.simulate(5, 0), "rng: got int"),
        (lambda model: model.simulate(-1, np.random.default_rng(0)), "n: got -1"),
    ],
)
def test_calls_that_are_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call(made())


# --------------------------------------------------------------------------- what was silent


class OwnVerbs(KalmanFilter):
    """A filter whose motion is not that of its matrices alone."""

    def predict(self, *args, **kwargs):
        super().predict(*args, **kwargs)
        self.x = 2.0 * self.x


def member(cls=KalmanFilter, P=1.0):
    f = cls(dim_x=2, dim_z=1)
    f.F, f.H, f.Q, f.R = 0.9 * np.eye(2), np.array([[1.0, 0.0]]), np.eye(2), np.eye(1)
    f.P = P * np.eye(2) if np.ndim(P) == 0 else np.array(P)
    return f


def patched():
    f = member()
    f.update = lambda z: None
    return f


@pytest.mark.parametrize(
    ("filters", "error", "message"),
    [
        (
            lambda: [member(), member(OwnVerbs)],
            ParameterError,
            r"filters\[1\]: got a OwnVerbs with a pr",
        ),
        (
            lambda: [patched(), member()],
            ParameterError,
            r"filters\[0\]: got a KalmanFilter with a",
        ),
        (lambda: [member(), member(P=[[1.0, 0.5], [0.0, 1.0]])], ParameterError, r"filters\[1\]\.P: "),
        (lambda: [member() for _ in range(3)], ParameterError, "filters: got 3, expected 2"),
    ],
)
def test_filters_that_a_model_cannot_stand_for_are_refused(filters, error, message):
    law = FadeLaw.between(20, 5)
    SwitchingStateSpace.from_filters([member(), member()], law)
    with pytest.raises(error, match=message):
        SwitchingStateSpace.from_filters(filters(), law)


def test_an_indefinite_state_of_a_filter_is_named():
    bad = member()
    bad.__dict__["P"] = -np.eye(2)
    with pytest.raises(NotPositiveDefiniteError, match=r"filters\[1\]\.P"):
        SwitchingStateSpace.from_filters([member(), bad], FadeLaw.between(20, 5))


def test_a_simulation_beyond_the_range_of_numbers_says_where():
    grows = SwitchingStateSpace([[1.0]], F=10.0, H=1.0, Q=1.0, R=1.0, x0=[0.0], P0=1.0)
    assert np.isfinite(grows.simulate(300, np.random.default_rng(0)).x).all()
    with pytest.raises(NumericalRangeError, match=r"simulate: observation 3\d\d of 400 is beyond"):
        grows.simulate(400, np.random.default_rng(0))
