"""The model of K hard regimes."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import scipy.stats

from fuzzykf import CGOMSModel
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError

P = [[0.9, 0.1], [0.3, 0.7]]
Z = np.array([[1.0, 0.5], [0.5, 1.0]])
PAIR = np.block([[Z, 0.8 * Z], [0.8 * Z, Z]])
GAMMA = np.broadcast_to(PAIR, (2, 2, 4, 4))
MEANS = [[0.0, 3.0], [0.0, 0.0]]


def test_attributes(hard_model):
    assert (hard_model.n_classes, hard_model.dim_x, hard_model.dim_z) == (3, 2, 1)
    pi = hard_model.initial
    np.testing.assert_allclose(pi @ hard_model.transition, pi)
    assert repr(hard_model) == "CGOMSModel(n_classes=3, dim_x=2, dim_z=1, form='transition')"
    np.testing.assert_array_equal(hard_model.class_weights([2, 0]), [[0, 0, 1], [1, 0, 0]])
    for r in ([3], [0.5], [-1], [np.nan]):
        with pytest.raises(ParameterError, match="r: expected regimes 0 to 2"):
            hard_model.class_weights(r)


def test_initial_law():
    assert CGOMSModel(P, MEANS, GAMMA, 1).initial == pytest.approx([0.75, 0.25])
    assert CGOMSModel(P, MEANS, GAMMA, 1, initial=[0.1, 0.9]).initial == pytest.approx([0.1, 0.9])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"transition": np.empty((0, 0)), "means": np.empty((0, 2)), "covariances": np.empty((0, 0, 4, 4))},
         ParameterError, "means: got no regime, expected at least one"),
        ({"transition": np.eye(3)}, ParameterError, "initial: has to be given|transition: got 3 regimes"),
        ({"transition": np.full((3, 3), 1 / 3)}, ParameterError, "transition: got 3 regimes, expected 2"),
        ({"transition": [[0.9, 0.2], [0.3, 0.7]]}, ParameterError, r"transition\[0\]: sums to 1\.1"),
        ({"initial": [0.5, 0.4]}, ParameterError, r"initial: sums to 0\.9"),
        ({"means": [[0.0, np.nan], [0, 0]]}, ParameterError, r"means: entry \(0, 1\) is nan"),
        ({"covariances": PAIR}, ShapeError, r"covariances: got shape \(4, 4\), expected \(2, 2, 4, 4\)"),
        ({"dim_x": 3}, ParameterError, "dim_x: got 3"),
        ({"constraint": "x"}, ParameterError, "constraint: got 'x'"),
    ],
)  # fmt: skip
def test_bad_arguments(changes, error, message):
    arguments = {"transition": P, "means": MEANS, "covariances": GAMMA, "dim_x": 1} | changes
    with pytest.raises(error, match=message):
        CGOMSModel(**arguments)


def test_indefinite_noise_of_a_pair():
    gamma = GAMMA.copy()
    gamma[1, 0, 0, 2] = gamma[1, 0, 2, 0] = 1.2
    with pytest.raises(NotPositiveDefiniteError, match=r"pair of nodes \(1, 0\), r_n = 1 and r_n\+1 = 0"):
        CGOMSModel(P, MEANS, gamma, 1)
    # an impossible pair is not asked
    CGOMSModel([[0.9, 0.1], [0.0, 1.0]], MEANS, gamma, 1)


def test_check_mode():
    gamma = GAMMA.copy()
    gamma[0, 1, 3, 0] = gamma[0, 1, 0, 3] = 0.41
    CGOMSModel(P, MEANS, gamma, 1)
    with pytest.raises(ParameterError, match=r"covariances\[0, 1\]: Cov\(Y2\[0\], X1\[0\]\) .* off by 0\.01"):
        CGOMSModel(P, MEANS, gamma, 1, constraint="check")


def test_regressions_are_taken_as_given():
    rng = np.random.default_rng(0)
    p = {
        "Ayy": rng.normal(size=(3, 3, 1, 1)),
        "Ny": rng.normal(size=(3, 3, 1)),
        "Qyy": rng.uniform(1, 2, (3, 3, 1, 1)),
        "Axx": rng.normal(size=(3, 3, 2, 2)),
        "H": rng.normal(size=(3, 3, 2, 1)),
        "G": rng.normal(size=(3, 3, 2, 1)),
        "c": rng.normal(size=(3, 3, 2)),
        "C": np.broadcast_to(np.diag([1.0, 0.0]), (3, 3, 2, 2)),  # singular
    }
    model = CGOMSModel.from_regressions(
        np.full((3, 3), 1 / 3), **p, means=np.zeros((3, 3)), covariances=np.broadcast_to(np.eye(3), (3, 3, 3))
    )
    pairs = model.on_nodes().pair_tables(0).pairs
    for name, value in p.items():
        np.testing.assert_array_equal(getattr(pairs, name), value)
    u = np.eye(3)[[0, 2]]
    np.testing.assert_array_equal(model.form.pairs(u[:1], u[1:], str).Axx[0], p["Axx"][0, 2])


def test_simulated_regimes(hard_model):
    r = hard_model.simulate(6000, np.random.default_rng(1)).r
    counts = np.histogram2d(r[:-1], r[1:], bins=[-0.5, 0.5, 1.5, 2.5])[0]
    for i in range(3):
        assert scipy.stats.chisquare(counts[i], hard_model.transition[i] * counts[i].sum()).pvalue > 1e-3
    first = np.array([hard_model.simulate(1, np.random.default_rng(k)).r[0] for k in range(1500)])
    counts = np.bincount(first.astype(int), minlength=3)
    assert scipy.stats.chisquare(counts, hard_model.initial * 1500).pvalue > 1e-3


def test_simulated_steps_follow_the_regressions(hard_model):
    data = hard_model.simulate(6000, np.random.default_rng(5))
    i, j = data.r[:-1].astype(int), data.r[1:].astype(int)
    p = hard_model.on_nodes().pair_tables(0).pairs
    x, y = data.x, data.y
    v = y[1:] - np.einsum("nkl,nl->nk", p.Ayy[i, j], y[:-1]) - p.Ny[i, j]
    w = x[1:] - p.c[i, j] - np.einsum("nkl,nl->nk", p.Axx[i, j], x[:-1])
    w -= np.einsum("nkl,nl->nk", p.H[i, j], y[:-1]) + np.einsum("nkl,nl->nk", p.G[i, j], y[1:])
    v /= np.sqrt(p.Qyy[i, j, 0])
    w = np.linalg.solve(np.linalg.cholesky(p.C)[i, j], w[..., None])[..., 0]
    white = np.concatenate([v, w], axis=1)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=4 / np.sqrt(6000))
    np.testing.assert_allclose(white.T @ white / 6000, np.eye(3), atol=4 * np.sqrt(2 / 6000))
    past = np.concatenate([x[:-1], y[:-1]], axis=1)
    np.testing.assert_allclose((white.T @ past / 6000) / past.std(axis=0), 0.0, atol=0.08)


def test_first_state_given_the_regime(hard_model):
    runs = [hard_model.simulate(1, np.random.default_rng(k)) for k in range(2000)]
    r = np.array([run.r[0] for run in runs])
    z = np.array([np.r_[run.x[0], run.y[0]] for run in runs])
    for k in range(3):
        sample = z[r == k]
        mean, covariance = hard_model.form.means[k], hard_model.form.stationary[k]
        sd = np.sqrt(np.diag(covariance))
        assert (np.abs(sample.mean(axis=0) - mean) < 4 * sd / np.sqrt(len(sample))).all()
        assert (np.abs(np.cov(sample.T) - covariance) < 4 * np.sqrt(2 / len(sample)) * np.outer(sd, sd)).all()


def test_models_never_change(hard_model):
    assert copy.deepcopy(hard_model) is hard_model
    for model in (hard_model, pickle.loads(pickle.dumps(hard_model))):
        with pytest.raises(AttributeError, match="form: a CGOMSModel never changes"):
            model.form = None
    with pytest.raises(ValueError, match="read-only"):
        hard_model.transition[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        hard_model.initial[0] = 1.0


def test_one_regime_is_spoken_of_in_the_singular(hard_model):
    assert hard_model.describe_switch().startswith(f"{hard_model.n_classes} hard regimes, which stay with")
    one = CGOMSModel([[1.0]], np.zeros((1, 2)), np.eye(4)[None, None], dim_x=1)
    assert one.describe_switch() == "1 hard regime, which stays"
