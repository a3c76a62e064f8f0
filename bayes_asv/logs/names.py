"""What the name and the unit of a logged channel say about what it measures and where."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.units import si_factor

if TYPE_CHECKING:
    from bayes_asv.domain.channels import Axle, Part, Quantity, Side

__all__ = ["Meaning", "meaning", "quantity_of_unit", "stem"]

Letter = Literal["x", "y", "z"]

_CORNERS: Final[dict[str, tuple[Axle, Side]]] = {
    "fl": ("front", "left"), "lf": ("front", "left"),
    "fr": ("front", "right"), "rf": ("front", "right"),
    "rl": ("rear", "left"), "lr": ("rear", "left"), "bl": ("rear", "left"),
    "rr": ("rear", "right"), "br": ("rear", "right"),
}  # fmt: skip
_AXLES: Final[dict[str, Axle]] = {
    "front": "front", "fork": "front", "rear": "rear", "back": "rear",
    "hinten": "rear", "vorne": "front",
}  # fmt: skip
_SIDES: Final[dict[str, Side]] = {"left": "left", "right": "right", "links": "left"}
_WHEEL: Final = "wheel hub upright unsprung axle knuckle spindle tire tyre whl carrier"
_BODY: Final = "chassis body frame sprung cg cog imu floor hoop seat cockpit car vehicle phone"
_SUSPENSION: Final = """susp suspension damper shock travel pot potentiometer linpot lvdt fork
    deflection stroke displacement rocker strut"""
_PARTS: Final[dict[Part, frozenset[str]]] = {
    "wheel": frozenset(_WHEEL.split()),
    "body": frozenset(_BODY.split()),
    "suspension": frozenset(_SUSPENSION.split()),
}
_ACCELERATION: Final = frozenset({"acc", "accel", "acceleration", "accelerometer"})
_RATE: Final = frozenset({"gyro", "gyroscope", "rate", "omega", "angular", "rotation"})
_TURNS: Final = frozenset({"pitch", "roll", "yaw"})
_OTHER_WORDS: Final = """speed velocity temp temperature pressure press gps lat latitude lon
    longitude lateral long longitudinal lap time throttle rpm brake steer steering gear volt battery
    fuel oil water lambda heading altitude bearing satellites distance counter index mag
    magnetometer humidity angle height level combined total resultant magnitude"""
_OTHER: Final = frozenset(_OTHER_WORDS.split())
_LETTERS: Final[dict[str, Letter]] = {"x": "x", "y": "y", "z": "z"}
_VERTICAL: Final = frozenset({"vertical", "vert", "heave", "up"})


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a name says; None and False where it says nothing.

    Parameters
    ----------
    quantity, part, axle, side
        As those of a channel of the car.
    letter : {'x', 'y', 'z'} or None
        Axis of the sensor.
    turn : {'pitch', 'roll', 'yaw'} or None
        Rotation of the body.
    vertical : bool
        Whether it says that the axis is vertical.
    other : bool
        Whether it names something that no channel of the car is.
    words : tuple of str
        The words of the name that were understood.
    """

    quantity: Quantity | None
    part: Part | None
    axle: Axle | None
    side: Side | None
    letter: Letter | None
    turn: str | None
    vertical: bool
    other: bool
    words: tuple[str, ...]


def meaning(name: str, unit: str) -> Meaning:
    """Read the name and the unit of a channel.

    Parameters
    ----------
    name, unit : str
        As in the file.
    """
    words = _words(name)
    by_unit = quantity_of_unit(unit)
    axle, side = _place(words)
    parts = [part for part, known in _PARTS.items() if known & set(words)]
    turn = next((word for word in words if word in _TURNS), None)
    letter: Letter | None = None
    prefix = ""
    for word in words:
        if word in _LETTERS:
            letter = _LETTERS[word]
        elif re.fullmatch(r"(a|g|acc|accel|gyr|gyro)[xyz]", word):
            letter, prefix = _LETTERS[word[-1]], word[:-1]
    acceleration = bool(_ACCELERATION & set(words)) or prefix in ("a", "acc", "accel")
    rate = bool(_RATE & set(words)) or prefix in ("g", "gyr", "gyro")
    quantity: Quantity | None = by_unit
    if quantity is None and not unit.strip():
        if acceleration:
            quantity = "acceleration"
        elif rate or turn:
            quantity = "angular_rate"
    part: Part | None = parts[0] if len(parts) == 1 else None
    if quantity is None and part == "suspension" and not acceleration:
        quantity = "deflection"
    if quantity == "deflection" and part is None and axle is None:
        quantity = None  # a length: of a lap, of a level
    understood = [
        word
        for word in words
        if word in _CORNERS
        or word in _AXLES
        or word in _SIDES
        or word in _TURNS
        or word in _VERTICAL
        or any(word in known for known in _PARTS.values())
    ]
    return Meaning(
        quantity=quantity,
        part=part,
        axle=axle,
        side=side,
        letter=letter,
        turn=turn,
        vertical=bool(_VERTICAL & set(words)),
        other=bool(_OTHER & set(words)),
        words=tuple(understood),
    )


def quantity_of_unit(unit: str) -> Quantity | None:
    """Return the quantity that a unit measures: an acceleration, an angular rate or a length."""
    if not unit.strip() or unit.strip().lower() in ("hz", "v", "volt", "volts"):
        return None
    quantities: tuple[Quantity, ...] = ("acceleration", "angular_rate", "deflection")
    for quantity in quantities:
        try:
            si_factor(unit, quantity)
        except InputError:
            continue
        return quantity
    return None


def stem(name: str) -> str:
    """Return the name without the letter of its axis: the same for the axes of one sensor."""
    plain = re.sub(r"(?<![A-Za-z])[xyzXYZ](?![A-Za-z])", "", name)
    plain = re.sub(r"(?i)(?<![a-z])(a|g|acc|accel|gyr|gyro)[xyz](?![a-z])", r"\1", plain)
    return re.sub(r"[\s_:.-]+", " ", plain).strip().lower()


def _place(words: list[str]) -> tuple[Axle | None, Side | None]:
    axle: Axle | None = None
    side: Side | None = None
    for word in words:
        if word in _CORNERS:
            return _CORNERS[word]
        axle = axle or _AXLES.get(word)
        side = side or _SIDES.get(word)
    if axle is None:  # a letter counts only where no word says it
        axle = next((one for word, one in _LETTER_AXLES if word in words), None)
    return axle, side


_LETTER_AXLES: Final[tuple[tuple[str, Axle], ...]] = (("f", "front"), ("r", "rear"))


def _words(name: str) -> list[str]:
    """Split a name at blanks, signs, digits and the capitals of camelCase."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word.lower() for word in re.split(r"[^A-Za-z]+", apart) if word]
