"""Can these rows answer at all?  Counted while they come in."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.preprocessing.data_checks import PLAIN, clipping_limit, least_rate, nominal_modes
from bayes_asv.tracking.sensor_noise import Sensing

__all__ = ["Fitness", "unlearned"]

Array = NDArray[np.float64]

# As before a fit, see docs/method.md.
_FEWEST = 100  # rows
_PERIODS = 1.0  # of the slowest mode
_MISSING = 0.2
_SHAKEN = 5.0  # wheel rms in units of its noise
_STILL = 0.05  # m/s²
_LEARNED = 0.7  # of the prior's deviation; and of priors this wide only
_WIDE = 0.3

_WORDS = {"c_f": "front damping", "c_r": "rear damping", "i": "pitch inertia"}
_DRIVES = {
    "c_f": "drive the front wheels over a bump",
    "c_r": "drive the rear wheels over a bump",
    "i": "drive over a bump that pitches the car, such as a parking stop",
}


@dataclass
class Fitness:
    """Counts what a verdict on the rows needs.

    Parameters
    ----------
    rate : float
        Rows a second.
    """

    rate: float
    rows: int = 0
    first: float = np.inf
    last: float = -np.inf
    present: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    clipped: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    total: Array = field(default_factory=lambda: np.zeros(4))
    squares: Array = field(default_factory=lambda: np.zeros(4))

    def count(self, times: Array, acc: Array, sensing: Sensing) -> None:
        """Take rows: stamps (n,), accelerations (n, 4)."""
        if not len(times):
            return
        there = np.isfinite(acc)
        value = np.where(there, acc, 0.0)
        self.rows += len(times)
        self.first = min(self.first, float(times[0]))
        self.last = max(self.last, float(times[-1]))
        self.present += there.sum(axis=0)
        self.clipped += (there & ((acc <= sensing.low) | (acc >= sensing.high))).sum(axis=0)
        self.total += value.sum(axis=0)
        self.squares += (value**2).sum(axis=0)

    def reasons(self, vehicle: Vehicle, sensing: Sensing, source: str) -> list[str]:
        """Say why these rows cannot answer; empty when they may."""
        found = nominal_modes(vehicle)
        slowest, fastest = found[0].natural, found[-1].natural
        seconds = max(self.last - self.first, 0.0)
        needed = max(_PERIODS / slowest, 0.3)
        out = []
        if seconds < needed or self.rows < _FEWEST:
            out.append(
                f"{source} is too short: {seconds:.2f} s in {self.rows} rows, and this car needs "
                f"at least {needed:.2f} s and {_FEWEST} rows; record longer"
            )
        if self.rate < least_rate(found):
            out.append(
                f"{source} was taken at {self.rate:.0f} Hz, too slow for this car, which moves at "
                f"up to {fastest:.1f} Hz; record at {least_rate(found):.0f} Hz or more"
            )
        n = np.maximum(self.present, 1)
        rms = np.sqrt(np.maximum(self.squares / n - (self.total / n) ** 2, 0.0))
        for c, name in enumerate(CHANNELS):
            if self.clipped[c] > clipping_limit(self.rows):
                out.append(
                    f"the {PLAIN[name]} sensor of {source} was at the end of its range in "
                    f"{self.clipped[c]} of {self.rows} samples; drive slower, take a lower bump "
                    "or use a sensor with a wider range"
                )
            missing = self.rows - int(self.present[c])
            if missing > _MISSING * self.rows:
                out.append(
                    f"{missing} of {self.rows} readings of the {PLAIN[name]} sensor of {source} "
                    "are missing; check its wiring and the transfer"
                )
        for axle, c in (("front", 0), ("rear", 2)):
            floor = max(float(np.nan_to_num(sensing.noise[c])), sensing.steps[c] / np.sqrt(12.0))
            if rms[c] < max(_SHAKEN * floor, _STILL):
                out.append(
                    f"the {axle} wheel hardly moved in {source} ({rms[c]:.2f} m/s² rms); drive "
                    "over a bump, a parking stop or a rough road"
                )
        return out

    def warnings(self, source: str) -> list[str]:
        """Say what was wrong with single readings."""
        out = []
        for c, name in enumerate(CHANNELS):
            if self.clipped[c]:
                out.append(
                    f"{self.clipped[c]} {'sample' if self.clipped[c] == 1 else 'samples'} of the "
                    f"{PLAIN[name]} sensor of {source} at the end of its range, used as "
                    f"{'a bound' if self.clipped[c] == 1 else 'bounds'}"
                )
            if self.present[c] < self.rows:
                out.append(
                    f"{_readings(self.rows - int(self.present[c]))} of the {PLAIN[name]} sensor of "
                    f"{source} missing"
                )
        return out


def _readings(count: int) -> str:
    return "1 reading" if count == 1 else f"{count} readings"


def unlearned(log_sd: Array, before: Array, *, lost: bool = False) -> list[str]:
    """Say which of c_f, c_r and i the rows taught next to nothing about.

    Parameters
    ----------
    log_sd, before : (3,) arrays
        Deviations of the logarithms, now and beforehand.
    lost : bool
        Whether the filter was not consistent: then what it learnt was taken back, and a harder
        drive would not help.
    """
    out = []
    for name, now, prior in zip(("c_f", "c_r", "i"), log_sd, before, strict=True):
        if prior > _WIDE and now > _LEARNED * prior:
            out.append(
                f"the filter could not hold the {_WORDS[name]} ({name}): its predictions missed by "
                "far more than the sensors' noise; see whether a sensor is loose or its noise is "
                "given too small, or ask 'bayes-asv diagnose' what the half car lacks"
                if lost
                else f"the recording says next to nothing about the {_WORDS[name]} ({name}): "
                f"{_DRIVES[name]}, faster or over a higher one"
            )
    return out
