"""One run against another, and the checks of each run, as plain data in the vehicle's units."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.predictive_checks import Check
from bayes_asv.analysis.run_consistency import COMPARED, DISAGREE_BELOW, RunConsistency
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimation import Estimate

__all__ = ["agreement_document", "checks_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

_TOLD = (*COMPARED, "k_g")
_CHASSIS = ("front_chassis", "rear_chassis")


def agreement_document(result: Estimate) -> Document | None:
    """Tell how the runs stand to each other.

    Parameters
    ----------
    result : Estimate
        Of one or several runs.

    Returns
    -------
    dict or None
        None with one run, or where it was not looked at.  ``verdict`` with the probability
        ``p`` of so much difference among equal runs; ``spread_percent`` from run to run;
        ``runs``, each run's own posterior, with ``own`` beside it: what it says when the given
        values, whose errors all runs share, are held; ``joint``, the answer if all runs are
        alike; ``mean_car`` and ``next_run``, the answers if they are not.
    """
    found = result.agreement
    if found is None:
        return None
    vehicle, seed = result.vehicle, result.seed
    mean_car = found.quantities(found.population.centre, seed)
    joint = result.joint or (result.draws if result.draws else {})
    return {
        "verdict": found.verdict,
        "p": found.whole.p,
        "contrasts": found.whole.freedom,
        "disagree_below": DISAGREE_BELOW,
        "each": {name: {"p": test.p} for name, test in found.each.items()},
        "differing": list(found.differing) if found.verdict == "disagree" else [],
        "spread_percent": {name: _spread(found, k) for k, name in enumerate(COMPARED)},
        "own_percent": {name: found.own_percent(name) for name in COMPARED},
        "runs": [
            {
                "source": run.fit.space.timelines[0].source,
                "effective_draws": run.effective,
                "parameters": _own(found, r, vehicle, seed),
            }
            for r, run in enumerate(found.runs)
        ],
        "joint": {name: _told(joint[name], name, vehicle) for name in _TOLD if name in joint},
        "mean_car": {name: _told(mean_car[name], name, vehicle) for name in _TOLD},
        "next_run": {
            name: _told(x, name, vehicle)
            for name, x in found.quantities(found.population.next_run, seed).items()
            if name in _TOLD
        },
    }


def _spread(found: RunConsistency, k: int) -> Document:
    low, middle, high = found.spread_percent(COMPARED[k])
    chance = float(np.mean(found.population.spread[:, k] > 0.0))
    return {"median": middle, "eti95": [low, high], "p_differs": chance}


def _own(found: RunConsistency, r: int, vehicle: Vehicle, seed: int) -> Document:
    """One run's posterior by name."""
    run = found.runs[r]
    draws = run.fit.space.quantities(run.z, seed)
    out = {name: _told(draws[name], name, vehicle) for name in _TOLD if name in draws}
    for name in COMPARED:
        values, deviations = found.own_values(name)
        value, sd = (_shown(float(v[r]), name, vehicle) for v in (values, deviations))
        if name in out and np.isfinite(value) and np.isfinite(sd):
            factor = float(np.exp(1.959964 * sd / value))
            out[name]["own"] = {
                "mean": value, "sd": sd, "eti95": [value / factor, value * factor],
            }  # fmt: skip
    return out


def _told(draws: Array, name: str, vehicle: Vehicle) -> Document:
    x = _shown(1.0, name, vehicle) * draws.ravel()
    low, middle, high = np.quantile(x, [0.025, 0.5, 0.975])
    return {
        "unit": display_units(vehicle.units)[QUANTITIES[name][0]],
        "mean": float(x.mean()),
        "median": float(middle),
        "sd": float(x.std(ddof=1)),
        "eti95": [float(low), float(high)],
    }


def _shown(value: float, name: str, vehicle: Vehicle) -> float:
    dimension = QUANTITIES[name][0]
    return value * float(from_si(1.0, display_units(vehicle.units)[dimension], dimension))


def checks_document(checks: tuple[Check, ...], vehicle: Vehicle) -> list[Document]:
    """Tell the posterior predictive checks of a run.

    Parameters
    ----------
    checks : tuple of Check
        From :func:`bayes_asv.analysis.predictive_checks.predictive_checks`.
    vehicle : Vehicle
        Its units are used.

    Returns
    -------
    list of dict
        ``p_larger`` is P(T(replicate) ≥ T(record)), ``p`` the same two-sided, ``p_family``
        corrected for the number of checks of the run.
    """
    unit = display_units(vehicle.units)["acceleration"]
    factor = float(from_si(1.0, unit, "acceleration"))
    out: list[Document] = []
    for check in checks:
        low, middle, high = (factor * float(v) for v in check.replicated)
        out.append(
            {
                "channel": _CHASSIS[check.axle],
                "of": check.of,
                "quantity": check.quantity,
                "band": None if check.band is None else [float(edge) for edge in check.band],
                "unit": unit,
                "observed": factor * check.observed,
                "replicated": {"median": middle, "eti95": [low, high]},
                "p": check.p,
                "p_larger": check.p_larger,
                "p_family": check.p_family,
            }
        )
    return out
