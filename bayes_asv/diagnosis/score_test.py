"""What every candidate would do to the innovations, and how strongly the data ask for it.

The signature of a candidate is how its values change the predictions, in deviations, as seen
through the filter as it stands (:mod:`.steady`).  The part that the model can imitate by what it
estimates anyway is taken out in the posterior metric, so that a given value that is tightly known
imitates little.
Innovations are martingale differences and signatures depend on their past alone: under the model a
normalised score is standard normal to first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import DenoisedModel
from bayes_asv.diagnosis.nuisance_projection import imitation
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.filters.kalman import VALUE
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, carried
from bayes_asv.posterior.likelihood import shared_work
from bayes_asv.preprocessing.quantization import wandering

__all__ = ["SILENT", "ScoreTest", "signatures"]

Array = NDArray[np.float64]

SILENT = 1e-6
"""Share of a signature that the model cannot imitate, below which it is silent."""


@dataclass(frozen=True)
class ScoreTest:
    """Signatures of K candidates in the N innovations of a stage.

    Parameters
    ----------
    candidates : tuple of Candidate
        Whose they are.
    rows : (K, N) array
        Changes of the predictions, in deviations.
    pull : (K,) array
        Signature times innovations: the slope of the log-likelihood.
    gram : (K, K) array
        Signatures times signatures, what the model can imitate left out.
    slopes : ScoreAndInformation
        The innovations, and their changes along the model's own coordinates on the same quiet
        inputs.
    feigned : (G, N) array
        Signatures of what coarse converters may feign, standard normal, which is left out too.
    """

    candidates: tuple[Candidate, ...]
    rows: Array
    pull: Array
    gram: Array
    slopes: ScoreAndInformation
    feigned: Array

    @property
    def sites(self) -> int:
        """How many places of effects there are, the same one in several runs counted once."""
        return len({str(c.site) for c in self.candidates})

    @property
    def score(self) -> Array:
        """Scores (K,), each standard normal when nothing is missing; 0 where data are silent."""
        own = np.diag(self.gram)
        return np.where(own > 1e-8, self.pull / np.sqrt(np.maximum(own, 1e-8)), 0.0)


def signatures(quiet: DenoisedModel, wanted: list[Candidate]) -> ScoreTest:
    """Work out the signatures of candidates at a stage's mode."""
    stage, where = quiet.stage, quiet.where
    z = stage.mode.z

    def one(candidate: Candidate) -> Array:
        target = where.target((*stage.sites, candidate.site))
        there = carried(stage.space, z, target.space, candidate.site, candidate.values)
        changed = {}
        for run, here in enumerate(quiet.stands):
            if candidate.site.run not in (None, run):
                continue
            if candidate.edge:  # a force that is added leaves the filter as it is: one pass
                changed[run] = (here.nu - target.scored(there, run)[0])[here.there]
            else:
                changed[run] = here.row(target, there)
        row = quiet.joined(changed)
        # a law whose simulation runs away has nothing to say
        return row if np.all(np.isfinite(row)) else np.zeros_like(row)

    with shared_work(stage.target) as shared:
        assert shared.pool is not None
        rows = np.array(list(shared.pool.map(one, wanted))).reshape(len(wanted), -1)
    feigned = _feigned(where, stage, wanted, rows)
    pull, gram = imitation(quiet.slopes, z, feigned).beyond(rows)
    return ScoreTest(tuple(wanted), rows, pull, gram, quiet.slopes, feigned)


def _feigned(where: Dataset, stage: FittedModel, wanted: list[Candidate], rows: Array) -> Array:
    """Rows (G, N) of zeros that wander because converters are coarse, run by run.

    Of an axle the chassis channel stands for both: a wheel's drift is its chassis' drift.
    """
    out = []
    for wheel, chassis in ((0, 1), (2, 3)):
        channel = CHANNELS[chassis]
        at = [k for k, c in enumerate(wanted) if str(c.site) == f"sensor_drift@{channel}"]
        if not at:
            continue
        begin = 0
        for run, line in enumerate(where.lines):
            slope = float(np.hypot(wandering(line, chassis), wandering(line, wheel)))
            end = begin + _count(stage, run)
            if slope > 0.0:
                row = np.zeros(rows.shape[1])
                row[begin:end] = rows[at[0], begin:end] * slope / wanted[at[0]].values["slope"]
                out.append(row)
            begin = end
    return np.array(out).reshape(len(out), rows.shape[1])


def _count(stage: FittedModel, run: int) -> int:
    line = stage.space.timelines[run]
    return int(np.count_nonzero(line.kind == VALUE))
