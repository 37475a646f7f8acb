from typing import Any

from numpy.typing import ArrayLike

from fuzzykf.base import FloatArray

LARGEST: int

def predict_linear(
    x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: float
) -> tuple[FloatArray, FloatArray]: ...
def update_linear(
    x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
def filter_linear(
    x: FloatArray,
    P: FloatArray,
    zs: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    H: FloatArray,
    R: FloatArray,
    alpha_sq: float,
    controls: FloatArray | None,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None: ...

class LinearStepper:
    def step(self, z: ArrayLike | None) -> Any: ...
    def _step_any(self, z: ArrayLike | None) -> Any: ...
    def _predict_at_once(self) -> bool: ...
    def _update_at_once(self, z: ArrayLike | None) -> bool: ...
    @classmethod
    def _overrides(cls) -> int: ...
