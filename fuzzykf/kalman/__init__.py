"""Kalman filters with the interface of filterpy's, as classes and as functions."""

from fuzzykf.kalman.extended import ExtendedKalmanFilter
from fuzzykf.kalman.functions import batch_filter, predict, predict_steadystate, update, update_steadystate
from fuzzykf.kalman.imm import IMMEstimator
from fuzzykf.kalman.kalman_filter import KalmanFilter
from fuzzykf.kalman.smoothing import rts_smoother
from fuzzykf.kalman.state_maps import StateMap

__all__ = [
    "ExtendedKalmanFilter",
    "IMMEstimator",
    "KalmanFilter",
    "StateMap",
    "batch_filter",
    "predict",
    "predict_steadystate",
    "rts_smoother",
    "update",
    "update_steadystate",
]
