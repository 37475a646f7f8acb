"""Filters of every kind and size, with random parameters that are drawn again from the same seed."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf import (
    CGOFMSModel,
    CGOMSMFilter,
    CGOMSModel,
    FuzzyMarkovLaw,
    IMMEstimator,
    KalmanFilter,
    KnownSwitchFilter,
    OFSRFilter,
)
from fuzzykf.switching.laws.cells import CellLaw

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["KINDS", "SIZES", "System", "system"]

#: Components of the state and of an observation.
SIZES = ((1, 1), (2, 1), (4, 2))

TRANSITION = np.array([[0.9, 0.1], [0.25, 0.75]])

Generator = np.random.Generator


@dataclass(frozen=True)
class System:
    """A way to make the same filter again and again.

    Attributes
    ----------
    make : callable
        Makes the filter.
    twin : callable or None
        Makes the filter of one regime that this one has to equal, since its regimes do not differ.
    knows_switch : bool
        Whether the value of the switch goes with each observation.
    cancels : bool
        Whether an outlier cancels to rounding in what comes after it, where no arithmetic of double
        precision knows more than the scale of the outlier times its rounding.
    """

    make: Callable[[], Any]
    twin: Callable[[], Any] | None = None
    knows_switch: bool = False
    cancels: bool = False

    def switches(self, n: int) -> dict[str, Any]:
        """Return what `filter` takes beside ``n`` observations: the switch, if it is known."""
        return {"r": np.arange(n) // 3 % 2 * 1.0} if self.knows_switch else {}


# --------------------------------------------------------------------------- parameters


def definite(rng: Generator, *shape: int) -> np.ndarray:
    """Draw covariances of about one; the last number of the shape is their size."""
    root = 0.3 * rng.normal(size=(*shape, shape[-1])) + 0.8 * np.eye(shape[-1])
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(shape[-1])


def contraction(rng: Generator, *shape: int) -> np.ndarray:
    """Draw matrices whose norm is below one."""
    size = shape[-1]
    drawn = rng.normal(size=(*shape, size)) / size
    return 0.5 * np.eye(size) + 0.3 * drawn / (1.0 + np.linalg.norm(drawn, axis=(-1, -2), keepdims=True))


def regressions(m: int, q: int, rng: Generator, regimes: int = 2) -> dict[str, np.ndarray]:
    """Draw what `from_regressions` takes."""
    pairs = (regimes, regimes)
    return {
        "Ayy": contraction(rng, *pairs, q),
        "Ny": 0.3 * rng.normal(size=(*pairs, q)),
        "Qyy": definite(rng, *pairs, q),
        "Axx": contraction(rng, *pairs, m),
        "H": 0.3 * rng.normal(size=(*pairs, m, q)),
        "G": 0.5 * rng.normal(size=(*pairs, m, q)),
        "c": 0.3 * rng.normal(size=(*pairs, m)),
        "C": definite(rng, *pairs, m),
        "means": rng.normal(size=(regimes, m + q)),
        "covariances": definite(rng, regimes, m + q),
    }


def repeated(one: dict[str, np.ndarray], regimes: int) -> dict[str, np.ndarray]:
    """Give several regimes the parameters of one."""
    return {
        name: np.tile(value[0], (regimes,) + (1,) * (value.ndim - 1))
        if name in ("means", "covariances")
        else np.tile(value[0, 0], (regimes, regimes) + (1,) * (value.ndim - 2))
        for name, value in one.items()
    }


def stationary_pairs(m: int, q: int, rng: Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw means and covariances (Z, Z') of a stationary model whose regimes differ in their means."""
    z = definite(rng, m + q)
    pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    return rng.normal(size=(2, m + q)), np.broadcast_to(pair, (2, 2, *pair.shape))


# --------------------------------------------------------------------------- switching filters


def fmc1(m: int, q: int, rng: Generator) -> System:
    """Make a fuzzy switch that is linear in the distance, on a stationary model."""
    model = CGOFMSModel(FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16), *stationary_pairs(m, q, rng), m)
    return System(lambda: OFSRFilter(model), cancels=True)


def fmc2(m: int, q: int, rng: Generator) -> System:
    """Make a fuzzy switch within a band, on regressions."""
    model = CGOFMSModel.from_regressions(FuzzyMarkovLaw.fmc2(0.12, 0.5, 0.17), **regressions(m, q, rng))
    return System(lambda: OFSRFilter(model))


def signed(m: int, q: int, rng: Generator) -> System:
    """Make a fuzzy switch by a product rule, some of whose weights are negative."""
    law = FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2)
    model = CGOFMSModel(law, *stationary_pairs(m, q, rng), m)
    return System(lambda: OFSRFilter(model, 8, "product"), cancels=True)


def free(m: int, q: int, rng: Generator) -> System:
    """Make a fuzzy switch of any chain on its nodes."""
    law = CellLaw(np.eye(4) + rng.uniform(0.05, 0.2, (4, 4)))
    model = CGOFMSModel.from_regressions(law, **regressions(m, q, rng))
    return System(lambda: OFSRFilter(model, 2))


def hard(m: int, q: int, rng: Generator) -> System:
    """Make three regimes that differ in everything."""
    transition = 0.1 + 0.7 * np.eye(3)
    model = CGOMSModel.from_regressions(transition, **regressions(m, q, rng, 3))
    return System(lambda: CGOMSMFilter(model))


def tied(m: int, q: int, rng: Generator) -> System:
    """Make two regimes that do not differ."""
    one = regressions(m, q, rng, 1)
    two = CGOMSModel.from_regressions(TRANSITION, **repeated(one, 2))
    alone = CGOMSModel.from_regressions([[1.0]], **one)
    return System(lambda: CGOMSMFilter(two), lambda: CGOMSMFilter(alone))


def converted(m: int, q: int, rng: Generator, order: int) -> System:
    """Make the model near a switching state-space model, steady."""
    matrices = {
        "A": contraction(rng, 2, m),
        "B": rng.normal(size=(2, q, m)),
        "C": np.linalg.cholesky(definite(rng, 2, m)),
        "D": np.linalg.cholesky(definite(rng, 2, q)),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how near is of no matter here
        model = CGOMSModel.from_cglssm(TRANSITION, **matrices, order=order)
    return System(lambda: CGOMSMFilter(model))


def known(m: int, q: int, rng: Generator) -> System:
    """Make regimes of which the present one is told."""
    model = CGOMSModel.from_regressions(TRANSITION, **regressions(m, q, rng))
    return System(lambda: KnownSwitchFilter(model), knows_switch=True)


# --------------------------------------------------------------------------- the Kalman layer


def kalman_parameters(m: int, q: int, rng: Generator) -> dict[str, np.ndarray]:
    """Draw what a Kalman filter is given."""
    F, H = contraction(rng, m) + 0.4 * np.eye(m), rng.normal(size=(q, m))
    return {"F": F, "H": H, "Q": 0.3 * definite(rng, m), "R": definite(rng, q)}


def kalman_filter(m: int, q: int, parameters: dict[str, np.ndarray]) -> KalmanFilter:
    """Make a Kalman filter with these."""
    return KalmanFilter(m, q, **{name: value.copy() for name, value in parameters.items()})


def kalman(m: int, q: int, rng: Generator) -> System:
    """Make a Kalman filter."""
    parameters = kalman_parameters(m, q, rng)
    return System(lambda: kalman_filter(m, q, parameters))


def imm(m: int, q: int, rng: Generator, method: str = "imm") -> System:
    """Make a bank of two Kalman filters that differ."""
    modes = [kalman_parameters(m, q, rng) for _ in range(2)]

    def bank() -> IMMEstimator:
        members = [kalman_filter(m, q, parameters) for parameters in modes]
        return IMMEstimator(members, [0.6, 0.4], TRANSITION, method=method)

    return System(bank, cancels=True)


def tied_imm(m: int, q: int, rng: Generator) -> System:
    """Make a bank of two Kalman filters that do not differ."""
    parameters = kalman_parameters(m, q, rng)

    def bank() -> IMMEstimator:
        return IMMEstimator([kalman_filter(m, q, parameters) for _ in range(2)], [0.6, 0.4], TRANSITION)

    return System(bank, lambda: kalman_filter(m, q, parameters))


#: How each kind of filter is made: functions of the size and a generator.
KINDS: dict[str, Callable[[int, int, Generator], System]] = {
    "fuzzy, FMC1": fmc1,
    "fuzzy, FMC2": fmc2,
    "fuzzy, signed weights": signed,
    "fuzzy, free chain": free,
    "hard": hard,
    "hard, tied": tied,
    "state space": lambda m, q, rng: converted(m, q, rng, 1),
    "state space, order 2": lambda m, q, rng: converted(m, q, rng, 2),
    "known switch": known,
    "Kalman": kalman,
    "IMM": imm,
    "IMM, tied": tied_imm,
    "GPB2": lambda m, q, rng: imm(m, q, rng, "gpb2"),
}


@cache
def system(kind: str, size: tuple[int, int], seed: int) -> System:
    """Make a system of a kind and a size; the same one for the same seed."""
    return KINDS[kind](*size, np.random.default_rng([seed, list(KINDS).index(kind), *size]))
