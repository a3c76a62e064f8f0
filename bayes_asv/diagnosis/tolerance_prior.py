"""A little of everything: what tolerances of all other effects do to evidence and intervals.

Every effect that a model does not name may be there to the size of its tolerance, to first
order: its signature times a normal number, which is integrated out.  How much of everything
there is differs from car to car, from nothing in a clean one to what data sheets allow, so
evidence is averaged over that: a car with a single fault is not told to have all of them, and a
car with all of them is not told to have a single one.

Where there is much of everything, a model without it takes it for noise.  At the most probable
amount the mode is therefore found again, with the tolerances where the data want them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr

from bayes_asv.diagnosis.nuisance_projection import imitation
from bayes_asv.diagnosis.score_test import ScoreTest
from bayes_asv.diagnosis.truncated_gaussian import TruncatedGaussian, bounded
from bayes_asv.posterior.fisher_scoring import ScoreAndInformation
from bayes_asv.posterior.fitted_model import FittedModel, fitted
from bayes_asv.posterior.likelihood import Perturbation, Posterior

__all__ = [
    "AMOUNTS",
    "MOST",
    "ModelEvidence",
    "OffsetPosterior",
    "allowed",
    "granted",
    "unfolded",
    "with_tolerances",
]

Array = NDArray[np.float64]

AMOUNTS = np.array([0.0, 0.5, 1.0])
"""How much of everything there may be, in tolerances.

Nothing, as on a rig or a new car, or about what data sheets allow.  A tenth of that would let a
single fault that is small itself pass for a little of everything, and twice as much one that is
plain: a zero that drifts by 6.6 tolerances, a score of 13, was none.
"""

MOST = 3.0
"""Tolerances beyond which nothing is a little: what stands further out has a name."""

_BELIEVED = np.log([0.7, 0.15, 0.15])
_ROUNDS = 2
_WORTH = 3.0  # nats that a little of everything has to bring for the mode to be found again


@dataclass(frozen=True)
class ModelEvidence:
    """A stage with a little of everything else.

    Parameters
    ----------
    by_amount : (3,) array
        Log evidence of the model with each amount, what is believed of the amount in it.
    amount : float
        The most probable one.
    shift : (D,) array
        How that much of everything moves the stage's mode.
    covariance : (D, D) array
        Of the stage's coordinates.
    stage : FittedModel
        The model with its tolerances where the data want them.
    rows : (K, N) array
        Signatures of that much of everything there.  What would have to be less than nothing, a
        knee that stiffens a damper, imitates nothing and is left out.
    at : (K,) array
        Where those are in that stage's innovations.
    """

    by_amount: Array
    amount: float
    shift: Array
    covariance: Array
    stage: FittedModel
    rows: Array
    at: Array

    @property
    def log_evidence(self) -> float:
        """Of the model, averaged over the amounts."""
        return float(logsumexp(self.by_amount))


@dataclass(frozen=True)
class OffsetPosterior(Posterior):
    """A target whose predictions are moved by a fixed change.

    Parameters
    ----------
    moved : tuple of (E, 2) arrays
        In deviations, as the innovations are.
    logs : tuple of (E, 2) arrays
        Log variances that those deviations belong to.
    cost : float
        What the change costs beforehand, nats.
    """

    moved: tuple[Array, ...] = ()
    logs: tuple[Array, ...] = ()
    cost: float = 0.0

    def scored(
        self, z: Array, run: int, nudge: Perturbation | None = None
    ) -> tuple[Array, Array, Array]:
        """Score as the plain target does, the change taken off the innovations."""
        nu, logs, states = super().scored(z, run, nudge)
        change = np.exp(-0.5 * (logs - self.logs[run])) * self.moved[run]
        return np.where(logs != 0.0, nu - change, 0.0), logs, states

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,) at coordinates (W, D), with what the change costs."""
        value = self.space.log_prior(z) - self.cost

        def one(at: tuple[int, int]) -> float:
            w, run = at
            nu, logs, _ = self.scored(z[w], run)
            there = logs != 0.0
            part = nu[there] ** 2 + logs[there] + math.log(2.0 * math.pi)
            return float(self.given_back(z[w : w + 1], run)[0] - 0.5 * part.sum())

        runs = range(len(self.space.timelines))
        work = self.pool.map if self.pool else map
        for w in np.flatnonzero(np.isfinite(value)).tolist():
            value[w] += sum(work(one, [(w, run) for run in runs]))
        return np.where(np.isfinite(value), value, -np.inf)


def allowed(stage: FittedModel, found: ScoreTest, *, rough: bool = False) -> ModelEvidence:
    """Integrate out what is there to a tolerance.

    Parameters
    ----------
    stage : FittedModel
        A model at its mode.
    found : ScoreTest
        Of candidates at that mode; those that are not tolerances are left out.
    rough : bool
        Only as far as a look from the stage's own mode goes, which promises more than there is.
    """
    alone = stage.mode.log_evidence
    if not (math.isfinite(alone) and np.all(np.isfinite(found.gram))):  # a fit that ran away
        nothing = np.zeros((0, len(stage.mode.slopes.nu)))
        none = np.zeros(len(stage.mode.z))
        never = np.full(len(AMOUNTS), -math.inf)
        return ModelEvidence(never, 0.0, none, np.eye(len(none)), stage, nothing, nothing[:, 0])
    keep = np.array([c.tolerance for c in found.candidates], bool)
    rows = found.rows[keep]
    high = np.full(len(rows), MOST)
    low = np.where([c.signed for c in found.candidates if c.tolerance], 0.0, -MOST)
    pull, gram = found.pull[keep], found.gram[np.ix_(keep, keep)]
    there = [bounded(a * pull, a * a * gram, low, high) for a in AMOUNTS]
    gains = np.array([one.gain for one in there])
    best = int(np.argmax(gains + _BELIEVED))
    amount, rows = float(AMOUNTS[best]), float(AMOUNTS[best]) * rows
    place = _Place(stage, found.slopes, rows, np.zeros(len(rows)), there[best])
    if not rough and amount > 0.0 and gains[best] > gains[0] + _WORTH:
        closer = place
        for _ in range(_ROUNDS):
            closer = _closer(stage, found, rows, low, high, closer)
        if math.isfinite(closer.log_evidence):
            place = closer
            # Expanded about a mode without tolerances, gains are guesses: far from it they promise
            # more than there is.  All amounts are wrong by about the same share.
            share = (place.log_evidence - alone) / gains[best]
            gains = np.where(gains > 0.0, share * gains, gains)
    gap = place.of_mode()
    shift = place.stage.mode.z - stage.mode.z + gap @ (place.found.at - place.at)
    covariance = place.stage.mode.covariance + gap @ place.found.covariance @ gap.T
    least = place.found.held & (place.found.at == 0.0) & (place.at == 0.0)
    return ModelEvidence(
        alone + unfolded(stage, stage.mode.z + shift, covariance) + gains + _BELIEVED,
        amount,
        shift,
        covariance,
        place.stage,
        place.rows[~least],
        place.at[~least],
    )


def unfolded(stage: FittedModel, z: Array, covariance: Array) -> float:
    """Nats that evidence about one mode misses where a coordinate counts by its size alone.

    A half-normal belief is twice a normal one, on one side of zero: log 2 far from it, and
    nothing at zero, where a mode reaches over to the other side.

    Parameters
    ----------
    stage : FittedModel
        A model.
    z, covariance : (D,) and (D, D) arrays
        Its posterior.
    """
    out = 0.0
    for site in stage.sites:
        for p in site.effect.parameters:
            if p.form == "positive":
                k = stage.space.names.index(site.coordinate_name(p))
                out += float(np.log(2.0 * ndtr(abs(z[k]) / np.sqrt(covariance[k, k]))))
    return out


@dataclass(frozen=True)
class _Place:
    """A stage with tolerances at some place, and what the data make of them from there.

    Parameters
    ----------
    stage : FittedModel
        At its mode with tolerances there.
    slopes : ScoreAndInformation
        Its innovations, and its changes on quiet wheels.
    rows : (K, N) array
        Signatures of the tolerances.
    at : (K,) array
        Where they are in the innovations.
    found : TruncatedGaussian
        Where they belong.
    """

    stage: FittedModel
    slopes: ScoreAndInformation
    rows: Array
    at: Array
    found: TruncatedGaussian

    @property
    def log_evidence(self) -> float:
        """Laplace's, tolerances integrated out."""
        # the target counts what the tolerances cost where they are, and so does the integral
        return self.stage.mode.log_evidence + 0.5 * float(self.at @ self.at) + self.found.gain

    def of_mode(self) -> Array:
        """How tolerances move the mode (D, K)."""
        cross = self.slopes.means @ self.rows.T
        return np.asarray(-np.linalg.solve(self.slopes.precision(), cross), np.float64)


def _closer(
    stage: FittedModel, found: ScoreTest, rows: Array, low: Array, high: Array, place: _Place
) -> _Place:
    """Find the mode again with tolerances where the data want them, and ask the data again."""
    at = place.found.at
    start = place.stage.mode.z + place.of_mode() @ (at - place.at)
    there = fitted(granted(stage, rows, at, 0.5 * float(at @ at)), start)
    # Along a coordinate predictions change as they did without tolerances; deviations are others.
    here = there.mode.slopes
    louder = np.exp(-0.5 * (here.logs - stage.mode.slopes.logs))
    slopes = replace(here, means=found.slopes.means * louder, scales=found.slopes.scales)
    scaled = rows * louder
    known = imitation(slopes, there.mode.z, found.feigned * louder)
    pull, gram = known.beyond(scaled)
    # the slope at t = 0 of a likelihood that is known about ``at``
    again = bounded(pull + gram @ at, gram, low, high)
    from_there = float((pull + 0.5 * gram @ at) @ at)
    return _Place(there, slopes, scaled, at, again._replace(gain=again.gain - from_there))


def granted(stage: FittedModel, rows: Array, at: Array, cost: float = 0.0) -> OffsetPosterior:
    """Return a stage's target with a change ``at`` (K,) times ``rows`` (K, N), and its cost."""
    moved, logs, begin = [], [], 0
    change = at @ rows
    for run in range(len(stage.space.timelines)):
        before = stage.target.scored(stage.mode.z, run)[1]
        read = before != 0.0
        laid = np.zeros_like(before)
        end = begin + int(np.count_nonzero(read))
        laid[read] = change[begin:end]
        begin = end
        moved.append(laid)
        logs.append(before)
    plain = {f: getattr(stage.target, f) for f in ("space", "colours", "patterns")}
    return OffsetPosterior(**plain, moved=tuple(moved), logs=tuple(logs), cost=cost)


def with_tolerances(found: ScoreTest) -> tuple[Array, Array]:
    """Pull and information of each candidate next to a full tolerance of all others, (K,) each."""
    tolerant = np.flatnonzero([c.tolerance for c in found.candidates])
    pull, own = found.pull.copy(), np.diag(found.gram).copy()
    for k in range(len(pull)):
        site = found.candidates[k].site
        others = np.array([j for j in tolerant if not site.meets(found.candidates[j].site)], int)
        inner = found.gram[np.ix_(others, others)] + np.eye(len(others))
        cross = found.gram[k, others]
        solved = np.linalg.solve(inner, np.column_stack([cross, found.pull[others]]))
        own[k] -= cross @ solved[:, 0]
        pull[k] -= cross @ solved[:, 1]
    return pull, np.maximum(own, 0.0)
