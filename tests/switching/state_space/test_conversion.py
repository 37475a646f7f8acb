"""The equations of the conversion, against the formulas as they stand and against exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fuzzykf import gaussian
from fuzzykf.errors import NotPositiveDefiniteError
from fuzzykf.switching.state_space import conversion
from fuzzykf.switching.state_space.conversion import StateSpace, WindowLaw


def random_space(K, m, q, seed, scale=0.8):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(K, m, m)) * scale / np.sqrt(m)
    return StateSpace(
        A, rng.normal(size=(K, q, m)), rng.normal(size=(K, m, m)), rng.normal(size=(K, q, q + 1))
    )


def random_law(K, w, m, seed):
    rng = np.random.default_rng(seed)
    factor = np.tril(rng.normal(size=(K, w + m, w + m))) + np.eye(w + m)
    return WindowLaw(np.log(rng.dirichlet(np.ones(K))), factor)


def everywhere(K):
    return np.ones((K, K), dtype=bool)


def moments_of(law, space, where=None):
    K = len(space.A)
    return conversion.pair_moments(law, space, str, everywhere(K) if where is None else where)


exactly = np.vectorize(Fraction, otypes=[object])


def inverse(matrix):
    """Inverse of a matrix of fractions, by Gauss and Jordan."""
    n = len(matrix)
    rows = np.concatenate([matrix, exactly(np.eye(n))], axis=1)
    for k in range(n):
        pivot = k + next(r for r, value in enumerate(rows[k:, k]) if value)
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k] = rows[k] / rows[k, k]
        for r in range(n):
            if r != k:
                rows[r] = rows[r] - rows[r, k] * rows[k]
    return rows[:, n:]


def by_formula(law, space, i, j):
    """J, P, E, V, K, P' of a pair, with inverses and differences.

    In rational arithmetic: in floats these very formulas lose all digits in a few of a thousand
    draws (cond(S) of 1e12 and more), where the code, which works on factors, does not.
    """
    A, B, C, D = (exactly(a[j]) for a in space)
    factor = exactly(law.factor[i])
    S = factor @ factor.T
    w = len(S) - len(A)
    J = S[w:, :w] @ inverse(S[:w, :w])
    P = S[w:, w:] - J @ S[:w, w:]
    prior = C @ C.T + A @ P @ A.T
    V = B @ prior @ B.T + D @ D.T
    K = prior @ B.T @ inverse(V)
    parts = J, P, B @ A @ J, V, K, prior - K @ B @ prior
    return tuple(part.astype(np.float64) for part in parts)


# --------------------------------------------------------------------------- moments


@given(
    K=st.integers(1, 3),
    m=st.integers(1, 4),
    q=st.integers(1, 3),
    w=st.integers(1, 5),
    seed=st.integers(0, 999),
)
@example(K=1, m=3, q=1, w=5, seed=220)  # cond(S) = 2e11: wrong in floats
@settings(max_examples=30, deadline=None)
def test_pair_moments_are_the_formulas(K, m, q, w, seed):
    law, space = random_law(K, w, m, seed), random_space(K, m, q, seed)
    moments = moments_of(law, space)
    for i in range(K):
        for j in range(K):
            J, P, E, V, gain, post = by_formula(law, space, i, j)
            got = (
                moments.J[i],
                gaussian.square(moments.Lx[i]),
                moments.E[i, j],
                moments.V[i, j],
                moments.K[i, j],
                gaussian.square(moments.Lnew[i, j]),
            )
            for value, expected in zip(got, (J, P, E, V, gain, post), strict=True):
                np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())


def test_a_singular_innovation_names_the_pair():
    space = random_space(2, 2, 1, seed=1)
    space = space._replace(D=space.D * 0.0, B=space.B * np.array([1.0, 0.0])[:, None, None])
    with pytest.raises(NotPositiveDefiniteError, match=r"regimes \(\d, 1\): expected a positive definite"):
        conversion.pair_moments(random_law(2, 1, 2, 1), space, lambda k: f"regimes {k}", everywhere(2))


def test_a_singular_innovation_of_an_impossible_pair_does_not_matter():
    space = random_space(2, 2, 1, seed=1)
    only_0 = np.array([1.0, 0.0])[:, None, None]
    space = space._replace(D=space.D * only_0, B=space.B * only_0)
    where = np.array([[True, False], [True, False]])
    moments = moments_of(random_law(2, 1, 2, 1), space, where)
    for pairs in (
        conversion.gain_coefficients(moments, space),
        conversion.clip_coefficients(moments, space, str, where),
        conversion.prove_noise(conversion.gain_coefficients(moments, space), moments, str, where),
    ):
        assert all(np.isfinite(value).all() for value in pairs)
        np.testing.assert_array_equal(pairs.Qyy[:, 1], 1.0)


def test_large_covariances_keep_their_digits():
    # P = G d^2 / (b^2 G + d^2) with G = 1e12: a difference of covariances has no correct digit left
    G, b, d = Fraction(10) ** 12, Fraction(3), Fraction(1, 100)
    exact = float(G * d**2 / (b**2 * G + d**2))
    law = conversion.first_window(
        np.zeros(1), np.full((1, 1, 1), 1e6), np.full((1, 1, 1), 3.0), np.full((1, 1, 1), 0.01)
    )
    assert float(law.factor[0, 1, 1] ** 2) == pytest.approx(exact, rel=1e-12)
    difference = 1e12 - (3e12 / (9e12 + 1e-4)) * 3e12
    assert abs(difference / exact - 1.0) > 0.1


def test_a_long_random_walk_keeps_its_digits():
    # one class, a window of three: Var(x_n | y_n, y_n-1, y_n-2) by exact rational arithmetic
    n, noise = 20_000, Fraction(1, 10**6)
    times = [n, n, n - 1, n - 2]  # x_n and the window, of a walk of unit steps from variance 1
    S = [[Fraction(1 + min(a, b)) for b in times] for a in times]
    for k in (1, 2, 3):
        S[k][k] += noise
    for k in (3, 2, 1):  # condition on one observation after the other
        S = [[S[a][b] - S[a][k] * S[k][b] / S[k][k] for b in range(k)] for a in range(k)]
    exact = float(S[0][0])

    one = np.ones((1, 1, 1))
    space = StateSpace(one, one, one, one * 1e-3)
    law = conversion.first_window(np.zeros(1), one * np.sqrt(n - 1), one, one * 1e-3)
    for _ in range(2):
        law = conversion.advance_window(
            law, moments_of(law, space), space.A, np.ones((1, 1)), np.zeros(1), length=3
        )
    assert law.factor.shape == (1, 4, 4)
    assert float(law.factor[0, 3, 3] ** 2) == pytest.approx(exact, rel=1e-10)


# --------------------------------------------------------------------------- laws


def test_backward_kernel_is_bayes_rule():
    p, T = np.array([0.2, 0.5, 0.3]), np.array([[0.1, 0.9, 0.0], [0.4, 0.6, 0.0], [0.5, 0.25, 0.25]])
    kernel, log_next = conversion.backward_kernel(np.log(p), T)
    np.testing.assert_allclose(np.exp(log_next), p @ T, rtol=1e-14)
    np.testing.assert_allclose(kernel, p[:, None] * T / (p @ T), rtol=1e-14)


def test_backward_kernel_of_regimes_that_cannot_occur():
    T = np.array([[1.0, 0.0], [0.5, 0.5]])
    with np.errstate(divide="ignore"):
        kernel, log_next = conversion.backward_kernel(np.log([1.0, 0.0]), T)
    np.testing.assert_array_equal(kernel, [[1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(log_next, [0.0, -np.inf])


def test_backward_kernel_of_probabilities_below_the_range_of_floating_point():
    kernel, log_next = conversion.backward_kernel(np.array([-2000.0, -2001.0]), np.full((2, 2), 0.5))
    np.testing.assert_allclose(kernel[0], 1.0 / (1.0 + np.exp(-1.0)), rtol=1e-12)
    np.testing.assert_allclose(log_next, np.log(0.5) - 2000.0 + np.log1p(np.exp(-1.0)), rtol=1e-14)


@given(K=st.integers(1, 3), m=st.integers(1, 3), seed=st.integers(0, 999))
@settings(max_examples=20, deadline=None)
def test_the_stationary_covariance_is_where_recursion_18_ends(K, m, seed):
    rng = np.random.default_rng(seed)
    space = random_space(K, m, 1, seed, scale=0.5)
    T = rng.dirichlet(np.ones(K), K)
    p = np.linalg.matrix_power(T, 200)[0]
    kernel = p[:, None] * T / (p @ T)
    radius = np.abs(np.linalg.eigvals(conversion.moment_operator(kernel, space.A))).max()
    G = np.zeros((K, m, m))
    growth, norms = np.array([np.eye(m)] * K), []
    for _ in range(400):
        G = space.A @ np.einsum("ij,ikl->jkl", kernel, G) @ np.swapaxes(space.A, 1, 2)
        G += gaussian.square(space.C)
        growth = space.A @ np.einsum("ij,ikl->jkl", kernel, growth) @ np.swapaxes(space.A, 1, 2)
        norms.append(np.abs(growth).max())
        growth /= norms[-1]
    # the operator carries positive matrices over, and their mean growth is its spectral radius
    assert np.exp(np.log(norms[100:]).mean()) == pytest.approx(radius, rel=0.05)
    if radius < 0.9:
        expected = conversion.stationary_covariance(kernel, space.A, space.C)
        np.testing.assert_allclose(G, expected, rtol=1e-9, atol=1e-12)


def test_advancing_the_window_is_recursion_18_and_shifts():
    K, m, q = 2, 2, 1
    rng = np.random.default_rng(3)
    space, T = random_space(K, m, q, seed=3), rng.dirichlet(np.ones(K), K)
    root = rng.normal(size=(K, m, m))
    law = conversion.first_window(np.log([0.3, 0.7]), root, space.B, space.D)
    kernel, log_next = conversion.backward_kernel(law.log_p, T)
    new = conversion.advance_window(law, moments_of(law, space), space.A, kernel, log_next, length=2)
    S = gaussian.square(new.factor)
    G = gaussian.square(root)
    for j in range(K):
        A, B, C, D = (a[j] for a in space)
        mixed = np.einsum("i,ikl->kl", kernel[:, j], G)
        X = A @ mixed @ A.T + C @ C.T
        np.testing.assert_allclose(S[j, 2:, 2:], X, rtol=1e-12)
        np.testing.assert_allclose(S[j, 0, 0], (B @ X @ B.T + D @ D.T)[0, 0], rtol=1e-12)
        np.testing.assert_allclose(S[j, 2:, :1], X @ B.T, rtol=1e-12)
        # the older entry: Cov(X', y) = A_j sum_i p(i | j) G(i) B_i'
        older = A @ np.einsum("i,ikl,iql->kq", kernel[:, j], G, space.B)
        np.testing.assert_allclose(S[j, 2:, 1:2], older, rtol=1e-12)


# --------------------------------------------------------------------------- constructions


@given(m=st.integers(1, 3), seed=st.integers(0, 9999))
@settings(max_examples=50, deadline=None)
def test_the_construction_of_the_paper_exists_iff_the_criterion_holds(m, seed):
    # Q2 is positive semi-definite iff Var(X' | Y, Y') - A Var(X | Y) A' is
    law, space = random_law(1, 1, m, seed), random_space(1, m, 1, seed, scale=[0.3, 1.0][seed % 2])
    _, P, _, _, _, post = by_formula(law, space, 0, 0)
    least = np.linalg.eigvalsh(post - space.A[0] @ P @ space.A[0].T)[0]
    moments = moments_of(law, space)
    pairs = conversion.markov_x_coefficients(moments, space)
    if least > 1e-6:
        proved = conversion.prove_noise(pairs, moments, str, everywhere(1))
        np.testing.assert_allclose(proved.C, pairs.C, atol=1e-9)
    elif least < -1e-6:
        with pytest.raises(NotPositiveDefiniteError, match="got the eigenvalue -"):
            conversion.prove_noise(pairs, moments, str, everywhere(1))


def test_a_noise_on_the_boundary_is_valid():
    # nothing is seen of a state without noise: X' = A X exactly, and the criterion is zero
    space = StateSpace(np.full((1, 1, 1), 0.7), np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), np.ones((1, 1, 1)))
    moments = moments_of(random_law(1, 1, 1, 5), space)
    proved = conversion.prove_noise(
        conversion.markov_x_coefficients(moments, space), moments, str, everywhere(1)
    )
    np.testing.assert_array_equal(proved.C, 0.0)


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize(("scale", "exists"), [(0.1, True), (1.5, False)])
def test_the_verdict_does_not_depend_on_units(unit, scale, exists):
    law, space = random_law(1, 1, 2, 8), random_space(1, 2, 1, 8, scale=scale)
    change = np.diag([unit, 1.0])  # the first component of the state in other units
    space = StateSpace(
        change @ space.A @ np.linalg.inv(change), space.B @ np.linalg.inv(change), change @ space.C, space.D
    )
    rows = np.concatenate([np.ones(1), np.diag(change)])
    moments = moments_of(law._replace(factor=law.factor * rows[:, None]), space)
    pairs = conversion.markov_x_coefficients(moments, space)
    if exists:
        conversion.prove_noise(pairs, moments, str, everywhere(1))
    else:
        with pytest.raises(NotPositiveDefiniteError):
            conversion.prove_noise(pairs, moments, str, everywhere(1))


@given(m=st.integers(1, 3), seed=st.integers(0, 9999))
@settings(max_examples=30, deadline=None)
def test_clip_is_the_construction_of_the_paper_where_that_exists_and_valid_elsewhere(m, seed):
    law, space = random_law(2, 1, m, seed), random_space(2, m, 1, seed, scale=[0.2, 1.5][seed % 2])
    moments = moments_of(law, space)
    pairs = conversion.clip_coefficients(moments, space, str, everywhere(2))
    printed = conversion.markov_x_coefficients(moments, space)
    for i, j in np.ndindex(2, 2):
        least = np.linalg.eigvalsh(printed.C[i, j])[0]
        if least > 1e-8:
            np.testing.assert_allclose(pairs.Axx[i, j], space.A[j], rtol=1e-7, atol=1e-9)
        else:
            assert np.abs(pairs.Axx[i, j] - space.A[j]).max() > 1e-9
    assert np.linalg.eigvalsh(conversion.noise_covariance(pairs)).min() > -1e-9
    # X' keeps its variance: C + At P At' = P'
    P = gaussian.square(moments.Lx)[:, None]
    total = pairs.C + pairs.Axx @ P @ np.swapaxes(pairs.Axx, -1, -2)
    np.testing.assert_allclose(total, gaussian.square(moments.Lnew), rtol=1e-7, atol=1e-9)


def test_clip_needs_an_uncertain_state():
    space = random_space(1, 2, 2, seed=4)._replace(D=np.zeros((1, 2, 2)))  # the state is seen as it is
    root = np.random.default_rng(4).normal(size=(1, 2, 2))
    law = conversion.first_window(np.zeros(1), root, space.B, space.D)
    with pytest.raises(NotPositiveDefiniteError, match="covariance of X_n given its window"):
        conversion.clip_coefficients(moments_of(law, space), space, str, everywhere(1))


def test_gain_has_no_other_memory_than_the_state():
    # H = 0: given X_n and Y_n+1, the window says nothing more about X_n+1
    law, space = random_law(2, 4, 2, 6), random_space(2, 2, 1, 6)
    pairs = conversion.gain_coefficients(moments_of(law, space), space)
    np.testing.assert_array_equal(pairs.H, np.zeros((2, 2, 2, 4)))


def test_averaged_noise_is_the_average():
    law, space = random_law(2, 1, 2, 7), random_space(2, 2, 1, 7)
    moments = moments_of(law, space)
    kernel, _ = conversion.backward_kernel(law.log_p, np.array([[0.8, 0.2], [0.3, 0.7]]))
    pairs = conversion.gain_coefficients(moments, space)
    averaged = conversion.average_noise(pairs, moments, kernel, str, everywhere(2))
    Q2, got = conversion.noise_covariance(pairs), conversion.noise_covariance(averaged)
    for j in range(2):
        expected = kernel[0, j] * Q2[0, j] + kernel[1, j] * Q2[1, j]
        for i in range(2):
            np.testing.assert_allclose(got[i, j], expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        conversion.transition_matrix(averaged), conversion.transition_matrix(pairs), rtol=1e-9, atol=1e-12
    )


def test_averaging_can_make_an_indefinite_noise_valid():
    # design: what is checked with averaged noise is the average
    for seed in range(200):
        law, space = random_law(2, 1, 1, seed), random_space(2, 1, 1, seed, scale=0.6)
        moments = moments_of(law, space)
        pairs = conversion.markov_x_coefficients(moments, space)
        kernel, _ = conversion.backward_kernel(law.log_p, np.full((2, 2), 0.5))
        average = np.einsum("ij,ijkl->jkl", kernel, conversion.noise_covariance(pairs))
        if pairs.C.min() < -0.01 and np.linalg.eigvalsh(average).min() > 0.01:
            break
    else:
        pytest.fail("no such model among 200")
    conversion.average_noise(pairs, moments, kernel, str, everywhere(2))
    with pytest.raises(NotPositiveDefiniteError):
        conversion.prove_noise(pairs, moments, str, everywhere(2))


def test_lower_factors_of_wide_tall_and_singular_arrays():
    rng = np.random.default_rng(9)
    for shape in ((3, 3, 7), (3, 5, 2), (2, 4, 4)):
        F = rng.normal(size=shape)
        F[0] = 0.0
        L = conversion.lower_factor(F)
        assert L.shape == (*shape[:-1], shape[-2])
        np.testing.assert_allclose(gaussian.square(L), conversion.square(F), atol=1e-12)
        np.testing.assert_array_equal(np.triu(L, 1), 0.0)


# --------------------------------------------------------------------------- scales


@pytest.mark.parametrize(("K", "m", "q"), [(1, 1, 1), (2, 2, 1), (2, 1, 3), (3, 3, 2)])
def test_the_scale_of_the_noise_is_what_it_is_a_difference_of(K, m, q):
    # Var(X' | w) = P' + K V K' and Var(Y' | w) = V: rounding is judged by these
    law, space = random_law(K, 2, m, seed=1), random_space(K, m, q, seed=2)
    moments = moments_of(law, space)
    found = conversion._variances(moments)
    assert found.shape == (K, K, m + q)
    for i, j in np.ndindex(K, K):
        *_, V, gain, post = by_formula(law, space, i, j)
        expected = np.append(np.diag(post + gain @ V @ gain.T), np.diag(V))
        np.testing.assert_allclose(found[i, j], expected, rtol=1e-8)
