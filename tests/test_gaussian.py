"""Gaussian algebra against scipy and by definition; what counts as a covariance."""

from __future__ import annotations

import fractions

import numpy as np
import pandas as pd
import pytest
import scipy.special
import scipy.stats

from fuzzykf import gaussian
from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError


def covariances(*shape, seed=0):
    root = np.random.default_rng(seed).normal(size=shape)
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])


def name(index):
    return f"matrix {index}"


# --------------------------------------------------------------------------- arrays


def test_as_array_copies():
    value = np.ones(3)
    copy = gaussian.as_array("a", value, (3,))
    copy[0] = 5.0
    assert value[0] == 1.0
    assert gaussian.as_array("a", [[1, 2]], (None, 2)).dtype == np.float64
    assert gaussian.as_array("a", 3, ()).shape == ()


@pytest.mark.parametrize(
    ("value", "shape", "error", "message"),
    [
        ([1, 2], (3,), ShapeError, r"a: got shape \(2,\), expected \(3,\)"),
        ([1, 2], (None, 2), ShapeError, r"a: got shape \(2,\), expected \(n, 2\)"),
        ("x", (), ShapeError, r"a: expected an array of numbers of shape \(\)"),
        ([[1], [1, 2]], (2, None), ShapeError, r"a: expected an array of numbers of shape \(2, n\)"),
        ([1.0, np.nan], (2,), ParameterError, r"a: entry \(1,\) is nan, expected finite numbers"),
        ([[1.0], [-np.inf]], (2, 1), ParameterError, r"a: entry \(1, 0\) is -inf, expected finite numbers"),
    ],
)
def test_as_array_refuses(value, shape, error, message):
    with pytest.raises(error, match=message):
        gaussian.as_array("a", value, shape)


@pytest.mark.parametrize("value", [3, 3.0, np.int8(3), np.float32(3), fractions.Fraction(6, 2), -2])
def test_whole_numbers(value):
    assert gaussian.is_whole(value)


@pytest.mark.parametrize("value", [3.5, True, None, "3", np.nan, np.inf, [3], 3j])
def test_what_is_no_whole_number(value):
    assert not gaussian.is_whole(value)


# --------------------------------------------------------------------------- definiteness


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("a",), "expected 'a'"),
        (("a", "b"), "expected 'a' or 'b'"),
        (("a", "b", "c", "d"), "expected one of 'a', 'b', 'c', 'd'"),
    ],
)
def test_a_word_that_is_none_of_a_few(options, told):
    assert gaussian.as_choice("w", "a", options) == "a"
    for value in ("z", 1, ["a"]):
        with pytest.raises(ParameterError, match="w: got") as caught:
            gaussian.as_choice("w", value, options)
        assert str(caught.value).endswith(told)


def test_semidefinite_matrices_pass():
    for P in (np.zeros((2, 2)), np.diag([1.0, 0.0]), np.ones((3, 3)), np.eye(2) - 1e-12):
        gaussian.check_definite(np.asarray(P), name)
    gaussian.check_definite(np.empty((0, 2, 2)), name)
    gaussian.check_definite(np.empty((2, 0, 0)), name)


def test_indefinite_matrices_are_named():
    P = np.stack([np.eye(2), np.array([[1.0, 2.0], [2.0, 1.0]]), np.diag([1.0, -0.5])])
    with pytest.raises(
        NotPositiveDefiniteError,
        match=r"matrix \(1,\): expected a positive semi-definite matrix, got the eigenvalue -1 \(largest 3\)",
    ):
        gaussian.check_definite(P, name)
    with pytest.raises(NotPositiveDefiniteError, match=r"matrix \(2,\).* eigenvalue -0\.5 \(largest 1\)"):
        gaussian.check_definite(P, name, where=np.array([True, False, True]))
    gaussian.check_definite(P, name, where=np.array([True, False, False]))


def test_rounding_is_tolerated_and_more_is_not():
    gaussian.check_definite(np.diag([1.0, -1e-11]), name)
    with pytest.raises(NotPositiveDefiniteError):
        gaussian.check_definite(np.diag([1.0, -1e-9]), name)
    gaussian.check_definite(np.diag([1e8, -1e-3]), name)  # relative to the largest eigenvalue


def test_strict():
    for P in (np.zeros((2, 2)), np.ones((2, 2)), np.diag([1.0, -1.0]), np.diag([1.0, 0.0])):
        with pytest.raises(NotPositiveDefiniteError, match="expected a positive definite matrix"):
            gaussian.check_definite(P, name, strict=True)
    gaussian.check_definite(np.array([[1.0, 0.999999], [0.999999, 1.0]]), name, strict=True)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_strictness_does_not_depend_on_units(unit):
    D = np.diag([unit, 1.0])
    good, bad = np.array([[1.0, 0.9], [0.9, 1.0]]), np.ones((2, 2))
    gaussian.check_definite(D @ good @ D, name, strict=True)
    with pytest.raises(NotPositiveDefiniteError):
        gaussian.check_definite(D @ bad @ D, name, strict=True)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_rounding_relative_to_a_scale(unit):
    # an error of 1e-6 of the size of the first component is none of rounding, in whatever unit
    P = np.diag([-1e-6 * unit**2, 1.0])
    scale = np.array([unit, 1.0])
    with pytest.raises(NotPositiveDefiniteError):
        gaussian.check_definite(P, name, scale=scale)
    gaussian.check_definite(1e-8 * P, name, scale=scale)  # now 1e-14 of that size
    with pytest.raises(NotPositiveDefiniteError):
        gaussian.check_definite(1e-15 * np.eye(2) * scale**2, name, strict=True, scale=scale)


def test_check_covariance():
    P = covariances(4, 3, 3)
    P[0, 0, 1] += 1e-12
    checked = gaussian.check_covariance("P", P, (4, 3, 3), strict=True)
    np.testing.assert_array_equal(checked, np.swapaxes(checked, -1, -2))
    np.testing.assert_allclose(checked, P, atol=1e-11)
    with pytest.raises(
        ParameterError, match=r"P: expected symmetric matrices, got 2 at \(0, 1\) but 0 at \(1, 0\)"
    ):
        gaussian.check_covariance("P", [[1.0, 2.0], [0.0, 1.0]], (2, 2))
    with pytest.raises(NotPositiveDefiniteError, match=r"P\[1\]: expected .* eigenvalue -1"):
        gaussian.check_covariance("P", [np.eye(2), -np.eye(2)], (2, 2, 2))
    with pytest.raises(ShapeError, match=r"P: got shape \(2,\)"):
        gaussian.check_covariance("P", [1.0, 2.0], (None, None))


def test_cholesky():
    P = covariances(5, 3, 3)
    L = gaussian.cholesky(P, name)
    np.testing.assert_allclose(L @ np.swapaxes(L, -1, -2), P, rtol=1e-12)
    np.testing.assert_array_equal(np.triu(L, 1), 0.0)
    P[2, 0, 0] = -1.0
    with pytest.raises(NotPositiveDefiniteError, match=r"matrix \(2,\): expected a positive definite"):
        gaussian.cholesky(P, name)


def test_semidefinite_root():
    P = covariances(4, 3, 3)
    P[0] = np.outer([1, 2, 3], [1, 2, 3])  # singular
    S = gaussian.semidefinite_root(P)
    np.testing.assert_allclose(S, np.swapaxes(S, -1, -2), atol=1e-13)
    np.testing.assert_allclose(S @ S, P, atol=1e-12)
    assert (np.linalg.eigvalsh(S) > -1e-12).all()
    np.testing.assert_array_equal(gaussian.semidefinite_root(np.diag([1.0, -1e-14])), np.diag([1.0, 0.0]))


# --------------------------------------------------------------------------- densities


def test_covariance_root_knows_no_units():
    units = np.array([1e-9, 1.0, 1e9])
    correlated = np.array([[1.0, 0.3, 0.2], [0.3, 1.0, 0.1], [0.2, 0.1, 1.0]])
    for P in (correlated, np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])):
        F = gaussian.covariance_root(P * units * units[:, None])
        np.testing.assert_allclose(gaussian.square(F) / units / units[:, None], P, atol=1e-14)


def test_covariance_root_leaves_no_rounding_to_what_has_no_variance():
    rng = np.random.default_rng(0)
    for known in ([0], [1, 3], [0, 1, 2, 3]):
        root = rng.normal(size=(5, 4, 4))
        root[:, known] = 0.0
        P = gaussian.square(root)
        F = gaussian.covariance_root(P)
        assert (F[:, known] == 0.0).all()
        np.testing.assert_allclose(gaussian.square(F), P, atol=1e-13)


def test_lower_factor_keeps_the_digits_of_small_columns():
    # variables that are one up to a small part: what is left of the second, given the first, is that part
    far, small = 1e30, np.array([3.0, 4.0])
    F = np.array([[0.0, far, 0.0, 0.0], [small[0], far, small[1], 0.0]])
    L = gaussian.lower_factor(F)
    np.testing.assert_allclose(L, [[far, 0.0], [far, 5.0]], rtol=1e-14)
    rng = np.random.default_rng(0)
    for shape in ((3, 5), (3, 3), (3, 2), (2, 4, 3, 7)):
        F = rng.normal(size=shape)
        L = gaussian.lower_factor(F)
        np.testing.assert_allclose(gaussian.square(L), gaussian.square(F), atol=1e-14)
        assert (np.triu(L, 1) == 0.0).all()
        assert (np.diagonal(L, axis1=-2, axis2=-1) >= 0.0).all()


def test_solve_lower_keeps_all_digits():
    L = np.array([[1e90, 0.0, 0.0], [3e90, 2e70, 0.0], [-1e90, 5e70, 4.0]])
    X = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    B = np.array([[1e90, 2e90], [3e90 + 6e70, 6e90 + 8e70], [-1e90 + 15e70 + 20, -2e90 + 20e70 + 24]])
    np.testing.assert_array_equal(gaussian.solve_lower(L, B)[0], X[0])
    rng = np.random.default_rng(0)
    L, X = np.tril(rng.normal(size=(2, 5, 4, 4))) + 4 * np.eye(4), rng.normal(size=(5, 4, 3))
    np.testing.assert_allclose(gaussian.solve_lower(L, L @ X), np.broadcast_to(X, (2, 5, 4, 3)), atol=1e-13)


def test_mixture_root_is_a_root_of_the_moments():
    rng = np.random.default_rng(1)
    p, means = rng.dirichlet(np.ones(4), 3), rng.normal(size=(3, 4, 2))
    roots = rng.normal(size=(3, 4, 2, 3))
    mean, covariance = gaussian.mixture_moments(p, means, gaussian.square(roots))
    found, root = gaussian.mixture_root(p, means, roots)
    np.testing.assert_allclose(found, mean, rtol=1e-13)
    np.testing.assert_allclose(gaussian.square(root), covariance, rtol=1e-13)


def test_log_density():
    P, e = covariances(4, 3, 3), np.random.default_rng(1).normal(size=(4, 3))
    value = gaussian.log_density(e, np.linalg.cholesky(P))
    expected = [scipy.stats.multivariate_normal.logpdf(v, np.zeros(3), S) for v, S in zip(e, P, strict=True)]
    np.testing.assert_allclose(value, expected, rtol=1e-12)
    # far off it is finite, as no density would be
    assert gaussian.log_density(np.array([1e6]), np.eye(1)) == pytest.approx(-5e11, rel=1e-10)


def test_condition():
    # X = mean + gain (Y - mean): what is left is independent of Y
    P, mean = covariances(2, 5, 5), np.random.default_rng(2).normal(size=(2, 5))
    y = np.array([1.0, -2.0])
    x, C = gaussian.condition(mean, P, 3, y)
    for k in range(2):
        gain = P[k, :3, 3:] @ np.linalg.inv(P[k, 3:, 3:])
        np.testing.assert_allclose(x[k], mean[k, :3] + gain @ (y - mean[k, 3:]), rtol=1e-11)
        np.testing.assert_allclose(C[k], np.linalg.inv(np.linalg.inv(P[k])[:3, :3]), rtol=1e-9)
    np.testing.assert_array_equal(C, np.swapaxes(C, -1, -2))


def test_logsumexp():
    a = np.random.default_rng(3).normal(scale=300, size=(4, 5))
    a[0, 0] = -np.inf
    for axis in (0, 1, -1):
        np.testing.assert_allclose(gaussian.logsumexp(a, axis=axis), scipy.special.logsumexp(a, axis=axis))
    assert gaussian.logsumexp(np.full(3, -np.inf)) == -np.inf
    assert gaussian.logsumexp(np.array([-1e300, -1e300])) == -1e300


def test_mixture_moments():
    rng = np.random.default_rng(4)
    w, x, P = rng.dirichlet(np.ones(4), 3), rng.normal(size=(3, 4, 2)), covariances(3, 4, 2, 2)
    mean, covariance = gaussian.mixture_moments(w, x, P)
    for k in range(3):
        centre = sum(w[k, i] * x[k, i] for i in range(4))
        second = sum(w[k, i] * (P[k, i] + np.outer(x[k, i], x[k, i])) for i in range(4))
        np.testing.assert_allclose(mean[k], centre, rtol=1e-12)
        np.testing.assert_allclose(covariance[k], second - np.outer(centre, centre), atol=1e-12)


def test_mixture_moments_do_not_cancel():
    # E[X^2] - E[X]^2 would lose everything here
    x = np.array([[1e9 - 1.0], [1e9 + 1.0]])
    _, covariance = gaussian.mixture_moments(np.array([0.5, 0.5]), x, np.full((2, 1, 1), 1e-3))
    assert covariance[0, 0] == pytest.approx(1.001, rel=1e-12)


def test_quantiles():
    for p in (1e-10, 0.05, 0.5, 0.9, 1 - 1e-10):
        assert gaussian.normal_quantile(p) == pytest.approx(scipy.stats.norm.ppf(p), rel=1e-12, abs=1e-15)
    # of a mixture: its distribution function there is p
    rng = np.random.default_rng(5)
    w, x, s = (
        rng.dirichlet(np.ones(4), 6)[..., None],
        rng.normal(0, 5, (6, 4, 2)),
        rng.uniform(0.1, 3, (6, 4, 2)),
    )
    for p in (0.001, 0.05, 0.5, 0.95):
        q = gaussian.mixture_quantile(p, w, x, s)
        assert q.shape == (6, 2)
        np.testing.assert_allclose((w * scipy.stats.norm.cdf((q[:, None] - x) / s)).sum(axis=1), p, rtol=1e-6)
    one = gaussian.mixture_quantile(0.9, np.ones((1, 1)), np.array([[2.0]]), np.array([[3.0]]))
    np.testing.assert_allclose(one, scipy.stats.norm.ppf(0.9, 2, 3), rtol=1e-8)


def test_whitening_splits_space():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 2))
    whiten, null = gaussian.whitening(root @ root.T)
    assert (whiten.shape, null.shape) == ((2, 4), (2, 4))
    np.testing.assert_allclose(null @ root, 0.0, atol=1e-6)
    np.testing.assert_allclose(whiten @ (root @ root.T) @ whiten.T, np.eye(2), atol=1e-10)


def test_module_is_light():
    import subprocess
    import sys

    code = "import sys, fuzzykf.gaussian, fuzzykf.base; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (1.5, "1.5"),
        ("a\nb  c", r"'a\nb  c'"),
        (np.eye(2), "array([[1., 0.], [0., 1.]])"),
        (pd.DataFrame({"a": [1, 2]}), "a 0  1 1  2"),
        ([pd.Series([1.5])], "[0    1.5 dtype: float64]"),
        ("x" * 300, "'" + "x" * 199 + "..."),
        pytest.param(10**5000, "int", id="many digits"),
    ],
)
def test_a_value_in_a_message_is_on_one_line_and_cut(value, shown):
    assert gaussian.brief(value) == shown
