"""Recordings whose wheels carry next to no noise, to work signatures out on.

The filter takes a wheel's noise for independent of its reading.  Where the road gives nothing, the
reading *is* the noise: a derivative along it then goes with the innovations, which the same noise
drives (errors in variables; Carroll et al. 2006, *Measurement Error in Nonlinear Models*, ch. 4).
Estimates hardly notice, but the small part of a signature that the car cannot imitate does.  So
the wheels lose what the chassis show to be noise, and then whatever does not stand above a sensor's
noise; the chassis readings change by what the car makes of that, so that the innovations stay what
they were (exactly for a linear car, to first order with a law in it), and what a filter makes of
earlier ones knows nothing of later ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.inference.likelihood import Target, shared_work
from bayes_asv.inference.quiet import calm
from bayes_asv.inference.scoring import Slopes, slopes
from bayes_asv.inference.stage import Setting, Stage, foretold
from bayes_asv.inference.timeline import Timeline

__all__ = ["Quiet", "clear"]

_SETTLING = 0.2
"""Seconds in which a filter finds motion and biases.

Meanwhile a law with a kink is drawn as a line through all the speeds that the car may have: on 60
recordings without a fault the score of dry friction had a mean of 0.9, all of it from this time.
"""


@dataclass(frozen=True)
class Quiet:
    """A stage on quiet wheels.

    Parameters
    ----------
    stage : Stage
        The stage, on the recordings as they are.
    where : Setting
        The recordings with quiet wheels; patterns stand on what the stage foretells from these.
    target : Target
        The stage's posterior there.
    settled : (N,) bool array
        Innovations that come when the filter has found the motion.
    slopes : Slopes
        The innovations as they are, and their changes along the stage's coordinates, those of the
        predictions on quiet wheels; zero where nothing is settled.
    """

    stage: Stage
    where: Setting
    target: Target
    settled: NDArray[np.bool_]
    slopes: Slopes


def clear(where: Setting, stage: Stage) -> Quiet:
    """Put a stage on quiet wheels, its innovations being what they were."""
    lines = tuple(_quiet(where, stage, run) for run in range(len(where.lines)))
    quiet = replace(where, lines=lines)
    quiet = foretold(quiet, replace(stage, target=quiet.target(stage.sites)))
    target, late = quiet.target(stage.sites), _settled(stage)
    with shared_work(target) as shared:
        means = slopes(shared, stage.mode.z).means
    here = stage.mode.slopes
    return Quiet(
        stage, quiet, target, late, replace(here, means=means * late, scales=here.scales * late)
    )


def _settled(stage: Stage) -> NDArray[np.bool_]:
    parts = []
    for run, line in enumerate(stage.space.timelines):
        _, logs, _ = stage.target.scored(stage.mode.z, run)
        late = line.instants > line.instants[0] + _SETTLING
        parts.append(np.broadcast_to(late[:, None], logs.shape)[logs != 0.0])
    return np.concatenate(parts)


def _quiet(where: Setting, stage: Stage, run: int) -> Timeline:
    still, before, after = calm(stage.target, stage.mode.z, run, where.vehicle)
    return replace(still, reading=still.reading + after - before)
