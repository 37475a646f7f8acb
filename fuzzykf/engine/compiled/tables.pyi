from typing import Any

from fuzzykf.base import FloatArray

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
