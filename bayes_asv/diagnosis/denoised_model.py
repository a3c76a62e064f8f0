"""Recordings whose wheels carry next to no noise, to weigh what is missing on.

The filter takes a wheel's noise for independent of its reading.  Where the road gives nothing, the
reading *is* the noise: a derivative along it then goes with the innovations, which the same noise
drives (errors in variables; Carroll et al. 2006, *Measurement Error in Nonlinear Models*, ch. 4).
Estimates of most cars hardly notice, but the small part of a signature that the car cannot imitate
does, and whatever lives where the road gives next to nothing: friction of 2.4 N, worth 27 nats on
quiet wheels, brought 4 on the readings.  So the wheels lose what the chassis show to be noise, and
then whatever does not stand above a sensor's noise; the chassis readings change by what the car
makes of that, so that the innovations stay what they were (exactly for a linear car, to first order
with a law in it), and what a filter makes of earlier ones knows nothing of later ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.fixed_gain_sensitivity import FixedGainFilter, along, steady
from bayes_asv.filters.kalman import MISSING
from bayes_asv.posterior.denoised_inputs import calm
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fitted, foretold
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["DenoisedModel", "clear", "on_quiet_wheels", "quieted"]

_SETTLING = 0.2
"""Seconds in which a filter finds motion and biases.

Meanwhile a law with a kink is drawn as a line through all the speeds that the car may have: on 60
recordings without a fault the score of dry friction had a mean of 0.9, all of it from this time.
"""


@dataclass(frozen=True)
class DenoisedModel:
    """A stage on quiet wheels.

    Parameters
    ----------
    stage : FittedModel
        The stage, at its mode there.
    where : Dataset
        The recordings with quiet wheels, and the stage's patterns.
    stands : tuple of FixedGainFilter
        Its filter as it stands on each run, nothing granted to it.
    settled : (N,) bool array
        Innovations that come when the filter has found the motion.
    slopes : ScoreAndInformation
        The innovations, and their changes along the stage's coordinates, of the car by the filter
        as it stands; those are zero where nothing is settled.
    """

    stage: FittedModel
    where: Dataset
    stands: tuple[FixedGainFilter, ...]
    settled: NDArray[np.bool_]
    slopes: ScoreAndInformation

    def joined(self, rows: Mapping[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Join changes of some runs' innovations to a row (N,); other runs do not change.

        Parameters
        ----------
        rows : mapping of int to (M,) array
            By the run, each in deviations.
        """
        parts = [
            rows[run] if run in rows else np.zeros(np.count_nonzero(here.there))
            for run, here in enumerate(self.stands)
        ]
        return np.asarray(np.concatenate(parts) * self.settled)


def quieted(where: Dataset, stage: FittedModel) -> Dataset:
    """Return recordings with quiet wheels, above which a stage's innovations are what they were."""
    lines = tuple(_quiet(where, stage, run) for run in range(len(where.lines)))
    quiet = replace(where, lines=lines, quiet=True)
    return foretold(quiet, replace(stage, target=quiet.target(stage.sites)))


def on_quiet_wheels(where: Dataset, stage: FittedModel) -> tuple[Dataset, FittedModel]:
    """Quieten a stage's wheels, and find its mode there.

    Evidence is comparable among models on the same recordings: quiet wheels follow from the
    stage that quietened them.
    """
    quiet = quieted(where, stage)
    return quiet, fitted(quiet.target(stage.sites), stage.mode.z)


def clear(where: Dataset, stage: FittedModel) -> DenoisedModel:
    """Say what a stage that was fitted on quiet wheels sees.

    Parameters
    ----------
    where : Dataset
        With quiet wheels.
    stage : FittedModel
        At its mode there.
    """
    where = replace(where, patterns=stage.target.patterns)
    target, z, first = where.target(stage.sites), stage.mode.z, stage.space.lasting_dimension
    stands = tuple(steady(target, z, run) for run in range(len(where.lines)))
    late, here = np.concatenate([_settled(one) for one in stands]), stage.mode.slopes
    means, scales = here.means.copy(), here.scales.copy()
    means[:first], scales[:first] = along(stands, first), 0.0
    known = replace(here, means=means * late, scales=scales * late)
    return DenoisedModel(stage, where, stands, late, known)


def _settled(one: FixedGainFilter) -> NDArray[np.bool_]:
    line = one.target.space.timelines[one.run]
    heard = np.any(line.kind != MISSING, axis=1)
    late = line.instants > line.instants[heard][0] + _SETTLING
    return np.broadcast_to(late[:, None], one.there.shape)[one.there]


def _quiet(where: Dataset, stage: FittedModel, run: int) -> PreparedRecording:
    still, before, after = calm(stage.target, stage.mode.z, run, where.vehicle)
    return replace(still, reading=still.reading + after - before)
