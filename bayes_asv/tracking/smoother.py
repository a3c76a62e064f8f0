"""What is known of each row in the light of all that came after it, for replays.

The Rauch–Tung–Striebel recursion over the same filter (unscented: Särkkä 2008).  What a step does
to parameters and states comes from the sigma points, as in the filter; going back, a gain carries
what later readings changed::

    G = Cov(s_k, s_{k+1}) P⁻¹_{k+1}    s_k ← s_k + G (s_{k+1} − s⁻_{k+1})

The stretch in which the parameters were found is smoothed with them at their estimate: there the
filter itself looked back (:mod:`bayes_asv.tracking.relinearization`).
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.discretization import ORDER, TAYLOR, series, transition
from bayes_asv.filters.kalman import MISSING
from bayes_asv.filters.ukf import run
from bayes_asv.filters.ukf_state import COLUMNS, Model, Rules, State, Steps
from bayes_asv.tracking.filter import Filter
from bayes_asv.tracking.prior_state import RULES, beginning, copied, model_of
from bayes_asv.tracking.relinearization import cut
from bayes_asv.tracking.sensor_noise import heard_level
from bayes_asv.tracking.streaming_timeline import Layout
from bayes_asv.tracking.tracker import tracker_for

__all__ = ["Smoothed", "smoothed", "smoothed_states"]

Array = NDArray[np.float64]

_BLOCK = 2000  # steps whose states are kept at a time
_X = 10  # states beside the parameters


@dataclass(frozen=True)
class Smoothed:
    """What all readings say of each of N rows; SI units.

    Parameters
    ----------
    time : (N,) array
        Stamps, s.
    median, log_sd : (N, 3) arrays
        Medians of c_f, c_r (N·s/m) and i (kg·m²), and the deviations of their logarithms.
    deflection, deflection_sd : (N, 2) arrays
        Front and rear suspension deflection, m, extension positive, and its deviation.
    """

    time: Array
    median: Array
    log_sd: Array
    deflection: Array
    deflection_sd: Array


@dataclass
class _Belief:
    """Mean and covariance of (θ, s)."""

    mean: Array
    covariance: Array

    @classmethod
    def of(cls, state: State) -> _Belief:
        p = len(state.mu)
        both = np.hstack([state.D, state.J])
        covariance = both.T @ both
        covariance[p:, p:] += state.Pi
        return cls(np.concatenate([state.mu, state.x]), covariance)


def smoothed(recording: Recording, vehicle: Vehicle, *, forget: float | None = None) -> Smoothed:
    """Smooth a recording.

    Parameters
    ----------
    recording : Recording
        As read.
    vehicle : Vehicle
        The car.
    forget : float, optional
        As :class:`bayes_asv.tracking.tracker.Tracker` takes it.

    Returns
    -------
    Smoothed

    Raises
    ------
    InputError
        When a channel is in counts and the vehicle lacks its calibration.
    """
    acc = accelerations(recording, vehicle).T
    tracker = tracker_for(recording, vehicle, forget=forget)
    sensors = tracker.sensing
    noise = sensors.noise.copy()
    for c in np.flatnonzero(~np.isfinite(noise)):
        noise[c] = heard_level(acc[:, c], sensors.steps[c])
    sensors = type(sensors)(**{**vars(sensors), "noise": noise})
    layout = Layout(vehicle, sensors, tracker.rate, tracker.timing)
    parts = [layout.push(recording.time, acc), layout.finish()]
    steps = Steps(*(np.concatenate(x) for x in zip(*(p.steps for p in parts), strict=True)))
    place = np.concatenate([p.rows.step for p in parts]).max(axis=1)
    where = tracker.coordinates
    model = model_of(where, sensors.kernel_noise(), forget)
    means, deviations = smoothed_states(model, steps)
    place = np.maximum.accumulate(np.maximum(place, 0))
    p = len(where)
    return Smoothed(
        time=recording.time.copy(),
        median=np.exp(where.logs(means[place, :3])),
        log_sd=where.scale[:3] * deviations[place, :3],
        deflection=means[place][:, [p, p + 2]],
        deflection_sd=deviations[place][:, [p, p + 2]],
    )


def smoothed_states(model: Model, steps: Steps, rules: Rules = RULES) -> tuple[Array, Array]:
    """Means and deviations (N, p + 10) of parameters and states after each step.

    Parameters
    ----------
    model : Model
        Car and sensors.
    steps : Steps
        N steps of a whole recording.
    rules : Rules
        When the filter doubts its noise.
    """
    n, p = len(steps.step), len(model.which)
    means, deviations = np.empty((n, p + _X)), np.empty((n, p + _X))
    head = Filter(model, rules=rules)
    known = 0
    while known < n and head.looking_back:
        head.advance(cut(steps, known, known + 1))
        known += 1
    marks = [copy.deepcopy(head)]  # what the filter was at the beginning of each block
    for first in range(known, n, _BLOCK):
        marks.append(copy.deepcopy(marks[-1]))
        marks[-1].advance(cut(steps, first, min(first + _BLOCK, n)))
    belief = _Belief.of(marks[-1].state)
    for mark, first in reversed(list(zip(marks, range(known, n, _BLOCK), strict=False))):
        last = min(first + _BLOCK, n)
        states, broken = _recorded(mark, steps, first, last)
        for k in range(last - 1, first - 1, -1):
            means[k], deviations[k] = belief.mean, np.sqrt(np.diag(belief.covariance))
            before = states[k - first]
            if broken[k - first]:
                belief = _across(before, belief, p)
            else:
                belief = _back(before, belief, model, cut(steps, k, k + 1), mark.rules)
    if known:
        _found(belief, model, steps, known, head.rules, means, deviations)
    return means, deviations


def _recorded(
    filter_: Filter, steps: Steps, first: int, last: int
) -> tuple[list[State], list[bool]]:
    """States before each step of a block, and whether the filter began anew behind it."""
    working = copy.deepcopy(filter_)
    states, broken = [], []
    for k in range(first, last):
        states.append(copied(working.state))
        resets = len(working.resets)
        working.advance(cut(steps, k, k + 1))
        broken.append(len(working.resets) != resets)
    return states, broken


def _back(before: State, after: _Belief, model: Model, step: Steps, rules: Rules) -> _Belief:
    """Carry what is known after a step to before it."""
    p = len(before.mu)
    now = _Belief.of(before)
    predicted, flow = _predicted(before, model, step, rules)
    then = _Belief.of(predicted)
    own, walked = now.covariance[:p, :p], then.covariance[:p, :p]
    between = now.covariance[:p, p:]  # θ with s
    if p:
        kept = np.linalg.solve(walked, own).T  # P (P + Q)⁻¹
        slope = np.linalg.solve(predicted.D, predicted.J).T  # s⁻ by θ
        rest = now.covariance[p:, p:] - between.T @ np.linalg.solve(walked, between)
    else:
        kept, slope, rest = own, np.zeros((_X, 0)), now.covariance[p:, p:]
    joint = np.zeros((p + _X, p + _X))  # Cov(before, predicted)
    joint[:p, :p] = own
    joint[:p, p:] = own @ slope.T + (between - kept @ between) @ flow.T
    joint[p:, :p] = between.T
    joint[p:, p:] = between.T @ slope.T + rest @ flow.T
    P = then.covariance.copy()
    dead = np.flatnonzero(np.diag(P) <= 0.0)  # a sensor without a filter has no slow noise
    P[dead, dead] = 1.0
    gain = np.linalg.solve(P, joint.T).T
    covariance = now.covariance + gain @ (after.covariance - then.covariance) @ gain.T
    return _Belief(
        now.mean + gain @ (after.mean - then.mean), 0.5 * (covariance + covariance.T)
    )  # fmt: skip


def _predicted(before: State, model: Model, step: Steps, rules: Rules) -> tuple[State, Array]:
    """Foretell a step: what the filter expects, and how it carries the state given θ."""
    state = copied(before)
    blind = step._replace(kind=np.full_like(step.kind, MISSING))
    run(0, False, state, model, rules, blind, np.empty((1, COLUMNS)))
    flow = np.zeros((_X, _X))
    flow[4, 4] = flow[5, 5] = 1.0
    h = float(step.step[0])
    if step.afresh[0]:
        return state, flow
    if h <= 0.0:
        return state, np.eye(_X)
    car = model.base.copy()
    value = model.centre + model.scale * before.mu
    car[model.which] = np.where(model.log, np.exp(np.where(model.log, value, 0.0)), value)
    C, powers, drive = np.empty((2, 4)), np.empty((TAYLOR + 1, 4, 4)), np.empty((2, ORDER, 4))
    series(car, C, powers, drive)
    gamma, qf, qr, decay = np.zeros((4, 2)), np.zeros((4, 4)), np.zeros((4, 4)), np.ones(6)
    phi = np.zeros((4, 4))
    transition(h, powers, model.noise[8:12], phi, gamma, qf, qr, decay)
    flow[:4, :4], flow[:4, 6:8] = phi, gamma
    flow[range(6, 10), range(6, 10)] = decay[2:]
    return state, flow


def _across(before: State, after: _Belief, p: int) -> _Belief:
    """Across a new beginning the parameters are the same; the motion is what it was."""
    now = _Belief.of(before)
    slope = np.linalg.solve(before.D, before.J).T
    theta, own = after.mean[:p], after.covariance[:p, :p]
    covariance = np.zeros_like(now.covariance)
    covariance[:p, :p] = own
    covariance[p:, :p] = slope @ own
    covariance[:p, p:] = covariance[p:, :p].T
    covariance[p:, p:] = before.Pi + slope @ own @ slope.T
    mean = np.concatenate([theta, before.x + slope @ (theta - before.mu)])
    return _Belief(mean, covariance)


def _found(
    belief: _Belief,
    model: Model,
    steps: Steps,
    known: int,
    rules: Rules,
    means: Array,
    deviations: Array,
) -> None:
    """Fill the stretch in which the parameters were found, with them at their estimate."""
    p = len(model.which)
    theta = belief.mean[:p]
    value = model.centre + model.scale * theta
    base = model.base.copy()
    base[model.which] = np.where(model.log, np.exp(np.where(model.log, value, 0.0)), value)
    none = np.zeros(0)
    fixed = model._replace(
        base=base, which=np.zeros(0, np.int64), log=np.zeros(0, np.bool_), centre=none,
        scale=none, walk=none, doubt=none,
    )  # fmt: skip
    states = []
    state = beginning(fixed)
    still = rules._replace(learned=np.inf, look=np.inf, patience=np.inf)
    for k in range(known):
        states.append(copied(state))
        step = cut(steps, k, k + 1)
        run(0, False, state, fixed, still, step, np.empty((1, COLUMNS)))
    motion = _Belief(belief.mean[p:], belief.covariance[p:, p:])
    sd = np.sqrt(np.diag(belief.covariance)[:p])
    for k in range(known - 1, -1, -1):
        means[k] = np.concatenate([theta, motion.mean])
        deviations[k] = np.concatenate([sd, np.sqrt(np.maximum(np.diag(motion.covariance), 0.0))])
        motion = _back(states[k], motion, fixed, cut(steps, k, k + 1), still)
