"""Deviations within tolerance, as every real car has: fractions of what data sheets allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.battery.world import Axle, World, minus_damper, with_terms_at
from tests.rig import (
    AsymmetricDamper,
    Coulomb,
    DigressiveDamper,
    FadingDamper,
    LinearSpring,
    RigCar,
    SinhSpring,
    Term,
)

__all__ = ["with_tolerances"]


_DIGRESSIVE = 0.05  # share of the damper
_KNEE = 0.93  # in velocities in use: 0.05 (1 - 0.93 tanh(1 / 0.93)) = 0.013


def with_tolerances(
    world: World,
    rng: np.random.Generator,
    rate: tuple[float, float],
    travel: tuple[float, float],
    seconds: float,
) -> World:
    """Return the world with a small amount of every effect.

    Compression and rebound within 3 %; a twentieth of the damper digressive with its knee near the
    velocity in use, which costs 1.3 % of the force there and never more than 5 %, so that a damper
    that has faded remains one; Coulomb friction of 1 to 2 N for a 230 kg car and in proportion
    otherwise; a spring stiffer by up to 0.5 % at full travel; 1 to 2 % of fading; gains within
    0.5 %, lags within 20 us, bandwidths within 3 %, drifts within 0.005 m/s^3.  Mass, weight
    fraction and springs are drawn within their
    declared deviations in every case.

    Parameters
    ----------
    world : World
        Without these deviations.
    rng : numpy.random.Generator
        Draws them.
    rate, travel : pair of float
        Largest velocity (m/s) and deflection (m) of the drives, front and rear.
    seconds : float
        Length of a run.
    """
    ratio = 1.0 + rng.uniform(-0.03, 0.03, size=2)
    force = rng.uniform(1.0, 2.0, size=2) * world.car.m / 230.0
    stiffer = rng.uniform(0.0, 0.005, size=2)
    loss = rng.uniform(0.01, 0.02, size=2)

    def terms(car: RigCar, axle: Axle) -> tuple[Term, ...]:
        j = int(axle == "rear")
        c, k = (car.c_f, car.k_f) if axle == "front" else (car.c_r, car.k_r)
        return (
            AsymmetricDamper(c, float(ratio[j])),
            minus_damper(c),
            DigressiveDamper(_DIGRESSIVE * c, _KNEE * rate[j]),
            minus_damper(_DIGRESSIVE * c),
            FadingDamper(c, float(loss[j]), seconds),
            minus_damper(c),
            Coulomb(float(force[j])),
            SinhSpring(k, float(stiffer[j]) / travel[j] ** 2 + 1e-9),
            LinearSpring(-k),
        )

    spec = world.sensors
    factors = 1.0 + np.array([0.005, 0.03])[:, None] * rng.uniform(-1.0, 1.0, size=(2, 4))
    lag = 2e-5 * rng.uniform(-1.0, 1.0, size=4)
    drift = 5e-3 * rng.uniform(-1.0, 1.0, size=4)

    def four(values: NDArray[np.float64]) -> tuple[float, float, float, float]:
        a, b, c, d = values.tolist()
        return a, b, c, d

    sensors = replace(
        spec,
        gain=four(np.array(spec.gain) * factors[0]),
        bandwidth=four(np.array(spec.bandwidth) * factors[1]),
        delay=four(np.array(spec.delay) + lag),
        drift=four(np.array(spec.drift) + drift),
    )
    return with_terms_at(replace(world, sensors=sensors), "both", terms)
