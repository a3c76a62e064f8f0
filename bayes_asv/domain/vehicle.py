"""What is known about a vehicle, what is only nominal, and what is mounted on it.

Everything inside is SI floats. Quantities are effective at the wheel and for both sides of an
axle together. The front weight fraction places the centre of gravity: it lies l_f = l (1 - wdf)
behind the front axle and l_r = l wdf ahead of the rear axle.
"""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Literal

from bayes_asv.domain.channels import CHANNELS, ROLL_CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest, read_bytes, write_whole
from bayes_asv.domain.units import display_units, si_factor
from bayes_asv.domain.vehicle_checks import make_sense
from bayes_asv.domain.vehicle_parts import Given, Nominal, Roll, Sensor, Travel, Unsprung

if TYPE_CHECKING:
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.vehicle_file import Measured, RollTable, SensorTable, UnsprungTable

__all__ = [
    "CHANNELS",
    "Given",
    "Nominal",
    "Roll",
    "Sensor",
    "Travel",
    "Unsprung",
    "Vehicle",
    "read_vehicle",
    "to_toml",
    "write_vehicle",
]

_LARGEST_FILE: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A half car: what is known, nominal and mounted.

    Two vehicles are equal when they say the same, whatever file they came from.

    Parameters
    ----------
    name : str
        What to call it.
    units : {"US", "SI"}
        How results are shown.
    m : Given
        Sprung mass, kg.
    l : Given
        Wheelbase, m.
    wdf : Given
        Share of the weight on the front axle.
    k_f, k_r : Given
        Spring rates, N/m.
    c_f, c_r : Nominal
        Damping rates, N s/m.
    i : Nominal
        Pitch inertia of the sprung mass, kg m^2.
    travel : Travel
        Suspension travel.
    sensors : tuple of 4 Sensor
        In the order of `CHANNELS`.
    corner_sensors : tuple of (str, Sensor)
        Those of single corners by channel, in the order of `ROLL_CHANNELS`.
    unsprung : Unsprung or None
        Wheels and tyres.
    roll : Roll or None
        What the car needs to roll.
    source, sha256 : str
        Name and hash of the file it was read from; empty when it was not.
    """

    name: str
    units: Literal["US", "SI"]
    m: Given
    l: Given
    wdf: Given
    k_f: Given
    k_r: Given
    c_f: Nominal
    c_r: Nominal
    i: Nominal
    travel: Travel = field(default_factory=Travel)
    sensors: tuple[Sensor, Sensor, Sensor, Sensor] = field(
        default_factory=lambda: (Sensor(), Sensor(), Sensor(), Sensor())
    )
    corner_sensors: tuple[tuple[str, Sensor], ...] = ()
    unsprung: Unsprung | None = None
    roll: Roll | None = None
    source: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)

    def sensor(self, name: str) -> Sensor:
        """Sensor of one channel.

        That of a corner without a table of its own is like the axle's, but for its zero and its
        scale in counts, which are each sensor's own.

        Raises
        ------
        InputError
            If `name` is not one of `CHANNELS` or `ROLL_CHANNELS`.
        """
        if name in ROLL_CHANNELS and name not in CHANNELS:
            axle, _, place = name.split("_")
            alike = self.sensors[CHANNELS.index(f"{axle}_{place}")]
            step = alike.resolution or (abs(alike.counts_scale) if alike.counts_scale else None)
            alike = replace(
                alike, zero_counts=None, counts_scale=None, counts_scale_sd=0.0, resolution=step
            )
            return dict(self.corner_sensors).get(name, alike)
        if name not in CHANNELS:
            near = closest(name, CHANNELS)
            mend = f"did you mean {near}?" if near else f"channels are {', '.join(CHANNELS)}"
            raise InputError(f"channel '{name}'", "there is no such channel", mend)
        return self.sensors[CHANNELS.index(name)]

    @property
    def l_f(self) -> float:
        """Centre of gravity to front axle, m."""
        return self.l.value * (1.0 - self.wdf.value)

    @property
    def l_r(self) -> float:
        """Centre of gravity to rear axle, m."""
        return self.l.value * self.wdf.value

    @property
    def k_g(self) -> float:
        """Radius of gyration in pitch at the nominal inertia, m."""
        return math.sqrt(self.i.value / self.m.value)

    @property
    def zeta_f(self) -> float:
        """Damping ratio of the front axle alone, at nominal damping."""
        return self.c_f.value / (2.0 * math.sqrt(self.k_f.value * self.m.value * self.wdf.value))

    @property
    def zeta_r(self) -> float:
        """Damping ratio of the rear axle alone, at nominal damping."""
        return self.c_r.value / (
            2.0 * math.sqrt(self.k_r.value * self.m.value * (1.0 - self.wdf.value))
        )


def read_vehicle(path: PathLike) -> Vehicle:
    """Read a vehicle file (TOML).

    Parameters
    ----------
    path : str or os.PathLike
        The file; its tables are described in ``data/README.md``.

    Returns
    -------
    Vehicle
        Everything in SI.

    Raises
    ------
    InputError
        One line with the file, the key and the mend: unreadable file, unknown or missing key,
        wrong unit, value that no vehicle has.
    """
    from bayes_asv.domain.vehicle_file import (
        parse_vehicle,
    )  # pydantic costs 0.1 s; pay when reading

    source = os.fspath(path)
    data = read_bytes(path, _LARGEST_FILE)
    tables = parse_vehicle(data, source)
    known, nominal, travel = tables.known, tables.nominal, tables.travel
    found = Vehicle(
        name=tables.name or os.path.splitext(os.path.basename(source))[0],
        units=tables.units,
        m=_given(known.sprung_mass),
        l=_given(known.wheelbase),
        wdf=_given(known.front_weight_fraction),
        k_f=_given(known.front_spring_rate),
        k_r=_given(known.rear_spring_rate),
        c_f=Nominal(*nominal.front_damping),
        c_r=Nominal(*nominal.rear_damping),
        i=Nominal(*nominal.pitch_inertia),
        travel=Travel(
            _value(travel.front_bump),
            _value(travel.front_droop),
            _value(travel.rear_bump),
            _value(travel.rear_droop),
        ),
        sensors=(
            _sensor(tables.sensors.front_wheel),
            _sensor(tables.sensors.front_chassis),
            _sensor(tables.sensors.rear_wheel),
            _sensor(tables.sensors.rear_chassis),
        ),
        corner_sensors=tuple(
            (name, _sensor(table))
            for name in ROLL_CHANNELS
            if name not in CHANNELS and (table := getattr(tables.sensors, name)) is not None
        ),
        unsprung=None if tables.unsprung is None else _unsprung(tables.unsprung),
        roll=None if tables.roll is None else _roll(tables.roll),
        source=source,
        sha256=hashlib.sha256(data).hexdigest(),
    )
    make_sense(found)
    return found


def write_vehicle(vehicle: Vehicle, path: PathLike) -> None:
    """Write a vehicle file, whole or not at all, in the units the vehicle is shown in.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_whole(path, to_toml(vehicle).encode("utf-8"))


def to_toml(vehicle: Vehicle) -> str:
    """Text of the vehicle file that reads back as `vehicle`.

    Numbers are the shortest that give the same float again after the unit is applied, so 68 in
    stays 68 in.
    """
    units = display_units(vehicle.units)

    def line(key: str, value: float, dimension: str, sd: float | None = None) -> str:
        unit = units[dimension]
        factor = si_factor(unit, dimension)
        parts = [f"value = {_shortest(value, factor)}"]
        if unit:
            parts.append(f'unit = "{unit}"')
        if sd:
            parts.append(f"sd = {_shortest(sd, factor)}")
        return f"{key} = {{ {', '.join(parts)} }}"

    known = (
        ("sprung_mass", vehicle.m, "mass"),
        ("wheelbase", vehicle.l, "length"),
        ("front_weight_fraction", vehicle.wdf, "dimensionless"),
        ("front_spring_rate", vehicle.k_f, "stiffness"),
        ("rear_spring_rate", vehicle.k_r, "stiffness"),
    )
    nominal = (
        ("front_damping", vehicle.c_f, "damping"),
        ("rear_damping", vehicle.c_r, "damping"),
        ("pitch_inertia", vehicle.i, "pitch_inertia"),
    )
    lines = [f"name = {_quoted(vehicle.name)}", f'units = "{vehicle.units}"']
    lines += ["", "[known]", *(line(key, g.value, of, g.sd) for key, g, of in known)]
    lines += ["", "[nominal]", *(line(key, n.value, of, n.sd) for key, n, of in nominal)]
    travel = [
        line(key, value, "length")
        for key in Travel.__dataclass_fields__
        if (value := getattr(vehicle.travel, key)) is not None
    ]
    if travel:
        lines += ["", "[travel]", *travel]
    if (wheels := vehicle.unsprung) is not None:
        entries = (
            ("front_mass", wheels.front_mass, "mass"),
            ("rear_mass", wheels.rear_mass, "mass"),
            ("front_tyre_rate", wheels.front_tyre_rate, "stiffness"),
            ("rear_tyre_rate", wheels.rear_tyre_rate, "stiffness"),
            ("front_tyre_damping", wheels.front_tyre_damping, "damping"),
            ("rear_tyre_damping", wheels.rear_tyre_damping, "damping"),
        )
        lines += ["", "[unsprung]", *(line(*entry) for entry in entries if entry[1])]
    if (roll := vehicle.roll) is not None:
        lines += [
            "",
            "[roll]",
            line("front_track", roll.front_track.value, "length", roll.front_track.sd),
            line("rear_track", roll.rear_track.value, "length", roll.rear_track.sd),
            line("inertia", roll.inertia.value, "pitch_inertia", roll.inertia.sd),
        ]
        for key, bar in (("front_bar", roll.front_bar), ("rear_bar", roll.rear_bar)):
            lines += [line(key, bar, "stiffness")] if bar else []
        if roll.front_sensors is not None:
            lines.append(line("front_sensors", roll.front_sensors, "length"))
    acceleration = si_factor(units["acceleration"], "acceleration")
    mounted = (*zip(CHANNELS, vehicle.sensors, strict=True), *vehicle.corner_sensors)
    for channel, sensor in mounted:
        table = []
        if sensor.zero_counts is not None:
            table.append(f"zero_counts = {_shortest(sensor.zero_counts, 1.0)}")
        if sensor.counts_scale is not None:
            sd = sensor.counts_scale_sd
            table.append(line("counts_scale", sensor.counts_scale, "acceleration", sd))
        ends = [
            f"{end} = {_shortest(value, acceleration)}"
            for end, value in (("low", sensor.low), ("high", sensor.high))
            if math.isfinite(value)
        ]
        if ends:
            table.append(f'range = {{ {", ".join(ends)}, unit = "{units["acceleration"]}" }}')
        for key, value, of in (
            ("noise", sensor.noise, "acceleration"),
            ("resolution", sensor.resolution, "acceleration"),
            ("bandwidth", sensor.bandwidth, "frequency"),
            ("delay", sensor.delay or None, "time"),
        ):
            if value is not None:
                table.append(line(key, value, of))
        if table:
            lines += ["", f"[sensors.{channel}]", *table]
    return "\n".join(lines) + "\n"


def _given(measured: Measured) -> Given:
    return Given(measured.value, measured.sd or 0.0)


def _value(measured: Measured | None) -> float | None:
    return None if measured is None else measured.value


def _unsprung(table: UnsprungTable) -> Unsprung:
    return Unsprung(
        table.front_mass.value,
        table.rear_mass.value,
        table.front_tyre_rate.value,
        table.rear_tyre_rate.value,
        _value(table.front_tyre_damping) or 0.0,
        _value(table.rear_tyre_damping) or 0.0,
    )


def _roll(table: RollTable) -> Roll:
    return Roll(
        _given(table.front_track),
        _given(table.rear_track),
        Nominal(*table.inertia),
        _value(table.front_bar) or 0.0,
        _value(table.rear_bar) or 0.0,
        _value(table.front_sensors),
    )


def _sensor(table: SensorTable) -> Sensor:
    scale = table.counts_scale
    low, high = table.range or (-math.inf, math.inf)
    return Sensor(
        zero_counts=table.zero_counts,
        counts_scale=_value(scale),
        low=low,
        high=high,
        noise=_value(table.noise),
        resolution=_value(table.resolution),
        bandwidth=_value(table.bandwidth),
        delay=_value(table.delay) or 0.0,
        counts_scale_sd=(scale.sd or 0.0) if scale else 0.0,
    )


def _shortest(si: float, factor: float) -> str:
    """Fewest digits whose product with `factor` is exactly `si` (else all 17 of the quotient)."""
    value = si / factor
    for digits in range(1, 17):
        near = float(f"{value:.{digits}g}")
        if near * factor == si:
            return repr(near).removesuffix(".0")
    # The quotient's own rounding may miss by one step: look at its neighbours too.
    for near in (value, math.nextafter(value, math.inf), math.nextafter(value, -math.inf)):
        if near * factor == si:
            return repr(near)
    return repr(value)


def _quoted(text: str) -> str:
    """Return a TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(_escape(ch) for ch in escaped) + '"'


def _escape(ch: str) -> str:
    code = ord(ch)
    if 0xD800 <= code <= 0xDFFF:
        return "\ufffd"  # half a surrogate pair cannot be written as UTF-8
    return f"\\u{code:04x}" if code < 0x20 or code == 0x7F else ch
