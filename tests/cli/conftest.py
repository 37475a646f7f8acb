"""Commands draw coarse pictures and time few passes here: what is tested does not depend on either."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from fuzzykf.comparison import evaluation


@pytest.fixture(autouse=True, scope="module")  # so that what a module shares is made in haste as well
def _in_haste():
    draw = Figure.savefig

    def coarse(self, *arguments, **options):
        self.set_layout_engine("none")  # labels may overlap: the pictures themselves are tested elsewhere
        draw(self, *arguments, **{**options, "dpi": 20})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", coarse)
        patch.setattr(evaluation, "TIMED_PASSES", 1)
        yield
