"""A car with a little of everything, as data sheets leave it open.

Each deviation is normal with the tolerance that the page of effects states; where a parameter
cannot be negative, it is the size of a normal number.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .blueprint import Blueprint, Outcome, Spans, hull
from .declared import Declared
from .forces import Inertance
from .kinds import AXLES, CHANNELS, Vector, Whole
from .scene import Scene
from .sensors import Motion, Sensing
from .simulate import Mechanism, Now
from .spans import equal_power, records

__all__ = ["tolerances"]


class _Axle:
    """Damper, friction and spring of one axle with their deviations, by the page's laws."""

    states = 0

    def __init__(self, scene: Scene, axle: int, rng: np.random.Generator, runs: Whole) -> None:
        draw = rng.standard_normal(6)
        self.axle, self.c, self.k = axle, scene.car.c[axle], scene.car.k[axle]
        ratio = float(np.exp(0.03 * draw[0]))
        self.a = (ratio - 1.0) / (ratio + 1.0)
        fast = float(np.max(np.abs(scene.history.rate[:, axle])))
        reach = float(np.max(np.abs(scene.history.delta[:, axle])))
        # nonlinearity is proportional to the draw, and at most 3 % over the range used for one
        self.knee = max(2.5, 4.0 * fast) / np.sqrt(max(abs(float(draw[1])), 1e-3))
        self.friction = 0.0015 * scene.car.mean_load * abs(float(draw[2]))
        self.kappa = min(6.0, 0.03 / reach**2) * float(draw[3])
        self.loss = 0.015 * float(draw[4])
        self.factor = float(np.exp(0.003 * draw[5]))
        self.shares = np.stack(
            [np.clip(d.half_times / d.length, 0.0, 1.0) for d in scene.drives], 1
        )[:, runs]

    def damper(self, rate: Vector) -> Vector:
        """Force of the damper against its rate, as at the start of a run, N."""
        uneven = 1.0 + self.a * rate / np.hypot(rate, 0.015)
        lost = 50.0 / 51.0 * (1.0 - 1.0 / np.hypot(1.0, rate / self.knee))
        return np.asarray(self.c * rate * uneven * (1.0 - lost))

    def act(self, now: Now) -> None:
        """Add what differs from −kδ − cδ̇."""
        delta, rate = now.delta[self.axle], now.rate[self.axle]
        damper = self.damper(rate) * (1.0 - self.loss * self.shares[now.half])
        bent = self.kappa * delta**2
        spring = self.k * delta * self.factor * (1.0 + bent + 0.15 * bent**2)
        rub = self.friction * rate / np.hypot(rate, 0.01)
        now.force[self.axle] += self.c * rate + self.k * delta - damper - spring - rub


class _Both:
    """Both axles, with a stiffness of 500 mean spring rates or more behind the dampers."""

    states = 0

    def __init__(self, scene: Scene, seed: int, runs: Whole) -> None:
        rng = np.random.default_rng(seed)
        self.axles = [_Axle(scene, n, rng, runs) for n in range(2)]
        self.lags: list[Inertance] = []
        behind = 500.0 * float(np.mean(scene.car.k))
        for n in range(2):
            soft = abs(float(rng.standard_normal())) / behind
            # a damper that lags by τ = c/K has the force of −cτ of inertia
            inertia = -(scene.car.c[n] ** 2) * soft / scene.car.unsprung[n]
            self.lags.append(Inertance(scene.car, n, np.full(len(runs), inertia)))

    def act(self, now: Now) -> None:
        """Add the forces of both axles."""
        for axle in self.axles:
            axle.act(now)
        for lag in self.lags:
            lag.act(now)


def _straight(at_rest: float, slope: float) -> Callable[[Vector, int], Vector]:
    """Return a constant with a slope in time."""

    def line(times: Vector, run: int) -> Vector:
        return np.asarray(at_rest + slope * times)

    return line


def tolerances(scene: Scene, rng: np.random.Generator) -> Blueprint:
    """All tolerances together; the size has no meaning."""
    seed = int(rng.integers(2**31))
    gain = dict(zip(CHANNELS, np.exp(0.003 * rng.standard_normal(4)), strict=True))
    lag = dict(zip(CHANNELS, 1.5e-5 * rng.standard_normal(4), strict=True))
    slope = dict(zip(CHANNELS, 0.005 * rng.standard_normal(4), strict=True))
    corner = dict(zip(CHANNELS, np.exp(0.02 * rng.standard_normal(4)), strict=True))
    weight = float(np.exp(0.002 * rng.standard_normal()))

    def mechanism(size: Vector, runs: Whole) -> Mechanism:
        return _Both(scene, seed, runs)

    def mount(motion: Motion, run: int) -> Motion:
        felt = {c: a * float(gain[c]) for c, a in motion.acceleration.items()}
        return Motion(motion.begin, motion.step, felt)

    def sensing(size: float) -> Sensing:
        poles: dict[str, tuple[complex, ...]] = {}
        for channel in CHANNELS:
            own = scene.declared.sensors[channel].poles
            if own:
                poles[channel] = (own[0] * float(corner[channel]),)
        late = {c: _straight(float(lag[c]), 0.0) for c in CHANNELS}
        shift = {c: _straight(0.0, float(slope[c])) for c in CHANNELS}
        return Sensing(mount=mount, poles=poles, late=late, shift=shift)

    def declare(size: float) -> Declared:
        return scene.declared.changed(wdf=1.0 / weight).rounded()

    def spans(outcome: Outcome) -> Spans:
        both = _Both(scene, seed, np.arange(1))
        found = []
        for n, axle in enumerate(both.axles):
            runs = records(outcome.histories, scene.drives, [n])
            driven = np.concatenate([run[0].rate for run in runs])
            rates = [scene.car.c[n], equal_power(axle.damper), equal_power(axle.damper, driven)]
            found.append(hull(*rates, *(x * (1.0 - axle.loss) for x in rates)))
        return Spans({}, found[0], found[1])

    return Blueprint(
        "tolerance",
        None,
        f"all at {AXLES[0]} and {AXLES[1]}",
        (1.0, 1.0),
        mechanism=mechanism,
        sensing=sensing,
        declare=declare,
        spans=spans,
    )
