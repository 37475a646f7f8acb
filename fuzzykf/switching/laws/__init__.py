"""Laws of the switch, and the Markov chains that stand for them."""

from fuzzykf.switching.laws.chain import SwitchChain
from fuzzykf.switching.laws.law import FuzzyMarkovLaw

__all__ = ["FuzzyMarkovLaw", "SwitchChain"]
