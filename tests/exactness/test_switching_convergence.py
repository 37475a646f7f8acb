"""Filtered means converge in the number of nodes with the orders of the theory.

The limit is that of the reference cases, computed by an independent implementation.
"""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter


def errors(case, rule, n_nodes):
    """Root mean square error of the filtered mean for each number of nodes."""
    parameters = dict(case["law"])
    make = {"FMC1": FuzzyMarkovLaw.fmc1, "FMC2": FuzzyMarkovLaw.fmc2}[parameters.pop("type")]
    gamma = [[case["Gamma"][f"{i}{j}"] for j in range(2)] for i in range(2)]
    model = CGOFMSModel(make(**parameters), [case["M0"], case["M1"]], gamma, dim_x=1)
    means = np.array([OFSRFilter(model, F, rule).filter(case["y"]).x[:, 0] for F in n_nodes])
    return np.sqrt(((means - case["converged"]["mean"]) ** 2).mean(axis=1))


def order(n_nodes, error):
    return np.polyfit(np.log(n_nodes), np.log(error), 1)[0]


@pytest.mark.parametrize("rule", ["midpoint", "gauss", "cell"])
@pytest.mark.parametrize("name", ["P1", "P3"])
def test_fmc1_second_order(name, rule, ofsrf_cases):
    n_nodes = [10, 20, 40, 80]
    assert order(n_nodes, errors(ofsrf_cases[name], rule, n_nodes)) == pytest.approx(-2.0, abs=0.05)


def test_fmc2_first_order(ofsrf_cases):
    # delta = .2 is a multiple of 1/F for all of these, so that ties do not scatter the errors
    n_nodes = [10, 20, 40, 80]
    assert order(n_nodes, errors(ofsrf_cases["P2"], "midpoint", n_nodes)) == pytest.approx(-1.0, abs=0.05)


def test_fmc2_cell_beats_midpoint_where_nodes_hit_ties(ofsrf_cases):
    n_nodes = [5, 10]
    cell, midpoint = (errors(ofsrf_cases["P2"], rule, n_nodes) for rule in ("cell", "midpoint"))
    assert (cell < midpoint / 3.0).all()


@pytest.mark.parametrize(("name", "n_nodes"), [("P1", [4, 7, 10, 13]), ("P3", [4, 7, 10, 13])])
def test_product_is_spectral(name, n_nodes, ofsrf_cases):
    # each three nodes more divide the error by fifty at least: no power of F does that
    error = errors(ofsrf_cases[name], "product", n_nodes)
    assert (error[1:] < error[:-1] / 50.0).all()


@pytest.mark.parametrize("name", ["P1", "P3"])
def test_seven_product_nodes_are_worth_fifty_midpoints(name, ofsrf_cases):
    product = errors(ofsrf_cases[name], "product", [7])[0]
    assert product < 4e-5
    assert product < errors(ofsrf_cases[name], "midpoint", [50])[0] * 1.5


def test_product_on_panels(ofsrf_cases):
    # two, four and eight nodes on each of the five panels of FMC2 with delta = .2
    error = errors(ofsrf_cases["P2"], "product", [10, 20, 40])
    assert error[1] < error[0] * 1e-3
    assert error[2] < 1e-12
