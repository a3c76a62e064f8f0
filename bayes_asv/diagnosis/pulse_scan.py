"""A force of free course in time at an axle: short pushes that follow each other through every run.

It is a model that has no name and explains much.  Its amplitude is integrated out over a few sizes,
so that the number of its pulses costs what it should.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_asv.diagnosis.denoised_model import DenoisedModel
from bayes_asv.diagnosis.nuisance_projection import NuisanceProjection
from bayes_asv.filters.force_laws import OUTSIDE, excess_many
from bayes_asv.models.effects import AXLES
from bayes_asv.posterior.likelihood import Perturbation, shared_work
from bayes_asv.posterior.parameters import car_scale

__all__ = ["free_course", "pulses"]

Array = NDArray[np.float64]

_PULSE = 0.04  # s between two pulses
_PUSH = 0.01  # of the axle's load
_SIZES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])


def free_course(quiet: DenoisedModel, known: NuisanceProjection) -> tuple[float, str]:
    """Nats by which a force of free course wins over none, and the axle at which it wins most.

    Parameters
    ----------
    quiet : DenoisedModel
        A model at its mode.
    known : NuisanceProjection
        What it can imitate.
    """
    wins = {axle: _wins(*known.beyond(pulses(quiet, k))) for k, axle in enumerate(AXLES)}
    axle = max(wins, key=lambda name: wins[name])
    return wins[axle], axle


def pulses(quiet: DenoisedModel, axle: int) -> Array:
    """Signatures (K, N) of short pushes at one axle that follow each other through every run.

    A push rises over as long as it lasts, so that all together are one steady force.

    Each is added to what the model has already, a named push in the same run among that.
    """
    size = _PUSH * car_scale(quiet.where.vehicle).load
    runs = [(run, line.elapsed) for run, line in enumerate(quiet.where.lines)]
    starts = [(run, t) for run, time in runs for t in np.arange(time[0], time[-1], _PULSE)]

    def one(at: tuple[int, float]) -> Array:
        run, start = at
        line = quiet.where.lines[run]
        nothing = np.zeros_like(line.reading)
        force = nothing.copy()
        pulse = np.array([[axle, OUTSIDE, size, start, _PULSE, _PULSE]])
        still = np.zeros(len(nothing))
        time = line.elapsed
        force[:, axle] = excess_many(pulse, axle, 0.0, 0.0, still, still, time, time[-1])[:, 0]
        nudge = Perturbation(np.zeros_like(line.moments), nothing, force)
        return quiet.joined({run: quiet.stands[run].nudged(nudge)})

    with shared_work(quiet.stage.target) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(one, starts)))


def _wins(pull: Array, gram: Array) -> float:
    """Log Bayes factor of a slack model against none, averaged over its sizes."""
    if not np.all(np.isfinite(gram)):  # a push that makes the model run away explains nothing
        return -math.inf
    eigen, vectors = np.linalg.eigh(gram)
    eigen = np.maximum(eigen, 0.0)
    turned = (vectors.T @ pull) ** 2
    gains = [
        0.5 * float(np.sum(turned * s**2 / (1.0 + s**2 * eigen) - np.log1p(s**2 * eigen)))
        for s in _SIZES
    ]
    return float(logsumexp(gains) - math.log(len(gains)))
