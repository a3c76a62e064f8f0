"""What is judged, as functions of the estimator's coordinates.

Logarithms of c_f, c_r, i, k_g and of the given values are linear in the coordinates that are
sampled and in those that keep their prior.  So, given a draw of the first, each is normal, and
nothing has to be drawn: distribution functions are averaged instead (Rao–Blackwell).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.parameters import CAR, ParameterSpace

__all__ = ["Conditional", "car_quantities", "coordinates", "log_spread", "nuisance"]

Array = NDArray[np.float64]

_LOGS = ("c_f", "c_r", "i", "m", "l", "k_f", "k_r")  # the order of Space's logarithms


@dataclass(frozen=True)
class Conditional:
    """A quantity given each draw: normal about ``mean`` with deviation ``sd``.

    Parameters
    ----------
    mean : (S,) array
        One a draw, logarithms for what is positive.
    sd : float
        What the data cannot see adds; zero when they see it all.
    truth : float
        The true value on the same scale.
    """

    mean: Array
    sd: float
    truth: float


def exponents(name: str) -> Array:
    """Exponents (7,) with which the logarithms of the car make that of a quantity."""
    out = np.zeros(len(_LOGS))
    if name == "k_g":  # √(i/m)
        out[_LOGS.index("i")], out[_LOGS.index("m")] = 0.5, -0.5
    else:
        out[_LOGS.index(name)] = 1.0
    return out


def car_quantities(
    space: ParameterSpace, z: Array, truth: Array, names: tuple[str, ...]
) -> dict[str, Conditional]:
    """Logarithms of the car's quantities for coordinates (S, D) and a true car (8,).

    Parameters
    ----------
    space : ParameterSpace
        Coordinates and priors.
    z : (S, D) array
        Draws.
    truth : (8,) array
        In the order of :data:`bayes_asv.posterior.parameters.CAR`, SI.
    names : tuple of str
        Of c_f, c_r, i, m, l, k_f, k_r, k_g; one that is exact is left out.
    """
    logs = np.log([truth[CAR.index(name)] for name in _LOGS])
    seen = z[:, : space.seen.shape[1]] @ space.seen.T
    out = {}
    for name in names:
        weight = exponents(name)
        scaled = weight * space.log_sd
        if not scaled.any():
            continue
        out[name] = Conditional(
            mean=np.asarray(weight @ space.log_mean + seen @ scaled),
            sd=float(np.linalg.norm(scaled @ space.unseen)),
            truth=float(weight @ logs),
        )
    return out


def nuisance(space: ParameterSpace, z: Array, truth: Array) -> dict[str, Conditional]:
    """Every other coordinate: weight share, noise levels, filtered share, as they are sampled.

    Parameters
    ----------
    space : ParameterSpace
        Coordinates and priors.
    z, truth : (S, D) and (D,) arrays
        Draws and the true coordinates.
    """
    first = space.seen.shape[1]
    return {
        space.names[k].removesuffix(" 0"): Conditional(z[:, k], 0.0, float(truth[k]))
        for k in range(first, space.dimension)
    }


def coordinates(space: ParameterSpace, truth: Array) -> Array:
    """Coordinates (D,) of a true car (8,), everything that is not the car at its prior's centre."""
    logs = np.log([truth[CAR.index(name)] for name in _LOGS])
    there = space.log_sd > 0.0
    turned = np.zeros(len(_LOGS))
    turned[there] = (logs - space.log_mean)[there] / space.log_sd[there]
    z = np.zeros(space.dimension)
    first = space.seen.shape[1]
    z[:first] = turned @ space.seen
    if "wdf" in space.names:
        z[first] = (truth[CAR.index("wdf")] - space.centre[first]) / space.scale[first]
    return z


def log_spread(space: ParameterSpace, covariance: Array, name: str) -> float:
    """Deviation of the logarithm of a quantity under a covariance (r, r) of what is seen."""
    scaled = exponents(name) * space.log_sd
    seen, unseen = scaled @ space.seen, scaled @ space.unseen
    return float(np.sqrt(seen @ covariance @ seen + unseen @ unseen))
