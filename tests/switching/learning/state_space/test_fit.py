"""Learning switching state-space models from observations: what is found, what is said of it."""

from __future__ import annotations

import pickle

import numpy as np
import pandas as pd
import pytest

from fuzzykf import (
    FadeLaw,
    FuzzyMarkovLaw,
    KalmanFilter,
    SwitchingKalmanFilter,
    SwitchingStateSpace,
    engine,
)
from fuzzykf.errors import FuzzykfError
from fuzzykf.estimation import LikelihoodFit
from fuzzykf.labels import Labels

pytestmark = pytest.mark.skipif(
    engine.info().name == "numpy", reason="its gradients are tested by themselves, and a fit takes long"
)

BOTH = {"Q": "full", "R": "full"}


def model(R=(0.09, 9.0), q=0.09, law=None, d=(0.0, 2.0)):
    """A state that is seen with one of two noises, and an offset."""
    law = FadeLaw.between(30, 8) if law is None else law
    R, d = np.array(R)[:, None, None], np.array(d)[:, None]
    return SwitchingStateSpace(law, F=0.9, H=1.0, Q=q, R=R, d=d, x0=[0.0], P0=0.5, mix="log")


def kalman(q=0.1, r=0.2, **others):
    """A model of one class."""
    return SwitchingStateSpace([[1.0]], **({"F": 0.9, "H": 1.0, "x0": [0.0], "P0": 0.5} | others), Q=q, R=r)


@pytest.fixture(scope="module")
def seen():
    return model().simulate(300, np.random.default_rng(3))


@pytest.fixture(scope="module")
def seen_by_one():
    return kalman().simulate(200, np.random.default_rng(0))


# --------------------------------------------------------------------------- what is found


def test_eight_numbers_are_found_and_those_of_permuted_classes_are_permuted(seen):
    fades = {(0, 1): (0.05, 6.0), (1, 0): (0.02, 7.0)}
    given = model((0.3, 3.0), 0.2, FadeLaw(2, fades), d=(0.0, 1.0))
    zs = seen.y[:200]
    fit = given.fit(zs, free=BOTH | {"d": [[False], [True]], "law": True}, n_nodes=1)
    assert isinstance(fit, LikelihoodFit)
    assert fit.converged
    assert fit.n_parameters == len(fit.estimates) == 8
    truth = {"R[0][0, 0]": 0.09, "R[1][0, 0]": 9.0, "Q[0, 0]": 0.09, "d[1][0]": 2.0}
    for name, value in truth.items():  # the standard errors say how near
        assert abs(fit.estimates[name] - value) < 3.0 * fit.standard_errors[name], name

    turned = {(1 - a, 1 - b): fade for (a, b), fade in fades.items()}
    other = model((3.0, 0.3), 0.2, FadeLaw(2, turned), d=(1.0, 0.0))
    found = other.fit(zs, free=BOTH | {"d": [[True], [False]], "law": True}, n_nodes=1)
    assert found.log_likelihood == pytest.approx(fit.log_likelihood, abs=1e-6)
    names = str.maketrans("01", "10")
    for name, value in found.estimates.items():
        if name == "Q[0, 0]":
            mirrored = name
        elif "[" in name:
            mirrored = name[:1] + name[1:4].translate(names) + name[4:]
        else:
            mirrored = name.translate(names)
        assert value == pytest.approx(fit.estimates[mirrored], rel=1e-4), name


@pytest.mark.parametrize(
    "law",
    [
        FadeLaw.between(20, 5, jump=0.01),
        FuzzyMarkovLaw.fmc1(0.3, 0.05, 0.08),
        FuzzyMarkovLaw.fmc2(0.3, 0.2, 0.25),
        [[0.9, 0.1], [0.2, 0.8]],
        FadeLaw.between(30, 8).discretize(1),
    ],
    ids=["fades", "fmc1", "fmc2", "hard", "chain"],
)
def test_every_law_is_learned_to_where_nothing_rises(law, seen):
    """Of what is found, the log-likelihood of the filter falls to either side of each number."""
    given = model(law=law)
    before = given.to_dict()
    fit = given.fit(seen.y[:80], free={"R": "full", "law": True}, n_nodes=2)
    assert given.to_dict() == before
    assert fit.converged
    f = SwitchingKalmanFilter(fit.model, n_nodes=2)
    assert f.filter(seen.y[:80]).log_likelihood.sum() == pytest.approx(fit.log_likelihood, rel=1e-10)
    begun = SwitchingKalmanFilter(given, n_nodes=2).filter(seen.y[:80]).log_likelihood.sum()
    assert fit.trace[0] == pytest.approx(begun, rel=1e-6)
    assert fit.log_likelihood > begun + 0.5
    R = fit.model.form.parameters["R"].values
    for factor in (0.99, 1.01):
        moved = SwitchingStateSpace(
            fit.model.law, F=0.9, H=1.0, Q=0.09, R=factor * R, d=[[0.0], [2.0]], x0=[0.0], P0=0.5, mix="log"
        )
        beside = SwitchingKalmanFilter(moved, n_nodes=2).filter(seen.y[:80]).log_likelihood.sum()
        assert beside < fit.log_likelihood


def test_one_class_is_the_kalman_filter(seen_by_one):
    zs = seen_by_one.y.copy()
    zs[20:30] = np.nan
    found = kalman(0.1, 0.5).fit(zs, free={"R": "full"})
    # the filter stands one step before: .81 P + .1 = .5
    kf = KalmanFilter(1, 1, F=[[0.9]], H=[[1.0]], Q=0.1, R=0.5, x=[0.0], P=0.4 / 0.81)
    expected = kf.fit(zs, free={"R": "full"})
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-9)
    assert found.estimates == pytest.approx(expected.estimates, rel=1e-4)
    assert found.standard_errors == pytest.approx(expected.standard_errors, rel=1e-3)
    assert found.n_observations == expected.n_observations == 190


def test_measured_states_make_moments_of_the_residuals(seen_by_one):
    """With every state known, the maximum of one class is known as well."""
    x, y = seen_by_one.x, seen_by_one.y
    fit = kalman(0.5, 0.5).fit(y, x, free=BOTH)
    assert fit.estimates["Q[0, 0]"] == pytest.approx(np.mean((x[1:] - 0.9 * x[:-1]) ** 2), rel=1e-6)
    assert fit.estimates["R[0, 0]"] == pytest.approx(np.mean((y - x) ** 2), rel=1e-6)


def test_measured_states_tell_gains_that_observations_alone_do_not(seen):
    given = model((0.09, 9.0))
    gains = SwitchingStateSpace(
        given.law,
        F=0.9,
        H=[[[0.5]], [[0.5]]],
        Q=0.09,
        R=given.form.parameters["R"].values,
        d=[[0.0], [2.0]],
        x0=[0.0],
        P0=0.5,
        mix="log",
    )
    xs = np.where(np.arange(300)[:, None] % 3 == 0, seen.x, np.nan)  # every third one
    fit = gains.fit(seen.y, xs, free={"H": "full"}, n_nodes=2)
    assert fit.n_observations == 300
    assert fit.estimates["H[0][0, 0]"] == pytest.approx(1.0, abs=3.0 * fit.standard_errors["H[0][0, 0]"])
    hidden = gains.fit(seen.y, free={"H": "full"}, n_nodes=2)
    assert fit.standard_errors["H[0][0, 0]"] < hidden.standard_errors["H[0][0, 0]"]


def test_several_series_count_together(seen):
    given = model((0.3, 3.0))
    parts = [seen.y[:100], seen.y[100:180]]
    fit = given.fit(parts, free={"R": "full"}, n_nodes=1)
    f = SwitchingKalmanFilter(fit.model, n_nodes=1)
    total = sum(float(f.filter(part).log_likelihood.sum()) for part in parts)
    assert fit.log_likelihood == pytest.approx(total, rel=1e-10)
    assert fit.n_observations == 180


def test_a_control_matrix_is_learned():
    rng = np.random.default_rng(2)
    us = rng.normal(size=200)
    given = kalman(B=[[0.8]])
    truth = given.simulate(200, rng, us=us)
    fit = kalman(B=[[0.1]]).fit(truth.y, free={"B": "full"}, us=us)
    assert abs(fit.estimates["B[0, 0]"] - 0.8) < 3.0 * fit.standard_errors["B[0, 0]"]


@pytest.mark.parametrize("unit", [1e-8, 1e3, 1e8])
def test_offsets_from_zero_are_found_in_any_unit(unit, seen_by_one):
    def learned(unit):
        given = kalman(0.1 * unit**2, 0.2 * unit**2, d=[0.0], b=[0.0], P0=0.5 * unit**2)
        return given.fit(unit * (seen_by_one.y + 3.0), free={"d": "full", "R": "full"}, max_iter=60)

    one, other = learned(1.0), learned(unit)
    assert other.converged
    for name, power in (("d[0]", 1), ("R[0, 0]", 2)):
        assert other.estimates[name] == pytest.approx(one.estimates[name] * unit**power, rel=1e-4)
        assert other.standard_errors[name] == pytest.approx(one.standard_errors[name] * unit**power, rel=1e-3)


def test_a_search_ends_where_an_offset_is_far_away():
    # the way to it leads over noises that vanish, from which nobody should climb step by step
    def sensor(d):
        noises = {"Q": 0.25, "R": [[[1.0]], [[100.0]]]}
        return SwitchingStateSpace([[0.9, 0.1], [0.1, 0.9]], F=0.95, H=1.0, **noises, d=[d], x0=[0.0], P0=1.0)

    zs = sensor(1000.0).simulate(100, np.random.default_rng(0)).y
    fit = sensor(0.0).fit(zs, free={"d": "full", "Q": "full", "R": "full"}, max_iter=200)
    assert fit.converged
    assert fit.estimates["d[0]"] == pytest.approx(1000.0, abs=3.0)


# --------------------------------------------------------------------------- what is said of it


def test_signs_of_gains_are_two_maxima_of_one_height(seen_by_one):
    given = kalman(H=[[0.7]])
    zs, rng = seen_by_one.y[:100], np.random.default_rng(1)
    fit = given.fit(zs, free={"H": "full"}, n_starts=8, rng=rng)
    gains = sorted(one.estimates["H[0, 0]"] for one in fit.maxima)
    assert gains[0] == pytest.approx(-gains[1], rel=1e-4)
    assert abs(abs(gains[1]) - 1.0) < 3.0 * fit.standard_errors["H[0, 0]"]
    assert fit.n_starts == 8
    assert any(
        note.startswith("another maximum has a log-likelihood that is less by") for note in fit.warnings
    )


def test_maxima_of_exchanged_classes_are_named(seen):
    R, law = [[[1.0]], [[1.2]]], [[0.9, 0.1], [0.1, 0.9]]
    given = SwitchingStateSpace(law, F=0.9, H=1.0, Q=0.09, R=R, x0=[0.0], P0=0.5)
    fit = given.fit(seen.y[:100], free={"R": "full"}, n_starts=4, rng=np.random.default_rng(0))
    first, second = (list(one.estimates.values()) for one in fit.maxima)
    assert second == pytest.approx(first[::-1], rel=1e-3)
    assert fit.warnings[-1].startswith("another maximum has the same numbers in another order")
    assert sum("another maximum" in note for note in fit.warnings) == 1
    alone = given.fit(seen.y[:100], free={"R": "full"})
    assert alone.warnings == ()


@pytest.mark.parametrize(
    ("fit", "notes"),
    [
        (
            lambda zs: model((0.1, 5.0), law=[[0.999, 0.001], [0.5, 0.5]]).fit(zs, free={"R": "full"}),
            [
                r"R\[1\]\[0, 0\]: weakly identified",
                "class 1: rarely visited, in .* of 60 steps",
            ],
        ),
        (
            lambda zs: kalman(0.1, 1.0, P0=1e-6).fit(np.tile([1.0, -1.0], 30), free=BOTH),
            [r"Q\[0, 0\]: at its bound; the estimate is 0"],
        ),
        (
            lambda zs: kalman(1.0, 1.0, x0=None, P0=None, F=0.0).fit(zs, free=BOTH),
            [r"Q\[0, 0\], R\[0, 0\]: weakly identified, the log-likelihood"],
        ),
        (
            lambda zs: model((0.1, 0.1), law=FadeLaw.between(20, 9)).fit(
                2.0 * (np.arange(240) % 60 > 30) + 0.3 * np.sin(np.arange(240) ** 2),
                free={"law": True},
                n_nodes=6,
            ),
            ["the fades from 0 to 1, 1 to 0 cannot be shorter than n_nodes = 6 steps"],
        ),
    ],
    ids=["not visited", "at its bound", "one number of two", "a short fade"],
)
def test_what_the_data_do_not_tell_is_said(fit, notes, seen_by_one):
    warnings = fit(seen_by_one.y[:60]).warnings
    for note in notes:
        assert pd.Series(warnings).str.match(note).any(), (note, warnings)


def test_occupancy_is_that_of_the_filter(seen):
    fit = model((0.3, 3.0)).fit(seen.y, free={"R": "full"}, n_nodes=2)
    weights = SwitchingKalmanFilter(fit.model, n_nodes=2).filter(seen.y).class_weights
    np.testing.assert_allclose(fit.occupancy, weights.mean(axis=0), rtol=1e-9)


def test_replicates_have_the_form_of_the_series(seen_by_one):
    xs = np.where(np.arange(60)[:, None] % 2, seen_by_one.x[:60], np.nan)
    zs = seen_by_one.y[:60].copy()
    zs[:7] = np.nan
    fit = pickle.loads(pickle.dumps(kalman(0.5, 0.5).fit(zs, xs, free=BOTH)))
    replicates = fit.bootstrap(8, np.random.default_rng(0))
    assert {one.n_observations for one in replicates} == {fit.n_observations}
    for name, error in fit.standard_errors.items():
        spread = np.std([one.estimates[name] for one in replicates])
        assert 0.5 < spread / error < 2.0, name


# --------------------------------------------------------------------------- what is refused

Z = np.zeros((30, 1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"zs": np.zeros((5, 2))}, r"zs: got shape \(5, 2\)"),
        ({"xs": np.zeros((30, 2))}, r"xs: got shape \(30, 2\)"),
        ({"us": np.zeros(30)}, "us: got .*, but the model has no B"),
        ({"n_nodes": 9}, "n_nodes: got 9, expected n_nodes=8 at most"),
        ({"n_nodes": 1.5}, "n_nodes: got 1.5"),
        ({"free": {"R": "full", "law": True}, "n_nodes": 0}, "n_nodes: got 0, expected at least 1"),
        ({"n_starts": 3}, "rng: missing; more than one start"),
        ({"tolerance": 0.0}, "tolerance: got 0.0"),
        ({"max_iter": 0}, "max_iter: got 0"),
        ({"progress": "yes"}, "progress: got 'yes', expected True or False"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    given = {"zs": Z, "free": {"R": "full"}} | arguments
    with pytest.raises(FuzzykfError, match=message):
        model().fit(given.pop("zs"), **given)


def test_names_of_the_model_are_kept(seen_by_one):
    named = kalman(0.5).labelled(observations=["level"])
    fit = named.fit(pd.DataFrame({"noise": 0.0, "level": seen_by_one.y[:60, 0]}), free=BOTH)
    assert fit.estimates == kalman(0.5).fit(seen_by_one.y[:60], free=BOTH).estimates
    assert fit.model.labels == named.labels


def test_names_and_step_of_the_data_are_remembered(seen_by_one):
    """So that the filter refuses rows of another step, and takes what it observes by name."""
    hours = pd.date_range("2024-01-01", periods=60, freq="h")
    frame = pd.DataFrame({"two": 0.0, "level": seen_by_one.y[:60, 0]}, hours)
    fit = kalman(0.5).fit(frame["level"], free=BOTH)
    assert fit.model.labels == Labels(None, ["level"], step=np.timedelta64(1, "h"))
    f = fit.model.filter()
    np.testing.assert_array_equal(f.filter(frame).x, f.filter(frame["level"].to_numpy()).x)
    with pytest.raises(FuzzykfError, match=r"zs: its rows are 2:00:00 apart, but the model was learned on"):
        f.filter(frame[::2])


def test_what_has_no_density_is_refused():
    """Of a position and its speed, driven by one noise, the one follows from the other."""
    F = [[1.0, 1.0], [0.0, 1.0]]
    given = SwitchingStateSpace(
        [[1.0]], F=F, H=[[1.0, 0.0]], Q=[[0.25, 0.5], [0.5, 1.0]], R=1.0, x0=[0.0, 0.0], P0=np.eye(2)
    )
    truth = given.simulate(20, np.random.default_rng(0))
    with pytest.raises(FuzzykfError, match=r"xs: .* or fewer measured components"):
        given.fit(truth.y, truth.x, free={"R": "full"})
    positions = np.stack([truth.x[:, 0], np.full(20, np.nan)], axis=1)
    assert given.fit(truth.y, positions, free={"R": "full"}).converged
    exact = SwitchingStateSpace([[1.0]], F=0.5, H=1.0, Q=0.0, R=0.0, x0=[0.0], P0=0.0, b=[1.0])
    with pytest.raises(
        FuzzykfError, match="R: got a model in which some of what is observed follows from the rest"
    ):
        exact.fit(Z, free={"b": "full"})
