"""Dimension and display name of every parameter, estimated or given."""

from __future__ import annotations

__all__ = ["QUANTITIES"]

QUANTITIES = {
    # name: (dimension, display name)
    "c_f": ("damping", "front damping rate"),
    "c_r": ("damping", "rear damping rate"),
    "i": ("pitch_inertia", "pitch inertia"),
    "k_g": ("length", "radius of gyration"),
    "zeta_f": ("dimensionless", "front damping ratio"),
    "zeta_r": ("dimensionless", "rear damping ratio"),
    "m": ("mass", "sprung mass"),
    "l": ("length", "wheelbase"),
    "wdf": ("dimensionless", "front weight fraction"),
    "k_f": ("stiffness", "front spring rate"),
    "k_r": ("stiffness", "rear spring rate"),
    "c_fl": ("damping", "front left damping rate"),
    "c_fr": ("damping", "front right damping rate"),
    "c_rl": ("damping", "rear left damping rate"),
    "c_rr": ("damping", "rear right damping rate"),
    "i_roll": ("pitch_inertia", "roll inertia"),
}
