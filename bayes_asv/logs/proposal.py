"""Which channel of the car each channel of a log probably is, and why.

Names and units say most.  The rest comes from the readings: gravity shows which way is up, a wheel
hub shakes faster than the body above it, and the rear meets the road after the front.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from itertools import permutations
from typing import TYPE_CHECKING, Final

import numpy as np

from bayes_asv.domain.channel_map import MappedChannel
from bayes_asv.domain.channels import KNOWN_CHANNELS, channel
from bayes_asv.domain.units import STANDARD_GRAVITY, si_factor
from bayes_asv.domain.vehicle_writer import channel_table
from bayes_asv.logs.names import Meaning, meaning, quantity_of_unit, stem

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log, LoggedChannel
    from bayes_asv.logs.facts import ChannelFacts

__all__ = ["Proposal", "map_text", "propose"]

_GRAVITY_TOLERANCE: Final = 0.15
"""Departure of a reading at rest from 1 g that a zero error, a gain error and a tilt explain: cheap
sensors are off by up to 0.1 g, and a tilt of 25 degrees takes another tenth away."""
_STRAIGHT: Final = math.cos(math.radians(2.5))
"""One axis alone is used where its tilt costs less than 0.1 % of gain."""
_ENVELOPE: Final = 0.1  # s
_LONGEST_LAG: Final = 3.0  # s: three metres of wheelbase at walking pace
_SLOW: Final = 0.05  # s, the mean that leaves what wheel and body have in common
_LEAST_CORRELATION: Final = 0.3
_FEWEST: Final = 50  # readings that say something about an order


@dataclass(frozen=True, slots=True)
class Proposal:
    """One channel of the car, as a log probably has it.

    Parameters
    ----------
    channel : MappedChannel
        Its table of the channel map.
    why : str
        In words, what speaks for it.
    todo : tuple of str
        Keys that the person has to fill in, as lines of TOML with a remark.
    """

    channel: MappedChannel
    why: str
    todo: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Candidate:
    """One channel of the log, or the three axes of one sensor, as a reading along one direction."""

    channels: tuple[LoggedChannel, ...]
    facts: tuple[ChannelFacts, ...]
    says: Meaning
    mapped: MappedChannel
    why: tuple[str, ...]
    todo: tuple[str, ...] = ()


def propose(log: Log, facts: Sequence[ChannelFacts]) -> tuple[Proposal, ...]:
    """Propose the channels of the car for a log.

    Parameters
    ----------
    log : Log
        The log.
    facts : sequence of ChannelFacts
        Those of its channels, in order.

    Returns
    -------
    tuple of Proposal
        In the order of the channels of the car; each channel of the car at most once.
    """
    candidates = _candidates(log, facts)
    named = _by_name(candidates)
    if not any(channel(one.channel.channel).is_input for one in named):
        named = _by_readings(candidates) or named or _only_vertical(candidates)
    return tuple(sorted(named, key=lambda one: KNOWN_CHANNELS.index(one.channel.channel)))


def map_text(proposals: Sequence[Proposal], log: Log, rate: float | None) -> str:
    """Return the text of a channel map with the reasons as remarks.

    Parameters
    ----------
    proposals : sequence of Proposal
        What is probably meant.
    log : Log
        The log.
    rate : float or None
        Sampling rate that the person gave, Hz.
    """
    name = " ".join(os.path.basename(log.source).split())  # one line, whatever the name
    lines = [f"# Channel map of {name} ({log.format}): a proposal, to be checked by a person."]
    lines += [f'rate = "{rate:g} Hz"'] if rate is not None else []
    for one in proposals:
        lines += ["", f"# {one.why}", *channel_table(one.channel.channel, one.channel)]
        lines += [f"# {text}" for text in one.todo]
    if not proposals:
        lines += [
            "", "# No channel was recognised.  Write a table for each that the car has, such as:",
            "# [channels.front_wheel]", '# column = "name in the file"', '# unit = "g"',
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _candidates(log: Log, facts: Sequence[ChannelFacts]) -> list[_Candidate]:
    """Return what could be a channel of the car, the axes of one sensor as one candidate."""
    groups: dict[tuple[str, str, str, int], list[int]] = {}
    single: list[int] = []
    says = [meaning(one.name, one.unit) for one in log.channels]
    for k, (one, its) in enumerate(zip(log.channels, says, strict=True)):
        if its.other or (its.quantity is None and not _is_bare(one)):
            continue
        if its.letter is None:
            single.append(k)
        else:
            key = (one.source, stem(one.name), str(its.quantity), one.time.size)
            groups.setdefault(key, []).append(k)
    # On a bicycle the front has a fork, and the shock is at the rear.
    if any("fork" in log.channels[k].name.lower() for k in single):
        for k in single:
            if says[k].part == "suspension" and says[k].axle is None:
                says[k] = replace(says[k], axle="rear")
    result = [_single(log.channels[k], facts[k], says[k]) for k in single]
    for members in groups.values():
        members = sorted(members, key=lambda k: str(says[k].letter))
        letters = [says[k].letter for k in members]
        if letters == ["x", "y", "z"] and says[members[0]].quantity == "acceleration":
            result.append(
                _triad(
                    [log.channels[k] for k in members],
                    [facts[k] for k in members],
                    [says[k] for k in members],
                )
            )
        else:
            result += [_single(log.channels[k], facts[k], says[k]) for k in members]
    return [one for one in result if one.says.part or one.says.axle or _may_be_vertical(one)]


def _is_bare(one: LoggedChannel) -> bool:
    """Whether neither name nor unit says anything, as in a table without a header."""
    return not one.unit and one.name.startswith("column ")


def _may_be_vertical(one: _Candidate) -> bool:
    """Whether an acceleration along one axis can be the vertical one."""
    if one.says.quantity == "acceleration" and len(one.channels) == 1 and one.says.letter:
        return bool(one.mapped.offset) or one.says.vertical
    return True


def _single(one: LoggedChannel, facts: ChannelFacts, says: Meaning) -> _Candidate:
    why, todo = [f"named '{one.name}'"], []
    unit, offset, scale = "", 0.0, 1.0
    if one.unit:
        why.append(f"unit {one.unit}")
    if says.quantity == "acceleration" or (says.quantity is None and _is_bare(one)):
        unit, gravity, reason = _gravity(facts)
        if reason:
            why.append(reason)
        if gravity:
            offset, scale = _rounded(facts.rest), math.copysign(1.0, facts.rest)
        elif not unit and not one.unit:
            todo.append('unit = "g"  # the file states none: fill in')
    elif says.quantity == "deflection":
        offset = _rounded(facts.rest)
        why.append(f"reads {facts.rest:.4g} at rest")
        todo.append("sign = -1  # if readings grow in compression: extension is positive")
        if says.part == "suspension" and not _is_length(one.unit):
            todo.append(
                f"scale = 0.1  # travel per {one.unit or 'unit of the reading'}: fill in, and"
            )
            todo.append('unit = "mm"')
        todo.append("motion_ratio = 0.6  # travel of the damper over that of the wheel, if it")
        todo[-1] += " measures the damper"
    elif says.quantity == "angular_rate":
        if says.turn is None:
            why.append("y is across the car where x points ahead: check")
        todo.append("sign = -1  # if nose down is positive")
    mapped = MappedChannel("front_wheel", (one.name,), one.source, unit, (), offset, scale)
    return _Candidate((one,), (facts,), says, mapped, tuple(why), tuple(todo))


def _is_length(unit: str) -> bool:
    return quantity_of_unit(unit) == "deflection"


def _gravity(facts: ChannelFacts) -> tuple[str, bool, str]:
    """Return the unit that gravity shows, whether the reading has it, and the reason."""
    size = abs(facts.rest)
    sign = "" if facts.rest > 0.0 else "minus "
    stated = _acceleration_factor(facts.unit)
    for unit, factor in (
        ("g", STANDARD_GRAVITY),
        ("m/s^2", 1.0),
        ("mg", STANDARD_GRAVITY / 1000.0),
    ):
        if abs(size * factor / STANDARD_GRAVITY - 1.0) > _GRAVITY_TOLERANCE:
            continue
        if stated is not None and math.isclose(stated, factor, rel_tol=0.01):
            words = f"reads {sign}{size * factor / STANDARD_GRAVITY:.3f} g at rest"
            return "", True, words + (", so up is negative" if facts.rest < 0.0 else "")
        if not facts.unit:
            return unit, True, f"reads {facts.rest:.4g} at rest, gravity in {unit}"
        return (
            unit,
            True,
            (f"reads {facts.rest:.4g} at rest, which is gravity in {unit} and not in {facts.unit}"),
        )
    if stated is not None and size * stated < _GRAVITY_TOLERANCE * STANDARD_GRAVITY:
        return "", False, "reads about zero at rest, so which way is up does not show"
    return "", False, f"reads {facts.rest:.4g} at rest" if facts.unit else ""


def _acceleration_factor(unit: str) -> float | None:
    return si_factor(unit, "acceleration") if quantity_of_unit(unit) == "acceleration" else None


def _triad(
    channels: list[LoggedChannel], facts: list[ChannelFacts], says: list[Meaning]
) -> _Candidate:
    """Combine three axes: gravity at rest shows the direction of up."""
    rest = np.array([one.rest for one in facts])
    size = float(np.linalg.norm(rest))
    up = rest / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    main = int(np.argmax(np.abs(up)))
    total = replace(facts[main], rest=math.copysign(size, rest[main]))
    unit, gravity, _ = _gravity(total)
    whole = replace(says[main], letter=None, vertical=True)
    if not gravity:
        vertical = next((k for k, one in enumerate(says) if one.vertical), 2)
        single = _single(channels[vertical], facts[vertical], says[vertical])
        return replace(single, says=replace(whole, vertical=False))
    factor = si_factor(unit or facts[main].unit, "acceleration")
    tilt = math.degrees(math.acos(min(1.0, abs(float(up[main])))))
    why = [
        f"three axes that read {size * factor / STANDARD_GRAVITY:.3f} g together at rest",
        f"{'minus ' if up[main] < 0.0 else ''}{channels[main].name} is up, tilted by {tilt:.1f}°",
    ]
    if abs(float(up[main])) >= _STRAIGHT:
        mapped = MappedChannel(
            "front_wheel", (channels[main].name,), channels[main].source, unit, (),
            _rounded(float(rest[main])), math.copysign(1.0, float(up[main])),
        )  # fmt: skip
        return _Candidate((channels[main],), (facts[main],), whole, mapped, tuple(why))
    mapped = MappedChannel(
        "front_wheel", tuple(one.name for one in channels), channels[main].source, unit,
        tuple(_rounded(float(part)) for part in up), _rounded(size),
    )  # fmt: skip
    return _Candidate(tuple(channels), tuple(facts), whole, mapped, tuple(why))


def _by_name(candidates: Sequence[_Candidate]) -> list[Proposal]:
    """Propose what names say; left and right of an axle become their mean."""
    found: dict[tuple[str, str, str | None], list[_Candidate]] = {}
    for one in candidates:
        says = one.says
        quantity, part = says.quantity, says.part
        if quantity == "acceleration" and part in (None, "suspension") and not says.axle:
            part = "body"
        if quantity == "deflection":
            part = "suspension"
        if quantity == "angular_rate":
            if says.turn not in (None, "pitch") or (says.turn is None and says.letter != "y"):
                continue
            part = "body"
        if quantity is None or part is None:
            continue
        axle = None if quantity == "angular_rate" else says.axle
        found.setdefault((quantity, part, axle), []).append(one)
    result = []
    for key, group in found.items():
        name = _channel_name(*key)
        if name is None:
            continue
        result.append(_merged(name, group))
    return result


def _channel_name(quantity: str, part: str, axle: str | None) -> str | None:
    """Return the channel of a quantity at a place, both sides of an axle together."""
    for name in KNOWN_CHANNELS:
        one = channel(name)
        if (one.quantity, one.part, one.axle, one.side) == (quantity, part, axle, None):
            return name
    return None


def _merged(name: str, group: list[_Candidate]) -> Proposal:
    """Propose one channel for one sensor, or for the left and the right one of an axle."""
    first = group[0]
    why = f"{name}: {'; '.join(first.why)}"
    todo = first.todo
    mapped = replace(first.mapped, channel=name)
    pair = sorted(group, key=lambda one: str(one.says.side))
    sides = [one.says.side for one in pair]
    alike = len({(one.mapped.unit, one.mapped.scale, one.channels[0].unit) for one in pair}) == 1
    if sides == ["left", "right"] and alike and all(len(one.channels) == 1 for one in pair):
        same = np.array_equal(pair[0].channels[0].time, pair[1].channels[0].time)
        same = same and pair[0].channels[0].source == pair[1].channels[0].source
        if same:
            offset = _rounded(0.5 * (pair[0].mapped.offset + pair[1].mapped.offset))
            mapped = replace(
                mapped, columns=tuple(one.channels[0].name for one in pair), axis=(0.5, 0.5),
                offset=offset,
            )  # fmt: skip
            why += "; the mean of left and right"
    elif len(group) > 1:
        others = ", ".join(f"'{one.channels[0].name}'" for one in group[1:])
        why += f"; so could be {others}"
    elif first.says.side is not None:
        why += f"; the {first.says.side} side stands for both"
    if channel(name).has_own_position:
        todo = (*todo, 'position = "0.60 m"  # place ahead of the rear axle: measure and fill in')
    return Proposal(mapped, why, todo)


def _by_readings(candidates: Sequence[_Candidate]) -> list[Proposal]:
    """Propose wheels, body and axles for four accelerations whose names say nothing."""
    four = [
        one for one in candidates
        if len(one.channels) == 1 and one.says.quantity in (None, "acceleration")
        and one.says.part is None
    ]  # fmt: skip
    times = [one.channels[0].time for one in four]
    if len(four) != 4 or any(
        time.size < _FEWEST or not np.array_equal(time, times[0]) for time in times
    ):
        return []
    rate = four[0].facts[0].rate
    readings = np.array([_standard(one) for one in four])
    quick = np.std(np.diff(readings, axis=1), axis=1)
    wheels = sorted(np.argsort(quick)[2:].tolist())
    bodies = [k for k in range(4) if k not in wheels]
    lag, strength = _lag(readings[wheels[0]], readings[wheels[1]], rate)
    if lag < 0.0:
        wheels.reverse()
    slow = _mean(readings, round(_SLOW * rate))
    pairs = max(
        permutations(bodies),
        key=lambda order: sum(
            _correlation(slow[w], slow[b]) for w, b in zip(wheels, order, strict=True)
        ),
    )
    lagging = (
        f"the rear meets the road {abs(lag):.2f} s later"
        if strength > _LEAST_CORRELATION and lag != 0.0
        else "which axle is the front one does not show: check"
    )
    result = []
    for axle, wheel, body in zip(("front", "rear"), wheels, pairs, strict=True):
        for name, k, why in (
            (f"{axle}_wheel", wheel, f"shakes faster than its partner; {lagging}"),
            (f"{axle}_chassis", body, "moves with that wheel, but slower"),
        ):
            one = four[k]
            text = f"{name}: a guess from the readings of '{one.channels[0].name}': {why}"
            if len(one.why) > 1:
                text += f"; {'; '.join(one.why[1:])}"
            result.append(Proposal(replace(one.mapped, channel=name), text, one.todo))
    return result


def _only_vertical(candidates: Sequence[_Candidate]) -> list[Proposal]:
    """Propose the only channel without a name that reads gravity as an acceleration of the body."""
    upright = [one for one in candidates if one.mapped.offset and one.says.quantity is None]
    if len(upright) != 1:
        return []
    proposal = _merged("body_vertical", upright)
    return [replace(proposal, why=f"{proposal.why}; a guess: on the body, not on a wheel")]


def _standard(one: _Candidate) -> NDArray[np.float64]:
    return one.mapped.scale * (one.channels[0].values - one.facts[0].rest)


def _mean(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return the running mean over `width` samples along the last axis."""
    width = max(1, min(width, values.shape[-1]))
    kernel = np.ones(width) / width
    return np.array([np.convolve(row, kernel, mode="same") for row in np.atleast_2d(values)])


def _lag(
    first: NDArray[np.float64], second: NDArray[np.float64], rate: float
) -> tuple[float, float]:
    """Time, s, by which the second follows the first, and the correlation there."""
    rough = _mean(np.abs(np.vstack([first, second])), round(_ENVELOPE * rate))
    a, b = rough - rough.mean(axis=1, keepdims=True)
    most = min(round(_LONGEST_LAG * rate), a.size - 1)
    size = 1 << int(np.ceil(np.log2(2 * a.size)))
    product = np.fft.irfft(np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size), size)
    lags = np.concatenate([np.arange(0, most + 1), np.arange(-most, 0)])
    at = int(np.argmax(product[lags]))
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(lags[at]) / rate, float(product[lags[at]]) / scale if scale > 0.0 else 0.0


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the correlation of two channels, zero where one of them does not move."""
    a, b = first - first.mean(), second - second.mean()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0.0 else 0.0


def _rounded(value: float) -> float:
    """Four significant digits: more than a rest level has."""
    return float(f"{value:.4g}")
