"""Numbers by which the compiled kernel tells suspension terms apart.

They stand in a file of their own because both the readable terms (:mod:`.laws`) and the
kernel need them, and neither should import the other.
"""

from __future__ import annotations

from typing import Final

SPRING: Final = 0
DAMPER: Final = 1
ASYMMETRIC: Final = 2
DIGRESSIVE: Final = 3
COULOMB: Final = 4
SINH_SPRING: Final = 5
STOP: Final = 6
FADE: Final = 7
CURVE_RATE: Final = 8
CURVE_TRAVEL: Final = 9
POSITION_DAMPER: Final = 10
QUADRATIC: Final = 11
MAXWELL: Final = 12
BOUC_WEN: Final = 13
CUSTOM: Final = 14
LASH: Final = 15
MOUNTED_CURVE: Final = 16
