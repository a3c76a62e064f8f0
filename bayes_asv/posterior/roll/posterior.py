"""The posterior density of the car that rolls, in coordinates that are standard normal beforehand.

Damping rates and inertias have log-normal priors about their nominal values, each damper its own.
A spring rate that is given for both sides of an axle has two unknowns: what is common to the sides
and what differs, both as wide as the file says of the axle.  Only ratios to the mass can be seen;
the coordinates that cannot keep their prior, which the curvature at the mode knows as well.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_asv.domain.channels import ROLL_CHANNELS
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman_roll import rolling_pass
from bayes_asv.models.from_vehicle import roll_car
from bayes_asv.models.roll_car import RollCar, deflections, warp
from bayes_asv.posterior.newton import Mode
from bayes_asv.models.priors import (
    DAMPING_FACTOR,
    INERTIA_FACTOR,
    NOISE_GIVEN_SD,
    NOISE_UNKNOWN_SD,
    WORST,
    prior_log_sd,
)
from bayes_asv.posterior.roll.layout import RollLayout
from bayes_asv.preprocessing.noise_level import quiet_level

__all__ = ["ROLL_ANSWERS", "RollPosterior", "climb", "roll_posterior"]

Array = NDArray[np.float64]

ROLL_ANSWERS: Final = ("c_fl", "c_fr", "c_rl", "c_rr", "i", "i_roll")
"""What is asked for."""

_DIFFERENCE = 1e-3  # of a prior deviation, to both sides: smaller ones lose to rounding
_ROUNDS = 60
_ENOUGH = 0.02  # nats that the next step would gain; the weights of the draws make up for it


@dataclass(frozen=True)
class RollPosterior:
    """Log-posterior over coordinates (D,).

    Parameters
    ----------
    names : tuple of str
        One a coordinate: fields of :class:`RollCar`, ``k_f``, ``k_r`` (both sides), ``split_f``,
        ``split_r`` (left against right), ``noise <channel> <run>`` and ``filtered share <run>``.
    scale : (D,) array
        Prior deviation: of a logarithm, but for ``wdf`` and the probit of a share.
    nominal : RollCar
        The prior's centre.
    levels : (runs, 7) array
        Centres of the noise levels' priors, m/s².
    runs : tuple of RollLayout
        The recordings.
    pool : ThreadPoolExecutor or None
        Where batches are split; the answer does not depend on it.
    """

    names: tuple[str, ...]
    scale: Array
    nominal: RollCar
    levels: Array
    runs: tuple[RollLayout, ...]
    pool: ThreadPoolExecutor | None = None

    def car(self, z: Array) -> RollCar:
        """Physical parameters at coordinates (D,)."""
        value = self.nominal._asdict()
        for name, x in zip(self.names, self.scale * z, strict=True):
            if name == "wdf":
                value["wdf"] += x
            elif name in ("k_f", "k_r"):
                for side in "lr":
                    value[f"{name}{side}"] *= math.exp(x)
            elif name.startswith("split"):
                axle = name[-1]
                value[f"k_{axle}l"] *= math.exp(x)
                value[f"k_{axle}r"] *= math.exp(-x)
            elif name in value:
                value[name] *= math.exp(x)
                if name == "t_f" and self.nominal.s_f == self.nominal.t_f:
                    value["s_f"] = value["t_f"]  # sensors right above the wheels
        return RollCar(**value)

    def noise(self, z: Array, run: int) -> Array:
        """White and filtered variances (2, 7) of one run's channels, m²/s⁴."""
        line = self.runs[run]
        level = np.log(self.levels[run])
        share = 0.0
        for name, x in zip(self.names, self.scale * z, strict=True):
            if name == f"filtered share {run}":
                share = float(ndtr(x))
            elif name.startswith("noise") and name.endswith(f" {run}"):
                level[ROLL_CHANNELS.index(name.split()[1])] += x
        variance = np.exp(2.0 * level)
        return np.stack([(1.0 - share) * variance + line.steps**2 / 12.0, share * variance])

    def innovations(self, z: Array, run: int) -> tuple[float, Array, Array]:
        """Log-likelihood, innovations and log variances (N, 3) of one run at coordinates (D,)."""
        line, car = self.runs[run], self.car(z)
        system, noise = deflections(car), self.noise(z, run)
        start = line.start.copy()
        start[range(12, 19), range(12, 19)] = noise[1]
        nu, logs = np.zeros(line.kind.shape), np.zeros(line.kind.shape)
        value = rolling_pass(
            system.A, np.ascontiguousarray(system.C), warp(car), noise, line.poles, line.step,
            line.moments, line.spread, line.kind, line.reading, start, nu, logs,
        )  # fmt: skip
        return float(value), nu, logs

    def log_prior(self, z: Array) -> float:
        """Log density of the prior at coordinates (D,); −inf where no car can be."""
        if not np.all(np.abs(z) < WORST):
            return -math.inf
        if "wdf" in self.names and not 0.01 < self.car(z).wdf < 0.99:
            return -math.inf
        return float(-0.5 * z @ z - 0.5 * len(z) * math.log(2.0 * math.pi))

    def log_posterior(self, z: Array) -> Array:
        """Log-posterior (W,), not normalised, at coordinates (W, D)."""
        work = self.pool.map if self.pool is not None else map
        return np.array(list(work(self._one, z)))

    def _one(self, z: Array) -> float:
        value = self.log_prior(z)
        if value > -math.inf:
            value += sum(self.innovations(z, run)[0] for run in range(len(self.runs)))
        return value if math.isfinite(value) else -math.inf

    def prior_sd(self, name: str) -> float:
        """Prior deviation of the logarithm of an answer."""
        return float(self.scale[self.names.index(name)])


def roll_posterior(vehicle: Vehicle, runs: tuple[RollLayout, ...]) -> RollPosterior:
    """Set up the coordinates for a vehicle and its recordings.

    Raises
    ------
    InputError
        If the vehicle has no ``[roll]``.
    """
    car = roll_car(vehicle)
    roll = vehicle.roll
    assert roll is not None
    names: list[str] = []
    scale: list[float] = []

    def add(name: str, deviation: float) -> None:
        if deviation > 0.0:
            names.append(name)
            scale.append(deviation)

    for name in ("c_fl", "c_fr", "c_rl", "c_rr"):
        add(name, prior_log_sd(getattr(vehicle, name[:3]), DAMPING_FACTOR))
    add("i", prior_log_sd(vehicle.i, INERTIA_FACTOR))
    add("i_roll", prior_log_sd(roll.inertia, INERTIA_FACTOR))
    add("m", prior_log_sd(vehicle.m))
    add("l", prior_log_sd(vehicle.l))
    for axle in "fr":
        add(f"k_{axle}", prior_log_sd(getattr(vehicle, f"k_{axle}")))
        add(f"split_{axle}", prior_log_sd(getattr(vehicle, f"k_{axle}")))
    add("t_f", prior_log_sd(roll.front_track))
    add("t_r", prior_log_sd(roll.rear_track))
    add("wdf", vehicle.wdf.sd)
    levels = np.empty((len(runs), 7))
    for run, line in enumerate(runs):
        for c, channel in enumerate(ROLL_CHANNELS):
            given = line.noise[c]
            quiet = quiet_level(line.acceleration[c], float(line.steps[c]))
            levels[run, c] = quiet if given is None else given
            add(f"noise {channel} {run}", NOISE_UNKNOWN_SD if given is None else NOISE_GIVEN_SD)
        if np.any(line.poles > 0.0):
            add(f"filtered share {run}", 1.0)
    return RollPosterior(tuple(names), np.array(scale), car, levels, runs)


def climb(target: RollPosterior, start: Array) -> Mode:
    """Climb to a mode by Fisher scoring on the innovations, damped where a step does not gain.

    The slope of −½ Σ (ν² + s) is −Σ (ν dν + ½ ds) and its expected curvature Σ dm dmᵀ + ½ ds dsᵀ
    with dm = dν + ½ ν ds; see :mod:`bayes_asv.posterior.fisher_scoring`.

    Parameters
    ----------
    target : RollPosterior
        The posterior.
    start : (D,) array
        Where to begin.

    Returns
    -------
    Mode
        With the inverse of the expected curvature as its covariance.
    """
    z, damping, converged = start.copy(), 0.0, False
    value = float(target.log_posterior(z[None])[0])
    gradient, precision = _slopes(target, z)
    for _ in range(_ROUNDS):
        gain = 0.5 * float(gradient @ np.linalg.solve(precision, gradient))
        if gain < _ENOUGH:
            converged = True
            break
        ridge = precision + damping * np.diag(np.diag(precision))
        step = np.linalg.solve(ridge, gradient)
        step /= max(1.0, float(np.max(np.abs(step))) / 2.0)
        reached = float(target.log_posterior((z + step)[None])[0])
        if reached > value:
            z, value, damping = z + step, reached, 0.2 * damping if damping > 1e-3 else 0.0
            gradient, precision = _slopes(target, z)
        elif damping > 1e8:
            break
        else:
            damping = max(4.0 * damping, 0.01)
    return Mode(z, np.asarray(np.linalg.inv(precision)), value, converged)


def _slopes(target: RollPosterior, z: Array) -> tuple[Array, Array]:
    """Slope (D,) and expected curvature (D, D) of the log-posterior."""
    d = len(z)
    points = np.vstack([z[None], z + _DIFFERENCE * np.eye(d), z - _DIFFERENCE * np.eye(d)])
    work = target.pool.map if target.pool is not None else map
    gradient, precision = -z.copy(), np.eye(d)
    for run in range(len(target.runs)):
        passes = list(work(lambda p, run=run: target.innovations(p, run)[1:], points))  # type: ignore[misc]
        nu = np.stack([p[0].ravel() for p in passes])
        logs = np.stack([p[1].ravel() for p in passes])
        d_nu = 0.5 * (nu[1 : d + 1] - nu[d + 1 :]) / _DIFFERENCE
        d_log = 0.5 * (logs[1 : d + 1] - logs[d + 1 :]) / _DIFFERENCE
        gradient -= d_nu @ nu[0] + 0.5 * d_log.sum(axis=1)
        mean = d_nu + 0.5 * d_log * nu[0]
        precision += mean @ mean.T + 0.5 * d_log @ d_log.T
    return gradient, precision
