"""The whole car: seven degrees of freedom (Fig. 2.2 of the reference, after Holen)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_asv.models.assembly import CORNERS, Link, SecondOrder, assemble, corners

__all__ = ["FullCar7"]

Four = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class FullCar7:
    """Heave, pitch and roll of the chassis and the heights of four wheels.

    Holen's truck has two rigid axles, whose bounce and roll are the mean and the half difference
    of its wheels; here each wheel is a mass of its own.  Corners are in the order of
    :data:`bayes_asv.models.assembly.CORNERS`.

    Parameters
    ----------
    m, i, i_roll : float
        Sprung mass, kg, and its inertias in pitch and roll, kg·m².
    l_f, l_r, t_f, t_r : float
        Distances of the axles from the centre of gravity, and track widths, m.
    m_u, k, c, k_t, c_t : tuple of 4 float
        Unsprung mass (kg), suspension's and tyre's rates (N/m, N·s/m) of each corner.
    bar_f, bar_r : float
        Anti-roll bars: force at either wheel per difference of the two deflections, N/m.
    """

    m: float
    i: float
    i_roll: float
    l_f: float
    l_r: float
    t_f: float
    t_r: float
    m_u: Four
    k: Four
    c: Four
    k_t: Four
    c_t: Four = (0.0, 0.0, 0.0, 0.0)
    bar_f: float = 0.0
    bar_r: float = 0.0

    coordinates = ("heave", "pitch", "roll", *(f"{corner} wheel" for corner in CORNERS))
    inputs = tuple(f"{corner} road" for corner in CORNERS)

    def system(self) -> SecondOrder:
        """Equations of motion: seven coordinates, four inputs."""
        still, under, wheel = np.zeros(4), np.eye(4), np.eye(7)[3:]
        body = np.hstack([corners(self.l_f, self.l_r, self.t_f, self.t_r), np.zeros((4, 4))])
        stretch = body - wheel
        links = [Link(stretch[j], still, self.k[j], self.c[j]) for j in range(4)]
        links += [Link(wheel[j], under[j], self.k_t[j], self.c_t[j]) for j in range(4)]
        links += [
            Link(stretch[0] - stretch[1], still, self.bar_f, 0.0),
            Link(stretch[2] - stretch[3], still, self.bar_r, 0.0),
        ]
        return assemble((self.m, self.i, self.i_roll, *self.m_u), links)
