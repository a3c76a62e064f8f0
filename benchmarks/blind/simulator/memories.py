"""Parts of the suspension that remember: valves, dampers in series, friction, stops, springs.

Each is a mechanism in the sense of ``simulate.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kinds import Vector
from .simulate import Now

__all__ = ["AeratedOil", "BoucWen", "CubicBush", "LateBall", "Relaxing", "Seat", "Strokes", "Zener"]


def _axles(rows: slice) -> int:
    return len(range(2)[rows])


@dataclass(frozen=True)
class LateBall:
    """A check ball that needs ``late`` (s) to close; ``a`` is (ratio − 1)/(ratio + 1)."""

    rows: slice
    c: Vector
    a: Vector
    late: float

    @property
    def states(self) -> int:
        """Place of the ball, from −1 to 1, at each axle."""
        return _axles(self.rows)

    def act(self, now: Now) -> None:
        """Add what the ball adds to the force of the mean damper."""
        rate = now.rate[self.rows]
        now.flow[:] = (rate / (np.abs(rate) + 0.006) - now.aux) / self.late
        now.force[self.rows] -= self.c * self.a * now.aux * rate


@dataclass(frozen=True)
class Zener:
    """A damper behind a mount of rubber: a spring beside a spring with a dashpot.

    ``stiffness`` (rows, B), N/m, is that of the spring alone; the other has 0.6 of it and relaxes
    in 15 ms. Memories are the forces of damper and dashpot.
    """

    rows: slice
    c: Vector
    stiffness: Vector

    @property
    def states(self) -> int:
        """Two for each axle."""
        return 2 * _axles(self.rows)

    def act(self, now: Now) -> None:
        """Replace −c δ̇ by the force of the chain."""
        count = _axles(self.rows)
        damper, dashpot = now.aux[:count], now.aux[count:]
        rate = now.rate[self.rows]
        give = rate - damper / self.c
        now.flow[count:] = 0.6 * self.stiffness * give - dashpot / 0.015
        now.flow[:count] = self.stiffness * give + now.flow[count:]
        now.force[self.rows] += self.c * rate - damper


@dataclass(frozen=True)
class AeratedOil:
    """A damper whose oil carries bubbles: stiff under pressure, soft without.

    ``stiffness`` (rows, B), N/m, is that at rest; ``preload`` (rows, 1), N, is the force whose
    pressure in compression doubles that of the fill.
    """

    rows: slice
    c: Vector
    stiffness: Vector
    preload: Vector

    @property
    def states(self) -> int:
        """Force of the damper at each axle."""
        return _axles(self.rows)

    def act(self, now: Now) -> None:
        """Replace −c δ̇ by the force of the chain."""
        rate = now.rate[self.rows]
        over = 0.5 - now.aux / self.preload
        pressure = 0.5 + 0.5 * (over + np.sqrt(over * over + 0.04))
        give = 0.4 + 0.6 * pressure**-1.2
        now.flow[:] = self.stiffness / give * (rate - now.aux / self.c)
        now.force[self.rows] += self.c * rate - now.aux


@dataclass(frozen=True)
class CubicBush:
    """A damper behind a bush of force K x (1 + (K x/``firm``)²); memory is its deflection x."""

    rows: slice
    c: Vector
    stiffness: Vector
    firm: Vector

    @property
    def states(self) -> int:
        """One for each axle."""
        return _axles(self.rows)

    def act(self, now: Now) -> None:
        """Replace −c δ̇ by the force of the bush."""
        rate = now.rate[self.rows]
        soft = self.stiffness * now.aux
        force = soft * (1.0 + (soft / self.firm) ** 2)
        now.flow[:] = rate - force / self.c
        now.force[self.rows] += self.c * rate - force


@dataclass(frozen=True)
class BoucWen:
    """Friction that sticks elastically: ``size`` (N), and the ``give`` (m) before it slides.

    Its share z grows by (v/give)(1 − z²) where it loads and by v/give where it unloads, the law
    of Bouc and Wen with equal coefficients. Beyond some 0.03 m/s, where it slides, v is held back
    for the sake of the integration.
    """

    rows: slice
    size: Vector
    give: float

    @property
    def states(self) -> int:
        """One for each axle."""
        return _axles(self.rows)

    def act(self, now: Now) -> None:
        """Add the friction."""
        rate, z = now.rate[self.rows], now.aux
        slow = rate / np.hypot(1.0, rate / 0.03)
        now.flow[:] = slow / self.give * (1.0 - np.where(slow * z > 0.0, z * z, 0.0))
        now.force[self.rows] -= self.size * z


@dataclass(frozen=True)
class Relaxing:
    """A stop of rubber of which 0.4 relaxes in ``fades`` (s); ``sign`` is −1 in compression.

    ``gap`` (B,), m; ``first`` is the rate that holds, N/m. Memory is the force that relaxes.
    """

    rows: slice
    sign: float
    first: float
    gap: Vector
    fades: float

    @property
    def states(self) -> int:
        """One for each axle."""
        return _axles(self.rows)

    def act(self, now: Now) -> None:
        """Push away from the stop."""
        d = self.sign * now.delta[self.rows] - self.gap
        inside = d > 0.0
        speed = self.sign * now.rate[self.rows]
        lead = 0.4 / 0.6 * self.first
        now.flow[:] = np.where(inside, lead * speed, 0.0) - now.aux / self.fades
        push = np.maximum(self.first * d + now.aux, 0.0)
        now.force[self.rows] -= self.sign * np.where(inside, push, 0.0)


class Strokes:
    """A damper that foams as it strokes: memory is the way it has gone, m.

    ``size`` of its rate is lost when it has gone ``whole`` (rows, 1), m.
    """

    def __init__(self, rows: slice, c: Vector, size: Vector, whole: Vector) -> None:
        self.rows, self.c, self.size, self.whole = rows, c, size, whole
        self.states = _axles(rows)

    def lost(self, way: Vector) -> Vector:
        """Share of the rate that is lost behind a way, m."""
        return np.asarray(self.size * (way / self.whole) ** 0.85)

    def act(self, now: Now) -> None:
        """Take away the lost share of the damper force."""
        rate = now.rate[self.rows]
        now.flow[:] = np.sqrt(rate * rate + 1e-8) - 1e-4
        now.force[self.rows] += self.c * self.lost(np.maximum(now.aux, 0.0)) * rate


class Seat:
    """A spring that stands on, or works beside, something that yields in time.

    With ``relaxes`` (s) a further spring of share ``size`` works beside it and relaxes; without,
    a seat with the compliance ``size``/k is in series, with a dashpot of ``lag`` (s).
    """

    def __init__(self, rows: slice, k: float, size: Vector, relaxes: float, lag: float) -> None:
        self.rows, self.k, self.size = rows, k, size
        self.relaxes, self.lag = relaxes, lag
        self.states = _axles(rows)

    def act(self, now: Now) -> None:
        """Add what changes in the force of the spring."""
        if self.relaxes:
            gain = self.k * self.size * now.rate[self.rows]
            now.flow[:] = gain - now.aux / self.relaxes
            now.force[self.rows] -= now.aux
            return
        # seat deflection x: (k/size)(x + lag ẋ) = k (δ − x)
        now.flow[:] = (self.size * (now.delta[self.rows] - now.aux) - now.aux) / self.lag
        now.force[self.rows] += self.k * now.aux
