"""The compiled twins of the kernels of `fuzzykf.engine.numpy`: names, signatures and meaning are theirs.

Arrays of any type and stride are converted, wrong shapes are refused; the arithmetic is in
``src/``, once per kind of processor.  The interpreter lock is released wherever a whole series
is at work.
"""

from importlib import import_module

#: All of them or none: an engine that is compiled in part would be neither.
MODULES = {
    name: import_module(f"{__name__}.{name}")
    for name in (
        *("arrays", "processor"),  # helpers, without twins
        *("backward", "convolution", "gap_backward", "gap_series", "gaps", "grid", "hidden_markov"),
        *("imm", "kalman", "kalman_series", "kernels", "nodes", "nodes_backward", "nodes_gradient", "raster"),
        *("series", "state_score", "switching", "tables"),
    )
}
