"""How much of a fault is left when any one listed effect may explain it.

The nearest linear half car is found as for the strength. Each effect of the page adds to it what
it does to readings, in first order and with free amplitudes; the least squared distance that
remains says how far an unlisted fault is from all listed ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from .declared import Declared
from .kinds import CHANNELS, Vector
from .scene import Scene
from .sizing import Built
from .strength import Fit, mobility

__all__ = ["Left", "left_by_each", "told"]

FURTHER = 9.0
"""Squared distance by which the right name is nearer than any other, at least."""

MOST_OWN = 0.3
"""Largest share of the strength that the right name leaves."""

CURVES = ("damper_curve", "spring_curve")

FREE = 1e3
"""Factor on a given value's standard deviation that sets it free."""


class Left(NamedTuple):
    """An effect, its place, and the squared distance that it leaves."""

    effect: str
    where: str
    left: float


class _Driven(NamedTuple):
    """Deflection (m), rate (m/s) and elapsed share of one axle in one run, at the rows."""

    delta: Vector
    rate: Vector
    share: Vector
    step: float


def _driven(scene: Scene, built: Built, axle: int) -> list[_Driven]:
    found = []
    for run in range(2):
        history, times = built.histories[run], scene.times[run]
        delta = np.interp(times, history.times, history.delta[:, axle, 0])
        rate = np.interp(times, history.times, history.rate[:, axle, 0])
        found.append(_Driven(delta, rate, times / times[-1], float(times[1])))
    return found


def _late(x: Vector, step: float, lag: float) -> Vector:
    keep = float(np.exp(-step / lag))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], x, axis=0))


def _hinges(x: Vector, most: float) -> Vector:
    """Columns of a free curve: hinges at shares of the largest value, both ways."""
    places = most * np.array([0.0, 0.06, 0.15, 0.3, 0.5, 0.75])
    up = np.maximum(x[:, None] - places, 0.0)
    down = np.minimum(x[:, None] + places, 0.0)
    return np.hstack([up, down])


def _shapes(runs: Sequence[_Driven]) -> Iterator[tuple[str, list[Vector]]]:
    """Names of effects, and the forces (N, columns) of each run that they add at an axle."""
    speed = max(float(np.max(np.abs(r.rate))) for r in runs)
    travel = max(float(np.max(np.abs(r.delta))) for r in runs)
    for slip in (0.004, 0.01, 0.02):
        yield "coulomb_friction", [(r.rate / np.hypot(r.rate, slip))[:, None] for r in runs]
    for seat in (0.008, 0.015, 0.03):
        yield "bound_rebound", [(r.rate**2 / np.hypot(r.rate, seat))[:, None] for r in runs]
    for knee in speed * np.array([0.03, 0.08, 0.2, 0.5, 1.2]):
        lost = [r.rate * (1.0 - 1.0 / np.hypot(1.0, r.rate / knee)) for r in runs]
        yield "digressive_damper", [x[:, None] for x in lost]
    for lag in (0.001, 0.003, 0.008, 0.02):
        yield "damper_hysteresis", [(_late(r.rate, r.step, lag) - r.rate)[:, None] for r in runs]
    bent = [(r.delta / travel) ** 3 for r in runs]
    yield (
        "progressive_spring",
        [np.stack([x, x * (r.delta / travel) ** 2], 1) for x, r in zip(bent, runs, strict=True)],
    )
    for sign, name in ((-1.0, "bump_stop"), (1.0, "droop_stop")):
        most = max(float(np.max(sign * r.delta)) for r in runs)
        for gap in most * np.array([0.2, 0.35, 0.5, 0.65, 0.8, 0.9]):
            over = [sign * r.delta - gap for r in runs]
            met = [0.5 * (x + np.hypot(x, 0.002)) for x in over]
            yield name, [np.stack([x, x * x], 1) for x in met]
    yield "damper_fade", [np.stack([r.rate * r.share, r.rate * r.share**2], 1) for r in runs]
    yield "damper_curve", [_hinges(r.rate, speed) for r in runs]
    yield "spring_curve", [_hinges(r.delta, travel) for r in runs]


class _Judge:
    """Readings with a fault beside their nearest linear car."""

    def __init__(self, scene: Scene, built: Built) -> None:
        self.scene, self.stick = scene, scene.yardstick
        self.declared = built.declared
        self.rows = [scene.pure(built.motions[n], n, built.sensing) for n in range(2)]
        self.best: Fit = self.stick.fit(self.rows, self.declared)
        whole = np.vstack([self.best.slope, self.best.prior_slope])
        self.basis, _ = np.linalg.qr(whole)
        self.rest = self._clear(np.concatenate([self.best.misfit, self.best.prior]))

    def _clear(self, x: Vector) -> Vector:
        return np.asarray(x - self.basis @ (self.basis.T @ x))

    def left(self, columns: Vector) -> float:
        """Squared distance that remains beside changes (whitened, one a column)."""
        padded = np.vstack([columns, np.zeros((4, columns.shape[1]))])
        clear = self._clear(padded)
        scale = np.linalg.norm(clear, axis=0)
        clear = clear[:, scale > 0.0] / scale[scale > 0.0]
        answer = np.linalg.lstsq(clear, self.rest, rcond=1e-8)[0]
        gap = self.rest - clear @ answer
        return float(gap @ gap)

    def read(self, rows: Sequence[Vector]) -> Vector:
        """Whitened change (N, 1) for a change of the readings."""
        inputs = [run.inputs(y) for run, y in zip(self.stick.runs, rows, strict=True)]
        p = self.stick.truth * np.exp(self.best.q)
        parts = [
            run.misfit(p, u, y) for run, u, y in zip(self.stick.runs, inputs, rows, strict=True)
        ]
        return np.concatenate(parts)[:, None]

    def pushed(self, axle: int, forces: Sequence[Vector]) -> Vector:
        """Whitened changes (N, columns) for forces (rows, columns) on the chassis at an axle."""
        p = self.stick.truth * np.exp(self.best.q)
        parts = []
        for run, force in zip(self.stick.runs, forces, strict=True):
            gives = mobility(p, run.length)
            frequency = np.fft.rfftfreq(len(force), 1.0 / run.rate)
            s = 2j * np.pi * frequency[:, None, None]
            matrix = s * s * np.eye(2) + gives * p[5:7] + s * (gives * p[0:2])
            answer = s * s * np.linalg.solve(matrix, np.broadcast_to(gives, matrix.shape))
            spectrum = np.fft.rfft(force, axis=0)
            through = [answer[:, n, axle] for n in range(2)]
            for n, channel in enumerate(("front_chassis", "rear_chassis")):
                sensor = run.sensors[channel]
                through[n] = through[n] * np.exp(s[:, 0, 0] * sensor.delay)
                if sensor.corner is not None:
                    through[n] = through[n] / (1.0 + 1j * frequency / sensor.corner)
            moved = [np.fft.irfft(t[:, None] * spectrum, len(force), axis=0) for t in through]
            columns = [
                run.whitened(np.stack([moved[0][:, n], moved[1][:, n]], 1))
                for n in range(force.shape[1])
            ]
            block = np.stack(columns, 1)
            parts.append(block - run.basis @ (run.basis.T @ block))
        return np.concatenate(parts)


def _sensor_effects(judge: _Judge) -> Iterator[Left]:
    rows, times = judge.rows, judge.scene.times
    slopes = [np.gradient(y, float(t[1]), axis=0) for y, t in zip(rows, times[:2], strict=True)]
    lags = {}
    for number, channel in enumerate(CHANNELS):
        pick = np.zeros(4)
        pick[number] = 1.0
        lags[channel] = judge.read([d * pick for d in slopes])
        yield Left("sensor_lag", channel, judge.left(lags[channel]))
        yield Left("sensor_gain", channel, judge.left(judge.read([y * pick for y in rows])))
        drift = [t[:, None] * pick for t in times[:2]]
        yield Left("sensor_drift", channel, judge.left(judge.read(drift)))
        corner = judge.declared.sensors[channel].corner
        if corner is not None:
            pace = 1.0 / (2.0 * np.pi * corner)
            slower = [
                (y - _late(y, float(t[1]), pace)) * pick
                for y, t in zip(rows, times[:2], strict=True)
            ]
            yield Left("sensor_bandwidth", channel, judge.left(judge.read(slower)))
    for group, part in (("body", "chassis"), ("front", "front")):
        late = np.sum([x for c, x in lags.items() if part in c], 0)
        yield Left("clock_offset", group, judge.left(late))


def _given_effects(judge: _Judge) -> Iterator[Left]:
    names = (
        ("weight_distribution", "", 1),
        ("spring_rate", "front", 2),
        ("spring_rate", "rear", 3),
    )
    for name, where, number in names:
        sds = list(judge.declared.sds)
        sds[number] *= FREE
        free: Declared = replace(judge.declared, sds=(sds[0], sds[1], sds[2], sds[3]))
        yield Left(name, where, judge.stick.distance(judge.rows, free))


def _tone(judge: _Judge) -> Left:
    """Return the strongest tone, as forces at both axles with phases of their own in each run."""
    run = judge.stick.runs[0]
    frequency = np.fft.rfftfreq(len(run.times), 1.0 / run.rate)
    first = judge.best.misfit[: 4 * len(frequency)]
    power = np.sum(first.reshape(2, len(frequency), 2) ** 2, (0, 2))
    tone = float(frequency[int(np.argmax(power))])
    columns = []
    for axle in range(2):
        for number in range(2):
            waves = []
            for n, times in enumerate(judge.scene.times[:2]):
                turn = 2.0 * np.pi * tone * times
                waves.append(np.stack([np.cos(turn), np.sin(turn)], 1) * float(n == number))
            columns.append(judge.pushed(axle, waves))
    return Left("engine_vibration", f"{tone:.1f} Hz", judge.left(np.hstack(columns)))


def left_by_each(scene: Scene, built: Built) -> list[Left]:
    """Squared distance that each listed effect leaves of a fault, least first."""
    judge = _Judge(scene, built)
    found = [*_sensor_effects(judge), *_given_effects(judge), _tone(judge)]
    pushes = []
    for axle, where in enumerate(("front", "rear")):
        shapes = list(_shapes(_driven(scene, built, axle)))
        pushes.append([(name, judge.pushed(axle, force)) for name, force in shapes])
        found += [Left(name, where, judge.left(change)) for name, change in pushes[-1]]
    for (name, front), (_, rear) in zip(*pushes, strict=True):
        found.append(Left(name, "both", judge.left(np.hstack([front, rear]))))
    return sorted(found, key=lambda one: one.left)


def told(scene: Scene, built: Built, name: str, where: str | None) -> bool:
    """Whether a listed effect at a place explains a fault, and clearly better than any other.

    A push is taken as it is: it has no form that is linear in all but its size. The curves of
    dampers and springs contain other effects and are no rivals, nor is the same effect of the
    suspension at both axles, nor the drift of the other sensor at the same end of the car, which
    the pages say looks the same.
    """
    if name == "external_force":
        return True
    found = left_by_each(scene, built)
    sensing = name.startswith(("sensor_", "clock_"))
    placed = sensing or name not in ("engine_vibration", "weight_distribution")
    mine = [x for x in found if x.effect == name and (x.where == where or not placed)]
    rivals = [x for x in found if x.effect not in (name, *CURVES)]
    if sensing:
        end = str(where).partition("_")[0] if name == "sensor_drift" else "no"
        others = [x for x in found if x.effect == name and x.where != where]
        rivals += [x for x in others if not x.where.startswith(end)]
    own, other = mine[0].left, min(x.left for x in rivals)
    wasted = own - scene.yardstick.base
    return other > own + FURTHER and wasted < MOST_OWN * built.strength
