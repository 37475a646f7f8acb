from fuzzykf.base import FloatArray

def moments_about(
    mass: FloatArray, axes: tuple[FloatArray, ...], center: FloatArray
) -> tuple[FloatArray, FloatArray]: ...
