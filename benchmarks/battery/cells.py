"""Cells of the battery: each is one kind of case, with many cars, drives and noises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tests.battery.effects import EFFECTS
from tests.battery.names import STRENGTHS
from tests.battery.unlisted_faults import UNLISTED_FAULTS

__all__ = ["CELLS", "GROUPS", "Cell", "Group", "in_turn"]


@dataclass(frozen=True)
class Group:
    """Cells that are counted together.

    Parameters
    ----------
    key : str
        On the command line.
    title : str
        In the page.
    """

    key: str
    title: str


@dataclass(frozen=True)
class Cell:
    """One kind of case.

    Parameters
    ----------
    group : Group
        What it is counted with.
    name : str
        As :func:`tests.battery.cases.case` takes it.
    runs : int
        Cases of the full battery.
    """

    group: Group
    name: str
    runs: int


NULL: Final = Group("null", "No fault")
LIFTING: Final = Group("lifting", "No fault, tyres that leave the ground")
COARSE: Final = Group("coarse", "No fault, 10-bit converter and half the usual noise")
MISSTATED: Final = Group("misstated", "No fault, noise 20 % off its declared value")
CLUTTER: Final = Group("clutter", "Deviations within tolerance")
SINGLE: Final = Group("single", "One listed effect")
IN_CLUTTER: Final = Group("in-clutter", "One listed effect and deviations within tolerance")
MISSTATED_SINGLE: Final = Group(
    "misstated-single", "One listed effect, noise 20 % off its declared value"
)
PAIR: Final = Group("pair", "Two listed effects")
OUTSIDE_LIST: Final = Group("outside", "A fault outside the list")
GROUPS: Final = (
    NULL, LIFTING, COARSE, MISSTATED, CLUTTER, SINGLE, IN_CLUTTER, MISSTATED_SINGLE, PAIR,
    OUTSIDE_LIST,
)  # fmt: skip


# A given value costs its deviations squared: a spring 2.5 times as stiff as it was given within
# 5 % is worth some 300, a weight split a quarter off some 600.
_OUT_OF_REACH: Final = {("spring_rate", 4000.0), ("weight_distribution", 4000.0)}


def _cells() -> tuple[Cell, ...]:
    out = [
        Cell(NULL, "null", 200),
        Cell(LIFTING, "lifting", 40),
        Cell(COARSE, "coarse", 40),
        Cell(MISSTATED, "noisier+null", 40),
        Cell(MISSTATED, "quieter+null", 40),
        Cell(CLUTTER, "clutter", 100),
    ]
    out += [
        Cell(SINGLE, f"{name}-{strength:g}", 8)
        for strength in STRENGTHS
        for name in EFFECTS
        if (name, strength) not in _OUT_OF_REACH
    ]
    out += [Cell(IN_CLUTTER, f"clutter+single-{strength:g}", 40) for strength in (400.0, 4000.0)]
    out += [Cell(MISSTATED_SINGLE, f"{how}+single-400", 30) for how in ("noisier", "quieter")]
    out += [Cell(PAIR, f"pair-{strength:g}", 40) for strength in (40.0, 400.0, 4000.0)]
    out += [
        Cell(OUTSIDE_LIST, f"{name}-{strength:g}", 5)
        for strength in (400.0, 4000.0)
        for name in UNLISTED_FAULTS
    ]
    return tuple(out)


CELLS: Final = _cells()


def in_turn(cells: Sequence[Cell], runs: int | None = None) -> list[tuple[str, int]]:
    """Names and numbers of the cases of some cells, in the order in which they are done.

    Every cell is about as far as the others at any time, so that a battery that is stopped
    half-way has asked half of everything.

    Parameters
    ----------
    cells : sequence of Cell
        Which.
    runs : int, optional
        Cases a cell, in place of each cell's own number.
    """
    waiting = []
    for place, cell in enumerate(cells):
        number = cell.runs if runs is None else runs
        waiting += [((k + 0.5) / number, place, cell.name, k) for k in range(number)]
    return [(name, k) for _, _, name, k in sorted(waiting)]
