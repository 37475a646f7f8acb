"""The filter of a fuzzy switch."""

from __future__ import annotations

from typing import Any

from fuzzykf.errors import ParameterError
from fuzzykf.immutable import keeps
from fuzzykf.switching.filters.driven_filter import DrivenFilter
from fuzzykf.switching.models.fuzzy import CGOFMSModel

__all__ = ["FuzzySwitchFilter", "OFSRFilter"]


@keeps("model", "n_nodes", "rule")
class OFSRFilter(DrivenFilter):
    """Optimal fuzzy switching recursive filter (2020 paper, section IV), for a fuzzy switch.

    `FuzzySwitchFilter` is another name of the same class.  The fuzzy law is approximated by a Markov
    chain on nodes, for which the filter is exact.

    Parameters
    ----------
    model : CGOFMSModel
        Model with a fuzzy switch.
    n_nodes : int
        Number F of nodes between the hard values 0 and 1.  The cost of a step grows as
        (F + 2)^2: 49 pairs at F = 5, 144 at F = 10.  The error falls as F^-2 for FMC1 and
        as F^-1 for FMC2; 5 is enough in most cases.  For a `FadeLaw`, F is the number per fade, at most
        its number of steps.
    rule : {"cell", "midpoint", "gauss", "product"}
        Quadrature rule, see `FuzzyMarkovLaw.discretize`; other laws have "cell" only.

    See Also
    --------
    fuzzykf.switching.SwitchingFilter : Methods and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc2(0.15, 0.6, 0.2),
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     dim_x=1,
    ... )
    >>> f = OFSRFilter(model, n_nodes=5)
    >>> f.step(2.5).shape, f.mu.shape
    ((1, 1), (7,))
    >>> result = f.filter(model.simulate(50, np.random.default_rng(0)).y)
    >>> result.x.shape, result.switch.shape
    ((50, 1), (50,))
    """

    def __init__(self, model: CGOFMSModel, n_nodes: int = 5, rule: str = "cell") -> None:
        if not isinstance(model, CGOFMSModel):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOFMSModel")
        self.model, self.n_nodes, self.rule = model, n_nodes, rule
        super().__init__(model.form.placed(model.law.discretize(n_nodes, rule)))

    def _options(self) -> dict[str, Any]:
        return {"n_nodes": int(self.n_nodes), "rule": self.rule}


#: The plain name of `OFSRFilter`, which is the one that reprs, pickles and files have.
FuzzySwitchFilter = OFSRFilter
