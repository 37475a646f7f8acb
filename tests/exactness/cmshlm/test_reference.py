"""Converted models against reference cases from an independent implementation."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from fuzzykf import CGLSSM, CGOMSMFilter, CGOMSModel, KnownSwitchFilter, SwitchingKalmanFilter

CASES = json.loads((Path(__file__).parents[2] / "data" / "cmshlm.json").read_text())["cases"]


def case_model(case):
    return CGOMSModel.from_cglssm(
        *(case[name] for name in ("trans", "A", "B", "C", "D")),
        initial_probability=case["p0"],
        initial_covariance=case["GX0"] if case["mode"] == "time_varying" else None,
        construction=case["construction"],
        noise=case["noise"],
        order=case.get("order", 1),
        mode=case["mode"],
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_filter_of_a_reference_case(case):
    result = CGOMSMFilter(case_model(case)).filter(np.array(case["y"]), keep_nodes=True)
    expected = case["expected"]
    for got, name in ((result.x, "mean"), (result.P, "cov"), (result.mu, "prob")):
        np.testing.assert_allclose(got, expected[name], rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(result.log_likelihood, expected["loglik_step"], rtol=1e-9)
    assert result.log_likelihood.sum() == pytest.approx(expected["loglik"], rel=1e-9)
    p = np.array(expected["prob"])
    np.testing.assert_allclose(
        p[..., None] * result.node_x, p[..., None] * np.array(expected["mean_r"]), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(
        p[..., None, None] * result.node_P,
        p[..., None, None] * np.array(expected["cov_r"]),
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_filter_with_known_regimes_of_a_reference_case(case):
    result = KnownSwitchFilter(case_model(case)).filter(np.array(case["y"]), case["r_known"])
    expected = case["expected_known_switches"]
    for got, name in ((result.x, "mean"), (result.P, "cov"), (result.log_likelihood, "loglik_step")):
        np.testing.assert_allclose(got, expected[name], rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    "case", [case for case in CASES if "reference_model1" in case], ids=lambda case: case["name"]
)
@pytest.mark.parametrize("method", ["imm", "gpb2", "kf_known_switches"])
def test_filters_of_the_state_space_model_itself(case, method):
    model = CGLSSM(
        *(case[name] for name in ("trans", "A", "B", "C", "D")),
        initial_probability=case["p0"],
        initial_covariance=case["GX0"],
    )
    ys, expected = np.array(case["y"]), case["reference_model1"][method]
    if method == "kf_known_switches":
        result = KnownSwitchFilter(model).filter(ys, case["r_known"])
        np.testing.assert_allclose(result.P, expected["cov"], rtol=1e-9, atol=1e-12)
    else:
        result = SwitchingKalmanFilter(model, method=method).filter(ys)
        np.testing.assert_allclose(result.mu, expected["prob"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.x, expected["mean"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.log_likelihood, expected["loglik_step"], rtol=1e-9)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_tables_of_a_reference_case(case):
    model, derived = case_model(case), case["derived"]
    np.testing.assert_allclose(model.initial, derived["p"], rtol=1e-9)
    np.testing.assert_allclose(model.cglssm.initial_covariance, derived["GX0"], rtol=1e-9)
    for step, A2, Q2 in zip(derived["steps"], derived["A2"], derived["Q2"], strict=True):
        pairs = model.on_nodes().pair_tables(step).pairs
        for i, j in itertools.product(range(case["K"]), repeat=2):
            if A2[i][j] is None:
                continue
            Axx, H, G, _, C, Ayy, _, V = (value[i, j] for value in pairs)
            below = np.zeros((case["q"], case["m"]))
            got_A = np.block([[Axx, H + G @ Ayy], [below, Ayy]])
            got_Q = np.block([[C + G @ V @ G.T, G @ V], [V @ G.T, V]])
            np.testing.assert_allclose(got_A, A2[i][j], rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(got_Q, Q2[i][j], rtol=1e-9, atol=1e-12)
