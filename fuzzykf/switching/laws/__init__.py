"""Laws of the switch, and the Markov chains that stand for them."""
