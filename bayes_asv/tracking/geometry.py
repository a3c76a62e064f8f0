"""Geometry of a car model for the compiled online filter.

The parameters change with every reading, so compiled code has to compute the accelerations of a car
from them.  The heights of its element tops, its masses and inertias, and the places of its sensors
differ from car model to car model: they are polynomials of its parameters, such as l (1 − w).  They
are found by calling the car's own functions with polynomials in place of numbers, so that a car is
defined only once, in :mod:`bayes_asv.models.cars`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.models.car_model import CarModel, Output
from bayes_asv.models.outputs import OUTPUTS, Motion

__all__ = ["Geometry", "Polynomial", "trace"]

Array = NDArray[np.float64]
Monomial = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A polynomial of named variables, for use in arrays of objects.

    Parameters
    ----------
    terms : mapping of tuple of str to float
        Coefficient by product of variables, whose names are sorted; the empty tuple is the
        constant.
    """

    terms: Mapping[Monomial, float]

    @staticmethod
    def of(value: Any) -> Polynomial:
        """Return a number as a polynomial, and a polynomial as it is."""
        if isinstance(value, Polynomial):
            return value
        return Polynomial({(): float(value)} if value else {})

    def __add__(self, other: Any) -> Polynomial:
        terms = dict(self.terms)
        for name, value in Polynomial.of(other).terms.items():
            terms[name] = terms.get(name, 0.0) + value
        return Polynomial({name: value for name, value in terms.items() if value != 0.0})

    def __mul__(self, other: Any) -> Polynomial:
        terms: dict[Monomial, float] = {}
        for a, x in self.terms.items():
            for b, y in Polynomial.of(other).terms.items():
                name = tuple(sorted(a + b))
                terms[name] = terms.get(name, 0.0) + x * y
        return Polynomial({name: value for name, value in terms.items() if value != 0.0})

    def __neg__(self) -> Polynomial:
        return self * -1.0

    def __sub__(self, other: Any) -> Polynomial:
        return self + -Polynomial.of(other)

    def __rsub__(self, other: Any) -> Polynomial:
        return Polynomial.of(other) - self

    def __truediv__(self, number: float) -> Polynomial:
        return self * (1.0 / number)

    def __pow__(self, power: int) -> Polynomial:
        out = Polynomial({(): 1.0})
        for _ in range(power):
            out = out * self
        return out

    __radd__ = __add__
    __rmul__ = __mul__

    def multiple_of(self, other: Polynomial) -> float | None:
        """Return its ratio to another polynomial; None if it is not a multiple of that one."""
        if not other.terms:
            return None if self.terms else 0.0
        name, value = next(iter(other.terms.items()))
        factor = self.terms.get(name, 0.0) / value
        return None if (self - other * factor).terms else factor


@dataclass(frozen=True)
class Geometry:
    """Geometry of a car as polynomials of its parameters, and the equations of its outputs.

    Parameters
    ----------
    heights : (ne, n) list of Polynomial
        Heights of the element tops per unit of the coordinates.
    inertia : (n,) list of Polynomial
        Masses and inertias of the coordinates.
    points : (nR − ne, n) list of Polynomial
        Additional rows of accelerations: the coordinates of body rates, and other places.
    rates : int
        Number of body rates.
    output_row, by_row : (ny,) int and float arrays
        Row of accelerations in each output, and its coefficient.
    by_state : (ny, nx) array
        Coefficients of the states in each output.
    bars : (ne, ne) array
        Stiffness of anti-roll bars, in addition to the springs.
    """

    heights: list[list[Polynomial]]
    inertia: list[Polynomial]
    points: list[list[Polynomial]]
    rates: int
    output_row: NDArray[np.int64]
    by_row: Array
    by_state: Array
    bars: Array

    @property
    def entries(self) -> list[Polynomial]:
        """All polynomials, in the order of the compiled filter."""
        rows = [p for row in self.heights for p in row]
        return [*rows, *self.inertia, *(p for row in self.points for p in row)]


def trace(car: CarModel, outputs: Sequence[Output], values: Mapping[str, Any]) -> Geometry:
    """Find the geometry of a car.

    Parameters
    ----------
    car : CarModel
        The car.
    outputs : sequence of Output
        Measured outputs.
    values : mapping
        Each parameter of the car as a number or, if it may change, as a polynomial.

    Raises
    ------
    InputError
        If the geometry is not a polynomial of the parameters.
    """
    try:
        return _trace(car, outputs, values)
    except (TypeError, AttributeError, ValueError):
        raise InputError(
            f"--car {car.name}",
            "cannot be tracked: its geometry is no polynomial of its parameters",
            "estimate its parameters instead",
        ) from None  # fmt: skip


def _trace(car: CarModel, outputs: Sequence[Output], values: Mapping[str, Any]) -> Geometry:
    symbols: dict[str, NDArray[Any]] = {
        name: np.array([value], dtype=object if isinstance(value, Polynomial) else np.float64)
        for name, value in values.items()
    }
    heights = [[Polynomial.of(x) for x in row] for row in car.heights(symbols)[0]]
    inertia = [Polynomial.of(x) for x in car.inertia(symbols)[0]]
    ne, n = len(heights), len(inertia)
    bars = np.zeros((ne, ne))
    if car.stiffness is not None:
        bars = np.asarray(car.stiffness(symbols)[0], np.float64)
    rate_axes = [o.channel.axis for o in outputs if o.channel.axis is not None]
    rows = list(heights)
    rows += [
        [Polynomial.of(float(coordinate == axis)) for coordinate in car.coordinates]
        for axis in rate_axes
    ]
    nx = 2 * ne + len(rate_axes)
    # the derivatives of the coordinates' accelerations by states are separate variables here
    by_states = np.empty((1, n, nx), object)
    for j in range(n):
        for a in range(nx):
            by_states[0, j, a] = Polynomial({(f"{j} by {a}",): 1.0})
    motion = Motion(car, symbols, by_states, np.zeros((1, n, ne)))
    rate_states = iter(range(2 * ne, nx))
    output_row, by_row, by_state = [], [], np.zeros((len(outputs), nx))
    for y, output in enumerate(outputs):
        place = next(rate_states) if output.channel.axis is not None else -1
        equation = OUTPUTS[output.channel.quantity]
        read, _ = equation.rows(motion, output.channel, place, output.lead)
        point = [Polynomial({})] * n
        for a in range(nx):
            for name, coefficient in Polynomial.of(read[0, a]).terms.items():
                variables = [v for v in name if " by " in v]
                if not variables:
                    assert not name
                    by_state[y, a] = coefficient
                elif a == 0:  # the same for every state
                    rest = tuple(v for v in name if v != variables[0])
                    j = int(variables[0].split()[0])
                    point[j] = point[j] + Polynomial({rest: coefficient})
        row, factor = _row_of(point, rows)
        output_row.append(row)
        by_row.append(factor)
    return Geometry(
        heights, inertia, rows[ne:], len(rate_axes), np.array(output_row, np.int64),
        np.array(by_row), by_state, bars,
    )  # fmt: skip


def _row_of(point: list[Polynomial], rows: list[list[Polynomial]]) -> tuple[int, float]:
    """Return the row that a point is a multiple of, and the factor; append one if none fits."""
    if not any(p.terms for p in point):
        return 0, 0.0
    for number, row in enumerate(rows):
        factors = {p.multiple_of(q) for p, q in zip(point, row, strict=True) if p.terms or q.terms}
        if len(factors) == 1 and (factor := factors.pop()):
            return number, factor
    rows.append(point)
    return len(rows) - 1, 1.0
