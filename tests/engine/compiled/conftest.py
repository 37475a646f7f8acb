"""Every test of the compiled core runs on every instruction set of this processor."""

from __future__ import annotations

import pytest

try:
    from fuzzykf.engine.compiled import processor
except ImportError:
    SETS = []
else:
    SETS = list(processor.available_instructions())


@pytest.fixture(params=SETS, autouse=True)
def instructions(request):
    """Name of the instruction set in use."""
    before = processor.instructions()
    processor.use_instructions(request.param)
    yield request.param
    processor.use_instructions(before)
