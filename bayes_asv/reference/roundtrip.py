"""Table 5.1 again: whether a grey box finds the parameters that its data were made with.

A car with exact values runs over one bump and nothing is added.  The reference gives its grey box
the four states and the wheels' positions and velocities at 300 instants; between them ``idgrey``
holds the inputs, since App. C.2 leaves ``data.int = 'foh'`` as a comment.  Held inputs lag by half
a sample, and the estimate makes up for that by damping.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car import HalfCar, position_form
from bayes_asv.reference.greybox import PointEstimate, estimate_states, grey_box, nominal_car
from bayes_asv.simulation.roads import Road
from bayes_asv.simulation.simulate import simulate

__all__ = ["POINTS", "Exact", "exact_states", "found_of", "in_states", "round_trip", "smooth_bump"]

Array = NDArray[np.float64]

POINTS = 300
"""Points that the reference used (section 5.3)."""
STEP = 0.005  # s: 300 points then hold the bump and what follows; the reference does not give it
_FINE = 10  # steps of the exact solution in each of those
_BEFORE = 0.1  # s at rest
_HEIGHT, _LENGTH, _SPEED = 3 * 0.0254, 60 * 0.0254, 10 * 0.44704  # m, m, m/s


def smooth_bump() -> Road:
    """Return a bump h sin⁶(πx/L), 3 in high and 60 in long, at 10 mph.

    Five derivatives are continuous.  What a spline cannot know between two samples, a jump of the
    jerk, is not in it: over the shipped bump, which has such jumps, the same round trip errs by
    0.02 %.
    """

    def height(x: Array) -> Array:
        inside = (x > 0.0) & (x < _LENGTH)
        return np.where(inside, _HEIGHT * np.sin(np.pi * x / _LENGTH) ** 6, 0.0)

    return Road("smooth bump", _SPEED, height)


class Exact(NamedTuple):
    """States and inputs of a car over a bump, without noise (Fig. 5.2)."""

    time: Array
    u: Array
    y: Array


def exact_states(car: HalfCar, step: float = STEP, points: int = POINTS) -> Exact:
    """Drive a car over :func:`smooth_bump`.

    Parameters
    ----------
    car : HalfCar
        SI units.
    step : float
        Time between points, s.
    points : int
        Number of points.

    Returns
    -------
    Exact
        time (N,), u (N, 4) as eq. 5.4, y (N, 4) as eq. 5.3; SI units.
    """
    bump = smooth_bump()
    h = step / _FINE
    time: Array = h * np.arange((points - 1) * _FINE + 1, dtype=np.float64)
    columns = []
    for behind in (0.0, car.l):
        x = bump.speed * (time - _BEFORE) - behind
        d = bump.speed * h
        high, ahead, back = bump.height(x), bump.height(x + d), bump.height(x - d)
        columns += [high, (ahead - back) / (2.0 * h)]
    u = np.stack(columns, axis=1)
    y = simulate_linear(position_form(car), time, u)
    return Exact(time[::_FINE], u[::_FINE], y[::_FINE])


def in_states(vehicle: Vehicle, hold: str, step: float = STEP) -> PointEstimate:
    """Round trip in the reference's coordinates, started from App. C.2's values."""
    data = exact_states(nominal_car(vehicle), step)
    return estimate_states(data.time, data.u, data.y, vehicle, hold=hold, initial="zero")


def round_trip(vehicle: Vehicle, rate: float = 400.0) -> PointEstimate:
    """Round trip in deflections: four accelerations without noise in, chassis accelerations out."""
    drive = simulate(vehicle, smooth_bump(), rate=rate, seconds=1.5)
    return grey_box(drive.recording, vehicle, coordinates="deflection", initial="zero")


def found_of(estimate: PointEstimate, vehicle: Vehicle) -> dict[str, float]:
    """Table 5.1's quantities of an estimate: k_g in metres, and both damping ratios."""
    car = nominal_car(vehicle)._replace(
        **{name: estimate.answers[name].value for name in ("c_f", "c_r", "i")}
    )
    return {"k_g": car.k_g, "zeta_f": car.zeta_f, "zeta_r": car.zeta_r}
