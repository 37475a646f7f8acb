"""Jacobians by central differences, for models that come without them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fuzzykf.gaussian import as_numbers

if TYPE_CHECKING:
    from collections.abc import Callable

    from fuzzykf.arrays import FloatArray

__all__ = ["central_jacobian"]

#: The step that balances the error of the difference, h^2, against rounding, eps / h.
RELATIVE_STEP = float(np.finfo(np.float64).eps) ** (1.0 / 3.0)


def central_jacobian(
    function: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    residual: Callable[[Any, Any], Any] = np.subtract,
) -> FloatArray:
    """Jacobian of a function by central differences.

    Component i is moved by h_i = eps^(1/3) max(1, abs(x_i)), about 6e-6 for values up
    to one: right for components of the order of one or larger.  For states that are
    much smaller give the Jacobian, or scale the state.

    Parameters
    ----------
    function : callable
        From (n,) to (m,).
    x : ndarray, shape (n,)
    residual : callable
        The difference of two values; one that wraps angles keeps the Jacobian
        finite where an angle jumps.

    Returns
    -------
    ndarray, shape (m, n)

    Examples
    --------
    >>> import numpy as np

    from fuzzykf.gaussian import as_numbers
    >>> central_jacobian(lambda x: np.array([x[0] * x[1]]), np.array([2.0, 3.0])).round(6)
    array([[3., 2.]])
    """
    columns = []
    for i, value in enumerate(x):
        step = RELATIVE_STEP * max(1.0, abs(float(value)))
        above, below = x.copy(), x.copy()
        above[i] += step
        below[i] -= step
        width = above[i] - below[i]  # a function may write into what it is given
        difference = as_numbers("residual", residual(function(above), function(below)))
        columns.append(difference.ravel() / width)
    jacobian: FloatArray = np.column_stack(columns)
    return jacobian
