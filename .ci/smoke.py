"""Try an installed fuzzykf on an engine: ``python .ci/smoke.py compiled``, or ``numpy``.

Needs what fuzzykf itself needs, and no more.
"""

import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

import fuzzykf
from fuzzykf import engine

expected = sys.argv[1]
print(f"fuzzykf {fuzzykf.__version__} in {Path(fuzzykf.__file__).parent}, Python {sys.version.split()[0]}")
print(engine.info())
assert engine.info().name == expected, f"expected the engine {expected!r}"
assert fuzzykf.__version__ == version("fuzzykf")
assert Path(fuzzykf.__file__).parents[1] != Path(__file__).resolve().parents[1], "the source"

# a Kalman filter, against Bayes' rule by hand: variances 1 and 1 meet half way
kf = fuzzykf.KalmanFilter(1, 1, x=[0.0], P=1.0, H=[[1.0]], Q=0.0, R=1.0)
kf.update(2.0)
np.testing.assert_allclose([kf.x.item(), kf.P.item()], [1.0, 0.5], rtol=1e-14)

# a switching filter step by step and along a series, with a gap, forwards and backwards
law = fuzzykf.FadeLaw.between(dwell=20, length=10)
z = np.array([[0.5, 0.3], [0.3, 1.0]])
pair = np.block([[z, 0.5 * z], [0.5 * z, z]])
model = fuzzykf.CGOFMSModel(law, [[0.0, 0.0], [4.0, 6.0]], [[pair, pair], [pair, pair]], 1)
truth = model.simulate(300, np.random.default_rng(0))
y = truth.y.copy()
y[100:110] = np.nan
f = fuzzykf.OFSRFilter(model)
found = f.filter(y)
f.reset()
steps = []
for observation in y:
    f.step(observation)
    steps.append(f.x[:, 0].copy())
np.testing.assert_allclose(found.x, steps, rtol=1e-9, atol=1e-9)
error, smoothed = (float(np.sqrt(np.mean((one.x - truth.x) ** 2))) for one in (found, f.smooth(y)))
assert smoothed < error < 0.8, (smoothed, error)

# learning, an IMM estimator, and a grid of memberships
fit = fuzzykf.CGOFMSModel.fit(truth.x, truth.y, truth.r, law="fade", form="regression")
assert np.isfinite(fit.log_likelihood)
modes = [fuzzykf.KalmanFilter(1, 1, H=[[1.0]], Q=q) for q in (0.01, 1.0)]
imm = fuzzykf.IMMEstimator(modes, [0.5, 0.5], [[0.9, 0.1], [0.1, 0.9]]).filter([0.0, 0.1, 3.0])
np.testing.assert_allclose(imm.mu.sum(axis=1), 1.0)
estimator = fuzzykf.FuzzyRelationEstimator(
    1,
    1,
    fx=lambda x: 0.9 * x,
    hx=lambda x: x,
    state=fuzzykf.TriangularMembership(-1.0, 0.0, 1.0),
    process_noise=fuzzykf.TriangularMembership(-0.1, 0.0, 0.1),
    measurement_noise=fuzzykf.CauchyMembership(0.0, 0.2),
)
estimator.predict()
estimator.update(0.5)
assert 0.0 < estimator.x.item() < 0.6
print("works")
