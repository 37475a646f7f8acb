"""What the command says of a forecast that means nothing."""

from __future__ import annotations

import numpy as np

from fuzzykf.cli.forecast import _notes_of_growth


def test_a_forecast_that_explodes_is_noted() -> None:
    seen = np.column_stack([np.append(np.random.default_rng(0).normal(size=400), np.nan), np.arange(401.0)])
    steady, growing = np.full(24, 1.1), np.geomspace(0.5, 40.0, 24)
    names = ["load", "row"]
    assert not _notes_of_growth(names, np.column_stack([steady, steady]), seen)
    assert not _notes_of_growth(names, np.column_stack([steady, growing]), seen)  # rows spread as far
    (note,) = _notes_of_growth(names, np.column_stack([growing, growing]), seen)
    assert note.startswith(
        "the standard deviation of load grows from 0.5 to 40 in 24 steps, that of the rows is "
    )
    (note,) = _notes_of_growth(None, growing[:, None], seen[:, :1])
    assert note.startswith("the standard deviation of z0 grows")
    assert not _notes_of_growth(names[:1], growing[:, None], np.full((5, 1), np.nan))
