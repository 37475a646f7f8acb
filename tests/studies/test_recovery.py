"""Learned models on new data: mean squared error of their filters above that of the true model."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, OFSRFilter

pytestmark = pytest.mark.study

#: eta of FMC1 (.07, .05, eta): 48 %, 67 % and 93 % hard switches
ETAS = (0.275, 0.16, 0.005)
SEEDS = 6
N_TRAIN, N_TEST = 2000, 20_000

FITS = {
    "hidden, covariance": lambda s: CGOFMSModel.fit(s.x, s.y, form="covariance"),
    "hidden, regression": lambda s: CGOFMSModel.fit(s.x, s.y, form="regression"),
    "hard, covariance": lambda s: CGOMSModel.fit(s.x, s.y, form="covariance"),
    "hard, regression": lambda s: CGOMSModel.fit(s.x, s.y, form="regression"),
    "known, covariance": lambda s: CGOFMSModel.fit(s.x, s.y, s.r, form="covariance"),
    "known, regression": lambda s: CGOFMSModel.fit(s.x, s.y, s.r, form="regression"),
}


def filter_error(model, data):
    f = OFSRFilter(model) if isinstance(model, CGOFMSModel) else CGOMSMFilter(model)
    return float(np.mean((f.filter(data.y).x - data.x) ** 2))


def test_recovery(paper_model, write_table):
    rows, means = [], {}
    for eta in ETAS:
        truth = paper_model(eta)
        errors, excess = [], {name: [] for name in FITS}
        for seed in range(SEEDS):
            rng = np.random.default_rng([seed, round(1000 * eta)])
            train, test = truth.simulate(N_TRAIN, rng), truth.simulate(N_TEST, rng)
            errors.append(filter_error(truth, test))
            for name, fit in FITS.items():
                excess[name].append(filter_error(fit(train).model, test) - errors[-1])
        means[eta] = {name: np.mean(values) for name, values in excess.items()}
        cells = [f"{np.mean(v):.4f} ({np.min(v):.4f} to {np.max(v):.4f})" for v in excess.values()]
        rows.append([f"{truth.law.p_hard:.0%}", f"{np.mean(errors):.4f}", *cells])
    write_table("recovery", ["hard", "true model", *FITS], rows)
    for eta in ETAS:
        found = means[eta]
        assert found["hidden, covariance"] <= 0.005, (eta, found)
        assert found["known, covariance"] <= 0.003, (eta, found)
        if paper_model(eta).law.p_hard < 0.7:
            hard = min(found["hard, covariance"], found["hard, regression"])
            assert found["hidden, covariance"] < hard, (eta, found)
