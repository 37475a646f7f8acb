"""The methods that are compared, each from a `Task` to a `Restoration`."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.base import FloatArray
    from fuzzykf.comparison.prepare import Task
    from fuzzykf.switching.tables import SwitchingSystem

__all__ = [
    "LinearModel",
    "Restoration",
    "fit_linear_model",
    "fuzzy_switches",
    "growth_notes",
    "hard_switches",
    "kalman_filter",
    "linear_regression",
]

#: A method's time per step is the least of this many passes over this many steps.
TIMED_PASSES, TIMED_STEPS = 5, 500


@dataclass(frozen=True, kw_only=True, eq=False)
class Restoration:
    """What one method says of the part to be restored.

    Attributes
    ----------
    name : str
        Name of the method.
    mean, std : ndarray, shape (n_test,)
        Its estimate of the state, and the standard deviation that it claims.
    log_likelihood : ndarray, shape (n_test,), or None
        Logarithm of the density of each observation given the earlier ones.
    microseconds : float
        Time of one step.
    switch : ndarray, shape (n_test,), or None
        Posterior mean of the switch.
    notes : tuple of str
        What a reader should know before trusting the method.
    """

    name: str
    mean: FloatArray
    std: FloatArray
    log_likelihood: FloatArray | None = None
    microseconds: float
    switch: FloatArray | None = None
    notes: tuple[str, ...] = ()


def fuzzy_switches(task: Task, n_nodes: int) -> Restoration:
    """Restore with `OFSRFilter`, on a fuzzy model learned from state, observation and switch.

    Parameters
    ----------
    task : Task
    n_nodes : int
        Nodes of the switch between 0 and 1; time grows as ``(n_nodes + 2) ** 2``.
    """
    from fuzzykf.switching import CGOFMSModel, OFSRFilter

    fit = CGOFMSModel.fit(*_learning_part(task), law="fmc1", form="regression")
    system = fit.model.on_nodes(n_nodes, "cell")
    restored = _switching("OFSRFilter", OFSRFilter(fit.model, n_nodes=n_nodes, rule="cell"), task)
    return replace(restored, notes=(*fit.warnings, *growth_notes(system)))


def hard_switches(task: Task) -> Restoration:
    """Restore with `CGOMSMFilter`, on a model of two classes: the switch, rounded."""
    from fuzzykf.switching import CGOMSMFilter, CGOMSModel

    x, y, r = _learning_part(task)
    fit = CGOMSModel.fit(x, y, (r >= 0.5).astype(np.float64), n_switches=2)
    restored = _switching("CGOMSMFilter", CGOMSMFilter(fit.model), task)
    return replace(restored, notes=(*fit.warnings, *growth_notes(fit.model.on_nodes())))


def growth_notes(system: SwitchingSystem) -> list[str]:
    """Say whether the error of the state grows while the switch stays where it is.

    The observation does not depend on the state before it, so the filter of the state has no
    feedback: what it errs is multiplied by Axx at each step.  A learned Axx above one makes it
    drift for as long as the switch is believed to stay.

    Parameters
    ----------
    system : SwitchingSystem

    Returns
    -------
    list of str
        Empty, or one sentence about the worst node.
    """
    n_nodes = len(system.chain.nodes)
    stay = system.pair_tables(0).pairs.Axx[np.arange(n_nodes), np.arange(n_nodes)]
    growth = np.abs(np.linalg.eigvals(stay)).max(axis=-1)
    worst = int(np.argmax(growth))
    if growth[worst] < 1.0:
        return []
    return [
        f"while the switch stays at {system.chain.nodes[worst]:.3g}, the error of the state grows by "
        f"{growth[worst] - 1.0:.2g} of itself in a step, and no observation corrects it"
    ]


def _learning_part(task: Task) -> tuple[FloatArray, FloatArray, FloatArray]:
    n = task.n_train
    return task.state[:n], task.observation[:n], task.switch[:n]


def _switching(name: str, switching_filter: Any, task: Task) -> Restoration:
    zs = task.observation[task.n_train :]
    result = switching_filter.filter(zs)
    return Restoration(
        name=name,
        mean=result.x[:, 0],
        std=np.sqrt(result.P[:, 0, 0]),
        log_likelihood=result.log_likelihood,
        microseconds=_microseconds(switching_filter.step, zs),
        switch=result.switch_mean,
    )


# --------------------------------------------------------------------------- one linear model


@dataclass(frozen=True, eq=False)
class LinearModel:
    """The law of (X, Y) as one Gaussian autoregression of order one.

    (X', Y') = offset + transition (X, Y) + N(0, noise), the best linear model of that
    order: the usual X' = a X + U, Y' = b X' + V, whatever the correlation of U and V, is a
    special case.

    Attributes
    ----------
    transition, noise : ndarray, shape (2, 2)
    offset : ndarray, shape (2,)
    mean, covariance : ndarray, shapes (2,) and (2, 2)
        Moments of (X, Y) in the learning part, from which the filter starts.
    """

    transition: FloatArray
    offset: FloatArray
    noise: FloatArray
    mean: FloatArray
    covariance: FloatArray


def fit_linear_model(state: FloatArray, observation: FloatArray) -> LinearModel:
    """Fit a `LinearModel` by maximum likelihood, given the first row: by least squares.

    Parameters
    ----------
    state, observation : ndarray, shape (n,)

    Returns
    -------
    LinearModel
    """
    z = np.column_stack([state, observation])
    mean = z.mean(axis=0)
    deviation = z - mean
    design = np.column_stack([np.ones(len(z) - 1), deviation[:-1]])
    coefficients, *_ = np.linalg.lstsq(design, deviation[1:])
    residual = deviation[1:] - design @ coefficients
    transition = coefficients[1:].T
    return LinearModel(
        transition=transition,
        offset=coefficients[0] + mean - transition @ mean,
        noise=residual.T @ residual / len(residual),
        mean=mean,
        covariance=deviation.T @ deviation / len(z),
    )


def kalman_filter(task: Task) -> Restoration:
    """Restore with filterpy's KalmanFilter on the best single linear model.

    Its state is (X, Y), of which Y is observed without noise: see `LinearModel`.

    Parameters
    ----------
    task : Task

    Raises
    ------
    MissingDependencyError
        If filterpy is not installed.
    """
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError as error:
        raise MissingDependencyError(
            "the comparison needs filterpy: pip install 'fuzzykf[compare]'"
        ) from error
    n = task.n_train
    model = fit_linear_model(task.state[:n], task.observation[:n])
    kf = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kf.x, kf.P = model.mean[:, None].copy(), model.covariance.copy()
    kf.F, kf.B, kf.Q = model.transition, model.offset[:, None], model.noise
    kf.H, kf.R = np.array([[0.0, 1.0]]), np.zeros((1, 1))
    u = np.ones((1, 1))

    zs = task.observation[n:]
    mean, variance, log_likelihood = np.empty((3, len(zs)))
    for k, z in enumerate(zs):
        if k > 0:  # the first observation belongs to the law that the filter starts from
            kf.predict(u)
        kf.update(z)
        mean[k], variance[k], log_likelihood[k] = kf.x[0, 0], kf.P[0, 0], kf.log_likelihood

    def step(z: float) -> None:
        kf.predict(u)
        kf.update(z)

    return Restoration(
        name="KalmanFilter (filterpy)",
        mean=mean,
        std=np.sqrt(variance),
        log_likelihood=log_likelihood,
        microseconds=_microseconds(step, zs),
    )


def linear_regression(task: Task) -> Restoration:
    """Restore by a straight line through the learning part: no dynamics, no switch.

    It has no law of the observation, and so no likelihood.

    Parameters
    ----------
    task : Task
    """
    n = task.n_train
    y_mean = task.observation[:n].mean()
    design = np.column_stack([np.ones(n), task.observation[:n] - y_mean])
    (level, slope), *_ = np.linalg.lstsq(design, task.state[:n])
    residual = task.state[:n] - design @ np.array([level, slope])
    zs = task.observation[n:]
    intercept = float(level - slope * y_mean)
    return Restoration(
        name="linear regression",
        mean=intercept + slope * zs,
        std=np.full(len(zs), np.sqrt(residual @ residual / (n - 2))),
        microseconds=_microseconds(lambda z: intercept + slope * z, zs),
    )


def _microseconds(step: Callable[[float], object], zs: FloatArray) -> float:
    """Time of one call of ``step``: the least mean over several passes, in microseconds."""
    values = zs[:TIMED_STEPS].tolist()
    passes = []
    for _ in range(TIMED_PASSES):
        start = time.perf_counter()
        for z in values:
            step(z)
        passes.append(time.perf_counter() - start)
    return 1e6 * min(passes) / len(values)
