"""One run: drive a car over a terrain and keep what was read beside what was true."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .car import RigCar
from .forces import ChassisForce
from .motion import RATE, Motion, lagrange, simulate
from .mounting import Mounting, transfer_coordinates
from .sensors import SensorSpec, sense
from .terrain import Terrain
from .units import INCH, LBF_PER_INCH, LBF_S2_INCH

__all__ = ["RigRun", "drive"]

Reals = npt.NDArray[np.float64]

_MARGIN = 0.25  # s at rest before the record; any filter or delay has settled by then


@dataclass(frozen=True)
class RigRun:
    """A recording and its truth. Channels in the order of ``sensors.CHANNELS``, SI.

    Attributes
    ----------
    rate : float
        Nominal rate, Hz.
    time : ndarray, shape (n,)
        Stamps of the rows, s.
    channels : ndarray, shape (4, n)
        Readings, m/s^2.
    clean : ndarray, shape (4, n)
        What perfect sensors with the same filters and delays would have read, m/s^2.
    counts : ndarray of int, shape (4, n), or None
        Readings as 10-bit counts.
    clipped : ndarray of bool, shape (4, n)
        Readings at a rail.
    states : ndarray, shape (8, n)
        True x, theta, u_f, u_r and their rates at the stamps, SI.
    deflection, deflection_rate : ndarray, shape (2, n)
        True suspension deflections at the stamps, m and m/s.
    tyre_force : ndarray, shape (2, n)
        True tyre forces at the stamps, N.
    truth : dict
        Car, terrain, speed, sensors, forces and seed in plain types, for ``write_truth``.
    motion : Motion or None
        Everything on the internal grid, when it was asked for.
    """

    rate: float
    time: Reals
    channels: Reals
    clean: Reals
    counts: npt.NDArray[np.int64] | None
    clipped: npt.NDArray[np.bool_]
    states: Reals
    deflection: Reals
    deflection_rate: Reals
    tyre_force: Reals
    truth: Mapping[str, Any]
    motion: Motion | None = None


def drive(
    car: RigCar,
    terrain: Terrain,
    speed: float,
    rate: float,
    seconds: float,
    sensors: SensorSpec,
    seed: int,
    *,
    forces: Sequence[ChassisForce] = (),
    mountings: Sequence[Mounting] = (),
    internal_rate: float = RATE,
    keep_motion: bool = False,
) -> RigRun:
    """Drive and record.

    Parameters
    ----------
    car, terrain, sensors : RigCar, Terrain, SensorSpec
        Truth.
    speed : float
        m/s, constant.
    rate : float
        Rows a second.
    seconds : float
        Length of the record; it starts at t = 0 after a quarter second at rest (more, if the
        terrain's lead-in is negative).
    seed : int
        Of noise, jitter and lost rows. Terrain and engine have seeds of their own.
    forces : sequence of ChassisForce
        Outside forces on the chassis.
    mountings : sequence of Mounting
        What moves sensors differently from the points they should measure.
    internal_rate : float
        Integration steps a second.
    keep_motion : bool
        Keep the internal grid in the result.

    Returns
    -------
    RigRun
        Readings and truth.
    """
    ahead = max(*sensors.delay, 0.0) + max(*sensors.clock_offset, 0.0)
    ahead += 3.0 * (sensors.jitter + sensors.hidden_jitter)
    ahead += seconds * 1e-6 * max(*sensors.clock_ppm, 0.0)
    behind = max(0.0, -min(*sensors.clock_offset), -min(*sensors.delay))
    t_start = min(0.0, terrain.lead_in) - _MARGIN - behind
    t_end = seconds + ahead + 0.02
    motion = simulate(car, terrain, speed, t_start, t_end, forces, internal_rate)
    at_sensors = dataclasses.replace(motion, acceleration=transfer_coordinates(motion, mountings))
    reading = sense(at_sensors, sensors, car.l, rate, seconds, np.random.SeedSequence(seed))
    rows = np.concatenate(
        [motion.states[:, :8].T, motion.deflection, motion.deflection_rate, motion.tyre_force]
    )
    at = lagrange(rows, (reading.time - motion.t_start) / motion.step)
    truth = {
        "parameters": _parameters(car),
        "car": _plain(car),
        "terrain": _plain(terrain),
        "speed": speed,
        "rate": rate,
        "seconds": seconds,
        "sensors": _plain(sensors),
        "forces": [_plain(force) for force in forces],
        "seed": seed,
        "internal_rate": internal_rate,
        "peak_deflection": np.abs(motion.deflection).max(axis=1).tolist(),
        "peak_deflection_rate": np.abs(motion.deflection_rate).max(axis=1).tolist(),
        "tyres_lifted": (motion.tyre_force.min(axis=1) <= 0.0).tolist(),
        "clipped": reading.clipped.sum(axis=1).tolist(),
    }
    if mountings:
        truth["mountings"] = [_plain(mounting) for mounting in mountings]
    return RigRun(
        rate=rate,
        time=reading.time,
        channels=reading.values,
        clean=reading.clean,
        counts=reading.counts,
        clipped=reading.clipped,
        states=at[0:8],
        deflection=at[8:10],
        deflection_rate=at[10:12],
        tyre_force=at[12:14],
        truth=truth,
        motion=motion if keep_motion else None,
    )


def _parameters(car: RigCar) -> dict[str, dict[str, float]]:
    """Spell out what the estimator is asked for, in SI and in the reference's units."""
    return {
        "SI": {"c_f": car.c_f, "c_r": car.c_r, "i": car.i, "k_g": car.k_g,
               "zeta_f": car.zeta_f, "zeta_r": car.zeta_r},
        "US": {"c_f": car.c_f / LBF_PER_INCH, "c_r": car.c_r / LBF_PER_INCH,
               "i": car.i / LBF_S2_INCH, "k_g": car.k_g / INCH,
               "zeta_f": car.zeta_f, "zeta_r": car.zeta_r},
    }  # fmt: skip


def _plain(thing: object) -> Any:
    """Turn frozen descriptions into dictionaries that carry the name of their class."""
    if dataclasses.is_dataclass(thing):
        public = [entry.name for entry in dataclasses.fields(thing) if entry.name[0] != "_"]
        return {"kind": type(thing).__name__} | {
            name: _plain(getattr(thing, name)) for name in public
        }
    if isinstance(thing, (tuple, list)):
        return [_plain(part) for part in thing]
    if callable(thing):
        return getattr(thing, "__qualname__", repr(thing))
    if isinstance(thing, float) and not np.isfinite(thing):
        return str(thing)
    return thing
