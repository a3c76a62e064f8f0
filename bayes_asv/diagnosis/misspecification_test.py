"""Whether something is left that no effect in the list explains.

A force of free course in time has no name.  When it beats the named model clearly, or a decoy does,
or the innovations remember their past, or noise had to swell, what was named is not all there is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bayes_asv.diagnosis.denoised_model import clear
from bayes_asv.diagnosis.max_score_test import largest
from bayes_asv.diagnosis.nuisance_projection import imitation
from bayes_asv.diagnosis.pulse_scan import free_course
from bayes_asv.diagnosis.thresholds import AS_WELL, ENOUGH, NOTICED
from bayes_asv.diagnosis.timing_jitter_test import jitter
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence
from bayes_asv.diagnosis.unlisted_faults_test import unlisted
from bayes_asv.diagnosis.whiteness_test import memory
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = ["Unexplained", "unexplained"]

Array = NDArray[np.float64]

_SWOLLEN = 1.38  # times the given level


@dataclass(frozen=True)
class Unexplained:
    """What is left after naming.

    Parameters
    ----------
    score : float
        Nats by which the best slack model wins; negative when it does not.
    axle : str
        Where the slack force acts that wins most.
    p_memory : float
        p-value of innovations without memory.
    swollen : tuple of str
        Channels whose noise had to swell.
    p_decoy : float
        Family-wise p-value of the decoys.
    like : str
        What the leading decoy is.
    failed : tuple of str
        Effects that were fitted and made things worse on what was held out.
    rival : float
        Nats by which a decoy alone explains the recordings better than what was named; negative
        when it does worse.
    p_jitter : float
        p-value of innovations that are no louder where signals are steep.
    jitters : str
        The channel whose slope makes them louder.
    ended : str
        What explained more than any name of the list, so that nothing more was named.
    """

    score: float
    axle: str
    p_memory: float
    swollen: tuple[str, ...]
    p_decoy: float = 1.0
    like: str = ""
    failed: tuple[str, ...] = ()
    rival: float = -math.inf
    p_jitter: float = 1.0
    jitters: str = ""
    ended: str = ""

    @property
    def found(self) -> bool:
        """Whether something is left beside what was named."""
        tests = np.array([self.p_memory, self.p_decoy, self.p_jitter])
        # Three faint signs of the same thing are one clear sign (Fisher's combination).
        faint = chi2.sf(-2.0 * np.sum(np.log(np.maximum(tests, 1e-300))), 2 * len(tests))
        noticed = min(float(tests.min()), float(faint)) < NOTICED
        told = self.swollen or self.failed or self.ended
        return self.score > ENOUGH or noticed or bool(told)

    @property
    def present(self) -> bool:
        """Whether something has no name: beside what was named, or as likely in its place."""
        return self.found or self.rival > AS_WELL


def unexplained(where: Dataset, allowed: ModelEvidence, seed: int) -> Unexplained:
    """Ask the slack models and the decoys.

    Parameters
    ----------
    where : Dataset
        The final model's, with quiet wheels.
    allowed : ModelEvidence
        The final model with a little of everything else.
    seed : int
        Of the decoys' test.
    """
    stage = allowed.stage
    quiet = clear(where, stage)
    known = imitation(quiet.slopes, stage.mode.z, allowed.rows, allowed.at)
    score, axle = free_course(quiet, known)
    decoys = unlisted(quiet, known)
    two_sided = np.zeros(len(decoys.words), bool)
    p, k = largest(decoys.pull, decoys.gram, decoys.raw, two_sided, seed)
    p_jitter, jitters = jitter(where, stage)
    return Unexplained(
        score=score,
        axle=axle,
        p_memory=memory(stage)[1],
        swollen=_swollen(where, stage),
        p_decoy=p,
        like=decoys.words[k],
        p_jitter=p_jitter,
        jitters=jitters,
    )


def _swollen(where: Dataset, stage: FittedModel) -> tuple[str, ...]:
    """Channels whose noise is far above what was given."""
    level = stage.space.nuisance(stage.mode.z[None])
    out = []
    for run, line in enumerate(where.lines):
        for c, channel in enumerate(CHANNELS):
            given = line.noise[c]
            fitted = level.get(f"noise {channel} {run}")
            if given and fitted is not None and float(fitted[0]) > _SWOLLEN * given:
                out.append(channel)
    return tuple(dict.fromkeys(out))
