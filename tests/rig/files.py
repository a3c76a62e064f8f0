"""Write what the estimator reads (recording, vehicle) and what it must not see (truth)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

from .car import DECLARED_SDS, RigCar
from .run import RigRun
from .sensors import CHANNELS, SensorSpec
from .units import INCH, LBF_PER_INCH, LBF_S2_INCH, LBF_S2_PER_INCH

__all__ = ["vehicle_toml", "write_csv", "write_truth"]

_KNOWN = (
    ("sprung_mass", "m", LBF_S2_PER_INCH, "lbf*s^2/in"),
    ("wheelbase", "l", INCH, "in"),
    ("front_weight_fraction", "wdf", 1.0, ""),
    ("front_spring_rate", "k_f", LBF_PER_INCH, "lbf/in"),
    ("rear_spring_rate", "k_r", LBF_PER_INCH, "lbf/in"),
)
_NOMINAL = (
    ("front_damping", "c_f", LBF_PER_INCH, "lbf*s/in"),
    ("rear_damping", "c_r", LBF_PER_INCH, "lbf*s/in"),
    ("pitch_inertia", "i", LBF_S2_INCH, "lbf*s^2*in"),
)


def write_csv(
    run: RigRun,
    path: Path | str,
    note: str = "",
    metadata: Mapping[str, str] | None = None,
    counts: bool = False,
) -> None:
    """Write a recording.

    Parameters
    ----------
    run : RigRun
        What to write; only what a logger would know goes into the file.
    path : Path or str
        File.
    note : str
        Value of the ``note`` line; left out when empty.
    metadata : mapping of str to str
        More ``# key = value`` lines, such as ``{"clock rear": "48.3 ppm"}``.
    counts : bool
        Write converter counts in place of in/s^2.

    Raises
    ------
    ValueError
        When counts are asked of a run without a converter.
    """
    lines = [f"# sample_rate = {run.rate:g} Hz"]
    if note:
        lines.append(f"# note = {note}")
    lines += [f"# {key} = {value}" for key, value in (metadata or {}).items()]
    unit = "counts" if counts else "in/s^2"
    lines.append(",".join(["time [s]", *(f"{name} [{unit}]" for name in CHANNELS)]))
    if counts:
        if run.counts is None:
            raise ValueError("this run has no converter (sensors.adc is None), so no counts")
        rows = zip(run.time, *run.counts, strict=True)
        lines += [f"{t:.9f},{a:d},{b:d},{c:d},{d:d}" for t, a, b, c, d in rows]
    else:
        rows = zip(run.time, *(run.channels / INCH), strict=True)
        lines += [f"{t:.9f},{a:.9g},{b:.9g},{c:.9g},{d:.9g}" for t, a, b, c, d in rows]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_truth(run: RigRun, path: Path | str) -> None:
    """Write the answers of a run as JSON."""
    Path(path).write_text(json.dumps(run.truth, indent=1) + "\n", encoding="utf-8")


def vehicle_toml(
    car: RigCar,
    sensors: SensorSpec,
    sds: Mapping[str, float] = DECLARED_SDS,
    travel: Mapping[str, float] | None = None,
    nominal_sds: Mapping[str, float] | None = None,
) -> str:
    """Write a vehicle file out of a *nominal* car and *declared* sensors.

    Parameters
    ----------
    car : RigCar
        What the team believes.
    sensors : SensorSpec
        What the data sheets say; gain, bias and drift have no place in the file.
    sds : mapping of str to float
        Relative deviations of ``m``, ``wdf``, ``l``, ``k_f``, ``k_r``; zero means exact.
    travel : mapping of str to float, optional
        Of ``front_bump``, ``front_droop``, ``rear_bump``, ``rear_droop``, m.
    nominal_sds : mapping of str to float, optional
        Relative deviations of the priors of ``c_f``, ``c_r``, ``i``.

    Returns
    -------
    str
        TOML of ``docs/interfaces.md``.
    """
    lines = [f'name  = "{car.name}"', 'units = "US"', "", "[known]"]
    lines += [_entry(car, row, sds) for row in _KNOWN]
    lines += ["", "[nominal]"]
    lines += [_entry(car, row, nominal_sds or {}) for row in _NOMINAL]
    if travel:
        lines += ["", "[travel]"]
        lines += [
            f'{key} = {{ value = {value / INCH:.12g}, unit = "in" }}'
            for key, value in travel.items()
        ]
    for j, name in enumerate(CHANNELS):
        lines += ["", f"[sensors.{name}]", *_sensor(sensors, j)]
    return "\n".join(lines) + "\n"


def _entry(car: RigCar, row: tuple[str, str, float, str], sds: Mapping[str, float]) -> str:
    """Write one value with its unit, and its deviation if it has one."""
    key, field, factor, unit = row
    parts = [f"value = {getattr(car, field) / factor:.12g}"]
    if unit:
        parts.append(f'unit = "{unit}"')
    if sds.get(field, 0.0) > 0.0:
        parts.append(f'sd = "{100.0 * sds[field]:.6g} %"')
    return f"{key} = {{ {', '.join(parts)} }}"


def _sensor(sensors: SensorSpec, j: int) -> list[str]:
    """Write one channel's table."""
    lines = []
    if sensors.adc is not None:
        zero, scale = sensors.adc.zero[j], sensors.adc.scale[j] / INCH
        low, high = -zero * scale, (sensors.adc.top - zero) * scale
        lines += [
            f"zero_counts = {zero:.12g}",
            f'counts_scale = {{ value = {scale:.12g}, unit = "in/s^2" }}',
            f'range = {{ low = {low:.12g}, high = {high:.12g}, unit = "in/s^2" }}',
            f'resolution = {{ value = {scale:.12g}, unit = "in/s^2" }}',
        ]
    if sensors.noise[j] > 0.0:
        lines.append(f'noise = {{ value = {sensors.noise[j] / INCH:.12g}, unit = "in/s^2" }}')
    if math.isfinite(sensors.bandwidth[j]):
        lines.append(f'bandwidth = {{ value = {sensors.bandwidth[j]:.12g}, unit = "Hz" }}')
    lines.append(f'delay = {{ value = {sensors.delay[j]:.12g}, unit = "s" }}')
    return lines
