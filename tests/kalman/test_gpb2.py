"""GPB2 of plain Kalman filters, all pairs at once, is GPB2 pair by pair, whatever comes in."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import FuzzykfError, NotPositiveDefiniteError, ParameterError
from fuzzykf.kalman import IMMEstimator, KalmanFilter
from fuzzykf.kalman.gpb2 import PairBranches


class PairByPair(KalmanFilter):
    """A filter with a verb of its own is not computed with its bank at once, but pair by pair."""

    def predict(self, *arguments, **named):
        super().predict(*arguments, **named)


#: (dim_x, dim_z, modes)
SIZES = [(1, 1, 2), (2, 1, 3), (4, 2, 7), (3, 3, 3), (6, 2, 2), (16, 5, 2), (1, 16, 2), (17, 1, 2)]
ONCE = (0.7, 0.2, 0.1)


def transition(K):
    M = np.full((K, K), 0.1 / (K - 1))
    np.fill_diagonal(M, 0.9)
    return M


def without_last_column(K):
    M = transition(K)[:, :-1]
    return np.hstack([M / M.sum(axis=1, keepdims=True), np.zeros((K, 1))])


def cycle(K):
    return np.roll(np.eye(K), 1, axis=1)


#: How modes follow one another, and what comes in: functions of the sizes.
LAWS = {
    "usual": (transition, lambda K: np.arange(1.0, K + 1.0)),
    "a mode that is not reached": (without_last_column, lambda K: np.ones(K)),
    "a mode that is not there": (transition, lambda K: np.append(np.ones(K - 1), 0.0)),
    "neither": (without_last_column, lambda K: np.append(np.ones(K - 1), 0.0)),
    "no switches": (np.eye, lambda K: np.append(np.ones(K - 1), 0.0)),
    "a cycle": (cycle, lambda K: np.append(np.zeros(K - 1), 1.0)),
}


def plain(rng, n, m):
    return 2.0 * rng.normal(size=(n, m))


def with_gaps(rng, n, m):
    zs = plain(rng, n, m)
    zs[rng.random(zs.shape) < 0.4] = np.nan
    zs[[0, 3, n - 1]] = np.nan
    return zs


def with_outliers(rng, n, m):
    zs = plain(rng, n, m)
    zs[2] = 1e3
    zs[5, 0] = -1e3
    return zs


SERIES = {"plain": plain, "gaps": with_gaps, "outliers": with_outliers}


def bank(kind, size, law, flat=False):
    n, m, K = size
    rng = np.random.default_rng(0)
    filters = []
    for k in range(K):
        F, H, x = rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=n)
        F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
        f = kind(n, m, x=x if flat else x[:, None], F=F, H=H, P=1.0 + k, Q=(0.1 + k) * np.eye(n))
        f.R, f.alpha = (0.5 + 0.2 * k) * np.eye(m), 1.0 + 0.02 * k
        filters.append(f)
    M, mu = LAWS[law]
    return IMMEstimator(filters, mu(K), M(K), method="gpb2")


def assert_close(got, expected, name):
    got, expected = (np.asarray(value, dtype=np.float64) for value in (got, expected))
    assert got.shape == expected.shape, name
    scale = np.abs(expected[np.isfinite(expected)]).max(initial=1.0)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * scale, err_msg=name)


def assert_same(f, g):
    """All attributes of two banks and of their members."""
    for one, other in zip((f, *f.filters), (g, *g.filters), strict=True):
        assert vars(one).keys() - {"_origin"} == vars(other).keys() - {"_origin"}
        for name, expected in vars(other).items():
            if name in {"filters", "_origin", "inv", "_log_likelihood", "_likelihood", "_mahalanobis"}:
                continue  # objects; or numbers that are computed when they are read
            value = vars(one)[name]
            if expected is None or (isinstance(expected, np.ndarray) and expected.dtype == object):
                np.testing.assert_equal(value, expected, err_msg=name)
            elif name != "method":
                assert_close(value, expected, name)
        for name in ("log_likelihood", "likelihood", "mahalanobis", "cbar", "omega"):
            if hasattr(other, name):
                assert_close(getattr(one, name), getattr(other, name), name)


def test_the_oracle_goes_pair_by_pair() -> None:
    f = bank(PairByPair, (2, 1, 3), "usual")
    f.step(0.3)
    assert not f._predict_at_once()
    f.predict()
    assert isinstance(f._branches, PairBranches)
    assert not f._update_at_once(0.3)


def by_steps(f, zs):
    for z in zs:
        f.step(z if len(z) > 1 else z[0])


def by_verbs(f, zs):
    for z in zs:
        f.predict()
        f.update(z)


def by_series(f, zs):
    f.filter(zs)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", SERIES)
def test_all_attributes_are_those_of_pair_by_pair(kind, law) -> None:
    for size, flat in ((2, 1, 3), False), ((3, 2, 2), True):
        slow, zs = bank(PairByPair, size, law, flat), SERIES[kind](np.random.default_rng(1), 8, size[1])
        by_verbs(slow, zs)
        for way in (by_steps, by_verbs, by_series):
            fast = bank(KalmanFilter, size, law, flat)
            way(fast, zs)
            assert_same(fast, slow)


@pytest.mark.parametrize("size", SIZES)
def test_systems_of_all_sizes(size) -> None:
    slow = bank(PairByPair, size, "usual")
    zs = np.vstack([SERIES[kind](np.random.default_rng(1), 6, size[1]) for kind in SERIES])
    by_verbs(slow, zs)
    for way in (by_steps, by_series):
        fast = bank(KalmanFilter, size, "usual")
        way(fast, zs)
        assert_same(fast, slow)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", SERIES)
def test_what_is_told_of_one_series_and_of_many(kind, law) -> None:
    size, keep = (2, 2, 3), ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")
    fast, slow = bank(KalmanFilter, size, law), bank(PairByPair, size, law)
    zs = np.stack([SERIES[kind](np.random.default_rng(seed), 8, 2) for seed in range(3)])
    many = fast.filter_many(zs, keep=keep)
    for s, series in enumerate(zs):
        expected, one = slow.copy().filter(series), fast.copy().filter(series)
        for name in keep:
            assert_close(getattr(one, name), getattr(expected, name), name)
            assert_close(getattr(many, name)[s], getattr(expected, name), name)


# ------------------------------------------------------------------ between a prediction and its update


def singular(f):
    f.inv = np.linalg.pinv  # which makes a plain filter one that is not


ASSIGNED = {
    "R": lambda f: setattr(f, "R", np.array([[7.0]])),
    "R as a number": lambda f: setattr(f, "R", 7.0),
    "H": lambda f: setattr(f, "H", np.array([[3.0, -1.0]])),
    "an entry of H": lambda f: f.H.__setitem__((0, 0), 5.0),
    "inv": singular,
}


@pytest.mark.parametrize("kind", [KalmanFilter, PairByPair])
@pytest.mark.parametrize("what", ASSIGNED)
def test_what_the_observation_needs_may_be_assigned_after_the_prediction(what, kind) -> None:
    # the prediction does not depend on it: assigned before, it leads to the same
    late, early = bank(kind, (2, 1, 3), "usual"), bank(kind, (2, 1, 3), "usual")
    for f in (late, early):
        f.step(0.3)
    ASSIGNED[what](early.filters[1])
    for f in (late, early):
        f.predict()
    ASSIGNED[what](late.filters[1])
    for f in (late, early):
        f.update(0.7)
    assert_same(late, early)
    for name in ("R", "H"):
        np.testing.assert_array_equal(getattr(late.filters[1], name), getattr(early.filters[1], name))


@pytest.mark.parametrize("kind", [KalmanFilter, PairByPair])
@pytest.mark.parametrize("in_place", [False, True])
@pytest.mark.parametrize("gap", [False, True])
def test_an_estimate_that_is_assigned_after_the_prediction_is_that_of_all_pairs(kind, in_place, gap) -> None:
    # where all pairs of each mode have one estimate, GPB2 is IMM
    pairs = bank(kind, (3, 2, 3), "usual")
    modes = IMMEstimator([f.copy() for f in pairs.filters], pairs.mu, pairs.M)
    for f in (pairs, modes):
        f.predict()
        for k, one in enumerate(f.filters):
            x, P = np.full((3, 1), 0.3 * k), (1.0 + k) * np.eye(3)
            if in_place:
                one.x[:], one.P[:] = x, P
            else:
                one.x, one.P = x, P
        f.update([0.4, np.nan if gap else -0.2])
    for name in ("x", "P", "mu", "likelihood", "log_likelihood"):
        assert_close(getattr(pairs, name), getattr(modes, name), name)


@pytest.mark.parametrize("kind", [KalmanFilter, PairByPair])
def test_a_mode_whose_estimate_was_not_touched_keeps_its_pairs(kind) -> None:
    touched, plain = bank(kind, (2, 1, 3), "no switches"), bank(kind, (2, 1, 3), "no switches")
    for f in (touched, plain):
        f.step(0.3)
        f.predict()
    touched.filters[0].x = touched.filters[0].x + 1.0
    for f in (touched, plain):
        f.update(0.7)
    assert np.abs(touched.filters[0].x - plain.filters[0].x).max() > 0.1
    assert_close(touched.filters[1].x, plain.filters[1].x, "x")


# ------------------------------------------------------------------ errors

BROKEN = {
    "S": (lambda f: setattr(f.filters[1], "R", -1e3 * np.eye(1)), 0.4, NotPositiveDefiniteError),
    "a mode of probability 0": (
        lambda f: (
            setattr(f, "M", without_last_column(3)),
            setattr(f.filters[2], "R", -1e3 * np.eye(1)),
        ),
        0.4,
        NotPositiveDefiniteError,
    ),
    "no density": (lambda f: None, 1e200, ParameterError),
    "beyond numbers": (lambda f: setattr(f.filters[0], "F", np.full((2, 2), 1e200)), 0.4, FuzzykfError),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("way", [by_steps, by_series, lambda f, zs: f.filter_many(zs[None])])
@pytest.mark.parametrize("broken", BROKEN)
def test_an_error_is_the_same_and_leaves_the_bank_as_it_was(broken, way) -> None:
    change, z, error = BROKEN[broken]
    texts = []
    for kind in (KalmanFilter, PairByPair):
        f, twin = bank(kind, (2, 1, 3), "usual"), bank(kind, (2, 1, 3), "usual")
        for one in (f, twin):
            one.step(0.3)
            change(one)
            assert np.isfinite(one.cbar).all()  # which takes the logarithms of a new M
        with pytest.raises(error) as caught:
            way(f, np.array([[z]]))
        texts.append(str(caught.value).removeprefix("zs: series 0 has an observation that ")[-30:])
        assert_same(f, twin)
    assert texts[0] == texts[1]
