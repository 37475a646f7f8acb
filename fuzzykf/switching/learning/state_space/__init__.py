"""Learning switching state-space models from observations, by maximum likelihood.

`data` reads series, and states that were measured beside them; `problem` has the log-likelihood of IMM on the
nodes as a function of free numbers, with its exact gradient; `fit` leads from series to what was found.
"""
