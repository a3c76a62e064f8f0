"""An unscented Kalman filter for states and parameters of the half car, compiled.

The states of :mod:`.innovations`, s = (x, b, w, v), ten in all, are linear once the parameters θ
are known, and only θ needs sigma points (Morelande & Moran 2007)::

    θ = μ + Dᵀ d,    d ~ N(m, Fᵀ F),    s = x + Jᵀ d + η,    η ~ N(0, Π)

Sigma points stand at ± :data:`REACH` along each row of D, with s on the line that J gives.  The
odd part of what a step or a reading makes of them is the new J; the even part goes to mean and
variance.  With θ before s in the state vector this is the plain unscented filter with n + λ =
REACH², α = β = 1, whose points along the ten linear directions need not be computed.  To its
process and reading noise comes what no point along an axis sees, that parameters and states are
both uncertain (:func:`bayes_asv.filters.simd_outputs.crossed`): without it the first sharp edge,
where nothing is known yet, gave answers off by 3 to 18 of the deviations claimed.

A moving reference follows the estimate: after each reading μ, D and J take up m and F.  A fixed
one stays where it was put, so that a stretch of record can be run over again with the points
where later readings have shown the parameters to be (García-Fernández et al. 2015).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bayes_asv.filters.cholesky_update import follow, leverage, take, wander
from bayes_asv.filters.discretization import OPTIONS, TAYLOR, advance
from bayes_asv.filters.kalman import AT_LEAST, MISSING, VALUE
from bayes_asv.filters.noise_adaptation import doubt, keep_safe, learn_level, levels, listen, shaken
from bayes_asv.filters.predicted_measurement import REACH, expect
from bayes_asv.filters.simd_batch import begin_cars, moved, place_cars, step, structure_of
from bayes_asv.filters.simd_layout import BLOCK, blocks
from bayes_asv.filters.simd_outputs import crossed, odd_parts, output_matrix
from bayes_asv.filters.tails import upper_tail
from bayes_asv.filters.ukf_state import (
    BROKEN,
    CLOCK,
    DEFLECTION,
    DEFLECTION_SD,
    DEVIATION,
    DOUBT,
    DOUBTED,
    EXPECTED,
    EXPECTED_SD,
    INNOVATION,
    LEVEL,
    LOG_P,
    LOST,
    MEAN,
    NIS,
    QUICK,
    READINGS,
    SCORE,
    Model,
    Rules,
    State,
    Steps,
)

__all__ = ["DONE", "LEARNED", "LOOK", "REACH", "UPSET", "run"]

Array = NDArray[np.float64]

DONE, LEARNED, UPSET, LOOK = 0, 1, 2, 3  # why a run came back

_SURE: Final = 0.1  # share of `crossed` in a reading's variance beyond which it tests nothing
_LOG_2PI: Final = math.log(2.0 * math.pi)


@njit(**OPTIONS)
def _forget_motion(state: State, start: Array, slow: Array) -> None:
    """Back to what is known of motion and slow noise when nothing was measured; biases stay."""
    for a in range(10):
        if a == 4 or a == 5:
            continue
        state.x[a] = 0.0
        for i in range(state.J.shape[0]):
            state.J[i, a] = 0.0
        for b in range(10):
            state.Pi[a, b] = state.Pi[b, a] = 0.0
        state.Pi[a, a] = start[a] if a < 4 else slow[a - 6]


@njit(**OPTIONS)
def run(
    first: int,
    fixed: bool,
    state: State,
    model: Model,
    rules: Rules,
    steps: Steps,
    out: Array,
) -> tuple[int, int]:
    """Take up steps from ``first`` on, until the end or until something has to be decided.

    Parameters
    ----------
    first : int
        Step to begin with.
    fixed : bool
        Whether the reference stays where it is.  Such a run goes to the end, nothing walks in it
        and nothing is learnt of the noise; directions beyond the model's coordinates change the
        state alone.
    state : State
        Changed in place.
    model, rules, steps : Model, Rules, Steps
        See there.
    out : (N, COLUMNS) array
        Filled from ``first`` on, see ``filter_state``; left alone where the reference is fixed.

    Returns
    -------
    event, next : int
        Why it came back, and the first step that was not taken.
    """
    mu, D, x, J, m, F, Pi = (
        state.mu, state.D, state.x, state.J, state.m, state.F, state.Pi,
    )  # fmt: skip
    memory, noise, walk = state.memory, model.noise, model.walk
    cars = model.which.shape[0]
    p = mu.shape[0]
    W = np.zeros(blocks(cars) * BLOCK)
    begin_cars(W, cars, model.base)
    inputs = np.empty((2, TAYLOR + 1))
    bent = np.empty((4, 4))
    half = np.empty((2, 4))
    B = np.empty((2, 2))
    odd = np.empty((cars, 8))
    phi = np.zeros((4, 4))
    gamma = np.zeros((4, 2))
    qf = np.zeros((4, 4))
    qr = np.zeros((4, 4))
    decay = np.ones(6)
    T = np.empty((4, 10))
    C = np.empty((2, 4))
    gain = np.empty(2)
    y = np.empty((1 + 2 * cars, 2))
    expected = np.empty(2)
    g = np.empty((2, p))
    PC = np.empty((2, 10))
    rest = np.empty(2)
    unsure = np.zeros(2)
    total = np.zeros(3)
    weight = np.empty(p)
    other = np.empty(p)
    room = np.empty(p)
    level = np.empty(2)
    slow = np.empty(4)
    ahead = behind = 0.0
    fastest = 0.0
    h_known = h_decay = -1.0
    placed = False

    for k in range(first, steps.step.shape[0]):
        levels(memory, rules, level)
        for c in range(4):
            slow[c] = noise[4 + c] * level[c & 1]
        h = steps.step[k]
        if h > 0.0 and not fixed:
            walks = False
            for a in range(p):
                rate = walk[a]
                if memory[DOUBTED] > 0.0 and model.doubt[a] > rate:
                    rate = model.doubt[a]
                room[a] = rate * h
                walks = walks or rate > 0.0
            if walks:
                memory[LOST] -= wander(D, J, Pi, room)
                placed = False
        if not placed:
            fastest = place_cars(W, mu, D, REACH, model.which, model.log, model.centre, model.scale)
            output_matrix(W, C, gain)
            odd_parts(W, cars, REACH, odd)
            placed = True
            h_known = -1.0
        if steps.afresh[k]:
            _forget_motion(state, model.start, slow)
        elif h > 0.0:
            fresh = abs(h - h_known) > 1e-12
            step(W, cars, REACH, x, J, h, steps.moments[k], inputs, fastest, fresh)
            if fresh:
                structure_of(W, cars, h, phi, gamma, qf, qr)
                h_known = h
            if h != h_decay:
                h_decay = h
                for c in range(4):
                    decay[2 + c] = math.exp(-noise[8 + c] * h)
            crossed(odd, Pi, B)
            moved(W, cars, REACH, x, J, bent, half)
            for i in range(cars, p):
                _moved_along(J[i], phi, gamma)
            for c in range(4):
                x[6 + c] *= decay[2 + c]
                for i in range(p):
                    J[i, 6 + c] *= decay[2 + c]
            intensity_f = level[0] * (noise[0] * steps.spread[k, 0] + steps.spread[k, 2])
            intensity_r = level[1] * (noise[1] * steps.spread[k, 1] + steps.spread[k, 3])
            advance(Pi, T, phi, gamma, qf, qr, decay, intensity_f, intensity_r, slow)
            for a in range(4):
                for b in range(4):
                    Pi[a, b] += bent[a, b]
            for a in range(2):
                for b in range(2):
                    Pi[1 + 2 * a, 1 + 2 * b] += h * h * B[a, b]

        learns = fixed or shaken(state, C, h)
        nis = 0.0
        count = 0
        between = 0.0
        if not fixed:
            out[k, INNOVATION] = out[k, INNOVATION + 1] = 0.0
        both = steps.kind[k, 0] == VALUE and steps.kind[k, 1] == VALUE
        for axle in range(2):
            what = steps.kind[k, axle]
            if axle == 0 or (not both and steps.kind[k, 0] != MISSING):
                if axle == 1 and not fixed:  # a bound is not linear: see what it left
                    follow(mu, D, x, J, m, F)
                    fastest = place_cars(
                        W, mu, D, REACH, model.which, model.log, model.centre, model.scale
                    )
                    output_matrix(W, C, gain)
                    odd_parts(W, cars, REACH, odd)
                    h_known = -1.0
                between = expect(W, cars, state, C, y, expected, g, PC, rest)
                crossed(odd, Pi, B)
                unsure[0] = gain[0] * gain[0] * B[0, 0]
                unsure[1] = gain[1] * gain[1] * B[1, 1]
                rest[0] += level[0] * noise[2] + unsure[0]
                rest[1] += level[1] * noise[3] + unsure[1]
                between += gain[0] * gain[1] * B[0, 1]
                total[1] = rest[1] + leverage(g[1], F, other)
                total[0] = rest[0] + leverage(g[0], F, weight)
                total[2] = between
                for i in range(p):
                    total[2] += weight[i] * other[i]
                if axle == 0 and not fixed:
                    for b in range(2):
                        out[k, EXPECTED + b] = expected[b]
                        out[k, EXPECTED_SD + b] = math.sqrt(total[b])
            if what == MISSING:
                continue
            mean = expected[axle]
            for i in range(p):
                mean += g[axle, i] * m[i]
            S = total[axle]
            if axle == 1 and both:  # given the front's, whether or not the parameters learnt of it
                S -= total[2] * total[2] / total[0]
                mean = behind + total[2] / total[0] * ahead
            value = steps.reading[k, axle]
            if what == VALUE:
                nu = value - mean
                ratio = nu * nu / S
                memory[LOG_P] -= 0.5 * (_LOG_2PI + math.log(S) + ratio)
                if not fixed:
                    out[k, INNOVATION + axle] = nu / math.sqrt(S)
                    if unsure[axle] < _SURE * S:
                        learn_level(memory, rules, axle, ratio, level[axle])
                        listen(state.echo[axle], nu / math.sqrt(S), rules)
                        nis += ratio
                        count += 1
                if ratio > rules.gate:
                    more = S * (ratio / rules.gate - 1.0)
                    rest[axle] += more
                    S += more
                apart = value - expected[axle]
                memory[SCORE] += math.log(rest[axle]) + apart * apart / rest[axle]
            else:
                sign = 1.0 if what == AT_LEAST else -1.0
                z = sign * (value - mean) / math.sqrt(S)
                if z > 0.0 and z * z > rules.gate:  # as far beyond belief as a value would be
                    more = S * (z * z / rules.gate - 1.0)
                    rest[axle] += more
                    S += more
                    z = math.sqrt(rules.gate)
                root = math.sqrt(S)
                log_tail, hazard = upper_tail(z)
                memory[LOG_P] += log_tail
                memory[SCORE] -= 2.0 * log_tail
                shrink = hazard * (hazard - z)
                if shrink < 1e-12:
                    continue  # far inside: it says nothing
                # the value with the noise that would move mean and variance as the bound does
                value = mean + sign * hazard * root / shrink
                more = S * (1.0 / shrink - 1.0)
                rest[axle] += more
                S += more
            if axle == 0 and both:
                total[0] = S
                ahead = value - mean
                behind = expected[1]
                for i in range(p):
                    behind += g[1, i] * m[i]
            leverage(g[axle], F, weight)
            if learns:
                memory[LOST] += 0.5 * math.log(S / rest[axle])
            take(
                value, expected[axle], g[axle], PC[axle], rest[axle], x, J, m, F, Pi, weight, room,
                learns,
            )  # fmt: skip
            if axle == 0 and both:  # what the front said of the rear
                share = between / rest[0]
                expected[1] += share * (value - expected[0])
                rest[1] -= share * between
                for i in range(p):
                    g[1, i] -= share * g[0, i]
                for a in range(10):
                    PC[1, a] -= share * PC[0, a]
        if fixed:
            continue
        if steps.kind[k, 0] != MISSING or steps.kind[k, 1] != MISSING:
            follow(mu, D, x, J, m, F)
            placed = False
        if count > 0:
            doubt(state, rules.coloured)
        _tell(state, level, nis, count, out[k])
        keep_safe(state, rules.sudden, h)
        memory[CLOCK] += h
        worst = max(memory[QUICK], memory[QUICK + 1])
        memory[BROKEN] = memory[BROKEN] + h if worst > rules.broken else 0.0
        if memory[BROKEN] > rules.patience:
            return UPSET, k + 1
        if memory[LOST] > rules.learned:
            return LEARNED, k + 1
        if memory[CLOCK] > rules.look:
            return LOOK, k + 1
    return DONE, steps.step.shape[0]


@njit(**OPTIONS)
def _moved_along(slope: Array, phi: Array, gamma: Array) -> None:
    """Carry the state's derivative (10,) along a direction that changes no car over a step."""
    a0, a1, a2, a3, wf, wr = slope[0], slope[1], slope[2], slope[3], slope[6], slope[7]
    for a in range(4):
        slope[a] = (
            phi[a, 0] * a0 + phi[a, 1] * a1 + phi[a, 2] * a2 + phi[a, 3] * a3
            + gamma[a, 0] * wf + gamma[a, 1] * wr
        )  # fmt: skip


@njit(**OPTIONS)
def _tell(state: State, level: Array, nis: float, count: int, row: Array) -> None:
    """Fill a row of what is told, the reference being at the estimate."""
    for q in range(3):
        total = 0.0
        for i in range(q + 1):
            total += state.D[i, q] * state.D[i, q]
        row[MEAN + q] = state.mu[q]
        row[DEVIATION + q] = math.sqrt(total)
    for axle in range(2):
        total = state.Pi[2 * axle, 2 * axle]
        for i in range(state.mu.shape[0]):
            total += state.J[i, 2 * axle] * state.J[i, 2 * axle]
        row[DEFLECTION + axle] = state.x[2 * axle]
        row[DEFLECTION_SD + axle] = math.sqrt(total)
        row[LEVEL + axle] = level[axle]
    row[NIS] = nis
    row[READINGS] = count
    row[DOUBT] = state.memory[DOUBTED]
