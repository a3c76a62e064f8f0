"""An estimate of a car that rolls as plain data, ready for JSON."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.models.from_vehicle import roll_car
from bayes_asv.posterior.importance import Weighted
from bayes_asv.posterior.roll.estimate import RollEstimate
from bayes_asv.posterior.roll.posterior import ROLL_ANSWERS

__all__ = ["ROLL_SCHEMA", "roll_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

ROLL_SCHEMA: Final = "bayes_asv/estimate_roll/1"

_RATIOS: Final = {"front": ("c_fl", "c_fr"), "rear": ("c_rl", "c_rr")}


def roll_document(result: RollEstimate) -> Document:
    """Write down an estimate.

    Parameters
    ----------
    result : RollEstimate
        Of any verdict.

    Returns
    -------
    dict
        Schema ``bayes_asv/estimate_roll/1``: ``parameters`` as in an estimate of the half car,
        ``left_over_right`` with the ratio of the two dampers of each axle, which no error of the
        mass enters.
    """
    parameters: Document = {}
    ratios: Document = {}
    if result.weighted is not None:
        parameters = {name: _parameter(result, name) for name in ROLL_ANSWERS}
        for axle, (left, right) in _RATIOS.items():
            value = result.quantities[left] / result.quantities[right]
            ratios[axle] = {
                **_summary(result.weighted, value),
                "p_left_softer": result.weighted.below(value, 1.0),
            }
    draws = result.weighted
    return {
        "schema": ROLL_SCHEMA,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "warnings": list(result.warnings),
        "parameters": parameters,
        "left_over_right": ratios,
        "diagnostics": {
            "likelihood": "innovations",
            "sampler": "weighted draws at the mode",
            "draws": 0 if draws is None else len(draws.weight),
            "effective_draws": None if draws is None else draws.effective,
        },
        "fit_by_run": [
            {
                "source": recording.source,
                **{
                    name: {"nrmse_percent": 100.0 * share if math.isfinite(share) else None}
                    for name, share in left.items()
                },
            }
            for recording, left in zip(result.recordings, result.left, strict=False)
        ],
        "vehicle": {"name": result.vehicle.name, "sha256": result.vehicle.sha256},
        "recordings": [
            {"source": r.source, "sha256": r.sha256, "rows": len(r.time)} for r in result.recordings
        ],
        "seconds": result.seconds,
        "version": __version__,
        "seed": result.seed,
    }


def _summary(draws: Weighted, value: Array) -> Document:
    low, median, high = draws.quantile(value, np.array([0.025, 0.5, 0.975]))
    return {
        "mean": draws.mean(value),
        "median": float(median),
        "sd": draws.sd(value),
        "eti95": [float(low), float(high)],
    }


def _parameter(result: RollEstimate, name: str) -> Document:
    assert result.weighted is not None
    dimension, words = QUANTITIES[name]
    unit = display_units(result.vehicle.units)[dimension]
    factor = from_si(1.0, unit, dimension)
    value, nominal = result.quantities[name], float(getattr(roll_car(result.vehicle), name))
    return {
        "label": words,
        "unit": unit,
        **_summary(result.weighted, factor * value),
        "nominal": factor * nominal,
        "p_below_nominal": result.weighted.below(value, nominal),
        "si": {
            "unit": display_units("SI")[dimension],
            **_summary(result.weighted, value),
            "nominal": nominal,
        },
    }
