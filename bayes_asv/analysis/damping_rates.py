"""What the rate of a damper is whose force is not proportional to speed.

Three numbers stand for its curve F(v): the slope at rest, the rate of the linear damper that
takes the same power at the speeds driven, E[F v]/E[v²], and the force over the speed on either
side at one speed, the root mean square of those driven.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.filters.force_laws import excess_many
from bayes_asv.filters.suspension_forces import damper_forces
from bayes_asv.models.effects import Site
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["DampingRates", "damping_rates"]

Array = NDArray[np.float64]

_DRAWS = 400
_AT_REST = 1e-4  # m/s, at which the slope at rest is taken


@dataclass(frozen=True)
class DampingRates:
    """Draws (N,) of the rates of one damper, N·s/m.

    Parameters
    ----------
    element : str
        Name of the suspension element.
    parameter : str
        Name of its damping rate.
    free_form : bool
        It has no single rate to hold against a nominal one.
    speed : float
        Root mean square of the rates of deflection that were driven, m/s.
    at_rest : (N,) array
        Slope of the curve at rest.
    equal_power : (N,) array
        Rate of the linear damper that takes the same power at the speeds driven.
    compression, extension : (N,) arrays
        Force over speed at ``speed`` on either side.
    """

    element: str
    parameter: str
    free_form: bool
    speed: float
    at_rest: Array
    equal_power: Array
    compression: Array
    extension: Array


def damping_rates(
    target: Posterior, mode: Array, z: Array, draws: Mapping[str, Array]
) -> tuple[DampingRates, ...]:
    """Rates of every damper that has a law of its own.

    Parameters
    ----------
    target : Posterior
        With effects.
    mode : (D,) array
        Coordinates at which the speeds driven are worked out.
    z : (N, D) array
        Draws of the posterior; four hundred of them are used.
    draws : mapping of str to (N,) array
        The same of the car's quantities, SI units.
    """
    space = target.space
    laws = [s for s in space.sites if s.effect.on_damper]
    if not laws:
        return ()
    runs = range(len(space.timelines))
    driven = [target.innovations_and_variances(mode, run)[2] for run in runs]
    used = np.linspace(0, len(z) - 1, min(len(z), _DRAWS)).astype(int)
    tables = [_table(target, laws, one) for one in z[used]]
    out = []
    for e, element in enumerate(space.car.elements):
        own = [site for site in laws if e in site.elements(space.car)]
        if not own:
            continue
        rates = [run[:, 2 * e + 1] for run in driven]
        square = sum(float(np.sum(rate**2)) for rate in rates)
        speed = math.sqrt(square / sum(map(len, rates)))
        grid = np.array([-speed, -_AT_REST, _AT_REST, speed])
        c = draws[element.damping].ravel()[used]
        power, curve = np.zeros(len(used)), np.zeros((len(used), len(grid)))
        for n, (one, table) in enumerate(zip(c, tables, strict=True)):
            zero = np.zeros_like(grid)
            curve[n] = one * grid - excess_many(table, e, one, 0.0, zero, grid, zero, 1.0)[:, 0]
            for rate, line in zip(rates, space.timelines, strict=True):
                start = np.zeros_like(rate)
                force = damper_forces(table, e, one, rate, line.measurements.step, start)
                power[n] += force @ rate
        out.append(
            DampingRates(
                element.name,
                element.damping,
                any(site.effect.free_form for site in own),
                speed,
                (curve[:, 2] - curve[:, 1]) / (2.0 * _AT_REST),
                power / square,
                curve[:, 0] / -speed,
                curve[:, 3] / speed,
            )
        )
    return tuple(out)


def _table(target: Posterior, laws: list[Site], z: Array) -> Array:
    """Laws of the dampers alone, as they are at the start of a run."""
    values = target.space.effects(z)
    return law_table(target.space.car, {site: values[site] for site in laws}, 0)
