"""Banks whose filters have states of their own, against filters that are padded and transformed by hand."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fuzzykf.errors import NotPositiveDefiniteError, NumericalRangeError, ParameterError, ShapeError
from fuzzykf.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter, StateMap
from fuzzykf.testing import check_filter

METHODS = ("imm", "gpb2")
M = np.array([[0.9, 0.1], [0.2, 0.8]])
MU = np.array([0.6, 0.4])
KEEP = ("x", "P", "x_prior", "P_prior", "mu", "log_likelihood")
ZS = np.array([0.1, 0.7, np.nan, 2.2, 3.9, 40.0, 6.1])

#: Position and velocity in the space of position, velocity and acceleration.
T = np.eye(3)[:, :2]


class Own(KalmanFilter):
    """A subclass, which goes through its own verbs in any bank."""


def accelerated(kind=KalmanFilter):
    F = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    f = kind(3, 1, x=[0.2, 0.5, 0.1], P=np.diag([2.0, 1.0, 0.5]), F=F, Q=0.1 * np.eye(3), R=0.5)
    return observing(f)


def steady(kind=KalmanFilter):
    f = kind(2, 1, x=[0.1, 0.4], P=[[2.0, 0.3], [0.3, 1.0]], F=[[1.0, 1.0], [0.0, 1.0]], R=1.0)
    f.Q = np.array([[0.03, 0.05], [0.05, 0.1]])
    return observing(f)


def padded(kind=KalmanFilter):
    """The steady filter with a third component that is zero and stays so."""
    small = steady()
    f = kind(3, 1, x=T @ small.x, P=T @ small.P @ T.T, F=T @ small.F @ T.T, Q=T @ small.Q @ T.T, R=small.R)
    return observing(f)


def observing(f):
    n = f.dim_x
    if isinstance(f, ExtendedKalmanFilter):
        f.hx, f.HJacobian = lambda x: x[:1], lambda x: np.eye(n)[:1]
    else:
        f.H = np.eye(n)[:1]
    f.B = np.eye(n)[:, 1:2]
    return f


def as_columns(*filters):
    for f in filters:
        f.x = np.reshape(f.x, (-1, 1))
    return list(filters)


def of_two_sizes(method, kind=KalmanFilter, flat=True):
    filters = [steady(kind), accelerated()]
    filters = filters if flat else as_columns(*filters)
    return IMMEstimator(filters, MU, M, method=method, state_maps=[T, None])


def of_one_size(method, flat=True):
    filters = [padded(), accelerated()]
    return IMMEstimator(filters if flat else as_columns(*filters), MU, M, method=method)


# ------------------------------------------------------------------ permuted and rescaled

#: Maps of a whole state: common x = A x.  The last one mixes all components.
WHOLE = {
    "permuted": np.eye(3)[[2, 0, 1]],
    "in other units": np.diag([100.0, 0.5, 2.0]),
    "another basis": np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [0.5, 0.0, 2.0]]),
}


def transformed(f, A):
    """The same filter for the state A^-1 x."""
    back = np.linalg.inv(A)
    g = KalmanFilter(3, 1, x=back @ f.x, F=back @ f.F @ A, H=f.H @ A, R=f.R)
    g.P, g.Q, g.B = back @ f.P @ back.T, back @ f.Q @ back.T, back @ f.B
    return g


def in_their_own_bases(method, A):
    filters = [transformed(padded(), A), transformed(accelerated(), A.T)]
    return IMMEstimator(filters, MU, M, method=method, state_maps=[A, StateMap(A.T)])


# ------------------------------------------------------------------ the table: banks with maps, and without

PAIRS = {
    "padded": (of_two_sizes, of_one_size),
    "padded, columns": (lambda m: of_two_sizes(m, flat=False), lambda m: of_one_size(m, flat=False)),
    "padded, own verbs": (lambda m: of_two_sizes(m, Own), of_one_size),
    "padded, extended": (lambda m: of_two_sizes(m, ExtendedKalmanFilter), of_one_size),
    **{name: (lambda m, A=A: in_their_own_bases(m, A), of_one_size) for name, A in WHOLE.items()},
}


def fields_of(rows):
    return {name: np.array([np.array(getattr(row, name)) for row in rows]) for name in KEEP}


def by_verbs(f, us=None):
    rows = []
    for k, z in enumerate(ZS):
        f.predict(*(() if us is None else (us[k],)))
        f.update(z)
        rows.append(f.copy())
    return fields_of(rows)


def by_steps(f):
    rows = []
    for z in ZS:
        f.step(z)
        rows.append(f.copy())
    return fields_of(rows)


def by_filter(f):
    result = f.filter(ZS)
    return {name: getattr(result, name) for name in KEEP}


def by_batch(f):
    return dict(zip(("x", "P", "x_prior", "P_prior"), f.batch_filter(ZS), strict=True))


def by_many(f):
    result = f.filter_many(np.stack([ZS[::-1], ZS]), keep=KEEP)
    return {name: getattr(result, name)[1] for name in KEEP}


WAYS = {
    "verbs": by_verbs,
    "verbs with controls": lambda f: by_verbs(f, np.linspace(-1.0, 1.0, 7).reshape(-1, *[1] * f.x.ndim)),
    "step": by_steps,
    "filter": by_filter,
    "batch_filter": by_batch,
    "filter_many": by_many,
    "two predictions": lambda f: (f.predict(), f.predict(), f.update(0.3), fields_of([f]))[-1],
    "update alone": lambda f: (f.update(0.3), fields_of([f]))[-1],
    "forecast": lambda f: {name: getattr(f.forecast(3), name) for name in ("x", "P", "mu", "z_prior", "S")},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pair", PAIRS)
def test_a_bank_with_maps_is_the_bank_in_the_common_space(pair, method, way) -> None:
    f, plain = (make(method) for make in PAIRS[pair])
    np.testing.assert_allclose(f.x, plain.x, atol=1e-13)
    np.testing.assert_allclose(f.P, plain.P, atol=1e-13)
    got, expected = WAYS[way](f), WAYS[way](plain)
    for name, value in expected.items():
        scale = np.abs(value).max()
        np.testing.assert_allclose(got[name], value, rtol=1e-9, atol=1e-11 * scale, err_msg=name)
        assert got[name].shape == value.shape


@pytest.mark.parametrize("method", METHODS)
def test_members_stay_in_their_own_spaces(method) -> None:
    f, plain = of_two_sizes(method), of_one_size(method)
    for z in ZS:
        f.step(z)
        plain.step(z)
    small, large = f.filters
    assert f.dim_x == 3
    for name in ("x", "x_prior", "x_post"):
        np.testing.assert_allclose(getattr(small, name), getattr(plain.filters[0], name)[:2], rtol=1e-9)
        np.testing.assert_allclose(getattr(large, name), getattr(plain.filters[1], name), rtol=1e-9)
    for name in ("P", "P_prior", "P_post"):
        np.testing.assert_allclose(getattr(small, name), getattr(plain.filters[0], name)[:2, :2], rtol=1e-9)
    for name in ("y", "S", "K"):
        np.testing.assert_allclose(getattr(small, name), getattr(plain.filters[0], name)[:2], rtol=1e-9)


# ------------------------------------------------------------------ what a filter lacks


def test_what_is_said_of_missing_components_counts() -> None:
    # one step by hand, in the common space, with the textbook's equations
    mean, covariance = np.array([0.0, 0.0, 0.3]), np.diag([0.0, 0.0, 4.0])
    filters = [steady(), accelerated()]
    xs = [np.append(filters[0].x, 0.3), filters[1].x]
    Ps = [T @ filters[0].P @ T.T + covariance, filters[1].P]
    f = IMMEstimator(filters, MU, M, state_maps=[StateMap(T, mean=mean, covariance=covariance), None])
    x = MU @ xs
    np.testing.assert_allclose(f.x, x)
    np.testing.assert_allclose(
        f.P, sum(w * (P + np.outer(a - x, a - x)) for w, a, P in zip(MU, xs, Ps, strict=True))
    )
    cbar, weights = MU @ M, MU[:, None] * M / (MU @ M)
    moved = []
    for j, back in enumerate((T.T, np.eye(3))):
        w = weights[:, j]
        start = w @ xs
        P = sum(v * (V + np.outer(a - start, a - start)) for v, a, V in zip(w, xs, Ps, strict=True))
        F, Q = (steady(), accelerated())[j].F, (steady(), accelerated())[j].Q
        moved.append((F @ back @ start, F @ back @ P @ back.T @ F.T + Q))
    f.predict()
    for (x_j, P_j), one in zip(moved, filters, strict=True):
        np.testing.assert_allclose(one.x, x_j)
        np.testing.assert_allclose(one.P, P_j)
    ends = [np.append(moved[0][0], 0.3), moved[1][0]]
    covariances = [T @ moved[0][1] @ T.T + covariance, moved[1][1]]
    x = cbar @ ends
    np.testing.assert_allclose(f.x_prior, x)
    np.testing.assert_allclose(
        f.P_prior,
        sum(w * (P + np.outer(a - x, a - x)) for w, a, P in zip(cbar, ends, covariances, strict=True)),
    )


@pytest.mark.parametrize("method", METHODS)
def test_without_transitions_a_filter_does_not_notice_the_others(method) -> None:
    # to the common space and back leaves an estimate as it was, whatever is said of missing components
    A = np.array([[1.0, 0.3], [0.2, 2.0], [0.5, -1.0]])
    beyond = np.linalg.svd(A)[0][:, 2]
    place = StateMap(A, mean=2.0 * beyond, covariance=5.0 * np.outer(beyond, beyond))
    filters, alone = [steady(), accelerated()], [steady(), accelerated()]
    f = IMMEstimator(filters, MU, np.eye(2), method=method, state_maps=[place, None])
    for z in ZS:
        f.step(z)
        for one in alone:
            one.step(z)
    for one, other in zip(filters, alone, strict=True):
        np.testing.assert_allclose(one.x, other.x, rtol=1e-10)
        np.testing.assert_allclose(one.P, other.P, rtol=1e-10)


# ------------------------------------------------------------------ objects


@pytest.mark.parametrize(("method", "flat"), [("imm", True), ("gpb2", False)])
def test_it_is_a_filter_like_any_other(method, flat) -> None:
    zs = 0.5 * np.sin(1.3 * np.arange(6))  # as few as will do
    check_filter(lambda: of_two_sizes(method, flat=flat), zs)


@pytest.mark.parametrize("method", METHODS)
def test_copies_files_and_resets_keep_the_maps(method, tmp_path) -> None:
    f = of_two_sizes(method)
    first = f.filter(ZS)
    f.predict()
    (tmp_path / "bank").write_bytes(pickle.dumps(f))
    for other in (f.copy(), pickle.loads((tmp_path / "bank").read_bytes())):
        one = f.copy()
        one.update(0.5)
        other.update(0.5)
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(other.state_maps[0].matrix, T)
    f.reset()
    np.testing.assert_array_equal(f.filter(ZS).x, first.x)
    assert "\nstate_maps = (StateMap(" in repr(f)
    assert "state_maps" not in repr(of_one_size(method))


def test_maps_are_told_and_do_not_change() -> None:
    place = StateMap(T)
    f = IMMEstimator([steady(), accelerated()], MU, M, state_maps=[place, None])
    assert f.state_maps == (place, None)
    assert of_one_size("imm").state_maps is None
    with pytest.raises(AttributeError):
        f.state_maps = None
    with pytest.raises(AttributeError, match="never changes"):
        place.matrix = np.eye(3)
    with pytest.raises(ValueError, match="read-only"):
        place.matrix[0, 0] = 2.0


# ------------------------------------------------------------------ inadmissible

OF_BANKS = {
    "no list": (3, ParameterError, "state_maps: got 3, expected a list"),
    "a text": ("ab", ParameterError, "state_maps: got 'ab', expected a list"),
    "a number": (np.array(1.0), ParameterError, "state_maps: got .*expected a list"),
    "too few": ([T], ParameterError, "state_maps: got 1, expected one for each of the 2 filters"),
    "none at all": (
        [None, None],
        ShapeError,
        r"state_maps\[0\]: got None for a filter of 2 states, .*\(3, 2\)",
    ),
    "too many columns": (
        [np.eye(3), None],
        ShapeError,
        r"state_maps\[0\]: .*shape \(3, 3\), expected \(3, 2\)",
    ),
    "lying": (
        [T.T, None],
        ShapeError,
        r"state_maps\[0\]: matrix: got shape \(2, 3\), .*no more columns than",
    ),
    "flat": ([[1.0, 0.0], None], ShapeError, r"state_maps\[0\]: matrix: got shape \(2,\)"),
    "words": ([[["a", "b"]], None], ShapeError, r"state_maps\[0\]: matrix: expected an array of numbers"),
    "not finite": ([np.nan * T, None], ParameterError, r"state_maps\[0\]: matrix: entry \(0, 0\) is nan"),
    "of rank one": (
        [np.ones((3, 2)), None],
        ParameterError,
        r"state_maps\[0\]: .*rank 1, expected full column rank, 2",
    ),
    "rows differ": (
        [T, np.eye(4)[:, :3]],
        ShapeError,
        r"state_maps\[0\]: .*shape \(3, 2\), expected \(4, 2\)",
    ),
}


@pytest.mark.parametrize("case", OF_BANKS)
def test_the_bank_names_the_member_and_what_is_admissible(case) -> None:
    maps, error, message = OF_BANKS[case]
    with pytest.raises(error, match=message):
        IMMEstimator([steady(), accelerated()], MU, M, state_maps=maps)


def test_filters_of_unequal_size_are_told_of_maps() -> None:
    with pytest.raises(ShapeError, match=r"x has shapes \[\(2,\), \(3,\)\], expected .*state_maps"):
        IMMEstimator([steady(), accelerated()], MU, M)
    with pytest.raises(
        ShapeError, match=r"x has shapes \[\(2, 1\), \(3,\)\], expected all flat or all columns"
    ):
        IMMEstimator([*as_columns(steady()), accelerated()], MU, M, state_maps=[T, None])


OF_MAPS = {
    "mean of another size": ({"mean": [0.0, 1.0]}, ShapeError, r"mean: got shape \(2,\), expected \(3,\)"),
    "what is known": ({"mean": [0.0, 1.0, 1.0]}, ParameterError, "mean: .*what the filter lacks alone"),
    "covariance of another size": ({"covariance": np.eye(2)}, ShapeError, r"covariance: got shape \(2, 2\)"),
    "covariance of what is known": ({"covariance": np.eye(3)}, ParameterError, "covariance: .*lacks alone"),
    "indefinite": ({"covariance": -np.diag([0, 0, 1.0])}, NotPositiveDefiniteError, "covariance: "),
    "asymmetric": (
        {"covariance": np.eye(3)[[0, 2, 1]] * [0, 0, 1]},
        ParameterError,
        "covariance: .*symmetric",
    ),
}


@pytest.mark.parametrize("case", OF_MAPS)
def test_a_map_names_what_is_wrong(case) -> None:
    arguments, error, message = OF_MAPS[case]
    with pytest.raises(error, match=message):
        StateMap(T, **arguments)


@pytest.mark.parametrize("verb", ["to_common", "to_member"])
def test_estimates_of_another_size_are_refused(verb) -> None:
    with pytest.raises(ShapeError, match=r"x: got shape \(4,\)"):
        getattr(StateMap(T), verb)(np.ones(4), np.eye(4))


@pytest.mark.parametrize("method", METHODS)
def test_a_refused_verb_leaves_the_bank_as_it_was(method) -> None:
    def held(f):
        return pickle.dumps([{**vars(one), "filters": None, "_origin": None} for one in (f, *f.filters)])

    f = of_two_sizes(method)
    f.step(0.3)
    f.filters[0].R = np.array([[-1e3]])
    before = held(f)
    for call in (lambda: f.step(0.4), lambda: f.filter(ZS), lambda: f.filter_many([ZS])):
        with pytest.raises(NotPositiveDefiniteError):
            call()
        assert held(f) == before
    f = of_two_sizes(method)
    f.filters[0].x = np.zeros(5)
    with pytest.raises(ShapeError, match=r"filters\[0\].x: got shape \(5,\), expected \(2, 1\) or \(2,\)"):
        f.predict()
    f = of_two_sizes(method)
    f.filters[0].P = np.eye(3)
    with pytest.raises(ShapeError, match=r"filters\[0\].P: got shape \(3, 3\), expected \(2, 2\)"):
        f.predict()
    f = of_two_sizes(method)
    f.filters[1].P = 1e200 * np.eye(3)
    f.filters[1].F = 1e200 * f.filters[1].F
    with pytest.raises(NumericalRangeError):
        f.predict()
