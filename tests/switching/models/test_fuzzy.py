"""The fuzzy model: what is proved at construction, hardening, simulation, value semantics."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError

LAW = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)


def pair_covariances(a=0.8):
    Z = np.array([[1.0, 0.5], [0.5, 1.0]])
    gamma = np.empty((2, 2, 4, 4))
    gamma[:] = np.block([[Z, 0.8 * Z], [0.8 * Z, Z]])
    gamma[..., 0, 2] = gamma[..., 2, 0] = a
    return gamma


MEANS = [[0.0, 3.0], [0.0, 0.0]]


def test_sizes_and_repr(fuzzy_model):
    assert (fuzzy_model.dim_x, fuzzy_model.dim_z, fuzzy_model.n_classes) == (1, 1, 2)
    assert "dim_x=1, dim_z=1, form='covariance'" in repr(fuzzy_model)
    np.testing.assert_allclose(fuzzy_model.class_weights([0.0, 0.25, 1.0]), [[1, 0], [0.75, 0.25], [0, 1]])
    for r in ([-0.1], [1.1], [np.nan]):
        with pytest.raises(ParameterError, match=r"r: got values from .*, expected \[0, 1\]"):
            fuzzy_model.class_weights(r)


def test_indefinite_noise_is_found_at_construction():
    with pytest.raises(
        NotPositiveDefiniteError, match=r"noise covariance of the pair r_n = .*, r_n\+1 = .* -"
    ):
        CGOFMSModel(LAW, MEANS, pair_covariances(a=1.2), 1)


def vine(b, s, c, e, a):
    """Covariances of (X1, Y1, X2, Y2) from partial correlations, definite at every hard pair.

    b: of X and Y; s: standard deviation of X; c: of Y1 and Y2; e: of Y1 and X2 given Y2; a: of
    X1 and X2 given both; that of X1 and Y2 given Y1 is zero.
    """
    gamma = np.empty((2, 2, 4, 4))
    for i in range(2):
        for j in range(2):
            C = np.array([[1.0, c[i][j]], [c[i][j], 1.0]])
            one = np.array([b[i], b[i] * c[i][j]])
            two = np.array([c[i][j] * b[j] + e[i][j] * np.sqrt((1 - c[i][j] ** 2) * (1 - b[j] ** 2)), b[j]])
            free = (1 - one @ np.linalg.solve(C, one)) * (1 - two @ np.linalg.solve(C, two))
            x1x2 = one @ np.linalg.solve(C, two) + a[i][j] * np.sqrt(free)
            correlation = np.eye(4)
            for k, el, value in (
                (0, 1, b[i]), (2, 3, b[j]), (1, 3, c[i][j]), (0, 3, one[1]), (1, 2, two[0]), (0, 2, x1x2)
            ):  # fmt: skip
                correlation[k, el] = correlation[el, k] = value
            sd = np.array([s[i], 1.0, s[j], 1.0])
            gamma[i, j] = correlation * sd[:, None] * sd
    return gamma


def test_indefinite_noise_between_definite_hard_pairs():
    # bilinear interpolation does not keep partial correlations within one: the pairs of hard
    # values pass, a hard model exists, the fuzzy one does not
    gamma = vine(
        b=[0.31, -0.97],
        s=[1.07, 2.87],
        c=[[0.57, -0.88], [-0.57, 0.96]],
        e=[[0.78, -0.29], [-0.24, -0.42]],
        a=[[0.99, 0.99], [-0.99, 0.99]],
    )
    assert (np.linalg.eigvalsh(gamma) > 0).all()
    CGOMSModel([[0.5, 0.5], [0.5, 0.5]], MEANS, gamma, 1, constraint="check")
    with pytest.raises(NotPositiveDefiniteError, match=r"pair r_n = 0\.\d+, r_n\+1 = 1: .* eigenvalue -1\."):
        CGOFMSModel(LAW, MEANS, gamma, 1)


def test_only_pairs_that_occur_are_proved():
    # abrupt changes between the regimes never happen: that pair may be anything
    gamma = pair_covariances()
    gamma[0, 1, 0, 2] = gamma[0, 1, 2, 0] = 1.2
    never = FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0)
    assert never.beta == 0.0
    model = CGOFMSModel(never, MEANS, gamma, 1)
    model.harden()
    with pytest.raises(NotPositiveDefiniteError, match=r"pair r_n = 0, r_n\+1 = 1"):
        CGOFMSModel(FuzzyMarkovLaw.fmc1(0.4, 0.0, 0.0), MEANS, gamma, 1)


@pytest.mark.parametrize("rule", ["cell", "midpoint", "gauss", "product"])
def test_nodes_without_mass_may_be_anything(rule):
    # definite at the hard pairs, not in between; without fuzziness nothing happens in between
    gamma = vine(
        b=[0.31, -0.97],
        s=[1.07, 2.87],
        c=[[0.57, -0.88], [-0.57, 0.96]],
        e=[[0.78, -0.29], [-0.24, -0.42]],
        a=[[0.99, 0.99], [-0.99, 0.99]],
    )
    model = CGOFMSModel(FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0), MEANS, gamma, 1)
    y = model.simulate(300, np.random.default_rng(0)).y
    fuzzy, hard = OFSRFilter(model, 5, rule).filter(y), CGOMSMFilter(model.harden()).filter(y)
    np.testing.assert_allclose(fuzzy.x, hard.x, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(fuzzy.log_likelihood, hard.log_likelihood, rtol=1e-9, atol=1e-11)


def test_first_states_between_singular_and_definite_regimes():
    # known in one regime, not in the other: between them a covariance has no interpolation
    one = np.ones((2, 2, 1, 1))
    p = {"Ayy": one / 2, "Ny": one[..., 0], "Qyy": one, "Axx": one / 2, "H": one, "G": one, "c": one[..., 0]}
    p |= {"C": one, "means": np.zeros((2, 2)), "covariances": [np.diag([0.0, 1.0]), np.eye(2)]}
    with pytest.raises(NotPositiveDefiniteError, match="covariances: the matrix number 0 is singular where"):
        CGOFMSModel.from_regressions(LAW, **p)
    model = CGOFMSModel.from_regressions(FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0), **p)
    assert np.isfinite(OFSRFilter(model, 3).step(1.0)).all()


def test_every_filter_proves_its_own_nodes(monkeypatch):
    # a model may be definite on the grid of the proof and still fail at the nodes of a filter
    gamma = pair_covariances()
    gamma[0, 1, 0, 2] = gamma[0, 1, 2, 0] = 1.2
    monkeypatch.setattr(CGOFMSModel, "_prove_noise", lambda self: None)
    model = CGOFMSModel(LAW, MEANS, gamma, 1)
    message = r"pair of nodes \(0, 4\), r_n = 0 and r_n\+1 = 1: expected .* eigenvalue -"
    with pytest.raises(NotPositiveDefiniteError, match=message):
        model.on_nodes(3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"law": "fmc1"}, "law: got str, expected a FuzzyMarkovLaw"),
        ({"interpolation": "cubic"}, "interpolation: got 'cubic', expected 'covariance' or 'transition'"),
        ({"constraint": "maybe"}, "constraint: got 'maybe', expected 'project' or 'check'"),
        ({"dim_x": 2}, "dim_x: got 2"),
        (
            {"means": [[0.0, 3.0]], "covariances": pair_covariances()[:1, :1]},
            "means: got those of 1 regimes, expected 2",
        ),
        ({"means": [[0.0, np.inf], [0, 0]]}, r"means: entry \(0, 1\) is inf"),
    ],
)
def test_bad_arguments(changes, message):
    arguments = {"law": LAW, "means": MEANS, "covariances": pair_covariances(), "dim_x": 1} | changes
    with pytest.raises(ParameterError, match=message):
        CGOFMSModel(**arguments)


def test_transition_interpolation_needs_definite_hard_pairs():
    with pytest.raises(NotPositiveDefiniteError, match=r"covariances \(noise of the hard pairs\)\[0\]\[0\]"):
        CGOFMSModel(LAW, MEANS, pair_covariances(a=1.2), 1, interpolation="transition")


def test_both_interpolations_agree_at_the_hard_pairs_only(fuzzy_model):
    form = fuzzy_model.form
    other = CGOFMSModel(LAW, form.means, form.covariances, 1, interpolation="transition").form
    for r1, r2, same in ((0.0, 1.0, True), (1.0, 1.0, True), (0.5, 0.5, False)):
        u = np.array([[1 - r1, r1]]), np.array([[1 - r2, r2]])
        pairs = form.pairs(*u, str), other.pairs(*u, str)
        equal = [np.allclose(a, b, rtol=1e-12, atol=1e-14) for a, b in zip(*pairs, strict=True)]
        assert all(equal) == same


# --------------------------------------------------------------------------- derived


def test_hardening(fuzzy_model):
    hard = fuzzy_model.harden()
    assert isinstance(hard, CGOMSModel)
    joint = fuzzy_model.law.harden()
    np.testing.assert_allclose(hard.initial, [0.5, 0.5])
    np.testing.assert_allclose(hard.initial[:, None] * hard.transition, joint, atol=1e-14)
    for i in range(2):
        for j in range(2):
            tables = hard.on_nodes().pair_tables(0).pairs
            u = np.eye(2)
            expected = fuzzy_model.form.pairs(u[i][None], u[j][None], str)
            for a, b in zip(tables, expected, strict=True):
                np.testing.assert_allclose(a[i, j], b[0], atol=1e-15)


@pytest.mark.parametrize("form", ["covariance", "transition"])
def test_simulation_has_the_moments_of_the_model(fuzzy_model, form):
    # Z given r has mean M(r) and covariance Sigma(r); asked of many short series, so that
    # samples are independent, at the first step and after five
    base = fuzzy_model.form
    model = CGOFMSModel(LAW, base.means, base.covariances, 1, interpolation=form)
    rng = np.random.default_rng(2)
    runs = [model.simulate(6, rng) for _ in range(800)]
    r = np.array([run.r for run in runs])
    z = np.concatenate([np.array([run.x for run in runs]), np.array([run.y for run in runs])], axis=2)
    for n in (0, 5):
        for value in (0.0, 1.0):
            sample = z[r[:, n] == value, n]
            mean, covariance = base.marginal(model.class_weights([value]))
            error = np.sqrt(np.diag(covariance[0]) / len(sample))
            assert (np.abs(sample.mean(axis=0) - mean[0]) < 4 * error).all()
            if form == "covariance":  # the other form keeps the covariance at the hard values only nearly
                bound = (
                    4
                    * np.sqrt(2 / len(sample))
                    * np.sqrt(np.outer(np.diag(covariance[0]), np.diag(covariance[0])))
                )
                assert (np.abs(np.cov(sample.T) - covariance[0]) < bound).all()


def test_simulated_steps_follow_the_regressions(fuzzy_model):
    # innovations of a long series, standardised with the tables of its own path, are white
    data = fuzzy_model.simulate(4000, np.random.default_rng(5))
    u = fuzzy_model.class_weights(data.r)
    p = fuzzy_model.form.pairs(u[:-1], u[1:], str)
    x, y = data.x[:, 0], data.y[:, 0]
    v = (y[1:] - p.Ayy[:, 0, 0] * y[:-1] - p.Ny[:, 0]) / np.sqrt(p.Qyy[:, 0, 0])
    fit = p.Axx[:, 0, 0] * x[:-1] + p.H[:, 0, 0] * y[:-1] + p.G[:, 0, 0] * y[1:] + p.c[:, 0]
    w = (x[1:] - fit) / np.sqrt(p.C[:, 0, 0])
    for e in (v, w):
        assert abs(e.mean()) < 4 / np.sqrt(4000)
        assert abs(e.var() - 1) < 4 * np.sqrt(2 / 4000)
        for other in (x[:-1], y[:-1], e[:-1]):
            assert abs(np.corrcoef(e[-len(other) :], other)[0, 1]) < 4 / np.sqrt(4000)
    assert abs(np.corrcoef(v, w)[0, 1]) < 4 / np.sqrt(4000)


def test_simulation_is_reproducible(fuzzy_model):
    a, b = (fuzzy_model.simulate(30, np.random.default_rng(7)) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (a.x.shape, a.y.shape, a.r.shape) == ((30, 1), (30, 1), (30,))
    empty = fuzzy_model.simulate(0, np.random.default_rng(7))
    assert (empty.x.shape, empty.y.shape, empty.r.shape) == ((0, 1), (0, 1), (0,))
    with pytest.raises(ParameterError, match="n: got -1"):
        fuzzy_model.simulate(-1, np.random.default_rng(7))


# --------------------------------------------------------------------------- values


def test_models_never_change(fuzzy_model):
    assert copy.copy(fuzzy_model) is fuzzy_model
    assert copy.deepcopy(fuzzy_model) is fuzzy_model
    for model in (fuzzy_model, pickle.loads(pickle.dumps(fuzzy_model))):
        for name in ("law", "form"):
            with pytest.raises(AttributeError, match=f"{name}: a CGOFMSModel never changes"):
                setattr(model, name, None)


def test_models_with_functions_say_so_when_saved(tmp_path):
    law = FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1)
    model = CGOFMSModel(law, MEANS, pair_covariances(), 1)
    with pytest.raises(ParameterError, match="law: a law given by functions cannot be written to a file"):
        model.save(tmp_path / "model.json")
    assert not list(tmp_path.iterdir())
