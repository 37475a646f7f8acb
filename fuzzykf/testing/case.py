"""The filter under check: what it can do, how its states are compared, how a check fails."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from fuzzykf.base import Filter
from fuzzykf.errors import FuzzykfError, ParameterError, ShapeError
from fuzzykf.results import FIELDS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from fuzzykf.arrays import FloatArray

__all__ = ["CHECKS", "Case", "FilterCheckError", "check"]


class FilterCheckError(FuzzykfError, AssertionError):
    """A filter breaks a promise of `fuzzykf.base.Filter`."""


#: What is compared when two filters, or a filter and a result, should agree.
COMPARED = tuple(name for name, known in FIELDS.items() if known.streamed)

#: The checks by their names, in the order in which they run.
CHECKS: dict[str, Callable[[Case], None]] = {}


def check(name: str) -> Callable[[Callable[[Case], None]], Callable[[Case], None]]:
    """Register a check under a name."""

    def register(function: Callable[[Case], None]) -> Callable[[Case], None]:
        CHECKS[name] = function
        return function

    return register


class Case:
    """The filter under check, and what it can do.

    Parameters
    ----------
    factory : callable
        Returns a new filter.
    zs : ndarray, shape (n, dim_z), or None
        Observations.
    """

    def __init__(self, factory: Callable[[], Any], zs: FloatArray | None) -> None:
        self.factory = factory
        self.checking = "construction"
        first = factory()
        self.name = type(first).__name__
        if not isinstance(first, Filter):
            self.fail(f"the factory returned {first!r}, expected an instance of fuzzykf.base.Filter")
        for dim in ("dim_x", "dim_z"):
            value = getattr(first, dim, None)
            if not isinstance(value, (int, np.integer)) or value < 1:
                self.fail(f"{dim} is {value!r}, expected an integer of at least 1")
        self.dim_x, self.dim_z = int(first.dim_x), int(first.dim_z)
        if zs is None:
            zs = 0.5 * np.sin(1.3 * np.arange(10)[:, None] + 0.7 * np.arange(self.dim_z))
        if zs.size != len(zs) * self.dim_z:
            raise ShapeError(f"zs: got shape {zs.shape}, expected (n, {self.dim_z})")
        self._zs = zs.reshape(len(zs), self.dim_z)
        if len(zs) < 6:
            self.fail(f"zs has {len(zs)} observations, expected at least six")
        self.probabilistic = hasattr(first, "log_likelihood")
        self.switching = hasattr(first, "mu") and hasattr(first, "nodes")
        self.possibilistic = hasattr(first, "membership") and hasattr(first, "possibility")
        self.no_missing = self._why_no_missing()

    @property
    def zs(self) -> FloatArray:
        """The observations, (n, dim_z); a copy, as nobody knows what a filter does to it."""
        return self._zs.copy()

    def _why_no_missing(self) -> str | None:
        try:
            f = self.stepped(2)
            f.predict()
        except Exception:  # the checks will meet it again, and say so
            return None
        try:
            f.update(None)
        except NotImplementedError as reason:
            return f"update(None) is not supported: {reason}"
        except Exception:
            return None
        return None

    def why_not(self, name: str) -> str | None:
        """Say why a check does not apply; None if it does."""
        self.checking = name
        first = self.factory()
        needs = {
            "missing_component": (self.dim_z > 1, "dim_z is 1"),
            "log_likelihood": (self.probabilistic, "no log_likelihood"),
            "density": (self.probabilistic and self.dim_z == 1, "no log_likelihood, or dim_z is not 1"),
            "outlier": (self.probabilistic, "no log_likelihood"),
            "mode_probabilities": (self.switching, "no mu and nodes"),
            "leading_predict": (self.switching, "no mu and nodes"),
            "sequence": (self.switching, "no mu and nodes"),
            "possibility": (self.possibilistic, "no membership and possibility"),
            "filter_many": (hasattr(first, "filter_many"), "no method filter_many"),
            "smooth": (
                hasattr(first, "smooth") and getattr(first, "has_smoother", True),
                "no method smooth",
            ),
            "save": (_is_savable(first), "no methods save and load, or it holds what no file can"),
        }
        applies, reason = needs.get(name, (True, ""))
        if not applies:
            return reason
        if name.startswith("missing"):
            return self.no_missing
        if name == "saver":
            try:
                import filterpy.common  # noqa: F401
            except ImportError:
                return "filterpy is not installed"
        return None

    def fail(self, message: str) -> NoReturn:
        """Raise the error of the current check."""
        raise FilterCheckError(f"{self.name} fails {self.checking!r}: {message}")

    def stepped(self, n: int) -> Any:
        """Return a new filter after n steps."""
        f = self.factory()
        for z in self.zs[:n]:
            f.step(z)
        return f

    def state(self, f: Any) -> dict[str, FloatArray]:
        """Copy what users read of a filter."""
        return {
            name: np.array(getattr(f, name), dtype=np.float64)
            for name in COMPARED
            if hasattr(f, name) and getattr(f, name) is not None
        }

    def require_finite(self, f: Any, when: str) -> None:
        """Fail where something that users read is not finite; bounds of the possible may be infinite."""
        for name, value in self.state(f).items():
            if np.isnan(value).any() or not (name in ("lower", "upper") or np.isfinite(value).all()):
                self.fail(f"{name} is {value.tolist()} {when}, expected finite numbers")

    def compare(self, got: dict[str, FloatArray], expected: dict[str, FloatArray], what: str) -> None:
        """Fail unless both hold the same."""
        for name, value in expected.items():
            if name not in got:
                self.fail(f"{what}: {name} is missing")
            if got[name].size != value.size:
                self.fail(f"{what}: {name} has shape {got[name].shape}, expected {value.shape}")
            actual = got[name].reshape(value.shape)
            scale = 1.0 + np.abs(value[np.isfinite(value)]).max(initial=0.0)
            if not np.allclose(actual, value, rtol=1e-8, atol=1e-10 * scale, equal_nan=True):
                self.fail(f"{what}: {name} is {actual.tolist()}, expected {value.tolist()}")

    def refuses(self, what: str, call: Callable[[], Any]) -> None:
        """Fail unless a call ends in a ValueError."""
        try:
            call()
        except ValueError:
            return
        except Exception as error:
            self.fail(f"{what} raised {type(error).__name__}, expected a ValueError: {error}")
        self.fail(f"{what} was accepted, expected a ValueError")

    def same(self, f: Any, g: Any, what: str) -> None:
        """Fail unless two filters are in the same state and stay together for two steps."""
        self.compare(self.state(f), self.state(g), what)
        for z in self.zs[-2:]:
            f.step(z.copy())
            g.step(z.copy())
        self.compare(self.state(f), self.state(g), f"{what}, two steps later")

    def along(self, f: Any, zs: Iterable[Any]) -> dict[str, FloatArray]:
        """Step a filter along a series and stack its states."""
        rows = []
        for z in zs:
            f.step(z)
            rows.append(self.state(f))
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def fields(self, result: Any) -> dict[str, FloatArray]:
        """Return what a result holds of the fields that are compared."""
        return {name: getattr(result, name) for name in COMPARED if getattr(result, name) is not None}


def _is_savable(f: Any) -> bool:
    """Whether a filter can be written to a file: it says so if it holds a function."""
    if not (hasattr(f, "save") and hasattr(type(f), "load")):
        return False
    try:
        getattr(f, "to_dict", dict)()
    except ParameterError:
        return False
    return True
