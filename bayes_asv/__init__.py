"""Bayesian estimation of vehicle suspension parameters from four accelerometers."""

__version__ = "0.1.0"
