"""Car and sensors as the online filter takes them: sizes, arrays for compiled code, and outputs."""

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

__all__ = ["FilterModel", "StandstillBias", "filter_model", "standstill_bias", "twists"]

Array = NDArray[np.float64]

_DRIFT_SECONDS = 20.0  # time constant of the random walk while a drift is detected
_MOST_FACTORS = 4  # of a term of the geometry
_AT_REST = 1.0  # N: deviation of a filtered force when a recording begins
# At standstill: a deflection along a twist changes nothing that a bias of the outputs could not.
_TWIST, _TWIST_RATE = 1e-3, 1e-2  # m and m/s


class StandstillBias(NamedTuple):
    """Biases of the inputs along their directions, from the mean of readings at standstill.

    Parameters
    ----------
    mean, sd : (nd,) arrays
        m/s².
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
        Numbers of the channels that are inputs and outputs.
    sizes : Sizes
        Sizes of the filter.
    start_mean : (ns,) array
        Prior mean of the states.
    initial : int array
        States that are unknown when a recording begins; filtered forces follow from them.
    arrays : Model
        Figures for compiled code.
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
        """Places of the statistics of the filter's state."""
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
        follow such a twist, no spring resists it, and a bias of the wheel sensors along it grows
        with time: while the parameters are unknown as well, an unknown bias would hide them.
    rate : float
        Rows per second, Hz; limits the band of forces where no sensor's filter is declared.

    Raises
    ------
    InputError
        If the car has a geometry that compiled code cannot evaluate.
    """
    car, outputs = coordinates.car, sensors.output_models
    found = trace(car, outputs, _symbols(coordinates))
    system = state_space(car, car.nominal, outputs)
    directions = bias_directions(system)
    names, P = car.names, len(car.names)
    ne, n, ny, nd = len(car.elements), len(car.coordinates), len(outputs), directions.shape[1]
    effects = coordinates.law_effects
    size = sizes(
        elements=ne, rates=found.rates, coordinates=n, rows=ne + len(found.points), directions=nd,
        outputs=ny, parameters=len(coordinates.base),
        answers=len(coordinates.estimands) + len(effects), bars=int(np.any(found.bars != 0.0)),
        forces=ne if effects else 0,
    )  # fmt: skip
    place, copies = _places(car, sensors, found.entries, len(coordinates.base))
    # prior of (x, d, b) in the order (x, filtered forces, b, d)
    nx = size.motion - size.forces
    order = [*range(nx), *range(nx + nd, nx + nd + ny), *range(nx, nx + nd)]
    initial = np.array([*range(nx), *range(size.motion, size.lasting)])
    start = _AT_REST**2 * np.eye(size.lasting)
    start[np.ix_(initial, initial)] = initial_covariance(
        system._replace(N=directions), outputs
    )[np.ix_(order, order)]  # fmt: skip
    mean = np.zeros(size.states)
    if standstill is not None:
        first = size.motion + ny
        mean[first : first + nd] = standstill.mean
        start[first : first + nd] = start[:, first : first + nd] = 0.0
        start[first : first + nd, first : first + nd] = np.diag(standstill.sd**2)
        twist = _twists(car)
        for of, sd in ((0, _TWIST), (1, _TWIST_RATE)):
            states = np.ix_(range(of, 2 * ne, 2), range(of, 2 * ne, 2))
            follow = np.eye(ne) - twist @ twist.T
            start[states] = follow @ start[states] @ follow + sd**2 * twist @ twist.T
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
        **_terms(found.entries, names, place),
        place=place,
        copies=copies,
        uncertain_gains=any(P + c in coordinates.element for c in sensors.inputs),
        bars=found.bars,
        output_row=found.output_row,
        by_row=found.by_row,
        by_state=found.by_state,
        reads_states=bool(found.by_state.any()),
        laws=law_table(
            car, effects, len(coordinates.base) - len(effects),
            float(np.max(sensors.poles)) or 2.0 * np.pi * NO_FILTER * rate,
        ),
    )  # fmt: skip
    return FilterModel(
        coordinates, outputs, sensors.inputs, sensors.outputs, size, mean, initial, arrays
    )


def twists(car: CarModel) -> bool:
    """Whether the wheels of a car can move in a way that its body cannot follow."""
    return len(car.elements) > len(car.coordinates)


def _twists(car: CarModel) -> Array:
    """Orthonormal motions (ne, k) of the wheels that the body cannot follow."""
    left, strength, _ = np.linalg.svd(car.heights(car.nominal)[0])
    return np.asarray(left[:, np.count_nonzero(strength > 1e-10 * strength[0]) :])


def standstill_bias(sensors: SensorModel, early: Array, rate: float) -> StandstillBias:
    """Estimate the biases of the inputs from the first readings, taken at standstill.

    Parameters
    ----------
    sensors : SensorModel
        With the poles of the sensors, which correlate their noise.
    early : (n, C) array
        Readings; NaN where missing.
    rate : float
        Rows per second, Hz.
    """
    outputs = sensors.output_models
    directions = bias_directions(state_space(sensors.car, sensors.car.nominal, outputs))
    along = early[:, list(sensors.inputs)] @ directions
    along = along[np.isfinite(along).all(axis=1)]
    if len(along) < _FEWEST:
        return StandstillBias(np.zeros(directions.shape[1]), np.full(directions.shape[1], _BIAS))
    pole = float(np.max(sensors.poles[list(sensors.inputs)]))
    correlation = np.exp(-pole / rate) if pole > 0.0 else 0.0
    spread = along.var(axis=0) * (1.0 + correlation) / (1.0 - correlation)
    # What one step hides does not average out at standstill.
    steps = sensors.resolution[list(sensors.inputs)] ** 2 / 12.0 + _LEAST**2
    variance = spread / len(along) + steps @ directions**2
    return StandstillBias(along.mean(axis=0), np.sqrt(variance))


_FEWEST = 20  # rows from which a mean is taken
_LEAST = 1e-3  # m/s², a ten-thousandth of gravity, below which no bias is known
_BIAS = 0.7  # m/s²: deviation of a sensor's bias, see models.outputs


def _symbols(coordinates: Coordinates) -> dict[str, Any]:
    """Parameters of the car: numbers where they are exact, polynomials where they are not."""
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
    the geometry's polynomials, and of parameters that are none of these.
    """
    names, P = car.names, len(car.names)
    wanted = [names.index(e.damping) for e in car.elements]
    wanted += [names.index(e.spring) for e in car.elements]
    wanted += [P + c for c in (*sensors.inputs, *sensors.outputs)]
    rows = list(enumerate(wanted))
    for number, entry in enumerate(entries, len(wanted)):
        alone = _alone(entry)
        if alone is not None:
            rows.append((number, names.index(alone)))
    place = np.arange(parameters) + len(wanted) + len(entries)
    taken: set[int] = set()
    copies = []
    for row, parameter in rows:
        if parameter in taken:
            copies.append((row, place[parameter]))
        else:
            place[parameter] = row
            taken.add(parameter)
    return place, np.array(copies, np.int64).reshape(-1, 2)


def _alone(entry: Polynomial) -> str | None:
    """Name of the parameter that a polynomial is; None where it is another."""
    if len(entry.terms) == 1:
        ((product, value),) = entry.terms.items()
        if len(product) == 1 and value == 1.0:
            return product[0]
    return None


def _terms(
    entries: list[Polynomial], names: tuple[str, ...], place: NDArray[np.int64]
) -> dict[str, Any]:
    """Figures of polynomials, as :class:`bayes_asv.filters.ukf_state.Model` names them."""
    constant = np.zeros(len(entries))
    term: list[tuple[int, int]] = []
    coefficient: list[float] = []
    factors: list[list[int]] = []
    for number, entry in enumerate(entries):
        if _alone(entry) is not None:
            continue  # the parameter has its row
        for product, value in entry.terms.items():
            if not product:
                constant[number] = value
                continue
            if len(product) > _MOST_FACTORS:
                raise InputError(
                    "the car", "has a geometry of too high a degree",
                    "estimate its parameters instead of tracking them",
                )  # fmt: skip
            own = [int(place[names.index(name)]) for name in product]
            term.append((number, own[0] if len(own) == 1 else -1))
            coefficient.append(value)
            factors.append(own + [-1] * (_MOST_FACTORS - len(own)))
    return {
        "constant": constant,
        "term": np.array(term, np.int64).reshape(-1, 2),
        "coefficient": np.array(coefficient),
        "factors": np.array(factors, np.int64).reshape(-1, _MOST_FACTORS),
    }


def _noise_shares(car: CarModel, outputs: tuple[Output, ...]) -> Array:
    """Shares (ne, ny) of the outputs' noise factors in those of the inputs.

    An input has the mean factor of the outputs that are nearest: at its element, else at its axle,
    else of all.
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
