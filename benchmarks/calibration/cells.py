"""What is driven: one cell is one kind of drive, repeated with everything random drawn anew."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

__all__ = [
    "CELLS",
    "DECLARED_400",
    "DECLARED_800",
    "EXACT_400",
    "EXACT_800",
    "GROUPS",
    "MODEL",
    "NAMES",
    "TERRAIN_NAMES",
    "Cell",
    "Group",
]

TERRAIN_NAMES: Final = ("bump", "stops", "rough", "rollers")
NAMES: Final = ("c_f", "c_r", "i", "k_g")
"""Quantities whose coverage is judged."""

MODEL: Final = "mixed"
"""Terrain of the cells that draw recordings from the model: each terrain in turn."""

Rule = Literal["nominal", "at least 90 %", "none"]


@dataclass(frozen=True)
class Group:
    """Cells that differ in their terrain alone.

    Parameters
    ----------
    key : str
        First part of its cells' names.
    title : str
        Heading in the page.
    rule : {'nominal', 'at least 90 %', 'none'}
        What is asked of its cells: nominal coverage (stops: at least 92 % at 95 %), at least
        90 % at 95 %, or nothing.
    """

    key: str
    title: str
    rule: Rule = "none"


@dataclass(frozen=True)
class Cell:
    """One kind of drive.

    Parameters
    ----------
    group : Group
        What it belongs to.
    terrain : str
        Of the rig, or :data:`MODEL` to draw recordings from the estimator's own model.
    rate : float
        Rows a second.
    runs : int
        How many drives make the full bench.
    checked : int
        How many of them are also sampled by the product's own ensembles.
    exact : bool
        Known values are exact, and so are they given; otherwise they are drawn from the declared
        deviations.
    noise : float
        Factor on the noise of all sensors, true and declared.
    misstated : float
        True noise over what the vehicle file says.
    white : bool
        Sensor noise independent from sample to sample; otherwise it passed the sensor's filter.
    engine : bool
        An engine of 25 to 45 Hz and 120 N shakes the frame.
    uneven : bool
        Rows at uneven times (0.3 ms rms, stamps tell), and 5 % of them lost, two at a time.
    clocks : bool
        Front and rear board have clocks of their own, declared in the recording.
    clipped : bool
        Sensors' ranges lowered, drive by drive, until up to five samples lie beyond either end;
        the ranges are declared.
    seconds : float
        Length of a recording.
    """

    group: Group
    terrain: str
    rate: float = 400.0
    runs: int = 60
    checked: int = 2
    exact: bool = False
    noise: float = 1.0
    misstated: float = 1.0
    white: bool = False
    engine: bool = False
    uneven: bool = False
    clocks: bool = False
    clipped: bool = False
    seconds: float = 2.0

    @property
    def name(self) -> str:
        """Name on the command line and in the results."""
        return f"{self.group.key}-{self.terrain}"

    def random(self, seed: int, run: int) -> np.random.Generator:
        """Return the stream of one run; it depends on nothing but seed, name and number."""
        return np.random.default_rng([seed, zlib.crc32(self.name.encode()), run])


DECLARED_400: Final = Group("declared-400", "Given values with declared errors, 400 Hz", "nominal")
DECLARED_800: Final = Group("declared-800", "Given values with declared errors, 800 Hz", "nominal")
EXACT_400: Final = Group("exact-400", "Given values exact, 400 Hz", "nominal")
EXACT_800: Final = Group("exact-800", "Given values exact, 800 Hz", "nominal")


def _cells() -> tuple[Cell, ...]:
    out = [
        Cell(group, terrain, rate=rate, runs=1000, checked=10)
        for group, rate in ((DECLARED_400, 400.0), (DECLARED_800, 800.0))
        for terrain in TERRAIN_NAMES
    ]

    def add(key: str, title: str, rule: Rule = "none", **what: float | bool) -> None:
        group = Group(key, title, rule)
        runs = 60 if rule == "none" else 200
        out.extend(Cell(group, t, runs=runs, **what) for t in TERRAIN_NAMES)  # type: ignore[arg-type]

    for rate in (200, 100):
        add(f"declared-{rate}", f"Given values with declared errors, {rate} Hz", rate=rate)
    for group, hertz in ((EXACT_400, 400.0), (EXACT_800, 800.0)):
        out += [Cell(group, t, rate=hertz, runs=100, exact=True) for t in TERRAIN_NAMES]
    add("half-noise", "Half the usual noise, declared", noise=0.5)
    add("double-noise", "Twice the usual noise, declared", noise=2.0)
    honest: Rule = "at least 90 %"
    add("less-noise", "Noise 0.8 times the declared value", honest, misstated=0.8)
    add("more-noise", "Noise 1.2 times the declared value", honest, misstated=1.2)
    for rate in (400, 800):
        add(f"white-{rate}", f"White sensor noise, {rate} Hz", honest, rate=rate, white=True)
    add("engine", "Engine on the frame", honest, engine=True)
    add("uneven", "Uneven time stamps and lost rows", uneven=True)
    add("clocks", "Two boards with separate clocks", clocks=True)
    add("clipped", "A few clipped samples", clipped=True)
    out.append(Cell(Group("model", "Draws from the model"), MODEL, runs=1000, checked=20))
    return tuple(out)


CELLS: Final = _cells()
GROUPS: Final = tuple(dict.fromkeys(cell.group for cell in CELLS))
