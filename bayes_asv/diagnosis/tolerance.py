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
from scipy.special import logsumexp

from bayes_asv.diagnosis.signatures import Signatures
from bayes_asv.inference.likelihood import Nudge, Target
from bayes_asv.inference.scoring import climb
from bayes_asv.inference.stage import Stage

__all__ = ["AMOUNTS", "Allowed", "Granted", "allowed", "granted", "with_tolerances"]

Array = NDArray[np.float64]

AMOUNTS = np.array([0.0, 0.5, 1.0])
"""How much of everything there may be, in tolerances.

Nothing, as on a rig or a new car, or about what data sheets allow.  A tenth of that would let a
single fault that is small itself pass for a little of everything, and twice as much one that is
plain: a zero that drifts by 6.6 tolerances, a score of 13, was none.
"""

_BELIEVED = np.log([0.4, 0.3, 0.3])
_ROUNDS = 2
_WORTH = 3.0  # nats that a little of everything has to bring for the mode to be found again


@dataclass(frozen=True)
class Allowed:
    """A stage with a little of everything else.

    Parameters
    ----------
    log_evidence : float
        Of the model, averaged over the amounts.
    amount : float
        The most probable one.
    shift : (D,) array
        How that much of everything moves the stage's mode.
    covariance : (D, D) array
        Of the stage's coordinates.
    stage : Stage
        The model with its tolerances where the data want them.
    rows : (K, N) array
        Signatures of that much of everything there.
    at : (K,) array
        Where the tolerances are in that stage's innovations.
    """

    log_evidence: float
    amount: float
    shift: Array
    covariance: Array
    stage: Stage
    rows: Array
    at: Array


@dataclass(frozen=True)
class Granted(Target):
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

    def scored(self, z: Array, run: int, nudge: Nudge | None = None) -> tuple[Array, Array, Array]:
        """Score as the plain target does, the change taken off the innovations."""
        nu, logs, states = super().scored(z, run, nudge)
        change = np.exp(-0.5 * (logs - self.logs[run])) * self.moved[run]
        return np.where(logs != 0.0, nu - change, 0.0), logs, states

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,) at coordinates (W, D), with what the change costs."""
        value = self.space.log_prior(z) - self.cost
        for w in np.flatnonzero(np.isfinite(value)):
            for run in range(len(self.space.timelines)):
                nu, logs, _ = self.scored(z[w], run)
                there = logs != 0.0
                part = nu[there] ** 2 + logs[there] + math.log(2.0 * math.pi)
                value[w] += float(self.given_back(z[w : w + 1], run)[0] - 0.5 * part.sum())
        return np.where(np.isfinite(value), value, -np.inf)


def allowed(stage: Stage, found: Signatures) -> Allowed:
    """Integrate out what is there to a tolerance.

    Parameters
    ----------
    stage : Stage
        A model at its mode.
    found : Signatures
        Of candidates at that mode; those that are not tolerances are left out.
    """
    keep = np.array([c.tolerance for c in found.candidates], bool)
    rows = found.rows[keep]
    at_mode = [_joint(stage, amount * rows, np.zeros(len(rows))) for amount in AMOUNTS]
    gains = np.array([joint.log_evidence for joint in at_mode])
    best = int(np.argmax(gains + _BELIEVED))
    amount = float(AMOUNTS[best])
    joint, there = at_mode[best], stage
    rows, at = amount * rows, np.zeros(len(rows))
    if amount > 0.0 and gains[best] > gains[0] + _WORTH and np.all(np.isfinite(gains)):
        mended, closer, scaled, moved = _again(stage, rows, joint)
        if math.isfinite(closer.log_evidence):
            there, joint, rows, at = mended, closer, scaled, moved
            # Expanded about a mode without tolerances, gains are guesses: far from it they promise
            # more than there is.  All amounts are wrong by about the same share.
            share = (joint.log_evidence - gains[0]) / (gains[best] - gains[0])
            gains = gains[0] + share * (gains - gains[0])
    return Allowed(
        float(logsumexp(gains + _BELIEVED)),
        amount,
        there.mode.z + joint.step[: len(stage.mode.z)] - stage.mode.z,
        joint.covariance,
        there,
        rows,
        at,
    )


@dataclass(frozen=True)
class _Joint:
    """Model and tolerances together, to second order about a place.

    Parameters
    ----------
    log_evidence : float
        Laplace's.
    step : (D + K,) array
        To the joint mode.
    covariance : (D, D) array
        Of the model's coordinates.
    """

    log_evidence: float
    step: Array
    covariance: Array


def _joint(stage: Stage, rows: Array, at: Array) -> _Joint:
    """Expand about a stage's mode and tolerance coordinates ``at`` (K,)."""
    here = stage.mode.slopes
    d = len(stage.mode.z)
    cross = here.means @ rows.T
    whole = np.block([[here.precision(), cross], [cross.T, rows @ rows.T + np.eye(len(rows))]])
    slope = np.concatenate([here.gradient(stage.mode.z), rows @ here.nu - at])
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(slope))):  # a fit that ran away
        return _Joint(-math.inf, np.zeros(len(slope)), np.eye(d))
    step = np.linalg.solve(whole, slope)
    value = here.log_posterior + 0.5 * float(slope @ step) + 0.5 * d * math.log(2.0 * math.pi)
    value -= 0.5 * float(np.linalg.slogdet(whole)[1])
    return _Joint(value, step, np.linalg.inv(whole)[:d, :d])


def _again(stage: Stage, rows: Array, joint: _Joint) -> tuple[Stage, _Joint, Array, Array]:
    """Find the mode again with tolerances where the data want them; their rows and places there."""
    d = len(stage.mode.z)
    at, there, scaled = np.zeros(len(rows)), stage, rows
    for _ in range(_ROUNDS):
        at = at + joint.step[d:]
        target = granted(stage, rows, at)
        start = there.mode.z + joint.step[:d] if there is stage else there.mode.z
        there = replace(stage, target=target, mode=climb(target, start))
        scaled = rows * np.exp(-0.5 * (there.mode.slopes.logs - stage.mode.slopes.logs))
        joint = _joint(there, scaled, at)
    return there, joint, scaled, at


def granted(stage: Stage, rows: Array, at: Array) -> Granted:
    """Return a stage's target with tolerances at ``at`` (K,), whose signatures are ``rows`` (K, N).

    They cost what a standard normal prior takes for them.
    """
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
    return Granted(**plain, moved=tuple(moved), logs=tuple(logs), cost=0.5 * float(at @ at))


def with_tolerances(found: Signatures) -> tuple[Array, Array]:
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
