"""Exact filters for switching systems and a fuzzy state estimator, in the style of filterpy.

The public names are imported when they are first used, so that
``import fuzzykf`` costs no more than ``import numpy``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf import moved

if TYPE_CHECKING:
    from fuzzykf.base import Filter
    from fuzzykf.clock import InputColumns, clock_inputs
    from fuzzykf.comparison import compare_models
    from fuzzykf.errors import FuzzykfError
    from fuzzykf.fixed_lag import FixedLag
    from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
    from fuzzykf.possibility import (
        CauchyMembership,
        FunctionMembership,
        FuzzyRelationEstimator,
        GaussianMembership,
        GridMembership,
        IntervalMembership,
        ParabolicMembership,
        SingletonMembership,
        TriangularMembership,
    )
    from fuzzykf.preprocessing import DailyProfile, Standardizer
    from fuzzykf.results import FilterResult
    from fuzzykf.switching import (
        CGLSSM,
        CGOFMSModel,
        CGOMSMFilter,
        CGOMSModel,
        FadeLaw,
        FilterPool,
        FuzzyMarkovLaw,
        FuzzySwitchFilter,
        GraphLaw,
        HardSwitchFilter,
        KnownSwitchFilter,
        OFSRFilter,
        SwitchChain,
        SwitchingKalmanFilter,
        SwitchingStateSpace,
        WindowFeatures,
        pool_models,
    )

moved.install()

__version__ = "0.1.0"

#: Where each public name stands.
_HOMES = {
    name: module
    for module, names in {
        "fuzzykf.base": "Filter",
        "fuzzykf.clock": "InputColumns clock_inputs",
        "fuzzykf.comparison": "compare_models",
        "fuzzykf.errors": "FuzzykfError",
        "fuzzykf.fixed_lag": "FixedLag",
        "fuzzykf.kalman": "ExtendedKalmanFilter IMMEstimator KalmanFilter",
        "fuzzykf.possibility": (
            "CauchyMembership FunctionMembership FuzzyRelationEstimator GaussianMembership "
            "GridMembership IntervalMembership ParabolicMembership SingletonMembership "
            "TriangularMembership"
        ),
        "fuzzykf.preprocessing": "DailyProfile Standardizer",
        "fuzzykf.results": "FilterResult",
        "fuzzykf.switching": (
            "CGLSSM CGOFMSModel CGOMSMFilter CGOMSModel FadeLaw FilterPool FuzzyMarkovLaw FuzzySwitchFilter "
            "GraphLaw HardSwitchFilter KnownSwitchFilter OFSRFilter SwitchChain SwitchingKalmanFilter "
            "SwitchingStateSpace WindowFeatures pool_models"
        ),
    }.items()
    for name in names.split()
}

__all__ = [
    "CGLSSM",
    "CGOFMSModel",
    "CGOMSMFilter",
    "CGOMSModel",
    "CauchyMembership",
    "DailyProfile",
    "ExtendedKalmanFilter",
    "FadeLaw",
    "Filter",
    "FilterPool",
    "FilterResult",
    "FixedLag",
    "FunctionMembership",
    "FuzzyMarkovLaw",
    "FuzzyRelationEstimator",
    "FuzzySwitchFilter",
    "FuzzykfError",
    "GaussianMembership",
    "GraphLaw",
    "GridMembership",
    "HardSwitchFilter",
    "IMMEstimator",
    "InputColumns",
    "IntervalMembership",
    "KalmanFilter",
    "KnownSwitchFilter",
    "OFSRFilter",
    "ParabolicMembership",
    "SingletonMembership",
    "Standardizer",
    "SwitchChain",
    "SwitchingKalmanFilter",
    "SwitchingStateSpace",
    "TriangularMembership",
    "WindowFeatures",
    "__version__",
    "clock_inputs",
    "compare_models",
    "pool_models",
]

if not TYPE_CHECKING:  # type checkers read the imports above instead

    def __getattr__(name: str) -> object:
        """Import a public name when it is first used (PEP 562)."""
        if name in _HOMES:
            from fuzzykf.registry import imported

            value = getattr(imported(_HOMES[name]), name)
            globals()[name] = value
            return value
        return moved.lookup(__name__, name)

    def __dir__() -> list[str]:
        """List the public names, imported or not."""
        return sorted(__all__)
