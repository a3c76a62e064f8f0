"""Rates and shape of a damper whose force is not proportional to speed.

Three numbers stand for its curve F(v): the slope at rest, the rate of the linear damper that
takes the same power at the speeds driven, E[F v]/E[v²], and the force over the speed on either
side at one speed, the root mean square of those driven.  Dry friction at the element is part of
that power, as it is on a dynamometer: no motion tells that of the damper's seals from that of the
joints.

Its shape is described by ratios that hold for any curve, with the posterior probability of each
statement.  On either side the mean slope over the upper half of the speeds driven is compared with
that over their lowest eighth: less is digressive, more is progressive.  Force over speed in
extension is compared with that in compression.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.curve_shapes import SLOWEST, CurveShape, curve_shapes, log_bend, ratio
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.filters.suspension_forces import damper_force_history
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["MAX_DRAWS", "DampingRates", "damping_rates", "with_equal_power"]

Array = NDArray[np.float64]

MAX_DRAWS = 2000
"""Draws of which rates are worked out: intervals of 95 % to a twentieth of their width."""

_AT_REST = 1e-4  # m/s, at which the slope at rest is taken
_FASTEST = 0.95  # quantile of the speeds driven up to which the shape is described
_BENT = 1.25  # ratio of slopes from which a curve is called bent
_POINTS = 41  # of a curve over the range driven


@dataclass(frozen=True)
class DampingRates:
    """Draws (N,) of the rates of one damper, N·s/m.

    Parameters
    ----------
    element : str
        Name of the suspension element.
    parameter : str
        Name of its damping rate.
    over_rate : (N,) array
        Its rate of equal power over that parameter.
    free_form : bool
        It has no single rate to hold against a nominal one.
    speed : float
        Root mean square of the rates of deflection that were driven, m/s.
    at_rest : (N,) array
        Slope of the curve at rest.
    equal_power : (N,) array
        Rate of the linear damper that takes the same power at the speeds driven, friction included.
    compression, extension : (N,) arrays
        Force over speed at ``speed`` on either side.
    shapes : tuple of CurveShape
        Statements that are more probable than not.
    velocity : (P,) array
        Rates of deflection over the range driven, m/s.
    force : (N, P) array
        Force at these, N, positive where it resists extension.
    """

    element: str
    parameter: str
    over_rate: Array
    free_form: bool
    speed: float
    at_rest: Array
    equal_power: Array
    compression: Array
    extension: Array
    shapes: tuple[CurveShape, ...]
    velocity: Array
    force: Array

    @property
    def names(self) -> tuple[str, str]:
        """Names of the damping rate and of the damping ratio that belongs to it."""
        return self.parameter, self.parameter.replace("c_", "zeta_", 1)


def damping_rates(
    posterior: Posterior, mode: Array, z: Array, draws: Mapping[str, Array]
) -> tuple[DampingRates, ...]:
    """Rates of every damper that has a law of its own.

    Parameters
    ----------
    posterior : Posterior
        With effects.
    mode : (D,) array
        Coordinates at which the speeds driven are worked out.
    z : (N, D) array
        Draws of the posterior; :data:`MAX_DRAWS` of them are used.
    draws : mapping of str to (N,) array
        The same of the car's quantities, SI units.
    """
    space = posterior.space
    laws = [s for s in space.placed_effects if s.effect.on_damper]
    if not laws:
        return ()
    runs = range(len(space.recordings))
    driven = [posterior.innovations_and_variances(mode, run)[2] for run in runs]
    used = np.linspace(0, len(z) - 1, min(len(z), MAX_DRAWS)).astype(int)
    rubbing = [s for s in space.placed_effects if s.effect.dissipative]
    tables = np.stack([_table(posterior, laws, one) for one in z[used]])
    friction = np.stack([_table(posterior, rubbing, one) for one in z[used]])
    out = []
    for e, element in enumerate(space.car.elements):
        own = [placed for placed in laws if e in placed.elements(space.car)]
        if not own:
            continue
        rates = [run[:, 2 * e + 1] for run in driven]
        square = sum(float(np.sum(rate**2)) for rate in rates)
        speed = math.sqrt(square / sum(map(len, rates)))
        fastest = float(np.quantile(np.abs(np.concatenate(rates)), _FASTEST))
        side = np.array([_AT_REST, speed, SLOWEST * fastest, 0.5 * fastest, fastest])
        ends = min(map(np.min, rates)), max(map(np.max, rates))
        shown = np.linspace(*ends, _POINTS)
        grid = np.concatenate([-side, side, shown])
        c = draws[element.damping].ravel()[used]
        curve = np.zeros((len(used), len(grid)))
        for n, (one, table) in enumerate(zip(c, tables, strict=True)):
            zero = np.zeros_like(grid)
            curve[n] = one * grid - excess_many(table, e, one, 0.0, zero, grid, zero, 1.0)[:, 0]
        power = np.zeros(len(used))
        for rate, recording in zip(rates, space.recordings, strict=True):
            power += damper_force_history(tables, e, c, rate, recording.measurements.step) @ rate
            power -= _added_forces(friction, e, rate) @ rate
        compression, extension = -curve[:, : len(side)], curve[:, len(side) : 2 * len(side)]
        out.append(
            DampingRates(
                element.name,
                element.damping,
                power / square / c,
                any(placed.effect.free_form for placed in own),
                speed,
                (extension[:, 0] + compression[:, 0]) / (2.0 * _AT_REST),
                power / square,
                compression[:, 1] / speed,
                extension[:, 1] / speed,
                _shapes(compression, extension),
                shown,
                curve[:, 2 * len(side) :],
            )
        )
    return tuple(out)


def with_equal_power(
    draws: Mapping[str, Array], dampers: Sequence[DampingRates]
) -> dict[str, Array]:
    """Return draws in which the rate of a damper with a free curve is that of equal power.

    Such a curve has no rate of its own: the one that it is a multiple of belongs to speeds that
    were not driven.  Its damping ratio is changed alike.

    Parameters
    ----------
    draws : mapping of str to array
        Draws that ``dampers`` were worked out from, of any shape.
    dampers : sequence of DampingRates
        Of as many draws.
    """
    out = dict(draws)
    for damper in dampers:
        if damper.free_form:
            for name in damper.names:
                if name in out:
                    out[name] = out[name] * damper.over_rate.reshape(out[name].shape)
    return out


def _shapes(compression: Array, extension: Array) -> tuple[CurveShape, ...]:
    """Statements that are more probable than not.

    Parameters
    ----------
    compression, extension : (N, 5) arrays
        Draws of the force on either side at the speeds that :func:`damping_rates` takes.
    """
    bends = {
        side: log_bend(force[:, 2], force[:, 3], force[:, 4])
        for side, force in (("compression", compression), ("extension", extension))
    }
    sides = ratio(extension[:, 1], compression[:, 1])
    return curve_shapes(bends, sides, ("digressive", "progressive"), _BENT)


def _added_forces(tables: Array, element: int, rate: Array) -> Array:
    """Return the forces (N, T) that laws add to those of springs and dampers, N."""
    nothing = np.zeros_like(rate)
    if not np.any(tables[:, :, 0] == element):
        return np.zeros((len(tables), len(rate)))
    forces = (excess_many(t, element, 0.0, 0.0, nothing, rate, nothing, 1.0)[:, 0] for t in tables)
    return np.stack(list(forces))


def _table(posterior: Posterior, laws: list[PlacedEffect], z: Array) -> Array:
    """Return the table of these laws alone, as they are at the start of a run."""
    values = posterior.space.effects(z)
    return law_table(posterior.space.car, {placed: values[placed] for placed in laws}, 0)
