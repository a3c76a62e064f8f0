"""Cars of the rig whose tyres and sizes a plan does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.rig import RigCar, baja, table51

__all__ = ["CARS", "chance_car"]


def _formula() -> RigCar:
    """Return a light car on stiff springs and small stiff tyres, as students race it."""
    return replace(
        baja(), name="formula", m=210.0, wdf=0.47, l=1.6, k_f=56e3, k_r=62e3, c_f=3000.0,
        c_r=3400.0, i=70.0, m_uf=24.0, m_ur=26.0, k_tf=230e3, k_tr=230e3, c_tf=350.0, c_tr=350.0,
        tyre_radius=0.26, contact_patch=0.12,
    )  # fmt: skip


def _hatchback() -> RigCar:
    """Return an ordinary small road car."""
    return replace(
        baja(), name="hatchback", m=1050.0, wdf=0.58, l=2.5, k_f=44e3, k_r=42e3, c_f=3200.0,
        c_r=2900.0, i=1350.0, m_uf=80.0, m_ur=75.0, k_tf=380e3, k_tr=380e3, c_tf=500.0, c_tr=500.0,
        tyre_radius=0.30, contact_patch=0.18,
    )  # fmt: skip


def _on_stiff_tyres() -> RigCar:
    """Return the baja on tyres twice as stiff and wheels two thirds as heavy."""
    car = baja()
    return replace(
        car, name="baja on stiff tyres", k_tf=2.0 * car.k_tf, k_tr=2.0 * car.k_tr,
        m_uf=0.67 * car.m_uf, m_ur=0.67 * car.m_ur, tyre_radius=0.25, contact_patch=0.20,
    )  # fmt: skip


CARS = {
    "baja": baja,
    "baja on stiff tyres": _on_stiff_tyres,
    "table 5.1": table51,
    "formula": _formula,
    "hatchback": _hatchback,
}


def chance_car(seed: int) -> RigCar:
    """Draw a car between a light racer and a road car, on tyres that the plan does not know."""
    rng = np.random.default_rng([seed, 51])

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    m, l, wdf = between(150.0, 1400.0), between(1.5, 2.7), float(rng.uniform(0.42, 0.6))
    axle = m * np.array([wdf, 1.0 - wdf])
    ride = 2.0 * np.pi * between(1.2, 3.0) * np.array([1.0, between(0.9, 1.25)])
    k = axle * ride**2
    c = 2.0 * np.array([between(0.25, 0.7), between(0.25, 0.7)]) * axle * ride
    unsprung = axle * np.array([between(0.14, 0.34), between(0.14, 0.34)])
    tyre = k * between(3.0, 9.0)
    return RigCar(
        name=f"chance {seed}", m=m, wdf=wdf, l=l, k_f=k[0], k_r=k[1], c_f=c[0], c_r=c[1],
        i=m * (between(0.32, 0.55) * l) ** 2, m_uf=unsprung[0], m_ur=unsprung[1],
        k_tf=tyre[0], k_tr=tyre[1], c_tf=0.004 * tyre[0], c_tr=0.004 * tyre[1],
        tyre_radius=between(0.22, 0.33), contact_patch=between(0.1, 0.3),
    )  # fmt: skip
