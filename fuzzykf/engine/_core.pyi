from typing import Any

from numpy.typing import ArrayLike

from fuzzykf.base import FloatArray

def instructions() -> str: ...
def available_instructions() -> tuple[str, ...]: ...
def use_instructions(name: str) -> None: ...

class Kernel:
    @property
    def shape(self) -> tuple[int, int, int, int]: ...

class Summary:
    def __init__(
        self,
        kernel: Kernel,
        transition: FloatArray,
        offset: FloatArray,
        twice: FloatArray,
        noise: FloatArray,
        nodes: FloatArray,
        weights: FloatArray,
        atoms: Any,
    ) -> None: ...

def pack(
    transition: FloatArray,
    factor: FloatArray,
    Axx: FloatArray,
    H: FloatArray,
    G: FloatArray,
    c: FloatArray,
    C: FloatArray,
    Ayy: FloatArray,
    Ny: FloatArray,
) -> Kernel: ...
def first_step(
    log_initial: FloatArray, mean: FloatArray, covariance: FloatArray, factor: FloatArray, y: FloatArray
) -> tuple[FloatArray, float]: ...
def step(
    kernel: Kernel, table: FloatArray, sign: FloatArray | None, window: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray | None, float]: ...
def run(
    kernel: Kernel, table: FloatArray, sign: FloatArray | None, U: FloatArray
) -> tuple[FloatArray, FloatArray | None, FloatArray]: ...
def log_pairs(kernel: Kernel, U: FloatArray) -> FloatArray: ...
def node_mean(p: FloatArray, means: FloatArray) -> FloatArray: ...
def step_many(kernel: Kernel, table: FloatArray, U: FloatArray) -> tuple[FloatArray, FloatArray]: ...
def forward_backward(
    first: FloatArray, transition: FloatArray, log_emission: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]: ...
def filter_series(
    kernel: Kernel,
    summary: Summary,
    law: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    ys: FloatArray,
    out: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]: ...

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
