"""Whether something is left that no effect in the list explains.

Slack models have no name: a force of any course in time at an axle, and a force that depends in any
way on where the suspension is and how fast it moves.  Their amplitude is integrated out over a
few sizes.  When one of them beats the named model clearly, or a decoy does, or the innovations
remember their past, or noise had to swell, what was named is not the whole story.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import chi2

from bayes_asv.channels import CHANNELS
from bayes_asv.diagnosis.clear import Quiet, clear
from bayes_asv.diagnosis.family import largest
from bayes_asv.diagnosis.imitation import imitation
from bayes_asv.diagnosis.jitter import jitter
from bayes_asv.diagnosis.memory import memory
from bayes_asv.diagnosis.thresholds import AS_WELL, ENOUGH, NOTICED
from bayes_asv.diagnosis.tolerance import Allowed
from bayes_asv.diagnosis.unlisted import unlisted
from bayes_asv.inference.effects import car_scale
from bayes_asv.inference.likelihood import Nudge, shared_work
from bayes_asv.inference.stage import Setting, Stage
from bayes_asv.kernels.forces import OUTSIDE, excess_many
from bayes_asv.model.effects import AXLES

__all__ = ["Unexplained", "pulses", "unexplained"]

Array = NDArray[np.float64]

_PULSE = 0.04  # s between two pulses of a force of any course
_PUSH = 0.01  # of the axle's load
_SIZES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
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


def pulses(quiet: Quiet, axle: int) -> Array:
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
        nudge = Nudge(np.zeros_like(line.moments), nothing, force)
        return quiet.joined({run: quiet.stands[run].nudged(nudge)})

    with shared_work(quiet.stage.target) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(one, starts)))


def unexplained(where: Setting, allowed: Allowed, seed: int) -> Unexplained:
    """Ask the slack models and the decoys.

    Parameters
    ----------
    where : Setting
        The final model's, with quiet wheels.
    allowed : Allowed
        The final model with a little of everything else.
    seed : int
        Of the decoys' test.
    """
    stage = allowed.stage
    quiet = clear(where, stage)
    known = imitation(quiet.slopes, stage.mode.z, allowed.rows, allowed.at)
    scores = {}
    for k, axle in enumerate(AXLES):
        scores[axle] = _wins(*known.beyond(pulses(quiet, k)))
    best = max(scores, key=lambda name: scores[name])
    decoys = unlisted(quiet, known)
    two_sided = np.zeros(len(decoys.words), bool)
    p, k = largest(decoys.pull, decoys.gram, decoys.raw, two_sided, seed)
    p_jitter, jitters = jitter(where, stage)
    return Unexplained(
        score=scores[best],
        axle=best,
        p_memory=memory(stage)[1],
        swollen=_swollen(where, stage),
        p_decoy=p,
        like=decoys.words[k],
        p_jitter=p_jitter,
        jitters=jitters,
    )


def _wins(pull: Array, gram: Array) -> float:
    """Log Bayes factor of a slack model against none, averaged over its sizes."""
    eigen, vectors = np.linalg.eigh(gram)
    eigen = np.maximum(eigen, 0.0)
    turned = (vectors.T @ pull) ** 2
    gains = [
        0.5 * float(np.sum(turned * s**2 / (1.0 + s**2 * eigen) - np.log1p(s**2 * eigen)))
        for s in _SIZES
    ]
    return float(logsumexp(gains) - math.log(len(gains)))


def _swollen(where: Setting, stage: Stage) -> tuple[str, ...]:
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
