"""The gradient of the log-likelihood of IMM is that of the filter, by differences, entry by entry."""

from __future__ import annotations

import numpy as np
import pytest

from fuzzykf.engine.numpy.nodes import NodeSpace, filter_nodes, pack_nodes
from fuzzykf.engine.numpy.nodes_gradient import node_gradient
from fuzzykf.engine.numpy.tables import LOG_ZERO

NAN = np.nan
LAW = ("transition", "probability", "mean", "covariance")
SYMMETRIC = ("Q", "R", "covariance")
KINDS = ("plain", "gaps", "sparse", "outlier", "certain", "controls", "steps")
CASES = [((1, 2, 1), "gaps"), *(((3, 2, 2), kind) for kind in KINDS)]
CASES += [((7, 1, 1), "plain"), ((7, 3, 2), "gaps"), ((7, 2, 1), "sparse"), ((4, 1, 2), "outlier")]


def definite(rng, *shape):
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ root.mT + 0.3 * np.eye(shape[-1])


def model_of(rng, size, steps=None):
    """Everything a log-likelihood depends on, by name; parameters that vary have an axis of steps."""
    M, m, q = size
    lead = {name: (1, (steps or {}).get(name, 1), M) for name in NodeSpace._fields}
    shapes = {"F": (m, m), "b": (m,), "H": (q, m), "d": (q,)}
    model = {name: rng.normal(size=(*lead[name], *shape)) for name, shape in shapes.items()}
    model |= {"Q": definite(rng, *lead["Q"], m), "R": definite(rng, *lead["R"], q)}
    model["F"] *= 0.9 / np.linalg.norm(model["F"], 2, axis=(-2, -1), keepdims=True)
    law = (
        rng.dirichlet(np.ones(M), M),
        rng.dirichlet(np.ones(M)),
        rng.normal(size=(M, m)),
        definite(rng, M, m),
    )
    return model | dict(zip(LAW, law, strict=True))


def sparse(model):
    """A chain whose first node is never entered again, and which cannot begin in the second."""
    T, p = np.triu(model["transition"]), model["probability"].copy()
    T[0, 0], p[1] = 0.0, 0.0
    return model | {"transition": T / T.sum(axis=1, keepdims=True), "probability": p / p.sum()}


def log(p):
    with np.errstate(divide="ignore"):
        return np.log(p)


def parts(model):
    """The arguments of the kernels: a kernel, and tables of the first law (s, 1 + m + m*m, M)."""
    p, mean, covariance = (model[name] for name in LAW[1:])
    p, mean = p[None] if p.ndim == 1 else p, mean[None] if mean.ndim == 2 else mean
    covariance = covariance[None] if covariance.ndim == 3 else covariance
    s, M, m = max(len(p), len(mean), len(covariance)), *mean.shape[1:]
    rows = np.maximum(log(p), LOG_ZERO)[:, None], mean.mT, covariance.reshape(-1, M, m * m).mT
    table = np.concatenate([np.broadcast_to(one, (s, *one.shape[1:])) for one in rows], axis=1)
    space = NodeSpace(*(model[name] for name in NodeSpace._fields))
    return pack_nodes(space, log(model["transition"])), table


def switch(M):
    """The arguments of the most likely value of a switch, which nobody asks for here."""
    return np.arange(M) * 1.0, np.ones(M), np.ones(M, dtype=bool), np.array([np.arange(M), np.full(M, 2)])


def last_state(kernel, table, ys):
    return filter_nodes(kernel, False, table, True, ys[None], {}, switch(table.shape[-1]))[1][0]


def gradient_of(model, ys):
    """The gradient by name, without the axis of series."""
    kernel, table = parts(model)
    found = node_gradient(kernel, table[0], ys)
    law = {name: getattr(found, name) for name in LAW}
    return found.log_likelihood, found.space._asdict() | law


def log_likelihoods(model, ys, s):
    """Of several series, which may have parameters of their own."""
    kernel, table = parts(model)
    out = {"log_likelihood": np.empty((s, len(ys)))}
    table, ys = np.broadcast_to(table, (s, *table.shape[1:])), np.broadcast_to(ys, (s, *ys.shape))
    filter_nodes(kernel, False, table, True, ys, out, switch(table.shape[-1]))
    return out["log_likelihood"].sum(axis=1)


def differences(model, ys, name, changes):
    """Derivatives along changes (s, ...) of a parameter, by extrapolated differences."""

    def of(h):
        ends = []
        for step in (h, -h):
            new = model[name] + step * (changes[:, 0] if name in NodeSpace._fields else changes)
            if name == "transition":  # series share it
                ends.append(np.array([log_likelihoods(model | {name: one}, ys, 1)[0] for one in new]))
            else:
                ends.append(log_likelihoods(model | {name: new}, ys, len(new)))
        return (ends[0] - ends[1]) / (2.0 * h)

    return (4.0 * of(1e-4) - of(2e-4)) / 3.0


def changes_of(name, value):
    """Of each entry by itself, or, of transitions, of all in several random proportions."""
    if name == "transition":
        return np.random.default_rng(1).normal(size=(6, *value.shape)) * value
    changes = np.zeros((value.size, *value.shape))
    changes.reshape(value.size, -1)[range(value.size), range(value.size)] = 1.0
    if name == "probability":
        return changes * value
    return 0.5 * (changes + changes.mT) if name in SYMMETRIC else changes


def assert_is_the_slope(model, ys):
    total, gradient = gradient_of(model, ys)
    assert total == pytest.approx(log_likelihoods(model, ys, 1)[0], rel=1e-13)
    for name, by in gradient.items():
        assert by.shape == model[name].shape
        if name in SYMMETRIC:
            np.testing.assert_array_equal(by, by.mT)
        changes = changes_of(name, model[name])
        expected = differences(model, ys, name, changes)
        found = (changes * by).sum(axis=tuple(range(1, changes.ndim)))
        rounding = 1e-11 * abs(total)  # of the log-likelihood, divided by the step
        atol = 1e-8 * (1.0 + np.abs(expected).max()) + rounding
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=atol, err_msg=name)


@pytest.mark.parametrize(("size", "kind"), CASES)
def test_a_gradient_is_the_limit_of_differences(size, kind) -> None:
    M, m, q = size
    rng, n = np.random.default_rng(100 * M + 10 * m + q), 4 if kind == "steps" else 7
    steps = {"controls": dict.fromkeys("bd", n), "steps": dict.fromkeys("FbQHdR", n)}.get(kind)
    model, ys = model_of(rng, size, steps), 2.0 * rng.normal(size=(n, q))
    if kind == "gaps":
        ys[rng.random(ys.shape) < 0.4] = ys[0, 0] = ys[5] = NAN
    elif kind == "sparse":
        model = sparse(model)
    elif kind == "outlier":
        ys[3] = 1e3
    elif kind == "certain":  # noise of rank one, and a state that is known where the series begins
        model["Q"] = np.ones_like(model["Q"])
        model["covariance"] = np.zeros_like(model["covariance"])
    assert_is_the_slope(model, ys)


@pytest.mark.parametrize("n", [1, 2, 6])
def test_parameters_of_each_step_sum_to_those_that_are_shared(n) -> None:
    rng = np.random.default_rng(1)
    model, ys = model_of(rng, (3, 2, 2)), rng.normal(size=(n, 2))
    ys[2:3, 1] = ys[4:5] = NAN
    spread = {name: np.repeat(model[name], n, axis=1) for name in NodeSpace._fields}
    for names in ("FbQHdR", "bd"):
        value, shared = gradient_of(model, ys)
        total, each = gradient_of(model | {name: spread[name] for name in names}, ys)
        assert total == pytest.approx(value, rel=1e-14)
        for name, by in each.items():
            by = by.sum(axis=1, keepdims=True) if name in names else by
            np.testing.assert_allclose(by, shared[name], rtol=1e-12, atol=1e-13, err_msg=name)
    assert not each["d"][0, 4:5].any()
    assert not each["d"][0, 2:3, :, 1].any()
    assert not each["b"][0, 0].any()  # nothing moves to the first observation


def test_what_is_never_seen_has_no_slope() -> None:
    rng = np.random.default_rng(2)
    model, ys = model_of(rng, (3, 2, 2)), rng.normal(size=(5, 2))
    ys[:, 1] = NAN
    _, gradient = gradient_of(model, ys)
    assert not gradient["H"][..., 1, :].any()
    assert not gradient["d"][..., 1].any()
    assert not gradient["R"][..., 1, :].any()
    assert gradient["H"][..., 0, :].all()
    total, gradient = gradient_of(model, np.full((5, 2), NAN))
    assert total == 0.0
    assert not any(by.any() for by in gradient.values())


def test_what_cannot_be_has_no_slope() -> None:
    # its parameters have no bearing on anything, even where an observation of it has no density
    rng = np.random.default_rng(3)
    model, ys = sparse(model_of(rng, (4, 2, 1))), rng.normal(size=(6, 1))
    model["transition"][:, 3], model["probability"][3] = 0.0, 0.0
    model["H"][..., 3, :, :] = model["R"][..., 3, :, :] = 0.0
    _, gradient = gradient_of(model, ys)
    for name in ("transition", "probability"):
        np.testing.assert_array_equal(gradient[name][model[name] == 0.0], 0.0)
    for name in NodeSpace._fields:
        assert not gradient[name][0, 0, 3].any()
    for name in "FbQ":  # it may be the first node, which none leads to
        assert not gradient[name][0, 0, 0].any()
    for name in ("H", "d", "R"):
        assert gradient[name][0, 0, 0].any()
    assert not gradient["mean"][[1, 3]].any()
    assert not gradient["covariance"][[1, 3]].any()
    assert all(np.isfinite(by).all() for by in gradient.values())


@pytest.mark.parametrize("far", [1e6, 1e12, 1e50])
def test_outliers_have_a_finite_slope(far) -> None:
    # a log-likelihood of about -far^2 / (2 S), whose variance S comes from Q and R
    rng = np.random.default_rng(4)
    model, ys = model_of(rng, (3, 2, 2)), rng.normal(size=(6, 2))
    ys[3, 0] = -far
    _, gradient = gradient_of(model, ys)
    assert all(np.isfinite(by).all() for by in gradient.values())
    for name, value in (("Q", model["Q"]), ("R", model["R"])):
        h = 1e-4
        ends = [log_likelihoods(model | {name: value * (1.0 + step)}, ys, 1)[0] for step in (h, -h)]
        slope = (ends[0] - ends[1]) / (2.0 * h)
        assert (gradient[name] * value).sum() == pytest.approx(slope, rel=1e-6)


def test_weights_far_below_the_range_of_numbers_have_their_slope() -> None:
    # the likely node leads nowhere else, and is refuted in the end: all there is then is what the others
    # held, which had been far below exp(-745)
    rng = np.random.default_rng(5)
    model, ys = model_of(rng, (3, 1, 1)), np.zeros((7, 1))
    model["transition"] = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.4, 0.6]])
    for name, value in {"H": 0.1, "Q": 1.0, "R": 1.0}.items():
        model[name][:] = value
    model["d"][..., 0] = [0.0, 60.0, 61.0]
    ys[3:] = 60.0
    kernel, table = parts(model)
    assert last_state(kernel, table, ys[:3])[0, 1:].max() < -3000.0
    total, gradient = gradient_of(model, ys)
    expected = differences(model, ys, "d", changes_of("d", model["d"]))
    np.testing.assert_allclose(gradient["d"].ravel(), expected, rtol=1e-6, atol=1e-10 * abs(total))
    assert np.abs(gradient["d"][0, 0, 1:]).min() > 1.0
    changes = changes_of("transition", model["transition"])
    found = (gradient["transition"] * changes).sum(axis=(1, 2))
    np.testing.assert_allclose(found, differences(model, ys, "transition", changes), rtol=1e-6, atol=1e-6)


def test_a_series_that_nothing_explains_has_no_gradient() -> None:
    model, ys = model_of(np.random.default_rng(6), (2, 1, 1)), np.array([[0.0], [1e200], [0.0]])
    total, gradient = gradient_of(model, ys)
    assert np.isnan(total)
    for name, by in gradient.items():
        assert by.shape == model[name].shape
        assert np.isnan(by).all()


def test_singular_covariances_are_refused() -> None:
    model = model_of(np.random.default_rng(7), (3, 2, 2))
    model["R"][0, 0, 1] = model["H"][0, 0, 1] = 1.0  # of rank one
    with pytest.raises(np.linalg.LinAlgError):
        gradient_of(model, np.zeros((2, 2)))


def test_arguments_that_do_not_fit_are_refused() -> None:
    rng = np.random.default_rng(8)
    kernel, table = parts(model_of(rng, (3, 2, 2)))
    for bad in (np.zeros((4, 1)), np.zeros(4), np.zeros((0, 2))):
        with pytest.raises(ValueError, match=r"ys: got shape .* expected \(n, 2\)"):
            node_gradient(kernel, table[0], bad)
    with pytest.raises(ValueError, match=r"table: got shape \(1, 7, 3\), expected \(7, 3\)"):
        node_gradient(kernel, table, np.zeros((4, 2)))
    kernel, _ = parts(model_of(rng, (3, 2, 2), {"b": 5}))
    with pytest.raises(ValueError, match=r"b: got parameters of \(1, 5\) series and steps"):
        node_gradient(kernel, table[0], np.zeros((4, 2)))
    series = {name: np.repeat(value, 2, axis=0) for name, value in kernel.space._asdict().items()}
    with pytest.raises(ValueError, match=r"F: got parameters of \(2, 1\) series and steps"):
        node_gradient(pack_nodes(NodeSpace(**series), np.zeros((3, 3))), table[0], np.zeros((5, 2)))
