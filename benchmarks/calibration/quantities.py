"""What is judged, as functions of the estimator's coordinates.

Logarithms of c_f, c_r, i, k_g and of the given values are linear in the coordinates that are
sampled and in those that keep their prior.  So, given a draw of the first, each is normal, and
nothing has to be drawn: distribution functions are averaged instead (Rao–Blackwell).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.posterior.parameters import ParameterSpace

__all__ = ["Conditional", "car_quantities", "coordinates", "log_spread", "nuisance"]

Array = NDArray[np.float64]


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


def exponents(space: ParameterSpace, name: str) -> Array:
    """Exponents with which the positive parameters of the car make a quantity."""
    logs = space.prior.log_parameters
    out = np.zeros(len(logs))
    for part, power in space.car.ratios.get(name, {name: 1.0}).items():
        out[logs.index(part)] = power
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
        In the order of the car's parameters, SI.
    names : tuple of str
        Of c_f, c_r, i, m, l, k_f, k_r, k_g; one that is exact is left out.
    """
    prior = space.prior
    logs = np.log([truth[space.car.names.index(name)] for name in prior.log_parameters])
    zeta = z[:, : prior.identified.shape[1]] @ prior.identified.T
    out = {}
    for name in names:
        weight = exponents(space, name)
        scaled = weight @ prior.root
        if not scaled.any():
            continue
        out[name] = Conditional(
            mean=np.asarray(weight @ prior.log_mean + zeta @ scaled),
            sd=float(np.linalg.norm(scaled @ prior.unidentified)),
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
    first = space.prior.identified.shape[1]
    return {
        space.names[k].removesuffix(" 0"): Conditional(z[:, k], 0.0, float(truth[k]))
        for k in range(first, space.dimension)
    }


def coordinates(space: ParameterSpace, truth: Array) -> Array:
    """Coordinates (D,) of a true car (8,), everything that is not the car at its prior's centre."""
    draws = {name: np.array(value) for name, value in zip(space.car.names, truth, strict=True)}
    z = np.zeros(space.dimension)
    z[: space.car_dimension] = space.car_coordinates(draws)
    return z


def log_spread(space: ParameterSpace, covariance: Array, name: str) -> float:
    """Deviation of the logarithm of a quantity under a covariance (r, r) of what is identified."""
    scaled = exponents(space, name) @ space.prior.root
    known, kept = scaled @ space.prior.identified, scaled @ space.prior.unidentified
    return float(np.sqrt(known @ covariance @ known + kept @ kept))
