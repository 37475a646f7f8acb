"""Learning without memory of the state: Axx is zero, the rest as in a regression, and the filter exact."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel
from fuzzykf.errors import ParameterError
from fuzzykf.gaussian import LOG_2PI

N = 480


def series():
    rng = np.random.default_rng(0)
    r = (np.arange(N) // 40) % 2
    x, y = np.zeros((2, N))
    for n in range(1, N):
        y[n] = 0.8 * y[n - 1] + r[n] + 0.5 * rng.normal()
        x[n] = (0.5, -1.0)[r[n]] * y[n] + 0.3 * y[n - 1] + 0.4 * rng.normal()
    return x, y, r


def memory(model):
    return model.placed().pair_tables(0).pairs.Axx


FITS = {
    "hard, known": lambda x, y, r, **o: CGOMSModel.fit(x, y, r, n_regimes=2, form="regression", **o),
    "hard, hidden": lambda x, y, r, **o: CGOMSModel.fit(
        x, y, n_regimes=2, form="regression", n_starts=1, **o
    ),
    "fuzzy, known": lambda x, y, r, **o: CGOFMSModel.fit(x, y, 1.0 * r, law="fmc2", form="regression", **o),
    "fuzzy, hidden": lambda x, y, r, **o: CGOFMSModel.fit(
        x, y, law="fmc2", form="regression", n_nodes=1, n_starts=1, max_iter=12, **o
    ),
}


@pytest.mark.parametrize("name", FITS)
def test_the_state_does_not_depend_on_the_one_before(name):
    found, with_memory = (FITS[name](*series(), state_feedback=flag) for flag in (False, True))
    assert not memory(found.model).any()
    assert memory(with_memory.model).any()
    assert found.n_parameters == with_memory.n_parameters - 4  # one for each pair of classes
    if "known" in name:  # a search for a hidden switch may end elsewhere
        assert found.log_likelihood < with_memory.log_likelihood


def test_with_a_known_switch_it_is_the_regression_on_observations():
    x, y, r = series()
    model = CGOMSModel.fit(x, y, r, n_regimes=2, state_feedback=False).model
    pairs = model.placed().pair_tables(0).pairs
    for i in range(2):
        for j in range(2):
            at = np.flatnonzero((r[:-1] == i) & (r[1:] == j))
            if at.size < 100:
                continue
            design = np.stack([y[at], y[at + 1], np.ones(at.size)], axis=1)
            wanted = np.linalg.lstsq(design, x[at + 1], rcond=None)[0]
            got = pairs.H[i, j].item(), pairs.G[i, j].item(), pairs.c[i, j].item()
            np.testing.assert_allclose(
                got, wanted, atol=0.02
            )  # a few average observations come before the data


def test_what_the_filter_knows_of_the_state_is_a_mixture_of_two_observations():
    x, y, r = series()
    model = CGOMSModel.fit(x, y, r, n_regimes=2, state_feedback=False).model
    system = model.placed()
    pairs, n = system.pair_tables(0).pairs, 50
    result = CGOMSMFilter(model).filter(y[:n])
    # p(r_n-1, r_n | y_1..n) from the chain and the observations alone, by all pairs
    mu = CGOMSMFilter(model).filter(y[: n - 1]).mu[-1]
    off = y[n - 1] - pairs.Ayy[..., 0, 0] * y[n - 2] - pairs.Ny[..., 0]
    S = pairs.Qyy[..., 0, 0]
    w = mu[:, None] * model.transition * np.exp(-0.5 * (off**2 / S + np.log(S) + LOG_2PI))
    w /= w.sum()
    mean = pairs.H[..., 0, 0] * y[n - 2] + pairs.G[..., 0, 0] * y[n - 1] + pairs.c[..., 0]
    assert result.x[-1, 0] == pytest.approx((w * mean).sum(), rel=1e-10)
    variance = (w * (pairs.C[..., 0, 0] + (mean - (w * mean).sum()) ** 2)).sum()
    assert result.P[-1, 0, 0] == pytest.approx(variance, rel=1e-10)


def test_the_covariance_form_always_has_memory():
    x, y, r = series()
    with pytest.raises(ParameterError, match="state_feedback: got False with form='covariance'"):
        CGOMSModel.fit(x, y, r, n_regimes=2, state_feedback=False, form="covariance")
    assert CGOMSModel.fit(x, y, r, n_regimes=2, state_feedback=False).model.form.kind == "regression"
    with pytest.raises(ParameterError, match="state_feedback"):
        CGOFMSModel.fit(x, y, state_feedback="no")


def test_a_filter_that_drifts_is_told_of_it():
    # a growing state: nothing in y corrects what the filter errs
    x = 1.02 ** np.arange(300) + 0.1 * np.random.default_rng(1).normal(size=300)
    y = np.random.default_rng(2).normal(size=300)
    options = {"n_regimes": 1, "form": "regression"}
    assert any("state_feedback=False" in note for note in CGOMSModel.fit(x, y, **options).warnings)
    steady = CGOMSModel.fit(x, y, **options, state_feedback=False)
    assert not any("unstable" in note for note in steady.warnings)
