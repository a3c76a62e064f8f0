"""Recordings made from a road and a vehicle: for planning, teaching and trying things out."""

__all__ = ["ROADS"]

ROADS = ("bump", "stops", "rough", "rollers", "noise")  # here, so that help needs no numpy
