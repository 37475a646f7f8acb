"""Every kind of dynamics keeps the contract of dynamics, and is found by its kind."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf import CGOMSModel, SwitchingStateSpace
from fuzzykf.errors import ParameterError
from fuzzykf.switching import CGLSSM, SwitchChain
from fuzzykf.switching.dynamics.base import Dynamics
from fuzzykf.switching.dynamics.features import WindowFeatures
from fuzzykf.switching.dynamics.forms import CovarianceForm, RegressionForm, TransitionForm
from fuzzykf.switching.dynamics.inputs import InputForm
from fuzzykf.switching.dynamics.pairwise import PairwiseForm
from fuzzykf.switching.dynamics.registry import FORMS
from fuzzykf.switching.state_space.converted_form import ConvertedForm

T = [[0.9, 0.1], [0.2, 0.8]]
Z = np.array([[1.0, 0.5], [0.5, 1.0]])
PAIR = np.block([[Z, 0.8 * Z], [0.8 * Z, Z]])
MEANS, COVARIANCES = [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(PAIR, (2, 2, 4, 4))
ONE = np.ones((2, 2, 1, 1))
EXAMPLES = {
    "covariance": CovarianceForm(MEANS, COVARIANCES, 1, "project"),
    "transition": TransitionForm(
        np.tile(0.5 * np.eye(2), (2, 2, 1, 1)), np.tile(np.eye(2), (2, 2, 1, 1)), MEANS, [Z, Z], 1
    ),
    "regression": RegressionForm(
        Ayy=0.5 * ONE, Ny=0.0 * ONE[..., 0], Qyy=ONE, Axx=0.9 * ONE, H=0.1 * ONE, G=0.3 * ONE,
        c=0.0 * ONE[..., 0], C=ONE, means=MEANS, covariances=[Z, Z],
    ),
    "inputs": InputForm(
        Ayy=0.5 * ONE, Ny=0.0 * ONE[..., 0], Qyy=ONE, Axx=0.9 * ONE, H=0.1 * ONE, G=0.3 * ONE,
        c=0.0 * ONE[..., 0], C=ONE, means=MEANS, covariances=[Z, Z], By=0.2 * np.ones((2, 2, 1, 2)),
        Bx=0.1 * np.ones((2, 2, 1, 2)), features=WindowFeatures(order=2, hinges=[[1.0]]),
    ),
    "pairwise": PairwiseForm(
        [[[0.5, 0.1], [0.0, 0.8]]] * 2, noise=[np.eye(2), 2.0 * Z], offset=MEANS, means=MEANS,
        covariances=[Z, Z], dim_x=1,
    ),
    "cglssm": ConvertedForm(
        CGLSSM(T, A=[[[0.9]], [[0.5]]], B=[[[1.0]]] * 2, C=[[[0.3]], [[1.0]]], D=[[[0.5]]] * 2),
        "gain", "pair", 3, "stationary",
    ),
    "space_on_nodes": SwitchingStateSpace(
        T, F=[[[0.9]], [[0.5]]], H=1.0, Q=[[[0.1]], [[1.0]]], R=0.2, b=[1.0], d=[[3.0], [0.0]]
    ).to_exact(3).form,
}  # fmt: skip


@pytest.fixture(params=sorted(FORMS))
def form(request):
    return EXAMPLES[request.param]


def test_dynamics_are_found_by_their_kind(form):
    assert isinstance(form, Dynamics)
    assert FORMS[form.kind] is type(form)


def test_a_model_holds_any_of_them(form):
    model = CGOMSModel._from_form(T, form)
    system = model.placed()
    assert (system.dim_x, system.dim_z, len(system.chain)) == (form.dim_x, form.dim_z, form.n_classes)
    data = model.simulate(30, np.random.default_rng(0))
    assert data.x.shape == data.y.shape == (30, 1)
    assert model.filter().filter(data.y).x.shape == (30, 1)
    mean, covariance = form.marginal(np.eye(2))
    np.testing.assert_allclose(mean, system.initial().mean, atol=1e-14)
    np.testing.assert_allclose(covariance, system.initial().covariance, rtol=1e-12, atol=1e-14)
    if form.kind == "inputs":
        with pytest.raises(ParameterError, match="no KnownSwitchFilter takes"):
            model.along(data.r)
        return
    path = model.along(data.r)
    np.testing.assert_array_equal(path.r, data.r)
    # a path through the regimes meets the tables of the chain
    i, j = int(data.r[0]), int(data.r[1])
    for here, there in zip(path.pair_tables(0).pairs, system.pair_tables(0).pairs, strict=True):
        np.testing.assert_allclose(here[0, 0], there[i, j], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    "again", [lambda f: type(f).from_dict(f.to_dict()), lambda f: pickle.loads(pickle.dumps(f))]
)
def test_dynamics_come_back_bit_for_bit(form, again):
    assert again(form).to_dict() == form.to_dict()
    for a, b in zip(again(form).marginal(np.eye(2)), form.marginal(np.eye(2)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_only_converted_dynamics_stand_for_a_state_space_model():
    assert isinstance(EXAMPLES["cglssm"].cglssm, CGLSSM)
    assert EXAMPLES["cglssm"].closeness([1.0]) >= 0.99
    assert EXAMPLES["space_on_nodes"].closeness([1.0]) >= 0.99
    assert EXAMPLES["space_on_nodes"].cglssm is None
    assert EXAMPLES["covariance"].cglssm is None
    with pytest.raises(ParameterError, match="closeness: got a model that stands for itself"):
        EXAMPLES["covariance"].closeness([1.0])


def test_converted_dynamics_go_with_their_own_chain():
    form = EXAMPLES["cglssm"]
    assert form.placed(SwitchChain.from_classes(T)) is form.system
    with pytest.raises(ParameterError, match="transition, initial: a converted model goes with the chain"):
        form.placed(SwitchChain.from_classes([[0.5, 0.5], [0.2, 0.8]]))
