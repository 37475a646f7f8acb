"""Laws against numerical integrals and the closed forms of the theory, and sampling against the law."""

from __future__ import annotations

import copy
import itertools
import pickle

import numpy as np
import pytest
import scipy.stats

from fuzzykf import FuzzyMarkovLaw
from fuzzykf.errors import ParameterError, ShapeError

FMC1 = FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)
FMC2 = FuzzyMarkovLaw.fmc2(alpha=0.12, gamma=0.5, delta=0.17)


def ramp(r1, r2):
    return 0.2 + 0.1 * (r1 + r2)


#: Corners and edges independent of the interior, p not a function of |r1 - r2|.
RAMP = FuzzyMarkovLaw.from_density(
    [[0.1, 0.05], [0.05, 0.15]], (lambda r: 0.05 + 0.1 * r, 0.075), ramp, kinks=()
)
LAWS = {"fmc1": FMC1, "fmc2": FMC2, "ramp": RAMP}


@pytest.fixture(params=LAWS)
def law(request):
    return LAWS[request.param]


#: Between their jumps the densities are polynomials of degree one, their integrals of degree two: the rule of
#: Gauss and Legendre is exact there.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)


def integral(f, low=0.0, high=1.0, jumps=()):
    """Integral of a function of arrays over ]low, high[, piece by piece between its jumps."""
    ends = [low, *sorted(p for p in jumps if low < p < high), high]
    pieces = ((0.5 * (a + b), 0.5 * (b - a)) for a, b in itertools.pairwise(ends))
    return sum(half * WEIGHTS @ f(middle + half * NODES) for middle, half in pieces)


def inner(law, r):
    """Integral of p(r, s) over s in ]0, 1[, with the jumps named."""
    return integral(lambda s: law.joint_density(r, s), jumps=(r - 0.17, r, r + 0.17))


# --------------------------------------------------------------------------- densities


def test_fmc1_density_by_definition():
    beta = (1 - 5 / 2 * (0.05 + 0.16) + (0.05 - 0.16) / 6) / 2 - 0.07
    assert FMC1.beta == pytest.approx(beta, rel=1e-14)
    assert FMC1.p_hard == pytest.approx(2 * (0.07 + beta) + 0.05 + 0.16, rel=1e-14)
    r1, r2 = np.array([0, 1, 0, 1, 0, 0.3, 1, 0.9, 0.3]), np.array([0, 1, 1, 0, 0.2, 0, 0.2, 1, 0.8])
    expected = [0.07, 0.07, beta, beta, *(0.16 - 0.11 * np.array([0.2, 0.3, 0.8, 0.1, 0.5]))]
    np.testing.assert_allclose(FMC1.joint_density(r1, r2), expected, rtol=1e-14)


def test_fmc2_density_by_definition():
    beta = (1 - 0.5 * 0.17 * (6 - 0.17)) / 2 - 0.12
    assert FMC2.beta == pytest.approx(beta, rel=1e-14)
    assert FMC2.p_hard == pytest.approx(2 * (0.12 + beta + 0.5 * 0.17), rel=1e-14)
    # inside and outside of the band; exactly on its rim, but for rounding, counts as inside
    r1 = np.array([0, 0, 0, 0, 1, 0.4, 0.4, 0.4, 0.1])
    r2 = np.array([0, 1, 0.1, 0.2, 0.83, 0.57, 0.23, 0.58, 0.1])
    expected = [0.12, beta, 0.5, 0, 0.5, 0.5, 0.5, 0, 0.5]
    np.testing.assert_allclose(FMC2.joint_density(r1, r2), expected, rtol=1e-14)
    ties = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    nodes = (np.arange(5) + 0.5) / 5  # 0.3 - 0.1 > 0.2 in floating point
    band = ties.joint_density(nodes[:, None], nodes) > 0
    np.testing.assert_array_equal(band, np.abs(np.subtract.outer(range(5), range(5))) <= 1)


def test_symmetric_and_normalised(law):
    r = np.r_[0.0, np.random.default_rng(0).random(9), 1.0]
    joint = law.joint_density(r[:, None], r)
    np.testing.assert_allclose(joint, joint.T, rtol=1e-14)
    edges = sum(inner(law, end) for end in (0.0, 1.0))
    # the open square, by an integral of the inner integrals
    square = integral(lambda a: np.array([inner(law, r) for r in a]), jumps=(0.17, 0.83))
    assert law.corners.sum() + 2 * edges + square == pytest.approx(1.0, abs=1e-9)
    assert law.p_hard == pytest.approx(law.corners.sum() + edges, abs=1e-12)


@pytest.mark.parametrize("r", [0.0, 0.05, 0.17, 0.4, 0.5, 0.83, 0.95, 1.0])
def test_marginal_is_the_integral_of_the_joint(law, r):
    expected = float(law.joint_density(r, 0.0) + law.joint_density(r, 1.0)) + inner(law, r)
    assert float(law.marginal_density(r)) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("r", [0.0, 0.05, 0.4, 0.95, 1.0])
def test_conditional_is_joint_over_marginal_and_normalised(law, r):
    s = np.array([0.0, 0.1, 0.35, 0.9, 1.0])
    expected = law.joint_density(r, s) / float(law.marginal_density(r))
    np.testing.assert_allclose(law.transition_density(r, s), expected, rtol=1e-12)
    ends = law.transition_density(r, np.array([0.0, 1.0])).sum()
    rest = inner(law, r) / float(law.marginal_density(r))
    assert ends + rest == pytest.approx(1.0, abs=1e-11)


def test_printed_conditionals_of_fmc2():
    # eq. (35): from 0, the band has mass gamma delta / S with S = alpha + beta + gamma delta
    S = 0.12 + FMC2.beta + 0.5 * 0.17
    assert float(FMC2.transition_density(0.0, 0.1)) == pytest.approx(0.5 / S, rel=1e-13)
    assert 1 - FMC2.transition_density(0.0, [0.0, 1.0]).sum() == pytest.approx(0.5 * 0.17 / S, rel=1e-13)


def test_conditional_of_a_value_without_mass():
    # nothing can follow what never happens
    law = FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0)
    assert np.isnan(law.transition_density(0.5, [0.0, 0.2])).all()
    assert float(law.transition_density(0.0, 0.0)) == pytest.approx(0.6)


def test_scalars_and_shapes(law):
    assert law.joint_density(0.2, 0.3).shape == ()
    assert law.joint_density([[0.2], [0.0]], [0.3, 1.0, 0.5]).shape == (2, 3)
    assert law.marginal_density([[0.2, 0.3]]).shape == (1, 2)


# --------------------------------------------------------------------------- hardening


def test_hardening_closed_forms():
    q01 = FMC1.beta + 3 * 0.16 / 8 + 7 * 0.05 / 8
    np.testing.assert_allclose(FMC1.harden(), [[0.5 - q01, q01], [q01, 0.5 - q01]], rtol=1e-13)
    q01 = FMC2.beta + 0.5 * 0.17**2 / 2
    np.testing.assert_allclose(FMC2.harden(), [[0.5 - q01, q01], [q01, 0.5 - q01]], rtol=1e-13)


def test_hardening_is_the_integral_over_quadrants(law):
    n = 400
    r = (np.arange(n) + 0.5) / n
    W = np.r_[1.0, np.full(n, 1 / n), 1.0]
    values = np.r_[0.0, r, 1.0]
    masses = W[:, None] * W * law.joint_density(values[:, None], values)
    low = values < 0.5
    expected = [[masses[np.ix_(a, b)].sum() for b in (low, ~low)] for a in (low, ~low)]
    np.testing.assert_allclose(law.harden(), expected, atol=5e-4)
    assert law.harden().sum() == pytest.approx(1.0, abs=1e-13)


# --------------------------------------------------------------------------- admissible parameters


def test_beta_within_rounding_of_zero_is_admissible():
    law = FuzzyMarkovLaw.fmc2(0.10, 0.8 / 1.71, 0.30)  # 1 - gamma delta (6 - delta) = .2 = 2 alpha
    assert 0.0 <= law.beta < 1e-12
    law = FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0)
    assert law.beta == 0.0
    tiny = FuzzyMarkovLaw.fmc1(0.5 + 5e-13, 0.0, 0.0)
    assert tiny.beta == 0.0
    for law in (FuzzyMarkovLaw.fmc1(0.0, 3 / 7, 0.0), FuzzyMarkovLaw.fmc1(0.0, 0.0, 3 / 8)):
        assert law.beta == pytest.approx(0.0, abs=1e-12)
        assert law.p_hard >= 3 / 8 - 1e-12


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        ("fmc1", (0.2284, 0.05, 0.16), r"alpha: got 0\.2284, expected a number in \[0, 0\.228333\]"),
        ("fmc1", (0.5 + 1e-11, 0.0, 0.0), r"alpha: got 0\.5, expected a number in \[0, 0\.5\]"),
        ("fmc1", (-0.01, 0.05, 0.16), r"alpha: got -0\.01, expected a number in \[0, 0\.228333\]"),
        ("fmc1", (0.07, -0.05, 0.16), r"delta: got -0\.05, expected a density"),
        ("fmc1", (0.07, 0.05, -0.16), r"eta: got -0\.16, expected a density"),
        ("fmc1", (0.0, 0.3, 0.3), r"delta, eta: got 0\.3 and 0\.3.*= 1\.5; expected at most 1"),
        ("fmc1", (np.nan, 0.05, 0.16), r"alpha: .*nan, expected finite"),
        ("fmc1", (0.1, np.inf, 0.16), r"delta: .*inf, expected finite"),
        ("fmc1", (0.1, 0.05, "x"), r"eta: expected an array of numbers"),
        ("fmc2", (0.10, 0.55, 0.30), r"gamma must be at most 0\.467836"),
        ("fmc2", (0.10, 0.60, 0.30), r"gamma: got 0\.6, expected a number in \[0, 0\.584795\]"),
        ("fmc2", (0.10, -0.1, 0.30), r"gamma: got -0\.1, expected a density"),
        ("fmc2", (0.10, 0.1, 0.5), r"delta: got 0\.5, expected a half width in \[0, 0\.5\["),
        ("fmc2", (0.10, 0.1, -0.1), r"delta: got -0\.1, expected a half width"),
        ("fmc2", (-0.10, 0.1, 0.1), r"alpha: got -0\.1, expected a number in \[0, 0\.4705\]"),
        ("fmc2", (0.10, np.nan, 0.1), r"gamma: .*nan, expected finite"),
        ("fmc2", (0.6, 0.0, 0.0), r"alpha: got 0\.6, expected a number in \[0, 0\.5\]"),
    ],
)
def test_inadmissible_parameters(make, arguments, message):
    with pytest.raises(ParameterError, match=message):
        getattr(FuzzyMarkovLaw, make)(*arguments)


def test_the_named_bounds_are_the_bounds():
    # just inside is accepted, just outside refused
    FuzzyMarkovLaw.fmc1(0.228333, 0.05, 0.16)
    FuzzyMarkovLaw.fmc2(0.10, 0.467836, 0.30)
    with pytest.raises(ParameterError):
        FuzzyMarkovLaw.fmc1(0.228334, 0.05, 0.16)
    with pytest.raises(ParameterError):
        FuzzyMarkovLaw.fmc2(0.10, 0.467837, 0.30)


@pytest.mark.parametrize("r", [-0.1, 1.1, np.nan, [0.2, 3.0]])
def test_values_of_the_switch_are_checked(law, r):
    for f in (law.marginal_density, lambda r: law.joint_density(r, 0.5), lambda r: law.joint_density(0.5, r)):
        with pytest.raises(ParameterError, match=r"r.?: got .*, expected values of the switch in \[0, 1\]"):
            f(r)


# --------------------------------------------------------------------------- laws from densities


def fmc1_line(r):
    return 0.16 - 0.11 * r


EDGES = {
    "pair of functions": (fmc1_line, lambda r: fmc1_line(1 - r)),
    "function of two arguments": lambda end, r: fmc1_line(np.abs(r - end)),
    "list": [fmc1_line, lambda r: fmc1_line(1 - r)],
}


@pytest.mark.parametrize("edges", EDGES.values(), ids=EDGES)
def test_from_density_equals_fmc1(edges):
    law = FuzzyMarkovLaw.from_density(FMC1.corners, edges, lambda a, b: fmc1_line(np.abs(a - b)))
    assert_same_law(law, FMC1)


CONSTANT = {
    "number": 0.1,
    "numpy number": np.float64(0.1),
    "array": np.array(0.1),
    "pair of numbers": (0.1, 0.1),
    "mixed": [0.1, lambda r: 0.1 + 0.0 * r],
    "function of one argument": lambda r: 0.1 + 0.0 * r,
    "function returning a number": lambda r: 0.1,
}


@pytest.mark.parametrize("edges", CONSTANT.values(), ids=CONSTANT)
def test_constant_edges(edges):
    # a constant density everywhere is FMC1 with delta = eta
    plain = FuzzyMarkovLaw.fmc1(0.2, 0.1, 0.1)
    assert_same_law(FuzzyMarkovLaw.from_density(plain.corners, edges, 0.1), plain)


def test_from_density_equals_fmc2_if_the_jumps_are_named():
    def band(a, b):
        return np.where(np.abs(a - b) <= 0.17, 0.5, 0.0)

    law = FuzzyMarkovLaw.from_density(FMC2.corners, band, band, kinks=[0.17])
    assert_same_law(law, FMC2)


def assert_same_law(law, other):
    r = np.r_[0.0, np.random.default_rng(1).random(20), 1.0]
    np.testing.assert_allclose(
        law.joint_density(r[:, None], r), other.joint_density(r[:, None], r), atol=1e-14
    )
    np.testing.assert_allclose(law.marginal_density(r), other.marginal_density(r), atol=1e-12)
    np.testing.assert_allclose(law.harden(), other.harden(), atol=1e-13)
    assert law.p_hard == pytest.approx(other.p_hard, abs=1e-12)
    assert law.beta == pytest.approx(other.beta, abs=1e-15)
    for rule in ("cell", "midpoint", "gauss", "product"):
        a, b = (
            law.discretize(7 if other is not FMC2 else 14, rule),
            other.discretize(7 if other is not FMC2 else 14, rule),
        )
        np.testing.assert_allclose(a.transition, b.transition, atol=1e-11)
        np.testing.assert_allclose(a.initial, b.initial, atol=1e-12)


@pytest.mark.parametrize(
    ("corners", "edges", "interior", "message"),
    [
        ([[0.2, 0.1], [0.0, 0.2]], 0.1, 0.1, r"corners: .*corners\[0, 1\] = corners\[1, 0\]"),
        ([[0.2, -0.1], [-0.1, 0.2]], 0.1, 0.1, r"corners: got .*expected four masses, not negative"),
        ([[0.2, 0.1]], 0.1, 0.1, r"corners: got shape \(1, 2\), expected \(2, 2\)"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, lambda a, b: 0.2 * a, "interior: expected a symmetric density"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.2, 0.1, r"the total mass is 0\.\d+|the total mass is 1\."),
        ([[0.2, 0.05], [0.05, 0.2]], -0.1, 0.9, r"edges: returned -0\.1, expected finite densities"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, lambda a, b: np.nan * a * b, "interior: returned nan"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, lambda a, b: np.ones(3), r"interior: returned shape \(3,\)"),
        ([[0.2, 0.05], [0.05, 0.2]], [0.1, 0.1, 0.1], 0.1, "edges: got 3 parts, expected the two"),
        ([[0.2, 0.05], [0.05, 0.2]], None, 0.1, "edges: "),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, "x", "interior: expected an array of numbers"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, lambda a: a, "interior: called with 2 arrays of .* a TypeError"),
        ([[0.2, 0.05], [0.05, 0.2]], 0.1, np.zeros, "interior: called with 2 arrays of .* a TypeError"),
        ([[0.2, 0.05], [0.05, 0.2]], lambda r: "x" * r, 0.1, "edges: called with an array of .* a TypeError"),
    ],
)
def test_inadmissible_densities(corners, edges, interior, message):
    with pytest.raises((ParameterError, ShapeError), match=message):
        FuzzyMarkovLaw.from_density(corners, edges, interior)


def test_total_mass_is_named():
    # corners .5, edges 2 (.2 + .2), interior .1
    with pytest.raises(ParameterError, match=r"the total mass is 1\.4, expected 1"):
        FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.2, 0.1)


@pytest.mark.parametrize("kinks", [[2.0], [np.nan], "x"])
def test_inadmissible_kinks(kinks):
    with pytest.raises(ParameterError, match="kinks"):
        FuzzyMarkovLaw.from_density([[0.2, 0.05], [0.05, 0.2]], 0.1, 0.1, kinks=kinks)


def test_rounding_below_zero_counts_as_zero():
    # a density that a user computed as a difference: no negative probability may come of it
    law = FuzzyMarkovLaw.from_density(
        [[0.5, 0.0], [0.0, 0.5]], 0.0, lambda a, b: np.where(np.abs(a - b) < 0.5, -1e-13, 1e-13)
    )
    chain = law.discretize(5)
    assert (chain.transition >= 0.0).all()
    assert not chain.is_signed


# --------------------------------------------------------------------------- sampling


def test_sampled_marginal(law):
    pairs = np.array([law.sample(2, np.random.default_rng(k)) for k in range(300 if law is RAMP else 1500)])
    counts = np.histogram2d(*pairs.T, bins=[0.0, 0.5, 1.0])[0]
    assert scipy.stats.chisquare(counts.ravel(), law.harden().ravel() * len(pairs)).pvalue > 1e-3
    r = pairs[:, 1]
    hard = [(r == 0).sum(), (r == 1).sum(), ((r > 0) & (r < 1)).sum()]
    ends = law.marginal_density([0.0, 1.0])
    assert scipy.stats.chisquare(hard, np.r_[ends, 1 - ends.sum()] * r.size).pvalue > 1e-3
    inside, total = r[(r > 0) & (r < 1)], 1 - ends.sum()
    grid = np.linspace(0, 1, 2001)
    middle = 0.5 * (grid[1:] + grid[:-1])
    cdf = np.r_[0.0, np.cumsum(law.marginal_density(middle))] / 2000 / total
    assert scipy.stats.kstest(inside, lambda x: np.interp(x, grid, cdf)).pvalue > 1e-3


@pytest.mark.parametrize("r", [0.0, 1.0, 0.1, 0.45, 0.9])
def test_sampled_transitions(law, r):
    # draws of what follows one value, against eq. (26) to (29), (34) to (38)
    uniforms = np.random.default_rng(7).random((400 if law is RAMP else 1200, 2))
    drawn = np.array([law._draw_next(r, *map(float, u)) for u in uniforms])
    ends = law.transition_density(r, [0.0, 1.0])
    counts = [(drawn == 0).sum(), (drawn == 1).sum(), ((drawn > 0) & (drawn < 1)).sum()]
    expected = np.r_[ends, 1 - ends.sum()] * drawn.size
    possible = expected > 1e-9
    assert not np.array(counts)[~possible].any()
    if possible.sum() > 1:
        assert scipy.stats.chisquare(np.array(counts)[possible], expected[possible]).pvalue > 1e-3
    inside = drawn[(drawn > 0) & (drawn < 1)]
    grid = np.linspace(0, 1, 2001)
    middle = 0.5 * (grid[1:] + grid[:-1])
    cdf = np.r_[0.0, np.cumsum(law.transition_density(r, middle))] / 2000
    assert scipy.stats.kstest(inside, lambda x: np.interp(x, grid, cdf / cdf[-1])).pvalue > 1e-3


@pytest.mark.parametrize(
    "law",
    [
        FuzzyMarkovLaw.fmc1(0.1, 0.3, 0.02),  # more mass far off: the distribution function is convex
        FuzzyMarkovLaw.fmc1(0.1, 0.12, 0.12),  # flat
        FuzzyMarkovLaw.fmc1(0.0, 0.0, 3 / 8),  # no mass at the largest distance
        FuzzyMarkovLaw.fmc1(0.0, 3 / 7, 0.0),  # none at distance zero
        FuzzyMarkovLaw.fmc2(0.0, 1 / (0.49 * 5.51), 0.49),
    ],
)
@pytest.mark.parametrize("r", [0.0, 0.3, 1.0])
def test_drawing_inverts_the_distribution_function(law, r):
    # F(draw(u)) = u at all levels
    for u in np.linspace(0.005, 0.995, 34):
        s = law._draw_inside(r, float(u))
        jumps = {r, r - law.parameters["delta"], r + law.parameters["delta"]}
        mass = integral(lambda t: law.joint_density(r, t), 0.0, s, jumps)
        assert mass / law._inner_mass(r) == pytest.approx(u, abs=1e-9)


def test_sampling_is_reproducible_and_exact_at_the_hard_values():
    a, b = (FMC1.sample(50, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    assert FMC1.sample(0, np.random.default_rng(3)).shape == (0,)
    hard = FuzzyMarkovLaw.fmc1(0.3, 0.0, 0.0).sample(400, np.random.default_rng(4))
    assert set(hard) == {0.0, 1.0}
    with pytest.raises(ParameterError, match="n: got -1"):
        FMC1.sample(-1, np.random.default_rng(3))


# --------------------------------------------------------------------------- values


def test_laws_never_change():
    with pytest.raises(AttributeError, match="alpha: a FMC1 never changes"):
        FMC1.alpha = 0.3
    with pytest.raises(AttributeError, match="never changes"):
        del FMC1.alpha
    with pytest.raises(ValueError, match="read-only"):
        FMC1.corners[0, 0] = 0.3


@pytest.mark.parametrize("name", ["fmc1", "fmc2"])
def test_copies_and_pickles(name):
    law = LAWS[name]
    assert copy.copy(law) is law
    assert copy.deepcopy(law) is law
    again = pickle.loads(pickle.dumps(law))
    assert again.parameters == law.parameters
    np.testing.assert_array_equal(again.corners, law.corners)
    assert not again.corners.flags.writeable
    with pytest.raises(AttributeError, match="never changes"):
        again.alpha = 0.3


def test_repr_is_the_constructor():
    assert repr(FMC1) == "FuzzyMarkovLaw.fmc1(alpha=0.07, delta=0.05, eta=0.16)"
    assert repr(FMC2) == "FuzzyMarkovLaw.fmc2(alpha=0.12, gamma=0.5, delta=0.17)"


@pytest.mark.parametrize("r", [0.0, 0.3, 0.62, 1.0])
def test_any_density_is_drawn_from_by_inverting_it(r):
    # the kink at s = r has to be known, or the sums that are inverted are not those of the density
    law = FuzzyMarkovLaw.from_density(
        FMC1.corners, EDGES["function of two arguments"], lambda a, b: fmc1_line(np.abs(a - b))
    )
    for u in np.linspace(0.05, 0.95, 7):
        assert law._draw_inside(r, float(u)) == pytest.approx(FMC1._draw_inside(r, float(u)), abs=1e-9)
    assert law._inner_mass(r) == pytest.approx(FMC1._inner_mass(r), rel=1e-12)


# --------------------------------------------------------------------------- durations


@pytest.mark.parametrize("jump", [0.0, 0.3])
@pytest.mark.parametrize("stay", [1.5, 20.0, 400.0])
@pytest.mark.parametrize(
    ("slide", "kind"),
    [(4 / 3, "fmc1"), (1.5, "fmc1"), (5 / 3, "fmc1"), (1.76, "fmc2"), (1.9, "fmc2"), (1.999, "fmc2")],
)
def test_laws_of_given_durations(stay, slide, kind, jump):
    law = FuzzyMarkovLaw.from_durations(stay=stay, slide=slide, jump=jump / stay)
    assert law.kind == kind
    for F in (None, 1, 4):
        np.testing.assert_allclose(law.mean_dwell(F), stay, rtol=1e-9)
        assert law.mean_fade(F) == pytest.approx(slide, rel=1e-9)
    # jumps, per step at a hard value
    assert law.beta / law.marginal_density(0.0) == pytest.approx(jump / stay, abs=1e-12)


@pytest.mark.parametrize("law", [FMC1, FMC2, FuzzyMarkovLaw.from_durations(6, 1.6, jump=0.05)])
def test_samples_have_the_durations(law):
    r = law.sample(30_000, np.random.default_rng(8))
    hard = np.isin(r, (0.0, 1.0))
    change = np.flatnonzero((np.diff(r) != 0.0) & (hard[1:] | hard[:-1]))  # to, from or between hard values
    lengths, kinds = np.diff(change), hard[change[:-1] + 1]
    assert lengths[kinds].mean() == pytest.approx(law.mean_dwell().mean(), rel=0.03)
    assert lengths[~kinds].mean() == pytest.approx(law.mean_fade(), rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            (20, 10),
            r"slide: got 10, expected .* in \[4/3, 5/3\] \(FMC1\) or \]7/4, 2\[ \(FMC2\).*FadeLaw.between",
        ),
        ((20, 1.7), "slide: got 1.7, expected a mean number of steps in"),
        ((20, 1.75), "slide: got 1.75, expected"),
        ((20, 2.0), "slide: got 2, expected"),
        ((20, 1.3), "slide: got 1.3, expected"),
        ((20, np.nan), "slide: got nan, expected"),
        ((20, "long"), "slide: got 'long', expected a number of steps"),
        ((0.9, 1.5), "stay: got 0.9, expected a finite number of steps, at least 1"),
        ((np.inf, 1.5), "stay: got inf, expected a finite number"),
        ((20, 1.5, 0.05), r"jump: got 0.05, expected a probability in \[0, 0.05\[, less than 1 / stay"),
        ((20, 1.5, -0.1), "jump: got -0.1, expected a probability"),
    ],
)
def test_durations_that_laws_of_the_paper_cannot_have(arguments, message):
    stay, slide, *jump = arguments
    with pytest.raises(ParameterError, match=message):
        FuzzyMarkovLaw.from_durations(stay, slide, jump=jump[0] if jump else 0.0)


def test_durations_of_laws_without_them():
    hard = FuzzyMarkovLaw.fmc1(0.5, 0.0, 0.0)
    assert np.isinf(hard.mean_dwell()).all()
    assert np.isnan(hard.mean_fade())
    soft = FuzzyMarkovLaw.from_density(np.zeros((2, 2)), 0.0, 1.0)
    assert np.isnan(soft.mean_dwell()).all()
    assert np.isinf(soft.mean_fade())


@pytest.mark.parametrize("law", [FMC1, FMC2])
@pytest.mark.parametrize("F", [2, 6])
def test_a_chain_of_even_cells_is_hardened_as_its_law(law, F):
    np.testing.assert_allclose(law.harden(F), law.harden(), rtol=1e-12)
    assert abs(law.harden(3) - law.harden()).max() > 1e-4  # the middle cell is shared out
