"""Commands draw coarse pictures, time few passes and train few iterations here: no test depends on these."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from fuzzykf.comparison import evaluation
from fuzzykf.switching.learning import filter_training


@pytest.fixture(autouse=True, scope="module")  # so that what a module shares is made in haste as well
def _in_haste():
    draw = Figure.savefig

    def coarse(self, *arguments, **options):
        self.set_layout_engine("none")  # labels may overlap: the pictures themselves are tested elsewhere
        draw(self, *arguments, **{**options, "dpi": 20})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", coarse)
        patch.setattr(evaluation, "TIMED_PASSES", 1)
        patch.setattr(filter_training, "MOST", 5)
        yield
