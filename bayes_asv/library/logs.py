"""Foreign logs: what is in them, which channels are probably meant, and calibration of sensors."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv import __version__
from bayes_asv.domain.channel_map import ChannelMap, find_column
from bayes_asv.domain.channels import missing_inputs
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.units import STANDARD_GRAVITY, parse_quantity, si_factor
from bayes_asv.io import read_log
from bayes_asv.logs import calibration
from bayes_asv.logs.facts import channel_facts
from bayes_asv.logs.names import quantity_of_unit
from bayes_asv.logs.proposal import map_text, propose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.channels import Quantity
    from bayes_asv.domain.files import PathLike
    from bayes_asv.domain.log import Log
    from bayes_asv.logs.calibration import StaticCalibration
    from bayes_asv.logs.facts import ChannelFacts

__all__ = ["Calibration", "Inspection", "calibrate", "inspect_log"]

_INSPECT_SCHEMA: Final = "bayes_asv/inspect/1"
_CALIBRATE_SCHEMA: Final = "bayes_asv/calibrate/1"


class Inspection:
    """What a log holds, made by :func:`inspect_log`.

    Parameters
    ----------
    log : Log
        The log.
    rate : float or None
        Sampling rate that was given, Hz.
    """

    def __init__(self, log: Log, rate: float | None = None):
        self.log = log
        self.facts = tuple(channel_facts(one) for one in log.channels)
        self.proposals = propose(log, self.facts)
        self._rate = rate

    @property
    def channel_map(self) -> ChannelMap:
        """The proposed channel map, to be checked by a person.

        Raises
        ------
        InputError
            If no channel was recognised.
        """
        return ChannelMap(tuple(one.channel for one in self.proposals), self._rate)

    @property
    def missing(self) -> tuple[str, ...]:
        """Wheel hubs without which no car model can explain the channels."""
        return missing_inputs([one.channel.channel for one in self.proposals])

    def to_toml(self) -> str:
        """Return the text of the proposed channel map, with the reasons as remarks."""
        return map_text(self.proposals, self.log, self._rate)

    def write_map(self, path: PathLike) -> None:
        """Write the proposed channel map.

        Raises
        ------
        InputError
            If the file exists already, since a person may have corrected it, or cannot be written.
        """
        if os.path.exists(path):
            raise InputError(os.fspath(path), "exists already", "name another file, or delete it")
        write_atomically(path, self.to_toml().encode("utf-8"))

    def to_dict(self) -> dict[str, Any]:
        """Return the facts, the proposals and their reasons, schema ``bayes_asv/inspect/1``."""
        return {
            "schema": _INSPECT_SCHEMA,
            "version": __version__,
            "file": self.log.source,
            "sha256": self.log.sha256,
            "format": self.log.format,
            "warnings": list(self.log.warnings),
            "channels": [
                {key: None if value != value else value for key, value in asdict(one).items()}
                for one in self.facts
            ],
            "proposals": [
                {
                    "channel": one.channel.channel,
                    "columns": list(one.channel.columns),
                    "why": one.why,
                    "complete": not one.todo,
                }
                for one in self.proposals
            ],
            "missing": list(self.missing),
        }

    def lines(self) -> list[str]:
        """Return the text that the command prints."""
        log = self.log
        longest = max(one.duration for one in self.facts)
        lines = [f"{log.source}: {log.format}, {len(self.facts)} channels, {longest:.4g} s"]
        lines += [f"  note: {text}" for text in log.warnings]
        lines += ["", *_table([_HEADER, *(_row(one) for one in self.facts)]), ""]
        if self.proposals:
            lines.append("Probably:")
            lines += [f"  {one.why}" for one in self.proposals]
        else:
            lines.append("No channel of the car was recognised by name, unit or readings.")
        if self.missing:
            words = " and ".join(name.replace("_", " ") for name in self.missing)
            lines += [
                "",
                f"Missing: the acceleration of {words}. A car model is driven by the wheel hubs; "
                "without them there is nothing to estimate.",
            ]
        return lines

    def __repr__(self) -> str:
        names = ", ".join(one.channel.channel for one in self.proposals) or "none recognised"
        return f"<Inspection {os.path.basename(self.log.source)[:60]}: {names}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in _row(one))}</tr>"
            for one in self.facts
        )
        head = "".join(f"<th>{escape(cell)}</th>" for cell in _HEADER)
        why = "".join(f"<li>{escape(one.why)}</li>" for one in self.proposals)
        return (
            f"<div><b>{escape(os.path.basename(self.log.source))}</b><table><thead><tr>{head}</tr>"
            f"</thead><tbody>{rows}</tbody></table><ul>{why}</ul></div>"
        )


def inspect_log(path: PathLike, *, rate: float | None = None) -> Inspection:
    """Read a log of any known format and say what its channels probably are.

    Parameters
    ----------
    path : str or os.PathLike
        The file; ``docs/formats.md`` lists the formats.
    rate : float, optional
        Sampling rate, Hz, of a file without time stamps.

    Returns
    -------
    Inspection
        Facts, proposals with reasons, and the channel map that follows.

    Raises
    ------
    InputError
        If the file cannot be read; the message names file and fix.
    """
    return Inspection(read_log(path, rate), rate)


class Calibration:
    """The calibration of a sensor, made by :func:`calibrate`.

    Parameters
    ----------
    file : str
        Name of the file.
    columns : sequence of str
        The axes.
    unit : str
        Unit of the value.
    result : StaticCalibration
        Offsets and scales in that unit.
    """

    def __init__(self, file: str, columns: Sequence[str], unit: str, result: StaticCalibration):
        self.file = file
        self.columns = tuple(columns)
        self.unit = unit
        self.result = result

    def to_dict(self) -> dict[str, Any]:
        """Return the calibration, schema ``bayes_asv/calibrate/1``."""
        return {
            "schema": _CALIBRATE_SCHEMA,
            "version": __version__,
            "file": self.file,
            "unit": self.unit,
            "positions": self.result.positions,
            "residual": self.result.residual,
            "largest": self.result.largest,
            "axes": {
                column: {
                    key: None if math.isnan(value) else value for key, value in asdict(axis).items()
                }
                for column, axis in zip(self.columns, self.result.axes, strict=True)
            },
        }

    def lines(self) -> list[str]:
        """Return the text that the command prints: lines of a channel map."""
        lines = [
            f"# {self.result.positions} positions; what is left: {self.result.residual:.3g} "
            f"{self.unit} (root mean square), {self.result.largest:.3g} {self.unit} at most"
        ]
        gravity = 0.0
        if quantity_of_unit(self.unit) == "acceleration":
            gravity = STANDARD_GRAVITY / si_factor(self.unit, "acceleration")
        for column, axis in zip(self.columns, self.result.axes, strict=True):
            known = not math.isnan(axis.scale_sd)
            offset = axis.offset + gravity / axis.scale
            remark = f"± {axis.offset_sd:.2g}" if known else "as many positions as unknowns"
            if gravity:
                remark += f"; at rest with this axis up ({axis.offset:.6g} without gravity)"
            lines += [
                "",
                f"column = {json.dumps(column, ensure_ascii=False)}",
                f"offset = {offset:.6g}  # {remark}",
                f"scale = {axis.scale:.6g}" + (f"  # ± {axis.scale_sd:.2g}" if known else ""),
                f'unit = "{self.unit}"',
            ]
        return lines

    def __repr__(self) -> str:
        return f"<Calibration of {', '.join(self.columns)}: {self.result.positions} positions>"


def calibrate(
    path: PathLike,
    columns: Sequence[str],
    *,
    values: Sequence[str] = (),
    angles: Sequence[float] = (),
    rate: float | None = None,
) -> Calibration:
    """Calibrate a sensor from a log in which it is held still in several positions.

    Parameters
    ----------
    path : str or os.PathLike
        The log.
    columns : sequence of str
        One column, or the three axes of an accelerometer, which need no known positions: hold each
        of the six faces down for two seconds.
    values : sequence of str
        Value of each position in the order of time, with its unit: ``["1 g", "-1 g"]`` for an
        accelerometer that is turned over, ``["0 mm", "25 mm", "50 mm"]`` for a potentiometer.
    angles : sequence of float
        Instead: angle of an accelerometer's axis from *up* in each position, degrees.
    rate : float, optional
        Sampling rate, Hz, of a file without time stamps.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        If the file cannot be read, or the positions do not determine the calibration.
    """
    log = read_log(path, rate)
    found = [find_column(log, name, "columns") for name in columns]
    if any(not np.array_equal(one.time, found[0].time) for one in found):
        raise InputError(log.source, "has other stamps for each axis", "export one sensor's axes")
    held = calibration.plateaus(found[0].time, np.array([one.values for one in found]))
    means = np.array([mean for _, _, mean in held]).reshape(len(held), len(found))
    if len(found) == 1:
        if bool(values) == bool(angles):
            raise InputError(
                log.source, "one column needs the value of each position",
                'give --values "1 g, -1 g" or --angles "0, 180"',
            )  # fmt: skip
        unit, known = _known_values(values, angles)
        result = calibration.calibrate_values(means[:, 0], known, log.source)
        return Calibration(log.source, columns, unit, result)
    if len(found) != 3 or values or angles:  # the axes of one sensor
        raise InputError(
            log.source, f"{len(found)} columns cannot be calibrated so",
            "name one column with values or angles, or the three axes of a sensor alone",
        )  # fmt: skip
    factor = _factor(found[0].unit, means)
    result = calibration.calibrate_axes(means, factor, log.source)
    return Calibration(log.source, columns, "m/s^2", result)


def _factor(unit: str, means: NDArray[np.float64]) -> float:
    """m/s² per unit of the readings: as stated, or such that gravity is the usual reading."""
    if quantity_of_unit(unit) == "acceleration":
        return si_factor(unit, "acceleration")
    return STANDARD_GRAVITY / max(float(0.5 * np.ptp(means, axis=0).max()), 1e-12)


def _known_values(values: Sequence[str], angles: Sequence[float]) -> tuple[str, list[float]]:
    if angles:
        return "g", [math.cos(math.radians(angle)) for angle in angles]
    pairs = [parse_quantity(text) for text in values]
    unit = next((unit for _, unit in pairs if unit), "")
    quantity: Quantity | None = quantity_of_unit(unit)
    if quantity is None:
        raise InputError(
            f"'{values[0]}'",
            "has no unit of acceleration, rate or travel",
            'write "1 g" or "25 mm"',
        )
    base = si_factor(unit, quantity)
    return unit, [number * si_factor(own or unit, quantity) / base for number, own in pairs]


_HEADER: Final = ("channel", "unit", "rate", "from", "to", "at rest", "noise", "remarks")


def _row(one: ChannelFacts) -> tuple[str, ...]:
    remarks = []
    if one.step:
        remarks.append(f"steps of {one.step:.3g}")
    if one.repeated > 0.5:
        remarks.append(f"{100 * one.repeated:.0f} % of the readings repeat the one before")
    if one.gaps:
        remarks.append(f"{one.gaps} gap{'s' * (one.gaps > 1)}, the longest {one.longest_gap:.3g} s")
    name = f"{one.name} ({one.source})" if one.source else one.name
    return (
        name[:40],
        one.unit[:12] or "–",
        "–" if math.isnan(one.rate) else f"{one.rate:.4g} Hz",
        f"{one.low:.4g}",
        f"{one.high:.4g}",
        f"{one.rest:.4g}",
        f"{one.noise:.2g}",
        "; ".join(remarks),
    )


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if k in (0, 1, 7) else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
