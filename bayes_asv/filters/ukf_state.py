"""Records of the unscented filter: its state, model, settings and data, for compiled code."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "COLUMNS", "DEFLECTION", "DEFLECTION_SD", "DEVIANCE", "DRIFT", "DRIFT_DETECTED", "DRIFT_LAGS",
    "FAST_FACTOR", "FAULT_TIME", "INFORMATION_GAIN", "INNOVATION", "LOG_LIKELIHOOD",
    "LONG_RUN_VARIANCE", "MEAN", "MOTION_MEAN", "MOTION_VARIANCE", "NIS", "NOISE_FACTOR",
    "NOISE_SUM", "NOISE_WEIGHT", "PREDICTED", "PREDICTED_SD", "READINGS", "REVIEW_TIME", "SD",
    "SNAPSHOT_TIME", "STATISTICS", "FilterSettings", "Model", "State", "Steps",
]  # fmt: skip

Array = NDArray[np.float64]

# Elements of `State.statistics`.  Where two follow each other, they are those of the front and of
# the rear axle.
NOISE_SUM, NOISE_WEIGHT = 0, 2  # of normalised innovations squared: the slow noise factor
FAST_FACTOR = 4  # fast noise factor
FAULT_TIME = 6  # s since the fast noise factor exceeded the fault threshold
REVIEW_TIME = 7  # s since the last review
SNAPSHOT_TIME = 8  # s since the last snapshot
INFORMATION_GAIN = 9  # decrease of the log-volume of the parameters' covariance factor
LOG_LIKELIHOOD = 10
DEVIANCE = 11  # −2 log p of the readings given the reference, up to a constant
LONG_RUN_VARIANCE = 12  # of the normalised innovations, larger of both axles
DRIFT_DETECTED = 13  # 1 while the innovations' correlation shows that parameters drift
MOTION_MEAN, MOTION_VARIANCE = 14, 16  # recent, of each axle's estimated acceleration
STATISTICS: Final = 18
"""Length of `State.statistics`."""

DRIFT_LAGS: Final = 8
"""Largest lag (readings) of the innovations' autocovariance that the drift detector uses."""

# Columns of a row of `out`.  Where two follow each other, they are those of the front and of the
# rear axle.
MEAN, SD = 0, 3  # of the coordinates of c_f, c_r and i
DEFLECTION, DEFLECTION_SD = 6, 8  # m
PREDICTED, PREDICTED_SD = 10, 12  # readings, m/s²
NIS, READINGS = 14, 15  # normalised innovation squared, and the number of readings in it
NOISE_FACTOR = 16  # on the declared noise variance
INNOVATION = 18  # normalised; the rear one given the front reading
DRIFT = 20  # as DRIFT_DETECTED
COLUMNS: Final = 21


class State(NamedTuple):
    """Belief of the filter; every array is changed in place.

    Parameters
    ----------
    mu, D : (p,) and (p, p) arrays
        Reference of the parameters' coordinates, and directions of the sigma points: row i is
        direction i, zero before its i-th element.
    x, J : (10,) and (p, 10) arrays
        State at the reference, and its derivatives along the directions.
    m, F : (p,) and (p, p) arrays
        Mean and triangular factor (shaped like D) of d; zero and one for a moving reference.
    Pi : (10, 10) array
        Covariance of the state given the parameters.
    statistics : (STATISTICS,) array
        Statistics and timers; their indices are constants of this module.
    snapshots : (2, p, 1 + p) array
        μ and D at two earlier instants at which the fast noise factor was low, older one first.
    autocovariance : (2, 2, 1 + DRIFT_LAGS) array
        Of each axle: lagged normalised innovations (row 0, newest first), and their exponentially
        weighted autocovariance by lag (row 1).
    """

    mu: Array
    D: Array
    x: Array
    J: Array
    m: Array
    F: Array
    Pi: Array
    statistics: Array
    snapshots: Array
    autocovariance: Array


class Model(NamedTuple):
    """Car and sensors.

    Parameters
    ----------
    base, element, log, centre, scale : arrays
        Parameter vector as a function of the coordinates, as in
        :func:`bayes_asv.filters.simd_batch.set_parameters`.
    noise : (12,) array
        White variance of one sample of the front and rear wheel and the front and rear chassis
        sensor, m²/s⁴; variance of their noise that passed the sensors' filters, m²/s⁴; poles of
        these filters, rad/s.
    start : (6,) array
        Prior variances of δ_f, δ̇_f, δ_r, δ̇_r and of the two biases.
    parameter_noise, drift_noise : (p,) arrays
        Process noise of each coordinate, variance per second; the second one, if larger, replaces
        the first while a drift is detected.
    """

    base: Array
    element: NDArray[np.int64]
    log: NDArray[np.bool_]
    centre: Array
    scale: Array
    noise: Array
    start: Array
    parameter_noise: Array
    drift_noise: Array


class FilterSettings(NamedTuple):
    """Thresholds of gating, noise adaptation, fault and drift detection, and relinearization.

    Parameters
    ----------
    gate : float
        Normalised innovation squared beyond which a reading's variance is inflated until it has
        this value.
    prior_readings : float
        Number of readings that the declared noise variance is worth.
    slow_window, fast_window : float
        Time constants (readings) of the slow and of the fast noise factor.
    fast_threshold : float
        Fast noise factor from which on it replaces the slow one.
    fault_threshold : float
        Fast noise factor beyond which something other than noise is at fault.
    fault_duration : float
        Time (s) beyond that threshold after which the filter is reset.
    drift_threshold : float
        Long-run variance of the normalised innovations, one if they are white, beyond which
        parameters are taken to drift; the detection ends below its square root.
    information_gain : float
        Information gain (nats) about the parameters after which the filter is relinearized.
    review_interval : float
        Time (s) after which the filter's window is reviewed in any case.
    """

    gate: float
    prior_readings: float
    slow_window: float
    fast_window: float
    fast_threshold: float
    fault_threshold: float
    fault_duration: float
    drift_threshold: float
    information_gain: float
    review_interval: float


class Steps(NamedTuple):
    """N time steps, each with the readings at its end.

    Parameters
    ----------
    step : (N,) array
        Length, s.
    moments : (N, 2, ORDER) array
        ∫₀ʰ (h−s)ʲ/j! û(s) ds of the measured front and rear wheel acceleration over each step.
    spread : (N, 4) array
        What turns the variance of a wheel's sample into the intensity of process noise (s), front
        and rear, and the intensity that is added for what the wheel did between its samples
        (m²/s³), front and rear.
    kind : (N, 2) int8 array
        Kind of the front and rear chassis reading: ``MISSING``, ``VALUE``, ``AT_LEAST`` or
        ``AT_MOST``.
    reading : (N, 2) array
        Those readings or the rails that they reached, m/s².
    restart : (N,) bool array
        Steps over which the wheels are unknown: the motion starts anew at their ends.
    """

    step: Array
    moments: Array
    spread: Array
    kind: NDArray[np.int8]
    reading: Array
    restart: NDArray[np.bool_]
