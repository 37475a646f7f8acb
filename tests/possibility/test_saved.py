"""An estimator that was written to a file goes on to the same numbers; functions are refused by name."""

from __future__ import annotations

import json

import numpy as np
import pytest

from fuzzykf import (
    CauchyMembership,
    FunctionMembership,
    FuzzyRelationEstimator,
    GaussianMembership,
    IntervalMembership,
    ParabolicMembership,
    SingletonMembership,
    TriangularMembership,
)
from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.io import load_filter
from fuzzykf.possibility import GridMembership

F = np.array([[1.0, 1.0], [0.0, 1.0]])
GAUSS, BOX = GaussianMembership(0.0, 1.0), IntervalMembership(-1.0, 1.0)
FIELDS = ("x", "P", "x_prior", "P_prior", "lower", "upper", "possibility")


def scalar(state, noise, error, **options):
    return FuzzyRelationEstimator(
        1, 1, F=0.9, H=1.1, state=state, process_noise=noise, measurement_noise=error, **options
    )


MAKE = {
    "gaussian": lambda: FuzzyRelationEstimator(
        2, 1, 1, F=F, H=[[1.0, 0.0]], Q=np.diag([0.1, 0.3]), R=0.7, B=[[0.0], [1.0]], x=[1.0, 0.5]
    ),
    "cauchy": lambda: FuzzyRelationEstimator(1, 1, F=0.9, H=1.0, R=0.3, t_norm="hamacher"),
    "parabolic": lambda: FuzzyRelationEstimator(
        1, 1, H=1.0, R=9.0, t_norm="lukasiewicz", constraint=ParabolicMembership(0.5, 2.0)
    ),
    "box": lambda: scalar(BOX, BOX, BOX, constraint=(-0.9, np.inf), on_empty="keep"),
    "grid": lambda: scalar(
        TriangularMembership(-1.0, 0.0, 2.0),
        GAUSS,
        CauchyMembership(0.0, 1.0),
        points=51,
        constraint=(-0.5, np.inf),
    ),
    "domain": lambda: scalar(GAUSS, [BOX], GAUSS.cut((-2.0, np.inf)), domain=(-4.0, 4.0), t_norm="min"),
    "plane": lambda: FuzzyRelationEstimator(
        2,
        1,
        F=F,
        H=[[1.0, 0.0]],
        state=[GAUSS, SingletonMembership(0.5)],
        process_noise=[None, CauchyMembership(0.0, 1.0).cut(0.5)],
        measurement_noise=GridMembership([-1.0, 0.0, 1.0], [0.0, 1.0, 0.5]),
        points=(21, 31),
        floor=1e-4,
    ),
}


@pytest.mark.parametrize("name", MAKE)
def test_it_goes_on_to_the_same_numbers(name, tmp_path) -> None:
    est = MAKE[name]()
    for n, zs in enumerate(([], [0.3, None, -0.2])):
        est.filter(zs)
        est.save(tmp_path / "est.json")
        again = FuzzyRelationEstimator.load(tmp_path / "est.json")
        assert type(load_filter(tmp_path / "est.json")) is FuzzyRelationEstimator
        assert repr(again) == repr(est), n
        for field in ("x_post", "P_post", "z", *FIELDS):
            assert np.array_equal(getattr(again, field), getattr(est, field)), field
            assert np.shape(getattr(again, field)) == np.shape(getattr(est, field)), field
        more = [0.4, None, 0.1]
        for verb in ("filter", "smooth"):
            expected, found = getattr(est.copy(), verb)(more), getattr(again.copy(), verb)(more)
            for field in FIELDS:
                assert np.array_equal(getattr(found, field), getattr(expected, field)), (verb, field)
    again.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == (tmp_path / "est.json").read_text()


def test_an_h_that_was_never_set_is_not_set_in_the_file(tmp_path) -> None:
    FuzzyRelationEstimator(1, 1).save(tmp_path / "est.json")
    again = FuzzyRelationEstimator.load(tmp_path / "est.json")
    with pytest.raises(ParameterError, match="H: got no matrix"):
        again.update(1.0)
    est = FuzzyRelationEstimator(1, 1, H=0.0)
    est.save(tmp_path / "est.json")
    FuzzyRelationEstimator.load(tmp_path / "est.json").update(1.0)


def bend(x):
    return x + 0.1 * x**2


@pytest.mark.parametrize(
    ("est", "message"),
    [
        (
            lambda: FuzzyRelationEstimator(
                1, 1, fx=bend, hx=np.sinh, state=GAUSS, measurement_noise=GAUSS, points=21
            ),
            r"fx \(bend\), hx \(sinh\): a file cannot hold functions",
        ),
        (
            lambda: scalar(GAUSS, GAUSS, FunctionMembership(np.cos, (-1.0, 1.0))),
            "measurement_noise: got a FunctionMembership of the function cos",
        ),
        (
            lambda: scalar(FunctionMembership(np.cos, (-1.0, 1.0)), GAUSS.cut(0.5), GAUSS),
            None,  # of the state only the lattice is kept
        ),
    ],
)
def test_functions_are_refused_by_name_and_no_file_is_left(est, message, tmp_path) -> None:
    path = tmp_path / "est.json"
    if message is None:
        est().save(path)
        return
    with pytest.raises(ParameterError, match=message):
        est().save(path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("gaussian", lambda d: d.update(representation="grid"), "representation: got 'grid'"),
        ("gaussian", lambda d: d["belief"].update(x=[0.0]), "belief: got"),
        ("gaussian", lambda d: d["belief"].update(P=[[1.0, 0.0], [0.0, -1.0]]), "covariance"),
        ("gaussian", lambda d: d["found"].update(K=[0.0, 0.0, 0.0]), "K: got"),
        ("gaussian", lambda d: d["numbers"].update(F=1.0), "F: got"),
        ("gaussian", lambda d: d["process_noise"].update(kind="os.system"), "expected that of a membership"),
        ("box", lambda d: d["belief"].update(lower=[9.0]), "expected lower <= upper"),
        ("grid", lambda d: d["belief"]["cost"].__setitem__(0, -1.0), "cost: expected"),
        ("grid", lambda d: d["belief"]["axes"][0].__setitem__(0, 9.0), "axes: expected 51 even steps"),
        ("grid", lambda d: d["universe"].update(limit=0.0), "universe: expected"),
        ("grid", lambda d: d["t_norm"].update(family="cauchy"), "family: got 'cauchy'"),
    ],
)
def test_a_damaged_file_is_refused(name, change, message, tmp_path) -> None:
    path = tmp_path / "est.json"
    MAKE[name]().save(path)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(FileFormatError, match=message):
        FuzzyRelationEstimator.load(path)
