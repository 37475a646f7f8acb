"""What mypy refuses: every line that says so, and no other."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fuzzykf import (
        DailyProfile,
        Filter,
        FuzzyRelationEstimator,
        IMMEstimator,
        KalmanFilter,
        KnownSwitchFilter,
        OFSRFilter,
        Standardizer,
    )

    def texts(
        kf: KalmanFilter, imm: IMMEstimator, fuzzy: OFSRFilter, known: KnownSwitchFilter, own: Filter
    ) -> None:
        """Texts are no numbers, alone or in lists."""
        kf.step("1.0")  # refused
        kf.step(b"1.0")  # refused
        kf.step(["1.0"])  # refused
        kf.step([["1.0"]])  # refused
        kf.update("1.0")  # refused
        kf.filter("1.0")  # refused
        kf.filter(["1.0", None])  # refused
        kf.filter_many("1.0")  # refused
        kf.batch_filter("1.0")  # refused
        imm.step("1.0")  # refused
        imm.update("1.0")  # refused
        imm.filter("1.0")  # refused
        fuzzy.step("1.0")  # refused
        fuzzy.update("1.0")  # refused
        fuzzy.filter("1.0")  # refused
        fuzzy.smooth("1.0")  # refused
        known.step("1.0", 1.0)  # refused
        known.filter("1.0", [1.0])  # refused
        own.step("1.0")  # refused
        own.update("1.0")  # refused
        own.filter("1.0")  # refused
        own.filter_many("1.0")  # refused

    def others(kf: KalmanFilter, est: FuzzyRelationEstimator, labels: NDArray[np.str_]) -> None:
        """Nor are complex numbers, arrays of texts, and anything else."""
        kf.step(1j)  # refused
        kf.step(object())  # refused
        kf.step(labels)  # refused
        kf.update(1.0, R="2.0")  # refused
        est.step("1.0")  # refused
        est.update({"z": 1.0})  # refused
        kf.filter([1.0], resume="yes")  # refused
        kf.step(1.0).absent()  # refused
        kf.filter([1.0]).absent()  # refused

    def preparing(step: Standardizer, profile: DailyProfile) -> None:
        """Nor do texts prepare data."""
        step.fit("1.0")  # refused
        step.fit(["1.0", None])  # refused
        profile.fit(["1.0"], ["2026-01-01"])  # refused
        profile.fit([1.0], ["2026-01-01"], ["yes"])  # refused
