"""Hypotheses about mistakes in an input, and the corrections that undo them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.recording import COUNTS, Recording, nominal_rate, timing
from bayes_asv.domain.units import STANDARD_GRAVITY, si_factor
from bayes_asv.domain.vehicle import Given, Nominal, Vehicle
from bayes_asv.models.car_model import CarModel

__all__ = [
    "CORRECT", "REPORTED", "Hypothesis", "Mistake", "hypotheses", "hypotheses_of_recording",
]  # fmt: skip

REPORTED = 0.05  # probability above which a mistake is reported
Corrected = tuple[Recording, Vehicle]

_NAMED_FACTOR = 0.03  # standard deviation of the logarithm of a factor between units
_FAR_GAIN = math.log(1.5)  # log gain above which a sensor is another one, not out of calibration
_DEAD = 0.05  # gain below which a sensor is called dead
_NOTHING = 1e-3  # gain of a sensor whose readings are only noise
# Occam factor of an unknown size, as a logarithm: its posterior width over its prior width, since
# the data determine it to a few hundredths of its range.
_OCCAM = -4.0
_N_PER_MM = si_factor("N/mm", "stiffness") / si_factor("lbf/in", "stiffness")
_LBF_S_PER_IN = si_factor("lbf*s/in", "damping")
_LB = si_factor("lbm", "mass")
_SPRING_FACTORS = {
    2.0: "the rate of one side is given instead of both sides",
    0.5: "both sides are counted twice",
    _N_PER_MM: "a value in N/mm was given the unit lbf/in",
    1.0 / _N_PER_MM: "a value in lbf/in was given the unit N/mm",
}
_DAMPING_FACTORS = {
    12.0: "a value in lbf·s/in was given the unit lbf·s/ft",
    1.0 / 12.0: "a value in lbf·s/ft was given the unit lbf·s/in",
    _LBF_S_PER_IN: "a value in lbf·s/in was given the unit N·s/m",
    1.0 / _LBF_S_PER_IN: "a value in N·s/m was given the unit lbf·s/in",
    1e3: "a value in N·s/mm was given the unit N·s/m",
    1e-3: "a value in N·s/m was given the unit N·s/mm",
}
_MASS_FACTORS = {
    1.0 / _LB: "a value in kg was given the unit lb",
    _LB: "a value in lb was given the unit kg",
}
_INERTIA_UNITS = {
    "kg·m²": "kg*m^2", "lbf·s²·in": "lbf*s^2*in", "slug·ft²": "lbf*s^2*ft", "lb·ft²": "lbm*ft^2",
    "lb·in²": "lbm*in^2",
}  # fmt: skip
_INERTIA_FACTORS = {
    si_factor(true, "pitch_inertia") / si_factor(given, "pitch_inertia"): (
        f"a value in {true_name} was given the unit {given_name}"
    )
    for true_name, true in _INERTIA_UNITS.items()
    for given_name, given in _INERTIA_UNITS.items()
    if true != given
}
# Common rates of loggers, Hz.  A wrong rate is equivalent to springs and dampers that are wrong by
# a factor, but it is one of these rates.
_RATES = (50.0, 100.0, 125.0, 200.0, 250.0, 400.0, 500.0, 800.0, 1000.0, 1600.0, 2000.0)
# Log prior odds of a wrong rate against other mistakes: rarer, since loggers stamp their rows.
_RARE = -3.0
_FARTHEST_RATE, _SAME_RATE = 6.0, 1.05  # largest and smallest ratio of rates that is considered
# Starting values of searches for a size.
_GAINS = (1.0 / STANDARD_GRAVITY, 0.5, 0.85, 1.18, 2.0, STANDARD_GRAVITY)
_LAGS = (0.005, 0.02)  # sampling delays, s
_SLOPES = (0.15, 0.8)  # drifts, m/s³
_SHARES = (-0.15, 0.1, 0.3)  # offsets of a body sensor, shares of the wheelbase
_TIME_CONSTANTS = (0.005, 0.02)  # time constants of filters, s: corners of 32 and 8 Hz
_FREE = 1.0  # prior sd of the logarithm of a given value whose factor is estimated
# Prior sd of the logarithms of values about their common factor, if each has one of its own.
_APART = 0.4


@dataclass(frozen=True)
class Mistake:
    """A mistake that explains the recordings.

    Parameters
    ----------
    words : str
        Description of the mistake.
    fix : str
        What to do, in one line.
    probability : float
        Its probability, given that the input has either one of the listed mistakes or none.
    misread : bool
        Whether a channel is not what its name says.
    """

    words: str
    fix: str
    probability: float
    misread: bool = False


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis about a mistake, and the correction that undoes it.

    Parameters
    ----------
    words : callable
        Function of the size of the mistake that returns its description and fix.
    undo : callable
        Function of recording, vehicle and size that returns the corrected recording and vehicle.
    sizes : tuple of float
        Starting values of the search for the size; empty for a mistake without a size.
    density : callable
        Function of the size that returns its log prior density.
    exact : bool
        Whether only these sizes, and the one that a fit finds, are possible.
    stretch : callable
        Function of the size that returns, by channel, the logarithm of the factor by which the
        correction multiplies readings (for the Jacobian of the likelihood).
    freed : callable or None
        Function of a vehicle that returns one with a wide prior of the value that may be wrong, so
        that a fit estimates it.
    size_of : callable or None
        Function of the vehicle and of the car's parameters in such a fit that returns the size.
    misread : callable
        Function of the size: whether a channel is then not what its name says, which no effect of
        car or sensor describes.
    """

    words: Callable[[float], tuple[str, str]]
    undo: Callable[[Recording, Vehicle, float], Corrected]
    sizes: tuple[float, ...] = ()
    density: Callable[[float], float] = lambda size: 0.0 if size == 0.0 else _OCCAM
    exact: bool = False
    stretch: Callable[[float], dict[str, float]] = lambda size: {}
    freed: Callable[[Vehicle], Vehicle] | None = None
    size_of: Callable[[Vehicle, Mapping[str, float]], float] | None = None
    misread: Callable[[float], bool] = lambda size: False


CORRECT = Hypothesis(lambda size: ("", ""), lambda recording, vehicle, size: (recording, vehicle))


def hypotheses(recording: Recording, vehicle: Vehicle, car: CarModel) -> Iterator[Hypothesis]:
    """Yield hypotheses about an input with these channels and given values."""
    yield from hypotheses_of_recording(recording, vehicle, car)
    yield from _of_given_values(vehicle, car)


def hypotheses_of_recording(
    recording: Recording, vehicle: Vehicle, car: CarModel
) -> Iterator[Hypothesis]:
    """Yield hypotheses about mistakes that may differ between recordings of one car."""
    channels = [vehicle.channel(name) for name in recording.channels]
    channels = [channel for channel in channels if car.has_channel(channel)]
    yield from _of_columns(channels)
    yield from _of_readings(channels, 1.0 / nominal_rate(recording))
    yield from _of_time(recording, car)


def _of_columns(channels: Sequence[Channel]) -> Iterator[Hypothesis]:
    """Exchanged columns."""
    names = {channel.name: channel for channel in channels}
    for one, other in combinations(channels, 2):
        if one.quantity == other.quantity:
            yield _exchange([(one.name, other.name)])
    mirrored = [(n, n.replace("front", "rear", 1)) for n in names if n.startswith("front")]
    mirrored = [pair for pair in mirrored if pair[1] in names]
    if len(mirrored) > 1:
        yield _exchange(mirrored)
    ends = [(n, n.replace("wheel", "chassis")) for n in names if n.endswith("wheel")]
    ends = [pair for pair in ends if pair[1] in names]
    if len(ends) > 1:
        yield _exchange(ends)


def _exchange(pairs: Sequence[tuple[str, str]]) -> Hypothesis:
    partner = dict(pairs) | {b: a for a, b in pairs}
    text = ", and ".join(f"{_label(a)} and {_label(b)}" for a, b in pairs)

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        order = [recording.channels.index(partner.get(name, name)) for name in recording.channels]
        units = tuple(recording.units[k] for k in order)
        return replace(recording, values=recording.values[order], units=units), vehicle

    return Hypothesis(
        lambda size: (f"the columns of {text} are exchanged", "exchange their names"),
        undo,
        misread=lambda size: True,
    )


def _of_readings(channels: Sequence[Channel], step: float) -> Iterator[Hypothesis]:
    """Signs, gains, lags, filters and places of channels; ``step`` is the sampling step, s."""
    outputs = tuple(channel.name for channel in channels if not channel.is_input)
    inputs = tuple(channel.name for channel in channels if channel.is_input)
    axles = [tuple(c.name for c in channels if c.axle == axle) for axle in ("front", "rear")]
    alone = [(channel.name,) for channel in channels]
    chassis = [c.name for c in channels if c.name in ("front_chassis", "rear_chassis")]
    if len(chassis) == 2:
        yield _misplaced(chassis[0], chassis[1])
        yield _misplaced(chassis[1], chassis[0])
    for channel in channels:
        if channel.quantity == "acceleration":
            yield _drifting(channel.name)
            yield _filtered(channel.name, step, 1)
            yield _filtered(channel.name, step, 2)
    for name in outputs:
        yield _dead(name)
    for names in [*alone, *([outputs] if len(outputs) > 1 else [])]:
        yield _inverted(names)
        yield _gain(names, inputs if names == outputs else ())
        yield _delayed(names)
    for names in axles:  # an axle may have a logger of its own; a common gain is another car
        if 1 < len(names) < len(channels):
            yield _delayed(names)


def _inverted(names: tuple[str, ...]) -> Hypothesis:
    fix = "change the sign of the column, or of counts_scale in the vehicle file"
    return Hypothesis(
        lambda size: (f"{_are_words(names)} upside down", fix),
        lambda recording, vehicle, size: _scaled(recording, vehicle, names, -1.0),
        misread=lambda size: True,
    )


def _gain(names: tuple[str, ...], others: tuple[str, ...] = ()) -> Hypothesis:
    """Wrong gain of channels, which is equivalent to the inverse gain of ``others``."""

    def words(size: float) -> tuple[str, str]:
        if size < math.log(_DEAD):
            return _dead_words(names)
        text = f"the readings of {_and(names)} are {_times(math.exp(size))} what they should be"
        text += f" beside those of {_and(others)}" if others else ""
        for sign, reason in (
            (1.0, "m/s² was given the unit g"),
            (-1.0, "g was given the unit m/s²"),
        ):
            if abs(size - sign * math.log(STANDARD_GRAVITY)) < 3.0 * _NAMED_FACTOR:
                text += f": a column in {reason}"
                text += ", or one of the others the other way round" if others else ""
        return text, "check unit, range and scale of the sensor"

    return Hypothesis(
        words,
        lambda recording, vehicle, size: _scaled(recording, vehicle, names, math.exp(-size)),
        tuple(math.log(gain) for gain in _GAINS),
        stretch=lambda size: dict.fromkeys(names, -size),
        misread=lambda size: abs(size) > _FAR_GAIN,
    )


def _dead_words(names: tuple[str, ...]) -> tuple[str, str]:
    return f"{_are_words(names)} dead or loose", "check sensor, wiring and mount"


def _with_sensor(vehicle: Vehicle, name: str, **changes: float) -> Vehicle:
    """Change a sensor whose readings were corrected; its range is then unknown."""
    sensor = replace(vehicle.sensor(name), low=-math.inf, high=math.inf, **changes)
    return replace(vehicle, sensors={**vehicle.sensors, name: sensor})


def _dead(name: str) -> Hypothesis:
    """Dead sensor: a channel whose readings are only noise."""
    size = math.log(_NOTHING)

    def undo(recording: Recording, vehicle: Vehicle, _: float) -> Corrected:
        readings = recording.values[recording.channels.index(name)]
        one = _si(recording, vehicle, name)
        noise = 0.0 if one is None else float(np.nanstd(readings)) * abs(one)
        if noise == 0.0:
            return recording, vehicle
        noisy = _with_sensor(vehicle, name, noise=noise)
        return _scaled(recording, noisy, [name], 1.0 / _NOTHING)

    return Hypothesis(
        lambda _: _dead_words((name,)),
        undo,
        stretch=lambda _: {name: -size},
        misread=lambda _: True,
    )


def _delayed(names: tuple[str, ...]) -> Hypothesis:
    return Hypothesis(
        lambda size: (
            f"{_are_words(names)} {abs(size) * 1e3:.1f} ms {'late' if size > 0.0 else 'early'}",
            f"give the delay of the sensor in the vehicle file, {-size:.4f} s more than now, or "
            "have it estimated: [clocks] in the vehicle file",
        ),
        lambda recording, vehicle, size: _shifted(recording, vehicle, names, -size),
        tuple(sorted(sign * lag for lag in _LAGS for sign in (1.0, -1.0))),
    )


def _si(recording: Recording, vehicle: Vehicle, name: str) -> float | None:
    """Return the unit of a channel's column in SI; None if the vehicle does not declare it."""
    unit = recording.units[recording.channels.index(name)]
    if unit == COUNTS:
        return vehicle.sensor(name).counts_scale
    return si_factor(unit, vehicle.channel(name).dimension)


def _misplaced(name: str, other: str) -> Hypothesis:
    """Body sensor that is a share of the wheelbase away from its axle."""

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        unit, other_unit = _si(recording, vehicle, name), _si(recording, vehicle, other)
        if unit is None or other_unit is None:
            return recording, vehicle
        c, d = recording.channels.index(name), recording.channels.index(other)
        values = recording.values.copy()
        values[c] -= size * other_unit / unit * values[d]
        moved = replace(recording, values=values)
        return _scaled(moved, vehicle, [name], 1.0 / (1.0 - size))

    def words(size: float) -> tuple[str, str]:
        where = "towards the middle of the car" if size > 0.0 else "away from the middle of the car"
        return (
            f"the {_label(name)} sensor is mounted off its axle by {100 * abs(size):.0f} % of the "
            f"wheelbase, {where}",
            "mount it above the axle",
        )

    return Hypothesis(
        words, undo, _SHARES, stretch=lambda size: {name: -math.log(1.0 - size)},
        misread=lambda size: True,
    )  # fmt: skip


def _filtered(name: str, step: float, order: int) -> Hypothesis:
    """Undeclared low-pass filter: a Butterworth filter of order 1 or 2.

    The size is 1/ω of its corner, s.  It is undone by the recursion that has its poles.
    """

    def recursion(size: float) -> tuple[float, ...]:
        if size <= 0.0:
            return ()
        angles = (math.pi,) if order == 1 else (0.75 * math.pi, 1.25 * math.pi)
        poles = [np.exp(step / size * np.exp(1j * angle)) for angle in angles]
        return tuple(float(x) for x in -np.poly(poles)[1:].real)

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        c = recording.channels.index(name)
        values, weights = recording.values.copy(), recursion(size)
        for lag, weight in enumerate(weights, start=1):
            values[c, lag:] -= weight * recording.values[c, :-lag]
        values[c, len(weights) :] /= 1.0 - sum(weights)
        values[c, : len(weights)] = recording.values[c, : len(weights)]
        return replace(recording, values=values), _with_sensor(vehicle, name)

    def words(size: float) -> tuple[str, str]:
        corner = 1.0 / (2.0 * math.pi * max(size, step))
        return (
            f"{_label(name)} is low-pass filtered at some {corner:.0f} Hz",
            "switch the filter off, or give the bandwidth of the sensor in the vehicle file",
        )

    return Hypothesis(
        words, undo, _TIME_CONSTANTS,
        stretch=lambda size: {name: -math.log(1.0 - sum(recursion(size)))},
    )  # fmt: skip


def _drifting(name: str) -> Hypothesis:
    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        c = recording.channels.index(name)
        one = _si(recording, vehicle, name)
        if one is None:
            return recording, vehicle
        values = recording.values.copy()
        values[c] -= size / one * (recording.time - recording.time[0])
        return replace(recording, values=values), vehicle

    return Hypothesis(
        lambda size: (
            f"the zero of {_label(name)} drifts by {size:.2g} m/s² per second",
            "check the supply, the temperature and the mount of the sensor",
        ),
        undo,
        tuple(sorted(sign * slope for slope in _SLOPES for sign in (1.0, -1.0))),
    )


def _scaled(
    recording: Recording, vehicle: Vehicle, names: Sequence[str], factor: float
) -> Corrected:
    """Multiply the readings of channels, and noise and range of their sensors, by a factor."""
    values = recording.values.copy()
    sensors = dict(vehicle.sensors)
    for name in names:
        c = recording.channels.index(name)
        sensor = vehicle.sensor(name)
        scale = sensor.counts_scale
        if recording.units[c] != "counts":
            values[c] *= factor
        elif scale is not None:
            scale *= factor
        ends = sorted((sensor.low * factor, sensor.high * factor))
        size = abs(factor)
        sensors[name] = replace(
            sensor, counts_scale=scale, low=ends[0], high=ends[1],
            noise=None if sensor.noise is None else sensor.noise * size,
            resolution=None if sensor.resolution is None else sensor.resolution * size,
        )  # fmt: skip
    return replace(recording, values=values), replace(vehicle, sensors=sensors)


def _shifted(
    recording: Recording, vehicle: Vehicle, names: Sequence[str], seconds: float
) -> Corrected:
    """Increase the delays of channels."""
    declared = timing(recording).delay
    added = []
    for name in names:
        declared_delay = declared[recording.channels.index(name)]
        delay = vehicle.sensor(name).delay if declared_delay is None else declared_delay
        added.append((f"delay {name}", f"{delay + seconds:.9f} s"))
    return replace(recording, metadata=(*recording.metadata, *added)), vehicle


def _of_given_values(vehicle: Vehicle, car: CarModel) -> Iterator[Hypothesis]:
    """Given values that are wrong by a factor."""
    springs = tuple(dict.fromkeys(element.spring for element in car.elements))
    given = [p.name for p in car.parameters if p.kind == "given" and hasattr(vehicle, p.name)]
    given_springs = [name for name in springs if name in given]
    if len(given_springs) > 1:
        yield _factor("the spring rates of all axles", given_springs, _SPRING_FACTORS, _SPRING_FIX)
        yield _factor(
            "the spring rates of all axles, each by a factor of its own,", given_springs, {},
            f"make sure that the vehicle file is that of this car; {_SPRING_FIX}",
            apart=_APART,
        )  # fmt: skip
    for name in given_springs:
        axle = next(e.axle for e in car.elements if e.spring == name)
        yield _factor(f"the {axle} spring rate", [name], _SPRING_FACTORS, _SPRING_FIX)
    dampers = list(dict.fromkeys(element.damping for element in car.elements))
    dampers = [name for name in dampers if hasattr(vehicle, name)]
    for names in [dampers, *([name] for name in dampers if len(dampers) > 1)]:
        subject = " and ".join(f"the nominal {QUANTITIES[name][1]}" for name in names)
        yield _factor(subject, names, _DAMPING_FACTORS, _DAMPING_FIX, free=False)
    if "i" in car.estimated:
        inertia = "the nominal pitch inertia"
        yield _factor(inertia, ["i"], _INERTIA_FACTORS, _INERTIA_FIX, free=False)
    if "m" in given:
        yield _factor("the sprung mass", ["m"], _MASS_FACTORS, _MASS_FIX)
    if any(p.kind == "fraction" for p in car.parameters):
        share = vehicle.wdf.value
        yield Hypothesis(
            lambda size: (
                f"the front weight fraction is that of the rear ({1.0 - share:.3f} would fit)",
                "give the front share of the sprung weight",
            ),
            lambda recording, vehicle, size: (recording, _with_share(vehicle, 1.0 - share)),
        )
        yield Hypothesis(
            lambda size: (
                f"the front weight fraction is off ({share + size:.3f} would fit)",
                "weigh both axles",
            ),
            lambda recording, vehicle, size: (recording, _with_share(vehicle, share + size)),
            (-0.1, -0.05, 0.05, 0.1),
        )
    if {"k_f", "k_r"} <= set(given):
        yield Hypothesis(
            lambda size: ("front and rear spring rate are exchanged", "exchange them"),
            lambda r, v, size: (r, replace(v, k_f=v.k_r, k_r=v.k_f)),
        )


def _with_share(vehicle: Vehicle, share: float) -> Vehicle:
    return replace(vehicle, wdf=replace(vehicle.wdf, value=float(np.clip(share, 0.05, 0.95))))


def _factor(
    subject: str,
    names: Sequence[str],
    named: dict[float, str],
    fix: str,
    *,
    free: bool = True,
    apart: float | None = None,
) -> Hypothesis:
    """Given values that are wrong by a common factor.

    Named factors are more probable than others, which are possible only if ``free``.  ``apart`` is
    the standard deviation of the logarithm of each value about the common factor.
    """

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        return recording, _with_factor(vehicle, names, math.exp(-size), apart)

    def freed(vehicle: Vehicle) -> Vehicle:
        return _with_factor(vehicle, names, 1.0, _FREE)

    def size_of(vehicle: Vehicle, values: Mapping[str, float]) -> float:
        logs = [math.log(getattr(vehicle, name).value / values[name]) for name in names]
        return sum(logs) / len(logs)

    def words(size: float) -> tuple[str, str]:
        plural = "are" if len(names) > 1 else "is"
        text = f"{subject} {plural} {_times(math.exp(size))} what the recording shows"
        for factor, reason in named.items():
            if abs(size + math.log(factor)) < 3.0 * _NAMED_FACTOR:
                return f"{text}: {reason}", fix
        return text, fix

    def density(size: float) -> float:
        if not named:
            return _OCCAM + (len(names) - 1) * math.log(_NAMED_FACTOR / _APART)
        nearest = min(abs(size + math.log(factor)) for factor in named) / _NAMED_FACTOR
        known = -math.log(2.0 * len(named)) - 0.5 * nearest**2
        return float(np.logaddexp(math.log(0.5) + _OCCAM, known)) if free else known

    logs = tuple(sorted(-math.log(f) for f in named))
    if not free:
        return Hypothesis(words, undo, logs, density, exact=True)
    return Hypothesis(words, undo, logs, density, exact=True, freed=freed, size_of=size_of)


def _with_factor(
    vehicle: Vehicle, names: Iterable[str], factor: float, deviation: float | None = None
) -> Vehicle:
    """Multiply values and their standard deviations by a factor, or set a relative deviation."""
    changed = {}
    for name in names:
        old: Given | Nominal = getattr(vehicle, name)
        sd = old.sd if deviation is None else deviation * old.value
        sds = {} if sd is None else {"sd": sd * factor}
        changed[name] = replace(old, value=old.value * factor, **sds)
    return replace(vehicle, **changed)  # type: ignore[arg-type]


_SPRING_FIX = (
    "give the rate of both springs of an axle together at the wheel (spring rate times the square "
    "of the motion ratio), and check its unit"
)
_DAMPING_FIX = "give the rate of all dampers of an axle together, at the wheel, and check its unit"
_INERTIA_FIX = "give the pitch inertia of the sprung mass with driver, and check its unit"
_MASS_FIX = (
    "give the sprung mass with driver, without wheels, hubs and half of the links, and check its "
    "unit"
)


def _of_time(recording: Recording, car: CarModel) -> Iterator[Hypothesis]:
    recorded_rate = nominal_rate(recording)
    factors = [recorded_rate / rate for rate in _RATES]  # factors by which time runs too fast
    sizes = [math.log(f) for f in factors if 1.0 / _FARTHEST_RATE < f < _FARTHEST_RATE]
    sizes = [size for size in sizes if abs(size) > math.log(_SAME_RATE)]
    if not sizes:
        return
    yield Hypothesis(
        lambda size: (
            f"time runs {_times(math.exp(-size))} as fast as it should: the sampling rate is "
            f"wrong, {recorded_rate * math.exp(-size):.0f} Hz would fit",
            "check the rate and the unit of the time column",
        ),
        lambda r, v, size: (r, _at_another_rate(car, v, size)),
        tuple(sorted(sizes)),
        lambda size: _RARE - math.log(len(sizes)),
        exact=True,
    )


def _at_another_rate(car: CarModel, vehicle: Vehicle, size: float) -> Vehicle:
    """Return the vehicle that is equivalent to another sampling rate of the recording.

    With the true time t′ = f t, a spring rate k appears as k f² and a damping rate c as c f.  Thus
    the rows do not change, and the choice of a rate does not depend on the noise model.
    """
    springs = {e.spring for e in car.elements if hasattr(vehicle, e.spring)}
    dampers = {e.damping for e in car.elements if hasattr(vehicle, e.damping)}
    stiffer = _with_factor(vehicle, springs, math.exp(2.0 * size))
    return _with_factor(stiffer, dampers, math.exp(size))


def _label(name: str) -> str:
    return name.replace("_", " ")


def _and(names: Sequence[str]) -> str:
    return " and ".join(map(_label, names))


def _are_words(names: Sequence[str]) -> str:
    return f"{_and(names)} {'is' if len(names) == 1 else 'are'}"


def _times(factor: float) -> str:
    """Format a factor."""
    if factor >= 10.0:
        return f"{factor:.0f} times"
    return f"{factor:.2f} times" if factor >= 0.1 else f"{factor:.2g} times"
