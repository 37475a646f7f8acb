"""The compiled twins of the kernels of `fuzzykf.engine`: signatures and meaning are theirs.

Arrays of any type and stride are converted, wrong shapes are refused; the arithmetic is in
``src/``, once per kind of processor.  The interpreter lock is released wherever a whole series
is at work.
"""

from fuzzykf.engine.compiled import (
    arrays,
    attributes,
    imm,
    kalman,
    processor,
    series,
    stepper,
    switching,
    tables,
)

__all__ = ["arrays", "attributes", "imm", "kalman", "processor", "series", "stepper", "switching", "tables"]
