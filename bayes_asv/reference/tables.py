"""The reference's tables: printed, recomputed by its own rule, corrected, and obtained here.

*As in the reference* applies the reference's rule to its figures and shows where a printed number
comes from.  *Corrected* is the result of the correct formula, *obtained* the result of this package
by another method.  The difference is that of the obtained from the printed figure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from bayes_asv.domain.units import from_si
from bayes_asv.models.half_car_equations import HalfCar
from bayes_asv.models.modes import modes
from bayes_asv.reference.modal import axle_matrices, corrected_modes, printed_modes
from bayes_asv.reference.printed import (
    TABLE_41,
    TABLE_42,
    TABLE_51,
    TABLE_51_FOUND,
    TABLE_71,
    UNITS,
    car_of_table_41,
    car_of_table_51,
    car_of_table_71,
)

__all__ = ["Row", "Table", "quantities", "table_41", "table_42", "table_51", "table_71"]


@dataclass(frozen=True)
class Row:
    """One printed figure with its recomputed values; None where there is none."""

    name: str
    label: str
    unit: str
    printed: float | None
    as_in_reference: float | None
    corrected: float | None
    obtained: float | None
    where: str

    @property
    def difference(self) -> float | None:
        """Relative difference of the obtained from the printed figure."""
        if self.printed is None or self.obtained is None or self.printed == 0.0:
            return None
        return self.obtained / self.printed - 1.0

    def plain(self) -> dict[str, Any]:
        """Convert to a dict for JSON."""
        difference = self.difference
        return {
            "name": self.name, "label": self.label, "unit": self.unit,
            "printed": self.printed, "its_way": self.as_in_reference,
            "corrected": self.corrected, "obtained": self.obtained,
            "difference_percent": None if difference is None else 100.0 * difference,
            "where": self.where,
        }  # fmt: skip


@dataclass(frozen=True)
class Table:
    """One table of the reference.

    Parameters
    ----------
    key, title : str
        Number, such as ``4.2``, and title.
    rows : tuple of Row
        In the printed order.
    notes : tuple of str
        Remarks.
    """

    key: str
    title: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()


LABELS: Final = {
    "m": "sprung mass m", "k_g": "radius of gyration k_g", "wdf": "weight distribution front wdf",
    "l": "wheel base l", "k_f": "spring rate front k_f", "k_r": "spring rate rear k_r",
    "zeta_f": "damping ratio front cz_f", "zeta_r": "damping ratio rear cz_r",
    "i": "pitch inertia i", "c_f": "damping rate front c_f", "c_r": "damping rate rear c_r",
}  # fmt: skip


def quantities(car: HalfCar) -> dict[str, float]:
    """Return all quantities of a car in the reference's units."""
    return {name: from_si(getattr(car, name), *of) for name, of in UNITS.items()}


def _inputs(printed: Mapping[str, float], car: HalfCar, where: str) -> tuple[Row, ...]:
    """Return the rows of given figures; the obtained ones are those of the simulated car."""
    ours = quantities(car)
    return tuple(
        Row(name, LABELS[name], UNITS[name][0], value, None, value, ours[name], where)
        for name, value in printed.items()
    )


def table_41() -> Table:
    """Build Table 4.1, the car of the spectral study."""
    car = car_of_table_41()
    rows = _inputs(TABLE_41, car, "Table 4.1")
    derived = quantities(car)
    rows += tuple(
        Row(name, LABELS[name], UNITS[name][0], None, None, value, derived[name], "App. C.1")
        for name, value in (
            ("i", TABLE_41["m"] * TABLE_41["k_g"] ** 2),
            ("c_f", 0.2 * math.sqrt(60.0 * 2.0 * 0.4)),
            ("c_r", 0.2 * math.sqrt(60.0 * 2.0 * 0.6)),
        )
    )
    return Table(
        "4.1",
        "Car parameters used to test the FFT",
        rows,
        ("The last three rows are not printed; they follow from the others.",),
    )


def table_42() -> Table:
    """Build Table 4.2, the modes of that car, by the printed and by the correct rule."""
    car = car_of_table_41()
    printed, corrected = printed_modes(car), corrected_modes(car)
    obtained = modes(car)
    labels = {
        "damped": ("damped natural frequency", "Hz", "App. C.1, damped_freq"),
        "ratio": ("damping ratio", "", "App. C.1, damping_zeta"),
        "natural": ("natural frequency", "Hz", "App. C.1, natural_freq"),
    }
    rows = []
    for name, (label, unit, where) in labels.items():
        for k, mode in enumerate(("1st", "2nd")):
            as_in_reference, right, ours = (
                getattr(method[k], name) for method in (printed, corrected, obtained)
            )
            rows.append(
                Row(
                    f"{name}_{k + 1}", f"{label}, {mode} mode", unit, TABLE_42[name][k],
                    as_in_reference, right, ours, where,
                )
            )  # fmt: skip
    M, _, _ = axle_matrices(car)
    ratio = M[0, 0] / M[1, 1]
    return Table(
        "4.2",
        "Modal analysis of that car",
        tuple(rows),
        (
            "As in the reference: all entries of the mass matrix of App. C.1 contain m/4, a centre "
            "of gravity at mid-wheelbase, although the car has 40 % of its weight in front (the "
            f"correct matrix has {ratio:.2f} times as much at the front axle as at the rear). The "
            "damped frequency is ω(1−ζ), since the square in sqrt(1−ζ)^2 is outside the root.",
            "Corrected: mass distribution according to wdf and ω√(1−ζ²), from the generalised "
            "eigenproblem of M, C, K. Obtained: eigenvalues of the system in deflections.",
        ),
    )


def table_51(held: Mapping[str, float], deflection: Mapping[str, float]) -> Table:
    """Build Table 5.1, the parameters that a grey box estimates from simulated data.

    Parameters
    ----------
    held, deflection : mapping of str to float
        k_g, in, and damping ratios estimated from states with held inputs, and in deflections.
    """
    given = {name: value for name, value in TABLE_51.items() if name not in TABLE_51_FOUND}
    rows = _inputs(given, car_of_table_51(), "Table 5.1, input")
    rows += tuple(
        Row(name, LABELS[name], UNITS[name][0], printed, held[name], TABLE_51[name],
            deflection[name], "Table 5.1, predicted")
        for name, printed in TABLE_51_FOUND.items()
    )  # fmt: skip
    return Table(
        "5.1",
        "Parameters of a simulation and their estimates",
        rows,
        (
            "Corrected: the values of the simulation. As in the reference: the four states at 300 "
            "instants, inputs held between them, the default of idgrey. Obtained: in deflections, "
            "accelerations as inputs and outputs, a spline between samples. No noise in either.",
            "Held inputs lag by half a sample, which the grey box compensates with damping: both "
            "ratios are too high, as printed. The radius of gyration comes out too low, which is "
            "not printed. Sampling interval and bump of the reference are unknown, so this "
            "explains its ratios but not its 9.985 in.",
        ),
    )


def table_71() -> Table:
    """Build Table 7.1, the Baja car, with the dependent rows computed."""
    car = car_of_table_71()
    ours = quantities(car)
    corrected = {
        **TABLE_71,
        "m": 500.0 / 32.2 / 12.0,
        "k_g": math.sqrt(TABLE_71["i"] / TABLE_71["m"]),
        "i": TABLE_71["m"] * TABLE_71["k_g"] ** 2,
        "zeta_f": TABLE_71["c_f"] / (2.0 * math.sqrt(100.0 * TABLE_71["m"] * 0.47)),
        "zeta_r": TABLE_71["c_r"] / (2.0 * math.sqrt(100.0 * TABLE_71["m"] * 0.53)),
    }
    rows = tuple(
        Row(
            name,
            LABELS[name],
            UNITS[name][0],
            value,
            None,
            corrected[name],
            ours[name],
            "Table 7.1",
        )
        for name, value in TABLE_71.items()
    )
    return Table(
        "7.1",
        "The 2008 Cal Poly SAE Baja car",
        rows,
        (
            "Corrected: mass from 500 lbf over 32.2 ft/s² (App. C.2); radius of gyration and "
            "inertia each from the other as printed; ratios c / (2 √(k m_axle)). All agree with "
            "the printed digits, the ratios to one unit in the last digit.",
        ),
    )
