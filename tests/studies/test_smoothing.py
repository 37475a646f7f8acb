"""What looking back is worth where sensors and motions fade, and what it costs under a hard switch.

The systems are those of the study of filters: the parameters of both classes are known, the fuzzy law is told
how long stays and fades are meant to last, and nothing is learned.
"""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import SwitchChain, SwitchingKalmanFilter
from fuzzykf.errors import HindsightWarning

pytestmark = pytest.mark.study

_spec = importlib.util.spec_from_file_location(
    "fading_sensor", Path(__file__).with_name("test_fading_sensor.py")
)
fading = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(fading)

RUNS = 100

#: A hard switch that leaves a class as often as the series do.
HARD = SwitchChain.from_classes([[1 - 1 / 66, 1 / 66], [1 / 66, 1 - 1 / 66]])

#: Components whose error counts: of the tracking cases the positions.
COUNTED = {"turn": (0, 2), "tsun": (0, 2)}

#: What the error of the smoother is of the filter's at most, with fades of 20 steps.
PROMISED = {"turn": 0.40, "sun": 0.85}


def looked_back(f, data, counted):
    """Errors of filter and smoother (runs,), and in how many runs the smoother warned."""
    errors, warned = np.empty((2, RUNS)), 0
    for k, (x, y) in enumerate(zip(data.x, data.y, strict=True)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", HindsightWarning)
            results = f.filter(y), f.smooth(y)
        warned += bool(caught)
        for row, result in enumerate(results):
            off = (result.x - x)[fading.SETTLING :, list(counted)]
            errors[row, k] = (off**2).mean()
    return errors, warned / RUNS


def test_what_smoothing_is_worth(write_table):
    rows, ratios = [], {}
    for length in fading.LENGTHS:
        for name, system in fading.SYSTEMS.items():
            data = fading.draw(name, length, RUNS, 2)
            counted = COUNTED.get(name, system.counted)
            for law_name, law in (("fades", fading.LAW), ("hard", HARD)):
                for method in ("imm", "gpb2"):
                    f = SwitchingKalmanFilter(system.model(law), method=method, n_nodes=fading.NODES)
                    (filtered, smoothed), warned = looked_back(f, data, counted)
                    value, error = fading.ratio(smoothed, filtered)
                    worse = (smoothed > filtered).mean()
                    cells = (
                        fading.mean(filtered),
                        f"{value:.2f} ({error:.2f})",
                        f"{worse:.0%}",
                        f"{warned:.0%}",
                    )
                    if length > 1 or method == "imm":  # GPB2 tells nothing else of jumps
                        rows.append([str(length), name, law_name, method.upper(), *cells])
                    ratios[length, name, law_name, method] = value
    header = ["steps", "system", "law", "method", "filter's error", "smoother's to it", "worse", "warned"]
    write_table("smoothing", header, rows)
    for name, most in PROMISED.items():
        assert ratios[20, name, "fades", "imm"] <= most, name
