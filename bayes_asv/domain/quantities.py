"""Dimension and display name of every parameter, estimated or given, and how wide 95 % is."""

from __future__ import annotations

__all__ = ["NORMAL_975", "QUANTITIES"]

NORMAL_975 = 1.959963984540054
"""Quantile of the standard normal distribution; a 95 % interval extends so many deviations."""

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
    "k_fl": ("stiffness", "front left spring rate"),
    "k_fr": ("stiffness", "front right spring rate"),
    "k_rl": ("stiffness", "rear left spring rate"),
    "k_rr": ("stiffness", "rear right spring rate"),
    "t_f": ("length", "front track"),
    "t_r": ("length", "rear track"),
    "s_f": ("length", "distance between the front sensors"),
    "bar_f": ("stiffness", "front anti-roll bar rate"),
    "bar_r": ("stiffness", "rear anti-roll bar rate"),
    "split_f": ("dimensionless", "difference between the front springs"),
    "split_r": ("dimensionless", "difference between the rear springs"),
}
