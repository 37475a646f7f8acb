"""Learned models on new data: mean squared error of their filters above that of the true model."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, OFSRFilter

pytestmark = pytest.mark.study

#: eta of FMC1 (.07, .05, eta): 48 %, 67 % and 93 % hard switches
ETAS = (0.275, 0.16, 0.005)
SEEDS = 10
N_TRAIN, N_TEST = 2000, 20_000

#: The default call, which chooses the form by BIC; and the form that is not of the true model.
FITS = {
    "hidden": lambda s: CGOFMSModel.fit(s.x, s.y),
    "hidden, regression form": lambda s: CGOFMSModel.fit(s.x, s.y, form="regression"),
    "hidden, for the filter": lambda s: CGOFMSModel.fit(s.x, s.y, objective="filter"),
    "hard K = 2": lambda s: CGOMSModel.fit(s.x, s.y),
    "hard K = 2, regression form": lambda s: CGOMSModel.fit(s.x, s.y, form="regression"),
    "supervised": lambda s: CGOFMSModel.fit(s.x, s.y, s.r),
    "supervised, regression form": lambda s: CGOFMSModel.fit(s.x, s.y, s.r, form="regression"),
}


def filter_error(model, data):
    f = OFSRFilter(model) if isinstance(model, CGOFMSModel) else CGOMSMFilter(model)
    return float(np.mean((f.filter(data.y).x - data.x) ** 2))


def test_recovery(paper_model, write_table):
    rows, means, forms = [], {}, []
    for eta in ETAS:
        truth = paper_model(eta)
        errors, excess = [], {name: [] for name in FITS}
        for seed in range(SEEDS):
            rng = np.random.default_rng([seed, round(1000 * eta)])
            train, test = truth.simulate(N_TRAIN, rng), truth.simulate(N_TEST, rng)
            errors.append(filter_error(truth, test))
            for name, learn in FITS.items():
                fit = learn(train)
                assert fit.converged, (eta, seed, name)
                excess[name].append(filter_error(fit.model, test) - errors[-1])
                if name == "hidden":
                    forms.append(fit.model.form.kind)
        means[eta] = {name: np.mean(values) for name, values in excess.items()}
        cells = [f"{np.mean(v):.4f} ({np.min(v):.4f} to {np.max(v):.4f})" for v in excess.values()]
        rows.append([f"{truth.law.p_hard:.1%}", f"{np.mean(errors):.4f}", *cells])
    write_table("recovery", ["hard", "true model", *FITS], rows)
    assert set(forms) == {"covariance"}  # BIC finds the form of the true model
    for eta in ETAS:
        found = means[eta]
        assert found["hidden"] <= 0.005, (eta, found)
        assert found["supervised"] <= 0.003, (eta, found)
        if paper_model(eta).law.p_hard < 0.7:
            hard = min(found["hard K = 2"], found["hard K = 2, regression form"])
            assert found["hidden"] < hard, (eta, found)
