"""Experiments write coarse pictures here: what is tested is that there are some, and what is in them."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure


@pytest.fixture(autouse=True, scope="module")
def _coarse():
    draw = Figure.savefig

    def coarse(self, *arguments, **options):
        draw(self, *arguments, **{**options, "dpi": 60})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", coarse)
        yield
