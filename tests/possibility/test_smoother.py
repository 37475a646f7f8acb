"""The estimator looks back: reference numbers, definition, gaps, contradictions, verbs of somebody else."""

from __future__ import annotations

from types import MethodType

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    KalmanFilter,
    ParabolicMembership,
)
from fuzzykf.errors import EmptyIntersectionError, ParameterError

#: By t-norm: the shape of the closed family, and the smoothed mean and matrix at n = 0 of the series below.
REFERENCE = {
    "product": (GaussianMembership, 0.43950, 0.25916),
    "hamacher": (CauchyMembership, 0.43535, 0.26749),
    "lukasiewicz": (ParabolicMembership, 0.44417, 0.25096),
}
ZS = [0.5, 0.9, -0.1, 0.4, 0.2]


def scalar(t_norm, **options):
    """F = .9, H = 1.2, Q = .4, R = .7; the prediction for the first measurement is (.3, 1.5)."""
    est = FuzzyRelationEstimator(1, 1, t_norm=t_norm, **options)
    est.F, est.H, est.Q, est.R, est.x, est.P = 0.9, 1.2, 0.4, 0.7, [1 / 3], 1.1 / 0.81
    return est


def state(f):
    return np.concatenate([np.ravel(f.x), np.ravel(f.P)])


@pytest.mark.parametrize("t_norm", REFERENCE)
def test_reference_numbers(t_norm) -> None:
    _, x, P = REFERENCE[t_norm]
    smoothed = scalar(t_norm).smooth(ZS)
    assert smoothed.x[0, 0] == pytest.approx(x, abs=5e-6)
    assert smoothed.P[0, 0, 0] == pytest.approx(P, abs=5e-6)


@pytest.mark.parametrize("t_norm", REFERENCE)
def test_it_is_the_definition_evaluated_on_dense_universes(t_norm) -> None:
    # gamma_n(x) = min over x' of c_n(x) + c_W(x' - f(x)) - c'(x') + gamma_{n+1}(x'), nowhere a closed form
    est, universe = scalar(t_norm), np.linspace(-3.0, 3.0, 2401)
    forward = scalar(t_norm).filter(ZS)
    smoothed = est.smooth(ZS)
    noise = (universe - 0.9 * universe[:, None]) ** 2 / 0.4

    def quadratic(x, P):
        return (universe - x.item()) ** 2 / P.item()

    gamma = quadratic(forward.x[-1], forward.P[-1])
    for n in range(len(ZS) - 2, -1, -1):
        later = gamma - quadratic(forward.x_prior[n + 1], forward.P_prior[n + 1])
        gamma = quadratic(forward.x[n], forward.P[n]) + (noise + later).min(axis=1)
        near = np.abs(universe - smoothed.x[n, 0]) < 1.0
        np.testing.assert_allclose(quadratic(smoothed.x[n], smoothed.P[n])[near], gamma[near], atol=1e-4)


@pytest.mark.parametrize("t_norm", REFERENCE)
@pytest.mark.parametrize("zs", [ZS, [0.5, None, np.nan, 0.4, None], [None], []])
def test_the_last_state_is_that_of_the_filter_and_a_step_goes_on_from_it(t_norm, zs) -> None:
    est, same = scalar(t_norm), scalar(t_norm)
    smoothed, filtered = est.smooth(zs), same.filter(zs)
    for name in ("x", "P", "lower", "upper"):
        got, expected = getattr(smoothed, name), getattr(filtered, name)
        assert got.shape == expected.shape
        np.testing.assert_allclose(got[-1:], expected[-1:], rtol=1e-12)
    np.testing.assert_array_equal(smoothed.possibility, filtered.possibility)
    assert (smoothed.log_likelihood is None) == (t_norm != "product")
    np.testing.assert_array_equal(est.step(0.3), same.step(0.3))
    est.reset()
    np.testing.assert_array_equal(state(est), state(scalar(t_norm)))


@pytest.mark.parametrize("t_norm", REFERENCE)
def test_a_gap_is_two_predictions_in_a_row(t_norm) -> None:
    # a missing measurement adds nothing: one prediction by F^2 and F Q F' + Q says the same
    gapped = scalar(t_norm).smooth([0.5, None, 0.4])
    once = scalar(t_norm)
    once.step(0.5)
    middle = once.x.copy(), once.P.copy()
    once.F, once.Q = 0.81, 0.4 * (1.0 + 0.81)
    prior = 0.81 * once.x.item(), 0.81**2 * once.P.item() + once.Q.item()
    last = once.step(0.4).item(), once.P.item()
    gain = middle[1].item() * 0.81 / prior[1]
    assert gapped.x[0, 0] == pytest.approx(middle[0].item() + gain * (last[0] - prior[0]), rel=1e-12)
    assert gapped.P[0, 0, 0] == pytest.approx(middle[1].item() + gain**2 * (last[1] - prior[1]), rel=1e-12)


def test_what_keep_skipped_is_skipped_and_what_reset_forgot_is_not_told() -> None:
    # parabolic: z = 9 excludes the prediction
    zs, kept = [0.5, 0.6, 9.0, 0.4], [0.5, 0.6, None, 0.4]
    with pytest.raises(EmptyIntersectionError):
        scalar("lukasiewicz").smooth(zs)
    skipped, missing = (
        scalar("lukasiewicz", on_empty="keep").smooth(zs),
        scalar("lukasiewicz").smooth(kept),
    )
    for name in ("x", "P", "lower", "upper"):
        np.testing.assert_array_equal(getattr(skipped, name), getattr(missing, name))
    np.testing.assert_array_equal(skipped.possibility == 0.0, [False, False, True, False])
    zs = [0.5, 0.6, 9.0, 8.0]
    reset = scalar("lukasiewicz", on_empty="reset").smooth(zs)
    before = scalar("lukasiewicz").smooth(zs[:2])
    np.testing.assert_allclose(reset.x[0], before.x[0], rtol=1e-12)
    filtered = scalar("lukasiewicz", on_empty="reset").filter(zs)
    np.testing.assert_array_equal(reset.x[1], filtered.x[1])  # of 9 nothing is known there
    assert reset.x[2] != filtered.x[2]  # but 8 is told to it


def test_a_parabola_stays_within_what_the_filter_left() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        zs = rng.uniform(-1.0, 1.2, 6)
        filtered = scalar("lukasiewicz", on_empty="keep").filter(zs)
        smoothed = scalar("lukasiewicz", on_empty="keep").smooth(zs)
        assert (smoothed.lower >= filtered.lower).all()
        assert (smoothed.upper <= filtered.upper).all()
        assert (smoothed.lower <= smoothed.upper).all()


def test_an_error_leaves_everything_as_it_was() -> None:
    est = scalar("lukasiewicz")
    est.step(0.5)
    before = state(est)
    for zs, error in ([0.5, 40.0], EmptyIntersectionError), ([0.5, np.inf], ParameterError):
        with pytest.raises(error):
            est.smooth(zs)
        np.testing.assert_array_equal(state(est), before)
    est.step(0.4)


# --------------------------------------------------------------------------- verbs of somebody else


def test_the_way_back_follows_verbs_of_a_subclass() -> None:
    class Halving(FuzzyRelationEstimator):
        def update(self, z, **given):
            super().update(None if z is None else 0.5 * np.asarray(z), **given)

    class Twice(FuzzyRelationEstimator):
        def predict(self, **given):
            super().predict(**given)
            super().predict(**given)

    class Clocked(FuzzyRelationEstimator):
        """Sets F and Q for its time, in place."""

        n = 0

        def predict(self, **given):
            self.F = np.full((1, 1), 1.0 + self.n % 2)
            self.Q[0, 0] = 0.1 * (1.0 + self.n)
            self.n += 1
            super().predict(**given)

    def made(cls):
        est = cls(1, 1)
        est.H, est.Q = 1.0, 0.1
        return est

    zs = np.array([0.5, 0.9, -0.1])
    plain = made(FuzzyRelationEstimator)
    np.testing.assert_allclose(made(Halving).smooth(zs).x, plain.smooth(0.5 * zs).x, rtol=1e-12)
    gaps = made(FuzzyRelationEstimator).smooth([None, 0.5, None, 0.9, None, -0.1])
    twice = made(Twice).smooth(zs)
    np.testing.assert_allclose(twice.x, gaps.x[1::2], rtol=1e-12)
    np.testing.assert_allclose(twice.P, gaps.P[1::2], rtol=1e-12)
    patched = made(FuzzyRelationEstimator)
    patched.predict = MethodType(lambda self: [FuzzyRelationEstimator.predict(self) for _ in "ab"], patched)
    np.testing.assert_allclose(patched.smooth(zs).x, twice.x, rtol=1e-12)
    clocked = made(Clocked).smooth(zs)
    kf = KalmanFilter(1, 1, H=[[1.0]])
    Fs, Qs = [[[1.0]], [[2.0]], [[1.0]]], [[[0.1]], [[0.2]], [[0.3]]]
    x, P, _, _ = kf.rts_smoother(*kf.batch_filter(zs, Fs=Fs, Qs=Qs)[:2], Fs, Qs)
    np.testing.assert_allclose(clocked.x, x[..., 0], rtol=1e-12)
    np.testing.assert_allclose(clocked.P, P, rtol=1e-12)


def test_an_assigned_membership_leads_nowhere_back() -> None:
    class Bounded(FuzzyRelationEstimator):
        def update(self, z, **given):
            super().update(z, **given)
            self.membership = GaussianMembership(self.x.ravel(), self.P)

    est = Bounded(1, 1)
    est.H = 1.0
    before = state(est)
    with pytest.raises(ParameterError, match=r"Bounded assigned the membership in step 0.*override smooth"):
        est.smooth(ZS)
    np.testing.assert_array_equal(state(est), before)
    assert est.filter(ZS).x.shape == (5, 1)
