from numpy import int64
from numpy.typing import NDArray

from fuzzykf.base import FloatArray
from fuzzykf.engine.compiled.tables import Kernel

def smooth_back(kernel: Kernel, log_p: FloatArray, U: FloatArray, after: FloatArray) -> FloatArray: ...
def best_path(kernel: Kernel, score: FloatArray, U: FloatArray) -> tuple[FloatArray, NDArray[int64]]: ...
