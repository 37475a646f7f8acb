"""What looking back is worth to the rocket of the 2001 paper, beside an extended Kalman smoother.

With an altimeter that errs without bounds, as the memberships say, and with both noises cut at their scales,
where a Gaussian law of the same scale is the better description.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from fuzzykf import FuzzyRelationEstimator
from fuzzykf.errors import SupportWarning
from fuzzykf.experiments import paper2001_rocket as rocket

pytestmark = pytest.mark.study

RUNS, POINTS = 60, 51


class Clocked(FuzzyRelationEstimator):
    """Counts its steps, which the mass of the rocket depends on."""

    steps = 0

    def predict(self, **given):
        super().predict(k=self.steps, **given)
        self.steps += 1


def fuzzy():
    est = rocket._fuzzy(POINTS)
    est.__class__ = Clocked
    return est


def energy(x, states):
    """Half the sum of squared errors of the altitude."""
    return 0.5 * ((x[:, 0] - states[:, 0]) ** 2).sum()


def extended(zs):
    """The filter and the smoother, infinite where the Euler step diverges after an outlier."""
    clock = [{"k": k} for k in range(len(zs))]
    with np.errstate(over="raise", invalid="raise"):
        try:
            return [getattr(rocket._extended(), verb)(zs, fx_args=clock).x for verb in ("filter", "smooth")]
        except (FloatingPointError, ArithmeticError):
            return [np.full((len(zs), 2), np.inf)] * 2


def follow(noise, seed):
    """Energies (4, RUNS): of the extended filter and smoother, of the fuzzy filter and smoother."""
    rng, found = np.random.default_rng(seed), np.empty((4, RUNS))
    for run in range(RUNS):
        states, z, _ = rocket.launch(rng, noise)
        zs = np.full(len(z), np.nan)
        zs[rocket._EVERY - 1 :: rocket._EVERY] = z[rocket._EVERY - 1 :: rocket._EVERY]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SupportWarning)  # an outlier may lie beyond the grid
            results = [*extended(zs), fuzzy().filter(zs).x, fuzzy().smooth(zs).x]
        found[:, run] = [energy(x, states) for x in results]
    return found


def test_what_looking_back_is_worth_to_the_rocket(write_table) -> None:
    rows, found = [], {}
    for noise, label in (("measurement", "Cauchy altimeter"), ("cut", "both noises cut")):
        found[noise] = follow(noise, 5)
        _, after, forward, back = found[noise]
        medians = [f"{np.median(one):.3g}" for one in found[noise]]
        ratio = f"{back.mean() / forward.mean():.2f}"
        rows.append([label, *medians, ratio, f"{(back < after).mean():.0%}"])
    write_table(
        "rocket_smoothing",
        [
            "noises",
            "EKF",
            "EKF with RTS",
            "fuzzy filter",
            "fuzzy smoother",
            "smoother's mean to the filter's",
            "fuzzy smoother better than EKF with RTS",
        ],
        rows,
    )
    _, after, forward, back = found["measurement"]
    # by how much is in the table; half of the mean is that of six launches, which smoothing does not help
    assert back.mean() < forward.mean()
    worst = np.argsort(back)[-6:]
    assert back[worst].sum() == pytest.approx(0.5 * back.sum(), rel=0.2)
    assert back[worst].sum() > forward[worst].sum() * 0.9
    rest = np.delete(back, worst).mean() / np.delete(forward, worst).mean()
    assert rest == pytest.approx(0.29, abs=0.03)
    assert (back < after).mean() >= 0.75
    _, after, _, back = found["cut"]
    assert np.median(after) < np.median(back)  # where a Gaussian law will do, it does better
