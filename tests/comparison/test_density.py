"""The density of a mixture is that of its definition, whatever is unknown, singular or far away."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from fuzzykf import FilterResult
from fuzzykf.comparison import Estimates, NormalMixture
from fuzzykf.comparison.evaluation import log_score
from fuzzykf.errors import ParameterError, ShapeError


def drawn(n: int = 6, M: int = 3, m: int = 2, seed: int = 0) -> NormalMixture:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, M, m, m))
    return NormalMixture(
        weights=rng.dirichlet(np.ones(M), size=n),
        means=rng.normal(size=(n, M, m)),
        covariances=root @ np.swapaxes(root, -1, -2),
    )


def by_definition(mixture: NormalMixture, x: np.ndarray) -> np.ndarray:
    """Oracle: scipy's densities of what is known, one step and one component after another."""
    found = []
    for k, state in enumerate(x):
        part = np.flatnonzero(~np.isnan(state))
        density = sum(
            w * multivariate_normal(mean[part], P[np.ix_(part, part)]).pdf(state[part])
            for w, mean, P in zip(mixture.weights[k], mixture.means[k], mixture.covariances[k], strict=True)
        )
        found.append(np.log(density))
    return np.array(found)


def test_the_density_is_that_of_what_is_known() -> None:
    mixture, x = drawn(), np.random.default_rng(1).normal(size=(6, 2))
    x[1, 0] = x[4, 1] = np.nan
    np.testing.assert_allclose(mixture.log_density(x), by_definition(mixture, x), rtol=1e-10)
    x[2] = np.nan  # nothing is
    assert mixture.log_density(x)[2] == 0.0


def test_one_law_is_the_normal_law_of_mean_and_standard_deviation() -> None:
    rng = np.random.default_rng(2)
    mean, std, x = rng.normal(size=(5, 2)), rng.uniform(0.1, 2.0, size=(5, 2)), rng.normal(size=(5, 2))
    one = NormalMixture.normal(mean, std)
    np.testing.assert_allclose(one.log_density(x), norm.logpdf(x, mean, std).sum(axis=1))
    np.testing.assert_allclose(one.moments(), (mean, std))
    for got, expected in zip(one.interval(0.8), Estimates(mean=mean, std=std).interval(0.8), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12)
    np.testing.assert_allclose(Estimates(mean=mean, std=std).interval(0.8)[1], norm.ppf(0.9, mean, std))


def test_the_interval_leaves_a_tail_on_either_side() -> None:
    mixture = drawn()
    std = np.sqrt(np.diagonal(mixture.covariances, axis1=-2, axis2=-1))
    for end, share in zip(mixture.interval(0.9), (0.05, 0.95), strict=True):
        below = (mixture.weights[..., None] * norm.cdf(end[:, None], mixture.means, std)).sum(axis=1)
        np.testing.assert_allclose(below, share, atol=1e-12)


@pytest.mark.filterwarnings("error")
def test_far_states_and_laws_without_weight_have_a_finite_density() -> None:
    two = NormalMixture(weights=[[1.0, 0.0]], means=[[[0.0], [1e6]]], covariances=[[[[1.0]], [[0.0]]]])
    assert two.log_density([[1e6]])[0] == pytest.approx(norm.logpdf(1e6))


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        ([1.0, 2.0], np.inf),  # on the line x1 = 2 x0, on which the first law lives
        ([1.0, 1.0], np.log(0.5) + norm.logpdf([1.0, 1.0]).sum()),  # beside it: the second law alone
        ([1.0, np.nan], np.log(norm.pdf(1.0))),  # of which only the first component is known
        ([np.nan, 1.0], np.log(0.5 * norm.pdf(1.0, scale=2.0) + 0.5 * norm.pdf(1.0))),
    ],
)
def test_a_law_without_spread_in_some_direction_counts_only_where_it_is_right(x, expected) -> None:
    line = [[1.0, 2.0], [2.0, 4.0]]
    two = NormalMixture(weights=[[0.5, 0.5]], means=np.zeros((1, 2, 2)), covariances=[[line, np.eye(2)]])
    assert two.log_density([x])[0] == pytest.approx(expected)
    sure = NormalMixture(weights=[[1.0]], means=[[[0.0, 0.0]]], covariances=np.zeros((1, 1, 2, 2)))
    assert sure.log_density([[0.0, 1.0]])[0] == -np.inf
    assert sure.log_density([[0.0, 0.0]])[0] == np.inf


def test_a_score_in_other_units_is_that_of_the_mixture_in_them() -> None:
    mixture, scale, x = drawn(), np.array([10.0, 0.2]), np.random.default_rng(3).normal(size=(6, 2))
    x[3, 0] = np.nan
    mean, std = mixture.moments()
    other = NormalMixture(
        weights=mixture.weights,
        means=mixture.means / scale,
        covariances=mixture.covariances / scale[:, None] / scale,
    )
    got = log_score(Estimates(mean=mean, std=std, density=mixture), x, scale)
    np.testing.assert_allclose(got, other.log_density(x / scale), rtol=1e-10)


def test_stretches_follow_one_another_and_pools_mix_whatever_their_sizes() -> None:
    few, many = drawn(4, 2, 1), drawn(4, 5, 1, seed=1)
    x = np.random.default_rng(4).normal(size=(8, 1))
    both = pickle.loads(pickle.dumps(NormalMixture.joined([few, many])))
    assert (len(both), both.n_components) == (8, 5)
    expected = np.concatenate([few.log_density(x[:4]), many.log_density(x[4:])])
    np.testing.assert_allclose(both.log_density(x), expected)
    pool = NormalMixture.pooled([few, many], [0.25, 0.75])
    density = 0.25 * np.exp(few.log_density(x[:4])) + 0.75 * np.exp(many.log_density(x[:4]))
    np.testing.assert_allclose(pool.log_density(x[:4]), np.log(density))


def test_what_is_no_mixture_is_refused_by_name() -> None:
    good = vars(drawn(2, 2, 1))
    for change, error, message in (
        ({"weights": np.ones(2)}, ShapeError, r"weights: got shape \(2,\), expected \(n, M\)"),
        ({"means": np.zeros((2, 3, 1))}, ShapeError, r"means: got shape .*, expected \(2, 2, m\)"),
        (
            {"covariances": np.ones((2, 2))},
            ShapeError,
            r"covariances: got shape \(2, 2\), expected \(2, 2, 1,",
        ),
        ({"weights": np.ones((2, 2))}, ParameterError, r"weights: got \[1.0, 1.0\] at step 0"),
        ({"weights": [[1.0, 0.0], [1.5, -0.5]]}, ParameterError, r"weights: got \[1.5, -0.5\] at step 1"),
        (
            {"means": [[[0.0], [0.0]], [[0.0], [np.nan]]]},
            ParameterError,
            "means: got NaN or infinity at step 1",
        ),
        (
            {"covariances": -np.ones((2, 2, 1, 1))},
            ParameterError,
            "covariances: got a variance of -1 at step 0",
        ),
    ):
        with pytest.raises(error, match=message):
            NormalMixture(**(good | change))
    with pytest.raises(ShapeError, match=r"x: got shape \(2,\), expected \(2, 1\)"):
        drawn(2, 2, 1).log_density(np.zeros(2))
    for wrong in (0.0, 1.0, np.nan):
        with pytest.raises(ParameterError, match="level: got"):
            drawn(2, 2, 1).interval(wrong)
    with pytest.raises(ParameterError, match="result: it holds no mu, node_x and node_P"):
        NormalMixture.of(FilterResult(x=np.zeros((3, 1)), P=np.ones((3, 1, 1))))
