"""Commands draw coarse pictures and time few passes here: what is tested does not depend on either."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from fuzzykf.comparison import evaluation


@pytest.fixture(autouse=True)
def _in_haste(monkeypatch):
    draw = Figure.savefig

    def coarse(self, *arguments, **options):
        self.set_layout_engine("none")  # labels may overlap: the pictures themselves are tested elsewhere
        draw(self, *arguments, **{**options, "dpi": 20})

    monkeypatch.setattr(Figure, "savefig", coarse)
    monkeypatch.setattr(evaluation, "TIMED_PASSES", 1)
