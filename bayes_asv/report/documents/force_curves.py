"""Force curves of dampers and springs that an effect changes, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.workflow import DiagnosisResult
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.effects import law_table
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.posterior.model_error import draw_cars
from bayes_asv.report.documents.quantities import Units, without_single_rate
from bayes_asv.report.schema import diagnose as schema
from bayes_asv.report.schema.parts import EffectValue

__all__ = ["force_curves"]

Array = NDArray[np.float64]

_DRAWS: Final = 400
_POINTS: Final = 81
_MIN_EXCESS: Final = 1e-6  # of the largest linear force: less is rounding


def force_curves(diagnosis: DiagnosisResult) -> dict[str, schema.ForceCurves]:
    """Force curves of each element with an effect on its damper or spring, over the range covered.

    Parameters
    ----------
    diagnosis : DiagnosisResult
        With or without effects.

    Returns
    -------
    dict of str to ForceCurves
        By the name of the suspension element: the damper's force over velocity at rest position,
        and the spring's force over deflection at standstill, with curves of the linear car
        (before), of the model with the named effects (after) and of the nominal values.

    Notes
    -----
    Draws of the car and of the effects have the marginals of the document and the ranks of
    Laplace's approximation at the mode (Iman & Conover 1982); parameters that only shape a curve
    are drawn from the approximation alone.
    """
    model = diagnosis.final_model
    if model is None or diagnosis.quantities_before is None:
        return {}
    units = Units(diagnosis.vehicle.units)
    z = _draws(model, diagnosis.seed)
    values, car = _effect_draws(model, z, diagnosis), _car_draws(model, z, diagnosis)
    nominal = {name: float(value[0]) for name, value in model.space.car.nominal.items()}
    curves = {}
    for e, element in enumerate(model.space.car.elements):
        placed_effects = [
            s for s in model.placed_effects if e in s.elements(model.space.car) and s.run is None
        ]
        laws = tuple(s for s in placed_effects if s.effect.acts == "suspension")
        if not laws and not any(s.effect.name == "spring_rate" for s in placed_effects):
            continue
        c_name, k_name = element.damping, element.spring
        law = _ForceLaw(e, model.space.car, laws, values, car[c_name], car[k_name])
        deflection, velocity = _range_covered(model, e)
        rest = np.zeros(_POINTS)
        own = schema.ForceCurves()
        if law.is_nonlinear(rest, velocity):
            damper = _curve("velocity", velocity, diagnosis.quantities_before[c_name],
                            nominal[c_name], law.forces(rest, velocity, 0.0), units)  # fmt: skip
            if any(s.effect.name == "damper_fade" for s in laws):
                damper.after_end = _band(law.forces(rest, velocity, 1.0), units)
            own.damper = damper
        if law.is_nonlinear(deflection, rest) or len(laws) < len(placed_effects):
            before = diagnosis.quantities_before.get(k_name, np.array([nominal[k_name]]))
            own.spring = _curve("deflection", deflection, before, nominal[k_name],
                                law.forces(deflection, rest, 0.0), units)  # fmt: skip
        for placed in laws:
            if placed.effect.name == "bound_rebound":
                own.rates = _rates(law.c, values[placed]["ratio"], units)
        if own.model_fields_set:
            curves[element.name] = own
    return curves


class _ForceLaw:
    """Draws of the force law of one suspension element, by its number."""

    def __init__(
        self,
        element: int,
        car: CarModel,
        placed_effects: tuple[PlacedEffect, ...],
        values: Mapping[PlacedEffect, Mapping[str, Array]],
        c: Array,
        k: Array,
    ) -> None:
        self.element, self.c, self.k = element, c, k
        self.tables = [
            law_table(
                car, {s: {p: float(v[n]) for p, v in values[s].items()} for s in placed_effects}, 0
            )
            for n in range(_DRAWS)
        ]

    def excess(self, n: int, deflection: Array, velocity: Array, share: float) -> Array:
        """Force (N) of draw `n` beyond the linear one, upward on the chassis."""
        time = np.full(len(deflection), share)  # share of the run that has passed
        table, c, k = self.tables[n], float(self.c[n]), float(self.k[n])
        force: Array = excess_many(table, self.element, c, k, deflection, velocity, time, 1.0)[:, 0]
        return force

    def is_nonlinear(self, deflection: Array, velocity: Array) -> bool:
        """Whether the force differs from the linear one along a line through the plane."""
        linear = self.k[0] * np.abs(deflection) + self.c[0] * np.abs(velocity)
        excess = [self.excess(0, deflection, velocity, share) for share in (0.0, 1.0)]
        return float(np.abs(excess).max()) > _MIN_EXCESS * float(linear.max())

    def forces(self, deflection: Array, velocity: Array, share: float) -> Array:
        """Return the forces (draws, points) that resist extension, N."""
        return np.array(
            [
                self.k[n] * deflection
                + self.c[n] * velocity
                - self.excess(n, deflection, velocity, share)
                for n in range(_DRAWS)
            ]
        )


def _draws(model: FittedModel, seed: int) -> Array:
    """Draws (N, p) from Laplace's approximation at the mode."""
    rng = np.random.default_rng([seed, 61])
    covariance = np.asarray(np.linalg.inv(model.mode.slopes.precision()), np.float64)
    return draw_cars(model.space, model.mode.z, covariance, _DRAWS, rng)


def _with_ranks(ranked: Array, marginal: Array) -> Array:
    """Quantiles of `marginal` (M,) in the order of `ranked` (N,): (N,)."""
    share = (np.argsort(np.argsort(ranked)) + 0.5) / len(ranked)
    return np.asarray(np.quantile(marginal, share))


def _effect_draws(
    model: FittedModel, z: Array, diagnosis: DiagnosisResult
) -> dict[PlacedEffect, dict[str, Array]]:
    drawn = [model.space.effects(one) for one in z]
    out: dict[PlacedEffect, dict[str, Array]] = {}
    for placed in model.placed_effects:
        marginals = (diagnosis.effect_draws or {}).get(str(placed), {})
        out[placed] = {}
        for parameter in placed.effect.parameters:
            own = np.array([values[placed][parameter.name] for values in drawn])
            marginal = marginals.get(parameter.name)
            out[placed][parameter.name] = own if marginal is None else _with_ranks(own, marginal)
    return out


def _car_draws(model: FittedModel, z: Array, diagnosis: DiagnosisResult) -> dict[str, Array]:
    drawn = model.space.quantities(z, diagnosis.seed)
    car = model.space.car
    out: dict[str, Array] = {}
    # the reported rate of a free curve is not the one that the curve is a multiple of
    free = without_single_rate(diagnosis.dampers)
    for name in [name for element in car.elements for name in (element.damping, element.spring)]:
        if name in free:
            out[name] = drawn[name]
        elif (
            name in drawn
            and diagnosis.quantities_after is not None
            and name in diagnosis.quantities_after
        ):
            out[name] = _with_ranks(drawn[name], diagnosis.quantities_after[name])
        else:
            out[name] = np.full(_DRAWS, car.nominal[name][0])
    for placed in model.placed_effects:  # the curve of a spring is that of its true rate
        if placed.effect.name == "spring_rate":
            factor = (diagnosis.effect_draws or {})[str(placed)]["factor"]
            rank = z[
                :, model.space.names.index(placed.coordinate_name(placed.effect.parameters[0]))
            ]
            for e in placed.elements(car):
                name = car.elements[e].spring
                out[name] = out[name] * _with_ranks(rank, factor)
    return out


def _range_covered(model: FittedModel, element: int) -> tuple[Array, Array]:
    """Grids of deflection (m) and velocity (m/s) over the range of the fitted runs."""
    states = np.concatenate(
        [
            model.posterior.innovations_and_variances(model.mode.z, run)[2][
                :, 2 * element : 2 * element + 2
            ]
            for run in range(len(model.space.recordings))
        ]
    )
    low, high = states.min(axis=0), states.max(axis=0)
    deflection, velocity = (
        np.linspace(min(low[n], 0.0), max(high[n], 0.0), _POINTS) for n in range(2)
    )
    return deflection, velocity


def _curve(
    along: str, grid: Array, before: Array, nominal: float, forces: Array, units: Units
) -> schema.ForceCurve:
    """Curves over `grid`: linear with the draws `before` of its rate, and `forces` after."""
    low, high = np.quantile(before, [0.025, 0.975])
    straight = np.outer([low, float(np.median(before)), high], grid)
    linear = np.array([straight.min(axis=0), straight[1], straight.max(axis=0)])
    axis: dict[str, Any] = {along: units.curve(grid, along)}
    return schema.ForceCurve(
        **axis,
        unit=units.unit(along),
        force_unit=units.unit("force"),
        before=_force_band(linear, units),
        after=_band(forces, units),
        nominal=units.curve(nominal * grid, "force"),
    )


def _band(forces: Array, units: Units) -> schema.ForceBand:
    """Median and 95 % band of curves (draws, points)."""
    return _force_band(np.quantile(forces, [0.025, 0.5, 0.975], axis=0), units)


def _force_band(curves: Array, units: Units) -> schema.ForceBand:
    low, median, high = (units.curve(curve, "force") for curve in curves)
    return schema.ForceBand(median=median, band95=[low, high])


def _rates(c: Array, ratio: Array, units: Units) -> schema.DamperRates:
    """Compression and rebound rates of a damper with mean rate `c`."""

    def rate(share: Array) -> EffectValue:
        x = units.convert(c * share, "damping")
        low, high = (float(q) for q in np.quantile(x, [0.025, 0.975]))
        return EffectValue(mean=float(np.mean(x)), eti95=[low, high])

    return schema.DamperRates(
        unit=units.unit("damping"),
        bound=rate(2.0 / (1.0 + ratio)),
        rebound=rate(2.0 * ratio / (1.0 + ratio)),
    )
