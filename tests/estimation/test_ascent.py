"""The way up, on log-likelihoods whose maxima are known."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import ParameterError
from fuzzykf.estimation.ascent import ascend, maximise
from fuzzykf.estimation.free import read_free

A = np.array([[4.0, 1.5], [1.5, 1.0]])
TOP = np.array([3.0, -200.0])


def plain(*start):
    return read_free({"b": "full"}, {"b": np.array(start)}, covariances=[], vectors=["b"])


def variances(*start):
    return read_free({"R": "diagonal"}, {"R": np.diag(start)}, covariances=["R"])


def quadratic(z):
    d = z - TOP
    return -0.5 * float(d @ A @ d), -A @ d


def walled(z):
    """Without a value where z[0] is above 3.001, just beyond the maximum."""
    return quadratic(z) if z[0] < 3.001 else (np.nan, np.full(2, np.nan))


def edge(z):
    """Exp(z) is a variance that is best at zero, beside one that is best at 4."""
    v = np.exp(z)
    return -3.0 * v[0] - 50.0 * (z[1] + 4.0 / v[1]), np.array([-3.0 * v[0], -50.0 * (1.0 - 4.0 / v[1])])


def two_hills(z):
    """Hills of height 0 at -2 and of height 1 at -4."""
    parts = np.array([-0.5 * (z[0] + 2.0) ** 2 / 0.09, 1.0 - 0.5 * (z[0] + 4.0) ** 2 / 0.09])
    value = np.logaddexp(*parts)
    share = np.exp(parts - value)
    return float(value), np.array([-(share[0] * (z[0] + 2.0) + share[1] * (z[0] + 4.0)) / 0.09])


def saddle(z):
    """(z0^2 - 1)^2 has a saddle at 0, where the gradient vanishes."""
    return -float((z[0] ** 2 - 1.0) ** 2), np.array([-4.0 * z[0] * (z[0] ** 2 - 1.0)])


@pytest.mark.parametrize("f", [quadratic, walled])
def test_the_maximum_is_found_also_beside_what_has_no_value(f) -> None:
    found = ascend(f, plain(-50.0, 0.0), np.array([-50.0, 0.0]))
    np.testing.assert_allclose(found.numbers, TOP, atol=1e-5)
    assert found.converged
    assert found.gain < 1e-7
    assert found.trace[-1] == found.log_likelihood
    assert (np.diff(found.trace) >= 0.0).all()
    np.testing.assert_allclose(found.information, A, rtol=1e-6)


def test_a_variance_goes_to_zero() -> None:
    free = variances(1.0, 1.0)
    found = ascend(edge, free, free.start)
    np.testing.assert_array_equal(found.at_bound, [True, False])
    np.testing.assert_allclose(free.estimates(found.numbers), [0.0, 4.0], rtol=1e-5)
    assert found.converged
    assert found.log_likelihood == pytest.approx(-50.0 * (np.log(4.0) + 1.0), rel=1e-12)
    np.testing.assert_array_equal(found.information[0], 0.0)


def test_a_variance_that_began_too_small_to_be_felt_comes_back() -> None:
    free = variances(1e-16)

    def f(z):  # best at 4, but flat at the start
        v = np.exp(z)
        return float(-5.0 * np.log1p(v[0]) - 25.0 / (1.0 + v[0])), -5.0 * v / (1 + v) + 25.0 * v / (
            1 + v
        ) ** 2

    found = ascend(f, free, free.start)
    np.testing.assert_allclose(free.estimates(found.numbers), [4.0], rtol=1e-4)
    assert found.converged


def test_a_flat_direction_stays_where_it_is() -> None:
    free = variances(1.0, 2.0)

    def f(z):  # of the product of both variances alone
        s = z.sum()
        return float(-(s + 3.0 * np.exp(-s))), np.full(2, -(1.0 - 3.0 * np.exp(-s)))

    found = ascend(f, free, free.start)
    assert np.prod(free.estimates(found.numbers)) == pytest.approx(3.0, rel=1e-4)
    assert np.isfinite(found.numbers).all()
    assert found.converged


def test_a_variance_that_others_can_make_up_for_does_not_go_to_zero() -> None:
    free = variances(0.1, 1.0)

    def f(z):  # of the sum of both variances alone, best at 2
        v = np.exp(z)
        s = v.sum()
        return float(-50.0 * (np.log(s) + 2.0 / s)), -50.0 * (1.0 / s - 2.0 / s**2) * v

    found = ascend(f, free, np.log([1e-9, 1.0]))
    assert np.isfinite(found.numbers).all()
    assert free.estimates(found.numbers).sum() == pytest.approx(2.0, rel=1e-4)
    assert found.converged


def test_a_saddle_is_left() -> None:
    found = ascend(saddle, plain(0.0), np.zeros(1))
    assert abs(found.numbers[0]) == pytest.approx(1.0, abs=1e-4)
    assert found.converged


def test_a_search_that_is_cut_short_says_so() -> None:
    found = ascend(quadratic, plain(-50.0, 0.0), np.array([-50.0, 0.0]), max_iter=1)
    assert not found.converged
    assert found.gain == pytest.approx(-found.log_likelihood, rel=1e-4)  # of a parabola Newton gains all


@pytest.mark.parametrize("max_iter", range(1, 9))
def test_no_more_iterations_are_taken_than_are_allowed(max_iter) -> None:
    start = np.array([-50.0, 0.0])
    found = ascend(quadratic, plain(*start), start, max_iter=max_iter, tolerance=1.0)
    assert len(found.trace) - 1 <= max_iter
    assert found.converged == (found.gain < 1.0)


def test_what_has_no_upper_bound_does_not_converge() -> None:
    found = ascend(lambda z: (float(z[0]), np.ones(1)), plain(0.0), np.zeros(1), max_iter=20)
    assert not found.converged


def test_a_start_without_a_value_is_refused() -> None:
    with pytest.raises(ParameterError, match="free: the log-likelihood of the start is nan"):
        ascend(walled, plain(5.0, 0.0), np.array([5.0, 0.0]))


def test_every_iteration_is_told() -> None:
    ticks = []
    found = ascend(quadratic, plain(9.0, 9.0), np.full(2, 9.0), tick=lambda: ticks.append(1))
    assert len(ticks) == len(found.trace) - 1 > 0


def test_several_starts_find_several_maxima_best_first() -> None:
    found = maximise(two_hills, plain(-2.5), n_starts=12, rng=np.random.default_rng(0))
    assert found.n_starts == 12
    assert [round(float(one.numbers[0]), 3) for one in found.maxima] == [-4.0, -2.0]
    assert found.maxima[0].log_likelihood == pytest.approx(1.0)
    alone = maximise(two_hills, plain(-2.5))
    assert [round(float(one.numbers[0]), 3) for one in alone.maxima] == [-2.0]


def test_maxima_along_a_flat_direction_are_one() -> None:
    def f(z):
        s = z.sum()
        return -0.5 * float(s**2), np.full(2, -s)

    assert len(maximise(f, plain(1.0, 1.0), n_starts=6, rng=np.random.default_rng(0)).maxima) == 1


def test_starts_without_a_value_are_drawn_again_or_left_out() -> None:
    def f(z):  # only the first start has a value
        return (0.0, np.zeros(1)) if z[0] == 1.0 else (np.inf, np.zeros(1))

    found = maximise(f, plain(1.0), n_starts=3, rng=np.random.default_rng(0))
    assert found.n_starts == 1


def test_more_starts_need_a_generator() -> None:
    with pytest.raises(ParameterError, match="rng: missing"):
        maximise(quadratic, plain(0.0, 0.0), n_starts=2)


def test_a_start_is_prepared() -> None:
    found = maximise(quadratic, plain(0.0, 0.0), prepare=lambda start: start + TOP)
    assert len(found.maxima[0].trace) == 1  # it began at the top
