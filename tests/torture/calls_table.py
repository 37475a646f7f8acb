"""What can be called: objects and their verbs, constructors and functions, and which of them are drawn."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import specimens
from calls_arguments import (
    Kind,
    array,
    choice,
    count,
    fixed,
    generator,
    listed,
    maybe,
    probabilities,
    real,
    shares,
)
from calls_constructors import CONSTRUCTORS
from calls_filters import (
    KINDS_OF_NODES,
    bank_verbs,
    extended_verbs,
    kalman_verbs,
    known_verbs,
    possibility_verbs,
    switching_verbs,
)
from calls_functions import FUNCTIONS
from calls_verbs import TIME, Verb, made, verb

from fuzzykf.possibility import memberships, norms

__all__ = ["drawn"]


def model_verbs(q: int, m: int) -> list[Verb]:
    """Return the verbs of a model."""
    nodes = maybe(count(0, 6))
    return [
        verb("simulate", n=count(0, 6, work=True), rng=generator()),
        verb("filter", n_nodes=nodes, rule=maybe(KINDS_OF_NODES)),
        verb("placed", n_nodes=nodes, rule=maybe(KINDS_OF_NODES)),
        verb("class_weights", r=shares(4)),
        verb("class_weights", r=choice(np.zeros(3), np.array([0.0, 1.0]))),
        verb("save", path=fixed("file:model.json")),
        verb("to_dict"),
        verb("describe_switch"),
        verb("plot", component=maybe(count(0, m - 1))),
    ]


def law_verbs() -> list[Verb]:
    """Return the verbs of a law."""
    return [
        *[verb("discretize", n_nodes=count(0, 6), rule=maybe(KINDS_OF_NODES))] * 3,
        verb("sample", n=count(0, 6, work=True), rng=generator(), n_nodes=maybe(count(0, 5))),
        *[
            verb(name, r1=shares(3), r2=shares(3), infinite=True)
            for name in ("joint_density", "transition_density")
        ],
        verb("marginal_density", r=shares(3), infinite=True),
        verb("harden"),
        verb("plot"),
        verb("to_dict"),
    ]


def graphic_law_verbs() -> list[Verb]:
    """Return the verbs of a law on a graph."""
    return [
        verb("discretize", n_nodes=count(0, 5), rule=maybe(choice("cell"))),
        verb("sample", n=count(0, 6, work=True), rng=generator(), n_nodes=maybe(count(0, 5))),
        verb("harden", n_nodes=maybe(count(0, 5))),
        *[verb(name, infinite=True, n_nodes=maybe(count(0, 5))) for name in ("mean_dwell", "mean_fade")],
        verb("plot", n=count(1, 5, work=True), rng=maybe(generator()), n_nodes=maybe(count(0, 5))),
        verb("to_dict"),
    ]


def membership_verbs(d: int) -> list[Verb]:
    """Return the verbs of a membership."""
    points, norm = array(3, d, scale=1.5), choice(norms.PRODUCT, norms.MIN, norms.HAMACHER, norms.LUKASIEWICZ)
    return [
        *[verb("__call__", x=points)] * 3,
        verb("negative_log", infinite=True, x=points),
        verb("cost", infinite=True, x=points, t_norm=norm),
        verb("alpha_cut", infinite=True, level=real(0.05, 1.0)),
        verb("support", infinite=True, level=maybe(real(0.0, 0.9))),
        verb("reach", infinite=True, levels=shares(3)),
        verb("plot", level=maybe(real(0.01, 0.5))),
        verb("project", components=choice([0], (0,), range(d))),
        verb("cut", level_or_bounds=choice(0.3, [-0.5, 0.5] if d == 1 else [[-0.5, 0.5], [0.0, 1.5]])),
    ]


def norm_verbs() -> list[Verb]:
    """Return the verbs of a t-norm."""
    return [
        *[verb("__call__", arg0=shares(3), arg1=maybe(shares(3)), arg2=maybe(shares(2, 3)))] * 2,
        verb("cost", infinite=True, membership=shares(3)),
        verb("membership", cost=shares(3)),
        verb("renormalise", infinite=True, cost=shares(3), best=real(0.0, 0.2)),
        verb("cost_of_log", infinite=True, negative_log=shares(3)),
    ]


def preparation_verbs(shape: tuple[int, ...], **extra: Kind) -> list[Verb]:
    """Return the verbs of a step of preparation."""
    values = array(*shape)
    return [
        verb(name, values=values, **extra)
        for name in ("fit", "transform", "inverse_transform", "fit_transform")
    ]


def without_clocks(found: Any) -> Any:
    """Return what makes a table of a comparison, without the times in it."""

    def to_dataframe(**kwargs: Any) -> Any:
        return found.to_dataframe(**kwargs).drop(columns=["seconds", "microseconds"], errors="ignore")

    return to_dataframe


DAYS = maybe(Kind(lambda rng: rng.integers(0, 2, 48).astype(bool)))

#: Objects: a specimen's name and its verbs.
OBJECTS: dict[str, list[Verb]] = {
    **{
        name: switching_verbs(specimens.FILTERS[name][0])
        for name in specimens.FILTERS
        if name[:4] in ("OFSR", "CGOM")
    },
    **{
        name: known_verbs(specimens.FILTERS[name][0])
        for name in specimens.FILTERS
        if name.startswith("Known")
    },
    **{
        name: kalman_verbs(specimens.FILTERS[name][0])
        for name in specimens.FILTERS
        if name.startswith("Kalman")
    },
    "ExtendedKalmanFilter": extended_verbs(),
    "IMMEstimator": bank_verbs(),
    "IMMEstimator, gpb2": bank_verbs(),
    "FuzzyRelationEstimator": possibility_verbs(
        Kind(lambda rng: memberships.GaussianMembership([rng.normal()], [[0.5]]))
    ),
    "FuzzyRelationEstimator, box": possibility_verbs(made("IntervalMembership")),
    "FuzzyRelationEstimator, grid": possibility_verbs(made("TriangularMembership", "IntervalMembership")),
    **{name: model_verbs(1, 1) for name in specimens.OTHERS if name.startswith("CGO")},
    "CGLSSM": [
        verb("simulate", n=count(0, 6, work=True), rng=generator()),
        verb("stationary_covariance"),
        verb("save", path=fixed("file:model.json")),
    ],
    **{name: law_verbs() for name in specimens.OTHERS if name.startswith("FuzzyMarkovLaw")},
    "FadeLaw": [*graphic_law_verbs(), verb("fade_lengths", n_nodes=maybe(count(0, 5)))],
    "GraphLaw": graphic_law_verbs(),
    **{
        name: [verb("sample", n=count(0, 6, work=True), rng=generator())]
        for name in ("SwitchChain", "SwitchChain, classes")
    },
    "FilterResult": [
        verb("interval", level=real(0.1, 0.99)),
        verb("to_dataframe", index=maybe(fixed(range(6)))),
        verb("plot", component=count(0, 0), level=real(0.1, 0.9)),
    ],
    **{
        name: membership_verbs(2 if name[:5] in ("Gauss", "Joint") else 1)
        for name in specimens.OTHERS
        if name.endswith("Membership")
    },
    **{name: norm_verbs() for name in specimens.OTHERS if name.startswith("TNorm")},
    **{
        name: [verb("__call__", memberships=shares(3, 2), axis=maybe(choice(0, 1, -1, (0, 1), None)))]
        for name in specimens.OTHERS
        if name.startswith("TConorm")
    },
    "Standardizer": preparation_verbs((6, 2)),
    "DailyProfile": [*preparation_verbs((48,), time=TIME, workday=DAYS), verb("at", time=TIME, workday=DAYS)],
    "ModelComparison": [
        verb("verdict", unit=maybe(fixed("MW"))),
        Verb("to_dataframe", {"by_fold": maybe(choice(True, False))}, without_clocks, gaps=True),
    ],
    "FitResult": [verb("bootstrap", n_replicates=count(1, 1, work=True), rng=generator())],
    "RuleBase": [
        verb("predict", sets=fixed([np.array([0.2, 1.0, 0.3])]), universes=listed(array(3), 2, 2)),
        verb("relation", universes=listed(array(3), 2, 2)),
    ],
}

OBJECTS["CGOMSModel, steady"] = [
    *OBJECTS["CGOMSModel, steady"],
    verb("closeness", weights=maybe(probabilities(2))),
]


#: Cases of constructors and functions among all; the others are filters three times out of four.
SHARE_OF_FUNCTIONS = 0.45

#: Slow ones, and how often they are left out.
SLOW = {
    "CGOFMSModel.fit": 0.9,
    "CGOMSModel.fit": 0.6,
    "compare_models": 0.6,
    "check_filter": 0.8,
    "plot": 0.8,
}


@cache
def names() -> tuple[list[str], list[str]]:
    """Return the names of filters, and those of other objects."""
    return [name for name in OBJECTS if name in specimens.FILTERS], [
        name for name in OBJECTS if name not in specimens.FILTERS
    ]


def drawn(rng: np.random.Generator) -> tuple[str, Any, list[Verb]]:
    """Draw what is called: an object's name, the object, and one or more of its verbs."""
    if rng.random() < SHARE_OF_FUNCTIONS:
        single = CONSTRUCTORS + FUNCTIONS
        while True:
            name, target, verbs = single[rng.integers(len(single))]
            if rng.random() >= SLOW.get(verbs[0].name, 0.0):
                return name, target, verbs
    filters, others = names()
    group = filters if rng.random() < 0.7 else others
    name = group[rng.integers(len(group))]
    verbs = OBJECTS[name]
    picked = [verbs[rng.integers(len(verbs))] for _ in range(rng.integers(1, 7))]
    return name, specimens.specimen(name), [one for one in picked if rng.random() >= SLOW.get(one.name, 0.0)]
