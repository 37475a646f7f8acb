"""Constructors of every public class, with the kinds of their arguments."""

from __future__ import annotations

import numpy as np
import specimens
from calls_arguments import (
    Kind,
    array,
    choice,
    count,
    covariance,
    fixed,
    generator,
    listed,
    maybe,
    probabilities,
    real,
    stochastic,
    trusted,
)
from calls_filters import KINDS_OF_NODES
from calls_verbs import Verb, function, made

import fuzzykf
from fuzzykf import switching
from fuzzykf.possibility import memberships, norms

__all__ = ["COMPARE", "CONSTRUCTORS", "SOME_CONORM", "SOME_NORM", "SQUARES"]


K, D = 2, 2  # regimes; components of the state and the observation together
REGRESSIONS = {
    "Ayy": array(K, K, 1, 1),
    "Ny": array(K, K, 1),
    "Qyy": covariance(K, K, 1),
    "Axx": array(K, K, 1, 1),
    "H": array(K, K, 1, 1),
    "G": array(K, K, 1, 1),
    "c": array(K, K, 1),
    "C": covariance(K, K, 1),
    "means": array(K, D),
    "covariances": covariance(K, D),
}
PAIRS = Kind(
    lambda rng: (
        np.broadcast_to(np.kron([[1.0, 0.8], [0.8, 1.0]], [[1.0, 0.5], [0.5, 1.0]]), (2, 2, 4, 4))
        * rng.uniform(0.5, 2)
    )
)
LAW = made("FuzzyMarkovLaw, fmc1", "FuzzyMarkovLaw, fmc2")
LINEAR = {
    name: Kind(lambda rng, value=value: np.array(value, float)) for name, value in specimens.LINEAR.items()
}
SEARCH = {"n_starts": count(1, 1, work=True), "max_iter": count(1, 2, work=True), "rng": maybe(generator())}
LEARN = {
    "x": Kind(lambda rng: specimens.sample(30).x),
    "y": Kind(lambda rng: specimens.sample(30).y),
    "r": maybe(Kind(lambda rng: np.round(specimens.sample(30).r))),
}
ONE = array(1)
EKF = {
    "fx": maybe(fixed(specimens.drift)),
    "FJacobian": maybe(fixed(specimens.drift_jacobian)),
    "hx": maybe(fixed(specimens.distance)),
    "HJacobian": maybe(fixed(specimens.distance_jacobian)),
}
WHAT = {
    "x": maybe(array(2)),
    "P": maybe(covariance(2)),
    "F": maybe(array(2, 2)),
    "Q": maybe(covariance(2)),
    "R": maybe(covariance(1)),
}
NOISES = made("GaussianMembership", "IntervalMembership", "TriangularMembership", "CauchyMembership")
SOME_NORM, SOME_CONORM = (
    choice("product", "min", "hamacher", "lukasiewicz"),
    choice("max", "probabilistic_sum", "bounded_sum"),
)
COMPARE = {
    "x": Kind(lambda rng: specimens.sample(160).x[:, 0]),
    "y": Kind(lambda rng: specimens.sample(160).y[:, 0]),
}
SQUARES = {"F": array(2, 2), "Q": covariance(2)}


#: Constructors, in threes of no name, no object, and the one verb.
CONSTRUCTORS: list[tuple[str, None, list[Verb]]] = [
    function(
        fuzzykf.KalmanFilter,
        dim_x=fixed(2),
        dim_z=fixed(1),
        dim_u=maybe(count(0, 2)),
        H=maybe(array(1, 2)),
        B=maybe(array(2, 1)),
        **WHAT,
    ),
    function(
        fuzzykf.ExtendedKalmanFilter, dim_x=fixed(2), dim_z=fixed(1), dim_u=maybe(count(0, 2)), **EKF, **WHAT
    ),
    function(
        fuzzykf.IMMEstimator,
        filters=Kind(lambda rng: specimens.bank().filters),
        mu=probabilities(2),
        M=stochastic(2),
        method=maybe(choice("imm", "gpb2")),
    ),
    function(
        fuzzykf.FuzzyRelationEstimator,
        dim_x=fixed(1),
        dim_z=fixed(1),
        dim_u=maybe(count(0, 1)),
        fx=maybe(fixed(specimens.bent)),
        hx=maybe(fixed(specimens.identity)),
        state=maybe(NOISES),
        process_noise=maybe(NOISES),
        measurement_noise=maybe(NOISES),
        t_norm=maybe(SOME_NORM),
        t_conorm=maybe(SOME_CONORM),
        on_empty=maybe(choice("raise", "keep", "reset")),
        points=maybe(count(5, 50)),
        domain=maybe(fixed([[-3.0, 3.0]])),
        floor=maybe(real(0.001, 0.1)),
    ),
    function(
        fuzzykf.OFSRFilter, model=made("CGOFMSModel"), n_nodes=maybe(count(0, 6)), rule=maybe(KINDS_OF_NODES)
    ),
    function(fuzzykf.CGOMSMFilter, model=made("CGOMSModel", "CGOMSModel, steady")),
    function(switching.SwitchingFilter, system=made("placed"), method=maybe(trusted(switching.EXACT))),
    function(
        norms.TNorm,
        infinite=True,
        name=fixed("own"),
        scale=choice("log", "reciprocal", "complement"),
        additive=choice(True, False),
        family=fixed(None),
    ),
    function(fuzzykf.KnownSwitchFilter, model=made("CGOMSModel", "CGOFMSModel")),
    *[
        function(
            fuzzykf.CGOFMSModel,
            law=LAW,
            means=array(2, 2),
            covariances=PAIRS,
            dim_x=fixed(1),
            interpolation=maybe(choice("covariance", "transition")),
            constraint=maybe(choice("project", "check")),
        )
    ]
    * 2,
    function(fuzzykf.CGOFMSModel.from_regressions, law=LAW, **REGRESSIONS),
    function(
        fuzzykf.CGOMSModel,
        transition=stochastic(2),
        means=array(2, 2),
        covariances=PAIRS,
        dim_x=fixed(1),
        initial=maybe(probabilities(2)),
    ),
    function(
        fuzzykf.CGOMSModel.from_regressions,
        transition=stochastic(2),
        initial=maybe(probabilities(2)),
        **REGRESSIONS,
    ),
    function(
        fuzzykf.CGOMSModel.from_transitions,
        transition=stochastic(2),
        dim_x=fixed(1),
        **{
            name: Kind(lambda rng, k=k: specimens.transitions(2, 1, 1)[k])
            for k, name in enumerate(("A", "Q", "means", "covariances"))
        },
    ),
    *[
        function(
            fuzzykf.CGOMSModel.from_cglssm,
            **LINEAR,
            initial_probability=maybe(probabilities(2)),
            initial_covariance=maybe(covariance(2, 1)),
            order=maybe(count(1, 2)),
            mode=maybe(choice("stationary", "time_varying")),
        )
    ]
    * 2,
    function(
        fuzzykf.CGLSSM,
        **LINEAR,
        initial_probability=maybe(probabilities(2)),
        initial_covariance=maybe(covariance(2, 1)),
    ),
    function(switching.shrink_covariances, switch=LAW, means=array(2, 2), covariances=PAIRS, dim_x=fixed(1)),
    function(
        fuzzykf.CGOFMSModel.fit,
        **LEARN,
        **SEARCH,
        n_nodes=maybe(count(1, 3)),
        law=maybe(choice("fmc1", "fmc2", "free")),
        form=fixed("covariance"),
        tolerance=maybe(real(1e-6, 0.1)),
    ),
    *[
        function(
            fuzzykf.CGOMSModel.fit,
            **LEARN,
            **SEARCH,
            n_switches=maybe(count(1, 2)),
            form=maybe(choice("covariance", "regression", "auto")),
            tolerance=maybe(real(1e-6, 0.1)),
        )
    ]
    * 2,
    *[
        function(
            fuzzykf.FuzzyMarkovLaw.fmc1, alpha=real(0.01, 0.1), delta=real(0.01, 0.1), eta=real(0.01, 0.2)
        )
    ]
    * 2,
    *[
        function(
            fuzzykf.FuzzyMarkovLaw.fmc2, alpha=real(0.01, 0.2), gamma=real(0.1, 0.9), delta=real(0.01, 0.3)
        )
    ]
    * 2,
    function(
        fuzzykf.FuzzyMarkovLaw.from_durations, stay=real(1.0, 9.0), slide=real(1.4, 1.6), jump=real(0.0, 0.1)
    ),
    function(
        fuzzykf.FadeLaw.between,
        dwell=real(1.0, 9.0),
        length=real(2.0, 9.0),
        jump=maybe(real(0.0, 0.1)),
        turn_back=maybe(real(0.0, 0.4)),
    ),
    function(
        fuzzykf.FadeLaw,
        n_classes=count(2, 2),
        fades=fixed({(0, 1): (0.1, 5.0), (1, 0): (0.2, 4.0)}),
        jumps=maybe(fixed({(0, 1): 0.1})),
        turn_back=maybe(real(0.0, 0.4)),
    ),
    function(
        fuzzykf.GraphLaw.from_masses,
        vertices=fixed(np.array([3.0, 3.0])),
        edges=fixed({(0, 1): 1.0}),
        jumps=maybe(fixed({(1, 0): 0.2})),
        family=maybe(choice("linear", "band")),
        shape=maybe(real(0.1, 0.5)),
    ),
    function(
        fuzzykf.FuzzyMarkovLaw.from_density,
        corners=fixed(np.array([[0.2, 0.05], [0.05, 0.2]])),
        edges=choice(0.1, specimens.edge),
        interior=fixed(0.1),
        kinks=maybe(choice((0.0,), [0.3])),
    ),
    *[
        function(
            fuzzykf.SwitchChain,
            nodes=fixed(np.array([0.0, 0.5, 1.0])),
            weights=fixed(np.ones(3) / 3),
            initial=probabilities(3),
            transition=stochastic(3),
            class_weights=maybe(fixed(np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]))),
        )
    ]
    * 2,
    function(fuzzykf.SwitchChain.from_classes, transition=stochastic(3), initial=maybe(probabilities(3))),
    function(fuzzykf.GaussianMembership, mean=array(2), covariance=covariance(2)),
    function(fuzzykf.CauchyMembership, center=array(2), scale=covariance(2)),
    function(fuzzykf.ParabolicMembership, center=array(2), scale=covariance(2)),
    function(fuzzykf.TriangularMembership, left=fixed(-1.0), peak=real(-1.0, 1.0), right=fixed(1.0)),
    function(fuzzykf.IntervalMembership, lower=array(2, scale=0.1), upper=fixed(np.array([1.0, 2.0]))),
    function(fuzzykf.SingletonMembership, point=array(2)),
    function(
        fuzzykf.GridMembership,
        axes=fixed([np.linspace(0.0, 1.0, 4)]),
        values=fixed(np.array([0.0, 0.4, 1.0, 0.2])),
        normalise=maybe(choice(True, False)),
    ),
    function(
        fuzzykf.FunctionMembership,
        function=fixed(specimens.tent),
        support=choice([-1.0, 1.0], [[-1.0, 1.0]]),
        normalise=maybe(choice(True, False)),
    ),
    function(memberships.CutMembership, base=NOISES, level_or_bounds=real(0.1, 0.9)),
    function(
        memberships.JointMembership,
        components=listed(made("TriangularMembership", "IntervalMembership"), 1, 2),
        t_norm=choice(norms.MIN, norms.PRODUCT),
    ),
    function(memberships.sampled, membership=NOISES, level=maybe(real(0.001, 0.5))),
]
