"""Laws of the switch, and the Markov chains that stand for them."""

from typing import Any

from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.law import FuzzyMarkovLaw
from fuzzykf.switching.laws.registry import LAWS

__all__ = ["LAWS", "FuzzyMarkovLaw", "SwitchChain"]


def __getattr__(name: str) -> Any:
    """Find the class of a law, in whatever module it stands."""
    if not name.startswith("_"):
        for law in LAWS.values():
            if law.__name__ == name:
                return law
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
