"""Recordings whose wheels carry next to no noise, to work signatures out on.

The filter takes a wheel's noise for independent of its reading.  Where the road gives nothing, the
reading *is* the noise: a derivative along it then goes with the innovations, which the same noise
drives (errors in variables; Carroll et al. 2006, *Measurement Error in Nonlinear Models*, ch. 4).
Estimates hardly notice, but the small part of a signature that the car cannot imitate does, when
car and signature are not worked out on the same, quiet inputs.
"""

from __future__ import annotations

from dataclasses import replace

from scipy.interpolate import CubicSpline

from bayes_asv.channels import CHANNELS
from bayes_asv.inference.denoised import clear_wheel
from bayes_asv.inference.stage import Setting, Stage, foretold
from bayes_asv.inference.timeline import Timeline
from bayes_asv.inference.wheels import WheelSignal, moments
from bayes_asv.kernels.innovations import ORDER

__all__ = ["clear"]


def clear(where: Setting, stage: Stage) -> Setting:
    """Return the setting with wheels passed where their spectra stand above the noise.

    Patterns stand on what the stage foretells from such wheels.
    """
    quiet = replace(where, lines=tuple(_quiet(where, line) for line in where.lines))
    target = quiet.target(stage.sites)
    return foretold(quiet, replace(stage, target=target))


def _quiet(where: Setting, line: Timeline) -> Timeline:
    driven = line.moments.copy()
    for axle, wheel in enumerate(line.wheels):
        corner = where.vehicle.sensor(CHANNELS[2 * axle]).bandwidth
        knots, signal = clear_wheel(line, axle, corner)
        quiet = WheelSignal(CubicSpline(knots, signal), knots, wheel.deviation)
        driven[:, axle] = moments(quiet, line.instants, ORDER)
    return replace(line, moments=driven)
