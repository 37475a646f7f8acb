"""Filters behind the interfaces of other libraries, which are imported when a name is first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf.errors import MissingDependencyError

if TYPE_CHECKING:
    from fuzzykf.compat.scikit_learn import SwitchingRegressor

__all__ = ["SwitchingRegressor"]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import a public name when it is first used (PEP 562)."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from fuzzykf.registry import imported

        try:
            imported("sklearn")
        except ImportError as error:
            raise MissingDependencyError(
                f"{name} needs scikit-learn: pip install 'fuzzykf[compare]'"
            ) from error
        value = getattr(imported("fuzzykf.compat.scikit_learn"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """List the public names, imported or not."""
        return sorted(__all__)
