"""check_filter passes for every filter of the project, and each of its checks can fail."""

from __future__ import annotations

import copy
import functools
import itertools
import pickle

import numpy as np
import pytest

import fuzzykf
from fuzzykf import ExtendedKalmanFilter, FilterResult, IMMEstimator, KalmanFilter
from fuzzykf.base import Filter, as_observation, as_observations
from fuzzykf.errors import SequenceError
from fuzzykf.testing.case import CHECKS
from fuzzykf.testing.check import CheckReport, FilterCheckError, check_filter

# ------------------------------------------------------------------ the project's filters


def velocity(m=1, flat=False):
    f = KalmanFilter(2, m, F=[[1.0, 1.0], [0.0, 1.0]], H=np.eye(2)[:m], Q=0.1, R=0.5)
    if flat:
        f.x = np.zeros(2)
    return f


def fading():
    f = velocity(2)
    f.alpha, f.inv = 1.05, np.linalg.pinv
    return f


def sine(x):
    return 0.9 * np.sin(x)


def square(x):
    return x + 0.1 * x**2


def bank(method="imm", m=1, mixed=False, flat=False):
    still = KalmanFilter(2, m, H=np.eye(2)[:m], Q=2.0)
    if mixed:
        still = ExtendedKalmanFilter(2, m, Q=2.0, hx=first if m == 1 else both)
    filters = [velocity(m), still]
    if flat:
        for f in filters:
            f.x = f.x.ravel()
    return IMMEstimator(filters, [0.5, 0.5], [[0.9, 0.1], [0.2, 0.8]], method=method)


def first(x):
    return x[:1]


def both(x):
    return x


PAIR = np.kron([[1.0, 0.8], [0.8, 1.0]], [[1.0, 0.5], [0.5, 1.0]])
MEANS = [[0.0, 3.0], [0.0, 0.0]]


# models never change, and a check makes its filter 150 times: they are built once


@functools.cache
def fuzzy_model():
    law = fuzzykf.FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16)
    return fuzzykf.CGOFMSModel(law, MEANS, np.broadcast_to(PAIR, (2, 2, 4, 4)), dim_x=1)


@functools.cache
def hard_model():
    transition = [[0.9, 0.1], [0.1, 0.9]]
    return fuzzykf.CGOMSModel(transition, MEANS, np.broadcast_to(PAIR, (2, 2, 4, 4)), 1)


@functools.cache
def two_observations():
    """Two hard regimes, one state, two observations."""
    first_block = np.array([[1.0, 0.4, 0.3], [0.4, 1.0, 0.2], [0.3, 0.2, 1.0]])
    pair = np.kron([[1.0, 0.5], [0.5, 1.0]], first_block)
    means = [[0.0, 2.0, 0.0], [1.0, 0.0, 1.0]]
    return fuzzykf.CGOMSModel([[0.9, 0.1], [0.2, 0.8]], means, np.broadcast_to(pair, (2, 2, 6, 6)), 1)


class AtOneSwitch(fuzzykf.KnownSwitchFilter):
    """The filter of known switches with one value for all of them, so that no verb needs it."""

    R = 0.3

    def predict(self, r=None):
        told = self._n == 0 and self._r_next is not None  # a leading predict has been told already
        super().predict(None if told else self.R)

    def update(self, z, r=None):
        super().update(z, self.R if self._r_next is None else None)

    def step(self, z, r=None):
        return super().step(z, self.R)

    def filter(self, zs, r=None, *, resume=False):
        return super().filter(zs, np.full(len(zs), self.R), resume=resume)

    def smooth(self, zs):
        return super().smooth(zs, np.full(len(zs), self.R))

    def filter_many(self, zs, keep=("x", "P", "log_likelihood"), *, resume=False):
        return super().filter_many(zs, keep, r=np.full(np.shape(zs)[:2], self.R), resume=resume)


@functools.cache
def state_space():
    law = fuzzykf.FadeLaw.between(10, 4, jump=0.02)
    return fuzzykf.SwitchingStateSpace(law, F=0.9, H=[[[1.0], [0.5]], [[0.3], [0.5]]], Q=0.2, R=np.eye(2))


FILTERS = {
    "FilterPool": lambda: fuzzykf.pool_models([hard_model(), hard_model()], [0.3, 0.7]),
    "KalmanFilter": velocity,
    "KalmanFilter, flat": lambda: velocity(2, flat=True),
    "KalmanFilter, two observations": lambda: velocity(2),
    "KalmanFilter, fading memory and pseudo-inverse": fading,
    "ExtendedKalmanFilter": lambda: ExtendedKalmanFilter(1, 1, fx=sine, hx=square, Q=0.1),
    "ExtendedKalmanFilter, two observations": lambda: ExtendedKalmanFilter(2, 2, hx=np.sin, x=[0.1, 0.2]),
    "IMMEstimator": bank,
    "IMMEstimator, flat": lambda: bank(m=2, flat=True),
    "IMMEstimator, two observations": lambda: bank(m=2),
    "IMMEstimator, mixed bank": lambda: bank(mixed=True),
    "IMMEstimator, GPB2": lambda: bank("gpb2"),
    "IMMEstimator, GPB2 of a mixed bank": lambda: bank("gpb2", m=2, mixed=True),
    "OFSRFilter": lambda: fuzzykf.OFSRFilter(fuzzy_model()),
    "OFSRFilter, product rule": lambda: fuzzykf.OFSRFilter(fuzzy_model(), rule="product"),
    "CGOMSMFilter": lambda: fuzzykf.CGOMSMFilter(hard_model()),
    "CGOMSMFilter, two observations": lambda: fuzzykf.CGOMSMFilter(two_observations()),
    "SwitchingKalmanFilter": lambda: fuzzykf.SwitchingKalmanFilter(state_space(), n_nodes=2),
    "KnownSwitchFilter": lambda: AtOneSwitch(fuzzy_model()),
    # on grids and intervals: tests/possibility/test_estimator.py
    "FuzzyRelationEstimator, Gaussian": lambda: fuzzykf.FuzzyRelationEstimator(2, 2, H=np.eye(2)),
}


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_of_the_project_passes(name):
    # six observations are the fewest that will do; what is checked by default stands below
    zs = 0.5 * np.sin(1.3 * np.arange(6)[:, None] + 0.7 * np.arange(FILTERS[name]().dim_z))
    report = check_filter(FILTERS[name], zs)
    assert {"step", "filter", "missing", "saver", "pickle", "reset"} <= set(report.passed)
    assert set(report.passed) | set(report.not_applicable) == set(CHECKS)


def test_every_filter_that_is_exported_is_checked():
    exported = {
        kind.__name__  # of a plain name too
        for name in fuzzykf.__all__
        if isinstance(kind := getattr(fuzzykf, name), type)
        and issubclass(kind, Filter)
        and kind is not Filter
    }
    assert exported <= {name.split(",")[0] for name in FILTERS}


# ------------------------------------------------------------------ sound examples of each kind


class Switching(Filter):
    """A two-state hidden Markov chain, observed in noise: x is the probability of state 1."""

    dim_x = dim_z = 1
    T, means = np.array([[0.8, 0.2], [0.3, 0.7]]), np.array([0.0, 1.0])

    def __init__(self):
        self.nodes, self.mu = np.array([0.0, 1.0]), np.array([0.5, 0.5])
        self.log_likelihood, self.n, self.ready = 0.0, 0, True
        self._show()
        self.x_prior, self.P_prior = self.x, self.P

    def _show(self):
        p = self.mu[1]
        self.x, self.P = np.array([[p]]), np.array([[p * (1 - p)]])

    def predict(self):
        self.remember_origin()
        if self.n > 0:
            self.mu = self.mu @ self.T
        self.ready = True
        self._show()
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()

    def update(self, z):
        self.remember_origin()
        z = as_observation(z, 1)
        if not self.ready:
            raise SequenceError("update: a predict is missing")
        log_density = np.zeros(2) if z is None else -0.5 * ((z - self.means) ** 2 + np.log(2 * np.pi))
        joint = np.log(self.mu) + log_density
        self.log_likelihood = float(np.logaddexp(*joint))
        self.mu = np.exp(joint - self.log_likelihood)
        self.log_likelihood = 0.0 if z is None else self.log_likelihood
        self.n, self.ready = self.n + 1, False
        self._show()

    def filter(self, zs, *, resume=False):
        as_observations(zs, 1)  # what is refused leaves the filter as it was
        if not resume:
            self.__init__()
        return super().filter(zs)


class Possibilistic(KalmanFilter):
    """The Kalman filter, read as a possibility distribution."""

    def __init__(self):
        super().__init__(1, 1, H=[[1.0]])

    possibility = property(lambda self: float(np.exp(-0.5 * self.mahalanobis**2)))

    def membership(self, points):
        return np.exp(-0.5 * ((points - self.x.ravel()) ** 2 / self.P[0]).sum(axis=-1))


class Saved(KalmanFilter):
    def __init__(self):
        super().__init__(1, 1, H=[[1.0]])

    def save(self, path):
        path.write_bytes(pickle.dumps(self))

    @classmethod
    def load(cls, path):
        return pickle.loads(path.read_bytes())


@pytest.mark.parametrize(
    ("factory", "checks"),
    [
        (Switching, {"mode_probabilities", "leading_predict", "sequence", "density"}),
        (Possibilistic, {"possibility"}),
        (Saved, {"save"}),
        (lambda: velocity(2), {"missing_component", "filter_many", "smooth"}),
    ],
)
def test_sound_filters_pass_the_checks_of_what_they_offer(factory, checks):
    assert checks <= set(check_filter(factory).passed)


# ------------------------------------------------------------------ one fault for each check


class Kalman(KalmanFilter):
    """A sound filter, to be broken in one place."""

    def __init__(self, m=1):
        super().__init__(2, m, F=[[1.0, 1.0], [0.0, 1.0]], H=np.eye(2)[:m], Q=0.1, R=0.5)


class SwappedPrior(Kalman):
    def predict(self, *args):
        super().predict(*args)
        self.x_prior = self.x_prior.T


class AskewCovariance(Kalman):
    def update(self, *args):
        super().update(*args)
        self.P = self.P + np.array([[0.0, 1e-3], [0.0, 0.0]])


class NegativePrior(Kalman):
    def predict(self, *args):
        super().predict(*args)
        self.P_prior = -self.P_prior


class NotTheSameTwice(Kalman):
    count = itertools.count()

    def update(self, z, *args):
        super().update(z, *args)
        self.x = self.x + 1e-3 * next(self.count)


class StepsWithoutX(Kalman):
    def step(self, z):
        super().step(z)


class StepsWithoutPredict(Kalman):
    def step(self, z):
        self.update(z)
        return self.x


class PriorIsTheState(Kalman):
    """Has the prior in the array of the state, and updates in place."""

    def predict(self, *args):
        super().predict(*args)
        self.x_prior = self.x

    def update(self, z, *args):
        before = self.x
        super().update(z, *args)
        before[:] = self.x
        self.x = before


class PriorCovarianceIsTheState(Kalman):
    def predict(self, *args):
        super().predict(*args)
        self.P_prior = self.P

    def update(self, z, *args):
        before = self.P
        super().update(z, *args)
        before[:] = self.P
        self.P = before


class PriorBeforeThePredict(Kalman):
    def predict(self, *args):
        before = self.x
        super().predict(*args)
        self.x_prior = before


class CollectsOtherPriors(Kalman):
    def filter(self, zs, us=None, *, resume=False):
        result = super().filter(zs, us, resume=resume)
        return FilterResult(x=result.x, P=result.P, x_prior=result.x, P_prior=result.P_prior)


class FiltersOtherwise(Kalman):
    def filter(self, zs):
        result = super().filter(zs)
        return FilterResult(x=result.x + 1e-3, P=result.P, x_prior=result.x_prior, P_prior=result.P_prior)


class FiltersFlat(Kalman):
    def filter(self, zs):
        result = super().filter(zs)
        return FilterResult(x=result.x[..., None], P=result.P, x_prior=result.x_prior, P_prior=result.P_prior)


class StaysWhereItWas(Kalman):
    def filter(self, zs):
        return KalmanFilter.filter(self.copy(), zs)


class StartsAnew(Kalman):
    def filter(self, zs, *, resume=False):
        as_observations(zs, 1)  # what is refused leaves the filter as it was
        if not resume:
            self.__init__()
        return super().filter(zs)


class GoesOn(Switching):
    def filter(self, zs):
        return Filter.filter(self, zs)


class NeedsAnObservation(Kalman):
    def filter(self, zs):
        assert len(zs) > 0
        return super().filter(zs)


class PriorsFirst(Kalman):
    def batch_filter(self, zs):
        x, P, x_prior, P_prior = super().batch_filter(zs)
        return x_prior, P_prior, x, P


class ListsAreOther(Kalman):
    def update(self, z, *args):
        super().update(2.0 * np.asarray(z) if isinstance(z, list) else z, *args)


class TakesInfinity(Kalman):
    def update(self, z, *args):
        super().update(
            np.nan_to_num(z, posinf=1e6) if isinstance(z, np.ndarray) and np.isinf(z).any() else z, *args
        )


class ChangedByRefusal(Kalman):
    def update(self, z, *args):
        self.P = self.P * 1.001
        super().update(z, *args)


class RaisesTypeError(Kalman):
    def update(self, z, *args):
        try:
            super().update(z, *args)
        except ValueError as error:
            raise TypeError from error


class KeepsTheArray(Kalman):
    def update(self, z, *args):
        super().update(z, *args)
        if isinstance(z, np.ndarray):
            self.z = z


class WritesIntoTheArray(Kalman):
    def update(self, z, *args):
        super().update(z, *args)
        if isinstance(z, np.ndarray):
            z += 1.0


class CopiesNothing(Kalman):
    def copy(self):
        return self


class CopiesHalf(Kalman):
    def copy(self):
        other = copy.copy(self)
        other.x = self.x.copy()
        other.Q = 2.0 * self.Q
        return other


class CannotBePickled(Kalman):
    def __init__(self):
        super().__init__()
        self.function = lambda: None


class PickledWithoutMemory(Kalman):
    def __getstate__(self):
        return self.__dict__ | {"P": np.eye(2)}

    def __deepcopy__(self, memo):
        other = object.__new__(type(self))
        other.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return other


class GrowsAnAttribute(Kalman):
    def update(self, z, *args):
        super().update(z, *args)
        self.history = [*getattr(self, "history", []), 0.0]


class NeverResets(Kalman):
    def reset(self):
        pass


class GrowsUnseen(Kalman):
    def update(self, z, *args):
        super().update(z, *args)
        if z is None:
            self.P = self.P + 1.0


class RemembersTheOldLikelihood(Kalman):
    def update(self, z, *args):
        before = self.log_likelihood
        super().update(z, *args)
        if z is None:
            self._log_likelihood = before


class NanIsZero(Kalman):
    def update(self, z, *args):
        super().update(z if not isinstance(z, np.ndarray) else np.where(np.isnan(z), 0.0, z), *args)


class AllOrNothing(Kalman):
    def __init__(self):
        super().__init__(2)

    def update(self, z, *args):
        partly = isinstance(z, np.ndarray) and np.isnan(z).any()
        super().update(None if partly else z, *args)


class LikelihoodInAnArray(Kalman):
    @property
    def log_likelihood(self):
        return np.atleast_1d(KalmanFilter.log_likelihood.fget(self))

    @property
    def likelihood(self):
        return float(np.exp(self.log_likelihood[0]))


class LosesAConstant(Kalman):
    @property
    def log_likelihood(self):
        value = KalmanFilter.log_likelihood.fget(self)
        return value + 0.5 * np.log(2 * np.pi) if value and self.z[0, 0] is not None else value


class RefusesOutliers(Kalman):
    def update(self, z, *args):
        super().update(z, *args)
        if z is not None and np.abs(np.asarray(z, dtype=float)).max(initial=0.0) > 100:
            self.x = self.x * np.nan


class MoreNodesThanModes(Switching):
    def __init__(self):
        super().__init__()
        self.nodes = np.array([0.0, 0.5, 1.0])


class ImproperModes(Switching):
    def update(self, z):
        self.mu = self.mu / self.mu.sum()
        super().update(z)
        self.mu = 1.01 * self.mu

    def predict(self):
        self.mu = self.mu / self.mu.sum()
        super().predict()


class MovesBeforeTheFirst(Switching):
    def predict(self):
        self.remember_origin()
        if self.n == 0:
            self.mu = self.mu @ self.T
        super().predict()


class TakesTwoAtOnce(Switching):
    def update(self, z):
        self.ready = True
        super().update(z)


class MoreThanPossible(Possibilistic):
    possibility = property(lambda self: 1.0 + self.mahalanobis)


class NeverSure(Possibilistic):
    possibility = property(lambda self: 0.5)


class NegativeMembership(Possibilistic):
    def membership(self, points):
        return super().membership(points) - 0.1


class KeepsEverything(Kalman):
    def filter_many(self, zs, keep=("x", "P", "log_likelihood")):
        return super().filter_many(zs)


class OneSeriesForAll(Kalman):
    def filter_many(self, zs, keep=("x", "P", "log_likelihood")):
        return super().filter_many(np.broadcast_to(zs[:1], np.shape(zs)), keep)


class SmoothsOtherwise(Kalman):
    def smooth(self, zs):
        result = super().smooth(zs)
        return FilterResult(x=result.x[::-1], P=result.P)


class LoadsANewOne(Saved):
    @classmethod
    def load(cls, path):
        return cls()


class TakesWhatIsMasked(Kalman):
    def update(self, z, *args):
        super().update(np.ma.getdata(z) if isinstance(z, np.ma.MaskedArray) else z, *args)


class StepsBeforeItRefuses(Kalman):
    def step(self, z):
        self.predict()
        self.update(z)
        return self.x


class MovesWhenItRefuses(Kalman):
    def filter(self, zs, us=None, *, resume=False):
        try:
            return super().filter(zs, us, resume=resume)
        except ValueError:
            self.x = self.x + 1.0
            raise


class GoesPastItsUpdate(Kalman):
    def filter(self, zs, us=None, *, resume=False):
        plain = Kalman()
        plain.__dict__.update({name: value for name, value in self.__dict__.items() if name != "update"})
        result = plain.filter(zs, us)
        self.__dict__.update(plain.__dict__)
        return result


class NeverResumes(Switching):
    def filter(self, zs, *, resume=False):
        return super().filter(zs)


class OfYesterday(Kalman):
    def filter(self, zs, us=None):
        return super().filter(zs, us)


_SHARED = Kalman()

BROKEN = {
    "construction": [lambda: _SHARED],
    "shapes": [SwappedPrior],
    "covariance": [AskewCovariance, NegativePrior],
    "repeatable": [NotTheSameTwice],
    "step": [StepsWithoutX, StepsWithoutPredict],
    "priors": [PriorIsTheState, PriorCovarianceIsTheState, PriorBeforeThePredict, CollectsOtherPriors],
    "filter": [FiltersOtherwise, FiltersFlat],
    "continuation": [StaysWhereItWas, StartsAnew, GoesOn],
    "empty_series": [NeedsAnObservation],
    "batch_filter": [PriorsFirst],
    "observation_forms": [ListsAreOther],
    "bad_observations": [TakesInfinity, ChangedByRefusal, RaisesTypeError],
    "input": [KeepsTheArray, WritesIntoTheArray],
    "copy": [CopiesNothing, CopiesHalf],
    "pickle": [CannotBePickled, PickledWithoutMemory],
    "saver": [GrowsAnAttribute],
    "reset": [NeverResets],
    "missing": [GrowsUnseen, RemembersTheOldLikelihood],
    "missing_nan": [NanIsZero],
    "missing_component": [AllOrNothing],
    "log_likelihood": [LikelihoodInAnArray],
    "density": [LosesAConstant],
    "outlier": [RefusesOutliers],
    "mode_probabilities": [MoreNodesThanModes, ImproperModes],
    "leading_predict": [MovesBeforeTheFirst],
    "sequence": [TakesTwoAtOnce],
    "possibility": [MoreThanPossible, NeverSure, NegativeMembership],
    "filter_many": [KeepsEverything, OneSeriesForAll],
    "smooth": [SmoothsOtherwise],
    "save": [LoadsANewOne],
    "missing_forms": [TakesWhatIsMasked],
    "refused": [StepsBeforeItRefuses, MovesWhenItRefuses],
    "overrides": [GoesPastItsUpdate],
    "resume": [NeverResumes, OfYesterday],
}


def test_every_check_has_a_filter_that_fails_it():
    assert list(BROKEN) == list(CHECKS)


@pytest.mark.parametrize(
    ("check", "factory"), [(check, factory) for check, factories in BROKEN.items() for factory in factories]
)
def test_a_broken_filter_fails_the_check_of_what_is_broken(check, factory):
    with pytest.raises(FilterCheckError, match=f"fails '{check}': ") as error:
        check_filter(factory)
    assert isinstance(error.value, AssertionError)


# ------------------------------------------------------------------ the frame


@pytest.mark.parametrize(
    ("factory", "message"),
    [(dict, "expected an instance of fuzzykf.base.Filter"), (lambda: setattr_dim(0), "dim_z is 0")],
)
def test_what_is_no_filter_at_all_is_refused(factory, message):
    with pytest.raises(FilterCheckError, match=f"fails 'construction': .*{message}"):
        check_filter(factory)


def setattr_dim(value):
    f = Kalman()
    f.dim_z = value
    return f


def test_an_error_in_the_filter_is_a_failure_that_names_it():
    class Raises(Kalman):
        def predict(self, *args):
            raise ZeroDivisionError("there")

    with pytest.raises(FilterCheckError, match="Raises fails 'shapes': ZeroDivisionError was raised: there"):
        check_filter(Raises)


class Complete(Switching):
    def update(self, z):
        if as_observation(z, 1) is None:
            raise NotImplementedError("no gaps, please")
        super().update(z)


def test_missing_observations_may_be_unsupported():
    report = check_filter(Complete)
    assert report.not_applicable["missing"] == "update(None) is not supported: no gaps, please"
    assert {"missing_nan", "missing_component"} <= set(report.not_applicable)
    assert "saver" in report.passed


class Notes(Kalman):
    seen = []  # noqa: RUF012 - of all instances

    def update(self, z, *args):
        self.seen.append(z)
        super().update(z, *args)


def test_observations_can_be_given():
    zs = np.linspace(10.0, 11.0, 6)
    check_filter(Notes, zs)
    seen = [z for z in Notes.seen if type(z) is np.ndarray and z.size == 1]
    assert 10.0 in [float(np.ravel(z)[0]) for z in seen]
    with pytest.raises(FilterCheckError, match="zs has 5 observations, expected at least six"):
        check_filter(Notes, zs[:5])


def test_a_filter_of_yesterday_is_told_what_it_lacks():
    with pytest.raises(
        FilterCheckError, match="fails 'resume': filter has no argument resume, expected resume=False"
    ):
        check_filter(OfYesterday)


def test_the_report_names_what_was_done():
    report = check_filter(Kalman)
    assert isinstance(report, CheckReport)
    assert report.filter == "Kalman"
    text = str(report)
    assert text.startswith(f"Kalman: {len(report.passed)} checks passed (construction, shapes, ")
    assert "not applicable: missing_component (dim_z is 1)" in text
    assert str(CheckReport("A", ("step",))) == "A: 1 checks passed (step)"


def test_without_filterpy_its_saver_is_not_asked_for(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "filterpy.common", None)
    assert check_filter(Kalman).not_applicable["saver"] == "filterpy is not installed"
