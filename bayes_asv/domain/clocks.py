"""Clocks: channels whose time stamps come from another logger than those of the others.

A reading with stamp t of a channel of such a clock was sampled at

    t_0 + (t − t_0) / ((1 + e)(1 + drift)) + delay + offset

with t_0 the first stamp, and e and delay what the recording and the vehicle file declare for the
channel (:func:`bayes_asv.domain.recording.sample_times`).  A positive offset is late, a positive
drift a clock that runs fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.channels import KNOWN_CHANNELS, Channel
from bayes_asv.domain.channels import channel as known_channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import closest
from bayes_asv.domain.recording import Recording, timing

if TYPE_CHECKING:
    from bayes_asv.domain.vehicle import Vehicle

__all__ = [
    "DRIFT_SD", "GROUPS", "OFFSET_SD", "Clock", "check_clocks", "clock_of_group",
    "declared_clocks", "members", "with_declared_clock_error",
]  # fmt: skip

OFFSET_SD: Final = 0.02
"""Prior standard deviation of an offset, s: phones and boards were 4 to 11 ms apart."""

DRIFT_SD: Final = 50e-6
"""Prior standard deviation of a drift: crystals are good to 20 to 50 ppm, each of two clocks."""

GROUPS: Final[dict[str, Callable[[Channel], bool]]] = {
    "body": lambda channel: not channel.is_input,
    "front": lambda channel: channel.axle == "front",
    "left": lambda channel: channel.side == "left",
}
"""Groups of channels that are often logged by a device of their own, against all others."""

_METADATA: Final = "unsynchronised"


@dataclass(frozen=True, slots=True)
class Clock:
    """A clock of some channels whose offset and drift against the other channels are unknown.

    Parameters
    ----------
    name : str
        As in reports.
    channels : tuple of str
        Channels that it stamps; those that a recording lacks do not matter.
    offset, drift : float
        Centres of their normal priors, s and relative.
    offset_sd, drift_sd : float
        Standard deviations; zero means exact.

    Raises
    ------
    InputError
        If a channel does not exist.
    """

    name: str
    channels: tuple[str, ...]
    offset: float = 0.0
    offset_sd: float = OFFSET_SD
    drift: float = 0.0
    drift_sd: float = DRIFT_SD

    def __post_init__(self) -> None:
        for name in self.channels:
            if name not in KNOWN_CHANNELS:
                near = closest(name, KNOWN_CHANNELS)
                fix = f"did you mean {near}?" if near else f"name of {', '.join(KNOWN_CHANNELS)}"
                raise InputError(f"channel '{name}'", "there is no such channel", fix)


def members(group: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the channels of a group of :data:`GROUPS` among some channels."""
    return tuple(name for name in names if GROUPS[group](known_channel(name)))


def clock_of_group(group: str) -> Clock:
    """Return the clock of a group of :data:`GROUPS`, with the default priors."""
    return Clock(group, members(group, KNOWN_CHANNELS))


def declared_clocks(recordings: Sequence[Recording], vehicle: Vehicle) -> tuple[Clock, ...]:
    """Return the clocks that the vehicle file or the metadata of a recording declare.

    A line ``# unsynchronised = body_vertical, body_pitch_rate`` names the channels of a clock with
    the default priors.

    Raises
    ------
    InputError
        If the metadata name no channel, or a channel has two clocks.
    """
    clocks = list(vehicle.clocks)
    for recording in recordings:
        text = recording.get(_METADATA)
        if text is None:
            continue
        channels = tuple(part.strip() for part in text.split(",") if part.strip())
        try:
            clock = Clock(_METADATA, channels)
        except InputError as exc:
            where = f"{recording.source or 'recording'}: # {_METADATA}"
            raise InputError(where, f"{exc.where}: {exc.what}", exc.fix) from None
        if clock not in clocks:
            clocks.append(clock)
    check_clocks(clocks, vehicle.source or "vehicle")
    return tuple(clocks)


def check_clocks(clocks: Sequence[Clock], where: str) -> None:
    """Check that no channel has two clocks.

    Raises
    ------
    InputError
        At `where`, if one has.
    """
    owner: dict[str, str] = {}
    for clock in clocks:
        for name in clock.channels:
            if name in owner:
                raise InputError(
                    where,
                    f"the channel {name} has two clocks, {owner[name]} and {clock.name}",
                    "list it once",
                )
            owner[name] = clock.name


def with_declared_clock_error(
    recording: Recording, vehicle: Vehicle, clock: Clock, offset: float, drift: float
) -> Recording:
    """Return a recording whose metadata declare an offset and a drift of a clock.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        Gives the delays that the recording does not.
    clock : Clock
        Whose channels are concerned.
    offset, drift : float
        s and relative; added to what is declared already.
    """
    declared = timing(recording)
    added = []
    for row, name in enumerate(recording.channels):
        if name not in clock.channels:
            continue
        own = declared.delay[row]
        delay = (vehicle.sensor(name).delay if own is None else own) + offset
        rate = (1.0 + declared.clock[row]) * (1.0 + drift) - 1.0
        added += [(f"delay {name}", f"{delay:.12f} s"), (f"clock {name}", f"{1e6 * rate:.9f} ppm")]
    return replace(recording, metadata=(*recording.metadata, *added))
