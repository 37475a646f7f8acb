from typing import Any

from numpy.typing import ArrayLike

from fuzzykf.base import FloatArray

class Stepper:
    _n: int
    _predicted: bool
    _belief: Any
    _before: Any
    _z: FloatArray | None
    _log_likelihood: float
    def step(self, z: ArrayLike | None) -> Any: ...
    def _step_any(self, z: ArrayLike | None) -> Any: ...
    def _arm(self, tables: Any, table: FloatArray, window: FloatArray, mass: FloatArray | None) -> bool: ...
