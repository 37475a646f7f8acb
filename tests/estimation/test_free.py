"""What is free of which parameters: numbers lead to them and back, stay admissible, and have exact slopes."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, ParameterError, ShapeError
from fuzzykf.estimation.free import read_free

DENSE = np.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.5]])
BLOCKS = np.array([[2.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 0.5]])
VALUES = {
    "Q": DENSE,
    "R": BLOCKS,
    "S": np.stack([DENSE, BLOCKS]),  # two classes
    "F": np.array([[0.9, 0.2], [0.0, 4.0]]),
    "G": np.arange(8.0).reshape(2, 2, 2),
    "b": np.array([1.0, -2.0]),
    "c": np.array([[1.0, -2.0], [0.0, 5.0]]),
}
KINDS = {"covariances": ("Q", "R", "S"), "vectors": ("b", "c")}
PAIR = np.array([[True, True, False], [True, True, False], [False, False, False]])
LAST = np.diag([False, False, True])
SINGULAR = np.array([[0.25, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 0.0]])

#: What is free, and the names of the numbers.
ADMISSIBLE = {
    "a full covariance": (
        {"Q": "full"},
        ["Q[0, 0]", "Q[1, 0]", "Q[1, 1]", "Q[2, 0]", "Q[2, 1]", "Q[2, 2]"],
    ),
    "a factor": ({"Q": ("scale", DENSE)}, ["Q"]),
    "a factor of what is singular": ({"R": ("scale", SINGULAR)}, ["R"]),
    "a pair of components": ({"R": PAIR}, ["R[0, 0]", "R[1, 0]", "R[1, 1]"]),
    "a variance": ({"R": LAST}, ["R[2, 2]"]),
    "a mask as a list": ({"R": LAST.tolist()}, ["R[2, 2]"]),
    "a variance of one class": ({"S": np.stack([LAST & False, LAST])}, ["S[1][2, 2]"]),
    "factors of classes": ({"S": ("scale", DENSE)}, ["S[0]", "S[1]"]),
    "factors of covariances of classes": ({"S": ("scale", VALUES["S"])}, ["S[0]", "S[1]"]),
    "a matrix": ({"F": "full"}, ["F[0, 0]", "F[0, 1]", "F[1, 0]", "F[1, 1]"]),
    "an entry": ({"F": [[False, True], [False, False]]}, ["F[0, 1]"]),
    "an entry of each class": ({"G": [[False, True], [False, False]]}, ["G[0][0, 1]", "G[1][0, 1]"]),
    "a vector": ({"b": "full"}, ["b[0]", "b[1]"]),
    "a component of each class": ({"c": [True, False]}, ["c[0][0]", "c[1][0]"]),
    "several": ({"F": np.eye(2, dtype=bool), "Q": ("scale", DENSE)}, ["F[0, 0]", "F[1, 1]", "Q"]),
}


def admissible(name):
    free, names = ADMISSIBLE[name]
    return read_free(free, VALUES, **KINDS), names


@pytest.mark.parametrize("name", ADMISSIBLE)
def test_numbers_begin_at_what_is_held_and_have_names(name) -> None:
    free, names = admissible(name)
    assert list(free.names) == names
    assert free.start.shape == free.spread.shape == free.is_variance.shape == (len(names),)
    for key, value in free.values(free.start).items():
        if "factor" not in name and key != "Q":
            np.testing.assert_allclose(value, VALUES[key], rtol=1e-14, atol=1e-15)
    for one, value in zip(names, free.estimates(free.start), strict=True):  # "S[1][2, 2]" is an entry
        where = [int(k) for k in one[1:].replace("][", ", ").strip("[]").split(", ") if k]
        array = free.values(free.start)[one[0]]
        if len(where) == array.ndim:
            assert value == pytest.approx(array[tuple(where)], rel=1e-14)


@pytest.mark.parametrize("name", ADMISSIBLE)
def test_any_numbers_are_admissible_and_what_is_held_stays(name) -> None:
    free, _ = admissible(name)
    rng = np.random.default_rng(0)
    for _ in range(20):
        numbers = free.start + 3.0 * free.spread * rng.standard_normal(len(free.names))
        for key, value in free.values(numbers).items():
            assert value.shape == VALUES[key].shape
            if key in KINDS["covariances"]:
                eigenvalues = np.linalg.eigvalsh(value)
                assert (eigenvalues >= -1e-13 * eigenvalues.max()).all()
                np.testing.assert_array_equal(value, np.swapaxes(value, -1, -2))
    if name == "a pair of components":
        np.testing.assert_array_equal(free.values(numbers)["R"][2], BLOCKS[2])
    if name == "an entry":
        np.testing.assert_array_equal(free.values(numbers)["F"][[0, 1, 1], [0, 0, 1]], [0.9, 0.0, 4.0])


@pytest.mark.parametrize("name", ADMISSIBLE)
def test_slopes_are_those_of_differences(name) -> None:
    free, _ = admissible(name)
    rng = np.random.default_rng(1)
    numbers = free.start + 0.3 * free.spread * rng.standard_normal(len(free.names))
    by_values = {}
    for key, value in free.values(numbers).items():  # of the sum of G times the parameter
        G = rng.standard_normal(value.shape)
        by_values[key] = G + np.swapaxes(G, -1, -2) if key in KINDS["covariances"] else G

    def total(point):
        return sum((by_values[key] * value).sum() for key, value in free.values(point).items())

    gradient, jacobian = free.gradient(numbers, by_values), free.jacobian(numbers)
    for k, size in enumerate(free.spread):
        step = np.zeros(len(numbers))
        step[k] = 1e-5 * size
        slope = (total(numbers + step) - total(numbers - step)) / (2.0 * step[k])
        assert gradient[k] == pytest.approx(slope, rel=1e-7, abs=1e-8)
        slopes = (free.estimates(numbers + step) - free.estimates(numbers - step)) / (2.0 * step[k])
        np.testing.assert_allclose(jacobian[:, k], slopes, rtol=1e-7, atol=1e-8)


def test_a_variance_at_minus_infinity_is_zero() -> None:
    free = read_free({"R": LAST, "Q": "full"}, VALUES, **KINDS)
    numbers = free.start.copy()
    numbers[[0, -1]] = -np.inf  # R[2, 2], and what is left of Q[2, 2] given the others
    values = free.values(numbers)
    assert values["R"][2, 2] == 0.0
    assert abs(np.linalg.eigvalsh(values["Q"])[0]) < 1e-14
    slopes = free.gradient(numbers, {"R": np.ones((3, 3)), "Q": np.ones((3, 3))})
    assert slopes[0] == slopes[-1] == 0.0
    assert np.isfinite(slopes).all()


def test_a_factor_begins_at_the_likeliest() -> None:
    # of second moments S and the covariance s M, s = tr(M^+ S) / rank M
    free = read_free({"Q": ("scale", SINGULAR)}, VALUES, **KINDS)
    expected = np.trace(np.linalg.pinv(SINGULAR) @ DENSE)
    np.testing.assert_allclose(free.estimates(free.start), [expected], rtol=1e-12)


def test_starts_are_drawn_around_what_is_held() -> None:
    free = read_free({"Q": "full", "F": "full"}, VALUES, **KINDS)
    drawn = np.array([free.draw(np.random.default_rng(seed)) for seed in range(400)])
    z = (drawn - free.start) / free.spread
    assert np.abs(z.mean(axis=0)).max() < 0.25  # five standard errors
    assert np.abs(z.std(axis=0) - 1.0).max() < 0.2


CHAIN = np.array([[True, True, False], [True, True, True], [False, True, True]])
ZERO = np.diag([1.0, 0.0])

#: What is refused: free, the error, and what its message has to name.
REFUSED = [
    (None, ParameterError, ["free", "None", "Q, R, S, F"]),
    ({}, ParameterError, ["free", "{}"]),
    ("Q", ParameterError, ["free", "'Q'"]),
    ({"K": "full"}, ParameterError, ["free", "'K'", "Q, R, S, F"]),
    ({"Q": "ful"}, ShapeError, ["free['Q']", "'ful'", "'full', 'diagonal', ('scale', M)", "(3, 3)"]),
    ({"Q": None}, ShapeError, ["free['Q']", "None"]),
    ({"Q": True}, ShapeError, ["free['Q']", "True"]),
    ({"Q": np.ones((3, 3))}, ShapeError, ["free['Q']", "bool"]),
    ({"Q": np.ones((2, 2), dtype=bool)}, ShapeError, ["free['Q']", "(3, 3)"]),
    ({"Q": [[True], [True, False]]}, ShapeError, ["free['Q']"]),
    ({"S": np.ones((3, 3, 3), dtype=bool)}, ShapeError, ["free['S']", "(2, 3, 3) or (3, 3)"]),
    ({"F": "diagonal"}, ShapeError, ["free['F']", "'diagonal'", "'full' or an array of bool"]),
    ({"F": ("scale", np.eye(2))}, ShapeError, ["free['F']"]),
    ({"b": np.zeros(2, dtype=bool)}, ParameterError, ["free['b']", "nothing is free"]),
    ({"Q": "diagonal"}, ParameterError, ["free['Q']", "'diagonal'", "Q[0, 1] is held at 0.6"]),
    ({"Q": PAIR}, ParameterError, ["free['Q']", "Q[0, 2] is held at -0.3"]),
    ({"S": "diagonal"}, ParameterError, ["free['S']", "S[0][0, 1] is held at 0.6"]),
    ({"R": CHAIN}, ParameterError, ["free['R']", "R[0, 2] is held between"]),
    ({"R": np.triu(PAIR)}, ParameterError, ["free['R']", "R[0, 1]", "beyond the diagonal"]),
    ({"R": PAIR & ~np.eye(3, dtype=bool)}, ParameterError, ["free['R']", "R[0, 1]", "variances beside it"]),
    ({"Q": ("scale", np.eye(2))}, ShapeError, ["free['Q']", "(2, 2)", "(3, 3)"]),
    ({"Q": ("scale", -np.eye(3))}, NotPositiveDefiniteError, ["free['Q']", "-1"]),
    ({"Q": ("scale", np.zeros((3, 3)))}, ParameterError, ["free['Q']", "zeros"]),
    ({"Q": ("scaled", np.eye(3))}, ShapeError, ["free['Q']", "'scale'"]),
]


@pytest.mark.parametrize(("free", "error", "named"), REFUSED)
def test_what_cannot_be_free_is_refused(free, error, named) -> None:
    with pytest.raises(error) as caught:
        read_free(free, VALUES, **KINDS)
    for word in named:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("what", "held"),
    [("diagonal", ZERO), ("full", ZERO), ("full", SINGULAR[:2, :2]), (("scale", ZERO[::-1, ::-1]), ZERO)],
)
def test_a_start_of_variance_zero_is_refused(what, held) -> None:
    with pytest.raises(NotPositiveDefiniteError, match=r"free\['Q'\].* Q") as caught:
        read_free({"Q": what}, {"Q": held}, covariances=["Q"])
    assert "start" in str(caught.value)
