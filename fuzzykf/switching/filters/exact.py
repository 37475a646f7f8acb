"""The filters of the switching models, as users meet them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np

from fuzzykf.errors import FileFormatError, ParameterError
from fuzzykf.io import MODELS, Document, decode, encode
from fuzzykf.switching.filters.switching_filter import SwitchingFilter
from fuzzykf.switching.inference.belief import Belief, Source, is_sound
from fuzzykf.switching.models.fuzzy import CGOFMSModel
from fuzzykf.switching.models.hard import CGOMSModel

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CGOMSMFilter", "OFSRFilter"]


class _SavedFilter(SwitchingFilter, Document):
    """A filter that knows its model and can be written to a file."""

    model: CGOFMSModel | CGOMSModel

    def _options(self) -> dict[str, Any]:
        """Arguments of the constructor beside the model."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return model, options and state as plain values."""
        return {
            "model_kind": type(self.model).__name__,
            "model": self.model.to_dict(),
            "options": self._options(),
            "state": self._export_state(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a filter from what `to_dict` returned, in the state it was in."""
        make: Any = cls
        loaded: Self = make(MODELS[values["model_kind"]].from_dict(values["model"]), **values["options"])
        loaded._import_state(values["state"])
        return loaded

    def _export_state(self) -> dict[str, Any]:
        """Return the state as plain values that `_import_state` restores bit for bit."""
        return {
            "n": self._n,
            "predicted": self._predicted,
            "belief": None if self._belief is None else self._belief.to_dict(),
            "before": None if self._before is None else self._before.belief.to_dict(),
            "z": encode(self._z),
            "log_likelihood": self._log_likelihood,
        }

    def _import_state(self, values: dict[str, Any]) -> None:
        n, belief, before = (
            values["n"],
            *(None if values[k] is None else Belief.from_dict(values[k]) for k in ("belief", "before")),
        )
        sizes = self.dim_x, self.dim_z, len(self._system.chain), self._system.order
        sound = all(is_sound(one, *sizes) for one in (belief, before) if one is not None)
        z, log_likelihood = decode(values["z"], 1), float(values["log_likelihood"])
        if not sound or (belief is None) != (n == 0) or (before is None) != (n < 2) or n < 0:
            raise FileFormatError(f"the state after {n} observations does not fit the model")
        if z.shape != (self.dim_z,) or not np.isfinite(log_likelihood):
            raise FileFormatError(f"z and log_likelihood: got {z.tolist()} and {log_likelihood}")
        self._n, self._predicted, self._belief = int(n), bool(values["predicted"]), belief
        self._z, self._log_likelihood = z, log_likelihood
        self._before = None if before is None else Source(before, self._system.pair_tables(self._n - 2))


class OFSRFilter(_SavedFilter):
    """Optimal fuzzy switching recursive filter (2020 paper, section IV).

    Exact for the Markov chain on ``n_nodes + 2`` nodes that stands for the fuzzy law.

    Parameters
    ----------
    model : CGOFMSModel
    n_nodes : int
        Number F of nodes between the hard values 0 and 1.  The cost of a step grows as
        (F + 2)^2: 49 pairs at F = 5, 144 at F = 10.  The error falls as F^-2 for FMC1 and
        as F^-1 for FMC2; 5 is enough in most cases.
    rule : {"cell", "midpoint", "gauss", "product"}
        How the law is discretised, see `FuzzyMarkovLaw.discretize`.

    See Also
    --------
    fuzzykf.switching.filters.switching_filter.SwitchingFilter : Verbs and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOFMSModel, FuzzyMarkovLaw, OFSRFilter
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOFMSModel(
    ...     FuzzyMarkovLaw.fmc1(0.07, 0.05, 0.16),
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
        super().__init__(model.on_nodes(n_nodes, rule))

    def _options(self) -> dict[str, Any]:
        return {"n_nodes": int(self.n_nodes), "rule": self.rule}


class CGOMSMFilter(_SavedFilter):
    """Exact recursive filter for K hard regimes.

    Parameters
    ----------
    model : CGOMSModel

    See Also
    --------
    fuzzykf.switching.filters.switching_filter.SwitchingFilter : Verbs and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSMFilter, CGOMSModel
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.1, 0.9]], [[0.0, 3.0], [0.0, 0.0]], np.broadcast_to(pair, (2, 2, 4, 4)), 1
    ... )
    >>> f = CGOMSMFilter(model)
    >>> f.step(2.5).shape, f.switch
    ((1, 1), 0.0)
    """

    def __init__(self, model: CGOMSModel) -> None:
        if not isinstance(model, CGOMSModel):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOMSModel")
        self.model = model
        super().__init__(model.on_nodes())
