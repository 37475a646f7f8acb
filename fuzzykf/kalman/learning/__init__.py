"""Learning the parameters of Kalman filters from observations alone, by maximum likelihood.

`score` has the log-likelihood of linear filters and its exact gradient, `problem` the log-likelihoods of all
filters as functions of free numbers, and `fit` leads from series to what was found.
"""
