"""The numeric kernels behind recursion and propagation: a reference in NumPy, and a compiled core.

Functions on flat arrays, without checks: their callers own shapes, validity and missing
data.  Where a compiled twin of a NumPy function exists, `fuzzykf.engine.selected` holds the one
in use, and `info` says which it is.  The environment variable ``FUZZYKF_ENGINE``, read when the
first of them is needed, decides between ``compiled`` and ``numpy``; where it is not set, the compiled
core is used if it has been built.
"""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from fuzzykf import moved
from fuzzykf.errors import MissingDependencyError, ParameterError

__all__ = ["EngineInfo", "info"]

_VARIABLE = "FUZZYKF_ENGINE"


class EngineInfo(NamedTuple):
    """The engine in use, and the reason.

    Attributes
    ----------
    name : str
        "compiled" or "numpy".
    reason : str
        Reason of the choice.
    instructions : str or None
        The instruction set of the compiled kernels: "x86-64-v4" (AVX-512), "x86-64-v3" (AVX2),
        or "portable".

    Examples
    --------
    >>> from fuzzykf.engine import EngineInfo
    >>> EngineInfo("numpy", "FUZZYKF_ENGINE is set", None).name
    'numpy'
    """

    name: str
    reason: str
    instructions: str | None


def info() -> EngineInfo:
    """Return which engine is in use, and why.

    Returns
    -------
    EngineInfo

    Raises
    ------
    ParameterError
        If ``FUZZYKF_ENGINE`` is neither "numpy" nor "compiled".
    MissingDependencyError
        If it is "compiled", but the compiled core is missing.

    Examples
    --------
    >>> from fuzzykf import engine
    >>> engine.info().name in ("numpy", "compiled")
    True
    """
    name, reason = _choice()
    if name == "numpy":
        return EngineInfo(name, reason, None)
    from fuzzykf.engine.compiled import MODULES

    return EngineInfo(name, reason, MODULES["processor"].instructions())


@cache
def _choice() -> tuple[str, str]:
    wanted = os.environ.get(_VARIABLE)
    if wanted not in (None, "numpy", "compiled"):
        raise ParameterError(
            f"{_VARIABLE}: got {wanted!r}, expected 'numpy' or 'compiled', or no such variable"
        )
    if wanted == "numpy":
        return wanted, f"{_VARIABLE} is set to 'numpy'"
    try:
        import fuzzykf.engine.compiled  # noqa: F401
    except ImportError as error:
        missing = (
            f"the compiled core cannot be imported ({error}); it is built when fuzzykf is installed "
            "with a C compiler at hand"
        )
        if wanted:
            raise MissingDependencyError(
                f"{_VARIABLE} is set to 'compiled', but {missing}; expected 'numpy', or no such variable"
            ) from error
        return "numpy", missing
    return "compiled", f"{_VARIABLE} is set to 'compiled'" if wanted else "the compiled core has been built"


if not TYPE_CHECKING:  # to type checkers only what is listed is there

    def __getattr__(name: str) -> object:
        """Find what has moved."""
        return moved.lookup(__name__, name)
