"""The example on data that are not part of the package runs; the other ones run when the pages are built."""

from __future__ import annotations

import os
import runpy
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from fuzzykf import CGOFMSModel, datasets
from fuzzykf.switching.learning import filter_training

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.skipif(
    "FUZZYKF_DATA" not in os.environ, reason="FUZZYKF_DATA does not name the folder of the data"
)
def test_traffic_restores_and_forecasts_a_day(monkeypatch, capsys) -> None:
    data = datasets.load_traffic()
    # a day, and two hours of the next one, which is taken to begin at seven: as much as shows that it runs
    rows = (data.time >= np.datetime64("2015-09-16")) & (data.time < np.datetime64("2015-09-17T09:00"))
    short = datasets.Traffic(
        data.time[rows] + np.timedelta64(17, "h"), data.speed[rows], data.occupancy[rows]
    )
    monkeypatch.setattr(datasets, "load_traffic", lambda: short)
    monkeypatch.setattr(filter_training, "MOST", 1)
    monkeypatch.setattr(CGOFMSModel, "fit", partial(CGOFMSModel.fit, max_iter=2, n_starts=1))
    plt.switch_backend("agg")
    monkeypatch.setattr(plt, "show", lambda: None)
    found = runpy.run_path(str(EXAMPLES / "plot_traffic.py"))
    told = [line for line in capsys.readouterr().out.splitlines() if "%" in line][1:]
    assert len(told) == 8  # two times, four methods
    for methods in found["found"].values():
        pool, parts = methods["pool"], [methods[name] for name in ("told", "hidden")]
        np.testing.assert_allclose(pool[1], (parts[0][1] + parts[1][1]) / 2.0, rtol=1e-9)
        here = np.isfinite(pool[1])
        assert (pool[3] < pool[1])[here].all()
        assert (pool[1] < pool[4])[here].all()
    assert len(found["figure"].axes) == 4
    plt.close(found["figure"])
