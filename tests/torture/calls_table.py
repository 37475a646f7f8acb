"""What can be called: objects and their verbs, constructors and functions, each with the kinds of its arguments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

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
    observation,
    probabilities,
    real,
    series,
    shares,
    stochastic,
    trusted,
)

import fuzzykf
from fuzzykf import base, comparison, io, kalman, possibility, preprocessing, results, switching, testing
from fuzzykf.possibility import memberships, norms

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Verb", "drawn"]


@dataclass(frozen=True)
class Verb:
    """Something that can be called.

    Attributes
    ----------
    name : str
    arguments : dict of str to Kind
        In order; those whose name begins with "arg" have no name in the call.
    of : callable
        Of the object: what is called.
    infinite : bool
        Whether infinity may be among what is returned.
    gaps : bool
        Whether NaN may, too.
    """

    name: str
    arguments: dict[str, Kind]
    of: Callable[[Any], Any]
    infinite: bool = False
    gaps: bool = False


def verb(name: str, *, infinite: bool = False, gaps: bool = False, **arguments: Kind) -> Verb:
    """Describe a method."""
    return Verb(name, arguments, lambda target: getattr(target, name), infinite, gaps)


def function(call: Any, *, infinite: bool = False, **arguments: Kind) -> tuple[str, None, list[Verb]]:
    """Describe a function or a constructor."""
    return "", None, [Verb(call.__qualname__, arguments, lambda _: call, infinite)]


def assign(attribute: str, kind: Kind) -> Verb:
    """Describe what happens when an attribute is assigned."""
    return Verb(
        f"set {attribute}", {"arg": kind}, lambda target: lambda value: setattr(target, attribute, value)
    )


# --------------------------------------------------------------------------- filters

KEEP = maybe(choice("x", ["x", "P"], ("log_likelihood",), ["mu"], [], ["nonsense"]))
KINDS_OF_NODES = choice("cell", "midpoint", "gauss", "product")


def common(q: int, **extra: Kind) -> list[Verb]:
    """Return the verbs of every filter; ``extra`` is needed beside the data."""
    many = Kind(lambda rng: rng.normal(size=(rng.integers(1, 4), rng.integers(0, 5), q)))
    return [
        *[verb("step", z=observation(q), **{k: v for k, v in extra.items() if k == "u"})] * 3,
        *[verb("update", z=observation(q))] * 2,
        *[verb("filter", zs=series(q), **extra)] * 2,
        verb("batch_filter", zs=series(q, 1), **extra),
        verb("filter_many", zs=many, keep=KEEP),
        verb("reset"),
        verb("copy"),
    ]


def switching_verbs(q: int) -> list[Verb]:
    """Return the verbs of a filter with a hidden switch."""
    return [
        *common(q),
        verb("predict"),
        verb("smooth", zs=series(q), keep_nodes=maybe(choice(True, False))),
        verb("filter", zs=series(q), keep_nodes=choice(True, False)),
        verb("forecast", steps=count(1, 5)),
        verb("filter_many", zs=array(2, 3, q), threads=count(1, 2)),
        verb("save", path=fixed("file:filter.json")),
        verb("to_dict"),
    ]


def known_verbs(q: int) -> list[Verb]:
    """Return the verbs of a filter with a known switch."""
    r, rs = maybe(choice(0.0, 1.0, 1)), choice(np.zeros(4), np.array([0.0, 1.0, 1.0, 0.0]))
    return [
        *[verb("step", z=observation(q), r=r)] * 3,
        verb("predict", r=r),
        verb("update", z=observation(q), r=r),
        *[verb(name, zs=series(q, 4, 4), r=rs) for name in ("filter", "smooth", "batch_filter")],
        verb("filter_many", zs=array(2, 4, q), keep=KEEP, r=rs),
        verb("forecast", steps=count(1, 5)),
        verb("reset"),
    ]


def kalman_verbs(q: int) -> list[Verb]:
    """Return the verbs of a Kalman filter of two components."""
    u, F, H, B = maybe(array(1, 1)), array(2, 2), array(q, 2), array(2, 1)
    Q, R = covariance(2), covariance(q)
    per_step = [maybe(listed(kind, 4, 4)) for kind in (F, Q, H, R, B, array(1, 1))]
    names = ("Fs", "Qs", "Hs", "Rs", "Bs", "us")
    return [
        *common(q),
        *[verb("predict", u=u, B=maybe(B), F=maybe(F), Q=maybe(Q))] * 2,
        verb("update", z=observation(q), R=maybe(R), H=maybe(H)),
        verb("update_correlated", z=observation(q), R=maybe(R), H=maybe(H)),
        verb("update_sequential", start=count(0, q - 1), z_i=array(1), R_i=maybe(covariance(1)), H_i=maybe(array(1, 2))),
        verb("predict_steadystate", u=u, B=maybe(B)),
        verb("update_steadystate", z=observation(q)),
        verb("get_prediction", u=u, B=maybe(B), F=maybe(F), Q=maybe(Q)),
        verb("get_update", z=observation(q)),
        verb("log_likelihood_of", infinite=True, z=observation(q)),
        verb("measurement_of_state", x=array(2, 1)),
        verb("residual_of", z=array(q, 1)),
        verb("test_matrix_dimensions", z=maybe(array(q, 1)), H=maybe(H), R=maybe(R), F=maybe(F), Q=maybe(Q)),
        verb("smooth", zs=series(q), us=maybe(fixed(None))),
        verb("filter", zs=series(q, 4, 4), us=listed(array(1, 1), 4, 4)),
        verb("filter_many", zs=array(2, 4, q), us=maybe(array(4, 1))),
        verb("rts_smoother", Xs=array(4, 2, 1), Ps=covariance(4, 2), Fs=maybe(listed(F, 4, 4)), Qs=maybe(listed(Q, 4, 4))),
        verb("batch_filter", zs=series(q, 4, 4), update_first=maybe(choice(True, False)), **dict(zip(names, per_step, strict=True))),
        *[assign(name, kind) for name, kind in zip("xPFQRHB", (array(2, 1), covariance(2), F, Q, R, H, B), strict=True)],
        assign("alpha", real(1.0, 1.2)),
    ]  # fmt: skip


def extended_verbs() -> list[Verb]:
    """Return the verbs of an extended Kalman filter."""
    see = {"HJacobian": maybe(fixed(specimens.distance_jacobian)), "Hx": maybe(fixed(specimens.distance))}
    return [
        *common(1),
        verb("predict", u=maybe(real(-1, 1))),
        verb("predict_x", u=maybe(real(-1, 1))),
        verb("update", z=observation(1), R=maybe(covariance(1)), residual=maybe(fixed(np.subtract)), **see),
        verb("predict_update", z=observation(1), args=maybe(fixed(())), u=maybe(real(-1, 1)), **see),
        verb("filter", zs=series(1, 3, 3), us=maybe(array(3)), hx_args=maybe(fixed([{}, None, {}]))),
        verb("smooth", zs=series(1)),
        *[assign(name, kind) for name, kind in zip("xPQR", (array(2, 1), covariance(2), covariance(2), covariance(1)), strict=True)],
    ]  # fmt: skip


def bank_verbs() -> list[Verb]:
    """Return the verbs of a bank of filters."""
    u = array(1, 1)
    return [
        *common(1),
        verb("predict", u=maybe(u)),
        verb("filter", zs=series(1, 3, 3), us=listed(u, 3, 3)),
        assign("mu", probabilities(2)),
        assign("M", stochastic(2)),
        assign("x", array(2, 1)),
    ]


def possibility_verbs(noise: Kind) -> list[Verb]:
    """Return the verbs of a possibilistic estimator."""
    return [
        *common(1),
        verb("predict", u=maybe(fixed(None)), Q=maybe(covariance(1)), F=maybe(array(1, 1))),
        verb("update", z=observation(1), R=maybe(covariance(1)), H=maybe(array(1, 1))),
        verb("defuzzify", method=choice("centroid", "mean_of_maximum", "peak")),
        *[assign(name, noise) for name in ("membership", "process_noise", "measurement_noise")],
        *[assign(name, kind) for name, kind in zip("xPQR", (array(1, 1), *[covariance(1)] * 3), strict=True)],
    ]


# --------------------------------------------------------------------------- everything else


def made(*names: str) -> Kind:
    """One of some specimens."""
    return Kind(lambda rng: specimens.specimen(names[rng.integers(len(names))]))


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


TIME = fixed(specimens.times())
DAYS = maybe(Kind(lambda rng: rng.integers(0, 2, 48).astype(bool)))

#: Objects: a specimen's name and its verbs.
OBJECTS: dict[str, list[Verb]] = {
    **{name: switching_verbs(specimens.FILTERS[name][0]) for name in specimens.FILTERS if name[:4] in ("OFSR", "CGOM")},
    **{name: known_verbs(specimens.FILTERS[name][0]) for name in specimens.FILTERS if name.startswith("Known")},
    **{name: kalman_verbs(specimens.FILTERS[name][0]) for name in specimens.FILTERS if name.startswith("Kalman")},
    "ExtendedKalmanFilter": extended_verbs(),
    "IMMEstimator": bank_verbs(),
    "IMMEstimator, gpb2": bank_verbs(),
    "FuzzyRelationEstimator": possibility_verbs(Kind(lambda rng: memberships.GaussianMembership([rng.normal()], [[0.5]]))),
    "FuzzyRelationEstimator, box": possibility_verbs(made("IntervalMembership")),
    "FuzzyRelationEstimator, grid": possibility_verbs(made("TriangularMembership", "IntervalMembership")),
    **{name: model_verbs(1, 1) for name in specimens.OTHERS if name.startswith("CGO")},
    "CGLSSM": [verb("simulate", n=count(0, 6, work=True), rng=generator()), verb("stationary_covariance"), verb("save", path=fixed("file:model.json"))],
    "CGOMSModel, steady ": [verb("closeness", weights=maybe(shares(2)))],
    **{name: law_verbs() for name in specimens.OTHERS if name.startswith("FuzzyMarkovLaw")},
    **{name: [verb("sample", n=count(0, 6, work=True), rng=generator())] for name in ("SwitchChain", "SwitchChain, classes")},
    "FilterResult": [verb("interval", level=real(0.1, 0.99)), verb("to_dataframe", index=maybe(fixed(range(6)))), verb("plot", component=count(0, 0), level=real(0.1, 0.9))],
    **{name: membership_verbs(2 if name[:5] in ("Gauss", "Joint") else 1) for name in specimens.OTHERS if name.endswith("Membership")},
    **{name: norm_verbs() for name in specimens.OTHERS if name.startswith("TNorm")},
    **{name: [verb("__call__", memberships=shares(3, 2), axis=maybe(choice(0, 1, -1, (0, 1), None)))] for name in specimens.OTHERS if name.startswith("TConorm")},
    "Standardizer": preparation_verbs((6, 2)),
    "DailyProfile": [*preparation_verbs((48,), time=TIME, workday=DAYS), verb("at", time=TIME, workday=DAYS)],
    "ModelComparison": [verb("verdict", unit=maybe(fixed("MW"))), Verb("to_dataframe", {"by_fold": maybe(choice(True, False))}, without_clocks, gaps=True)],
    "RuleBase": [verb("predict", sets=fixed([np.array([0.2, 1.0, 0.3])]), universes=listed(array(3), 2, 2)), verb("relation", universes=listed(array(3), 2, 2))],
}  # fmt: skip

del OBJECTS["CGOMSModel, steady "]
OBJECTS["CGOMSModel, steady"] = [
    *OBJECTS["CGOMSModel, steady"],
    verb("closeness", weights=maybe(probabilities(2))),
]


# --------------------------------------------------------------------------- constructors and functions

K, D = 2, 2  # regimes; components of the state and the observation together
REGRESSIONS = {
    "Ayy": array(K, K, 1, 1), "Ny": array(K, K, 1), "Qyy": covariance(K, K, 1), "Axx": array(K, K, 1, 1),
    "H": array(K, K, 1, 1), "G": array(K, K, 1, 1), "c": array(K, K, 1), "C": covariance(K, K, 1),
    "means": array(K, D), "covariances": covariance(K, D),
}  # fmt: skip
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
    "x": Kind(lambda rng: specimens.sample(30).x), "y": Kind(lambda rng: specimens.sample(30).y),
    "r": maybe(Kind(lambda rng: np.round(specimens.sample(30).r))),
}  # fmt: skip
ONE = array(1)
EKF = {
    "fx": maybe(fixed(specimens.drift)), "FJacobian": maybe(fixed(specimens.drift_jacobian)),
    "hx": maybe(fixed(specimens.distance)), "HJacobian": maybe(fixed(specimens.distance_jacobian)),
}  # fmt: skip
WHAT = {"x": maybe(array(2)), "P": maybe(covariance(2)), "F": maybe(array(2, 2)), "Q": maybe(covariance(2)), "R": maybe(covariance(1))}  # fmt: skip
NOISES = made("GaussianMembership", "IntervalMembership", "TriangularMembership", "CauchyMembership")
SOME_NORM, SOME_CONORM = choice("product", "min", "hamacher", "lukasiewicz"), choice("max", "probabilistic_sum", "bounded_sum")  # fmt: skip
COMPARE = {
    "x": Kind(lambda rng: specimens.sample(160).x[:, 0]),
    "y": Kind(lambda rng: specimens.sample(160).y[:, 0]),
}
SQUARES = {"F": array(2, 2), "Q": covariance(2)}


def read(cls: Any, name: str) -> tuple[str, None, list[Verb]]:
    """Describe loading a file of a class."""

    def load(path: Any = None, max_bytes: Any = None) -> Any:
        if isinstance(path, str) and path.endswith("there.json"):
            specimens.specimen(name).save(path)
        return cls.load(path, max_bytes=max_bytes)

    load.__qualname__ = f"{name}.load"
    return function(load, path=fixed("file:there.json"), max_bytes=maybe(count(1, 10**6)))


#: Constructors and functions, in threes of no name, no object, and the one verb.
FUNCTIONS: list[tuple[str, None, list[Verb]]] = [
    function(fuzzykf.KalmanFilter, dim_x=fixed(2), dim_z=fixed(1), dim_u=maybe(count(0, 2)), H=maybe(array(1, 2)), B=maybe(array(2, 1)), **WHAT),
    function(fuzzykf.ExtendedKalmanFilter, dim_x=fixed(2), dim_z=fixed(1), dim_u=maybe(count(0, 2)), **EKF, **WHAT),
    function(fuzzykf.IMMEstimator, filters=Kind(lambda rng: specimens.bank().filters), mu=probabilities(2), M=stochastic(2), method=maybe(choice("imm", "gpb2"))),
    function(fuzzykf.FuzzyRelationEstimator, dim_x=fixed(1), dim_z=fixed(1), dim_u=maybe(count(0, 1)), fx=maybe(fixed(specimens.bent)), hx=maybe(fixed(specimens.identity)),
             state=maybe(NOISES), process_noise=maybe(NOISES), measurement_noise=maybe(NOISES), t_norm=maybe(SOME_NORM), t_conorm=maybe(SOME_CONORM),
             on_empty=maybe(choice("raise", "keep", "reset")), points=maybe(count(5, 50)), domain=maybe(fixed([[-3.0, 3.0]])), floor=maybe(real(0.001, 0.1))),
    function(fuzzykf.OFSRFilter, model=made("CGOFMSModel"), n_nodes=maybe(count(0, 6)), rule=maybe(KINDS_OF_NODES)),
    function(fuzzykf.CGOMSMFilter, model=made("CGOMSModel", "CGOMSModel, steady")),
    function(fuzzykf.KnownSwitchFilter, model=made("CGOMSModel", "CGOFMSModel")),
    *[function(fuzzykf.CGOFMSModel, law=LAW, means=array(2, 2), covariances=PAIRS, dim_x=fixed(1), interpolation=maybe(choice("covariance", "transition")), constraint=maybe(choice("project", "check")))] * 2,
    function(fuzzykf.CGOFMSModel.from_regressions, law=LAW, **REGRESSIONS),
    function(fuzzykf.CGOMSModel, transition=stochastic(2), means=array(2, 2), covariances=PAIRS, dim_x=fixed(1), initial=maybe(probabilities(2))),
    function(fuzzykf.CGOMSModel.from_regressions, transition=stochastic(2), initial=maybe(probabilities(2)), **REGRESSIONS),
    function(fuzzykf.CGOMSModel.from_transitions, transition=stochastic(2), dim_x=fixed(1), **{name: Kind(lambda rng, k=k: specimens.transitions(2, 1, 1)[k]) for k, name in enumerate(("A", "Q", "means", "covariances"))}),
    *[function(fuzzykf.CGOMSModel.from_cglssm, **LINEAR, initial_probability=maybe(probabilities(2)), initial_covariance=maybe(covariance(2, 1)), order=maybe(count(1, 2)), mode=maybe(choice("stationary", "time_varying")))] * 2,
    function(fuzzykf.CGLSSM, **LINEAR, initial_probability=maybe(probabilities(2)), initial_covariance=maybe(covariance(2, 1))),
    function(switching.shrink_covariances, switch=LAW, means=array(2, 2), covariances=PAIRS, dim_x=fixed(1)),
    function(fuzzykf.CGOFMSModel.fit, **LEARN, **SEARCH, n_nodes=maybe(count(1, 3)), law=maybe(choice("fmc1", "fmc2", "free")), form=fixed("covariance"), tolerance=maybe(real(1e-6, 0.1))),
    *[function(fuzzykf.CGOMSModel.fit, **LEARN, **SEARCH, n_switches=maybe(count(1, 2)), form=maybe(choice("covariance", "regression", "auto")), tolerance=maybe(real(1e-6, 0.1)))] * 2,
    *[function(fuzzykf.FuzzyMarkovLaw.fmc1, alpha=real(0.01, 0.1), delta=real(0.01, 0.1), eta=real(0.01, 0.2))] * 2,
    *[function(fuzzykf.FuzzyMarkovLaw.fmc2, alpha=real(0.01, 0.2), gamma=real(0.1, 0.9), delta=real(0.01, 0.3))] * 2,
    function(fuzzykf.FuzzyMarkovLaw.from_density, corners=fixed(np.array([[0.2, 0.05], [0.05, 0.2]])), edges=choice(0.1, specimens.edge), interior=fixed(0.1), kinks=maybe(choice((0.0,), [0.3]))),
    *[function(fuzzykf.SwitchChain, nodes=fixed(np.array([0.0, 0.5, 1.0])), weights=fixed(np.ones(3) / 3), initial=probabilities(3), transition=stochastic(3), class_weights=maybe(fixed(np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]))))] * 2,
    function(fuzzykf.SwitchChain.from_classes, transition=stochastic(3), initial=maybe(probabilities(3))),
    function(fuzzykf.GaussianMembership, mean=array(2), covariance=covariance(2)),
    function(fuzzykf.CauchyMembership, center=array(2), scale=covariance(2)),
    function(fuzzykf.ParabolicMembership, center=array(2), scale=covariance(2)),
    function(fuzzykf.TriangularMembership, left=fixed(-1.0), peak=real(-1.0, 1.0), right=fixed(1.0)),
    function(fuzzykf.IntervalMembership, lower=array(2, scale=0.1), upper=fixed(np.array([1.0, 2.0]))),
    function(fuzzykf.SingletonMembership, point=array(2)),
    function(fuzzykf.GridMembership, axes=fixed([np.linspace(0.0, 1.0, 4)]), values=fixed(np.array([0.0, 0.4, 1.0, 0.2])), normalise=maybe(choice(True, False))),
    function(fuzzykf.FunctionMembership, function=fixed(specimens.tent), support=choice([-1.0, 1.0], [[-1.0, 1.0]]), normalise=maybe(choice(True, False))),
    function(memberships.CutMembership, base=NOISES, level_or_bounds=real(0.1, 0.9)),
    function(memberships.JointMembership, components=listed(made("TriangularMembership", "IntervalMembership"), 1, 2), t_norm=choice(norms.MIN, norms.PRODUCT)),
    function(memberships.sampled, membership=NOISES, level=maybe(real(0.001, 0.5))),
    function(norms.as_t_norm, infinite=True, t_norm=SOME_NORM),
    function(norms.as_t_conorm, infinite=True, t_conorm=SOME_CONORM, continuum=maybe(choice(True, False))),
    function(possibility.compose, fuzzy_set=shares(3), relation=shares(3, 2), t_norm=maybe(SOME_NORM), t_conorm=maybe(SOME_CONORM)),
    function(possibility.extend, fuzzy_set=shares(3), images=array(3), universe=array(4), nearest=maybe(choice(True, False)), t_conorm=maybe(SOME_CONORM)),
    function(possibility.fuzzify, point=array(2), kind=maybe(choice("singleton", "gaussian")), covariance=maybe(covariance(2))),
    function(possibility.Rule, antecedents=fixed((specimens.specimen("IntervalMembership"),)), consequent=made("IntervalMembership")),
    function(possibility.RuleBase.from_function, f=fixed(specimens.bent), arg=array(3), t_norm=maybe(SOME_NORM), t_conorm=maybe(SOME_CONORM)),
    function(kalman.predict, x=array(2, 1), P=covariance(2), **SQUARES, u=maybe(array(2, 1)), alpha=maybe(real(1.0, 1.1))),
    function(kalman.update, x=array(2, 1), P=covariance(2), z=observation(1), R=covariance(1), H=array(1, 2), return_all=maybe(choice(True, False))),
    function(kalman.predict_steadystate, x=array(2, 1), F=array(2, 2), u=maybe(array(2, 1))),
    function(kalman.update_steadystate, x=array(2, 1), z=observation(1), K=array(2, 1), H=array(1, 2)),
    function(kalman.batch_filter, x=array(2, 1), P=covariance(2), zs=series(1, 3, 3), Fs=listed(array(2, 2), 3, 3), Qs=listed(covariance(2), 3, 3), Hs=listed(array(1, 2), 3, 3), Rs=listed(covariance(1), 3, 3), update_first=maybe(choice(True, False))),
    function(kalman.rts_smoother, Xs=array(3, 2, 1), Ps=covariance(3, 2), Fs=listed(array(2, 2), 3, 3), Qs=listed(covariance(2), 3, 3)),
    function(preprocessing.hour_of_day, time=TIME),
    function(fuzzykf.DailyProfile, slot=maybe(choice(1.0, 0.5, 24, 2))),
    function(fuzzykf.compare_models, **COMPARE, rng=generator(), candidates=choice(["hard1"], ["regression"], ("kalman",)), n_folds=maybe(count(2, 2, work=True)), first=maybe(real(0.63, 0.7)), window=maybe(choice("expanding", "sliding")), max_iter=count(1, 2, work=True), n_resamples=fixed(100)),
    function(comparison.bootstrap_rmse, squared=shares(60, 2), n_resamples=count(100, 150, work=True), rng=generator()),
    function(comparison.block_length, series=array(60)),
    function(comparison.circular_block_means, series=array(60), length=count(1, 9), n_resamples=count(1, 9, work=True), rng=generator()),
    function(comparison.prepare, state=COMPARE["x"], observation=COMPARE["y"], train=maybe(real(0.63, 0.68)), switch=maybe(choice("learned", "quantiles"))),
    function(comparison.quantile_switch, learning=array(60)),
    function(comparison.candidate, name=choice("hard1", "imm", "kalman")),
    function(base.as_observation, z=observation(2), dim_z=trusted(2)),
    function(base.as_observations, zs=series(2), dim_z=trusted(2)),
    function(base.as_many, zs=array(2, 3, 2), dim_z=trusted(2)),
    function(base.check_keep, keep=choice("x", ["x", "P"]), admissible=trusted(("x", "P"))),
    function(results.bic, n_parameters=count(1, 9), n_observations=count(1, 99), log_likelihood=real(-9, 9)),
    function(results.field_shapes, names=choice(["x"], ("x", "P")), state=count(1, 3)),
    function(testing.check_filter, factory=choice(specimens.kalman, specimens.extended), zs=maybe(array(6, 1))),
    *[read(getattr(fuzzykf, name), name) for name in ("CGOFMSModel", "CGOMSModel", "CGLSSM", "OFSRFilter", "CGOMSMFilter")],
    function(io.load_model, path=fixed("file:nowhere.json")),
    function(io.load_filter, path=fixed("file:nowhere.json"), max_bytes=maybe(count(1, 10**6))),
    function(io.save_model, model=made("CGOMSModel", "CGLSSM", "CGOFMSModel"), path=fixed("file:model.json")),
    function(io.save_filter, filter_=made("CGOMSMFilter", "OFSRFilter"), path=fixed("file:filter.json")),
]  # fmt: skip

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
        while True:
            name, target, verbs = FUNCTIONS[rng.integers(len(FUNCTIONS))]
            if rng.random() >= SLOW.get(verbs[0].name, 0.0):
                return name, target, verbs
    filters, others = names()
    group = filters if rng.random() < 0.7 else others
    name = group[rng.integers(len(group))]
    verbs = OBJECTS[name]
    picked = [verbs[rng.integers(len(verbs))] for _ in range(rng.integers(1, 7))]
    return name, specimens.specimen(name), [one for one in picked if rng.random() >= SLOW.get(one.name, 0.0)]
