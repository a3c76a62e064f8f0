"""Names and records that all modules share.

Units are SI throughout: m, s, kg, N. Upward acceleration, nose-up pitch and extension of the
suspension are positive.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AXLES",
    "CHANNELS",
    "Complexes",
    "Drawn",
    "Fault",
    "Run",
    "Span",
    "Truth",
    "UnreachableError",
    "Vector",
    "Whole",
    "rows_of",
]

Vector = NDArray[np.floating[Any]]
Complexes = NDArray[np.complexfloating[Any, Any]]
Whole = NDArray[np.int64]
Span = tuple[float, float]

AXLES = ("front", "rear")
CHANNELS = ("front_wheel", "front_chassis", "rear_wheel", "rear_chassis")


class UnreachableError(Exception):
    """A scene in which what is wanted cannot be shown; another one is drawn."""


def rows_of(where: str) -> slice:
    """Rows of an array of axles (front, rear) that belong to a place."""
    return {"front": slice(0, 1), "rear": slice(1, 2), "both": slice(0, 2)}[where]


@dataclass(frozen=True)
class Run:
    """One recording: times of the rows, s, and the readings of each channel, m/s²."""

    time: Vector
    channels: dict[str, Vector]


@dataclass(frozen=True)
class Fault:
    """What a correct diagnosis reports: name, place, and spans of right values by parameter.

    Parameters have the units of the page of effects. The name of a fault that the page does not
    list begins with ``unlisted:``.
    """

    name: str
    where: str | None
    parameters: dict[str, Span] = field(default_factory=dict)


@dataclass(frozen=True)
class Truth:
    """What is true of a case: spans (low, high) in SI (N·s/m, N·s/m, kg·m²), and its faults.

    ``noise_factor`` is true over declared noise; ``strength`` the squared whitened distance that
    a linear car leaves because of the faults; ``form`` the mathematical form of the faults and
    ``strength_alone`` what each fault alone would leave.
    """

    cell: str
    number: int
    family: str
    road: str
    faults: tuple[Fault, ...]
    c_f: Span
    c_r: Span
    i: Span
    noise_factor: float
    strength: float
    form: str = ""
    strength_alone: tuple[float, ...] = ()
    held_out_road: str = ""


@dataclass(frozen=True)
class Drawn:
    """A case: recordings to fit, recordings held out, the declared vehicle, and the truth."""

    runs: tuple[Run, ...]
    held_out: tuple[Run, ...]
    vehicle_toml: str
    truth: Truth
