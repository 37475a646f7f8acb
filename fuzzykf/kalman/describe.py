"""How filters show themselves: every attribute, one below the other."""

from __future__ import annotations

import numpy as np

__all__ = ["describe"]


def describe(filter_: object, *more: str) -> str:
    """Lines ``name = value`` of the public attributes and ``more``; columns are shown as transposed rows."""
    lines = [f"{type(filter_).__name__} object"]
    for name in (*(name for name in vars(filter_) if not name.startswith("_")), *more):
        value = getattr(filter_, name)
        turned = isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[0] > value.shape[1] == 1
        text = f"{name} = " + (f"{value.T}.T" if turned else str(value))
        lines.append(text.replace("\n", "\n" + " " * (len(name) + 3)))
    return "\n".join(lines)
