"""Suspension terms: what one axle's springs, dampers, stops and friction do to the chassis.

A law is a tuple of terms and its force is their sum. Every term gives the upward force on the
chassis (N) from the deflection ``delta`` (m, extension positive, zero at rest), its rate
``delta_dot`` (m/s) and the time ``t`` (s). The static load is left out: a law is zero at rest.

The functional forms are chosen to differ from the ones the estimator writes down (smooth
transitions, tanh, sinh, splines), while their parameters keep the meaning of
``docs/interfaces.md``, so that an answer can be compared with the truth.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import PchipInterpolator

from . import kinds
from .compiled import native_address
from .units import INCH

__all__ = [
    "AsymmetricDamper",
    "BoucWen",
    "Coulomb",
    "CurveDamper",
    "CurveSpring",
    "CustomLaw",
    "DigressiveDamper",
    "FadingDamper",
    "Lash",
    "LinearDamper",
    "LinearSpring",
    "MaxwellMount",
    "MountedCurve",
    "Packed",
    "PositionDamper",
    "QuadraticDamper",
    "SinhSpring",
    "SmoothStop",
    "Term",
]


@dataclass(frozen=True)
class Packed:
    """One term as the kernel reads it.

    Attributes
    ----------
    kind : int
        A number of :mod:`.kinds`.
    parameters : tuple of float
        At most six, SI, in the order the kernel expects.
    table : tuple of float
        Knots and coefficients of a curve, empty otherwise.
    states : int
        How many states of its own the term carries.
    address : int
        Address of a native ``double f(double, double, double)``, 0 if none.
    """

    kind: int
    parameters: tuple[float, ...]
    table: tuple[float, ...] = ()
    states: int = 0
    address: int = 0


class Term(Protocol):
    """Anything that adds a force between chassis and wheel of one axle."""

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        ...


@dataclass(frozen=True)
class LinearSpring:
    """F = -k delta, with ``k`` in N/m."""

    k: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.SPRING, (self.k,))


@dataclass(frozen=True)
class LinearDamper:
    """F = -c delta_dot, with ``c`` in N s/m."""

    c: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.DAMPER, (self.c,))


@dataclass(frozen=True)
class AsymmetricDamper:
    """Bound and rebound differ, with a rounded corner between them.

    F = -c v - c (ratio - 1)/(ratio + 1) (sqrt(v^2 + b^2) - b)

    Attributes
    ----------
    c : float
        Mean of both rates, N s/m.
    ratio : float
        Rebound (extension) rate over bound rate, far from the corner.
    blend : float
        Speed ``b`` over which the corner is rounded, m/s.
    """

    c: float
    ratio: float
    blend: float = 0.03

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        half = self.c * (self.ratio - 1.0) / (self.ratio + 1.0)
        return Packed(kinds.ASYMMETRIC, (self.c, half, self.blend))


@dataclass(frozen=True)
class DigressiveDamper:
    """F = -c knee tanh(v/knee): slope ``c`` (N s/m) at rest, c·knee far out; ``knee`` in m/s."""

    c: float
    knee: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.DIGRESSIVE, (self.c, self.knee))


@dataclass(frozen=True)
class Coulomb:
    """F = -force tanh(v/slip): dry friction of ``force`` N, smoothed over ``slip`` m/s."""

    force: float
    slip: float = 0.01

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.COULOMB, (self.force, self.slip))


@dataclass(frozen=True)
class SinhSpring:
    """F = -k s sinh(delta/s), which is -k delta (1 + kappa delta^2 + ...) with s = 1/sqrt(6 kappa).

    Attributes
    ----------
    k : float
        Slope at rest, N/m.
    kappa : float
        Leading stiffening, 1/m^2, positive.
    """

    k: float
    kappa: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.SINH_SPRING, (self.k, 1.0 / math.sqrt(6.0 * self.kappa)))


@dataclass(frozen=True)
class SmoothStop:
    """A travel stop that comes in gradually (softplus), added to whatever else acts.

    Attributes
    ----------
    gap : float
        Travel from rest to the stop, m, positive.
    rate : float
        Slope well beyond the stop, N/m.
    droop : bool
        False: the stop is met in compression (bump). True: in extension.
    width : float
        Travel over which it comes in, m.
    """

    gap: float
    rate: float
    droop: bool = False
    width: float = 0.1 * INCH

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        # what the softplus leaves at rest is taken off, so that rest stays an equilibrium
        at_rest = self.width * math.log1p(math.exp(-self.gap / self.width))
        sign = 1.0 if self.droop else -1.0
        return Packed(kinds.STOP, (self.gap, self.rate, sign, self.width, at_rest))


@dataclass(frozen=True)
class FadingDamper:
    """F = -c (1 - loss g(t)) v, where g rises from 0 at 0 s to 1 at ``duration``, levelling off.

    Attributes
    ----------
    c : float
        Rate at the start of the run, N s/m.
    loss : float
        Share gone after ``duration``.
    duration : float
        Length of the run, s.
    """

    c: float
    loss: float
    duration: float = 2.0

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.FADE, (self.c, self.loss, self.duration))


@dataclass(frozen=True)
class CurveDamper:
    """A measured damper curve: force against rate through given points.

    Attributes
    ----------
    rate : tuple of float
        Knots, m/s, rising; extension positive.
    force : tuple of float
        Force that the damper holds against the motion, N (rising with the rate); the chassis
        feels its negative. Monotone cubic between knots, straight beyond them.
    """

    rate: tuple[float, ...]
    force: tuple[float, ...]

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return _pack_curve(kinds.CURVE_RATE, self.rate, self.force)


@dataclass(frozen=True)
class CurveSpring:
    """A measured spring curve: as :class:`CurveDamper`, but against ``travel`` in m."""

    travel: tuple[float, ...]
    force: tuple[float, ...]

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return _pack_curve(kinds.CURVE_TRAVEL, self.travel, self.force)


@dataclass(frozen=True)
class PositionDamper:
    """F = -c (1 + growth delta^2) v; ``c`` in N s/m at rest, ``growth`` in 1/m^2."""

    c: float
    growth: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.POSITION_DAMPER, (self.c, self.growth))


@dataclass(frozen=True)
class QuadraticDamper:
    """F = -c2 v sqrt(v^2 + b^2): turbulent damping, ``c2`` in N s^2/m^2, ``b`` in m/s."""

    c2: float
    blend: float = 0.01

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.QUADRATIC, (self.c2, self.blend))


@dataclass(frozen=True)
class MaxwellMount:
    """A damper ``c`` (N s/m) in series with a rubber mount ``k_mount`` (N/m): one state."""

    c: float
    k_mount: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.MAXWELL, (self.c, self.k_mount), states=1)


@dataclass(frozen=True)
class MountedCurve:
    """A damper with a measured curve (as :class:`CurveDamper`) in series with a stiffness.

    It has one state of its own.

    Attributes
    ----------
    rate, force : tuple of float
        Knots of the curve, m/s, and the damper's force there, N, both rising.
    k_mount : float
        Stiffness, N/m.
    """

    rate: tuple[float, ...]
    force: tuple[float, ...]
    k_mount: float

    def pack(self) -> Packed:
        """Return the form the kernel reads: rate over force, the curve from its other side."""
        inverse = _pack_curve(kinds.MOUNTED_CURVE, self.force, self.rate)
        parameters = (*inverse.parameters, self.k_mount)
        return Packed(kinds.MOUNTED_CURVE, parameters, inverse.table, states=1)


@dataclass(frozen=True)
class Lash:
    """A damper ``c`` whose rod end has play: nothing is felt within it, then bushing and damper.

    F = -k_end (e - play tanh(e/play)) with e = delta - s and c s' = -F: one state, the damper's.

    Attributes
    ----------
    c : float
        Damper, N s/m.
    play : float
        Free travel to either side, m.
    k_end : float
        Stiffness of the rod end beyond it, N/m; k_end over c times the internal step has to stay
        below 2.
    """

    c: float
    play: float
    k_end: float

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.LASH, (self.c, self.k_end, self.play), states=1)


@dataclass(frozen=True)
class BoucWen:
    """Hysteretic friction F = -force z, z' = (v - (beta |v| z + (1-beta) v |z|) |z|)/travel.

    Attributes
    ----------
    force : float
        Force at which it slips, N.
    travel : float
        Travel over which it yields, m.
    beta : float
        Shape of the loop, 0.5 to 1.
    """

    force: float
    travel: float = 0.002
    beta: float = 0.7

    def pack(self) -> Packed:
        """Return the form the kernel reads."""
        return Packed(kinds.BOUC_WEN, (self.force, self.travel, self.beta), states=1)


@dataclass(frozen=True)
class CustomLaw:
    """Any function ``F(delta, delta_dot, t)`` of floats that returns a force in N.

    Attributes
    ----------
    function : callable
        Upward force on the chassis. Must be zero at rest.
    native : bool
        True compiles it (numba; about 0.1 s once a process, then full speed). False calls it
        as plain Python (any code at all, about 0.3 s for a run of 2 s).
    """

    function: Callable[[float, float, float], float]
    native: bool = True
    _alive: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def pack(self) -> Packed:
        """Return the form the kernel reads; the callback is kept alive with the term."""
        if "address" not in self._alive:
            if self.native:
                self._alive["callback"], address = native_address(self.function)
            else:
                shape = ctypes.CFUNCTYPE(ctypes.c_double, *([ctypes.c_double] * 3))
                callback = shape(self.function)
                self._alive["callback"] = callback
                address = int(ctypes.cast(callback, ctypes.c_void_p).value or 0)
            self._alive["address"] = address
        return Packed(kinds.CUSTOM, (), address=self._alive["address"])


def _pack_curve(kind: int, abscissa: tuple[float, ...], force: tuple[float, ...]) -> Packed:
    """Turn points into piecewise cubics: knots first, then four coefficients a piece."""
    knots = np.asarray(abscissa, dtype=np.float64)
    curve = PchipInterpolator(knots, np.asarray(force, dtype=np.float64))
    table = np.concatenate([knots, np.ascontiguousarray(curve.c.T).ravel()])
    # a curve that does not pass through the origin is shifted: rest has to stay an equilibrium
    return Packed(kind, (float(len(knots)), float(curve(0.0))), table=tuple(table.tolist()))
