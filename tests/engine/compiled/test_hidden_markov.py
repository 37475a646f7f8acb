"""The compiled messages along a hidden Markov chain are those of NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy import hidden_markov

core = pytest.importorskip(
    "fuzzykf.engine.compiled.hidden_markov", reason="the compiled core has not been built"
)


@pytest.mark.parametrize("M", [1, 3, 7, 12])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_forward_and_backward_are_those_of_numpy(M, scale) -> None:
    # at the larger scale some steps make every likely state impossible
    rng = np.random.default_rng(4)
    transition = rng.dirichlet(np.ones(M), M)
    transition[0, -1] = 0.0 if M > 1 else 1.0
    log_emission = rng.normal(size=(50, M, M)) * scale
    with np.errstate(divide="ignore"):
        arguments = rng.dirichlet(np.ones(M)), transition, log_emission
        got, expected = core.forward_backward(*arguments), hidden_markov.forward_backward(*arguments)
    tolerance = max(1e-12, 1e-15 * np.abs(log_emission).max())
    for a, b in zip(got, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance * np.abs(b).max())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0], [[1.0]], np.ones((2, 2, 3))), "log_emission: got shape"),
        (([], np.ones((0, 0)), np.ones((2, 0, 0))), "log_emission"),
    ],
)
def test_wrong_shapes_are_refused(arguments, message) -> None:
    with pytest.raises(ValueError, match=message):
        core.forward_backward(*arguments)
