"""Fisher information of recordings about a car, and the standard deviations that it predicts.

The unknowns of a car are the independent terms of its prior: a common factor on each parameter, and
one on the difference of the springs of an axle's two sides
(:class:`bayes_asv.models.car_model.CarParameter`).  For normalised
innovations ν with unit covariance and a mean that depends on the logarithms t of the unknowns, the
information is J = Σ (∂ν/∂t)(∂ν/∂t)ᵀ, the expected negative Hessian of the log-likelihood.
The noise levels are fixed at their declared or estimated values.  Compared with the curvature of
the full posterior with free noise levels, J has an error of 2 % on average and of 4 to 9 % for a
single recording (``benchmarks/plan.py``).

With the prior standard deviations σ, the posterior precision after n passes is diag(1/σ²) + n J.
Directions on which the state-space model does not depend, such as a heavier car with every rate in
proportion, have no information in any recording; J is projected onto the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters import kalman
from bayes_asv.filters.vector_code import LANES
from bayes_asv.models.car_model import CarModel, Output, state_space
from bayes_asv.posterior.car_prior import identified_directions
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "UNMEASURED",
    "WIDE_PRIOR",
    "ParameterPrior",
    "fisher_information",
    "make_parameter_prior",
    "predicted_sd",
    "sd_floor",
    "unmeasured",
]  # fmt: skip

Array = NDArray[np.float64]

UNMEASURED = 0.7
"""Ratio of posterior to prior standard deviation above which a parameter was not measured: the
data then have less information about it than the prior (1/0.7² = 2.04)."""
WIDE_PRIOR = 0.3
"""Prior standard deviation of a logarithm above which a prior is vague; a narrower one was given by
the user and is informative by itself."""

_STEP = 0.01  # step of central differences of the logarithms
# Share of the noise that passes the sensor's filter; a share of exactly one has no probit.
_FILTERED_SHARE = 0.98


@dataclass(frozen=True)
class ParameterPrior:
    """Independent unknowns of a car, their prior, and what its outputs can identify.

    Parameters
    ----------
    car : CarModel
        The car.
    names : tuple of str
        Names (nT,) of the unknowns; an unknown of a single parameter has the parameter's name.
    log_sd : (nT,) array
        Prior standard deviations of their logarithms; for a fraction, relative to its value.
    log_gradients : dict of str to (nT,) array
        Derivatives of the logarithm of each parameter by the logarithms of the unknowns.
    identified : (nT, r) array
        Orthonormal directions on which the state-space model depends.
    """

    car: CarModel
    names: tuple[str, ...]
    log_sd: Array
    log_gradients: Mapping[str, Array]
    identified: Array

    @property
    def estimands(self) -> dict[str, Array]:
        """Derivatives (nT,) of the logarithms of the parameters of interest by the unknowns'."""
        out = {name: self.log_gradients[name] for name in self.car.estimated}
        for name, powers in self.car.ratios.items():
            out[name] = sum(
                (power * self.log_gradients[p] for p, power in powers.items()),
                np.zeros(len(self.names)),
            )
        return out

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the unknowns of given values."""
        return tuple(name for name in self.names if name not in self.car.estimated)

    def sd(self, name: str) -> float:
        """Prior standard deviation of the logarithm of an unknown or a parameter."""
        if name in self.log_gradients:
            return float(np.linalg.norm(self.log_gradients[name] * self.log_sd))
        return float(self.log_sd[self.names.index(name)])

    def replaced(self, log_sd: Mapping[str, float]) -> ParameterPrior:
        """Return a copy with some prior standard deviations replaced."""
        log_sds = dict(zip(self.names, self.log_sd.tolist(), strict=True))
        return replace(self, log_sd=np.array([{**log_sds, **log_sd}[name] for name in self.names]))

    def with_exact_given(self) -> ParameterPrior:
        """Return a copy with all given values exact."""
        return self.replaced(dict.fromkeys(self.given, 0.0))


def make_parameter_prior(car: CarModel, outputs: Sequence[Output]) -> ParameterPrior:
    """Set up the unknowns of a car with measured outputs, and their prior.

    Parameters
    ----------
    car : CarModel
        The car.
    outputs : sequence of Output
        Measured outputs.
    """
    varying = [p for p in car.parameters if p.terms and p.nominal != 0.0]
    sds = {
        name: sd / p.nominal if p.kind == "fraction" else sd
        for p in varying
        for name, _, sd in p.terms
    }
    names = tuple(sds)
    parameters = {}
    for p in varying:
        parameters[p.name] = np.zeros(len(names))
        for name, coefficient, _ in p.terms:
            parameters[p.name][names.index(name)] += coefficient
    fractions = [names.index(p.name) for p in varying if p.kind == "fraction"]
    logs = [p.name for p in varying if p.kind != "fraction"]
    root = np.array([parameters[name] for name in logs])
    directions, _ = identified_directions(car, outputs, tuple(logs), root)
    of_fractions = np.eye(len(names))[:, fractions]
    return ParameterPrior(
        car=car,
        names=names,
        log_sd=np.array(list(sds.values())),
        log_gradients=parameters,
        identified=np.hstack([directions, of_fractions]),
    )


def fisher_information(
    recording: PreparedRecording, vehicle: Vehicle, parameter_prior: ParameterPrior
) -> Array:
    """Compute the information of one recording about the logarithms of the unknowns.

    Parameters
    ----------
    recording : PreparedRecording
        One pass.
    vehicle : Vehicle
        The car; its values and the noise of its sensors are assumed to be true.
    parameter_prior : ParameterPrior
        Prior of the recording's car.

    Returns
    -------
    (nT, nT) array
        Positive semi-definite information.  That of independent passes adds up.
    """
    parameters = make_parameter_space(vehicle, (recording,))
    z = np.zeros(parameters.dimension)
    if "filtered share 0" in parameters.names:
        z[parameters.names.index("filtered share 0")] = ndtri(_FILTERED_SHARE)
    noise = parameters.noises(z[None], 0)
    directions = parameter_prior.identified
    slopes = np.empty((recording.kind.size, directions.shape[1]))
    # in batches: all innovations of a long recording at once would need too much memory
    for k in range(0, directions.shape[1], LANES // 2):
        batch = directions.T[k : k + LANES // 2]
        logs = _STEP * np.concatenate([batch, -batch])
        values = {
            p.name: np.full(len(logs), p.nominal)
            if p.name not in parameter_prior.log_gradients
            else p.nominal * np.exp(logs @ parameter_prior.log_gradients[p.name])
            for p in parameter_prior.car.parameters
        }
        system = state_space(
            parameter_prior.car, values, recording.output_models, None, recording.bias_directions
        )
        noises = kalman.SensorNoise(*(np.repeat(part, len(logs), axis=0) for part in noise))
        innovations = kalman.filter_pass(system, noises, recording.measurements).innovations
        above, below = np.split(innovations.reshape(len(logs), -1), 2)
        slopes[:, k : k + len(batch)] = (above - below).T / (2.0 * _STEP)
    gradients = slopes @ directions.T
    return np.asarray(gradients.T @ gradients)


def predicted_sd(
    information: Array,
    passes: float,
    parameter_prior: ParameterPrior,
    directions: Mapping[str, Array],
) -> dict[str, float]:
    """Predict the posterior standard deviations of logarithms.

    Parameters
    ----------
    information : (nT, nT) array
        Information of one pass.
    passes : float
        Number of passes.
    parameter_prior : ParameterPrior
        Prior, with its standard deviations.
    directions : mapping of str to (nT,) array
        Derivatives of each quantity's logarithm by those of the unknowns, such as
        ``about.estimands``.

    Returns
    -------
    dict of str to float
        Standard deviation of each quantity's logarithm.
    """
    sd = parameter_prior.log_sd
    # in units of the prior standard deviations, where the prior precision is the unit matrix
    precision = np.eye(len(sd)) + passes * information * np.outer(sd, sd)
    slopes = np.array(list(directions.values())) * sd
    variance = np.sum(slopes * np.linalg.solve(precision, slopes.T).T, axis=1)
    return dict(zip(directions, np.sqrt(variance).tolist(), strict=True))


def sd_floor(parameter_prior: ParameterPrior, directions: Mapping[str, Array]) -> dict[str, float]:
    """Compute the standard deviations of logarithms in the limit of infinitely many passes.

    Directions on which the state-space model does not depend keep their prior.  A mass known to
    1 % leaves 1 % in every rate; springs known to 5 % add a little information about the mass.
    """
    free = parameter_prior.log_sd > 0.0
    sd = parameter_prior.log_sd[free]
    # in units of the prior standard deviations: identified directions, and the others
    rows = parameter_prior.identified.T[:, free] * sd
    _, singular, right = np.linalg.svd(rows)
    rank = int(np.count_nonzero(singular > 1e-9 * singular[0])) if singular.size else 0
    slopes = np.array([slope[free] * sd for slope in directions.values()])
    sds = np.sqrt(np.sum((slopes @ right[rank:].T) ** 2, axis=1))
    sds[sds < 1e-12] = 0.0  # rounding error of an identifiable direction
    return dict(zip(directions, sds.tolist(), strict=True))


def unmeasured(prior_sd: Mapping[str, float], posterior_sd: Mapping[str, float]) -> tuple[str, ...]:
    """Name the parameters that data hardly constrain, see :data:`UNMEASURED`.

    Parameters
    ----------
    prior_sd, posterior_sd : mappings of str to float
        Standard deviations of the logarithms before and after the data.
    """
    return tuple(
        name
        for name, before in prior_sd.items()
        if before > 0.0 and posterior_sd[name] > UNMEASURED * before
    )
