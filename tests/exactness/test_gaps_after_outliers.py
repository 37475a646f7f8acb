"""What is known in a gap keeps its digits when an outlier came before it.

After an outlier the nodes expect things that lie as far apart as it is far off.  The reference for
scalar systems is the recursion in decimal numbers of as many digits as the outlier needs.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from functools import cache

import numpy as np
import pytest

from fuzzykf import CGOFMSModel, CGOMSMFilter, CGOMSModel, FuzzyMarkovLaw, OFSRFilter

SIZES = [1e3, 1e8, 1e12, 1e36, 1e100]
GAPS = [[6], [6, 7], [7, 8]]


def series(q, size, gap):
    """Twelve observations, the sixth of which is ``size`` off."""
    ys = np.random.default_rng(0).normal(size=(12, q))
    ys[5] = size
    ys[gap] = np.nan
    return ys


class DecimalRecursion:
    """The recursion for scalar X and Y in decimal numbers: per node log-weight, means and covariances."""

    def __init__(self, system):
        tables, law = system.pair_tables(0), system.initial()
        self.K = len(law.probability)
        self.pairs = {
            (i, j): [Decimal(float(part[i, j].item())) for part in tables.pairs]
            for i, j in np.argwhere(tables.transition > 0.0)
        }
        self.log_T = {(i, j): Decimal(float(tables.transition[i, j])).ln() for i, j in self.pairs}
        self.law = law

    @staticmethod
    def condition(node, y):
        log_w, x, z, P, cross, S = node
        if y is None:
            return node
        gain = cross / S
        density = -((y - z) ** 2 / S + S.ln()) / 2
        return log_w + density, x + gain * (y - z), y, P - gain * cross, Decimal(0), Decimal(0)

    @staticmethod
    def merge(nodes):
        top = max(node[0] for node in nodes)
        w = [(node[0] - top).exp() for node in nodes]
        total = sum(w)
        p = [a / total for a in w]
        x, z = (sum(a * node[k] for a, node in zip(p, nodes, strict=True)) for k in (1, 2))
        off = [(node[1] - x, node[2] - z) for node in nodes]
        P, cross, S = (
            sum(a * (node[k] + u[r] * u[s]) for a, node, u in zip(p, nodes, off, strict=True))
            for k, r, s in ((3, 0, 0), (4, 0, 1), (5, 1, 1))
        )
        return top + total.ln(), x, z, P, cross, S

    def move(self, i, j, node):
        log_w, x, z, P, cross, S = node
        Axx, H, G, c, C, Ayy, Ny, Q = self.pairs[i, j]
        h = H + G * Ayy
        return (
            log_w + self.log_T[i, j],
            Axx * x + h * z + c + G * Ny,
            Ayy * z + Ny,
            Axx**2 * P + 2 * Axx * h * cross + h**2 * S + C + G**2 * Q,
            Axx * Ayy * cross + h * Ayy * S + G * Q,
            Ayy**2 * S + Q,
        )

    def advance(self, nodes, y):
        """The components of each node: one where y is there, else one for each node before it."""
        if y is None:
            nodes = [[self.merge(node)] for node in nodes]
        moved = {(i, j): [self.condition(self.move(i, j, one), y) for one in nodes[i]] for i, j in self.pairs}
        arrived = [[one for (_, to), some in moved.items() if to == j for one in some] for j in range(self.K)]
        return arrived if y is None else [[self.merge(some)] for some in arrived]

    def run(self, ys):
        """Means and variances of X, and the probabilities of the nodes."""
        with localcontext() as context:
            # variances beside the square of the outlier, and 60 digits to spare: up to 300 digits
            context.prec = 60 + round(2.4 * np.log10(np.nanmax(np.abs(ys))))
            context.Emin, context.Emax = -(10**9), 10**9
            seen = [None if np.isnan(y) else Decimal(float(y)) for y in ys]
            law, found, nodes = self.law, [], []
            for p, mean, S in zip(law.probability, law.mean, law.covariance, strict=True):
                parts = [Decimal(float(a)) for a in (*mean, S[0, 0], S[0, 1], S[1, 1])]
                nodes.append([self.condition((Decimal(float(p)).ln(), *parts), seen[0])])
            for n, y in enumerate(seen):
                if n:
                    nodes = self.advance(nodes, y)
                total, x, _, P, *_ = self.merge([one for node in nodes for one in node])
                p = [(self.merge(node)[0] - total).exp() for node in nodes]
                found.append((float(x), float(P), *map(float, p)))
        table = np.array(found)
        return table[:, 0], table[:, 1], table[:, 2:]


@pytest.fixture(scope="module")
def scalar_filters(fuzzy_model):
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)  # some pairs of nodes are impossible
    banded = CGOFMSModel(law, fuzzy_model.form.means, fuzzy_model.form.covariances, 1)
    return {
        "fmc1": OFSRFilter(fuzzy_model, 2),
        "fmc2": OFSRFilter(banded, 2),
        "hard": CGOMSMFilter(fuzzy_model.harden()),
    }


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["fmc1", "fmc2", "hard"])
def test_moments_are_those_of_decimal_numbers(scalar_filters, name, size):
    f = scalar_filters[name]
    for gap in GAPS:
        ys = series(1, size, gap)
        x, P, mu = DecimalRecursion(f._system).run(ys[:, 0])
        result = f.filter(ys[:, 0])
        np.testing.assert_allclose(result.P.ravel(), P, rtol=1e-12)
        np.testing.assert_allclose(result.x.ravel(), x, rtol=1e-11, atol=1e-15 * size)
        np.testing.assert_allclose(result.mu, mu, atol=1e-13)


@cache
def linear(m, q, order):
    """Two regimes that differ in everything, m states, q observed components."""
    rng = np.random.default_rng(3)
    A = 0.25 * rng.normal(size=(2, m, m)) / np.sqrt(m) + 0.4 * np.eye(m)
    B, C = rng.normal(size=(2, q, m)), 0.3 * np.eye(m) + 0.3 * rng.normal(size=(2, m, m))
    D = 0.5 * np.eye(q) + 0.2 * rng.normal(size=(2, q, q))
    return CGOMSModel.from_cglssm([[0.9, 0.1], [0.1, 0.9]], A=A, B=B, C=C, D=D, order=order)


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize(("m", "q"), [(1, 1), (2, 1), (4, 2)])
@pytest.mark.parametrize("size", SIZES[1:])
def test_no_variance_is_negative(m, q, order, size):
    f = CGOMSMFilter(linear(m, q, order))
    for gap in GAPS:
        ys = series(q, size, gap)
        one_by_one = f.copy()
        one_by_one.reset()
        for y in ys:
            one_by_one.step(y)
        many = f.filter_many(ys[None], keep=("x", "P", "mu"))
        filtered = f.filter(ys)
        np.testing.assert_allclose(one_by_one.P, filtered.P[-1], rtol=1e-9)
        np.testing.assert_array_equal(many.P[0], filtered.P)
        for result in (filtered, f.smooth(ys)):
            assert np.isfinite(result.x).all()
            np.testing.assert_allclose(result.mu.sum(axis=-1), 1.0, rtol=1e-12)
            eigenvalues = np.linalg.eigvalsh(result.P)
            assert (eigenvalues[:, 0] >= -1e-14 * eigenvalues[:, -1]).all()
            assert (np.diagonal(result.P, axis1=-2, axis2=-1) > 0.0).all()


@pytest.mark.parametrize("size", [1e3, 1e12, 1e36])
def test_a_file_made_in_the_gap_keeps_the_digits(size, tmp_path):
    f = CGOMSMFilter(linear(2, 1, 2))
    ys = series(1, size, [6, 7])
    for y in ys[:8]:
        f.step(y)
    f.save(tmp_path / "gap.json")
    again = CGOMSMFilter.load(tmp_path / "gap.json")
    for y in ys[8:]:
        np.testing.assert_array_equal(again.step(y), f.step(y))
        np.testing.assert_array_equal(again.P, f.P)
