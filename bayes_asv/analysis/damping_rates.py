"""Rates and shape of a damper whose force is not proportional to speed.

Its curve F(v) is summarised by three numbers: the slope at rest; the rate of the linear damper that
dissipates the same power at the speeds driven, E[F v]/E[v²]; and force over speed on either side at
the root-mean-square speed.  Dry friction at the element is part of that power, as it is on a
dynamometer: no motion distinguishes the friction of the damper's seals from that of the joints.

Its shape is described by ratios that are defined for any curve, with the posterior probability of
each statement.  On either side, the mean slope over the upper half of the speeds driven is compared
with that over their lowest eighth: a smaller one is digressive, a larger one progressive.  Force
over speed in extension is compared with that in compression.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.curve_shapes import SLOWEST, CurveShape, curve_shapes, log_bend, ratio
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.filters.suspension_forces import resisting_force_history
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.models.effects.piecewise_slope import between_knots
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.likelihood import Posterior

__all__ = ["MAX_DRAWS", "DampingRates", "damping_rates", "with_equal_power"]

Array = NDArray[np.float64]

MAX_DRAWS = 2000
"""Largest number of draws for which rates are computed; their 95 % intervals are accurate to a
twentieth of their width."""

_AT_REST = 1e-4  # speed at which the slope at rest is computed, m/s
_FASTEST = 0.95  # quantile of the speeds driven up to which the shape is described
_BENT = 1.25  # ratio of slopes above which a curve is digressive or progressive
_POINTS = 41  # number of points of a curve over the range driven


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
        Its equal-power rate over that parameter.
    free_form : bool
        Whether it has a free curve, and thus no single rate to compare with a nominal one.
    speed : float
        Root mean square of the rates of deflection that were driven, m/s.
    at_rest : (N,) array
        Slope of the curve at rest.
    equal_power : (N,) array
        Rate of the linear damper that dissipates the same power at the speeds driven, including
        friction.
    compression, extension : (N,) arrays
        Force over speed at ``speed`` on either side.
    shapes : tuple of CurveShape
        Statements that are more probable than not.
    velocity : (P,) array
        Rates of deflection over the range driven, m/s.
    force : (N, P) array
        Force at these rates, N, positive if it resists extension.
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
    """Compute the rates of every damper with a nonlinear law.

    Parameters
    ----------
    posterior : Posterior
        Posterior of a model with effects.
    mode : (D,) array
        Coordinates for which the speeds driven are computed.
    z : (N, D) array
        Draws of the posterior; :data:`MAX_DRAWS` of them are used.
    draws : mapping of str to (N,) array
        Corresponding draws of the car's quantities, SI units.
    """
    space = posterior.space
    laws = [s for s in space.placed_effects if s.effect.on_damper]
    if not laws:
        return ()
    runs = range(len(space.recordings))
    states = [posterior.innovations_and_variances(mode, run)[2] for run in runs]
    picked = np.linspace(0, len(z) - 1, min(len(z), MAX_DRAWS)).astype(int)
    friction = [placed for placed in space.placed_effects if placed.effect.dissipative]
    curves, tables = (
        [_table(posterior, chosen, one) for one in z[picked]]
        for chosen in (laws, [*laws, *friction])
    )
    out = []
    for e, element in enumerate(space.car.elements):
        laws_of_element = [placed for placed in laws if e in placed.elements(space.car)]
        if not laws_of_element:
            continue
        rates = [run[:, 2 * e + 1] for run in states]
        square = sum(float(np.sum(rate**2)) for rate in rates)
        speed = math.sqrt(square / sum(map(len, rates)))
        fastest = float(np.quantile(np.abs(np.concatenate(rates)), _FASTEST))
        side = np.array([_AT_REST, speed, SLOWEST * fastest, 0.5 * fastest, fastest])
        ends = min(map(np.min, rates)), max(map(np.max, rates))
        shown = np.linspace(*ends, _POINTS)
        grid = np.concatenate([-side, side, shown])
        c = draws[element.damping].ravel()[picked]
        curve = np.zeros((len(picked), len(grid)))
        for n, (one, table) in enumerate(zip(c, curves, strict=True)):
            zero = np.zeros_like(grid)
            curve[n] = one * grid - excess_many(table, e, one, 0.0, zero, grid, zero, 1.0)[:, 0]
        power = np.zeros(len(picked))
        for rate, recording in zip(rates, space.recordings, strict=True):
            step = recording.measurements.step
            power += resisting_force_history(np.stack(tables), e, c, rate, step) @ rate
        compression, extension = -curve[:, : len(side)], curve[:, len(side) : 2 * len(side)]
        free_form = any(placed.effect.free_form for placed in laws_of_element)
        force = curve[:, 2 * len(side) :]
        out.append(
            DampingRates(
                element.name,
                element.damping,
                power / square / c,
                free_form,
                speed,
                (extension[:, 0] + compression[:, 0]) / (2.0 * _AT_REST),
                power / square,
                compression[:, 1] / speed,
                extension[:, 1] / speed,
                _shapes(compression, extension),
                shown,
                between_knots(force) if free_form else force,
            )
        )
    return tuple(out)


def with_equal_power(
    draws: Mapping[str, Array], dampers: Sequence[DampingRates]
) -> dict[str, Array]:
    """Return draws in which the rate of a damper with a free curve is its equal-power rate.

    The parameter of such a curve is only a scale factor, which corresponds to speeds that were not
    driven.  Its damping ratio is changed in the same way.

    Parameters
    ----------
    draws : mapping of str to array
        Draws from which ``dampers`` were computed, of any shape.
    dampers : sequence of DampingRates
        Rates of the dampers for the same draws.
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
        Draws of the force on either side at the speeds chosen in :func:`damping_rates`.
    """
    bends = {
        side: log_bend(force[:, 2], force[:, 3], force[:, 4])
        for side, force in (("compression", compression), ("extension", extension))
    }
    sides = ratio(extension[:, 1], compression[:, 1])
    return curve_shapes(bends, sides, ("digressive", "progressive"), _BENT)


def _table(posterior: Posterior, laws: list[PlacedEffect], z: Array) -> Array:
    """Return the table of these laws only, as they are at the start of a run."""
    values = posterior.space.effects(z)
    return law_table(posterior.space.car, {placed: values[placed] for placed in laws}, 0)
