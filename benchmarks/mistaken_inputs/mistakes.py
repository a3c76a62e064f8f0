"""Mistakes that a user makes in a vehicle file, with the sensors or with the logger."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .cars import CHANNELS, UNITS, Design, Truth
from .ride import Faults

SPRINGS = ("front_spring_rate", "rear_spring_rate")
DAMPERS = ("front_damping", "rear_damping")
INERTIA = "pitch_inertia"
CHASSIS = ("front_chassis", "rear_chassis")
WHEELS = ("front_wheel", "rear_wheel")


@dataclass(frozen=True)
class Setting:
    """The car before the mistake, and the rate and unit of its recordings."""

    design: Design
    truth: Truth
    units: Mapping[str, str]
    rate: float
    recording_unit: str

    def given(self, key: str) -> float:
        """Return a right given value, in SI."""
        return self.design.values[key]


@dataclass
class Mistake:
    """One mistake, and the words by which an answer that names it can be recognised."""

    details: str
    names: tuple[str, ...]
    words: tuple[str, ...]
    factors: dict[str, float] = field(default_factory=dict)
    """Written over right, by key of the vehicle file or by channel."""
    units: dict[str, str] = field(default_factory=dict)
    """Units that the file states."""
    faults: Faults = field(default_factory=Faults)
    recording_unit: str | None = None


Maker = Callable[[Setting, np.random.Generator], Mistake | None]


@dataclass(frozen=True)
class Kind:
    """A kind of mistake.

    ``shows`` is where a careful reader can see it: in the file alone (``file``), because recordings
    and given values contradict each other (``fit``), or only because the answer is far from nominal
    (``answer``).  ``like`` are kinds that the recordings can hardly tell from this one.
    """

    count: int
    shows: str
    make: Maker
    like: tuple[str, ...] = ()


def _one(rng: np.random.Generator, names: tuple[str, ...]) -> str:
    """Draw one of these names."""
    return names[int(rng.integers(len(names)))]


def _far(factor: float, least: float = 0.15) -> bool:
    """Return whether a factor is too large to be a deviation of a right value."""
    return abs(float(np.log(factor))) > least


# Columns and channels.


def _swap(*pairs: tuple[str, str]) -> Faults:
    """Return a logger with these channels exchanged."""
    columns = {}
    for one, other in pairs:
        columns[one], columns[other] = other, one
    return Faults(columns=columns)


def axles_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Call the front axle rear and the rear axle front."""
    return Mistake(
        "columns of the front and the rear axle are exchanged, wheels and chassis",
        CHANNELS,
        ("swapped", "exchanged", "front and rear", "mixed up", "reversed"),
        faults=_swap(WHEELS, CHASSIS),
    )


def wheel_columns_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Exchange the two wheel columns only."""
    return Mistake(
        "columns front_wheel and rear_wheel are exchanged",
        WHEELS,
        ("swapped", "exchanged", "front and rear", "mixed up"),
        faults=_swap(WHEELS),
    )


def chassis_columns_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Exchange the two chassis columns only."""
    return Mistake(
        "columns front_chassis and rear_chassis are exchanged",
        CHASSIS,
        ("swapped", "exchanged", "front and rear", "mixed up"),
        faults=_swap(CHASSIS),
    )


def wheel_chassis_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Exchange wheel and chassis of one axle, or of both."""
    axle = _one(rng, ("front", "front", "rear", "rear", "both"))
    axles = ("front", "rear") if axle == "both" else (axle,)
    pairs = [(f"{a}_wheel", f"{a}_chassis") for a in axles]
    return Mistake(
        f"wheel and chassis columns are exchanged: {axle}",
        tuple(name for pair in pairs for name in pair),
        ("swapped", "exchanged", "wheel and chassis", "mixed up"),
        faults=_swap(*pairs),
    )


def channel_twice(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the signal of one sensor into two columns."""
    one, other = CHASSIS if rng.random() < 0.6 else WHEELS
    if rng.random() < 0.5:
        one, other = other, one
    return Mistake(
        f"column {one} holds a copy of {other}",
        (one, other),
        ("same", "copy", "identical", "twice", "duplicate"),
        faults=Faults(columns={one: other}),
    )


def gain_low(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Read a channel some 10 % low, or both of the chassis."""
    name = _one(rng, (*CHASSIS, *CHASSIS, *WHEELS, "both chassis"))
    names = CHASSIS if name == "both chassis" else (name,)
    factor = round(float(rng.uniform(0.87, 0.92)), 3)
    return Mistake(
        f"{name} reads {100 * (1 - factor):.1f} % low",
        names,
        ("scale", "gain", "sensitivity", "calibration", "low"),
        dict.fromkeys(names, factor),
        faults=Faults(gain=dict.fromkeys(names, factor)),
    )


def gain_two(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Set a channel to another range, so that it reads double or half."""
    name = _one(rng, (*CHASSIS, *CHASSIS, *WHEELS))
    factor = _one(rng, ("2", "2", "0.5"))
    return Mistake(
        f"{name} reads {factor} times what it should",
        (name,),
        ("scale", "gain", "sensitivity", "range", "twice", "double", "half"),
        {name: float(factor)},
        faults=Faults(gain={name: float(factor)}),
    )


def g_for_ms2(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Call a channel m/s² that is in g."""
    name = _one(rng, (*CHASSIS, *WHEELS, "both chassis", "both wheels"))
    names = {"both chassis": CHASSIS, "both wheels": WHEELS}.get(name, (name,))
    factor = 1 / UNITS["g"]
    return Mistake(
        f"{name} in g under a header of m/s²",
        names,
        ("m/s", " g ", "unit", "9.8", "scale", "gain"),
        dict.fromkeys(names, factor),
        faults=Faults(gain=dict.fromkeys(names, factor)),
        recording_unit="m/s^2",
    )


def ms2_for_g(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Call a channel g that is in m/s²."""
    name = _one(rng, (*CHASSIS, *WHEELS))
    return Mistake(
        f"{name} in m/s² under a header of g",
        (name,),
        ("m/s", " g ", "unit", "9.8", "scale", "gain"),
        {name: UNITS["g"]},
        faults=Faults(gain={name: UNITS["g"]}),
        recording_unit="g",
    )


def inverted(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Mount a sensor, or both of the chassis, upside down."""
    name = _one(rng, (*CHANNELS, *CHANNELS, "both chassis"))
    names = CHASSIS if name == "both chassis" else (name,)
    return Mistake(
        f"{name} has the wrong sign",
        names,
        ("invert", "sign", "upside down", "reversed", "negative"),
        dict.fromkeys(names, -1.0),
        faults=Faults(gain=dict.fromkeys(names, -1.0)),
    )


def dead(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Record a sensor that does not answer: nothing, or its noise."""
    name = _one(rng, CHANNELS)
    how = _one(rng, ("constant", "noise"))
    return Mistake(
        f"{name} is dead and shows {how}",
        (name,),
        ("dead", "constant", "no motion", "flat", "still", "does not move", "not connected"),
        {name: 0.0},
        faults=Faults(dead={name: how}),
    )


def tilted(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Mount a sensor 25 to 50 degrees off the vertical."""
    name = _one(rng, (*CHASSIS, *CHASSIS, *WHEELS))
    angle = round(float(rng.uniform(25, 50)), 0)
    factor = float(np.cos(np.radians(angle)))
    return Mistake(
        f"{name} is tilted by {angle:g}°",
        (name,),
        ("tilt", "vertical", "scale", "gain", "low"),
        {name: factor},
        faults=Faults(tilt={name: angle}),
    )


def off_axle(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Mount a chassis sensor far from its axle, towards the middle of the car."""
    name = _one(rng, CHASSIS)
    metres = round(float(rng.uniform(0.18, 0.35)) * s.given("wheelbase"), 2)
    return Mistake(
        f"{name} is {metres} m from its axle, towards the middle",
        (name,),
        ("position", "above the axle", "over the axle", "mounted", "place"),
        faults=Faults(inboard={name: metres}),
    )


def filtered(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Leave a low-pass filter on in one channel and say nothing of it."""
    name = _one(rng, (*CHASSIS, *WHEELS))
    corner = round(float(rng.uniform(6, 14)), 1)
    return Mistake(
        f"{name} is low-pass filtered at {corner} Hz",
        (name,),
        ("filter", "bandwidth", "late", "delay", "lag"),
        faults=Faults(low_pass={name: corner}),
    )


# Time.

_LATE = ("late", "delay", "lag", "behind", "ahead", "early", "clock", "time", "synchron")


def channel_late(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Receive one channel 5 to 20 ms late."""
    name = _one(rng, (*CHASSIS, *CHASSIS, *WHEELS))
    lag = round(float(rng.uniform(0.005, 0.020)), 4)
    return Mistake(
        f"{name} is {1000 * lag:.1f} ms late", (name,), _LATE, faults=Faults(late={name: lag})
    )


def channel_early(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Correct one channel for a delay that it does not have."""
    name = _one(rng, (*CHASSIS, *WHEELS))
    lag = round(float(rng.uniform(0.005, 0.015)), 4)
    return Mistake(
        f"{name} is {1000 * lag:.1f} ms early", (name,), _LATE, faults=Faults(late={name: -lag})
    )


def chassis_late(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Record the chassis with another logger than the wheels."""
    lag = round(float(rng.uniform(0.005, 0.020)), 4)
    return Mistake(
        f"both chassis channels are {1000 * lag:.1f} ms late",
        CHASSIS,
        _LATE,
        faults=Faults(late=dict.fromkeys(CHASSIS, lag)),
    )


def axle_late(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Record the two axles with two loggers."""
    lag = round(float(rng.uniform(0.008, 0.020)), 4)
    axle = _one(rng, ("front", "rear"))
    names = (f"{axle}_wheel", f"{axle}_chassis")
    return Mistake(
        f"both {axle} channels are {1000 * lag:.1f} ms late",
        names,
        _LATE,
        faults=Faults(late=dict.fromkeys(names, lag)),
    )


def rate_wrong(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Make the time stamps from another sampling rate than that of the logger."""
    factor = float(rng.choice([0.5, 2.0, 0.5, 2.0, 0.8, 1.25]))
    return Mistake(
        f"sampled at {s.rate:g} Hz, stamped as {s.rate / factor:g} Hz",
        ("time", "sample_rate"),
        ("rate", "Hz", "time stamps", "time"),
        {"time": factor},
        faults=Faults(time_factor=factor),
    )


def ms_for_s(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Call the time s that is in ms."""
    return Mistake(
        "time in ms under a header of s",
        ("time",),
        ("ms", "millisecond", "rate", "Hz", "time"),
        {"time": 1000.0},
        faults=Faults(time_in_ms=True),
    )


# Springs.


def springs_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the front springs under rear and the rear springs under front."""
    ratio = s.given(SPRINGS[1]) / s.given(SPRINGS[0])
    if not _far(ratio, 0.2):
        return None
    return Mistake(
        "spring rates of the axles are exchanged",
        SPRINGS,
        ("swapped", "exchanged", "front and rear", "mixed up"),
        {SPRINGS[0]: ratio, SPRINGS[1]: 1 / ratio},
    )


_HALF = ("per wheel", "one side", "both sides", "per side", "half", "each side", "one wheel")


def springs_per_wheel(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the rate of one wheel instead of the axle's."""
    return Mistake(
        "spring rates of one wheel instead of both", SPRINGS, _HALF, dict.fromkeys(SPRINGS, 0.5)
    )


def springs_per_wheel_one_axle(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the rate of one wheel instead of the axle's at one axle."""
    key = _one(rng, SPRINGS)
    return Mistake(f"{key} of one wheel instead of both", (key,), _HALF, {key: 0.5})


_RATIO = ("at the spring", "motion ratio", "at the wheel", "motion_ratio", "lever")


def springs_at_spring(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the rates of the springs themselves."""
    factors = {k: 1 / r**2 for k, r in zip(SPRINGS, s.design.motion_ratios, strict=True)}
    return Mistake("spring rates at the springs, not at the wheels", SPRINGS, _RATIO, factors)


def springs_at_spring_one_axle(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the rates of the springs themselves at one axle."""
    axle = int(rng.integers(2))
    factor = 1 / s.design.motion_ratios[axle] ** 2
    if not _far(factor, 0.25):
        return None
    key = SPRINGS[axle]
    return Mistake(f"{key} at the springs, not at the wheels", (key,), _RATIO, {key: factor})


def motion_ratio_once(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Multiply the springs by the motion ratio instead of its square."""
    factors = {k: 1 / r for k, r in zip(SPRINGS, s.design.motion_ratios, strict=True)}
    if not any(_far(factor) for factor in factors.values()):
        return None
    words = (*_RATIO, "square")
    return Mistake("spring rates with the motion ratio, not its square", SPRINGS, words, factors)


def _misnamed(
    rng: np.random.Generator,
    keys: tuple[str, ...],
    choices: tuple[tuple[float, str, str], ...],
) -> Mistake:
    """Write numbers in one unit and call them another: (true unit in SI, its name, stated)."""
    size, true, stated = choices[int(rng.integers(len(choices)))]
    factor = UNITS[stated] / size
    return Mistake(
        f"{' and '.join(keys)} in {true}, called {stated}",
        keys,
        ("unit", true, true.replace("*", "·")),
        dict.fromkeys(keys, factor),
        dict.fromkeys(keys, stated),
    )


def springs_unit(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take lbf/in for N/mm, N/mm for lbf/in or kgf/mm for N/mm."""
    keys = SPRINGS if rng.random() < 0.75 else (_one(rng, SPRINGS),)
    pound = (UNITS["lbf/in"], "lbf/in", "N/mm")
    newton = (UNITS["N/mm"], "N/mm", "lbf/in")
    return _misnamed(rng, keys, (pound, pound, newton, newton, (9806.65, "kgf/mm", "N/mm")))


def springs_decimal(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Slip the decimal point of a spring rate."""
    key = _one(rng, SPRINGS)
    factor = float(rng.choice([0.1, 10.0]))
    return Mistake(f"{key} times {factor:g}", (key,), ("decimal", "10", "digit"), {key: factor})


# Dampers.


def dampers_swapped(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the front damping under rear and the rear damping under front."""
    ratio = s.given(DAMPERS[1]) / s.given(DAMPERS[0])
    if not _far(ratio, 0.2):
        return None
    return Mistake(
        "nominal damping of the axles is exchanged",
        DAMPERS,
        ("swapped", "exchanged", "front and rear", "mixed up"),
        {DAMPERS[0]: ratio, DAMPERS[1]: 1 / ratio},
    )


def damping_at_damper(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the rates of the dampers themselves."""
    factors = {k: 1 / r**2 for k, r in zip(DAMPERS, s.design.motion_ratios, strict=True)}
    words = ("at the damper", "motion ratio", "at the wheel", "motion_ratio", "lever")
    return Mistake("nominal damping at the dampers, not at the wheels", DAMPERS, words, factors)


def damping_per_side(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the damping of one side."""
    factors = dict.fromkeys(DAMPERS, 0.5)
    return Mistake("nominal damping of one side instead of both", DAMPERS, _HALF, factors)


def damping_per_side_one_axle(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the damping of one side at one axle."""
    key = _one(rng, DAMPERS)
    return Mistake(f"nominal {key} of one side instead of both", (key,), _HALF, {key: 0.5})


def damping_unit(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take one unit of damping for another."""
    inch, foot = UNITS["lbf*s/in"], UNITS["lbf*s/ft"]
    choices = (
        (inch, "lbf*s/in", "lbf*s/ft"),
        (foot, "lbf*s/ft", "lbf*s/in"),
        (foot, "lbf*s/ft", "lbf*s/in"),
        (1000.0, "N*s/mm", "N*s/m"),
        (1.0, "N*s/m", "N*s/mm"),
        (inch, "lbf*s/in", "N*s/m"),
        (1.0, "N*s/m", "lbf*s/in"),
    )
    return _misnamed(rng, DAMPERS, choices)


# Mass and its place.

_MASS = ("sprung_mass",)


def mass_unit(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take pounds for kilograms, kilograms for pounds, slugs for blobs or newtons for kilograms."""
    pound = (UNITS["lbm"], "lbm", "kg")
    kilo = (1.0, "kg", "lbm")
    choices = (pound, pound, pound, kilo, kilo, kilo, (1 / 9.80665, "N", "kg"))
    slug = (UNITS["lbf*s^2/in"] / 12, "slug", "lbf*s^2/in")
    return _misnamed(rng, _MASS, (*choices, slug))


def mass_digits(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Exchange two digits of the mass."""
    number = f"{s.given('sprung_mass') / UNITS[s.units['sprung_mass']]:.0f}"
    at = int(rng.integers(len(number) - 1))
    wrong = number[:at] + number[at + 1] + number[at] + number[at + 2 :]
    factor = int(wrong) / int(number)
    if wrong.startswith("0") or not _far(factor, 0.1):
        return None
    return Mistake(
        f"mass {wrong} for {number}", _MASS, ("mass", "weigh", "digit"), {"sprung_mass": factor}
    )


def total_mass(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the mass on the scales, with wheels and axles."""
    sprung = s.given("sprung_mass")
    factor = (sprung + sum(s.design.unsprung)) / sprung
    words = ("total", "unsprung", "wheels", "sprung", "weigh", "heav")
    return Mistake(
        "total mass, with wheels and axles, for sprung mass", _MASS, words, {"sprung_mass": factor}
    )


def _person(s: Setting, mass: float, share: float) -> dict[str, float]:
    """Return factors of mass and front share with another person on board; negative: one less."""
    m, w = s.given("sprung_mass"), s.given("front_weight_fraction")
    there = (m * w + mass * share) / (m + mass)
    return {"sprung_mass": (m + mass) / m, "front_weight_fraction": there / w}


def without_driver(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Weigh the car without its driver."""
    return Mistake(
        f"weighed without the driver of {s.design.driver:g} kg",
        ("sprung_mass",),
        ("driver", "weigh", "light"),
        _person(s, -s.design.driver, s.design.driver_share),
    )


def with_passenger(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Weigh the car with people or ballast that are not on board in the drive."""
    extra = s.design.passenger * int(rng.integers(1, 4)) or s.design.driver
    return Mistake(
        f"weighed with {extra:g} kg that are not on board in the drive",
        ("sprung_mass",),
        ("passenger", "driver", "weigh", "heav", "load"),
        _person(s, extra, 0.45),
    )


def share_mirrored(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the share of the rear axle."""
    share = s.given("front_weight_fraction")
    if abs(share - 0.5) < 0.02:
        return None
    return Mistake(
        f"rear share {1 - share:.3f} for front share {share:.3f}",
        ("front_weight_fraction",),
        ("mirror", "rear", "weight", "share", "fraction"),
        {"front_weight_fraction": (1 - share) / share},
    )


def share_percent(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the front share in percent."""
    return Mistake(
        "front share in percent",
        ("front_weight_fraction",),
        ("percent", "%", "between 0 and 1", "less than", "100"),
        {"front_weight_fraction": 100.0},
    )


def wheelbase_off(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Measure the wheelbase some 10 % long or short."""
    factor = float(rng.choice([-1, 1]) * rng.uniform(0.09, 0.13)) + 1
    words = ("wheelbase", "wheel base", "length", "measure")
    return Mistake(
        f"wheelbase {100 * (factor - 1):+.0f} %", ("wheelbase",), words, {"wheelbase": factor}
    )


def wheelbase_unit(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take one unit of length for another."""
    choices = (
        (0.01, "cm", "mm"),
        (UNITS["in"], "in", "cm"),
        (0.01, "cm", "in"),
        (0.001, "mm", "cm"),
    )
    return _misnamed(rng, ("wheelbase",), choices)


def wheelbase_other_length(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the length or the track of the car as its wheelbase."""
    lengths = {"overall length": s.design.overall_length, "track": s.design.track}
    name = _one(rng, tuple(lengths))
    factor = lengths[name] / s.given("wheelbase")
    words = ("wheelbase", "wheel base", "length", "track", "measure")
    return Mistake(f"{name} for wheelbase", ("wheelbase",), words, {"wheelbase": factor})


def inertia_unit(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take one unit of inertia for another."""
    blob = UNITS["lbf*s^2*in"]
    choices = (
        (1.0, "kg*m^2", "lbf*s^2*in"),
        (blob, "lbf*s^2*in", "kg*m^2"),
        (UNITS["lbm*ft^2"], "lbm*ft^2", "kg*m^2"),
        (UNITS["lbm*in^2"], "lbm*in^2", "lbf*s^2*in"),
        (12 * blob, "lbf*s^2*ft", "lbf*s^2*in"),
    )
    return _misnamed(rng, (INERTIA,), choices)


def inertia_other_axis(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Write the inertia in roll as that in pitch."""
    factor = round(float(rng.uniform(0.2, 0.33)), 3)
    words = ("roll", "axis", "inertia", "gyration")
    return Mistake("roll inertia for pitch inertia", (INERTIA,), words, {INERTIA: factor})


def other_car(s: Setting, rng: np.random.Generator) -> Mistake | None:
    """Take the vehicle file of another car; the caller writes it."""
    return Mistake(
        "vehicle file of another car",
        ("sprung_mass", *SPRINGS, "front_weight_fraction"),
        ("another car", "other car", "not from this car", "this car", "vehicle file"),
    )


KINDS: dict[str, Kind] = {
    "axles_swapped": Kind(12, "fit", axles_swapped),
    "wheel_columns_swapped": Kind(4, "fit", wheel_columns_swapped),
    "chassis_columns_swapped": Kind(4, "fit", chassis_columns_swapped),
    "wheel_chassis_swapped": Kind(9, "fit", wheel_chassis_swapped),
    "channel_twice": Kind(4, "file", channel_twice),
    "gain_low": Kind(10, "fit", gain_low, ("tilted",)),
    "gain_two": Kind(7, "fit", gain_two),
    "g_for_ms2": Kind(6, "fit", g_for_ms2, ("gain_two",)),
    "ms2_for_g": Kind(2, "fit", ms2_for_g, ("gain_two",)),
    "inverted": Kind(9, "fit", inverted),
    "dead": Kind(7, "file", dead),
    "tilted": Kind(5, "fit", tilted, ("gain_low",)),
    "off_axle": Kind(4, "fit", off_axle),
    "filtered": Kind(3, "fit", filtered, ("channel_late",)),
    "channel_late": Kind(11, "fit", channel_late, ("filtered",)),
    "channel_early": Kind(4, "fit", channel_early),
    "chassis_late": Kind(6, "fit", chassis_late),
    "axle_late": Kind(3, "fit", axle_late, ("channel_late", "channel_early")),
    "rate_wrong": Kind(8, "fit", rate_wrong),
    "ms_for_s": Kind(4, "file", ms_for_s),
    "springs_swapped": Kind(5, "fit", springs_swapped),
    "springs_per_wheel": Kind(14, "fit", springs_per_wheel),
    "springs_per_wheel_one_axle": Kind(4, "fit", springs_per_wheel_one_axle),
    "springs_at_spring": Kind(11, "fit", springs_at_spring),
    "springs_at_spring_one_axle": Kind(6, "fit", springs_at_spring_one_axle),
    "motion_ratio_once": Kind(4, "fit", motion_ratio_once, ("springs_at_spring",)),
    "springs_unit": Kind(10, "fit", springs_unit),
    "springs_decimal": Kind(3, "fit", springs_decimal, ("springs_unit",)),
    "dampers_swapped": Kind(12, "answer", dampers_swapped),
    "damping_at_damper": Kind(9, "answer", damping_at_damper),
    "damping_per_side": Kind(9, "answer", damping_per_side),
    "damping_per_side_one_axle": Kind(3, "answer", damping_per_side_one_axle),
    "damping_unit": Kind(10, "answer", damping_unit),
    "mass_unit": Kind(8, "fit", mass_unit),
    "mass_digits": Kind(3, "fit", mass_digits, ("total_mass", "without_driver")),
    "total_mass": Kind(12, "fit", total_mass, ("with_passenger",)),
    "without_driver": Kind(12, "fit", without_driver),
    "with_passenger": Kind(3, "fit", with_passenger, ("total_mass",)),
    "share_mirrored": Kind(9, "fit", share_mirrored),
    "share_percent": Kind(3, "file", share_percent),
    "wheelbase_off": Kind(6, "answer", wheelbase_off, ("inertia_unit", "inertia_other_axis")),
    "wheelbase_unit": Kind(5, "answer", wheelbase_unit, ("inertia_unit", "inertia_other_axis")),
    "wheelbase_other_length": Kind(
        4, "answer", wheelbase_other_length, ("inertia_unit", "inertia_other_axis")
    ),
    "inertia_unit": Kind(7, "answer", inertia_unit, ("wheelbase_unit",)),
    "inertia_other_axis": Kind(3, "answer", inertia_other_axis, ("wheelbase_unit",)),
    "other_car": Kind(3, "fit", other_car),
}
"""Every kind of mistake; the counts add up to 300."""

ONE_RUN = ("wheel_chassis_swapped", "inverted", "dead", "channel_late", "gain_two")
"""Kinds that may affect only the second of two runs."""
