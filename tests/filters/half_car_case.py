"""A small recording of the half car as the unscented filter takes it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import channel
from bayes_asv.filters.kalman import (
    MISSING,
    FilterPass,
    Measurements,
    SensorNoise,
    filter_pass,
)  # fmt: skip
from bayes_asv.models.car_model import Output, state_space
from bayes_asv.models.cars import car_model
from bayes_asv.models.half_car_equations import HalfCar
from tests.filters.linear_cases import VEHICLE, straight_moments

__all__ = ["CAR", "Prepared", "kalman_pass", "recursion_case"]

Array = NDArray[np.float64]
Prepared = tuple[Array, Array, Array, NDArray[np.int8], Array, Array, Array]

CAR = HalfCar(1261.0, 1751.0, 70.7, 226.6, 1.727, 0.47, 17513.0, 17513.0)


def recursion_case(
    seed: int, n: int = 25, missing: bool = True
) -> tuple[Array, Array, Array, Prepared]:
    """Uneven steps, missing readings, straight inputs: time, inputs, noise and the arrays.

    Noise is white variances, filtered variances and poles (12,), inputs before outputs; the arrays
    are those of `Measurements`, with prior variances (6,) in place of their covariance.
    """
    rng = np.random.default_rng(seed)
    step = np.append(0.0, rng.uniform(0.001, 0.005, n - 1))
    u = 5.0 * rng.normal(size=(n, 2))
    kind = np.ones((n, 2), np.int8)
    if missing:
        kind[rng.uniform(size=(n, 2)) < 0.2] = MISSING
    spread = np.stack([step, step, 0.01 * step, 0.02 * step], axis=1)
    reading = 3.0 * rng.normal(size=(n, 2))
    extra = 0.01 * rng.uniform(size=(n, 2))
    start = np.array([0.01, 0.5, 0.02, 0.4, 1.0, 2.0])
    noise = np.array([0.02, 0.03, 0.05, 0.04, 0.01, 0.02, 0.03, 0.02, 314.0, 314.0, 280.0, 300.0])
    arrays = (step, straight_moments(step, u), spread, kind, reading, extra, start)
    return np.cumsum(step), u, noise, arrays


def kalman_pass(noise: Array, arrays: Prepared) -> FilterPass:
    """One pass of the Kalman filter for `CAR`."""
    model = car_model("half", VEHICLE)
    values = {name: np.array([x]) for name, x in CAR._asdict().items()}
    outputs = [Output(channel("front_chassis")), Output(channel("rear_chassis"))]
    of_sensors = SensorNoise(noise[None, :4], noise[None, 4:8], noise[None, 8:])
    data = Measurements(*arrays[:6], np.diag(arrays[6]))
    return filter_pass(state_space(model, values, outputs), of_sensors, data)
