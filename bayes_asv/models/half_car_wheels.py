"""The half car with wheels and tyres: four degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_asv.models.assembly import Link, SecondOrder, assemble

__all__ = ["HalfCar4"]


@dataclass(frozen=True, slots=True)
class HalfCar4:
    """Heave and pitch of the chassis and the heights of both axles, both sides together.

    With its wheels taken as inputs it is :class:`bayes_asv.models.half_car.HalfCar`, which the
    reference uses from chapter 3 on.

    Parameters
    ----------
    m, i : float
        Sprung mass, kg, and its pitch inertia, kg·m².
    l_f, l_r : float
        Distances of the axles from the centre of gravity, m.
    m_uf, m_ur : float
        Unsprung mass of each axle, kg.
    k_f, k_r, c_f, c_r : float
        Rates of the suspension, N/m and N·s/m.
    k_tf, k_tr, c_tf, c_tr : float
        Rates of the tyres.
    """

    m: float
    i: float
    l_f: float
    l_r: float
    m_uf: float
    m_ur: float
    k_f: float
    k_r: float
    c_f: float
    c_r: float
    k_tf: float
    k_tr: float
    c_tf: float = 0.0
    c_tr: float = 0.0

    coordinates = ("heave", "pitch", "front wheels", "rear wheels")
    inputs = ("front road", "rear road")

    def system(self) -> SecondOrder:
        """Equations of motion: four coordinates, two inputs."""
        still, under = np.zeros(2), np.eye(2)
        return assemble(
            (self.m, self.i, self.m_uf, self.m_ur),
            (
                Link(np.array([1.0, self.l_f, -1.0, 0.0]), still, self.k_f, self.c_f),
                Link(np.array([1.0, -self.l_r, 0.0, -1.0]), still, self.k_r, self.c_r),
                Link(np.array([0.0, 0.0, 1.0, 0.0]), under[0], self.k_tf, self.c_tf),
                Link(np.array([0.0, 0.0, 0.0, 1.0]), under[1], self.k_tr, self.c_tr),
            ),
        )
