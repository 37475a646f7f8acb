"""The compiled bank of Kalman filters is the NumPy one, along series of any kind: IMM and GPB2."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import imm

METHODS = pytest.mark.parametrize("every_pair", [False, True], ids=["imm", "gpb2"])
core = pytest.importorskip("fuzzykf.engine.compiled.imm", reason="the compiled core has not been built")


def model_of(K, n, m, seed=0):
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(K, n, n))
    F *= 0.9 / np.abs(np.linalg.eigvals(F)).max(axis=-1)[:, None, None]
    model = {"F": F, "H": rng.normal(size=(K, m, n)), "alpha_sq": np.array(1.0)}
    for name, k in (("Q", n), ("R", m)):
        root = rng.normal(size=(K, k, k))
        model[name] = root @ root.mT + 0.2 * np.eye(k)
    return model


def start_of(K, n, seed=0):
    rng = np.random.default_rng(seed + 1)
    root = rng.normal(size=(K, n, n))
    return rng.normal(size=(K, n)), root @ root.mT + np.eye(n), np.log(rng.dirichlet(np.ones(K)))


def outputs(n_steps, n, K):
    shapes = {"x": (n,), "P": (n, n), "x_prior": (n,), "P_prior": (n, n), "mu": (K,), "log_likelihood": ()}
    return {name: np.empty((n_steps, *shape)) for name, shape in shapes.items()}


def observations(n_steps, m, gaps=0.0, seed=0):
    rng = np.random.default_rng(seed + 2)
    zs = 2.0 * rng.normal(size=(n_steps, m))
    zs[rng.random(zs.shape) < gaps] = np.nan
    return zs


def assert_close(got, expected, name=""):
    got, expected = (np.asarray(value, dtype=np.float64) for value in (got, expected))
    assert got.shape == expected.shape, name
    np.testing.assert_allclose(
        got, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max(initial=1.0), err_msg=name
    )


@METHODS
@pytest.mark.parametrize("gaps", [0.0, 0.4])
@pytest.mark.parametrize("alpha_sq", [np.array(1.0), np.array([1.0, 1.1, 1.2, 1.3, 1.0])])
@pytest.mark.parametrize(("K", "n", "m"), [(2, 1, 1), (3, 2, 1), (3, 4, 2), (5, 3, 3), (2, 16, 5)])
def test_a_series_is_that_of_numpy(K, n, m, alpha_sq, gaps, every_pair) -> None:
    model, (xs, Ps, log_mu) = model_of(K, n, m), start_of(K, n)
    model["alpha_sq"] = alpha_sq if alpha_sq.ndim == 0 else alpha_sq[:K, None, None]
    log_M = np.log(np.random.default_rng(4).dirichlet(np.ones(K), K))
    zs = observations(30, m, gaps)
    found = []
    for engine in (core, imm):
        out = outputs(30, n, K)
        state = engine.filter_bank(xs, Ps, log_mu, log_M, zs, model, every_pair, out)
        found.append(out | state)
    assert found[0].keys() == found[1].keys()
    for name, value in found[1].items():
        assert_close(found[0][name], value, name)


@METHODS
def test_modes_that_cannot_be_reached(every_pair) -> None:
    model, (xs, Ps, _) = model_of(3, 2, 1), start_of(3, 2)
    with np.errstate(divide="ignore"):
        log_mu, log_M = np.log([0.5, 0.5, 0.0]), np.log([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0], [0.0, 0.0, 1.0]])
    found = []
    for engine in (core, imm):
        out = outputs(6, 2, 3)
        engine.filter_bank(xs, Ps, log_mu, log_M, observations(6, 1), model, every_pair, out)
        found.append(out)
    for name, value in found[1].items():
        assert_close(found[0][name], value, name)
    assert not found[0]["mu"][:, 2].any()


@METHODS
def test_a_mode_that_cannot_be_reached_keeps_to_itself_however_well_it_fits(every_pair) -> None:
    model, (xs, Ps, _) = model_of(3, 2, 1), start_of(3, 2)
    model["R"][2] = 1e6  # what is a thousand standard deviations off for the others fits it well
    with np.errstate(divide="ignore"):
        log_mu, log_M = np.log([0.5, 0.5, 0.0]), np.log([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0], [0.5, 0.4, 0.1]])
    zs, found = np.array([[0.1], [1e3], [0.2]]), []
    for engine in (core, imm):
        out = outputs(3, 2, 3)
        state = engine.filter_bank(xs, Ps, log_mu, log_M, zs, model, every_pair, out)
        found.append(out | state)
    for name, value in found[1].items():
        np.testing.assert_allclose(found[0][name], value, rtol=1e-11, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(found[0]["mu"].sum(axis=1), 1.0, rtol=1e-14)
    assert not found[0]["mu"][:, 2].any()


@METHODS
def test_what_is_refused_by_numpy_is_refused_here(every_pair) -> None:
    model, (xs, Ps, log_mu) = model_of(2, 2, 1), start_of(2, 2)
    log_M = np.log(np.full((2, 2), 0.5))
    for zs, change in ((np.full((3, 1), 1e200), 1.0), (observations(3, 1), -1e3)):
        changed = model | {"R": change * model["R"]}
        for engine in (core, imm):
            with np.errstate(over="ignore"):
                assert engine.filter_bank(xs, Ps, log_mu, log_M, zs, changed, every_pair, {}) is None


@METHODS
def test_many_series_are_those_of_numpy(every_pair) -> None:
    model, (xs, Ps, log_mu) = model_of(3, 2, 2), start_of(3, 2)
    with np.errstate(divide="ignore"):
        log_M = np.log([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0], [0.3, 0.3, 0.4]])
    zs = observations(60, 2, 0.3).reshape(5, 12, 2)
    zs[1, 4] = 1e3
    found = []
    for engine in (core, imm):
        out = {name: np.stack([value] * 5) for name, value in outputs(12, 2, 3).items()}
        lost = engine.filter_bank_many(xs, Ps, log_mu, log_M, zs, model, every_pair, out)
        assert not lost.any()
        found.append(out)
    for name, value in found[1].items():
        np.testing.assert_allclose(found[0][name], value, rtol=1e-9, atol=1e-9, err_msg=name)
    for s, series in enumerate(zs):  # and each is that of the series alone
        alone = outputs(12, 2, 3)
        core.filter_bank(xs, Ps, log_mu, log_M, series, model, every_pair, alone)
        for name, value in alone.items():
            np.testing.assert_array_equal(found[0][name][s], value, err_msg=name)


@METHODS
def test_of_many_series_those_that_are_lost_are_named_and_blank(every_pair) -> None:
    model, (xs, Ps, log_mu) = model_of(2, 2, 1), start_of(2, 2)
    zs = observations(12, 1).reshape(3, 4, 1)
    zs[1, 3] = 1e200
    for engine in (core, imm):
        out = {name: np.stack([value] * 3) for name, value in outputs(4, 2, 2).items()}
        with np.errstate(over="ignore"):
            lost = engine.filter_bank_many(
                xs, Ps, log_mu, np.log(np.full((2, 2), 0.5)), zs, model, every_pair, out
            )
        assert lost.tolist() == [False, True, False]
        for name in ("x", "P", "mu"):
            assert np.isfinite(out[name][[0, 2]]).all()
            assert np.isfinite(out[name][1, :3]).all()
            assert np.isnan(out[name][1, 3:]).all()
        changed = model | {"R": -1e3 * model["R"]}
        with pytest.raises(np.linalg.LinAlgError):
            engine.filter_bank_many(xs, Ps, log_mu, np.log(np.full((2, 2), 0.5)), zs, changed, every_pair, {})
    zs[1, 1], zs[1, 3] = 1e200, 0.1  # and does not come back
    out = {name: np.stack([value] * 3) for name, value in outputs(4, 2, 2).items()}
    lost = core.filter_bank_many(xs, Ps, log_mu, np.log(np.full((2, 2), 0.5)), zs, model, every_pair, out)
    assert lost.tolist() == [False, True, False]
    assert all(np.isnan(out[name][1, 1:]).all() for name in out)
    assert all(np.isfinite(out[name][[0, 2]]).all() for name in out)


@pytest.mark.parametrize("name", ["F", "Q", "H", "R"])
def test_wrong_shapes_are_refused(name) -> None:
    model, (xs, Ps, log_mu) = model_of(2, 3, 2), start_of(2, 3)
    model[name] = model[name][:1]
    with pytest.raises(ValueError, match="got shape"):
        core.filter_bank(xs, Ps, log_mu, np.zeros((2, 2)), observations(3, 2), model, False, {})
