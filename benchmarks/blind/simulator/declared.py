"""What the owner declares of a car: given values with errors, nominal values, sensors; as TOML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .cars import GRAVITY, Car, Family
from .kinds import CHANNELS, Span
from .sensors import Sensor

__all__ = ["Declared", "declare"]

INCH = 0.0254
POUND = 0.45359237
POUND_FORCE = POUND * GRAVITY


@dataclass(frozen=True)
class Declared:
    """Given and nominal values in SI; ``sds`` are relative, of mass, weight fraction and springs.

    ``nominal`` has the damping rates front and rear (N·s/m) and the pitch inertia (kg·m²).
    """

    name: str
    units: str
    m: float
    wheelbase: float
    wdf: float
    k: Span
    sds: tuple[float, float, float, float]
    nominal: tuple[float, float, float]
    sensors: Mapping[str, Sensor]

    def changed(
        self, m: float = 1.0, wdf: float = 1.0, k_f: float = 1.0, k_r: float = 1.0
    ) -> Declared:
        """Return the same with given values multiplied by factors."""
        return replace(self, m=self.m * m, wdf=self.wdf * wdf, k=(self.k[0] * k_f, self.k[1] * k_r))

    def rounded(self) -> Declared:
        """Return the same with the digits that an owner would write."""

        def short(x: float) -> float:
            return float(f"{x:.5g}")

        return replace(
            self,
            m=short(self.m),
            wdf=short(self.wdf),
            k=(short(self.k[0]), short(self.k[1])),
            sds=tuple(float(f"{x:.2g}") for x in self.sds),  # type: ignore[arg-type]
        )

    def toml(self) -> str:
        """Return the vehicle file."""
        us = self.units == "US"
        spring = (INCH / POUND_FORCE, "lbf/in") if us else (1e-3, "N/mm")
        damping = (INCH / POUND_FORCE, "lbf*s/in") if us else (1.0, "N*s/m")
        inertia = (1.0 / (POUND_FORCE * INCH), "lbf*s^2*in") if us else (1.0, "kg*m^2")
        mass = (1.0 / POUND, "lbm") if us else (1.0, "kg")
        length = {"US": (1.0 / INCH, "in"), "SI mm": (1e3, "mm")}.get(self.units, (1.0, "m"))
        acceleration = {"US": (1.0 / INCH, "in/s^2"), "SI": (1.0 / GRAVITY, "g")}.get(
            self.units, (1.0, "m/s^2")
        )

        def entry(value: float, unit: tuple[float, str] | None, sd: float | None = None) -> str:
            factor, name = unit or (1.0, "")
            text = f"{{ value = {value * factor:.10g}"
            text += f', unit = "{name}"' if name else ""
            text += f', sd = "{100.0 * sd:.4g} %"' if sd else ""
            return text + " }"

        lines = [
            f'name = "{self.name}"',
            f'units = "{"US" if us else "SI"}"',
            "",
            "[known]",
            f"sprung_mass = {entry(self.m, mass, self.sds[0])}",
            f"wheelbase = {entry(self.wheelbase, length)}",
            f"front_weight_fraction = {entry(self.wdf, None, self.sds[1])}",
            f"front_spring_rate = {entry(self.k[0], spring, self.sds[2])}",
            f"rear_spring_rate = {entry(self.k[1], spring, self.sds[3])}",
            "",
            "[nominal]",
            f"front_damping = {entry(self.nominal[0], damping)}",
            f"rear_damping = {entry(self.nominal[1], damping)}",
            f"pitch_inertia = {entry(self.nominal[2], inertia)}",
        ]
        for channel in CHANNELS:
            sensor = self.sensors[channel]
            lines += [
                "",
                f"[sensors.{channel}]",
                f"range = {entry(sensor.limit, (1.0 / GRAVITY, 'g'))}",
                f"noise = {entry(sensor.noise, acceleration)}",
                f"resolution = {entry(sensor.step, acceleration)}",
            ]
            if sensor.corner is not None:
                lines.append(f"bandwidth = {entry(sensor.corner, (1.0, 'Hz'))}")
            if sensor.delay:
                lines.append(f"delay = {entry(sensor.delay, (1.0, 's'))}")
        return "\n".join(lines) + "\n"


def declare(
    car: Car, family: Family, sensors: Mapping[str, Sensor], rng: np.random.Generator
) -> Declared:
    """Draw what the owner of a car knows: given values with normal errors of the declared sizes."""
    sds = (
        float(rng.uniform(*family.sds[0])),
        float(rng.uniform(*family.sds[1])),
        float(rng.uniform(*family.sds[2])),
        float(rng.uniform(*family.sds[2])),
    )
    sds = (round(sds[0], 4), round(sds[1], 4), round(sds[2], 3), round(sds[3], 3))
    error = [1.0 / (1.0 + sd * float(rng.standard_normal())) for sd in sds]
    off = np.exp(rng.standard_normal(3) * np.array([0.3, 0.3, 0.2]))
    nominal = (
        float(f"{car.c[0] * off[0]:.4g}"),
        float(f"{car.c[1] * off[1]:.4g}"),
        float(f"{car.i * off[2]:.4g}"),
    )
    drawn = Declared(
        family.name,
        family.units,
        car.m * error[0],
        car.wheelbase,
        car.wdf * error[1],
        (car.k[0] * error[2], car.k[1] * error[3]),
        sds,
        nominal,
        sensors,
    )
    return drawn.rounded()
