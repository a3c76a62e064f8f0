"""A test rig: a half car with tyres on a road, sensors on it, and the truth beside the data.

It shares no code with the package that it judges, and never imports it. What it does differently
on purpose: four degrees of freedom instead of two, absolute coordinates instead of deflections,
a Runge-Kutta integrator at its own rate instead of an exact discretisation, smooth functional
forms instead of the estimator's, filters applied on the internal grid.
"""

from __future__ import annotations

from .car import DECLARED_SDS, SPREADS, RigCar, Seat, baja, draw, table51, with_terms
from .files import vehicle_toml, write_csv, write_truth
from .forces import ChassisForce, Engine, ForceFunction, Push
from .laws import (
    AsymmetricDamper,
    BoucWen,
    Coulomb,
    CurveDamper,
    CurveSpring,
    CustomLaw,
    DigressiveDamper,
    FadingDamper,
    Lash,
    LinearDamper,
    LinearSpring,
    MaxwellMount,
    MountedCurve,
    PositionDamper,
    QuadraticDamper,
    SinhSpring,
    SmoothStop,
    Term,
)
from .motion import Motion, simulate
from .mounting import Bracket, Compressed, Mounting, OneSided, Panel, SensorTone
from .run import RigRun, drive
from .sensors import CHANNELS, Adc, SensorSpec, draw_biases
from .terrain import (
    DEFAULT_SPEEDS,
    TERRAINS,
    Haversine,
    Rollers,
    Rough,
    Sine,
    Stop,
    Terrain,
    bump,
    flat,
    parking_stops,
    rollers,
    rough_road,
)

__all__ = [
    "CHANNELS",
    "DECLARED_SDS",
    "DEFAULT_SPEEDS",
    "SPREADS",
    "TERRAINS",
    "Adc",
    "AsymmetricDamper",
    "BoucWen",
    "Bracket",
    "ChassisForce",
    "Compressed",
    "Coulomb",
    "CurveDamper",
    "CurveSpring",
    "CustomLaw",
    "DigressiveDamper",
    "Engine",
    "FadingDamper",
    "ForceFunction",
    "Haversine",
    "Lash",
    "LinearDamper",
    "LinearSpring",
    "MaxwellMount",
    "Motion",
    "MountedCurve",
    "Mounting",
    "OneSided",
    "Panel",
    "PositionDamper",
    "Push",
    "QuadraticDamper",
    "RigCar",
    "RigRun",
    "Rollers",
    "Rough",
    "Seat",
    "SensorSpec",
    "SensorTone",
    "Sine",
    "SinhSpring",
    "SmoothStop",
    "Stop",
    "Term",
    "Terrain",
    "baja",
    "bump",
    "draw",
    "draw_biases",
    "drive",
    "flat",
    "parking_stops",
    "rollers",
    "rough_road",
    "simulate",
    "table51",
    "vehicle_toml",
    "with_terms",
    "write_csv",
    "write_truth",
]
