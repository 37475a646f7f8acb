"""The example of the manoeuvring target holds what it says."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "plot_manoeuvring_target.py"


@pytest.mark.study
def test_a_hundred_runs(monkeypatch, capsys):
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    mpl.use("Agg")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    ran = runpy.run_path(str(EXAMPLE))
    print(capsys.readouterr().out)
    both, positions, ratio = ran["both"], ran["positions"], ran["ratio"]
    assert len(both["IMM"]) == 100

    def to_imm(table, name, k=0):
        return ratio(table[name][:, k], table["IMM"][:, k])[0]

    # with velocities observed, order 5 is within 3 % of IMM on position, and IMM is the better one
    assert 1.0 < to_imm(both, "exact, order 5") < 1.03
    assert 1.0 < to_imm(positions, "exact, order 5") < 1.10
    for table in (both, positions):
        errors = [to_imm(table, f"exact, order {order}") for order in (1, 3, 5)]
        assert (np.diff(errors) < 0.0).all()
        # the smoother more than halves the share of wrong regimes, and helps the velocity
        wrong = {name: rows[:, 2].mean() for name, rows in table.items()}
        assert wrong["smoothed, order 5"] < wrong["exact, order 5"] / 2.0
        assert to_imm(table, "smoothed, order 5", k=1) < 0.9
    assert ran["rates"][np.argmax(ran["log_likelihood"])] == 9.0
