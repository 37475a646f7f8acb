from typing import Any

from numpy.typing import ArrayLike

from fuzzykf.base import FloatArray

def filter_bank(
    xs: FloatArray,
    Ps: FloatArray,
    log_mu: FloatArray,
    log_M: FloatArray,
    zs: FloatArray,
    model: dict[str, FloatArray],
    out: dict[str, FloatArray],
) -> dict[str, FloatArray] | None: ...

class BankStepper:
    def step(self, z: ArrayLike | None) -> Any: ...
    def _step_any(self, z: ArrayLike | None) -> Any: ...
    def _predict_at_once(self) -> bool: ...
    def _update_at_once(self, z: ArrayLike | None) -> bool: ...
    @classmethod
    def _overrides(cls) -> int: ...
