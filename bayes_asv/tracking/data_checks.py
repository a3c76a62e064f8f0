"""Checks of the rows as they arrive: whether they determine the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.identifiability import unidentified_sentence
from bayes_asv.posterior.information import WIDE_PRIOR, unmeasured
from bayes_asv.preprocessing.activity import FEWEST_ROWS
from bayes_asv.preprocessing.data_checks import (
    LEAST_PERIODS,
    MIN_EXCITATION,
    min_sampling_rate,
    mistaken_time_unit,
    still_wheel,
)
from bayes_asv.preprocessing.faulty_channels import clipping_limit
from bayes_asv.tracking.sensor_noise import SensorModel

__all__ = ["DataChecks", "unidentified_parameters"]

Array = NDArray[np.float64]

# Limits as for `estimate`, see bayes_asv.preprocessing.data_checks.
_MAX_MISSING = 0.2  # largest share of missing readings of a channel
_MIN_RMS = 0.05  # least rms of a wheel, m/s²


@dataclass
class DataChecks:
    """Accumulates the statistics that the checks need.

    Parameters
    ----------
    rate : float
        Rows per second, Hz.
    channels : int
        Number of channels, C.
    """

    rate: float
    channels: int = 4
    rows: int = 0
    first: float = np.inf
    last: float = -np.inf
    present: NDArray[np.int64] = field(init=False)
    clipped: NDArray[np.int64] = field(init=False)
    total: Array = field(init=False)
    squares: Array = field(init=False)

    def __post_init__(self) -> None:
        self.present, self.clipped = np.zeros((2, self.channels), np.int64)
        self.total, self.squares = np.zeros((2, self.channels))

    def update(self, times: Array, acc: Array, sensors: SensorModel) -> None:
        """Add rows: stamps (n,), s, and readings (n, C), SI units."""
        if not len(times):
            return
        present = np.isfinite(acc)
        value = np.where(present, acc, 0.0)
        self.rows += len(times)
        self.first = min(self.first, float(times[0]))
        self.last = max(self.last, float(times[-1]))
        self.present += present.sum(axis=0)
        self.clipped += (present & ((acc <= sensors.low) | (acc >= sensors.high))).sum(axis=0)
        self.total += value.sum(axis=0)
        self.squares += (value**2).sum(axis=0)

    def reasons(self, sensors: SensorModel, source: str) -> list[str]:
        """List the reasons to refuse these rows."""
        modes = nominal_modes(sensors.car)
        slowest, fastest = modes[0].natural, modes[-1].natural
        seconds = max(self.last - self.first, 0.0)
        needed = max(LEAST_PERIODS / slowest, 0.3)
        out = []
        if seconds < needed or self.rows < FEWEST_ROWS:
            out.append(
                f"{source} is too short: {seconds:.2f} s in {self.rows} rows, and this car needs "
                f"at least {needed:.2f} s and {FEWEST_ROWS} rows; record longer"
            )
        mistaken = mistaken_time_unit(source, self.rate, min_sampling_rate(modes))
        if mistaken:
            return [*out, mistaken]
        if self.rate < min_sampling_rate(modes):
            out.append(
                f"{source} was taken at {self.rate:.0f} Hz, too slow for this car, which moves at "
                f"up to {fastest:.1f} Hz; record at {min_sampling_rate(modes):.0f} Hz or more"
            )
        n = np.maximum(self.present, 1)
        rms = np.sqrt(np.maximum(self.squares / n - (self.total / n) ** 2, 0.0))
        for c, channel in enumerate(sensors.channels):
            if self.clipped[c] > clipping_limit(self.rows):
                out.append(
                    f"the {channel.words} sensor of {source} was at the end of its range in "
                    f"{self.clipped[c]} of {self.rows} samples; drive slower, take a lower bump "
                    "or use a sensor with a wider range"
                )
            missing = self.rows - int(self.present[c])
            if missing > _MAX_MISSING * self.rows:
                out.append(
                    f"{missing} of {self.rows} readings of the {channel.words} sensor of "
                    f"{source} are missing; check its wiring and the transfer"
                )
        for c in sensors.inputs:
            quantisation = sensors.resolution[c] / np.sqrt(12.0)
            floor = max(float(np.nan_to_num(sensors.noise[c])), quantisation)
            if rms[c] < max(MIN_EXCITATION * floor, _MIN_RMS):
                out.append(still_wheel(source, sensors.channels, c, rms.tolist()))
        return out

    def warnings(self, sensors: SensorModel, source: str) -> list[str]:
        """List faults of single readings that the filter tolerates."""
        out = []
        for c, channel in enumerate(sensors.channels):
            if self.clipped[c]:
                out.append(
                    f"{self.clipped[c]} {'sample' if self.clipped[c] == 1 else 'samples'} of the "
                    f"{channel.words} sensor of {source} at the end of its range, used as "
                    f"{'a bound' if self.clipped[c] == 1 else 'bounds'}"
                )
            if self.present[c] < self.rows:
                missing = self.rows - int(self.present[c])
                out.append(
                    f"{missing} {'reading' if missing == 1 else 'readings'} of the "
                    f"{channel.words} sensor of {source} missing"
                )
        return out


def unidentified_parameters(
    car: CarModel,
    measured: Sequence[Channel],
    prior_sd: Mapping[str, float],
    posterior_sd: Mapping[str, float],
    *,
    inconsistent: bool = False,
) -> list[str]:
    """List the parameters of interest that the rows do not identify.

    Parameters
    ----------
    car : CarModel
        The car.
    measured : sequence of Channel
        Its measured outputs.
    prior_sd, posterior_sd : mappings of str to float
        Standard deviations of the logarithms of the parameters of interest.
    inconsistent : bool
        Whether the filter was inconsistent: it has then discarded its information, and a harder
        drive would not help.
    """
    return [
        f"the filter could not track the {QUANTITIES[name][1]} ({name}): its prediction errors are "
        "far larger than the sensors' noise; check whether a sensor is loose or its noise is given "
        f"too small, or find with 'bayes-asv diagnose' what the {car.name} car lacks"
        if inconsistent
        else unidentified_sentence(car, measured, name, prior_sd[name])
        for name in unmeasured(prior_sd, posterior_sd)
        if prior_sd[name] > WIDE_PRIOR
    ]
