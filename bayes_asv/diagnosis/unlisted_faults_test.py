"""How well what has no name would explain what a model leaves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.denoised_model import DenoisedModel, clear
from bayes_asv.diagnosis.nuisance_projection import NuisanceProjection, imitation
from bayes_asv.diagnosis.pulse_scan import free_course
from bayes_asv.diagnosis.score_test import SILENT
from bayes_asv.diagnosis.thresholds import PRICE
from bayes_asv.diagnosis.timing_jitter_test import louder_where_steep
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence
from bayes_asv.diagnosis.unlisted_faults import decoy_rows
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.models.effects import AXLES
from bayes_asv.posterior.fitted_model import Dataset

__all__ = ["Nameless", "UnlistedFaultScores", "unlisted", "without_a_name"]

Array = NDArray[np.float64]

_OF_ALL = 0.5
"""Share of what louder noise explains that counts against one name.

It takes in what several names would have to share: of four faults of one size in the same quarter
of a run nearly twice what the best of them does.
"""


class UnlistedFaultScores(NamedTuple):
    """Decoys next to a model, to first order.

    Parameters
    ----------
    pull : (K,) array
        Slopes of the log-likelihood along their signatures.
    gram : (K, K) array
        Curvature, what the model can imitate left out.
    rows : (K, N) array
        The signatures.
    words : tuple of str
        What each of them is.
    """

    pull: Array
    gram: Array
    rows: Array
    words: tuple[str, ...]

    @property
    def raw(self) -> Array:
        """Squared lengths (K,) of the signatures before anything is left out."""
        return np.asarray(np.sum(self.rows**2, axis=1))

    @property
    def gains(self) -> Array:
        """Nats (K,) by which each explains better at its best size; none for what is silent."""
        own = np.diag(self.gram)
        return np.where(own > SILENT * self.raw, 0.5 * self.pull**2 / np.maximum(own, 1e-30), 0.0)

    @property
    def best(self) -> tuple[float, str]:
        """Nats of the one that explains most, and what it is."""
        gains = self.gains
        k = int(np.argmax(gains))
        return float(gains[k]), self.words[k]


class Nameless(NamedTuple):
    """What explains most without a name.

    Parameters
    ----------
    log_evidence : float
        Of the model with it.
    words : str
        What it is.
    """

    log_evidence: float
    words: str


def unlisted(quiet: DenoisedModel, known: NuisanceProjection) -> UnlistedFaultScores:
    """Hold the decoys against what a model leaves.

    Parameters
    ----------
    quiet : DenoisedModel
        The model at its mode.
    known : NuisanceProjection
        What it can imitate.
    """
    rows, words = decoy_rows(quiet)
    pull, gram = known.beyond(rows)
    return UnlistedFaultScores(pull, gram, rows, words)


def without_a_name(where: Dataset, allowed: ModelEvidence) -> Nameless:
    """Find what explains most without a name, a little of everything beside it.

    It is the decoy that fits best, to first order, a force of free course at an axle, or time
    stamps that jitter.

    Parameters
    ----------
    where : Dataset
        Recordings with quiet wheels.
    allowed : ModelEvidence
        The model with a little of everything.
    """
    stage = allowed.stage
    quiet = clear(where, stage)
    known = imitation(quiet.slopes, stage.mode.z, allowed.rows, allowed.at)
    found = unlisted(quiet, known)
    gain, words = found.best
    nats, channel = louder_where_steep(where, stage, quiet.settled)
    wins, axle = free_course(quiet, known)
    so_far = allowed.log_evidence
    return max(
        Nameless(so_far + gain - PRICE - math.log(len(found.words)), words),
        Nameless(so_far + wins - math.log(len(AXLES)), f"a force of free course at the {axle}"),
        Nameless(
            so_far + _OF_ALL * nats - PRICE - math.log(len(CHANNELS)),
            f"time stamps that jitter ({channel.replace('_', ' ')})",
        ),
    )
