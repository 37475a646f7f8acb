"""Forms of the Gaussian part: interpolation by definition, the constraint, what is refused."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.switching.dynamics.forms import CovarianceForm, RegressionForm, TransitionForm

#: Covariances of Z in the two regimes, and of Z_2 with Z_1 for each pair; rows X, Y.
S = np.array([[[0.5, 0.3], [0.3, 1.0]], [[0.75, 0.3], [0.3, 0.5]]])
K = np.array(
    [
        [[[0.1, 0.35], [0.12, 0.4]], [[0.5, 0.33], [0.18, 0.6]]],
        [[[0.1, 0.35], [0.24, 0.4]], [[0.5, 0.33], [0.18, 0.3]]],
    ]
)
MEANS = np.array([[0.0, 3.0], [1.0, -1.0]])


def gamma():
    return np.array([[np.block([[S[i], K[i, j].T], [K[i, j], S[j]]]) for j in range(2)] for i in range(2)])


def shares(*r):
    return np.array([[1 - v, v] for v in r])


def pair(form, r1, r2):
    return form.pairs(shares(r1), shares(r2), str)


def describe(index):
    return f"pair {index}"


# --------------------------------------------------------------------------- covariance form


def test_marginal_is_linear():
    form = CovarianceForm(MEANS, gamma(), 1, "project")
    mean, covariance = form.marginal(shares(0.0, 0.25, 1.0))
    np.testing.assert_allclose(mean, [MEANS[0], 0.75 * MEANS[0] + 0.25 * MEANS[1], MEANS[1]])
    np.testing.assert_allclose(covariance, [S[0], 0.75 * S[0] + 0.25 * S[1], S[1]])


@pytest.mark.parametrize("constraint", ["project", "check"])
def test_hard_pairs_reproduce_the_covariances(constraint):
    # from the regressions, Cov(Z_2, Z_1) and Cov(Z_2) come out as they were given
    form = CovarianceForm(MEANS, gamma(), 1, constraint)
    for i in range(2):
        for j in range(2):
            p = pair(form, float(i), float(j))
            A = np.block([[p.Axx[0], p.H[0] + p.G[0] @ p.Ayy[0]], [np.zeros((1, 1)), p.Ayy[0]]])
            np.testing.assert_allclose(A @ S[i], K[i, j], atol=1e-14)
            V, G = p.Qyy[0], p.G[0]
            Q = np.block([[p.C[0] + G @ V @ G.T, G @ V], [V @ G.T, V]])
            np.testing.assert_allclose(A @ S[i] @ A.T + Q, S[j], atol=1e-14)
            offset = np.r_[p.c[0] + G @ p.Ny[0], p.Ny[0]]
            np.testing.assert_allclose(A @ MEANS[i] + offset, MEANS[j], atol=1e-14)


def test_interpolating_breaks_the_constraint_and_so_it_is_set_at_every_pair():
    # (42) of the paper is bilinear in all entries: half-way between four matrices that satisfy
    # Cov(Y_2, X_1) = c Syy^-1 Syx it gives .18 where .17 is needed; the tables have .17
    middle = gamma().mean(axis=(0, 1))
    needed = middle[1, 3] * middle[0, 1] / middle[1, 1]
    assert (middle[0, 3], needed) == pytest.approx((0.18, 0.17))
    p = pair(CovarianceForm(MEANS, gamma(), 1, "project"), 0.5, 0.5)
    A = np.block([[p.Axx[0], p.H[0] + p.G[0] @ p.Ayy[0]], [np.zeros((1, 1)), p.Ayy[0]]])
    expected = middle[2:, :2].copy()
    expected[1, 0] = needed
    np.testing.assert_allclose(A @ middle[:2, :2], expected, atol=1e-14)


def test_the_noise_as_printed_does_not_keep_the_covariance():
    # (45) is printed with an inverse of Sigma(r_2); test_hard_pairs_reproduce_the_covariances
    # shows that without it A Sigma(r_1) A' + Q = Sigma(r_2)
    A = K[0, 1] @ np.linalg.inv(S[0])
    printed = np.linalg.inv(S[1]) - A @ K[0, 1].T
    assert np.abs(A @ S[0] @ A.T + printed - S[1]).max() > 1.0


def test_projection_ignores_what_is_given():
    # d = b c / sigma_Y^2 is set, at the hard pairs and in between
    other = gamma()
    other[..., 3, 0] += 0.05
    other[..., 0, 3] += 0.05
    a, b = (CovarianceForm(MEANS, g, 1, "project") for g in (gamma(), other))
    for r1, r2 in ((0.0, 1.0), (0.3, 0.8)):
        for x, y in zip(pair(a, r1, r2), pair(b, r1, r2), strict=True):
            np.testing.assert_array_equal(x, y)


def test_check_names_the_entry_and_by_how_much():
    off = gamma()
    off[1, 0, 3, 0] = off[1, 0, 0, 3] = 0.25
    message = (
        r"covariances\[1, 0\]: Cov\(Y2\[0\], X1\[0\]\) \(row 3, column 0\) is 0\.25, but the model needs "
        r"c Syy\^-1 Syx = 0\.24, off by 0\.01"
    )
    with pytest.raises(ParameterError, match=message):
        CovarianceForm(MEANS, off, 1, "check")
    CovarianceForm(MEANS, off, 1, "project")
    CovarianceForm(MEANS, gamma(), 1, "check")


def test_the_printed_matrices_fail_the_check():
    # the paper prints Gamma_00 with .06 where .12 is right and Gamma_01 with .14 where .18 is
    for (i, j), printed, needed in (((0, 0), 0.06, r"0\.12"), ((0, 1), 0.14, r"0\.18")):
        off = gamma()
        off[i, j, 3, 0] = off[i, j, 0, 3] = printed
        with pytest.raises(ParameterError, match=rf"covariances\[{i}, {j}\].* = {needed}, off by"):
            CovarianceForm(MEANS, off, 1, "check")


@pytest.mark.parametrize("scale", [1e-7, 1e7])
def test_check_does_not_depend_on_units(scale):
    D = np.tile([scale, 1.0], 2)
    CovarianceForm(MEANS, gamma() * D[:, None] * D, 1, "check")
    off = gamma()
    off[1, 0, 3, 0] = off[1, 0, 0, 3] = 0.2401
    with pytest.raises(ParameterError, match=r"covariances\[1, 0\]: Cov\(Y2\[0\], X1\[0\]\)"):
        CovarianceForm(MEANS, off * D[:, None] * D, 1, "check")


@pytest.mark.parametrize("scale", [1e-7, 1.0, 1e7])
@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ((0, 1, 2, 0), r"covariances: expected symmetric matrices, got .* at \(0, 1, [02], [02]\) but"),
        ((0, 1, 3, 1), r"covariances: expected symmetric matrices, got .* at \(0, 1, [13], [13]\) but"),
    ],
)
def test_asymmetry(entry, message, scale):
    D, off = np.tile([scale, 1.0], 2), gamma()
    off[entry] *= 1.001
    with pytest.raises(ParameterError, match=message):
        CovarianceForm(MEANS, off * D[:, None] * D, 1, "project")


@pytest.mark.parametrize("scale", [1e-7, 1.0, 1e7])
@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ((0, 1, 2, 2), r"covariances\[0, 1\]: the second diagonal block .* regime 1 .* entry \(0, 0\)"),
        ((0, 1, 1, 1), r"covariances\[0, 1\]: the first diagonal block .* regime 0 .* entry \(1, 1\)"),
        ((1, 1, 3, 3), r"covariances\[1, 1\]: the second diagonal block .* regime 1 .* entry \(1, 1\)"),
    ],
)
def test_blocks_have_to_agree(entry, message, scale):
    D, off = np.tile([scale, 1.0], 2), gamma()
    off[entry] *= 1.001
    with pytest.raises(ParameterError, match=message):
        CovarianceForm(MEANS, off * D[:, None] * D, 1, "project")


@pytest.mark.parametrize("scale", [1e-7, 1.0, 1e7])
def test_indefinite_noise_names_pair_and_eigenvalue(scale):
    # a = .7 at (0, 1): Var(X_2 | Z_1, Y_2) would be negative
    D, off = np.tile([scale, 1.0], 2), gamma()
    off[0, 1, 2, 0] = off[0, 1, 0, 2] = 0.7
    form = CovarianceForm(MEANS, off * D[:, None] * D, 1, "project")
    with pytest.raises(
        NotPositiveDefiniteError, match=r"noise covariance of the pair \(0,\): .* eigenvalue -"
    ):
        form.pairs(shares(0.0), shares(1.0), describe)
    form.pairs(shares(0.0), shares(0.0), describe)
    # not checked where it cannot occur
    p = form.pairs(shares(0.0, 0.0), shares(0.0, 1.0), describe, np.array([True, False]))
    assert np.isfinite(p.C).all()


def test_eigenvalue_in_the_message_is_that_of_the_noise():
    off = gamma()
    off[0, 1, 2, 0] = off[0, 1, 0, 2] = 0.7
    k = K[0, 1].copy()
    k[0, 0], k[1, 0] = 0.7, 0.18
    Q = S[1] - k @ np.linalg.inv(S[0]) @ k.T
    smallest = np.linalg.eigvalsh(Q)[0]
    with pytest.raises(NotPositiveDefiniteError, match=f"eigenvalue {smallest:.6g} "):
        pair(CovarianceForm(MEANS, off, 1, "project"), 0.0, 1.0)


def test_unlike_units_are_no_reason_to_refuse():
    # components of Y of very different size are definite all the same
    d = np.array([1.0, 1e-8, 1e8])
    Sigma = np.array([[1, 0.3, 0.2], [0.3, 1, 0.4], [0.2, 0.4, 1]]) * d[:, None] * d
    A = 0.3 * np.eye(3)
    cross = A @ Sigma
    g = np.broadcast_to(np.block([[Sigma, cross.T], [cross, Sigma]]), (2, 2, 6, 6))
    form = CovarianceForm(np.zeros((2, 3)), g, 1, "project")
    p = form.pairs(shares(0.4), shares(0.9), describe)
    np.testing.assert_allclose(p.Qyy[0], 0.91 * Sigma[1:, 1:], rtol=1e-9)


def test_singular_noise_is_valid():
    # Z' = A Z exactly but for the noise of Y: the state noise has rank zero, but for rounding
    for seed in range(20):
        rng = np.random.default_rng(seed)
        b = rng.normal()
        Sigma = np.array([[b * b, b], [b, 1.0]])
        Sigma[0, 0] += 1.0
        a, c = 0.6, 0.5
        # X' = a X + g (Y' - c Y) + h Y without noise of its own, with Var X' = Var X
        V = Sigma[1, 1] * (1 - c * c)
        g_ = 0.3
        K_yy, K_yx = c * Sigma[1, 1], c * Sigma[1, 0]
        h = 0.1
        K_xx, K_xy = a * Sigma[0, 0] + h * Sigma[1, 0], a * Sigma[0, 1] + h * Sigma[1, 1]
        after = np.array([[a * K_xx + h * K_xy + g_ * g_ * V, 0.0], [0.0, Sigma[1, 1]]])
        after[0, 1] = after[1, 0] = c * K_xy + g_ * V
        cross = np.array([[K_xx, K_xy], [K_yx, K_yy]])
        # regime 1 has the covariance that follows; it never returns to regime 0 here
        pair_covariance = np.block([[Sigma, cross.T], [cross, after]])
        full = np.empty((2, 2, 4, 4))
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            first, second = (Sigma, after)[i], (Sigma, after)[j]
            full[i, j] = np.block([[first, np.zeros((2, 2))], [np.zeros((2, 2)), second]])
        full[0, 1] = pair_covariance
        p = CovarianceForm(np.zeros((2, 2)), full, 1, "project").pairs(shares(0.0), shares(1.0), describe)
        assert p.C[0, 0, 0] == pytest.approx(0.0, abs=1e-12)
        assert p.C[0, 0, 0] >= 0.0
        np.testing.assert_allclose([p.Axx[0, 0, 0], p.G[0, 0, 0]], [a, g_], rtol=1e-9)


# --------------------------------------------------------------------------- transition form


def test_transition_between_the_regimes():
    A = np.array(
        [[[[0.5, 0.2], [0, 0.4]], [[0.3, 0.0], [0, 0.8]]], [[[0.1, 0.1], [0, 0.2]], [[0.9, 0.0], [0, 0.6]]]]
    )
    Q = np.stack([np.stack([np.diag([1.0, 4.0]), np.diag([4.0, 9.0])]), np.stack([np.eye(2), np.eye(2)])])
    form = TransitionForm(A, Q, MEANS, S, 1)
    p = pair(form, 0.25, 0.5)
    w = np.array([[0.375, 0.375], [0.125, 0.125]])
    expected = np.einsum("ij,ijkl->kl", w, A)
    root = np.einsum("ij,ijk->k", w, np.sqrt(np.diagonal(Q, axis1=-2, axis2=-1)))
    np.testing.assert_allclose(p.Axx[0, 0, 0], expected[0, 0])
    np.testing.assert_allclose(p.Ayy[0, 0, 0], expected[1, 1])
    np.testing.assert_allclose([p.C[0, 0, 0], p.Qyy[0, 0, 0]], root**2, rtol=1e-14)
    offset = 0.5 * MEANS.sum(axis=0) - expected @ (0.75 * MEANS[0] + 0.25 * MEANS[1])
    np.testing.assert_allclose(p.Ny[0, 0], offset[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": (0, 1, 1, 0)}, r"A\[0, 1\]: the entry \(1, 0\), from X_n to Y_n\+1, is 9, expected 0"),
        ({"Q": (0, 1, 1, 0)}, r"Q: expected symmetric matrices"),
        (
            {"Q": (1, 0, 0, 0)},
            r"Q\[1\]\[0\]: expected a positive semi-definite matrix, got the eigenvalue -9",
        ),
        ({"stationary": (1, 1, 1)}, r"stationary\[1\]: expected a positive semi-definite matrix"),
    ],
)
def test_bad_transitions(change, message):
    d = {
        "A": np.zeros((2, 2, 2, 2)),
        "Q": np.broadcast_to(np.eye(2), (2, 2, 2, 2)).copy(),
        "stationary": S.copy(),
    }
    for name, where in change.items():
        d[name][where] = -9.0 if where[-1] == where[-2] else 9.0
    with pytest.raises(ParameterError, match=message):
        TransitionForm(d["A"], d["Q"], MEANS, d["stationary"], 1)


def test_the_first_observation_needs_a_density():
    Sigma = S.copy()
    Sigma[1] = np.diag([1.0, 0.0])
    with pytest.raises(NotPositiveDefiniteError, match=r"stationary\[1\], its block of the observation"):
        TransitionForm(np.zeros((2, 2, 2, 2)), np.broadcast_to(np.eye(2), (2, 2, 2, 2)), MEANS, Sigma, 1)
    # a first state without spread is fine
    Sigma[1] = np.diag([0.0, 1.0])
    TransitionForm(np.zeros((2, 2, 2, 2)), np.broadcast_to(np.eye(2), (2, 2, 2, 2)), MEANS, Sigma, 1)


# --------------------------------------------------------------------------- regression form


def regressions(m=1, q=1, **changes):
    one = {
        "Ayy": np.full((2, 2, q, q), 0.5),
        "Ny": np.zeros((2, 2, q)),
        "Qyy": np.broadcast_to(np.eye(q), (2, 2, q, q)),
        "Axx": np.full((2, 2, m, m), 0.5),
        "H": np.zeros((2, 2, m, q)),
        "G": np.zeros((2, 2, m, q)),
        "c": np.zeros((2, 2, m)),
        "C": np.broadcast_to(np.eye(m), (2, 2, m, m)),
        "means": np.zeros((2, m + q)),
        "covariances": np.broadcast_to(np.eye(m + q), (2, m + q, m + q)),
    }
    return one | changes


def test_regressions_between_the_regimes():
    values = np.arange(1.0, 5.0).reshape(2, 2, 1, 1)
    form = RegressionForm(**regressions(Axx=values, C=values, Qyy=values[::-1], c=values[..., 0]))
    p = pair(form, 0.25, 0.5)
    w = np.array([0.375, 0.375, 0.125, 0.125])
    assert p.Axx[0, 0, 0] == pytest.approx(w @ [1, 2, 3, 4])
    assert p.c[0, 0] == pytest.approx(w @ [1, 2, 3, 4])
    assert p.C[0, 0, 0] == pytest.approx(np.prod(np.array([1, 2, 3, 4.0]) ** w))
    assert p.Qyy[0, 0, 0] == pytest.approx(np.prod(np.array([3, 4, 1, 2.0]) ** w))


def test_singular_state_noise_in_the_regressions():
    form = RegressionForm(**regressions(C=np.zeros((2, 2, 1, 1))))
    assert pair(form, 0.3, 0.6).C[0, 0, 0] == 0.0
    # singular at some pairs only: between them no interpolation exists, but is not needed where
    # no path leads
    C = np.ones((2, 2, 1, 1))
    C[0, 1] = 0.0
    form = RegressionForm(**regressions(C=C))
    with pytest.raises(NotPositiveDefiniteError, match="C: the matrix number 1 is singular"):
        pair(form, 0.5, 0.5)
    p = form.pairs(shares(0.0, 0.5), shares(1.0, 0.5), describe, np.array([True, False]))
    assert p.C[0, 0, 0] == 0.0
    assert np.isfinite(p.C).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"Ayy": np.zeros((2, 2, 2, 1))}, r"Ayy: got shape \(2, 2, 2, 1\), expected \(2, 2, 1, 1\)"),
        ({"Axx": np.zeros((2, 3, 1, 1))}, r"Axx: got shape \(2, 3, 1, 1\), expected \(2, 2, 1, 1\)"),
        ({"Axx": np.zeros((2, 2, 1, 2))}, r"Axx: got shape \(2, 2, 1, 2\), expected \(2, 2, 2, 2\)"),
        ({"G": np.zeros((2, 2, 2, 1))}, r"G: got shape \(2, 2, 2, 1\), expected \(2, 2, 1, n\)"),
        ({"c": np.full((2, 2, 1), np.nan)}, r"c: entry \(0, 0, 0\) is nan, expected finite"),
        ({"means": np.zeros((2, 3))}, r"means: got shape \(2, 3\), expected \(2, 2\)"),
        ({"C": -np.ones((2, 2, 1, 1))}, r"C\[0\]\[0\]: expected a positive semi-definite .* eigenvalue -1"),
        ({"Qyy": np.zeros((2, 2, 1, 1))}, r"Qyy\[0\]\[0\]: expected a positive definite .* eigenvalue 0"),
        (
            {"covariances": np.zeros((2, 2, 2))},
            r"covariances\[0\], its block of the observation: .* definite",
        ),
        ({"covariances": [[[1, 2], [2, 1]]] * 2}, r"covariances\[0\]: .* eigenvalue -1"),
        ({"covariances": [[[1, 0.5], [0, 1]]] * 2}, "covariances: expected symmetric matrices"),
    ],
)
def test_bad_regressions(changes, message):
    with pytest.raises(ParameterError, match=message):
        RegressionForm(**regressions(**changes))


# --------------------------------------------------------------------------- common


@pytest.mark.parametrize(
    ("means", "covariances", "dim_x", "error", "message"),
    [
        (MEANS, gamma()[:1], 1, ShapeError, r"covariances: got shape \(1, 2, 4, 4\), expected"),
        (MEANS[:, :1], gamma(), 1, ShapeError, "means: got 1 column, expected at least 2"),
        (MEANS[0], gamma(), 1, ShapeError, r"means: got shape \(2,\), expected \(n, n\)"),
        (MEANS * np.nan, gamma(), 1, ParameterError, r"means: entry \(0, 0\) is nan, expected finite"),
        (MEANS, gamma() * np.nan, 1, ParameterError, r"covariances: entry .* is nan"),
        (MEANS, gamma(), 0, ParameterError, "dim_x: got 0, expected a whole number from 1 to 1"),
        (MEANS, gamma(), 2, ParameterError, "dim_x: got 2, expected a whole number from 1 to 1"),
        (MEANS, gamma(), 1.5, ParameterError, "dim_x: got 1.5"),
        (MEANS, gamma(), None, ParameterError, "dim_x: got None"),
        (MEANS, gamma(), np.nan, ParameterError, "dim_x: got nan"),
        (MEANS, -gamma(), 1, NotPositiveDefiniteError, "covariance of Z in the regime 0: .* eigenvalue -"),
        (np.empty((0, 2)), np.empty((0, 0, 4, 4)), 1, ParameterError, "means: got no regime"),
    ],
)  # fmt: skip
def test_bad_covariance_forms(means, covariances, dim_x, error, message):
    with pytest.raises(error, match=message):
        CovarianceForm(means, covariances, dim_x, "project")


def test_bad_constraint():
    with pytest.raises(ParameterError, match="constraint: got 'repair', expected 'project' or 'check'"):
        CovarianceForm(MEANS, gamma(), 1, "repair")


FORMS = [
    CovarianceForm(MEANS, gamma(), 1, "project"),
    TransitionForm(np.zeros((2, 2, 2, 2)), np.broadcast_to(np.eye(2), (2, 2, 2, 2)), MEANS, S, 1),
    RegressionForm(**regressions()),
]


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.kind)
def test_forms_never_change(form):
    assert copy.deepcopy(form) is form
    for again in (form, pickle.loads(pickle.dumps(form))):
        with pytest.raises(AttributeError, match=r"means: a .*Form never changes"):
            again.means = MEANS
        with pytest.raises(ValueError, match="read-only"):
            again.means[0, 0] = 1.0
    p, other = pair(form, 0.3, 0.4), pair(pickle.loads(pickle.dumps(form)), 0.3, 0.4)
    for a, b in zip(p, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_was_given_may_change_afterwards():
    means, covariances = MEANS.copy(), gamma()
    form = CovarianceForm(means, covariances, 1, "project")
    before = pair(form, 0.3, 0.4)
    means[:] = 9.0
    covariances[:] = 0.0
    for a, b in zip(before, pair(form, 0.3, 0.4), strict=True):
        np.testing.assert_array_equal(a, b)
