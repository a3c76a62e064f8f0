"""Simulated recordings from a road and a vehicle."""

__all__ = ["ROADS"]

ROADS = (
    "bump",
    "stops",
    "rough",
    "rollers",
    "noise",
)  # here, because the command line lists them without importing numpy
