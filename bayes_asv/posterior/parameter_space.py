"""The coordinates of a vehicle and its recordings, with their priors."""

from __future__ import annotations

import math

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import Site
from bayes_asv.posterior.effects import car_scale
from bayes_asv.posterior.parameters import LOGS, SEEN, ParameterSpace
from bayes_asv.posterior.priors import (
    DAMPING_FACTOR,
    INERTIA_FACTOR,
    NOISE_GIVEN_SD,
    NOISE_UNKNOWN_SD,
    prior_log_sd,
)
from bayes_asv.preprocessing.input_bias import ZERO_SD, axles_with_travel
from bayes_asv.preprocessing.noise_level import noise_level
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["space"]

_NEAR_SD = 0.2  # of the logarithm of a noise level that is given, where it is kept near that
_NEAR_SHARE = 3.0  # probits: noise comes before a sensor's filter or behind, seldom half and half


def space(
    vehicle: Vehicle,
    timelines: tuple[PreparedRecording, ...],
    likelihood: str = "innovations",
    hold: frozenset[int] = frozenset(),
    sites: tuple[Site, ...] = (),
    near: bool = False,
) -> ParameterSpace:
    """Set up the coordinates for a vehicle and its recordings.

    Parameters
    ----------
    vehicle : Vehicle
        Gives nominal values, known values and their deviations.
    timelines : tuple of PreparedRecording
        The recordings, in order.
    likelihood : str
        ``innovations``, or ``output-error`` and ``coloured`` in which wheels have no noise.
    hold : frozenset of int
        Runs whose noise levels are held at the centre of their prior: under a colour they are
        but the shape of a filter, and the colour has the scale.
    sites : tuple of Site
        Effects that the car and its sensors have.
    near : bool
        Keep noise levels near what is given.

    Returns
    -------
    ParameterSpace
    """
    log_mean = np.array([math.log(getattr(vehicle, name).value) for name in LOGS])
    factors = {name: INERTIA_FACTOR if name == "i" else DAMPING_FACTOR for name in LOGS}
    log_sd = np.array([prior_log_sd(getattr(vehicle, n), f) for n, f in factors.items()])
    _, strength, turns = np.linalg.svd(SEEN * log_sd)
    rank = int(np.count_nonzero(strength > 1e-9 * strength[0]))
    directions = turns.T
    names = [f"car-{k}" for k in range(rank)]
    centre = [0.0] * rank
    scale = [1.0] * rank

    def add(name: str, middle: float, deviation: float) -> None:
        names.append(name)
        centre.append(middle)
        scale.append(deviation)

    if vehicle.wdf.sd > 0.0:
        add("wdf", vehicle.wdf.value, vehicle.wdf.sd)
    for c, channel in enumerate(CHANNELS):  # one sensor, one scale, whatever the run
        deviation = max((float(line.scale_sd[c]) for line in timelines), default=0.0)
        if deviation > 0.0:
            add(f"gain {channel}", 0.0, deviation)
    for site in sites:
        for parameter in site.effect.parameters:
            add(site.coordinate_name(parameter), 0.0, 1.0)
    held = []
    for run, line in enumerate(timelines):
        levels = np.zeros(4)
        for c, channel in enumerate(CHANNELS):
            if likelihood != "innovations" and channel.endswith("wheel"):
                continue
            noise = line.noise[c]
            levels[c] = noise_level(line, c) if noise is None else noise
            if run not in hold:
                deviation = NOISE_UNKNOWN_SD if noise is None else NOISE_GIVEN_SD
                if near and noise is not None:
                    deviation = _NEAR_SD
                add(f"noise {channel} {run}", math.log(levels[c]), deviation)
        held.append(levels)
        filtered = likelihood == "innovations" and np.any(line.poles > 0.0)
        if filtered and run not in hold:
            add(f"filtered share {run}", 0.0, _NEAR_SHARE if near else 1.0)
        for axle in axles_with_travel(sites):
            add(f"zero {axle} {run}", 0.0, ZERO_SD)
    return ParameterSpace(
        names=tuple(names),
        centre=np.array(centre),
        scale=np.array(scale),
        log_mean=log_mean,
        log_sd=log_sd,
        seen=directions[:, :rank],
        unseen=directions[:, rank:],
        wdf=vehicle.wdf.value,
        timelines=timelines,
        likelihood=likelihood,
        held=tuple(held),
        sites=sites,
        sizes=car_scale(vehicle) if sites else None,
        near=near,
    )
