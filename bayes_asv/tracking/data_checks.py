"""Checks of the rows as they come: whether they can answer the question at all."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS, channel
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.cars import car_model
from bayes_asv.models.modes import nominal_modes
from bayes_asv.preprocessing.data_checks import clipping_limit, least_rate
from bayes_asv.tracking.sensor_noise import SensorModel

__all__ = ["DataChecks", "unidentified_parameters"]

Array = NDArray[np.float64]

# As for `estimate`, see bayes_asv.preprocessing.data_checks.
_MIN_ROWS = 100
_MIN_PERIODS = 1.0  # of the slowest mode
_MAX_MISSING = 0.2  # share of the readings of a channel
_MIN_EXCITATION = 5.0  # rms of a wheel over its noise
_MIN_RMS = 0.05  # of a wheel, m/s²
_LEARNED = 0.7  # posterior over prior standard deviation of a parameter that was learnt
_WIDE_PRIOR = 0.3  # standard deviation of a logarithm; a narrower prior is an answer already

_NAMES = {"c_f": "front damping", "c_r": "rear damping", "i": "pitch inertia"}
_DRIVES = {
    "c_f": "drive the front wheels over a bump",
    "c_r": "drive the rear wheels over a bump",
    "i": "drive over a bump that pitches the car, such as a parking stop",
}


@dataclass
class DataChecks:
    """Accumulates the statistics that the checks need.

    Parameters
    ----------
    rate : float
        Rows per second, Hz.
    """

    rate: float
    rows: int = 0
    first: float = np.inf
    last: float = -np.inf
    present: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    clipped: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    total: Array = field(default_factory=lambda: np.zeros(4))
    squares: Array = field(default_factory=lambda: np.zeros(4))

    def update(self, times: Array, acc: Array, sensors: SensorModel) -> None:
        """Add rows: stamps (n,), s, and accelerations (n, 4), m/s²."""
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

    def reasons(self, vehicle: Vehicle, sensors: SensorModel, source: str) -> list[str]:
        """List why these rows cannot answer; empty when they may."""
        modes = nominal_modes(car_model("half", vehicle))
        slowest, fastest = modes[0].natural, modes[-1].natural
        seconds = max(self.last - self.first, 0.0)
        needed = max(_MIN_PERIODS / slowest, 0.3)
        out = []
        if seconds < needed or self.rows < _MIN_ROWS:
            out.append(
                f"{source} is too short: {seconds:.2f} s in {self.rows} rows, and this car needs "
                f"at least {needed:.2f} s and {_MIN_ROWS} rows; record longer"
            )
        if self.rate < least_rate(modes):
            out.append(
                f"{source} was taken at {self.rate:.0f} Hz, too slow for this car, which moves at "
                f"up to {fastest:.1f} Hz; record at {least_rate(modes):.0f} Hz or more"
            )
        n = np.maximum(self.present, 1)
        rms = np.sqrt(np.maximum(self.squares / n - (self.total / n) ** 2, 0.0))
        for c, name in enumerate(CHANNELS):
            if self.clipped[c] > clipping_limit(self.rows):
                out.append(
                    f"the {channel(name).words} sensor of {source} was at the end of its range in "
                    f"{self.clipped[c]} of {self.rows} samples; drive slower, take a lower bump "
                    "or use a sensor with a wider range"
                )
            missing = self.rows - int(self.present[c])
            if missing > _MAX_MISSING * self.rows:
                out.append(
                    f"{missing} of {self.rows} readings of the {channel(name).words} sensor of "
                    f"{source} are missing; check its wiring and the transfer"
                )
        for axle, c in (("front", 0), ("rear", 2)):
            quantization = sensors.resolution[c] / np.sqrt(12.0)
            floor = max(float(np.nan_to_num(sensors.noise[c])), quantization)
            if rms[c] < max(_MIN_EXCITATION * floor, _MIN_RMS):
                out.append(
                    f"the {axle} wheel hardly moved in {source} ({rms[c]:.2f} m/s² rms); drive "
                    "over a bump, a parking stop or a rough road"
                )
        return out

    def warnings(self, source: str) -> list[str]:
        """List faults of single readings that the filter copes with."""
        out = []
        for c, name in enumerate(CHANNELS):
            if self.clipped[c]:
                out.append(
                    f"{self.clipped[c]} {'sample' if self.clipped[c] == 1 else 'samples'} of the "
                    f"{channel(name).words} sensor of {source} at the end of its range, used as "
                    f"{'a bound' if self.clipped[c] == 1 else 'bounds'}"
                )
            if self.present[c] < self.rows:
                missing = self.rows - int(self.present[c])
                out.append(
                    f"{missing} {'reading' if missing == 1 else 'readings'} of the "
                    f"{channel(name).words} sensor of {source} missing"
                )
        return out


def unidentified_parameters(
    log_sd: Array, prior_log_sd: Array, *, inconsistent: bool = False
) -> list[str]:
    """List which of c_f, c_r and i the rows did not identify.

    Parameters
    ----------
    log_sd, prior_log_sd : (3,) arrays
        Standard deviations of the logarithms, posterior and prior.
    inconsistent : bool
        Whether the filter was inconsistent: then it discarded what it had learnt, and a harder
        drive would not help.
    """
    out = []
    for name, sd, prior in zip(("c_f", "c_r", "i"), log_sd, prior_log_sd, strict=True):
        if prior > _WIDE_PRIOR and sd > _LEARNED * prior:
            out.append(
                f"the filter could not track the {_NAMES[name]} ({name}): its prediction errors "
                "are far larger than the sensors' noise; check whether a sensor is loose or its "
                "noise is given too small, or find with 'bayes-asv diagnose' what the half car "
                "lacks"
                if inconsistent
                else f"the recording hardly constrains the {_NAMES[name]} ({name}): "
                f"{_DRIVES[name]}, faster or over a higher one"
            )
    return out
