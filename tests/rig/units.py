"""Exact factors between the reference's units and SI; the rig keeps its own table."""

from __future__ import annotations

from typing import Final

__all__ = [
    "INCH",
    "LBF",
    "LBF_PER_INCH",
    "LBF_S2_INCH",
    "LBF_S2_PER_INCH",
    "MPH",
    "STANDARD_GRAVITY",
]

INCH: Final = 0.0254  # m
STANDARD_GRAVITY: Final = 9.80665  # m/s^2
LBF: Final = 0.45359237 * STANDARD_GRAVITY  # N
LBF_PER_INCH: Final = LBF / INCH  # N/m; also lbf s/in in N s/m
LBF_S2_PER_INCH: Final = LBF / INCH  # kg
LBF_S2_INCH: Final = LBF * INCH  # kg m^2
MPH: Final = 1609.344 / 3600.0  # m/s
