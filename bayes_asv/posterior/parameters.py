"""Parameters of the posterior: blocks of coordinates that are standard normal a priori.

The blocks are, in this order: the car (with its given values), sensor gains, effects, clock errors,
and the coordinates of single runs (noise levels, filtered shares, input biases).

Coordinates of the car are directions of its prior (:mod:`.car_prior`).  Fractions have a normal
prior, noise levels a log-normal one, and the filtered share of the noise a uniform one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.kalman import SensorNoise, StateSpace
from bayes_asv.models.car_model import (
    MAX_PRIOR_DISTANCE,
    NOISE_GIVEN_SD,
    NOISE_UNKNOWN_SD,
    CarModel,
    Values,
    state_space,
)
from bayes_asv.models.effects import Parameter, PlacedEffect, Scale
from bayes_asv.posterior.car_prior import CarPrior, effect_scale, prior_of_vehicle
from bayes_asv.preprocessing.measured_inputs import INPUT_BIAS_SD
from bayes_asv.preprocessing.prepared_recording import ClockError, PreparedRecording
from bayes_asv.preprocessing.quantization import noise_level

__all__ = [
    "Coordinate", "EffectValues", "ParameterSpace", "make_parameter_space",
]  # fmt: skip

Array = NDArray[np.float64]
EffectValues = dict[PlacedEffect, dict[str, float]]

# Bounds on the logarithm of a noise level relative to its prior centre: at most a factor of 1.5, or
# 2 if the level is undeclared, so that noise cannot absorb a misfit.
_TIGHT_CAP, _UNKNOWN_CAP = 0.4, 0.7
_TIGHT_SD = 0.2  # prior sd of the logarithm of a declared noise level that is kept near its value
# Prior sd of the filtered share, probits: noise arises before a sensor's filter or after it, seldom
# half and half.
_TIGHT_SHARE = 3.0
_SHARE_HELD = 0.5  # filtered share where it is not sampled: beside a residual autoregression

Kind = Literal[
    "car", "fraction", "gain", "effect", "clock", "noise", "filtered_share", "input_bias"
]


@dataclass(frozen=True)
class Coordinate:
    """One coordinate.

    Parameters
    ----------
    kind : str
        Kind of quantity.
    name : str
        Unique name.
    centre, scale : float
        A quantity other than a direction of the car is ``centre + scale z`` (a logarithm for noise
        and gains, a probit for the filtered share).
    channel : str
        Channel of a gain or a noise level, element of an input bias, or name of a clock.
    run : int or None
        The only run that depends on it; None for all runs.
    placed : PlacedEffect or None
        Effect that it belongs to, if any.
    parameter : Parameter or None
        Parameter of that effect.
    """

    kind: Kind
    name: str
    centre: float = 0.0
    scale: float = 1.0
    channel: str = ""
    run: int | None = None
    placed: PlacedEffect | None = None
    parameter: Parameter | None = None


@dataclass(frozen=True)
class ParameterSpace:
    """Coordinates (D,) of a posterior, and their mapping to the arguments of a filter.

    Parameters
    ----------
    coordinates : tuple of Coordinate
        Block after block: car, gains, effects, single runs.
    prior : CarPrior
        Prior of the car.
    recordings : tuple of PreparedRecording
        The recordings.
    likelihood : str
        ``innovations``, or ``output-error`` and ``coloured`` in which inputs have no noise.
    held : tuple of (C,) arrays
        Noise level of each channel of each run (SI units), used where it is not sampled.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    sizes : Scale
        Reference sizes in which the priors of effects are expressed.
    tight_noise : bool
        Whether noise levels are bounded near the centre of their prior.
    sensors : tuple of int
        For each run, the run whose coordinates describe the noise of its sensors: the first of the
        pieces of one log, which share their sensors.  By default each run has its own.
    """

    coordinates: tuple[Coordinate, ...]
    prior: CarPrior
    recordings: tuple[PreparedRecording, ...]
    likelihood: str
    held: tuple[Array, ...]
    placed_effects: tuple[PlacedEffect, ...] = ()
    sizes: Scale = field(default_factory=lambda: Scale(1.0, 1.0))
    tight_noise: bool = False
    sensors: tuple[int, ...] = ()

    @property
    def car(self) -> CarModel:
        """The car."""
        return self.prior.car

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(c.name for c in self.coordinates)

    @cached_property
    def index(self) -> dict[str, int]:
        """Number of each coordinate by name."""
        return {name: k for k, name in enumerate(self.names)}

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def origin(self) -> Array:
        """Coordinates (D,) of the prior's centre, with clock errors as prepared."""
        z = np.zeros(self.dimension)
        for k, one, error in self._clocks():
            z[k] = (error - one.centre) / one.scale
        return z

    def scales(self, usual: float) -> Array:
        """Return initial steps (D,) of a search: ``usual``, for clocks those of the variants."""
        out = np.full(self.dimension, usual)
        for run, recording in enumerate(self.recordings):
            if recording.clock_variants is not None:
                for k, step in zip(
                    self.clock_coordinates(run), recording.clock_variants.step, strict=True
                ):
                    out[k] = step / self.coordinates[k].scale
        return out

    def _clocks(self) -> Iterator[tuple[int, Coordinate, float]]:
        """Coordinates of clock errors, and the errors with which recordings were prepared."""
        for run, recording in enumerate(self.recordings):
            if recording.clock_variants is not None:
                for k, error in zip(
                    self.clock_coordinates(run), recording.clock_variants.middle, strict=True
                ):
                    yield k, self.coordinates[k], float(error)

    def clock_coordinates(self, run: int) -> list[int]:
        """Coordinates of the errors of a run's clocks."""
        variants = self.recordings[run].clock_variants
        return (
            [] if variants is None else [self.index[_clock_name(e, run)] for e in variants.errors]
        )

    def clock_errors(self, z: Array, run: int) -> Array:
        """Errors (W, K) of a run's clocks at coordinates (W, D)."""
        picked = self.clock_coordinates(run)
        centre = np.array([self.coordinates[k].centre for k in picked])
        scale = np.array([self.coordinates[k].scale for k in picked])
        return np.asarray(centre + z[:, picked] * scale)

    @cached_property
    def car_dimension(self) -> int:
        """Number of coordinates of the car, which come first."""
        return sum(c.kind in ("car", "fraction") for c in self.coordinates)

    @cached_property
    def shared_dimension(self) -> int:
        """Number of coordinates of the car, of gains and of effects, which come first."""
        return self.car_dimension + sum(c.kind in ("gain", "effect") for c in self.coordinates)

    @cached_property
    def heavy_tailed(self) -> NDArray[np.bool_]:
        """Which coordinates (D,) are those of parameters with a hyperbolic-sine prior."""
        names = {
            placed.coordinate_name(p)
            for placed in self.placed_effects
            for p in placed.effect.parameters
            if p.form == "sinh"
        }
        return np.array([name in names for name in self.names], bool)

    def effects(self, z: Array) -> EffectValues:
        """Values of the effects' parameters, SI units, at coordinates (D,)."""
        return {
            placed: {
                p.name: float(p.value(z[self.index[placed.coordinate_name(p)]], self.sizes))
                for p in placed.effect.parameters
            }
            for placed in self.placed_effects
        }

    def effect_draws(self, z: Array) -> dict[PlacedEffect, dict[str, Array]]:
        """Values (N,) of the reported parameters of effects, at coordinates (N, D)."""
        return {
            placed: {name: x for name, x in self._of_effect(placed, z).items() if name in reported}
            for placed in self.placed_effects
            for reported in [{p.name for p in placed.effect.parameters if not p.shape}]
        }

    def _of_effect(self, placed: PlacedEffect, z: Array) -> dict[str, Array]:
        """Values (W,) of an effect's parameters at coordinates (W, D)."""
        return {
            p.name: p.value(z[:, self.index[placed.coordinate_name(p)]], self.sizes)
            for p in placed.effect.parameters
        }

    def values(self, z: Array, unidentified: Array | None = None) -> Values:
        """Map coordinates (W, D) to the car's parameters by name, each (W,), SI units.

        Parameters
        ----------
        z : (W, D) array
            Coordinates.
        unidentified : (W, nT − r) array, optional
            Standard normal coordinates of the unidentified directions; zero by default.
        """
        prior = self.prior
        zeta = z[:, : prior.identified.shape[1]] @ prior.identified.T
        if unidentified is not None:
            zeta = zeta + unidentified @ prior.unidentified.T
        logs = np.exp(prior.log_mean + zeta @ prior.root.T)
        out = {p.name: np.full(len(z), p.nominal) for p in self.car.parameters}
        out |= dict(zip(prior.log_parameters, logs.T, strict=True))
        for k, coordinate in enumerate(self.coordinates[: self.car_dimension]):
            if coordinate.kind == "fraction":
                out[coordinate.name] = coordinate.centre + coordinate.scale * z[:, k]
        for placed in self.placed_effects:
            if placed.effect.on_car is not None:
                placed.effect.on_car(out, self._of_effect(placed, z), placed.where, self.car)
        return out

    def cars(self, z: Array, unidentified: Array | None = None) -> Array:
        """Map coordinates (W, D) to the car's parameters (W, P); see :meth:`values`."""
        values = self.values(z, unidentified)
        return np.stack([values[name] for name in self.car.names], axis=1)

    def quantities(self, z: Array, seed: int) -> dict[str, Array]:
        """Physical quantities of the car by name, SI units, for coordinates (N, D).

        Parameters
        ----------
        z : (N, D) array
            Coordinates.
        seed : int
            Seed of the draws of unidentified directions, which keep their prior independently of
            all other coordinates.

        Returns
        -------
        dict of str to (N,) array
            The parameters of the car that vary, and quantities derived from them.
        """
        rng = np.random.default_rng([seed, 2])
        values = self.values(z, rng.normal(size=(len(z), self.prior.unidentified.shape[1])))
        named = {name: x for name, x in values.items() if np.ptp(x) > 0.0}
        return named if self.car.derived is None else {**named, **self.car.derived(values)}

    def gains(self, z: Array, run: int) -> tuple[Array, Array]:
        """Sensor gains (W, nu) of a run's inputs and (W, ny) of its outputs: reading over truth."""
        recording = self.recordings[run]
        gains = np.ones((len(z), len(recording.channels)))
        for k, coordinate in enumerate(self.coordinates):
            if coordinate.kind != "gain":
                continue
            for c, channel in enumerate(recording.channels):
                if channel.name == coordinate.channel and recording.scale_sd[c] > 0.0:
                    gains[:, c] *= np.exp(coordinate.centre + coordinate.scale * z[:, k])
        for placed in self.placed_effects:
            if placed.effect.on_gain is not None:
                for c, channel in enumerate(recording.channels):
                    if channel.name == placed.where:
                        gains[:, c] *= placed.effect.on_gain(self._of_effect(placed, z))
        return gains[:, list(recording.inputs)], gains[:, list(recording.outputs)]

    def state_space(self, z: Array, run: int) -> StateSpace:
        """State-space models of one run at coordinates (W, D)."""
        recording = self.recordings[run]
        return state_space(
            self.car, self.values(z), recording.output_models, self.gains(z, run),
            recording.bias_directions,
        )  # fmt: skip

    def noises(self, z: Array, run: int) -> SensorNoise:
        """Noise of one run's sensors at coordinates (W, D)."""
        recording = self.recordings[run]
        order = recording.order
        white, filtered, poles = (np.zeros((len(z), len(order))) for _ in range(3))
        share = self._share(z, run)
        for column, c in enumerate(order):
            channel = recording.channels[c].name
            k = self.index.get(f"noise {channel} {self._sensors_of(run)}")
            if k is not None:
                variance = np.exp(2.0 * self._level(z, k))
            elif self.held[run][c] > 0.0:
                variance = np.full(len(z), self.held[run][c] ** 2)
            else:
                continue  # inputs without noise
            passed = share if recording.poles[c] > 0.0 else 0.0 * share
            white[:, column] = (1.0 - passed) * variance + recording.quantization_steps[
                c
            ] ** 2 / 12.0
            filtered[:, column] = passed * variance
            poles[:, column] = recording.poles[c]
            for placed in self.placed_effects:
                if placed.effect.on_pole is not None and placed.where == channel:
                    poles[:, column] *= placed.effect.on_pole(self._of_effect(placed, z))
        return SensorNoise(white, filtered, poles)

    def _level(self, z: Array, k: int) -> Array:
        """Logarithm (W,) of a noise level."""
        one = self.coordinates[k]
        if not self.tight_noise:
            return np.asarray(one.centre + one.scale * z[:, k])
        cap = _TIGHT_CAP if one.scale < NOISE_GIVEN_SD else _UNKNOWN_CAP
        return np.asarray(one.centre + cap * np.tanh(one.scale * z[:, k] / cap))

    def _sensors_of(self, run: int) -> int:
        """Return the run whose coordinates describe the noise of a run's sensors."""
        return self.sensors[run] if self.sensors else run

    def _share(self, z: Array, run: int) -> Array:
        """Share (W,) of the noise variance that passed the sensor's filter."""
        k = self.index.get(f"filtered share {self._sensors_of(run)}")
        if k is not None:
            one = self.coordinates[k]
            return np.asarray(ndtr(one.centre + one.scale * z[:, k]))
        filtered = self.likelihood == "innovations" and np.any(self.recordings[run].poles > 0.0)
        return np.full(len(z), _SHARE_HELD if filtered else 0.0)

    def input_biases(self, z: Array, run: int) -> Array:
        """Biases (W, nu) of a run's inputs, m/s², at coordinates (W, D)."""
        out = np.zeros((len(z), len(self.car.elements)))
        for e, element in enumerate(self.car.elements):
            k = self.index.get(f"input bias {element.name} {run}")
            if k is not None:
                out[:, e] = self.coordinates[k].centre + self.coordinates[k].scale * z[:, k]
        return out

    def nuisance(self, z: Array) -> dict[str, Array]:
        """Noise levels, gains, filtered shares and clock errors by name, each (W,), SI units."""
        out: dict[str, Array] = {}
        for k, one in enumerate(self.coordinates):
            if one.kind == "noise":
                level = np.exp(self._level(z, k))
                out |= {f"noise {one.channel} {run}": level for run in self._with_sensors(one.run)}
            elif one.kind == "gain":
                out[one.name] = np.exp(one.centre + one.scale * z[:, k])
            elif one.kind == "filtered_share":
                share = np.asarray(ndtr(one.centre + one.scale * z[:, k]))
                out |= {f"filtered share {run}": share for run in self._with_sensors(one.run)}
            elif one.kind == "clock":
                out[one.name] = np.asarray(one.centre + one.scale * z[:, k])
        return out

    def _with_sensors(self, owner: int | None) -> list[int]:
        """Return the runs whose sensor noise is described by the coordinates of run ``owner``."""
        return [run for run in range(len(self.recordings)) if self._sensors_of(run) == owner]

    def log_prior(self, z: Array) -> Array:
        """Log density (W,) of the prior; −inf for impossible cars."""
        value = -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * math.log(2.0 * math.pi)
        bad = np.any(~(np.abs(z) < MAX_PRIOR_DISTANCE), axis=1)
        for k, one in enumerate(self.coordinates[: self.car_dimension]):
            if one.kind == "fraction":
                fraction = one.centre + one.scale * z[:, k]
                bad |= (fraction <= 0.01) | (fraction >= 0.99)
        return np.where(bad, -np.inf, value)

    def coordinates_of_run(self, run: int) -> NDArray[np.int64]:
        """Coordinates that one run's likelihood depends on."""
        owners = {True: (None, self._sensors_of(run)), False: (None, run)}
        return np.array(
            [
                k
                for k, one in enumerate(self.coordinates)
                if one.run in owners[one.kind in ("noise", "filtered_share")]
            ],
            np.int64,
        )

    def from_logs(self, shift: dict[str, float]) -> Array:
        """Coordinates (D,) of the prior's centre with some logarithms shifted."""
        z = np.zeros(self.dimension)
        prior = self.prior
        shifts = np.array([shift.get(name, 0.0) for name in prior.log_parameters])
        shifts[prior.log_sd == 0.0] = 0.0
        zeta = np.linalg.lstsq(prior.root, shifts, rcond=1e-12)[0]
        z[: prior.identified.shape[1]] = zeta @ prior.identified
        return z

    def car_coordinates(self, draws: Mapping[str, Array]) -> Array:
        """Coordinates (…, n) of the car from draws of its parameters; inverse of `quantities`.

        Parameters
        ----------
        draws : mapping of str to (…) array
            At least the parameters that vary.
        """
        prior = self.prior
        shape = next(iter(draws.values())).shape
        shifts = np.zeros((*shape, len(prior.log_parameters)))
        for k, name in enumerate(prior.log_parameters):
            if name in draws and prior.log_sd[k] > 0.0:
                shifts[..., k] = np.log(draws[name]) - prior.log_mean[k]
        zeta = shifts @ np.linalg.pinv(prior.root).T
        out = np.zeros((*shape, self.car_dimension))
        out[..., : prior.identified.shape[1]] = zeta @ prior.identified
        for k, one in enumerate(self.coordinates[: self.car_dimension]):
            if one.kind == "fraction":
                out[..., k] = (draws[one.name] - one.centre) / one.scale
        return out

    def nuisance_coordinates(self, values: Mapping[str, Array]) -> Array:
        """Coordinates (…, D − n) of nuisance parameters; inverse of `nuisance`, no effects."""
        out = []
        for one in self.coordinates[self.car_dimension :]:
            value = values[one.name]
            if one.kind != "clock":
                value = ndtri(value) if one.kind == "filtered_share" else np.log(value)
            out.append((value - one.centre) / one.scale)
        return np.stack(out, axis=-1)

    def log_slopes(self, name: str) -> Array:
        """Return the derivatives (r,) of a parameter's logarithm by identified coordinates."""
        prior = self.prior
        return np.asarray(prior.root[prior.log_parameters.index(name)] @ prior.identified)

    def log_deviation(self, covariance: Array, name: str) -> float:
        """Posterior standard deviation of the logarithm of a parameter.

        Parameters
        ----------
        covariance : (D, D) array
            Of the coordinates.
        name : str
            The parameter.
        """
        prior = self.prior
        slopes = self.log_slopes(name)
        r = len(slopes)
        unidentified = prior.root[prior.log_parameters.index(name)] @ prior.unidentified
        return float(math.sqrt(slopes @ covariance[:r, :r] @ slopes + unidentified @ unidentified))

    def log_prior_of(self, name: str) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of a parameter a priori."""
        k = self.prior.log_parameters.index(name)
        return float(self.prior.log_mean[k]), float(self.prior.log_sd[k])


def _clock_name(error: ClockError, run: int) -> str:
    """Name of the coordinate of a clock error; the drift of a clock is common to all runs."""
    return f"clock {error.kind} {error.clock}" + (f" {run}" if error.kind == "offset" else "")


def make_parameter_space(
    vehicle: Vehicle,
    recordings: tuple[PreparedRecording, ...],
    likelihood: str = "innovations",
    fixed_noise_runs: frozenset[int] = frozenset(),
    placed_effects: tuple[PlacedEffect, ...] = (),
    tight_noise: bool = False,
) -> ParameterSpace:
    """Set up the coordinates for a vehicle and its recordings.

    Parameters
    ----------
    vehicle : Vehicle
        Gives the priors of the car, and the sizes in which the priors of effects are expressed.
    recordings : tuple of PreparedRecording
        The recordings, in order, all of one car.
    likelihood : str
        ``innovations``, or ``output-error`` and ``coloured`` in which inputs have no noise.
    fixed_noise_runs : frozenset of int
        Runs whose noise levels are fixed at the centre of their prior: with a residual
        autoregression they only shape the filter, and the autoregression sets the scale.
    placed_effects : tuple of PlacedEffect
        Effects that the car and its sensors have.
    tight_noise : bool
        Bound noise levels near the declared ones.

    Returns
    -------
    ParameterSpace
    """
    outputs = tuple(dict.fromkeys(o for one in recordings for o in one.output_models))
    prior = prior_of_vehicle(recordings[0].car.name, vehicle, outputs)
    car = prior.car
    coordinates = [Coordinate("car", f"car-{k}") for k in range(prior.identified.shape[1])]
    coordinates += [
        Coordinate("fraction", p.name, p.nominal, p.terms[0][2])
        for p in car.parameters
        if p.kind == "fraction" and p.terms[0][2] > 0.0
    ]
    scale_sd: dict[str, float] = {}
    for recording in recordings:  # a sensor has one gain in all runs
        for c, channel in enumerate(recording.channels):
            known = scale_sd.get(channel.name, 0.0)
            scale_sd[channel.name] = max(known, float(recording.scale_sd[c]))
    coordinates += [
        Coordinate("gain", f"gain {channel}", 0.0, sd, channel=channel)
        for channel, sd in scale_sd.items()
        if sd > 0.0
    ]
    for placed in placed_effects:
        coordinates += [
            Coordinate(
                "effect", placed.coordinate_name(p), placed=placed, parameter=p, run=placed.run
            )
            for p in placed.effect.parameters
        ]
    clocks = {
        _clock_name(error, run): Coordinate(
            "clock", _clock_name(error, run), error.centre, error.sd, error.clock,
            run if error.kind == "offset" else None,
        )
        for run, recording in enumerate(recordings)
        if recording.clock_variants is not None
        for error in recording.clock_variants.errors
    }  # fmt: skip
    coordinates += clocks.values()
    with_travel = [
        element.name
        for element in car.elements
        if any(placed.effect.travel and element.is_at(placed.where) for placed in placed_effects)
    ]
    noise_levels = []
    sensors = _sensors(recordings, fixed_noise_runs)
    for run, recording in enumerate(recordings):
        levels = np.zeros(len(recording.channels))
        samples_noise = run not in fixed_noise_runs and sensors[run] == run
        for c, channel in enumerate(recording.channels):
            if likelihood != "innovations" and channel.is_input:
                continue
            noise = recording.noise[c]
            levels[c] = noise_level(recording, c) if noise is None else noise
            if samples_noise:
                sd = NOISE_UNKNOWN_SD if noise is None else NOISE_GIVEN_SD
                if tight_noise and noise is not None:
                    sd = _TIGHT_SD
                coordinates.append(
                    Coordinate(
                        "noise",
                        f"noise {channel.name} {run}",
                        math.log(levels[c]),
                        sd,
                        channel=channel.name,
                        run=run,
                    )
                )
        noise_levels.append(levels)
        filtered = likelihood == "innovations" and bool(np.any(recording.poles > 0.0))
        if filtered and samples_noise:
            width = _TIGHT_SHARE if tight_noise else 1.0
            coordinates.append(
                Coordinate("filtered_share", f"filtered share {run}", 0.0, width, run=run)
            )
        coordinates += [
            Coordinate(
                "input_bias", f"input bias {name} {run}", 0.0, INPUT_BIAS_SD, channel=name, run=run
            )
            for name in with_travel
        ]
    return ParameterSpace(
        coordinates=tuple(coordinates),
        prior=prior,
        recordings=recordings,
        likelihood=likelihood,
        held=tuple(noise_levels),
        placed_effects=placed_effects,
        sizes=effect_scale(car),
        tight_noise=tight_noise,
        sensors=sensors,
    )


def _sensors(
    recordings: tuple[PreparedRecording, ...], fixed_noise_runs: frozenset[int]
) -> tuple[int, ...]:
    """Find the first run of each run's log, among those whose noise levels are not fixed."""
    first: dict[str, int] = {}
    return tuple(
        run
        if run in fixed_noise_runs or not one.log_sha256
        else first.setdefault(one.log_sha256, run)
        for run, one in enumerate(recordings)
    )
