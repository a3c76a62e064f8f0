"""Names of cases: fault, strength and terrain.

``[modifier+]kind[@where][-strength][/terrain][~family]``, such as ``null``, ``clutter``,
``bound_rebound-400``, ``coulomb_friction@rear-40/bump~baja``, ``outside``, ``damper_lash-4000``,
``pair-400``, ``noisier+null``, ``clutter+sensor_gain-4000``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from tests.battery.drives import TERRAIN_NAMES
from tests.battery.effects import EFFECTS, places
from tests.battery.unlisted_faults import UNLISTED_FAULTS

__all__ = ["MODIFIERS", "STRENGTHS", "Name", "parse"]

STRENGTHS: Final = (10.0, 40.0, 400.0, 4000.0)
MODIFIERS: Final = ("clutter", "noisier", "quieter")
_DEFAULT_STRENGTH: Final = 400.0
_SINGLE: Final = ("null", "lifting", "coarse", "clutter")
_FORM = re.compile(
    r"(?:(?P<modifier>\w+)\+)?(?P<kind>\w+)(?:@(?P<where>\w+))?(?:-(?P<strength>[\d.]+))?"
    r"(?:/(?P<terrain>\w+))?(?:~(?P<family>.+))?"
)


@dataclass(frozen=True)
class Name:
    """A parsed name.

    Parameters
    ----------
    kind : str
        ``null``, ``lifting`` (no fault, tyres that leave the ground), ``coarse`` (no fault, ten
        bits and the low noise of the 2008 car's data sheets), ``clutter`` (deviations within
        tolerance), ``single`` (any listed effect), ``outside`` (any unlisted fault), ``pair``, or
        the name of an effect or unlisted fault.
    where : str
        Place; drawn if empty.
    strength : float
        Intended noncentrality; 0 without a fault.
    modifier : str
        One of :data:`MODIFIERS`, or empty.
    terrain, family : str
        Taken in turn or drawn if empty.
    """

    kind: str
    where: str = ""
    strength: float = 0.0
    modifier: str = ""
    terrain: str = ""
    family: str = ""


def parse(name: str) -> Name:
    """Parse a name.

    Raises
    ------
    ValueError
        If it is invalid.
    """
    found = _FORM.fullmatch(name)
    if found is None:
        raise ValueError(f"'{name}' is not the name of a case")
    part = {key: value or "" for key, value in found.groupdict().items()}
    kind, where = part["kind"], part["where"]
    if kind not in (*_SINGLE, "single", "outside", "pair", *EFFECTS, *UNLISTED_FAULTS):
        raise ValueError(f"'{kind}' is not a known fault")
    if part["modifier"] not in ("", *MODIFIERS):
        raise ValueError(f"'{part['modifier']}' is none of {', '.join(MODIFIERS)}")
    if where and (kind not in EFFECTS or where not in places(kind)):
        raise ValueError(f"'{kind}' cannot be at '{where}'")
    if part["terrain"] not in ("", *TERRAIN_NAMES):
        raise ValueError(f"'{part['terrain']}' is none of {', '.join(TERRAIN_NAMES)}")
    strength = float(part["strength"]) if part["strength"] else _DEFAULT_STRENGTH
    if kind in _SINGLE:
        if part["strength"]:
            raise ValueError(f"'{kind}' has no strength")
        strength = 0.0
    return Name(kind, where, strength, part["modifier"], part["terrain"], part["family"])
