"""Candidate drives: road profiles that a team can build or find, speeds, sampling rates.

The recording comes from the wheel hubs, which do not follow every corner of the road.  A tyre
envelops the profile: a disc of the tyre's radius rolls over it, and the contact patch averages the
result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bayes_asv.domain.units import FOOT, INCH, KMH, MPH
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.modes import nominal_modes

__all__ = [
    "ISO_8608",
    "KINDS",
    "LEAD_IN",
    "RATES",
    "Drive",
    "RoadProfile",
    "candidate_drives",
    "enveloped_profile",
    "road_profiles",
    "speeds",
]

Array = NDArray[np.float64]

LEAD_IN = 0.5
"""Level road at the beginning of each recording, s."""

KINDS = ("bump", "stops", "rollers", "rough")
"""Kinds of road, in order of preference for planning."""

RATES = (100.0, 200.0, 400.0, 800.0)
"""Sampling rates of common loggers, Hz."""

# Displacement density at 0.1 cycles/m, geometric means of ISO 8608:2016, table A.1, m³.
ISO_8608 = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}

_STOP_BASE, _STOP_TOP = (
    0.15,
    0.10,
)  # m along the road: concrete stops are 6 in wide at the base and 4 in on top
_LONGEST_WAVE, _SHORTEST_WAVE = 20.0, 0.15  # m; the contact patch averages over shorter waves
_TYRE_RADIUS = 0.27  # m, half of a 21 in tyre
# Length of the contact patch over the chord of the undeformed circle at the same deflection.
_CONTACT_FRACTION = 2.0 / 3.0
_GRID_STEP = 0.005  # m


@dataclass(frozen=True)
class RoadProfile:
    """A road profile on level ground, the same under both sides of the car.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    height : float
        Height of a bump or stop, or of a roller from trough to crest, m; 0 for a rough road.
    length : float
        Length of a bump, clear distance between two stops or wavelength of the rollers, m; 0 for a
        rough road.
    count : int
        Number of bumps, stops or rollers; 0 for a rough road.
    iso : str
        ISO 8608 class of a rough road, else empty.
    """

    kind: str
    height: float = 0.0
    length: float = 0.0
    count: int = 0
    iso: str = ""

    @property
    def extent(self) -> float:
        """Length of the obstacle, m; infinite for a rough road."""
        if self.kind == "rough":
            return math.inf
        if self.kind == "stops":
            return self.count * _STOP_BASE + (self.count - 1) * self.length
        return self.count * self.length

    def profile(self, x: Array, seed: int = 0) -> Array:
        """Return the height, m, of the road at distances x; zero before x = 0.

        Parameters
        ----------
        x : (N,) array
            Increasing distances, m.
        seed : int
            Seed of a rough road with the displacement density G(n) = G₀ (n/0.1)⁻² of ISO 8608.
        """
        if self.kind == "rough":
            return _rough(x, ISO_8608[self.iso], seed)
        if self.kind == "stops":
            ramp = 0.5 * (_STOP_BASE - _STOP_TOP)
            corners = np.array([0.0, ramp, _STOP_BASE - ramp, _STOP_BASE])
            stops = [
                np.interp(x - k * (_STOP_BASE + self.length), corners, [0.0, 1.0, 1.0, 0.0])
                for k in range(self.count)
            ]
            return np.asarray(self.height * np.sum(stops, axis=0))
        inside = (x > 0.0) & (x < self.extent)
        wave = 0.5 * self.height * (1.0 - np.cos(2.0 * np.pi * x / self.length))
        return np.where(inside, wave, 0.0)


def _rough(x: Array, density: float, seed: int) -> Array:
    """Random road: sines of random phase with logarithmically spaced wavenumbers."""
    rng = np.random.default_rng([seed, 8608])
    edges = np.geomspace(1.0 / _LONGEST_WAVE, 1.0 / _SHORTEST_WAVE, 161)
    wavenumber = np.sqrt(edges[1:] * edges[:-1])
    variance = density * (wavenumber / 0.1) ** -2.0 * np.diff(edges)
    # normal amplitudes, so that the roughness varies between seeds as between real roads
    amplitude = rng.normal(size=(2, len(wavenumber))) * np.sqrt(variance)
    phase = 2.0 * np.pi * x[:, None] * wavenumber
    s = np.clip(x, 0.0, 1.0)
    fade_in = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return np.asarray((np.sin(phase) @ amplitude[0] + np.cos(phase) @ amplitude[1]) * fade_in)


def enveloped_profile(
    road: RoadProfile, end: float, start: float, static_deflection: float, seed: int = 0
) -> CubicSpline:
    """Envelope a road profile with a rolling tyre: the path of a hub on a stiff tyre.

    Parameters
    ----------
    road : RoadProfile
        The bare road.
    end : float
        Distance covered after the beginning of the obstacle, m.
    start : float
        Distance covered before the beginning of the obstacle, m.
    static_deflection : float
        Static deflection of the tyre, m, which sets the length of the contact patch.
    seed : int
        Seed of a rough road.

    Returns
    -------
    CubicSpline
        Height, m, over the distance from the beginning of the obstacle, m.
    """
    # the effective width of a raised cosine is half its length
    patch_length = 2.0 * _CONTACT_FRACTION * 2.0 * math.sqrt(2.0 * _TYRE_RADIUS * static_deflection)
    margin = _TYRE_RADIUS + patch_length
    x = np.arange(-start - margin, end + margin, _GRID_STEP)
    height = road.profile(x, seed)
    half = int(_TYRE_RADIUS / _GRID_STEP)
    across = _GRID_STEP * np.arange(-half, half + 1)
    sag = _TYRE_RADIUS - np.sqrt(np.maximum(_TYRE_RADIUS**2 - across**2, 0.0))
    disc = np.max(
        [np.roll(height, int(k)) - s for k, s in zip(range(-half, half + 1), sag, strict=True)],
        axis=0,
    )
    patch = 1.0 + np.cos(np.linspace(-np.pi, np.pi, max(round(patch_length / _GRID_STEP), 3) | 1))
    smooth = np.convolve(np.pad(disc, len(patch) // 2, mode="edge"), patch / patch.sum(), "valid")
    return CubicSpline(x, smooth)


_ROUGH_SECONDS = 4.0
_REST_TIME = 1.0  # s, minimum after the last wheel has left the obstacle
_PERIODS = 1.5  # of the slowest mode, if longer
_MAX_SECONDS = 12.0  # s


class Drive(NamedTuple):
    """One candidate drive.

    Parameters
    ----------
    road : RoadProfile
        The road.
    speed : float
        Speed, m/s.
    rate : float
        Sampling rate, Hz.
    seconds : float
        Length of the recording, including :data:`LEAD_IN` before the obstacle.
    """

    road: RoadProfile
    speed: float
    rate: float
    seconds: float


def road_profiles(units: str) -> tuple[RoadProfile, ...]:
    """Return the roads considered, with dimensions in round numbers of the vehicle's units."""
    if units == "US":
        heights, lengths = [2 * INCH, 3 * INCH, 4 * INCH], [3 * FOOT, 5 * FOOT]
        stops, gap = [3 * INCH, 4 * INCH], 12 * INCH
        waves = [(1.5 * INCH, 3 * FOOT), (2 * INCH, 5 * FOOT)]
    else:
        heights, lengths = [0.05, 0.075, 0.10], [0.9, 1.5]
        stops, gap = [0.075, 0.10], 0.30
        waves = [(0.04, 0.9), (0.05, 1.5)]
    return (
        *(RoadProfile("bump", h, l, 1) for h in heights for l in lengths),
        *(RoadProfile("stops", h, gap, 2) for h in stops),
        *(RoadProfile("rough", iso=iso) for iso in "DE"),
        *(RoadProfile("rollers", h, pitch, 8) for h, pitch in waves),
    )


def speeds(kind: str, units: str) -> tuple[float, ...]:
    """Return the speeds, m/s, for a kind of road, in round numbers of the vehicle's units."""
    if units == "US":
        round_numbers = {
            "bump": (4, 6, 8, 10, 12, 15, 20),
            "stops": (3, 4, 5, 6, 7, 8, 10),
            "rough": (5, 8, 12, 16, 20),
            "rollers": (4, 6, 8, 10, 12, 15),
        }
        return tuple(v * MPH for v in round_numbers[kind])
    round_numbers = {
        "bump": (6, 10, 13, 16, 20, 25, 32),
        "stops": (5, 6, 8, 10, 11, 13, 16),
        "rough": (8, 13, 20, 25, 32),
        "rollers": (6, 10, 13, 16, 20, 25),
    }
    return tuple(v * KMH for v in round_numbers[kind])


def candidate_drives(
    car: CarModel,
    units: str,
    rates: Sequence[float] = RATES,
    kinds: Sequence[str] = KINDS,
    speed_limit: float = math.inf,
) -> list[Drive]:
    """Return all combinations of road, speed and sampling rate.

    Parameters
    ----------
    car : CarModel
        Its wheelbase and slowest mode determine the length of the recordings.
    units : str
        ``US`` or ``SI``, for round numbers.
    rates, kinds : sequences of float and str
        Sampling rates, Hz, and kinds of road.
    speed_limit : float
        Largest speed, m/s.

    Returns
    -------
    list of Drive
        Sorted by road, speed and rate.
    """
    slowest = nominal_modes(car)[0].natural
    wheelbase = float(car.nominal["l"][0]) if "l" in car.names else 0.0
    return [
        Drive(road, speed, rate, _seconds(road, speed, wheelbase, slowest))
        for road in road_profiles(units)
        if road.kind in kinds
        for speed in speeds(road.kind, units)
        if speed <= speed_limit * (1.0 + 1e-6)
        for rate in rates
    ]


def _seconds(road: RoadProfile, speed: float, wheelbase: float, slowest: float) -> float:
    """Length of a recording, s, rounded up to tenths."""
    if math.isinf(road.extent):
        seconds = max(_ROUGH_SECONDS, _PERIODS / slowest)
    else:
        seconds = LEAD_IN + (road.extent + wheelbase) / speed + max(_REST_TIME, _PERIODS / slowest)
    return min(math.ceil(10.0 * seconds - 1e-9) / 10.0, _MAX_SECONDS)
