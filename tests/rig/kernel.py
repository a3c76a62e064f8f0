"""Compiled arithmetic: the equations of motion and a classical Runge-Kutta step.

State (absolute, about static equilibrium, up and nose-up positive)::

    0 x       heave of the sprung centre of gravity      4 its rate
    1 theta   pitch                                      5 its rate
    2 u_f     front hub                                  6 its rate
    3 u_r     rear hub                                   7 its rate
    8 y       seat mass                                  9 its rate
    10...     states of the suspension terms

Equations, with F an axle's suspension force on the chassis, E an outside force there, T a tyre's
force above its static value, S the seat's force at position p, and q the place of the centre of
gravity of the chassis without the seat mass::

    m x_q'' = F_f + F_r + E_f + E_r + S
    i theta'' = (l_f - q)(F_f + E_f) - (l_r + q)(F_r + E_r) + (p - q) S,    x'' = x_q'' - q theta''
    m_uf u_f'' = T_f - F_f,    m_ur u_r'' = T_r - F_r
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from . import kinds
from .compiled import call_native, compiled

__all__ = ["integrate", "road_at"]

Reals = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_SPRING = kinds.SPRING
_DAMPER = kinds.DAMPER
_ASYMMETRIC = kinds.ASYMMETRIC
_DIGRESSIVE = kinds.DIGRESSIVE
_COULOMB = kinds.COULOMB
_SINH_SPRING = kinds.SINH_SPRING
_STOP = kinds.STOP
_FADE = kinds.FADE
_CURVE_RATE = kinds.CURVE_RATE
_CURVE_TRAVEL = kinds.CURVE_TRAVEL
_POSITION_DAMPER = kinds.POSITION_DAMPER
_QUADRATIC = kinds.QUADRATIC
_MAXWELL = kinds.MAXWELL
_BOUC_WEN = kinds.BOUC_WEN
_CUSTOM = kinds.CUSTOM
_LASH = kinds.LASH
_MOUNTED_CURVE = kinds.MOUNTED_CURVE

_FIRST_OWN = 10


@compiled
def road_at(coefficients: Reals, start: float, grid: float, x: float) -> tuple[float, float]:
    """Height and slope of a piecewise cubic on a uniform grid; level beyond both ends."""
    where = (x - start) / grid
    if where <= 0.0:
        return coefficients[0, 0], 0.0
    piece = int(where)
    if piece >= coefficients.shape[0]:
        last = coefficients.shape[0] - 1
        a, b = coefficients[last, 0], coefficients[last, 1]
        c, d = coefficients[last, 2], coefficients[last, 3]
        return a + grid * (b + grid * (c + grid * d)), 0.0
    r = (where - piece) * grid
    a, b = coefficients[piece, 0], coefficients[piece, 1]
    c, d = coefficients[piece, 2], coefficients[piece, 3]
    return a + r * (b + r * (c + r * d)), b + r * (2.0 * c + 3.0 * r * d)


@compiled
def _curve(pool: Reals, offset: int, count: int, x: float) -> float:
    """Value of a piecewise cubic with free knots, straight beyond its ends."""
    low, high = 0, count - 2
    while low < high:
        middle = (low + high + 1) // 2
        if pool[offset + middle] <= x:
            low = middle
        else:
            high = middle - 1
    at = offset + count + 4 * low
    left: float = pool[offset + low]
    right: float = pool[offset + low + 1]
    r: float = min(max(x, left), right) - left
    c3, c2, c1, c0 = pool[at], pool[at + 1], pool[at + 2], pool[at + 3]
    value: float = c0 + r * (c1 + r * (c2 + r * c3))
    slope: float = c1 + r * (2.0 * c2 + 3.0 * r * c3)
    return value + slope * (x - left - r)


@compiled
def _axle_force(
    kind: Integers,
    par: Reals,
    pool: Reals,
    pointer: Integers,
    first: int,
    last: int,
    d: float,
    v: float,
    t: float,
    s: Reals,
    ds: Reals,
) -> float:
    """Sum of one axle's terms (N, up on the chassis); rates of their own states go into ``ds``.

    ``pointer`` holds, a term: address of a native law, offset into ``pool``, own state.
    """
    total = 0.0
    for j in range(first, last):
        which = kind[j]
        p0, p1, p2 = par[j, 0], par[j, 1], par[j, 2]
        if which == _SPRING:
            total -= p0 * d
        elif which == _DAMPER:
            total -= p0 * v
        elif which == _ASYMMETRIC:
            total -= p0 * v + p1 * (math.sqrt(v * v + p2 * p2) - p2)
        elif which == _DIGRESSIVE:
            total -= p0 * p1 * math.tanh(v / p1)
        elif which == _COULOMB:
            total -= p0 * math.tanh(v / p1)
        elif which == _SINH_SPRING:
            total -= p0 * p1 * math.sinh(d / p1)
        elif which == _STOP:
            width = par[j, 3]
            depth = (p2 * d - p0) / width
            soft = width * depth if depth > 30.0 else width * math.log1p(math.exp(depth))
            total -= p2 * p1 * (soft - par[j, 4])
        elif which == _FADE:
            share = min(max(t / p2, 0.0), 1.0)
            gone = (1.0 - math.exp(-3.0 * share)) / (1.0 - math.exp(-3.0))
            total -= p0 * (1.0 - p1 * gone) * v
        elif which == _CURVE_RATE:
            total -= _curve(pool, pointer[j, 1], int(p0), v) - p1
        elif which == _CURVE_TRAVEL:
            total -= _curve(pool, pointer[j, 1], int(p0), d) - p1
        elif which == _POSITION_DAMPER:
            total -= p0 * (1.0 + p1 * d * d) * v
        elif which == _QUADRATIC:
            total -= p0 * v * math.sqrt(v * v + p1 * p1)
        elif which == _MAXWELL:
            own = pointer[j, 2]
            force = p1 * (d - s[own])
            ds[own] = force / p0
            total -= force
        elif which == _BOUC_WEN:
            own = pointer[j, 2]
            z = s[own]
            drag = (p2 * abs(v) * z + (1.0 - p2) * v * abs(z)) * abs(z)
            ds[own] = (v - drag) / p1
            total -= p0 * z
        elif which == _LASH:
            own = pointer[j, 2]
            apart = d - s[own]
            force = p1 * (apart - p2 * math.tanh(apart / p2))
            ds[own] = force / p0
            total -= force
        elif which == _MOUNTED_CURVE:
            own = pointer[j, 2]
            force = p2 * (d - s[own])
            ds[own] = _curve(pool, pointer[j, 1], int(p0), force) - p1
            total -= force
        elif which == _CUSTOM:
            total += call_native(pointer[j, 0], d, v, t)
    return total


@compiled
def _tyre(
    stiffness: float, damping: float, load: float, lifts: bool, gap: float, gap_rate: float
) -> float:
    """Whole tyre force (N). ``gap`` is road minus hub, from rest; ``load`` the static force.

    Without lift it is linear. With lift it never pulls; its damping fades in over a fifth of the
    static deflection, or a landing would be a jump of force that no fixed step can follow.
    """
    if not lifts:
        return load + stiffness * gap + damping * gap_rate
    depth = load / stiffness + gap
    if depth <= 0.0:
        return 0.0
    share = min(depth / (0.2 * load / stiffness), 1.0)
    share = share * share * (3.0 - 2.0 * share)
    return max(0.0, stiffness * depth + share * damping * gap_rate)


@compiled
def _rates(
    t: float,
    s: Reals,
    e_f: float,
    e_r: float,
    body: Reals,
    coefficients: Reals,
    kind: Integers,
    par: Reals,
    pool: Reals,
    pointer: Integers,
    split: int,
    ds: Reals,
    seen: Reals,
) -> None:
    """Rates of the state at one instant, and what one may want to see there."""
    m, i, q = body[0], body[1], body[2]
    l_f, l_r = body[3], body[4]
    m_uf, m_ur = body[5], body[6]
    lifts = body[13] > 0.5
    speed, origin, start, grid = body[18], body[19], body[20], body[21]

    v_f, v_r = s[6], s[7]
    d_f = s[0] + l_f * s[1] - s[2]
    d_r = s[0] - l_r * s[1] - s[3]
    r_f = s[4] + l_f * s[5] - v_f
    r_r = s[4] - l_r * s[5] - v_r
    f_f = _axle_force(kind, par, pool, pointer, 0, split, d_f, r_f, t, s, ds)
    f_r = _axle_force(kind, par, pool, pointer, split, len(kind), d_r, r_r, t, s, ds)

    place = speed * t - origin
    z_f, slope_f = road_at(coefficients, start, grid, place)
    z_r, slope_r = road_at(coefficients, start, grid, place - (l_f + l_r))
    t_f = _tyre(body[7], body[9], body[11], lifts, z_f - s[2], speed * slope_f - v_f)
    t_r = _tyre(body[8], body[10], body[12], lifts, z_r - s[3], speed * slope_r - v_r)

    seat_force = 0.0
    p = body[17]
    if body[14] > 0.0:
        seat_force = body[15] * (s[8] - s[0] - p * s[1]) + body[16] * (s[9] - s[4] - p * s[5])
        ds[8] = s[9]
        ds[9] = -seat_force / body[14]
    pitch = ((l_f - q) * (f_f + e_f) - (l_r + q) * (f_r + e_r) + (p - q) * seat_force) / i
    heave = (f_f + e_f + f_r + e_r + seat_force) / m - q * pitch
    for j in range(4):
        ds[j] = s[4 + j]
    ds[4] = heave
    ds[5] = pitch
    ds[6] = (t_f - body[11] - f_f) / m_uf
    ds[7] = (t_r - body[12] - f_r) / m_ur

    seen[0] = ds[6]
    seen[1] = heave + l_f * pitch
    seen[2] = ds[7]
    seen[3] = heave - l_r * pitch
    seen[4], seen[5] = t_f, t_r
    seen[6], seen[7] = f_f, f_r
    seen[8], seen[9] = z_f, z_r


@compiled
def integrate(
    t_start: float,
    h: float,
    steps: int,
    initial: Reals,
    outside: Reals,
    body: Reals,
    coefficients: Reals,
    kind: Integers,
    par: Reals,
    pool: Reals,
    pointer: Integers,
    split: int,
) -> tuple[Reals, Reals]:
    """Classical fourth-order Runge-Kutta with a fixed step.

    ``outside`` (2, 1 or 2·steps + 1) holds the outside forces at every whole and half step, so
    that every stage sees the force and the road of its own instant.
    """
    n = len(initial)
    states = np.empty((steps + 1, n))
    seen = np.empty((steps + 1, 10))
    s = initial.copy()
    k1, k2, k3, k4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    stage = np.empty(n)
    spare = np.empty(10)
    moving = outside.shape[1] > 1
    e = np.zeros((2, 3))
    for step in range(steps + 1):
        t = t_start + step * h
        if moving:
            for j in range(3):
                at = min(2 * step + j, 2 * steps)
                e[0, j] = outside[0, at]
                e[1, j] = outside[1, at]
        _rates(
            t, s, e[0, 0], e[1, 0], body, coefficients, kind, par, pool, pointer, split, k1, spare
        )
        for j in range(n):
            states[step, j] = s[j]
            stage[j] = s[j] + 0.5 * h * k1[j]
        for j in range(10):
            seen[step, j] = spare[j]
        if step == steps:
            break
        middle = t + 0.5 * h
        _rates(
            middle, stage, e[0, 1], e[1, 1], body, coefficients, kind, par, pool, pointer, split,
            k2, spare,
        )  # fmt: skip
        for j in range(n):
            stage[j] = s[j] + 0.5 * h * k2[j]
        _rates(
            middle, stage, e[0, 1], e[1, 1], body, coefficients, kind, par, pool, pointer, split,
            k3, spare,
        )  # fmt: skip
        for j in range(n):
            stage[j] = s[j] + h * k3[j]
        _rates(
            t + h, stage, e[0, 2], e[1, 2], body, coefficients, kind, par, pool, pointer, split,
            k4, spare,
        )  # fmt: skip
        for j in range(n):
            s[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])
    return states, seen
