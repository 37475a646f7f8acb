from fuzzykf.arrays import IntArray
from fuzzykf.base import FloatArray

def convolve_parabola(
    cost: FloatArray, y0: float, dy: float, x0: float, dx: float, n_targets: int, curvature: float
) -> FloatArray: ...
def refine(
    before: FloatArray, left: FloatArray, middle: FloatArray, right: FloatArray, after: FloatArray
) -> FloatArray: ...
def envelope_of_parabolas(
    cost: FloatArray, y0: float, dy: float, x0: float, dx: float, n_targets: int, curvature: float
) -> IntArray: ...
