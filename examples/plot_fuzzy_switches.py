"""
Gradual switches, restored
==========================

A hidden state follows one of two regimes, or anything in between, and only a noisy
companion of it is seen. The switch between the regimes is part abrupt, part gradual: a
*fuzzy Markov chain* that stays at 0 or at 1, jumps, or drifts through the values in
between. This example simulates such a system, and restores state and switch from the
observations alone: once with the fuzzy filter, and once with a filter that knows only
abrupt switches. It is the setting of Figure 4 of Bouyahia, Derrode and Pieczynski
(2020), with their law FMC2 and their matrices.
"""

# %%
# The model
# ---------
# The law of the switch has masses in the corners (stay at 0 or 1 with ``alpha``, jump with what is
# left over) and a band of density ``gamma`` along the diagonal, ``delta`` wide: a gradual switch moves
# by at most 0.2 in a step. Rows and columns of the covariances are :math:`X_n, Y_n, X_{n+1}, Y_{n+1}`.

import matplotlib.pyplot as plt
import numpy as np

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    FuzzyMarkovLaw,
    KnownSwitchFilter,
    OFSRFilter,
)

law = FuzzyMarkovLaw.fmc2(alpha=0.15, gamma=0.60, delta=0.20)


def pair(x1, y1, b1, x2, y2, b2, a, e, c):
    """Covariance of (X1, Y1, X2, Y2); the entry Cov(Y2, X1) is set by the model."""
    return [[x1, b1, a, 0.0], [b1, y1, e, c], [a, e, x2, b2], [0.0, c, b2, y2]]


covariances = [
    [
        pair(0.50, 1.0, 0.3, 0.50, 1.0, 0.3, a=0.1, e=0.35, c=0.4),
        pair(0.50, 1.0, 0.3, 0.75, 0.5, 0.3, a=0.5, e=0.33, c=0.6),
    ],
    [
        pair(0.75, 0.5, 0.3, 0.50, 1.0, 0.3, a=0.1, e=0.35, c=0.4),
        pair(0.75, 0.5, 0.3, 0.75, 0.5, 0.3, a=0.5, e=0.33, c=0.3),
    ],
]
model = CGOFMSModel(
    law, means=[[0.0, 3.0], [0.0, 0.0]], covariances=covariances, dim_x=1
)
print(f"share of hard switches: {law.p_hard:.3f}")

# %%
# A series, and four filters
# --------------------------
# The rival is the hardened model: its law is the fuzzy one integrated over the four
# quadrants, and its matrices are the same. Each filter runs once with known switches
# (rounded, for the hard one) and once without.

hard = model.harden()


def restore(truth):
    """Run the fuzzy and the hard filters, with known and with unknown switches."""
    known = (
        KnownSwitchFilter(model).filter(truth.y, truth.r),
        KnownSwitchFilter(hard).filter(truth.y, np.round(truth.r)),
    )
    unknown = (
        OFSRFilter(model, n_nodes=5).filter(truth.y),
        CGOMSMFilter(hard).filter(truth.y),
    )
    return known, unknown


def errors(truth, known, unknown):
    """Mean squared errors of state (switches known), state and switch; fuzzy, hard."""
    return np.array(
        [
            [np.mean((result.x - truth.x) ** 2) for result in known],
            [np.mean((result.x - truth.x) ** 2) for result in unknown],
            [np.mean((result.switch - truth.r) ** 2) for result in unknown],
        ]
    )


rng = np.random.default_rng(1)
truth = model.simulate(80, rng)
known, unknown = restore(truth)
shown = errors(truth, known, unknown)

# %% One series of 80 steps says little, so the errors are also averaged over 100
# further series.

many = []
for _ in range(100):
    series = model.simulate(80, rng)
    many.append(errors(series, *restore(series)))
mean, standard_error = np.mean(many, axis=0), np.std(many, axis=0) / np.sqrt(len(many))

print(
    f"{'mean squared error':25}{'fuzzy':>12}{'hard':>15}"
    "        (this series: fuzzy, hard)"
)
for row, name in enumerate(
    ["state, switches known", "state, switches unknown", "switch, most probable"]
):
    cells = [
        f"{m:.3f} +- {e:.3f}"
        for m, e in zip(mean[row], standard_error[row], strict=True)
    ]
    print(
        f"{name:25s} {cells[0]:>15s} {cells[1]:>15s}"
        f"    {shown[row, 0]:12.3f} {shown[row, 1]:8.3f}"
    )

# %%
# What they find
# --------------
# The stairs in the middle panel are the five nodes between 0 and 1 on which the fuzzy filter works.

BLUE, ORANGE = "#0072B2", "#D55E00"
figure, axes = plt.subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
panels = [
    (
        "state, switches known",
        truth.x[:, 0],
        [result.x[:, 0] for result in known],
        shown[0],
    ),
    (
        "switch, most probable value",
        truth.r,
        [result.switch for result in unknown],
        shown[2],
    ),
    (
        "state, switches unknown",
        truth.x[:, 0],
        [result.x[:, 0] for result in unknown],
        shown[1],
    ),
]
for panel, (title, true, (by_fuzzy, by_hard), (error, hard_error)) in zip(
    axes, panels, strict=True
):
    panel.plot(true, color="black", linewidth=1, label="true")
    panel.plot(
        by_hard,
        color=ORANGE,
        linewidth=1.2,
        linestyle=(0, (4, 1.5)),
        label="hard filter",
    )
    panel.plot(by_fuzzy, color=BLUE, linewidth=1.8, label="fuzzy filter")
    panel.set_title(
        f"{title} (mean squared error: fuzzy {error:.2f}, hard {hard_error:.2f})"
    )
    panel.set_ylabel(title.partition(",")[0])
    panel.grid(color="0.9")
    panel.margins(x=0)
axes[0].legend(ncols=3, loc="lower right")
axes[2].set_xlabel("step")
plt.show()
