"""Every public function, with the kinds of its arguments."""

from __future__ import annotations

from typing import Any

import specimens
from calls_arguments import (
    array,
    choice,
    count,
    covariance,
    fixed,
    generator,
    listed,
    maybe,
    observation,
    real,
    series,
    shares,
    trusted,
)
from calls_constructors import COMPARE, SOME_CONORM, SOME_NORM, SQUARES
from calls_verbs import TIME, Verb, function, made

import fuzzykf
from fuzzykf import base, comparison, datasets, io, kalman, possibility, preprocessing, results, testing
from fuzzykf.possibility import norms

__all__ = ["FUNCTIONS"]


def read(cls: Any, name: str) -> tuple[str, None, list[Verb]]:
    """Describe loading a file of a class."""

    def load(path: Any = None, max_bytes: Any = None) -> Any:
        if isinstance(path, str) and path.endswith("there.json"):
            specimens.specimen(name).save(path)
        return cls.load(path, max_bytes=max_bytes)

    load.__qualname__ = f"{name}.load"
    return function(load, path=fixed("file:there.json"), max_bytes=maybe(count(1, 10**6)))


#: Estimators of all representations.
ESTIMATORS = choice(
    *(make() for make in (specimens.linear_estimator, specimens.box_estimator, specimens.grid_estimator))
)

#: Functions, in the same form.
FUNCTIONS: list[tuple[str, None, list[Verb]]] = [
    function(norms.as_t_norm, infinite=True, t_norm=SOME_NORM),
    function(norms.as_t_conorm, infinite=True, t_conorm=SOME_CONORM, continuum=maybe(choice(True, False))),
    function(
        possibility.compose,
        fuzzy_set=shares(3),
        relation=shares(3, 2),
        t_norm=maybe(SOME_NORM),
        t_conorm=maybe(SOME_CONORM),
    ),
    function(
        possibility.extend,
        fuzzy_set=shares(3),
        images=array(3),
        universe=array(4),
        nearest=maybe(choice(True, False)),
        t_conorm=maybe(SOME_CONORM),
    ),
    *[
        function(one, est=ESTIMATORS, n=count(1, 6), level=maybe(real(0.0, 1.0)), x=maybe(array(1)))
        for one in (possibility.observability, possibility.controllability)
    ],
    function(
        possibility.fuzzify,
        point=array(2),
        kind=maybe(choice("singleton", "gaussian")),
        covariance=maybe(covariance(2)),
    ),
    function(
        possibility.Rule,
        antecedents=fixed((specimens.specimen("IntervalMembership"),)),
        consequent=made("IntervalMembership"),
    ),
    function(
        possibility.RuleBase.from_function,
        f=fixed(specimens.bent),
        arg=array(3),
        t_norm=maybe(SOME_NORM),
        t_conorm=maybe(SOME_CONORM),
    ),
    function(
        kalman.predict,
        x=array(2, 1),
        P=covariance(2),
        **SQUARES,
        u=maybe(array(2, 1)),
        alpha=maybe(real(1.0, 1.1)),
    ),
    function(
        kalman.update,
        x=array(2, 1),
        P=covariance(2),
        z=observation(1),
        R=covariance(1),
        H=array(1, 2),
        return_all=maybe(choice(True, False)),
    ),
    function(kalman.predict_steadystate, x=array(2, 1), F=array(2, 2), u=maybe(array(2, 1))),
    function(kalman.update_steadystate, x=array(2, 1), z=observation(1), K=array(2, 1), H=array(1, 2)),
    function(
        kalman.batch_filter,
        x=array(2, 1),
        P=covariance(2),
        zs=series(1, 3, 3),
        Fs=listed(array(2, 2), 3, 3),
        Qs=listed(covariance(2), 3, 3),
        Hs=listed(array(1, 2), 3, 3),
        Rs=listed(covariance(1), 3, 3),
        update_first=maybe(choice(True, False)),
    ),
    function(
        kalman.rts_smoother,
        Xs=array(3, 2, 1),
        Ps=covariance(3, 2),
        Fs=listed(array(2, 2), 3, 3),
        Qs=listed(covariance(2), 3, 3),
    ),
    function(preprocessing.hour_of_day, time=TIME),
    function(
        fuzzykf.clock_inputs,
        time=TIME,
        harmonics=maybe(count(1, 24)),
        workday=maybe(choice(True, False)),
        day_of_year=maybe(choice(True, False)),
    ),
    function(fuzzykf.DailyProfile, slot=maybe(choice(1.0, 0.5, 24, 2))),
    function(
        fuzzykf.compare_models,
        gaps=True,  # no law of the observation, no likelihood
        **COMPARE,
        rng=generator(),
        candidates=choice(["hard1"], ["regression"], ("kalman",)),
        n_folds=maybe(count(2, 2, work=True)),
        first=maybe(real(0.63, 0.7)),
        window=maybe(choice("expanding", "sliding")),
        max_iter=count(1, 2, work=True),
        n_resamples=fixed(100),
    ),
    function(
        comparison.bootstrap_rmse,
        squared=shares(60, 2),
        n_resamples=count(100, 150, work=True),
        rng=generator(),
    ),
    function(comparison.block_length, series=array(60)),
    function(
        comparison.circular_block_means,
        series=array(60),
        length=count(1, 9),
        n_resamples=count(1, 9, work=True),
        rng=generator(),
    ),
    function(
        comparison.prepare,
        state=COMPARE["x"],
        observation=COMPARE["y"],
        train=maybe(real(0.63, 0.68)),
        switch=maybe(choice("learned", "quantiles")),
    ),
    function(comparison.quantile_switch, learning=array(60)),
    function(comparison.candidate, name=choice("hard1", "imm", "kalman")),
    function(base.as_observation, z=observation(2), dim_z=trusted(2)),
    function(base.as_observations, zs=series(2), dim_z=trusted(2)),
    function(base.as_many, zs=array(2, 3, 2), dim_z=trusted(2)),
    function(base.check_keep, keep=choice("x", ["x", "P"]), admissible=trusted(("x", "P"))),
    function(results.bic, n_parameters=count(1, 9), n_observations=count(1, 99), log_likelihood=real(-9, 9)),
    function(results.field_shapes, names=choice(["x"], ("x", "P")), state=count(1, 3)),
    function(
        testing.check_filter, factory=choice(specimens.kalman, specimens.extended), zs=maybe(array(6, 1))
    ),
    *[
        read(getattr(fuzzykf, name), name)
        for name in ("CGOFMSModel", "CGOMSModel", "CGLSSM", "OFSRFilter", "CGOMSMFilter")
    ],
    function(
        datasets.read_table,
        path=fixed("file:nowhere.csv"),
        sep=maybe(choice(",", ";", "\t")),
        decimal=maybe(choice(".", ",")),
        max_bytes=maybe(count(1, 10**6)),
    ),
    function(io.load_model, path=fixed("file:nowhere.json")),
    function(io.load_filter, path=fixed("file:nowhere.json"), max_bytes=maybe(count(1, 10**6))),
    function(io.save_model, model=made("CGOMSModel", "CGLSSM", "CGOFMSModel"), path=fixed("file:model.json")),
    function(io.save_filter, filter_=made("CGOMSMFilter", "OFSRFilter"), path=fixed("file:filter.json")),
]
