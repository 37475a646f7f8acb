"""Maximum likelihood: free parameters, the ascent, and what the data say of what was found.

`fuzzykf.estimation.free` turns what is free of a model into a vector of numbers, `ascent` finds the maxima of
a log-likelihood of these, `information` says how well each is known, and `result` presents it.
"""

from fuzzykf.estimation.result import LikelihoodFit, LocalMaximum

__all__ = ["LikelihoodFit", "LocalMaximum"]
