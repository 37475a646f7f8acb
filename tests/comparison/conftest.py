"""Comparisons time one pass of a method here: what is tested does not depend on how many there are."""

from __future__ import annotations

import pytest

from fuzzykf.comparison import evaluation


@pytest.fixture(autouse=True, scope="module")
def _in_haste():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "TIMED_PASSES", 1)
        yield
