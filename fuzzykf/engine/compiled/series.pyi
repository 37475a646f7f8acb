from fuzzykf.base import FloatArray
from fuzzykf.engine.compiled.tables import Kernel, Summary

def filter_series(
    kernel: Kernel,
    summary: Summary,
    law: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ys: FloatArray,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]: ...
