"""What users write, and mypy accepts; a comment says the type that it finds."""

from __future__ import annotations

from typing import assert_type

import numpy as np
import pandas as pd

from fuzzykf import (
    CGOMSMFilter,
    CGOMSModel,
    DailyProfile,
    ExtendedKalmanFilter,
    FadeLaw,
    Filter,
    FilterResult,
    FuzzyRelationEstimator,
    GaussianMembership,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
    Standardizer,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
)
from fuzzykf.arrays import FloatArray, ManyNumbers, Numbers


def observations(f: KalmanFilter, table: pd.DataFrame, column: pd.Series[float]) -> None:
    """Take one observation in every form."""
    f.step(1)
    f.step(1.5)
    f.step(None)
    f.step(np.float32(1.0))
    f.step(np.int64(1))
    f.step([1.0, None])
    f.step((1, 2))
    f.step([[1.0], [None]])
    f.step(np.zeros(2))
    f.step(np.zeros(2, dtype=np.int16))
    f.step(np.array([1.0, None], dtype=object))
    f.step(np.ma.masked_invalid(np.zeros(2)))
    f.step(column)
    f.step(pd.NA)
    f.update([np.zeros(1), np.zeros(1)])
    f.update(1.0, R=2.0, H=[[1.0, 0.0]])
    f.filter([1.0, None, 2.0])
    f.filter([[1.0, 2.0], None, [None, 3.0]])
    f.filter(z for z in [1.0, 2.0])
    f.filter(table)
    f.filter(column, resume=True)
    f.filter_many(np.zeros((3, 4, 2)), keep=["x"], resume=True)
    f.filter_many([[[1.0], [2.0]], [[3.0], [4.0]]])
    f.filter_many([np.zeros(3), [1.0, None], column])
    f.filter_many({"east": column, "west": column})
    f.filter_many(table, by="meter")
    f.batch_filter([1.0, None])
    f.filter(column, us=column)
    f.filter(table, us=[None, 1.0, np.zeros(2)])
    f.smooth(column, us=table)
    f.batch_filter(column, Rs=column, Fs=np.zeros((3, 1, 1)))
    f.forecast(2, us=column)
    f.batch_filter(column, us=column, resume=True)
    f.filter_many(table, us=column)
    f.filter_many(table, us=table)
    f.filter_many({"east": column}, us={"east": column})
    f.filter_many([column, column], us=[[1.0, None], column])
    f.filter_many(np.zeros((3, 4)), us=[None, 1.0, np.zeros(1), 2])
    KalmanFilter(1, 1, F=0.9, H=1, B=np.float64(2.0)).update(1.0, H=1.0)


def preparing(
    step: Standardizer, profile: DailyProfile, table: pd.DataFrame, column: pd.Series[float]
) -> None:
    """Fit what prepares data on data with gaps, in every form."""
    step.fit([1.0, None])
    step.fit([[1.0, None], [2.0, 3.0]])
    step.fit(np.ma.masked_invalid(np.zeros(2)))
    step.fit(table).transform(column)
    step.fit_transform([1, 2, None])
    step.inverse_transform((0.0, None))
    hours = ["2026-01-01T00:00", "2026-01-01T01:00"]
    profile.fit([1.0, None], hours, [True, False])
    profile.fit(column, workday=np.ones(2, dtype=bool))
    profile.transform([None, 1.0], hours)
    profile.fit_transform(column)
    profile.inverse_transform([0.0, None], hours)
    assert_type(profile.at(hours, [True, True]), FloatArray)


def results(
    f: KalmanFilter,
    ekf: ExtendedKalmanFilter,
    imm: IMMEstimator,
    hard: CGOMSMFilter,
    fuzzy: OFSRFilter,
    known: KnownSwitchFilter,
    est: FuzzyRelationEstimator,
    own: Filter,
) -> None:
    """Get arrays and results."""
    assert_type(f.step(1.0), FloatArray)
    assert_type(ekf.step(1.0), FloatArray)
    assert_type(imm.step(1.0), FloatArray)
    assert_type(hard.step(1.0), FloatArray)
    assert_type(fuzzy.step(1.0), FloatArray)
    assert_type(known.step(1.0, 0.5), FloatArray)
    assert_type(est.step(1.0), FloatArray)
    assert_type(own.step(1.0), FloatArray)
    assert_type(f.filter([1.0]), FilterResult)
    assert_type(ekf.filter([1.0], resume=True), FilterResult)
    assert_type(imm.filter([1.0], resume=True), FilterResult)
    assert_type(hard.filter([1.0], keep_nodes=True, resume=True), FilterResult)
    assert_type(known.filter([1.0], [0.5], resume=True), FilterResult)
    assert_type(est.filter([1.0], resume=True), FilterResult)
    assert_type(est.filter([1.0], [[0.1]], Rs=[GaussianMembership(0.0, 1.0)], Qs=[None]), FilterResult)
    assert_type(est.smooth(np.ones(3), Rs=[1.0, None, 2.0]), FilterResult)
    FuzzyRelationEstimator(1, 1, F=0.9, H=[[1.0]], Q=np.eye(1), R=1, constraint=(0, np.inf))
    FuzzyRelationEstimator(2, 1, constraint=([0.0, -np.inf], np.inf), points=21)
    assert_type(own.filter_many([[1.0]], resume=True), FilterResult)


def state_space(column: pd.Series[float], law: FadeLaw, kf: KalmanFilter) -> None:
    """Make a state-space model in every form, and filter with it."""
    SwitchingStateSpace([[0.9, 0.1], [0.2, 0.8]], F=0.9, H=[[[1.0]], [[0.3]]], Q=np.eye(1), R=1)
    SwitchingStateSpace(law, lambda w: np.eye(2) * w[0], np.eye(2), np.eye(2), 1.0, initial=[1, 0], mix="log")
    SwitchingStateSpace(law.discretize(3), F=0.9, H=1, Q=1, R=1, b=[1.0], B=[[1.0]], x0=[0.0], P0=1.0)
    f = SwitchingKalmanFilter(SwitchingStateSpace.from_filters([kf, kf], law), method="gpb2", n_nodes=3)
    f.predict([1.0])
    f.update([1.0, None], R=2.0, H=lambda w: np.eye(2))
    assert_type(f.step(1.0, 2.0, R=np.eye(2)), FloatArray)
    assert_type(f.filter(column, us=column, Rs=[None, 2.0]), FilterResult)
    f.filter_many({"east": column}, ["x"], {"east": column}, threads=2)
    f.forecast(2, us=[1.0, 2.0])


class Gated(KalmanFilter):
    """A verb of one's own."""

    def update(self, z: Numbers, R: Numbers = None, H: Numbers = None) -> None:
        """Pass it on."""
        super().update(z, R, H)


class Doubled(CGOMSMFilter):
    """The same of a switching filter."""

    def __init__(self, model: CGOMSModel) -> None:
        super().__init__(model)

    def update(self, z: Numbers) -> None:
        """Pass it on."""
        super().update(z)


def whole(f: Filter, zs: ManyNumbers) -> FilterResult:
    """Hand on what users give."""
    return f.filter(zs)
