"""Mass, damping and stiffness of bodies that springs and dampers join."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.models.half_car_equations import LinearSystem

__all__ = ["CORNERS", "Link", "SecondOrder", "assemble", "corners", "state_form"]

Array = NDArray[np.float64]

CORNERS = ("front left", "front right", "rear left", "rear right")


class Link(NamedTuple):
    """A spring and a damper side by side.

    Parameters
    ----------
    q : (n,) array
        How far the coordinates stretch it: extension = q · coordinates − u · inputs.
    u : (p,) array
        How far the inputs shorten it.
    k, c : float
        Spring rate, N/m, and damping rate, N·s/m.
    """

    q: Array
    u: Array
    k: float
    c: float


class SecondOrder(NamedTuple):
    """M q̈ + C q̇ + K q = C_u u̇ + K_u u, with positions u of wheels or road as inputs."""

    M: Array
    C: Array
    K: Array
    C_u: Array
    K_u: Array


def assemble(masses: Iterable[float], links: Iterable[Link]) -> SecondOrder:
    """Sum the links' stiffness and damping over bodies without inertial coupling.

    The potential ½ k e² and the dissipation ½ c ė² of an extension e = d·q − g·u give k d dᵀ and
    c d dᵀ on the left and k d gᵀ and c d gᵀ on the right (Lagrange), so that K and C are symmetric
    and no energy is made whatever the links are.

    Parameters
    ----------
    masses : iterable of float
        Mass (kg) or inertia (kg·m²) of each coordinate.
    links : iterable of Link
        What joins them.

    Returns
    -------
    SecondOrder
        n coordinates, p inputs.
    """
    M = np.diag(np.array(list(masses), float))
    links = list(links)
    n, p = len(M), len(links[0].u)
    C, K = np.zeros((n, n)), np.zeros((n, n))
    C_u, K_u = np.zeros((n, p)), np.zeros((n, p))
    for d, g, k, c in links:
        K += k * np.outer(d, d)
        C += c * np.outer(d, d)
        K_u += k * np.outer(d, g)
        C_u += c * np.outer(d, g)
    return SecondOrder(M, C, K, C_u, K_u)


def corners(l_f: float, l_r: float, t_f: float, t_r: float) -> Array:
    """Heights at the corners (4, 3) for unit heave, pitch and roll, in the order of `CORNERS`.

    Parameters
    ----------
    l_f, l_r : float
        Distances of the axles from the centre of gravity, m.
    t_f, t_r : float
        Track widths, m.
    """
    return np.array(
        [
            [1.0, l_f, 0.5 * t_f],
            [1.0, l_f, -0.5 * t_f],
            [1.0, -l_r, 0.5 * t_r],
            [1.0, -l_r, -0.5 * t_r],
        ]
    )


def state_form(system: SecondOrder) -> LinearSystem:
    """State (q, q̇), input (u, u̇), output (q, q̈).

    Parameters
    ----------
    system : SecondOrder
        n coordinates, p inputs.

    Returns
    -------
    LinearSystem
        A (2n, 2n), B (2n, 2p), C (2n, 2n), D (2n, 2p).
    """
    M, C, K, C_u, K_u = system
    n, p = C_u.shape
    zero = np.zeros((n, n))
    motion = np.linalg.solve(M, np.hstack([-K, -C, K_u, C_u]))
    A = np.block([[zero, np.eye(n)], [motion[:, : 2 * n]]])
    B = np.vstack([np.zeros((n, 2 * p)), motion[:, 2 * n :]])
    out = np.vstack([np.hstack([np.eye(n), zero]), motion[:, : 2 * n]])
    through = np.vstack([np.zeros((n, 2 * p)), motion[:, 2 * n :]])
    return LinearSystem(A, B, out, through)
