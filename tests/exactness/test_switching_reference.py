"""The reference cases: numbers computed by independent implementations.

``tests/data/ofsrf.json`` carries its conventions in ``meta.conventions``.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, FuzzyMarkovLaw, KnownSwitchFilter, OFSRFilter

CASES = ("P1", "P2", "P3", "P4")
RULES = {"mid": "midpoint", "gl": "gauss"}
TOLERANCE = 1e-9


@pytest.fixture(params=CASES)
def case(request, ofsrf_cases):
    return ofsrf_cases[request.param]


def law_of(case):
    law = case["law"]
    if law["type"] == "FMC1":
        return FuzzyMarkovLaw.fmc1(law["alpha"], law["delta"], law["eta"])
    return FuzzyMarkovLaw.fmc2(law["alpha"], law["gamma"], law["delta"])


def model_of(case):
    gamma = [[case["Gamma"][f"{i}{j}"] for j in range(2)] for i in range(2)]
    return CGOFMSModel(law_of(case), [case["M0"], case["M1"]], gamma, dim_x=1)


def check(result, expected):
    np.testing.assert_allclose(result.x[:, 0], expected["mean"], rtol=TOLERANCE, atol=TOLERANCE)
    np.testing.assert_allclose(result.P[:, 0, 0], expected["var"], rtol=TOLERANCE, atol=TOLERANCE)
    if "loglik_step" in expected:
        log_likelihood = result.log_likelihood
        np.testing.assert_allclose(log_likelihood, expected["loglik_step"], rtol=TOLERANCE, atol=TOLERANCE)
        np.testing.assert_allclose(log_likelihood.sum(), expected["loglik_total"], rtol=TOLERANCE)
        np.testing.assert_allclose(result.mu[:, 0], expected["p0"], rtol=TOLERANCE, atol=1e-15)
        np.testing.assert_allclose(result.mu[:, -1], expected["p1"], rtol=TOLERANCE, atol=1e-15)


def test_law(case):
    law, derived = law_of(case), case["derived"]
    assert law.beta == pytest.approx(derived["beta"], rel=1e-12, abs=1e-15)
    assert law.p_hard == pytest.approx(derived["pH"], rel=1e-12)
    np.testing.assert_allclose(law.harden(), derived["hard_joint"], rtol=1e-12, atol=1e-15)


def test_nodes_and_weights(case):
    chain = law_of(case).discretize(case["F"], RULES[case["rule"]])
    np.testing.assert_allclose(chain.nodes, case["nodes"], rtol=1e-13)
    np.testing.assert_allclose(chain.weights, case["weights"], rtol=1e-13)


def test_point_rules(case):
    # midpoint (P1, P2, P4) and Gauss-Legendre (P3)
    result = OFSRFilter(model_of(case), case["F"], RULES[case["rule"]]).filter(case["y"])
    check(result, case["expected"])
    np.testing.assert_allclose(result.switch, case["mpm_paper_rule"], rtol=1e-12)


def test_step_by_step(case):
    # the same through the verbs, whose arithmetic is another function than that of whole series
    f, expected = OFSRFilter(model_of(case), case["F"], RULES[case["rule"]]), case["expected"]
    for n, z in enumerate(case["y"]):
        f.predict()
        f.update(z)
        assert f.x[0, 0] == pytest.approx(expected["mean"][n], rel=TOLERANCE, abs=TOLERANCE)
        assert f.P[0, 0] == pytest.approx(expected["var"][n], rel=TOLERANCE)
        assert f.log_likelihood == pytest.approx(expected["loglik_step"][n], rel=TOLERANCE, abs=TOLERANCE)
        assert f.mu[0] == pytest.approx(expected["p0"][n], rel=TOLERANCE)
        assert f.switch == pytest.approx(case["mpm_paper_rule"][n], rel=1e-12)


@pytest.mark.parametrize("name", ["P1", "P2", "P4"])
def test_cell_rule(name, ofsrf_cases):
    case = ofsrf_cases[name]
    check(OFSRFilter(model_of(case), case["F"], "cell").filter(case["y"]), case["expected_cell"])


def test_200_midpoints(case):
    # with 202 nodes the kernels take another path than with few
    check(OFSRFilter(model_of(case), 200, "midpoint").filter(case["y"]), case["F200_mid_norm"])


# FMC1 has one panel; FMC2 has one between any two of k delta and 1 - k delta: 5 for .2, 11 for .17
@pytest.mark.parametrize(("name", "n_nodes"), [("P1", 24), ("P2", 50), ("P3", 24), ("P4", 110)])
def test_product_rule_converges_to_the_limit(name, n_nodes, ofsrf_cases):
    case = ofsrf_cases[name]
    check(OFSRFilter(model_of(case), n_nodes, "product").filter(case["y"]), case["converged"])


def test_hardened_model(case):
    check(CGOMSMFilter(model_of(case).harden()).filter(case["y"]), case["expected_hard"])


def test_known_switches(case):
    check(KnownSwitchFilter(model_of(case)).filter(case["y"], case["r_true"]), case["expected_kj"])
