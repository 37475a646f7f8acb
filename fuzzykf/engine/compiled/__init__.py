"""The compiled twins of the kernels of `fuzzykf.engine`: signatures and meaning are theirs.

Arrays of any type and stride are converted, wrong shapes are refused; the arithmetic is in
``src/``, once per kind of processor.  The interpreter lock is released wherever a whole series
is at work.
"""

from importlib import import_module

#: All of them or none: an engine that is compiled in part would be neither.
MODULES = (
    "arrays",
    "attributes",
    "backward",
    "convolution",
    "grid",
    "imm",
    "kalman",
    "kernels",
    "moments",
    "processor",
    "raster",
    "series",
    "stepper",
    "switching",
    "tables",
)

for _name in MODULES:
    import_module(f"{__name__}.{_name}")
