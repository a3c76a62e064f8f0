"""Curves of a diagnosis: forces of damper and spring, and what the simulations leave of each run.

Both are told before (the linear half car) and after (with everything that was named).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.workflow import Diagnosis
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.force_laws import excess_many
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.effects import AXLES, Site
from bayes_asv.posterior.effects import rows
from bayes_asv.posterior.fitted_model import FittedModel
from bayes_asv.posterior.free_simulation import free_run

__all__ = ["law_curves", "left_over"]

Array = NDArray[np.float64]
Document = dict[str, Any]

_DRAWS = 400
_GRID = 81
_CURVE = 1200  # points of a residual's curve
_LEAST = 1e-6  # of the largest force: less is no excess
_CHASSIS = ("front_chassis", "rear_chassis")


def law_curves(found: Diagnosis) -> Document:
    """Tell the forces of dampers and springs that an effect bends, over what was visited.

    Parameters
    ----------
    found : Diagnosis
        With or without effects.

    Returns
    -------
    dict
        By axle ``damper`` (force against velocity at rest position) and ``spring`` (against
        deflection, standing still), each with the curves before, after and nominal in the
        vehicle's units; extension is positive, and so is a force that resists it. A damper that
        fades has ``after_end``, at the end of a run. ``rates`` holds bound and rebound rate where
        they differ.

    Notes
    -----
    Draws of the car and of the effects have the marginals that the document reports and the ranks
    of Laplace's approximation at the mode (Iman & Conover 1982); what only shapes a law is drawn
    from the latter alone.
    """
    stage = found.final
    if stage is None or found.before is None:
        return {}
    out: Document = {}
    z = _coordinates(stage, found.seed)
    values = _effects(stage, z, found)
    car = _car(stage, z, found)
    for k, axle in enumerate(AXLES):
        sites = [s for s in stage.sites if axle in s.axles and s.run is None]
        laws = tuple(s for s in sites if s.effect.acts == "suspension")
        if not laws and not any(s.effect.name == "spring_rate" for s in sites):
            continue
        law = _Law(axle, laws, values, car[f"c_{axle[0]}"], car[f"k_{axle[0]}"])
        delta, rate = _visited(stage, k)
        entry: Document = {}
        if law.bends(np.zeros(_GRID), rate):
            before = found.before[f"c_{axle[0]}"]
            nominal = getattr(found.vehicle, f"c_{axle[0]}").value
            entry["damper"] = _told(
                rate, ("velocity", "force"), law.forces(0.0 * rate, rate, 0.0), before, nominal,
                found.vehicle,
            )  # fmt: skip
            if any(s.effect.name == "damper_fade" for s in laws):
                late = law.forces(0.0 * rate, rate, 1.0)
                entry["damper"]["after_end"] = _band(late, "force", found.vehicle)
        if law.bends(delta, np.zeros(_GRID)) or len(laws) < len(sites):
            nominal = getattr(found.vehicle, f"k_{axle[0]}").value
            before = found.before.get(f"k_{axle[0]}", np.array([nominal]))
            entry["spring"] = _told(
                delta, ("deflection", "force"), law.forces(delta, 0.0 * delta, 0.0), before,
                nominal, found.vehicle,
            )  # fmt: skip
        for site in laws:
            if site.effect.name == "bound_rebound":
                entry["rates"] = _rates(law.c, values[site]["ratio"], found.vehicle)
        if entry:
            out[axle] = entry
    return out


class _Law:
    """Draws of one axle's law."""

    def __init__(
        self, axle: str, sites: tuple[Site, ...], values: dict[Site, dict[str, Array]], c: Array,
        k: Array,
    ) -> None:  # fmt: skip
        self.axle, self.c, self.k = AXLES.index(axle), c, k
        self.tables = [
            rows({s: {p: float(v[n]) for p, v in values[s].items()} for s in sites}, 0)
            for n in range(_DRAWS)
        ]

    def excess(self, n: int, delta: Array, rate: Array, share: float) -> Array:
        """Force (N) of draw ``n`` beyond spring and damper, upward on the chassis."""
        time = np.full(len(delta), share)
        table, c, k = self.tables[n], float(self.c[n]), float(self.k[n])
        found: Array = excess_many(table, self.axle, c, k, delta, rate, time, 1.0)[:, 0]
        return found

    def bends(self, delta: Array, rate: Array) -> bool:
        """Whether anything is beyond spring and damper on a line through the plane."""
        linear = self.k[0] * np.abs(delta) + self.c[0] * np.abs(rate)
        beyond = max(
            float(np.abs(self.excess(0, delta, rate, share)).max()) for share in (0.0, 1.0)
        )
        return beyond > _LEAST * float(linear.max())

    def forces(self, delta: Array, rate: Array, share: float) -> Array:
        """Return the forces (N, G) that resist extension."""
        return np.array(
            [
                self.k[n] * delta + self.c[n] * rate - self.excess(n, delta, rate, share)
                for n in range(_DRAWS)
            ]
        )


def _coordinates(stage: FittedModel, seed: int) -> Array:
    rng = np.random.default_rng([seed, 61])
    covariance = np.linalg.inv(stage.mode.slopes.precision())
    return rng.multivariate_normal(stage.mode.z, covariance, _DRAWS, method="eigh")


def _like(ranked: Array, wanted: Array) -> Array:
    """Values of ``wanted`` (M,) in the order that ``ranked`` (N,) has: (N,)."""
    share = (np.argsort(np.argsort(ranked)) + 0.5) / len(ranked)
    return np.asarray(np.quantile(wanted, share))


def _effects(stage: FittedModel, z: Array, found: Diagnosis) -> dict[Site, dict[str, Array]]:
    drawn = [stage.space.effects(one) for one in z]
    out: dict[Site, dict[str, Array]] = {}
    for site in stage.sites:
        told = (found.effects or {}).get(str(site), {})
        out[site] = {}
        for parameter in site.effect.parameters:
            own = np.array([values[site][parameter.name] for values in drawn])
            known = told.get(parameter.name)
            out[site][parameter.name] = own if known is None else _like(own, known)
    return out


def _car(stage: FittedModel, z: Array, found: Diagnosis) -> dict[str, Array]:
    drawn = stage.space.quantities(z, found.seed)
    out: dict[str, Array] = {}
    for name in ("c_f", "c_r", "k_f", "k_r"):
        if name in drawn and found.after is not None and name in found.after:
            out[name] = _like(drawn[name], found.after[name])
        else:
            out[name] = np.full(_DRAWS, getattr(found.vehicle, name).value)
    for site in stage.sites:  # the law of a spring is that of the true one
        if site.effect.name == "spring_rate":
            told = (found.effects or {})[str(site)]["factor"]
            rank = z[:, stage.space.names.index(site.coordinate_name(site.effect.parameters[0]))]
            out[f"k_{site.where[0]}"] = out[f"k_{site.where[0]}"] * _like(rank, told)
    return out


def _visited(stage: FittedModel, axle: int) -> tuple[Array, Array]:
    """Grids (G,) of deflection and its rate over what the fitted runs visited, m and m/s."""
    states = np.concatenate(
        [
            stage.target.scored(stage.mode.z, run)[2][:, 2 * axle : 2 * axle + 2]
            for run in range(len(stage.space.timelines))
        ]
    )
    low, high = states.min(axis=0), states.max(axis=0)
    return (
        np.linspace(min(low[0], 0.0), max(high[0], 0.0), _GRID),
        np.linspace(min(low[1], 0.0), max(high[1], 0.0), _GRID),
    )


def _told(
    grid: Array, dimensions: tuple[str, str], forces: Array, before: Array, nominal: float,
    vehicle: Vehicle,
) -> Document:  # fmt: skip
    shown = display_units(vehicle.units)
    along, force = dimensions
    low, high = np.quantile(before, [0.025, 0.975])
    linear = np.outer([low, float(np.median(before)), high], grid)
    return {
        along: _shown(grid, along, vehicle),
        "unit": shown[along],
        "force_unit": shown[force],
        "before": _band(linear, force, vehicle),
        "after": _band(forces, force, vehicle),
        "nominal": _shown(nominal * grid, force, vehicle),
    }


def _band(draws: Array, dimension: str, vehicle: Vehicle) -> Document:
    """Median and 95 % band of curves (N, G)."""
    if len(draws) == 3:  # a straight line at its lower end, median and upper end
        low, median, high = draws.min(axis=0), draws[1], draws.max(axis=0)
    else:
        low, median, high = np.quantile(draws, [0.025, 0.5, 0.975], axis=0)
    curves = [_shown(curve, dimension, vehicle) for curve in (low, median, high)]
    return {"median": curves[1], "band95": [curves[0], curves[2]]}


def _rates(c: Array, ratio: Array, vehicle: Vehicle) -> Document:
    """Bound and rebound rates of a damper whose mean rate is c."""
    unit = display_units(vehicle.units)["damping"]
    factor = float(from_si(1.0, unit, "damping"))
    out: Document = {"unit": unit}
    for name, share in (("bound", 2.0 / (1.0 + ratio)), ("rebound", 2.0 * ratio / (1.0 + ratio))):
        low, high = np.quantile(c * share, [0.025, 0.975]) * factor
        mean = float(np.mean(c * share) * factor)
        out[name] = {"mean": mean, "eti95": [float(low), float(high)]}
    return out


def left_over(found: Diagnosis) -> list[Document]:
    """Tell what the free-running simulation leaves of every fitted run, before and after.

    Parameters
    ----------
    found : Diagnosis
        With both stages.

    Returns
    -------
    list of dict
        A run each: ``time`` on the recording's own clock (s), and by chassis channel ``before`` and
        ``after``, measured less simulated; ``spectrum`` holds their power spectral densities
        (Welch). An engine's tones are cut out of both.
    """
    if found.base is None or found.final is None:
        return []
    out = []
    for run, line in enumerate(found.base.space.timelines):
        whole: dict[str, Array] = {}
        for name, stage in (("before", found.base), ("after", found.final)):
            own = stage.space.timelines[run]
            output, _, _ = free_run(stage.target, stage.mode.z, run)
            whole[name] = own.paired(np.where(own.kind == VALUE, own.reading - output, np.nan))
        time = line.instants[line.pairs.max(axis=1)]
        keep = np.unique(np.linspace(0, len(time) - 1, _CURVE).astype(int))
        entry: Document = {
            "source": line.source,
            "unit": display_units(found.vehicle.units)["acceleration"],
            "time": _rounded(time[keep]),
            "seconds": [float(time[0]), float(time[-1])],
            "spectrum": _spectra(whole, line.reading_step, found.vehicle),
        }
        for axle, channel in enumerate(_CHASSIS):
            entry[channel] = {
                name: _shown(left[keep, axle], "acceleration", found.vehicle)
                for name, left in whole.items()
            }
        out.append(entry)
    return out


def _spectra(whole: dict[str, Array], step: float, vehicle: Vehicle) -> Document:
    from scipy.signal import welch

    unit = display_units(vehicle.units)["acceleration"]
    out: Document = {"unit": f"({unit})^2/Hz"}
    for axle, channel in enumerate(_CHASSIS):
        out[channel] = {}
        for name, left in whole.items():
            x = np.nan_to_num(left[:, axle])
            frequency, power = welch(x, 1.0 / step, nperseg=min(256, len(x)))
            out["frequency"] = _rounded(frequency[1:])
            out[channel][name] = _rounded(
                power[1:] * float(from_si(1.0, unit, "acceleration")) ** 2
            )
    return out


def _shown(values: Array, dimension: str, vehicle: Vehicle) -> list[float | None]:
    unit = display_units(vehicle.units)[dimension]
    return _rounded(values * float(from_si(1.0, unit, dimension)))


def _rounded(values: Array) -> list[float | None]:
    """Six significant digits: a curve for the eye need not carry sixteen."""
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values]
