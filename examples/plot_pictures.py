"""
Pictures of laws, models and results
====================================

What the methods ``plot`` draw, and how to place and label it. Each draws into the axes that it is
given, or into new ones, and returns them.
"""

# %%
# A law
# -----
# The joint density of two consecutive values of the switch. The bars at the corners are
# probabilities: of staying at 0 or 1, or of jumping. The bars in between are a density;
# here the switch moves by at most 0.2 in a step if it does not jump.

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import CGOFMSModel, CGOMSMFilter, FuzzyMarkovLaw, OFSRFilter

law = FuzzyMarkovLaw.fmc2(alpha=0.15, gamma=0.60, delta=0.20)
law.plot()
plt.show()

# %%
# A model
# -------
# Mean of state and observation for each value of the switch, with two standard
# deviations. A model whose switch can only jump has regimes instead.

z0, z1 = np.array([[0.3, 0.2], [0.2, 0.4]]), np.array([[0.6, 0.3], [0.3, 0.3]])
cross = 0.25 * (z0 + z1)
covariances = [[np.block([[a, cross], [cross, b]]) for b in (z0, z1)] for a in (z0, z1)]
model = CGOFMSModel(
    law, means=[[0.0, 0.0], [4.0, 6.0]], covariances=covariances, dim_x=1
)

figure, (left, right) = plt.subplots(
    1, 2, figsize=(9, 3.2), layout="constrained", sharey=True
)
options = {"labels": ("level", "pressure"), "units": ("m", "kPa")}
model.plot(left, **options).set_title("fuzzy switch")
model.harden().plot(right, **options).set_title("hard switch")
right.set_ylabel("")
plt.show()

# %%
# A result
# --------
# The estimate with its band, and the mean of the switch in the strip at the bottom:
# white is 0, black is 1. The truth is drawn if it is given.

truth = model.simulate(120, np.random.default_rng(6))
figure, (top, bottom) = plt.subplots(
    2, 1, figsize=(9, 6), layout="constrained", sharex=True
)
filters = (
    (top, OFSRFilter(model), "fuzzy"),
    (bottom, CGOMSMFilter(model.harden()), "hard"),
)
for axes, filter_, name in filters:
    result = filter_.filter(truth.y)
    result.plot(axes, truth=truth.x, level=0.9, label="level", unit="m")
    error = np.sqrt(np.mean((result.x - truth.x) ** 2))
    axes.set_title(f"{name} switches: root mean squared error {error:.2f} m")
top.set_xlabel("")
plt.show()
