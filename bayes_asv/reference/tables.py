"""The reference's tables beside ours: printed, in its own way again, corrected, obtained.

*Its way* follows the reference's rule on its figures and shows where a printed number comes from.
*Corrected* is what the right rule gives, from a formula; *obtained* is what this package gives by
another way.  The difference is that of the obtained from the printed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from bayes_asv.domain.units import from_si
from bayes_asv.models.half_car import HalfCar
from bayes_asv.models.modes import modes
from bayes_asv.reference.modal import axle_matrices, printed_way, right_way
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

__all__ = ["COLUMNS", "Row", "Table", "quantities", "table_41", "table_42", "table_51", "table_71"]

COLUMNS: Final = ("printed", "its_way", "corrected", "obtained")


@dataclass(frozen=True)
class Row:
    """One printed figure and what becomes of it; None where there is nothing to say."""

    name: str
    label: str
    unit: str
    printed: float | None
    its_way: float | None
    corrected: float | None
    obtained: float | None
    where: str

    @property
    def difference(self) -> float | None:
        """Obtained over printed, less one."""
        if self.printed is None or self.obtained is None or self.printed == 0.0:
            return None
        return self.obtained / self.printed - 1.0

    def plain(self) -> dict[str, Any]:
        """Tell it as a dict for JSON."""
        share = self.difference
        return {
            "name": self.name, "label": self.label, "unit": self.unit,
            **{column: getattr(self, column) for column in COLUMNS},
            "difference_percent": None if share is None else 100.0 * share,
            "where": self.where,
        }  # fmt: skip


@dataclass(frozen=True)
class Table:
    """One table of the reference.

    Parameters
    ----------
    key, title : str
        ``4.2``, and what it is about.
    rows : tuple of Row
        In the printed order.
    notes : tuple of str
        What to know, in sentences.
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
    """Every quantity of a car in the reference's units, ratios from the rates."""
    return {name: from_si(getattr(car, name), *of) for name, of in UNITS.items()}


def _inputs(printed: Mapping[str, float], car: HalfCar, where: str) -> tuple[Row, ...]:
    """Rows for given figures: obtained is what the simulated car has."""
    ours = quantities(car)
    return tuple(
        Row(name, LABELS[name], UNITS[name][0], value, None, value, ours[name], where)
        for name, value in printed.items()
    )


def table_41() -> Table:
    """Table 4.1, the car on which the spectrum was tried."""
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
    """Table 4.2, the modes of that car: the printed rule, and the right one in two ways."""
    car = car_of_table_41()
    theirs, right = printed_way(car), right_way(car)
    ours = modes(car)
    words = {
        "damped": ("damped natural frequency", "Hz", "App. C.1, damped_freq"),
        "ratio": ("damping ratio", "", "App. C.1, damping_zeta"),
        "natural": ("natural frequency", "Hz", "App. C.1, natural_freq"),
    }
    rows = []
    for name, (label, unit, where) in words.items():
        for k, mode in enumerate(("1st", "2nd")):
            rows.append(
                Row(
                    f"{name}_{k + 1}", f"{label}, {mode} mode", unit, TABLE_42[name][k],
                    getattr(theirs[k], name), getattr(right[k], name), getattr(ours[k], name),
                    where,
                )
            )  # fmt: skip
    M, _, _ = axle_matrices(car)
    ratio = M[0, 0] / M[1, 1]
    return Table(
        "4.2",
        "Modal analysis of that car",
        tuple(rows),
        (
            "Its way: the mass matrix of App. C.1 has m/4 in every place, a centre of gravity at "
            "mid-wheelbase, although the car has 40 % of its weight in front (the right matrix has "
            f"{ratio:.2f} times as much at the front axle as at the rear); and its damped "
            "frequency is ω(1−ζ), since the square in sqrt(1−ζ)^2 stands outside the root.",
            "Corrected: the mass where wdf puts it, and ω√(1−ζ²), from the generalised "
            "eigenproblem of M, C, K. Obtained: eigenvalues of the system in deflections.",
        ),
    )


def table_51(held: Mapping[str, float], deflection: Mapping[str, float]) -> Table:
    """Table 5.1, what a grey box finds again.

    Parameters
    ----------
    held, deflection : mapping of str to float
        k_g (in) and ratios found with held inputs in states, and in deflections.
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
        "Parameters put into a simulation, and found again",
        rows,
        (
            "Corrected is what was put in. Its way: the four states at 300 instants, inputs held "
            "between them as its idgrey does. Obtained: in deflections, accelerations in and out, "
            "a spline between samples. Neither has noise.",
            "Held inputs lag by half a sample, which the grey box takes for damping: both ratios "
            "come out high, as printed. They take the radius of gyration down with them, which "
            "is not printed; spacing and bump of the reference are not known, so this explains "
            "its ratios and not its 9.985 in.",
        ),
    )


def table_71() -> Table:
    """Table 7.1, the Baja car, what follows from other rows computed."""
    car = car_of_table_71()
    ours = quantities(car)
    right = {
        **TABLE_71,
        "m": 500.0 / 32.2 / 12.0,
        "k_g": math.sqrt(TABLE_71["i"] / TABLE_71["m"]),
        "i": TABLE_71["m"] * TABLE_71["k_g"] ** 2,
        "zeta_f": TABLE_71["c_f"] / (2.0 * math.sqrt(100.0 * TABLE_71["m"] * 0.47)),
        "zeta_r": TABLE_71["c_r"] / (2.0 * math.sqrt(100.0 * TABLE_71["m"] * 0.53)),
    }
    rows = tuple(
        Row(name, LABELS[name], UNITS[name][0], value, None, right[name], ours[name], "Table 7.1")
        for name, value in TABLE_71.items()
    )
    return Table(
        "7.1",
        "The 2008 Cal Poly SAE Baja car",
        rows,
        (
            "Corrected: mass from 500 lbf over 32.2 ft/s² (App. C.2); radius of gyration and "
            "inertia each from the other as printed; ratios c / (2 √(k m_axle)). All agree with "
            "what is printed to its digits, the ratios to one in the last.",
        ),
    )


def rows_of(tables: Sequence[Table]) -> int:
    """Count printed figures."""
    return sum(row.printed is not None for table in tables for row in table.rows)
