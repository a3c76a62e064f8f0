"""The last seconds run over again, from where the parameters have turned out to be.

An unscented filter draws a line through a curve where it happens to be when a reading comes.
While next to nothing is known that place is far off, and what was learnt there cannot be taken
back later.  So the filter remembers the stretch since it knew little: when it has learnt more, the
stretch is run again with a fixed reference at the estimate and sigma points as far apart as
the parameters are uncertain now, until the estimate stays (García-Fernández et al. 2015; with
motion and biases at the beginning of the stretch as unknowns too, since a state that is found from
the first readings depends on the parameters as much as they do).  Each round is a Gauss–Newton
step on the log-posterior of the stretch; one that would lower it is shortened.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.ukf import run
from bayes_asv.filters.ukf_state import COLUMNS, LOST, QUICK, SCORE, Model, Rules, State, Steps

__all__ = ["Stretch", "cut", "joined_steps", "relinearised"]

Array = NDArray[np.float64]

_UNKNOWNS = 6  # motion and biases at the beginning
_ROUNDS = 10
_STILL = 0.05  # deviations: the estimate stays
_FARTHEST = 1.5  # prior deviations of a parameter in one round
_SHORTER = 0.4
_GAIN = 0.02  # of −2 log p: less says nothing
_SHORTEST = 0.02


@dataclass(frozen=True)
class Stretch:
    """A stretch of record and what was known where it begins.

    Parameters
    ----------
    known : State
        What was known, the reference at the estimate.
    steps : Steps
        Everything since.
    """

    known: State
    steps: Steps


def cut(steps: Steps, first: int, last: int) -> Steps:
    """Take the steps from one number to before another."""
    step, moments, spread, kind, reading, afresh = steps
    part = slice(first, last)
    return Steps(
        step[part], moments[part], spread[part], kind[part], reading[part], afresh[part]
    )  # fmt: skip


def joined_steps(parts: list[Steps]) -> Steps:
    """One after the other."""
    if len(parts) == 1:
        return parts[0]
    return Steps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _Joint:
    """Parameters and unknowns of a beginning, q = (θ, u), both as they were known there.

    The state there is x + slopeᵀ (q − mean) + η with η ~ N(0, Π); q has the factor D.
    """

    mean: Array
    D: Array
    x: Array
    slope: Array
    Pi: Array
    memory: Array

    @classmethod
    def of(cls, known: State, memory: Array) -> _Joint:
        p = len(known.mu)
        first = np.linalg.cholesky(known.Pi[:_UNKNOWNS, :_UNKNOWNS])
        own = np.linalg.solve(first, known.Pi[:_UNKNOWNS]).T  # the state by its first six
        D = np.eye(p + _UNKNOWNS)
        D[:p, :p] = known.D
        memory = memory.copy()
        memory[QUICK : QUICK + 2] = 1.0  # the level that was learnt slowly holds for all of it
        return cls(
            mean=np.concatenate([known.mu, np.zeros(_UNKNOWNS)]),
            D=D,
            x=known.x,
            slope=np.vstack([np.linalg.solve(known.D, known.J), own.T]),
            Pi=known.Pi - own @ own.T,
            memory=memory,
        )

    def seen_from(self, place: Array, D: Array) -> State:
        """Put the reference at a place, with sigma points spread by D."""
        memory = self.memory.copy()
        memory[SCORE] = 0.0
        to_d = np.linalg.inv(D.T)
        return State(
            mu=place.copy(),
            D=np.ascontiguousarray(D),
            x=self.x + self.slope.T @ (place - self.mean),
            J=np.ascontiguousarray(D @ self.slope),
            m=to_d @ (self.mean - place),
            F=np.ascontiguousarray(np.triu(self.D @ to_d.T)),
            Pi=self.Pi.copy(),
            memory=memory,
            safe=np.zeros((2, 0, 0)),
            echo=np.zeros((2, 2, 0)),
        )

    def misfit(self, place: Array) -> float:
        """−2 log density of what was known, at a place."""
        away = np.linalg.solve(self.D.T, place - self.mean)
        return float(away @ away)


def _pass(
    joint: _Joint, stretch: Stretch, model: Model, rules: Rules, place: Array, D: Array
) -> tuple[State, float]:
    """Run over a stretch from a place; return what is known at its end and −2 log posterior."""
    state = joint.seen_from(place, D)
    run(0, True, state, model, rules, stretch.steps, np.empty((0, COLUMNS)))
    score = float(state.memory[SCORE]) + joint.misfit(place)
    return state, score if np.isfinite(score) else np.inf


def _estimate(state: State) -> tuple[Array, Array]:
    """Mean of (θ, u) and its factor at the end of a pass."""
    return state.mu + state.D.T @ state.m, np.triu(state.F @ state.D)


def relinearised(stretch: Stretch, now: State, model: Model, rules: Rules) -> tuple[State, float]:
    """Run a stretch again until its estimate stays.

    Parameters
    ----------
    stretch : Stretch
        The stretch.
    now : State
        What the filter knows at its end: where the search begins, and whose memory is kept.
    model, rules : Model, Rules
        As the filter has them.

    Returns
    -------
    state : State
        What is known at the end of the stretch, the reference at the estimate.
    moved : float
        How far the parameters went from ``now``, in deviations of ``now``, the largest.
    """
    p = len(now.mu)
    joint = _Joint.of(stretch.known, now.memory)
    D = np.eye(p + _UNKNOWNS)
    D[:p, :p] = now.D
    place = np.concatenate([now.mu, np.zeros(_UNKNOWNS)])
    state, score = _pass(joint, stretch, model, rules, place, D)
    for _ in range(_ROUNDS):
        target, D = _estimate(state)
        move = target - place
        if np.max(np.abs(np.linalg.solve(D.T, move))) < _STILL:
            break
        length = min(1.0, _FARTHEST / max(float(np.max(np.abs(move[:p]))), 1e-300))
        while True:
            tried, reached = _pass(joint, stretch, model, rules, place + length * move, D)
            if reached <= score + _GAIN or length < _SHORTEST:
                break
            length *= _SHORTER
        if reached > score + _GAIN:
            break
        settled = length == 1.0 and abs(reached - score) < _GAIN
        place, state, score = place + length * move, tried, reached
        if settled:
            break
    mean, D = _estimate(state)
    moved = np.linalg.solve(now.D.T, mean[:p] - now.mu)
    J = state.F @ state.J
    memory = now.memory.copy()
    memory[LOST] = 0.0
    found = State(
        mu=mean[:p].copy(),
        D=np.ascontiguousarray(D[:p, :p]),
        x=state.x + state.J.T @ state.m,
        J=np.ascontiguousarray(J[:p]),
        m=np.zeros(p),
        F=np.eye(p),
        Pi=state.Pi + J[p:].T @ J[p:],
        memory=memory,
        safe=now.safe.copy(),
        echo=now.echo.copy(),
    )
    return found, float(np.max(np.abs(moved)))
