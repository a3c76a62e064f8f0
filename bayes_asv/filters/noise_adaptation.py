"""What the unscented filter thinks of its noise and of itself, compiled.

The noise has a level for each axle, one where it is as declared.  It follows the innovations:
slowly as it should, at once when something breaks.  Innovations that hang together say that
parameters do not stay where they were.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.discretization import OPTIONS
from bayes_asv.filters.ukf_state import (
    COLOUR,
    COPIED,
    DOUBTED,
    LAGS,
    MOTION,
    QUICK,
    SHAKEN,
    SUM,
    WEIGHT,
    Rules,
    State,
)

__all__ = ["COPY", "doubt", "keep_safe", "learn_level", "levels", "listen", "shaken"]

Array = NDArray[np.float64]

_SHAKEN = 25.0  # variance of the motion in variances of its estimate
_SHAKEN_TIME = 0.25  # s over which it is looked at

COPY = 0.1
"""Seconds between copies of what is known of the parameters."""


@njit(**OPTIONS)
def levels(memory: Array, rules: Rules, level: Array) -> None:
    """Fill the level of each axle's noise, a factor on its variance."""
    for axle in range(2):
        held = rules.trust + memory[WEIGHT + axle]
        level[axle] = (rules.trust + memory[SUM + axle]) / held
        if memory[QUICK + axle] > max(rules.sudden, level[axle]):
            level[axle] = memory[QUICK + axle]


@njit(**OPTIONS)
def learn_level(memory: Array, rules: Rules, axle: int, ratio: float, level: float) -> None:
    """Hold a reading's squared deviations against what its noise would give."""
    raw = min(ratio, rules.gate) * level
    kept = 1.0 - 1.0 / rules.window
    memory[SUM + axle] = memory[SUM + axle] * kept + min(raw, rules.gate)
    memory[WEIGHT + axle] = memory[WEIGHT + axle] * kept + 1.0
    memory[QUICK + axle] += (raw - memory[QUICK + axle]) / rules.quick


@njit(**OPTIONS)
def listen(echo: Array, nu: float, rules: Rules) -> None:
    """Hold a normalised innovation, cut at the gate, against those before it."""
    edge = math.sqrt(rules.gate)
    nu = min(max(nu, -edge), edge)
    share = 1.0 / rules.window
    echo[0, 0] = nu
    for lag in range(LAGS, -1, -1):
        echo[1, lag] += (nu * echo[0, lag] - echo[1, lag]) * share
        if lag > 0:
            echo[0, lag] = echo[0, lag - 1]


@njit(**OPTIONS)
def doubt(state: State, coloured: float) -> None:
    """Doubt constant parameters while the innovations say more than white ones would.

    A mean of n of them has 1 + 2 Σ r_l times the variance; the sum is tapered (Bartlett).
    """
    most = 0.0
    for axle in range(2):
        total = 1.0
        for lag in range(1, LAGS + 1):
            taper = 2.0 * (1.0 - lag / (LAGS + 1.0))
            total += taper * state.echo[axle, 1, lag] / state.echo[axle, 1, 0]
        most = max(most, total)
    state.memory[COLOUR] = most
    if most > coloured:
        state.memory[DOUBTED] = 1.0
    elif most * most < coloured:
        state.memory[DOUBTED] = 0.0


@njit(**OPTIONS)
def shaken(state: State, C: Array, h: float) -> bool:
    """Whether the car moves enough for its readings to speak of the parameters.

    At rest the noise of the wheels' sensors is all that there is to explain, and a filter
    would explain it by a car that answers to nothing.  So what the estimated motion makes of the
    readings has to vary by more than five of its own deviations.
    """
    share = min(h / _SHAKEN_TIME, 1.0)
    moves = False
    for axle in range(2):
        value = 0.0
        variance = 0.0
        for a in range(4):
            value += C[axle, a] * state.x[a]
            for b in range(4):
                variance += C[axle, a] * C[axle, b] * state.Pi[a, b]
        away = value - state.memory[MOTION + axle]
        state.memory[MOTION + axle] += share * away
        state.memory[SHAKEN + axle] += share * (away * away - state.memory[SHAKEN + axle])
        moves = moves or state.memory[SHAKEN + axle] > _SHAKEN * variance
    return moves


@njit(**OPTIONS)
def keep_safe(state: State, sudden: float, h: float) -> None:
    """Keep the parameters as they were when all was well, at least one copy's time ago."""
    memory, safe = state.memory, state.safe
    memory[COPIED] += h
    if memory[COPIED] < COPY or max(memory[QUICK], memory[QUICK + 1]) > sudden:
        return
    memory[COPIED] = 0.0
    for i in range(state.mu.shape[0]):
        safe[0, i, 0] = safe[1, i, 0]
        safe[1, i, 0] = state.mu[i]
        for k in range(state.mu.shape[0]):
            safe[0, i, 1 + k] = safe[1, i, 1 + k]
            safe[1, i, 1 + k] = state.D[i, k]
