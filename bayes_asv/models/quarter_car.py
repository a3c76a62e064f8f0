"""The quarter car: one corner, body and wheel (Fig. 2.1 of the reference)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_asv.models.assembly import Link, SecondOrder, assemble

__all__ = ["QuarterCar"]


@dataclass(frozen=True, slots=True)
class QuarterCar:
    """A sprung mass on a wheel on a tyre; coordinates are their heights, the input is the road's.

    Parameters
    ----------
    m, m_u : float
        Sprung and unsprung mass, kg.
    k, c : float
        Spring rate, N/m, and damping rate, N·s/m, of the suspension at the wheel.
    k_t, c_t : float
        Rate and damping of the tyre.
    """

    m: float
    m_u: float
    k: float
    c: float
    k_t: float
    c_t: float = 0.0

    coordinates = ("body", "wheel")
    inputs = ("road",)

    def system(self) -> SecondOrder:
        """Equations of motion: two coordinates, one input."""
        still, road = np.zeros(1), np.ones(1)
        return assemble(
            (self.m, self.m_u),
            (
                Link(np.array([1.0, -1.0]), still, self.k, self.c),
                Link(np.array([0.0, 1.0]), road, self.k_t, self.c_t),
            ),
        )
