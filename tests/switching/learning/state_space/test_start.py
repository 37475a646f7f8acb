"""Where the search for a state-space model begins if states were measured, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import FadeLaw, SwitchingStateSpace, engine
from fuzzykf.errors import FuzzykfError
from fuzzykf.switching.learning.state_space.start import learn_from_states, starts

RNG = np.random.default_rng(4)
X = np.cumsum(RNG.normal(size=(80, 2)), axis=0) * 0.3
Y = X @ [[1.0], [2.0]] + 3.0 + RNG.normal(size=(80, 1))

HARD = [[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6]]


def test_it_begins_at_regressions_of_complete_rows():
    x = X.copy()
    x[7, 0] = np.nan
    (one,) = starts(x, Y, [[1.0]])
    rows = np.delete(np.arange(80), 7)
    design = np.column_stack([np.ones(79), x[rows]])
    coefficients, *_ = np.linalg.lstsq(design, Y[rows])
    values = {name: parameter.values[0] for name, parameter in one.form.parameters.items()}
    np.testing.assert_allclose(values["d"], coefficients[0])
    np.testing.assert_allclose(values["H"], coefficients[1:].T)
    np.testing.assert_allclose(values["R"], np.mean((Y[rows] - design @ coefficients) ** 2))
    np.testing.assert_allclose(values["x0"], x[rows].mean(axis=0))
    assert values["F"].shape == values["Q"].shape == (2, 2)


@pytest.mark.parametrize("law", [FadeLaw.between(40, 10), HARD], ids=["two", "three"])
def test_classes_differ_in_offset_or_in_noise(law):
    offsets, noises = starts(X, Y, law)
    K = offsets.n_classes
    d, R = (offsets.form.parameters[name].values.reshape(-1) for name in "dR")
    assert (np.diff(d) > 0.0).all()
    assert len(d) == len(R) == K
    assert np.ptp(R) == 0.0
    d, R = (noises.form.parameters[name].values.reshape(-1) for name in "dR")
    assert np.ptp(d) == 0.0
    assert (np.diff(R) > 0.0).all()


@pytest.mark.skipif(engine.info().name == "numpy", reason="a fit takes long on NumPy")
def test_the_likelier_end_is_taken():
    law = [[0.9, 0.1], [0.1, 0.9]]
    fit = learn_from_states(X[:50], Y[:50], law, max_iter=5)
    free = {"F": "full", "b": "full", "Q": "full", "H": "full", "d": "full", "R": "full", "law": True}
    ends = [
        start.fit(Y[:50], X[:50], free=free, max_iter=5).log_likelihood
        for start in starts(X[:50], Y[:50], law)
    ]
    assert fit.log_likelihood == max(ends)
    assert isinstance(fit.model, SwitchingStateSpace)
    assert fit.n_parameters == 4 + 2 + 3 + 2 * (2 + 1 + 1) + 2


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (X[:20], Y[:20], "x: got 19 rows in which all is measured, expected at least 25 to begin with"),
        (X, np.where(np.arange(80)[:, None] < 15, Y, np.nan), "x, y: got 15 rows .* at least 20"),
        (X, X[:, :1], "xs: got measured states of which some follow, in this model,"),
    ],
)
def test_what_cannot_begin_is_refused(x, y, message):
    with pytest.raises(FuzzykfError, match=message):
        learn_from_states(x, y, [[0.9, 0.1], [0.1, 0.9]])
