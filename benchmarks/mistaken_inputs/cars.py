"""Three cars, the true values of one specimen of each, and the vehicle file of its team."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

G = 9.80665
POUND = 0.45359237
INCH = 0.0254
POUND_FORCE = POUND * G

CHANNELS = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")
KNOWN = (
    "sprung_mass",
    "wheelbase",
    "front_weight_fraction",
    "front_spring_rate",
    "rear_spring_rate",
)
NOMINAL = ("front_damping", "rear_damping", "pitch_inertia")

UNITS: dict[str, float] = {
    "": 1.0,
    "kg": 1.0,
    "lbm": POUND,
    "lbf*s^2/in": POUND_FORCE / INCH,
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "in": INCH,
    "N/m": 1.0,
    "N/mm": 1000.0,
    "lbf/in": POUND_FORCE / INCH,
    "N*s/m": 1.0,
    "N*s/mm": 1000.0,
    "lbf*s/in": POUND_FORCE / INCH,
    "lbf*s/ft": POUND_FORCE / (12 * INCH),
    "kg*m^2": 1.0,
    "lbf*s^2*in": POUND_FORCE * INCH,
    "lbm*ft^2": POUND * (12 * INCH) ** 2,
    "lbm*in^2": POUND * INCH**2,
    "m/s^2": 1.0,
    "g": G,
    "in/s^2": INCH,
}
"""Every unit of the vehicle files and recordings, in SI."""

SI_UNITS = {
    "sprung_mass": "kg",
    "wheelbase": "m",
    "front_weight_fraction": "",
    "front_spring_rate": "N/mm",
    "rear_spring_rate": "N/mm",
    "front_damping": "N*s/m",
    "rear_damping": "N*s/m",
    "pitch_inertia": "kg*m^2",
}
US_UNITS = {
    "sprung_mass": "lbm",
    "wheelbase": "in",
    "front_weight_fraction": "",
    "front_spring_rate": "lbf/in",
    "rear_spring_rate": "lbf/in",
    "front_damping": "lbf*s/in",
    "rear_damping": "lbf*s/in",
    "pitch_inertia": "lbf*s^2*in",
}


@dataclass(frozen=True)
class Design:
    """What a team knows of its car, in SI; rates are at the wheel, both sides together."""

    name: str
    values: Mapping[str, float]
    unsprung: tuple[float, float]
    tyre_rates: tuple[float, float]
    motion_ratios: tuple[float, float]
    driver: float
    driver_share: float
    passenger: float
    overall_length: float
    track: float
    travel: tuple[float, float]
    speeds: tuple[float, float]
    road_height: float
    tyre_patch: float
    us_share: float


BAJA = Design(
    name="baja",
    values={
        "sprung_mass": 262.0,
        "wheelbase": 1.56,
        "front_weight_fraction": 0.44,
        "front_spring_rate": 15200.0,
        "rear_spring_rate": 21800.0,
        "front_damping": 1110.0,
        "rear_damping": 1640.0,
        "pitch_inertia": 82.0,
    },
    unsprung=(33.0, 40.0),
    tyre_rates=(70e3, 76e3),
    motion_ratios=(0.62, 0.71),
    driver=78.0,
    driver_share=0.47,
    passenger=0.0,
    overall_length=2.24,
    track=1.30,
    travel=(0.12, 0.13),
    speeds=(3.0, 8.0),
    road_height=0.09,
    tyre_patch=0.16,
    us_share=0.5,
)
FORMULA = Design(
    name="formula",
    values={
        "sprung_mass": 251.0,
        "wheelbase": 1.545,
        "front_weight_fraction": 0.472,
        "front_spring_rate": 46000.0,
        "rear_spring_rate": 57000.0,
        "front_damping": 3050.0,
        "rear_damping": 2350.0,
        "pitch_inertia": 96.0,
    },
    unsprung=(21.0, 25.0),
    tyre_rates=(215e3, 235e3),
    motion_ratios=(0.74, 0.83),
    driver=72.0,
    driver_share=0.50,
    passenger=0.0,
    overall_length=2.87,
    track=1.22,
    travel=(0.030, 0.030),
    speeds=(4.0, 12.0),
    road_height=0.035,
    tyre_patch=0.12,
    us_share=0.3,
)
PASSENGER = Design(
    name="passenger",
    values={
        "sprung_mass": 905.0,
        "wheelbase": 2.42,
        "front_weight_fraction": 0.60,
        "front_spring_rate": 41000.0,
        "rear_spring_rate": 31500.0,
        "front_damping": 2760.0,
        "rear_damping": 1930.0,
        "pitch_inertia": 1190.0,
    },
    unsprung=(70.0, 62.0),
    tyre_rates=(370e3, 350e3),
    motion_ratios=(0.93, 0.68),
    driver=76.0,
    driver_share=0.54,
    passenger=72.0,
    overall_length=3.62,
    track=1.41,
    travel=(0.085, 0.095),
    speeds=(4.0, 12.0),
    road_height=0.07,
    tyre_patch=0.15,
    us_share=0.0,
)
CARS = {design.name: design for design in (BAJA, FORMULA, PASSENGER)}


def significant(value: float, digits: int = 4) -> float:
    """Return the value as a person writes it, with a few significant digits."""
    return float(f"{value:.{digits}g}")


def draw_design(base: Design, rng: np.random.Generator) -> Design:
    """Draw a car of this kind: another year's springs, driver and wheelbase."""
    spread = {"wheelbase": 0.04, "front_weight_fraction": 0.02}
    values = {
        key: significant(value * (1 + rng.uniform(-1, 1) * spread.get(key, 0.1)), 3)
        for key, value in base.values.items()
    }
    return replace(
        base,
        values=values,
        driver=round(base.driver * rng.uniform(0.85, 1.15), 1),
        unsprung=(
            base.unsprung[0] * rng.uniform(0.9, 1.1),
            base.unsprung[1] * rng.uniform(0.9, 1.1),
        ),
        motion_ratios=(
            round(base.motion_ratios[0] * rng.uniform(0.95, 1.04), 3),
            round(base.motion_ratios[1] * rng.uniform(0.95, 1.04), 3),
        ),
    )


@dataclass(frozen=True)
class Truth:
    """The car as it is, and how far its dampers are from their design."""

    values: Mapping[str, float]
    deviation: tuple[float, float]
    worn: tuple[bool, bool]


def _normal(rng: np.random.Generator) -> float:
    """Draw a standard normal number without the rarest half percent on either side."""
    while True:
        number = float(rng.normal())
        if abs(number) < 2.5:
            return number


def draw_sds(rng: np.random.Generator) -> dict[str, float]:
    """Draw the relative standard deviations that the team states for what it measured."""
    spring = float(rng.choice([0.03, 0.05, 0.05]))
    return {
        "sprung_mass": float(rng.choice([0.01, 0.01, 0.01, 0.02])),
        "wheelbase": float(rng.choice([0.0, 0.0, 0.003])),
        "front_weight_fraction": float(rng.choice([0.01, 0.01, 0.015])),
        "front_spring_rate": spring,
        "rear_spring_rate": spring,
    }


def draw_truth(design: Design, sds: Mapping[str, float], rng: np.random.Generator) -> Truth:
    """Draw a car whose true values agree with what its team states."""
    values = dict(design.values)
    for key, sd in sds.items():
        values[key] *= 1 + sd * _normal(rng)
    values["pitch_inertia"] *= float(np.exp(0.1 * _normal(rng)))
    deviations: list[float] = []
    worn: list[bool] = []
    for key in ("front_damping", "rear_damping"):
        is_worn = bool(rng.random() < 0.5)
        size = rng.uniform(0.10, 0.40)
        deviation = float(size * rng.choice([-1, 1])) if is_worn else 0.02 * _normal(rng)
        values[key] *= 1 + deviation
        deviations.append(deviation)
        worn.append(is_worn)
    return Truth(values, (deviations[0], deviations[1]), (worn[0], worn[1]))


@dataclass(frozen=True)
class Sensors:
    """Accelerometers as the vehicle file declares them, in m/s²; wheel first, chassis second."""

    noise: tuple[float, float]
    resolution: tuple[float, float]
    limits: tuple[float, float]
    bandwidth: tuple[float, float] | None
    chassis_delay: float


def draw_sensors(rate: float, rng: np.random.Generator) -> Sensors:
    """Draw one of three kinds of accelerometer: analogue, digital with a filter, digital."""
    kind = int(rng.integers(3))
    if kind == 0:
        corner = float(rng.choice([50.0, 80.0]))
        density = 0.0025 * rng.uniform(0.8, 1.3)
        noise = density * np.sqrt(corner * np.pi / 2)
        return Sensors(
            (significant(noise, 3), significant(0.6 * noise, 3)),
            (0.0766, 0.0383),
            (16 * G, 8 * G),
            (corner, corner),
            float(rng.choice([0.0, 0.0004, 0.0007])),
        )
    noise = significant(rng.uniform(0.03, 0.09), 2)
    bands = None if kind == 2 else (min(0.4 * rate, 150.0), min(0.4 * rate, 150.0))
    return Sensors((noise, noise), (0.00479, 0.00239), (16 * G, 8 * G), bands, 0.0)


def _quantity(value: float, unit: str, sd: float = 0.0) -> str:
    """Write one value of a vehicle file."""
    parts = [f"value = {significant(value):.10g}"]
    if unit:
        parts.append(f'unit = "{unit}"')
    if sd:
        parts.append(f'sd = "{100 * sd:g} %"')
    return "{ " + ", ".join(parts) + " }"


def vehicle_file(
    name: str,
    style: str,
    values: Mapping[str, float],
    units: Mapping[str, str],
    sds: Mapping[str, float],
    sensors: Sensors,
    travels: tuple[float, float],
) -> str:
    """Write a vehicle file with these values, which are in SI, in these units."""
    lines = [f'name  = "{name}"', f'units = "{style}"', "", "[known]"]
    for key in KNOWN:
        number = values[key] / UNITS[units[key]]
        lines.append(f"{key} = {_quantity(number, units[key], sds[key])}")
    lines += ["", "[nominal]"]
    for key in NOMINAL:
        lines.append(f"{key} = {_quantity(values[key] / UNITS[units[key]], units[key])}")
    lines += ["", "[travel]"]
    for axle, travel in zip(("front", "rear"), travels, strict=True):
        for way in ("bump", "droop"):
            lines.append(f"{axle}_{way} = {_quantity(1000 * travel, 'mm')}")
    for channel in CHANNELS:
        which = 0 if channel.endswith("wheel") else 1
        lines += [
            "",
            f"[sensors.{channel}]",
            f"range = {_quantity(sensors.limits[which] / G, 'g')}",
            f"noise = {_quantity(sensors.noise[which], 'm/s^2')}",
            f"resolution = {_quantity(sensors.resolution[which], 'm/s^2')}",
        ]
        if sensors.bandwidth is not None:
            lines.append(f"bandwidth = {_quantity(sensors.bandwidth[which], 'Hz')}")
        if which == 1 and sensors.chassis_delay:
            lines.append(f"delay = {_quantity(sensors.chassis_delay, 's')}")
    return "\n".join(lines) + "\n"
