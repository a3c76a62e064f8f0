"""Car and sensors for the online filter: sizes, arrays for compiled code, and outputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.filters.ukf_state import (
    Columns,
    Model,
    Sizes,
    Statistics,
    columns,
    sizes,
    statistics,
)
from bayes_asv.models.car_model import (
    CarModel,
    Output,
    bias_directions,
    initial_covariance,
    state_space,
)
from bayes_asv.posterior.effects import NO_FILTER
from bayes_asv.tracking.effects import law_table
from bayes_asv.tracking.geometry import Polynomial, trace
from bayes_asv.tracking.parameters import Coordinates
from bayes_asv.tracking.sensor_noise import SensorModel

__all__ = ["FilterModel", "StandstillBias", "filter_model", "has_warp", "standstill_bias"]

Array = NDArray[np.float64]

_DRIFT_SECONDS = 20.0  # time constant of the random walk while a drift is detected, s
_MOST_FACTORS = 4  # largest number of factors of a term of the geometry
_AT_REST = 1.0  # prior sd of a filtered force at the start of a recording, N
# Prior sd at standstill of a deflection along a twist of the wheels, m, and of its rate, m/s: such
# a deflection is equivalent to biases of the outputs.
_TWIST, _TWIST_RATE = 1e-3, 1e-2


class StandstillBias(NamedTuple):
    """Biases of the inputs along their directions, from the mean of readings at standstill.

    Parameters
    ----------
    mean, sd : (nd,) arrays
        Mean and standard deviation, m/s².
    """

    mean: Array
    sd: Array


@dataclass(frozen=True)
class FilterModel:
    """Car and sensors.

    Parameters
    ----------
    coordinates : Coordinates
        Parameters and their priors.
    outputs : tuple of Output
        Measured outputs.
    inputs, output_channels : tuple of int
        Indices of the channels that are inputs and outputs.
    sizes : Sizes
        Sizes of the filter.
    start_mean : (ns,) array
        Prior mean of the states.
    initial : int array
        States that are unknown when a recording begins; filtered forces follow from them.
    arrays : Model
        Arrays for compiled code.
    """

    coordinates: Coordinates
    outputs: tuple[Output, ...]
    inputs: tuple[int, ...]
    output_channels: tuple[int, ...]
    sizes: Sizes
    start_mean: Array
    initial: NDArray[np.int64]
    arrays: Model

    @property
    def at(self) -> Statistics:
        """Indices of the statistics of the filter's state."""
        return statistics(self.sizes.outputs)

    @property
    def into(self) -> Columns:
        """Columns of a row of results."""
        return columns(self.sizes)

    def with_constant_parameters(self) -> FilterModel:
        """Return the model without a random walk of the parameters."""
        none = np.zeros_like(self.arrays.parameter_noise)
        return replace(self, arrays=self.arrays._replace(parameter_noise=none, drift_noise=none))


def filter_model(
    coordinates: Coordinates,
    sensors: SensorModel,
    forget: float | None = None,
    standstill: StandstillBias | None = None,
    rate: float = 400.0,
) -> FilterModel:
    """Assemble the model of car and sensors.

    Parameters
    ----------
    coordinates : Coordinates
        Parameters and their priors.
    sensors : SensorModel
        Sensors with their noise.
    forget : float, optional
        Time constant of the parameters' random walk, s; constant parameters without it.
    standstill : StandstillBias, optional
        Biases of the inputs, for a car whose wheels can twist against each other.  The body cannot
        follow such a twist and no spring resists it, so the effect of a bias along it grows with
        time: an unknown bias would make the parameters unidentifiable.
    rate : float
        Rows per second, Hz; limits the band of forces where no sensor's filter is declared.

    Raises
    ------
    InputError
        If the car has a geometry that compiled code cannot evaluate.
    """
    car, outputs = coordinates.car, sensors.output_models
    geometry = trace(car, outputs, _symbols(coordinates))
    system = state_space(car, car.nominal, outputs)
    directions = bias_directions(system)
    names, P = car.names, len(car.names)
    ne, n, ny, nd = len(car.elements), len(car.coordinates), len(outputs), directions.shape[1]
    effects = coordinates.law_effects
    size = sizes(
        elements=ne, rates=geometry.rates, coordinates=n, rows=ne + len(geometry.points),
        directions=nd, outputs=ny, parameters=len(coordinates.base),
        answers=len(coordinates.estimands) + len(effects), bars=int(np.any(geometry.bars != 0.0)),
        forces=ne if effects else 0,
    )  # fmt: skip
    place, copies = _places(car, sensors, geometry.entries, len(coordinates.base))
    # prior of (x, d, b) in the order (x, filtered forces, b, d)
    nx = size.motion - size.forces
    order = [*range(nx), *range(nx + nd, nx + nd + ny), *range(nx, nx + nd)]
    initial = np.array([*range(nx), *range(size.motion, size.lasting)])
    start = _AT_REST**2 * np.eye(size.lasting)
    start[np.ix_(initial, initial)] = initial_covariance(
        system._replace(N=directions), outputs
    )[np.ix_(order, order)]  # fmt: skip
    start_mean = np.zeros(size.states)
    if standstill is not None:
        first = size.motion + ny
        start_mean[first : first + nd] = standstill.mean
        start[first : first + nd] = start[:, first : first + nd] = 0.0
        start[first : first + nd, first : first + nd] = np.diag(standstill.sd**2)
        twist = _warp(car)
        for of, sd in ((0, _TWIST), (1, _TWIST_RATE)):
            states = np.ix_(range(of, 2 * ne, 2), range(of, 2 * ne, 2))
            projection = np.eye(ne) - twist @ twist.T
            start[states] = projection @ start[states] @ projection + sd**2 * twist @ twist.T
    arrays = Model(
        base=coordinates.base,
        element=coordinates.element,
        log=coordinates.log,
        centre=coordinates.centre,
        scale=coordinates.scale,
        factor=coordinates.factor,
        noise=sensors.noise_parameters(),
        share=_noise_shares(car, outputs),
        start=np.ascontiguousarray(start),
        input_bias=np.ascontiguousarray(directions),
        parameter_noise=coordinates.parameter_noise(forget),
        drift_noise=coordinates.parameter_noise(_DRIFT_SECONDS),
        **_terms(geometry.entries, names, place),
        place=place,
        copies=copies,
        uncertain_gains=any(P + c in coordinates.element for c in sensors.inputs),
        bars=geometry.bars,
        output_row=geometry.output_row,
        by_row=geometry.by_row,
        by_state=geometry.by_state,
        reads_states=bool(geometry.by_state.any()),
        laws=law_table(
            car, effects, len(coordinates.base) - len(effects),
            float(np.max(sensors.poles)) or 2.0 * np.pi * NO_FILTER * rate,
        ),
    )  # fmt: skip
    return FilterModel(
        coordinates, outputs, sensors.inputs, sensors.outputs, size, start_mean, initial, arrays
    )


def has_warp(car: CarModel) -> bool:
    """Whether the wheels of a car can move in a way that the body cannot follow."""
    return len(car.elements) > len(car.coordinates)


def _warp(car: CarModel) -> Array:
    """Orthonormal motions (ne, k) of the wheels that the body cannot follow."""
    left, strength, _ = np.linalg.svd(car.heights(car.nominal)[0])
    return np.asarray(left[:, np.count_nonzero(strength > 1e-10 * strength[0]) :])


def standstill_bias(sensors: SensorModel, early: Array, rate: float) -> StandstillBias:
    """Estimate the biases of the inputs from the first readings, taken at standstill.

    Parameters
    ----------
    sensors : SensorModel
        Sensors; their poles make the noise autocorrelated.
    early : (n, C) array
        Readings; NaN where missing.
    rate : float
        Rows per second, Hz.
    """
    outputs = sensors.output_models
    directions = bias_directions(state_space(sensors.car, sensors.car.nominal, outputs))
    projected = early[:, list(sensors.inputs)] @ directions
    projected = projected[np.isfinite(projected).all(axis=1)]
    if len(projected) < _FEWEST:
        return StandstillBias(np.zeros(directions.shape[1]), np.full(directions.shape[1], _BIAS))
    pole = float(np.max(sensors.poles[list(sensors.inputs)]))
    correlation = np.exp(-pole / rate) if pole > 0.0 else 0.0
    variance_of_rows = projected.var(axis=0) * (1.0 + correlation) / (1.0 - correlation)
    # the quantisation error does not average out at standstill
    steps = sensors.resolution[list(sensors.inputs)] ** 2 / 12.0 + _LEAST**2
    variance = variance_of_rows / len(projected) + steps @ directions**2
    return StandstillBias(projected.mean(axis=0), np.sqrt(variance))


_FEWEST = 20  # least number of rows for a mean
_LEAST = 1e-3  # least standard deviation of a bias, m/s²: a ten-thousandth of gravity
_BIAS = 0.7  # prior standard deviation of a sensor's bias, m/s², see models.outputs


def _symbols(coordinates: Coordinates) -> dict[str, Any]:
    """Parameters of the car: numbers if they are exact, polynomials otherwise."""
    values: dict[str, Any] = {p.name: p.nominal for p in coordinates.car.parameters}
    for name in values:
        if name in coordinates.names:
            values[name] = Polynomial({(name,): 1.0})
    for name, (other, ratio) in coordinates.tied.items():
        values[name] = Polynomial({(other,): ratio})
    return values


def _places(
    car: CarModel, sensors: SensorModel, entries: list[Polynomial], parameters: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the parameters in a lane, and further rows that are copies of them.

    The rows are those of the elements' dampings, springs and input gains, of the output gains, of
    the geometry's polynomials, and of all other parameters.
    """
    names, P = car.names, len(car.names)
    needed = [names.index(e.damping) for e in car.elements]
    needed += [names.index(e.spring) for e in car.elements]
    needed += [P + c for c in (*sensors.inputs, *sensors.outputs)]
    rows = list(enumerate(needed))
    for number, entry in enumerate(entries, len(needed)):
        single = _single_parameter(entry)
        if single is not None:
            rows.append((number, names.index(single)))
    place = np.arange(parameters) + len(needed) + len(entries)
    taken: set[int] = set()
    copies = []
    for row, parameter in rows:
        if parameter in taken:
            copies.append((row, place[parameter]))
        else:
            place[parameter] = row
            taken.add(parameter)
    return place, np.array(copies, np.int64).reshape(-1, 2)


def _single_parameter(entry: Polynomial) -> str | None:
    """Name of the parameter that a polynomial consists of; None for any other polynomial."""
    if len(entry.terms) == 1:
        ((product, value),) = entry.terms.items()
        if len(product) == 1 and value == 1.0:
            return product[0]
    return None


def _terms(
    entries: list[Polynomial], names: tuple[str, ...], place: NDArray[np.int64]
) -> dict[str, Any]:
    """Arrays of polynomials, for the fields of :class:`bayes_asv.filters.ukf_state.Model`."""
    constant = np.zeros(len(entries))
    term: list[tuple[int, int]] = []
    coefficient: list[float] = []
    factors: list[list[int]] = []
    for number, entry in enumerate(entries):
        if _single_parameter(entry) is not None:
            continue  # the parameter has a row already
        for product, value in entry.terms.items():
            if not product:
                constant[number] = value
                continue
            if len(product) > _MOST_FACTORS:
                raise InputError(
                    "the car", "has a geometry of too high a degree",
                    "estimate its parameters instead of tracking them",
                )  # fmt: skip
            rows_of_factors = [int(place[names.index(name)]) for name in product]
            term.append((number, rows_of_factors[0] if len(rows_of_factors) == 1 else -1))
            coefficient.append(value)
            factors.append(rows_of_factors + [-1] * (_MOST_FACTORS - len(rows_of_factors)))
    return {
        "constant": constant,
        "term": np.array(term, np.int64).reshape(-1, 2),
        "coefficient": np.array(coefficient),
        "factors": np.array(factors, np.int64).reshape(-1, _MOST_FACTORS),
    }


def _noise_shares(car: CarModel, outputs: tuple[Output, ...]) -> Array:
    """Weights (ne, ny) of the outputs' noise factors in those of the inputs.

    An input has the mean factor of the nearest outputs: at its element, else at its axle, else all.
    """
    out = np.zeros((len(car.elements), len(outputs)))
    for e, element in enumerate(car.elements):
        places = [(o.channel.axle, o.channel.side) for o in outputs]
        at_element = [place == (element.axle, element.side) for place in places]
        at_axle = [axle == element.axle for axle, _ in places]
        nearest = (
            at_element if any(at_element) else at_axle if any(at_axle) else [True] * len(places)
        )
        out[e, nearest] = 1.0 / sum(nearest)
    return out
