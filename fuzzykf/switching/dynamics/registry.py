"""The kinds of dynamics: the one list of them, which files read."""

from __future__ import annotations

from fuzzykf.registry import Registry

__all__ = ["FORMS"]

#: Classes of dynamics by the kind under which they are written to a file.
FORMS = Registry(
    {
        "covariance": "fuzzykf.switching.dynamics.forms:CovarianceForm",
        "transition": "fuzzykf.switching.dynamics.forms:TransitionForm",
        "regression": "fuzzykf.switching.dynamics.forms:RegressionForm",
        "inputs": "fuzzykf.switching.dynamics.inputs:InputForm",
        "pairwise": "fuzzykf.switching.dynamics.pairwise:PairwiseForm",
        "cglssm": "fuzzykf.switching.state_space.converted_form:ConvertedForm",
        "space_on_nodes": "fuzzykf.switching.state_space.converted_form:ConvertedNodesForm",
    }
)
