"""Data far from zero are learned as well as the same data shifted to zero, to what double precision holds."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSModel, FuzzyMarkovLaw
from fuzzykf.errors import ParameterError
from fuzzykf.switching.learning.data import ROUNDING, gather

Z = np.array([[1.0, 0.5], [0.5, 1.0]])
PAIR = np.block([[Z, 0.8 * Z], [0.8 * Z, Z]])
TRUTH = CGOFMSModel(
    FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(PAIR, (2, 2, 4, 4)), 1
)
DATA = TRUTH.simulate(300, np.random.default_rng(0))
FAST = {"n_starts": 1, "max_iter": 4, "tolerance": 1e-4}

#: How, and whether the switch is known.
FITS = {
    "hard": (CGOMSModel, {}, False),
    "free": (CGOFMSModel, {"law": "free", "n_nodes": 1}, False),
    "fmc1, switch known": (CGOFMSModel, {}, True),
}

#: Noise and offset: of a counter, coordinates on the earth, a time, a small unit.
OFFSETS = [(5e-4, 1e7), (0.01, -6_378_137.0), (1e-3, 1.7e9), (1e-12, 1e-4)]

#: Data are shifted before any model sees them: the quickest fit meets every offset, each other one two.
CASES = [("hard", *one, "regression") for one in OFFSETS]
CASES += [("free", *one, "regression") for one in OFFSETS[::2]]
CASES += [("fmc1, switch known", *one, "regression") for one in OFFSETS[1::2]]
CASES += [(name, *OFFSETS[0], "covariance") for name in ("hard", "fmc1, switch known")]


def learned(name, form, x, y):
    model, options, known = FITS[name]
    return model.fit(x, y, DATA.r if known else None, form=form, **FAST, **options)


@pytest.mark.parametrize(("name", "noise", "offset", "form"), CASES)
def test_an_offset_changes_nothing(name, noise, offset, form):
    x_far, y_far = noise * DATA.x + offset, noise * DATA.y - 2.0 * offset
    x, y = x_far - offset, y_far + 2.0 * offset  # exactly what the far numbers hold
    far, near = learned(name, form, x_far, y_far), learned(name, form, x, y)
    blur = np.spacing(2.0 * abs(offset)) / noise  # of a standard deviation
    assert far.log_likelihood == pytest.approx(near.log_likelihood, abs=1e-6 + 1e4 * blur)
    assert len(far.trace) == len(near.trace)
    if len(far.trace) > 1:  # in standard units
        np.testing.assert_allclose(far.trace, near.trace, rtol=1e-8)
    np.testing.assert_allclose(far.switch_mean, near.switch_mean, atol=1e-8)
    a, b = (fit.model.placed().pair_tables(0).pairs for fit in (far, near))
    near_enough = 1e-7 if form == "regression" else 1e-6  # found by an ascent, which the last digits may end
    for part in ("Axx", "H", "G", "C", "Ayy", "Qyy"):
        scale = np.abs(getattr(b, part)).max()
        np.testing.assert_allclose(getattr(a, part), getattr(b, part), atol=near_enough * scale)
    shift = np.array([offset, -2.0 * offset])
    means = (far.model.regime_means() - shift - near.model.regime_means()) / noise
    np.testing.assert_allclose(means, 0.0, atol=1e-8 + 4.0 * blur)
    assert far.warnings == near.warnings
    # and the filter of the model does its work there
    found, expected = far.model.filter().filter(y_far).x, near.model.filter().filter(y).x
    np.testing.assert_allclose((found - offset) / noise, expected / noise, atol=1e-7 + 100.0 * blur)


@pytest.mark.parametrize("size", [0.9, 1.2])
@pytest.mark.parametrize(("offset", "column"), [(1e7, 0), (-1e7, 1), (1.0, 0), (1e-5, 1), (3e100, 0)])
def test_noise_is_refused_within_rounding_and_no_larger_noise(offset, column, size):
    z = np.random.default_rng(1).normal(size=(2000, 2))
    gap = np.spacing(1.1 * abs(offset))
    z[:, column] = offset + gap * np.round(size * ROUNDING * z[:, column] / z[:, column].std())
    if size > 1.0:
        assert gather(z[:, 0], z[:, 1]).scale.std[column] > ROUNDING * gap
        return
    with pytest.raises(ParameterError, match=r"\[0\]: is constant \(.*\) but for rounding") as caught:
        gather(z[:, 0], z[:, 1])
    assert f"doubles of this size are {gap:.2g} apart" in str(caught.value)


@pytest.mark.parametrize("value", [0.0, 0.1, -1e7, 1e300])
def test_what_is_constant_is_refused(value):
    y = np.random.default_rng(2).normal(size=100)
    with pytest.raises(
        ParameterError, match=r"x\[0\]: is constant \(.*\), which no model can be learned from"
    ):
        gather(np.full(100, value), y)


@pytest.mark.parametrize("unit", [1e160, 1e-160])
def test_units_whose_squares_no_double_holds_are_refused(unit):
    rng = np.random.default_rng(3)
    with pytest.raises(ParameterError, match=r"y\[0\]: got a standard deviation of .*use other units"):
        gather(rng.normal(size=100), unit * rng.normal(size=100))


def test_standard_units_are_exact_far_from_zero():
    x = 1e7 + 5e-4 * DATA.x[:, 0]
    data = gather(x, DATA.y)
    near = gather(x - 1e7, DATA.y)
    np.testing.assert_allclose(data.z, near.z, atol=1e-9)
    assert np.abs(data.z.mean(axis=0)).max() < 1e-13
    np.testing.assert_allclose(data.z.std(axis=0), 1.0, rtol=1e-13)
