"""Prior of a car, and its directions that measured outputs can identify.

Every positive quantity of the car has a log-normal prior.  Accelerations depend only on ratios such
as c/m, k/m and i/(m l²): mass and wheelbase are scale factors and cannot be identified.  With the
logarithms log θ = log θ₀ + S ζ and independent standard normal ζ, the space of ζ is therefore
divided into directions on which the state-space model depends and directions on which it does not.
The first are sampled; the others are drawn from the prior afterwards, which is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.units import STANDARD_GRAVITY
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel, Output, state_space
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import Scale

__all__ = ["CarPrior", "car_prior", "effect_scale", "identified_directions", "prior_of_vehicle"]

Array = NDArray[np.float64]

_STEP = 1e-4  # step of finite differences of the logarithms
# Least singular value of an identified direction, relative to the largest; differences are accurate
# to 1e-8.
_IDENTIFIED = 1e-5


@dataclass(frozen=True)
class CarPrior:
    """Prior of a car's parameters, and the directions that a state-space model can identify.

    Parameters
    ----------
    car : CarModel
        The car.
    log_parameters : tuple of str
        Its parameters, except fractions and parameters that are exactly zero; nL of them.
    log_mean : (nL,) array
        Prior mean of their logarithms, SI units.
    root : (nL, nT) array
        S, a root of the prior covariance of the logarithms.
    identified, unidentified : (nT, r) and (nT, nT − r) arrays
        Orthonormal directions of ζ.
    """

    car: CarModel
    log_parameters: tuple[str, ...]
    log_mean: Array
    root: Array
    identified: Array
    unidentified: Array

    @property
    def log_sd(self) -> Array:
        """Prior standard deviations (nL,) of the logarithms."""
        return np.asarray(np.sqrt(np.sum(self.root**2, axis=1)))


@lru_cache(maxsize=16)  # a diagnosis sets up thousands of parameter spaces of one vehicle
def prior_of_vehicle(car: str, vehicle: Vehicle, outputs: tuple[Output, ...]) -> CarPrior:
    """Return the :func:`car_prior` of a car model by name."""
    return car_prior(car_model(car, vehicle), outputs)


def car_prior(car: CarModel, outputs: Sequence[Output]) -> CarPrior:
    """Set up the prior of a car, and find the directions that measured outputs identify."""
    logs = tuple(p.name for p in car.parameters if p.kind != "fraction" and p.nominal != 0.0)
    by_name = {p.name: p for p in car.parameters}
    terms = sorted({t[0] for name in logs for t in by_name[name].terms if t[2] > 0.0})
    root = np.zeros((len(logs), len(terms)))
    for a, name in enumerate(logs):
        for term, coefficient, sd in by_name[name].terms:
            if sd > 0.0:
                root[a, terms.index(term)] += coefficient * sd
    log_mean = np.log([by_name[name].nominal for name in logs])
    return CarPrior(car, logs, log_mean, root, *identified_directions(car, outputs, logs, root))


def identified_directions(
    car: CarModel, outputs: Sequence[Output], logs: tuple[str, ...], root: Array
) -> tuple[Array, Array]:
    """Find the directions of ζ on which the state-space model depends, and the others.

    Parameters
    ----------
    car : CarModel
        The car.
    outputs : sequence of Output
        Measured outputs.
    logs : tuple of str
        Parameters whose logarithms are log θ₀ + S ζ, nL of them.
    root : (nL, nT) array
        S.

    Returns
    -------
    identified, unidentified : (nT, r) and (nT, nT − r) arrays
        Orthonormal directions.
    """
    _, singular, right = np.linalg.svd(_sensitivity(car, outputs, logs) @ root)
    rank = int(np.count_nonzero(singular > _IDENTIFIED * max(singular.max(initial=0.0), 1e-300)))
    return right[:rank].T, right[rank:].T


def _sensitivity(car: CarModel, outputs: Sequence[Output], logs: tuple[str, ...]) -> Array:
    """Relative derivatives of all entries of A and C by the logarithms, for four cars."""
    rng = np.random.default_rng(0)
    nL = len(logs)
    mean = np.log([float(car.nominal[name][0]) for name in logs])
    rows = []
    for offset in (np.zeros(nL), *(0.5 * rng.normal(size=(3, nL)))):
        points = mean + offset + _STEP * np.vstack([np.zeros(nL), np.eye(nL), -np.eye(nL)])
        values = {p.name: np.full(len(points), p.nominal) for p in car.parameters}
        values |= dict(zip(logs, np.exp(points).T, strict=True))
        system = state_space(car, values, outputs)
        entries = np.concatenate(
            [system.A.reshape(len(points), -1), system.C.reshape(len(points), -1)], axis=1
        )
        scale = np.abs(entries[0])
        is_nonzero = scale > 1e-9 * scale.max()
        slopes = (entries[1 : nL + 1] - entries[nL + 1 :])[:, is_nonzero] / (
            2.0 * _STEP * scale[is_nonzero]
        )
        rows.append(slopes.T)
    return np.concatenate(rows)


def effect_scale(car: CarModel) -> Scale:
    """Return the reference sizes for priors of effects: those of the mean suspension element."""
    nominal, count = car.nominal, len(car.elements)
    # the effective mass in the first coordinate: all of it in heave
    mass = float(car.inertia(nominal)[0, 0] / car.heights(nominal)[0, 0, 0] ** 2)
    return Scale(
        load=mass * STANDARD_GRAVITY / count,
        spring=sum(float(nominal[element.spring][0]) for element in car.elements) / count,
    )
