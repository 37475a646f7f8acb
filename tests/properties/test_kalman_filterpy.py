"""fuzzykf gives filterpy's numbers on any model, to 1e-10, where filterpy's are right."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzykf import kalman

theirs = pytest.importorskip("filterpy.kalman")
pytestmark = pytest.mark.filterwarnings("error")

some = settings(max_examples=20, deadline=None)
dims = st.tuples(st.integers(1, 6), st.integers(1, 3))
seeds = st.integers(0, 10**6)


def covariance(rng, n):
    root = rng.uniform(-1.0, 1.0, (n, n))
    return root @ root.T + 0.1 * np.eye(n)


def system(n, m, seed, flat):
    """Matrices of a random stable system with two controls."""
    rng = np.random.default_rng(seed)
    F = rng.uniform(-1.0, 1.0, (n, n))
    F *= rng.uniform(0.3, 1.0) / max(np.abs(np.linalg.eigvals(F)).max(), 0.1)
    x = rng.normal(size=n)
    return {
        "x": x if flat else x[:, None],
        "P": covariance(rng, n),
        "F": F,
        "Q": covariance(rng, n),
        "H": rng.uniform(-1.0, 1.0, (m, n)),
        "R": covariance(rng, m),
        "B": rng.uniform(-1.0, 1.0, (n, 2)),
        "alpha": float(rng.uniform(1.0, 1.1)),
    }


def assign(f, values, skip=()):
    for name, value in values.items():
        if name not in skip:
            setattr(f, name, np.copy(value) if isinstance(value, np.ndarray) else value)
    return f


def series(m, n, seed, missing):
    """Observations in all the forms that filterpy takes; None with the given probability."""
    rng = np.random.default_rng(seed + 1)
    forms = [lambda z: z[:, None], lambda z: z[:, None].tolist()] + (
        [lambda z: float(z[0])] if m == 1 else []
    )
    out = []
    for _ in range(n):
        z = rng.normal(scale=2.0, size=m)
        out.append(None if rng.random() < missing else forms[rng.integers(len(forms))](z))
    return out


def close(a, b, what):
    scale = np.abs(np.asarray(b, dtype=float)).max(initial=0.0)
    np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * scale, err_msg=what)


@some
@given(dims, seeds, st.booleans(), st.sampled_from([0.0, 0.3]))
def test_kalman_filter(dim, seed, flat, missing):
    (n, m), values = dim, system(*dim, seed, flat)
    ours = assign(kalman.KalmanFilter(n, m, 2), values)
    reference = assign(theirs.KalmanFilter(n, m, 2), values)
    rng = np.random.default_rng(seed + 2)
    for k, z in enumerate(series(m, 12, seed, missing)):
        u = None if k % 3 == 0 else rng.normal(size=2 if flat else (2, 1))
        close(ours.get_prediction(u)[0], reference.get_prediction(u)[0], "get_prediction")
        ours.predict(u)
        reference.predict(u)
        if z is not None:
            close(ours.residual_of(z), reference.residual_of(z), "residual_of")
            close(ours.get_update(z)[1], reference.get_update(z)[1], "get_update")
        R = float(rng.uniform(0.1, 2.0)) if k % 4 == 1 else None
        ours.update(z, R=R)
        reference.update(z, R=R)
        for name in ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "S", "SI", "K"):
            close(getattr(ours, name), getattr(reference, name), name)
            assert np.shape(getattr(ours, name)) == np.shape(getattr(reference, name))
        if z is not None:
            for name in ("y", "z", "log_likelihood", "likelihood", "mahalanobis"):
                close(getattr(ours, name), getattr(reference, name), name)


@some
@given(dims, seeds, st.booleans(), st.booleans())
def test_batch_filter_and_smoother(dim, seed, flat, update_first):
    # with dim_z > 1 filterpy 2.0.0 only takes columns here, of the right size
    (n, m), values = dim, system(*dim, seed, flat)
    length = 8
    zs = [
        None if z is None else np.reshape(z, (m,) if flat else (m, 1)) for z in series(m, length, seed, 0.2)
    ]
    rng = np.random.default_rng(seed + 3)
    varying = {
        "Fs": [values["F"] * rng.uniform(0.8, 1.0) for _ in range(length)],
        "Qs": [values["Q"] * rng.uniform(0.5, 2.0) for _ in range(length)],
        "Rs": [values["R"] * rng.uniform(0.5, 2.0) for _ in range(length)],
        "us": [rng.normal(size=2 if flat else (2, 1)) for _ in range(length)],
    }
    ours = assign(kalman.KalmanFilter(n, m), values)
    reference = assign(theirs.KalmanFilter(n, m), values)
    got = ours.batch_filter(zs, **varying, update_first=update_first)
    expected = reference.batch_filter(zs, **varying, update_first=update_first)
    for a, b in zip(got, expected, strict=True):
        assert a.shape == b.shape
        close(a, b, "batch_filter")
    smoothed = ours.rts_smoother(got[0], got[1], varying["Fs"], varying["Qs"])
    expected = reference.rts_smoother(got[0], got[1], varying["Fs"], varying["Qs"])
    for a, b in zip(smoothed, expected, strict=True):
        close(a, b, "rts_smoother")
    start = (
        values["x"],
        values["P"],
        zs,
        varying["Fs"],
        varying["Qs"],
        [values["H"]] * length,
        varying["Rs"],
    )
    for a, b in zip(kalman.batch_filter(*start), theirs.batch_filter(*start), strict=True):
        close(a, b, "the function batch_filter")
    constant = (got[0], got[1], [values["F"]] * length, [values["Q"]] * length)
    for a, b in zip(kalman.rts_smoother(*constant)[:3], theirs.rts_smoother(*constant)[:3], strict=True):
        close(a, b, "the function rts_smoother")


@some
@given(dims, seeds, st.booleans())
def test_variants_of_the_update(dim, seed, flat):
    (n, m), values = dim, system(*dim, seed, flat)
    rng = np.random.default_rng(seed + 4)
    ours = assign(kalman.KalmanFilter(n, m), values)
    reference = assign(theirs.KalmanFilter(n, m), values)
    M = 0.05 * rng.uniform(-1.0, 1.0, (n, m))
    for f in (ours, reference):
        f.M = M
    for k in range(6):
        z = rng.normal(size=m if flat else (m, 1))
        u = rng.normal(size=2 if flat else (2, 1))
        for f in (ours, reference):
            if k % 2:
                f.predict_steadystate(u)
                f.update_steadystate(z)
            else:
                f.predict(u)
                f.update_correlated(z)
        for name in ("x", "P", "x_prior", "y", "S", "K", "z", "log_likelihood"):
            close(getattr(ours, name), getattr(reference, name), name)
    if flat:
        return  # filterpy's sequential update is wrong for a flat x
    for f in (ours, reference):
        f.R = np.diag(np.diag(f.R))
        f.predict()
        f.update_sequential(0, np.array([0.3]))
        if m > 1:
            f.update_sequential(1, np.arange(m - 1.0), H_i=f.H[1:])
    for name in ("x", "P", "y", "K"):
        close(getattr(ours, name), getattr(reference, name), name)


@some
@given(dims, seeds, st.booleans())
def test_extended_kalman_filter(dim, seed, flat):
    (n, m), values = dim, system(*dim, seed, flat)
    ours = assign(kalman.ExtendedKalmanFilter(n, m), values, skip=("H", "alpha"))
    reference = assign(theirs.ExtendedKalmanFilter(n, m), values, skip=("H", "alpha"))
    H = values["H"]

    def Hx(x, scale):
        return np.sin(scale * H @ x)

    def HJacobian(x, scale):
        return scale * np.cos(scale * H @ x.ravel())[:, None] * H

    rng = np.random.default_rng(seed + 5)
    for k in range(8):
        z, u = rng.normal(size=m if flat else (m, 1)), rng.normal(size=2 if flat else (2, 1))
        R = 0.7 if k % 3 == 0 else None
        for f in (ours, reference):
            f.predict(u)
            f.update(z, HJacobian, Hx, R=R, args=(0.5,), hx_args=0.5)
        for name in ("x", "P", "x_prior", "P_prior", "x_post", "P_post", "y", "S", "SI", "K", "z"):
            close(getattr(ours, name), getattr(reference, name), name)
        for name in ("log_likelihood", "likelihood", "mahalanobis"):
            close(getattr(ours, name), getattr(reference, name), name)
    for f in (ours, reference):  # where Hx is linear both linearise alike
        f.predict_update(z, lambda x: H, lambda x: H @ x, u=u)
    close(ours.x, reference.x, "predict_update")
    close(ours.P, reference.P, "predict_update")


@some
@given(dims, seeds, st.booleans(), st.integers(2, 4), st.booleans())
def test_imm_estimator(dim, seed, flat, K, update_first):
    # x_prior is left out: filterpy weights the predictions with the old mode probabilities
    n, m = dim
    rng = np.random.default_rng(seed + 6)
    T = rng.uniform(0.05, 1.0, (K, K)) + 3.0 * np.eye(K)
    T /= T.sum(axis=1, keepdims=True)
    mu = rng.uniform(0.1, 1.0, K)
    banks = []
    for module in (kalman, theirs):
        filters = [
            assign(module.KalmanFilter(n, m), system(n, m, seed + 17 * k, flat), skip=("alpha",))
            for k in range(K)
        ]
        banks.append(module.IMMEstimator(filters, mu, T))
    ours, reference = banks
    for _ in range(6):
        z, u = rng.normal(size=m if flat else (m, 1)), rng.normal(size=2 if flat else (2, 1))
        for f in banks:
            if not update_first:
                f.predict(u)
            f.update(z)
        for name in ("x", "P", "x_post", "P_post", "mu", "cbar", "omega", "likelihood"):
            close(getattr(ours, name), getattr(reference, name), name)
        for f in banks:
            if update_first:
                f.predict(u)
        for f, g in zip(ours.filters, reference.filters, strict=True):
            for name in ("x", "P", "x_prior", "x_post", "y", "S", "SI", "K", "log_likelihood"):
                close(getattr(f, name), getattr(g, name), name)
