"""The filter of hard regimes."""

from __future__ import annotations

from fuzzykf.errors import ParameterError
from fuzzykf.immutable import keeps
from fuzzykf.switching.filters.driven_filter import DrivenFilter
from fuzzykf.switching.inference.registry import METHODS
from fuzzykf.switching.models.hard import CGOMSModel

__all__ = ["CGOMSMFilter", "HardSwitchFilter"]


@keeps("model")
class CGOMSMFilter(DrivenFilter):
    """Exact recursive filter for K hard regimes.

    `HardSwitchFilter` is another name of the same class.  CGOMSM stands for conditionally Gaussian observed
    Markov switching model.

    Parameters
    ----------
    model : CGOMSModel
        Model with an exact filter.

    Raises
    ------
    ParameterError
        If ``model`` is of another class or has no exact filter, see `CGOMSModel.exactness`.

    Notes
    -----
    Exact for complete observations and gaps at the end, and for any gaps with a single regime.  After
    other gaps, estimates are merged to mean and covariance per regime.

    See Also
    --------
    fuzzykf.switching.SwitchingFilter : Methods and attributes.

    Examples
    --------
    >>> import numpy as np
    >>> from fuzzykf import CGOMSMFilter, CGOMSModel
    >>> z = np.array([[1.0, 0.5], [0.5, 1.0]])
    >>> pair = np.block([[z, 0.8 * z], [0.8 * z, z]])
    >>> model = CGOMSModel(
    ...     [[0.9, 0.1], [0.1, 0.9]],
    ...     [[0.0, 3.0], [0.0, 0.0]],
    ...     np.broadcast_to(pair, (2, 2, 4, 4)),
    ...     1,
    ... )
    >>> f = CGOMSMFilter(model)
    >>> f.step(2.5).shape, f.switch
    ((1, 1), 0.0)
    """

    def __init__(self, model: CGOMSModel) -> None:
        if not isinstance(model, CGOMSModel):
            raise ParameterError(f"model: got {type(model).__name__}, expected a CGOMSModel")
        system = model.placed()
        found = model.form.exactness(system.chain)
        if not found.holds:
            raise ParameterError(
                f"model: {found.words}; expected an exact one, or SwitchingKalmanFilter, which takes any "
                "such model"
            )
        self.model = model
        super().__init__(system, METHODS[model.form.exact_method])


#: The plain name of `CGOMSMFilter`, which is the one that reprs, pickles and files have.
HardSwitchFilter = CGOMSMFilter
