"""Default widths of priors, where a vehicle file gives none."""

from __future__ import annotations

import math

from bayes_asv.domain.vehicle import Given, Nominal

__all__ = [
    "DAMPING_FACTOR",
    "INERTIA_FACTOR",
    "MAX_PRIOR_DISTANCE",
    "NOISE_GIVEN_SD",
    "NOISE_UNKNOWN_SD",
    "log_normal_sd",
    "prior_log_sd",
]  # fmt: skip

DAMPING_FACTOR = 3.0
"""A damping rate may be off by this factor at one deviation."""
INERTIA_FACTOR = 2.0
"""The same of a moment of inertia."""
NOISE_GIVEN_SD = 0.3
"""Deviation of a noise level's logarithm: a data sheet's figure is good to about a third."""
NOISE_UNKNOWN_SD = math.log(3.0)
"""The same without one: the quiet part of the record gives the level to a factor of three."""
MAX_PRIOR_DISTANCE = 30.0
"""Prior deviations beyond which nothing is tried."""


def log_normal_sd(value: float, sd: float) -> float:
    """Deviation of the logarithm of a log-normal with this median and this deviation."""
    return math.sqrt(math.log(0.5 * (1.0 + math.sqrt(1.0 + 4.0 * (sd / value) ** 2))))


def prior_log_sd(quantity: Given | Nominal, factor: float = DAMPING_FACTOR) -> float:
    """Prior deviation of the logarithm of a quantity of the car.

    Parameters
    ----------
    quantity : Given or Nominal
        As the vehicle file has it.
    factor : float
        One deviation where the file gives none, such as :data:`INERTIA_FACTOR`.
    """
    if quantity.sd is None:
        return math.log(factor)
    return log_normal_sd(quantity.value, quantity.sd)
