"""Arguments by kind: valid ones, valid ones in unusual dress, and hostile ones.

Masked arrays are not among them: what they mean is settled, and tested, where observations are taken in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    Generator = np.random.Generator

__all__ = ["Kind", "argument", "show"]

NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Kind:
    """How to draw valid arguments.

    Attributes
    ----------
    draw : callable
        Of a random number generator.
    optional : bool
        Whether it may be left out.
    work : bool
        Whether it says how much is to be done, without a limit: then it is never huge.
    trusted : bool
        Whether it is never hostile.
    """

    draw: Callable[[Generator], Any]
    optional: bool = False
    work: bool = False
    trusted: bool = False


# --------------------------------------------------------------------------- valid


def maybe(kind: Kind) -> Kind:
    """Let it be left out."""
    return Kind(kind.draw, True, kind.work)


def fixed(value: Any) -> Kind:
    """Always the same."""
    return Kind(lambda rng: value)


def trusted(value: Any) -> Kind:
    """Always the same, since it comes from the package itself."""
    return Kind(lambda rng: value, trusted=True)


def choice(*values: Any) -> Kind:
    """One of a few."""
    return Kind(lambda rng: values[rng.integers(len(values))])


def count(least: int, most: int, *, work: bool = False) -> Kind:
    """Draw a whole number."""
    return Kind(lambda rng: int(rng.integers(least, most + 1)), work=work)


def real(low: float, high: float) -> Kind:
    """Draw a number."""
    return Kind(lambda rng: float(rng.uniform(low, high)))


def array(*shape: int, scale: float = 0.5) -> Kind:
    """Draw numbers around zero."""
    return Kind(lambda rng: rng.normal(scale=scale, size=shape))


def shares(*shape: int) -> Kind:
    """Draw numbers between zero and one."""
    return Kind(lambda rng: rng.random(shape))


def covariance(*shape: int) -> Kind:
    """Draw covariances; the last number is their size."""

    def draw(rng: Generator) -> Any:
        root = rng.normal(size=(*shape, shape[-1])) * 0.4 + 0.6 * np.eye(shape[-1])
        return root @ np.swapaxes(root, -1, -2)

    return Kind(draw)


def stochastic(K: int) -> Kind:
    """Draw a transition matrix."""
    return Kind(lambda rng: rng.dirichlet(np.ones(K), size=K) * 0.8 + 0.2 * np.eye(K))


def probabilities(K: int) -> Kind:
    """Draw probabilities."""
    return Kind(lambda rng: rng.dirichlet(np.ones(K)))


def observation(q: int) -> Kind:
    """Draw an observation: a number, a row, a column, nothing, or one with a gap."""

    def draw(rng: Generator) -> Any:
        z = rng.normal(size=q)
        what = rng.integers(8)
        if what == 0:
            return None
        if what == 1:
            z[rng.integers(q)] = NAN
        return (z, z[:, None], z[None], z.tolist(), float(z[0]) if q == 1 else z)[rng.integers(5)]

    return Kind(draw)


def series(q: int, least: int = 0, most: int = 8) -> Kind:
    """Draw a series of observations."""

    def draw(rng: Generator) -> Any:
        zs = rng.normal(size=(rng.integers(least, most + 1), q))
        if len(zs) and rng.random() < 0.3:
            zs[rng.integers(len(zs)), rng.integers(q)] = NAN
        if rng.random() < 0.2:
            return [None if np.isnan(z).any() else z for z in zs]
        return zs[:, 0] if q == 1 and rng.random() < 0.4 else zs

    return Kind(draw)


def listed(kind: Kind, least: int, most: int) -> Kind:
    """Draw a list."""
    return Kind(lambda rng: [kind.draw(rng) for _ in range(rng.integers(least, most + 1))])


def generator() -> Kind:
    """Draw a generator."""
    return Kind(lambda rng: np.random.default_rng(int(rng.integers(100))))


# --------------------------------------------------------------------------- unusual


def read_only(a: np.ndarray) -> np.ndarray:
    """Forbid to write."""
    a = a.copy()
    a.flags.writeable = False
    return a


def with_gaps_between(a: np.ndarray) -> np.ndarray:
    """Let the entries stand apart in memory."""
    apart = np.full(tuple(2 * n for n in a.shape), NAN)
    view = apart[tuple(slice(None, None, 2) for _ in a.shape)]
    view[...] = a
    return view


def in_pandas(a: np.ndarray) -> Any:
    """Put a table around it."""
    import pandas as pd

    return pd.Series(a) if a.ndim == 1 else pd.DataFrame(a) if a.ndim == 2 else a


#: The same numbers, or rounded ones, otherwise.
DRESSES: tuple[Callable[[np.ndarray], Any], ...] = (
    read_only,
    with_gaps_between,
    np.asfortranarray,
    in_pandas,
    np.ndarray.tolist,
    lambda a: tuple(a.tolist()) if a.ndim else a.item(),
    lambda a: a.astype(">f8"),
    lambda a: a.astype(np.float32),
    lambda a: a.astype(np.longdouble),
    lambda a: a.astype(object),
    lambda a: np.nan_to_num(a).astype(np.int64),
    lambda a: np.nan_to_num(a).astype(np.int8),
    lambda a: a[::-1][::-1],
)


def dressed(rng: Generator, value: Any) -> Any:
    """Return a valid argument in another type or another order in memory."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim:
        return DRESSES[rng.integers(len(DRESSES))](value)
    if type(value) is int:
        return (
            (np.int64(value), np.uint8(value), float(value))[rng.integers(3)] if 0 <= value < 200 else value
        )
    if type(value) is float:
        return (np.float64(value), np.float32(value), np.array(value), np.array([value]))[rng.integers(4)]
    return value


# --------------------------------------------------------------------------- hostile


class Thing:
    """Nothing that anybody expects."""

    def __repr__(self) -> str:
        return "Thing()"


#: In place of anything.
STRANGE: tuple[Any, ...] = (
    None, NAN, INF, -INF, 1e150, -1e150, 1e-300, 0, 0.0, -0.0, -1, -1.0, 2.5, 1j, 10**400, "text", "",
    b"bytes", Thing(), object, [], {}, (), [[]], [None], [None, None], [[1.0, 2.0], [3.0]], [1.0, "x"],
    {"a": 1.0}, {1.0}, np.array(1.0), np.empty(0), np.empty((0, 0)), np.empty((0, 1)), np.empty((1, 0)),
    np.zeros((1, 1, 1)), np.zeros((2, 2, 2, 2)), np.array([[NAN]]), np.array(["x"]), np.zeros((3, 3)),
    np.array([None, 1.0], dtype=object), np.array([1 + 1j]), np.array([True]), np.datetime64("2020-01-01"),
    np.array([1, 2], dtype=np.uint64), range(3), slice(None), np.zeros, print, np.float64(3.0), np.ones(5),
)  # fmt: skip

#: In place of a number that has no limit.
HUGE = (10**9, 10**15, 2**63, 1e18, 1e300)

#: In place of an entry.
ENTRIES = (NAN, INF, -INF, 1e150, -1e150, 1e-300, 0.0, -1.0, 1e16)


def misshapen(rng: Generator, a: np.ndarray) -> Any:
    """Return an array of another shape or kind."""
    what = rng.integers(9)
    if what == 0:
        return a[None]
    if what == 1:
        return a[..., None]
    if what == 2:
        return a.T if a.ndim > 1 and a.shape != a.T.shape else a[:0]
    if what == 3:
        return a[:-1]
    if what == 4:
        return np.concatenate([a, a[-1:]])
    if what == 5:
        return a.ravel()
    if what == 6:
        return a.astype(complex)
    if what == 7:
        ragged = a.tolist()
        return [*ragged[:-1], [1.0] * 7]
    return a[..., :0]


def spoiled(rng: Generator, value: Any) -> Any:
    """Return an array with a bad entry or a bad shape."""
    if rng.random() < 0.4:
        return misshapen(rng, value)
    value = value.copy()
    if rng.random() < 0.3:
        value[...] = ENTRIES[rng.integers(len(ENTRIES))]
    elif value.size:
        value.flat[rng.integers(value.size)] = ENTRIES[rng.integers(len(ENTRIES))]
    return value


def hostile(rng: Generator, kind: Kind) -> Any:
    """Return an argument that ought to be refused, mostly."""
    value = kind.draw(rng)
    if kind.trusted:
        return value
    if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim and rng.random() < 0.65:
        return spoiled(rng, value)
    if isinstance(value, list) and value and rng.random() < 0.4:
        value = list(value)
        value[rng.integers(len(value))] = STRANGE[rng.integers(len(STRANGE))]
        return value
    if not kind.work and rng.random() < 0.1:
        return HUGE[rng.integers(len(HUGE))]
    strange = STRANGE[rng.integers(len(STRANGE))]
    if callable(value) and callable(strange):  # what the user's own function raises is his
        return None
    return 2.5 if kind.work and isinstance(strange, int | float) and strange > 100 else strange


def argument(rng: Generator, kind: Kind, is_hostile: bool) -> Any:
    """Draw an argument."""
    if is_hostile:
        return hostile(rng, kind)
    value = kind.draw(rng)
    return dressed(rng, value) if not kind.trusted and rng.random() < 0.2 else value


# --------------------------------------------------------------------------- in words


def show(value: Any) -> str:
    """Write an argument so that it can be typed again, where it is short enough."""
    if isinstance(value, np.ndarray):
        if value.size > 20:
            return f"<array {value.shape} of {value.dtype}>"
        dress = "".join(
            f", {what}"
            for what, there in (("read-only", not value.flags.writeable), ("apart", not value.flags.forc))
            if there
        )
        return f"array({value.tolist()}, {value.dtype}, shape {value.shape}{dress})"
    if isinstance(value, list | tuple) and len(value) <= 20:
        left, right = "[]" if isinstance(value, list) else "()"
        return left + ", ".join(map(show, value)) + right
    if callable(value):
        return getattr(value, "__qualname__", repr(value)[:80])
    if isinstance(value, int) and abs(value) > 10**30:
        return f"<int of {len(str(value))} digits>"
    return repr(value)[:200].replace("\n", " ")
