"""Moments of a linear filter: by the engine in use, or by NumPy where a system is larger than that covers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fuzzykf.engine import selected
from fuzzykf.engine.numpy import kalman, kalman_series

if TYPE_CHECKING:
    from fuzzykf.arrays import FloatArray

__all__ = ["filter_linear", "predict_linear", "update_linear"]

if selected.LARGEST_LINEAR:

    def predict_linear(
        x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray, alpha_sq: float
    ) -> tuple[FloatArray, FloatArray]:
        """See `fuzzykf.engine.numpy.kalman.predict_linear`."""
        if len(P) <= selected.LARGEST_LINEAR:
            return selected.predict_linear(x, P, F, Q, alpha_sq)
        return kalman.predict_linear(x, P, F, Q, alpha_sq)

    def update_linear(
        x: FloatArray, P: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """See `fuzzykf.engine.numpy.kalman.update_linear`."""
        if len(P) <= selected.LARGEST_LINEAR >= len(R):
            return selected.update_linear(x, P, z, H, R)
        return kalman.update_linear(x, P, z, H, R)

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
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
        """See `fuzzykf.engine.numpy.kalman_series.filter_linear`."""
        if len(P) <= selected.LARGEST_LINEAR >= len(R):
            return selected.filter_linear(x, P, zs, F, Q, H, R, alpha_sq, controls, out)
        return kalman_series.filter_linear(x, P, zs, F, Q, H, R, alpha_sq, controls, out)

else:
    from fuzzykf.engine.selected import filter_linear, predict_linear, update_linear
