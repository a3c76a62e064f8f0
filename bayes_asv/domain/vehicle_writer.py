"""The vehicle file as it is written: TOML text that reads back as the same vehicle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bayes_asv.domain.channels import KNOWN_CHANNELS, channel
from bayes_asv.domain.units import display_units, si_factor

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bayes_asv.domain.channel_map import MappedChannel
    from bayes_asv.domain.vehicle import Vehicle

__all__ = ["channel_table", "to_toml"]


def to_toml(vehicle: Vehicle) -> str:
    """Return the text of a vehicle file that reads back as `vehicle`.

    Each number is the shortest one that gives the same float once its unit is applied, so 68 in
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
        for key in vehicle.travel.__dataclass_fields__
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
    mapped = {} if vehicle.channel_map is None else vehicle.channel_map.by_name
    placed = {one.name: one.position for one in vehicle.channels if one.position is not None}
    for name in sorted({*mapped, *placed}, key=KNOWN_CHANNELS.index):
        position = line("position", placed[name], "length") if name in placed else ""
        lines += ["", *channel_table(name, mapped.get(name), position)]
    for clock in vehicle.clocks:
        channels = ", ".join(map(_quoted, clock.channels))
        lines += [
            "",
            f"[clocks.{_quoted(clock.name)}]",
            f"channels = [{channels}]",
            f'offset = {{ value = {clock.offset!r}, unit = "s", sd = {clock.offset_sd!r} }}',
            f"drift = {{ value = {clock.drift!r}, sd = {clock.drift_sd!r} }}",
        ]
    for name, sensor in vehicle.sensors.items():
        table = []
        dimension = channel(name).dimension
        factor = si_factor(units[dimension], dimension)
        if sensor.zero_counts is not None:
            table.append(f"zero_counts = {_shortest(sensor.zero_counts, 1.0)}")
        if sensor.counts_scale is not None:
            sd = sensor.counts_scale_sd
            table.append(line("counts_scale", sensor.counts_scale, dimension, sd))
        ends = [
            f"{end} = {_shortest(value, factor)}"
            for end, value in (("low", sensor.low), ("high", sensor.high))
            if math.isfinite(value)
        ]
        if ends:
            table.append(f'range = {{ {", ".join(ends)}, unit = "{units[dimension]}" }}')
        for key, value, of in (
            ("noise", sensor.noise, dimension),
            ("resolution", sensor.resolution, dimension),
            ("bandwidth", sensor.bandwidth, "frequency"),
            ("delay", sensor.delay or None, "time"),
        ):
            if value is not None:
                table.append(line(key, value, of))
        lines += ["", f"[sensors.{name}]", *table]
    return "\n".join(lines) + "\n"


def channel_table(name: str, mapped: MappedChannel | None, position: str = "") -> list[str]:
    """Return the lines of ``[channels.<channel>]``.

    Parameters
    ----------
    name : str
        The channel.
    mapped : MappedChannel or None
        Its place in the file.
    position : str
        The line of its position, empty for none.
    """
    lines = [f"[channels.{name}]"]
    if mapped is not None:
        columns = [_quoted(column) for column in mapped.columns]
        lines.append(f"column = {columns[0] if len(columns) == 1 else '[' + ', '.join(columns)}")
        lines[-1] += "]" if len(columns) > 1 else ""
        lines += [f"group = {_quoted(mapped.group)}"] if mapped.group else []
        lines += [f"unit = {_quoted(mapped.unit)}"] if mapped.unit else []
        lines += [f"axis = [{_numbers(mapped.axis)}]"] if mapped.axis else []
        lines += [f"offset = {_number(mapped.offset)}"] if mapped.offset else []
        lines += ["sign = -1"] if mapped.scale < 0.0 else []
        lines += [f"scale = {_number(abs(mapped.scale))}"] if abs(mapped.scale) != 1.0 else []
        if mapped.curve:
            pairs = ", ".join(f"[{_numbers(pair)}]" for pair in mapped.curve)
            lines.append(f"curve = [{pairs}]")
        ratio = mapped.motion_ratio
        if not isinstance(ratio, float):
            travels, ratios = zip(*ratio, strict=True)
            lines.append(
                f"motion_ratio = {{ travel = [{_numbers(travels)}], ratio = [{_numbers(ratios)}], "
                'unit = "m" }'
            )
        elif ratio != 1.0:
            lines.append(f"motion_ratio = {_number(ratio)}")
        lines += [f'delay = "{_number(mapped.delay)} s"'] if mapped.delay is not None else []
    return [*lines, position] if position else lines


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(map(_number, values))


def _shortest(si: float, factor: float) -> str:
    """Return the shortest decimal whose product with `factor` is exactly `si`, else 17 digits."""
    value = si / factor
    for digits in range(1, 17):
        near = float(f"{value:.{digits}g}")
        if near * factor == si:
            return repr(near).removesuffix(".0")
    # The quotient is rounded itself and may be one float off: try its neighbours too.
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
