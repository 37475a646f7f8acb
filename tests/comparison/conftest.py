"""Comparisons time one pass of a method here, and train a few iterations for the filter.

What is tested depends on neither; tests/switching/learning and the studies train to the end.
"""

from __future__ import annotations

import pytest

from fuzzykf.comparison import evaluation
from fuzzykf.switching.learning import filter_training


@pytest.fixture(autouse=True, scope="module")
def _in_haste():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "TIMED_PASSES", 1)
        patch.setattr(filter_training, "MOST", 5)
        yield
