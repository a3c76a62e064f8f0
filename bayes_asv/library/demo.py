"""What ``bayes-asv demo`` compares the results of the shipped drives with: the simulated truth."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import from_si
from bayes_asv.library.inputs import example
from bayes_asv.report.svg import curve_array
from bayes_asv.report.words import number, readable_unit

if TYPE_CHECKING:
    from bayes_asv.library.diagnoses import Diagnosis
    from bayes_asv.library.estimates import Estimate

__all__ = ["DRIVES", "VALVED_DRIVES", "force_lines", "parameter_line"]

DRIVES: Final = ("stops-400hz.csv", "bump-400hz.csv")
"""Recordings of one car."""

VALVED_DRIVES: Final = ("valved-bump-400hz.csv", "valved-stops-400hz.csv")
"""Recordings of the same car with other valves: one to fit, one to hold out."""

_VELOCITY: Final = 0.5  # m/s at which the force of a damper is compared


def _truth(recording: str) -> Any:
    file = example(recording.replace(".csv", ".truth.json"))
    return json.loads(file.read_text(encoding="utf-8"))


def parameter_line(result: Estimate) -> str:
    """State the true parameters of the simulated car, and whether the intervals hold them."""
    true = _truth(DRIVES[0])["parameters"][result.vehicle.units]
    parts = []
    for name in ("c_f", "c_r", "i"):
        if name in result:
            low, high = result[name].interval()
            place = "inside" if low <= true[name] <= high else "outside"
            unit = readable_unit(result[name].unit)
            parts.append(f"{QUANTITIES[name][1]} {true[name]:.3g} {unit} ({place} its interval)")
    return f"True values of the simulated car, not given to the estimate: {', '.join(parts)}."


def force_lines(result: Diagnosis) -> list[str]:
    """State the true force of the simulated front damper, and whether the bands hold it.

    Forces are compared because the simulated law and the named one differ in form.
    """
    laws = result.document.laws
    curve = laws["front"].damper if "front" in laws else None
    if curve is None:
        return []
    terms = _truth(VALVED_DRIVES[0])["car"]["front_law"]
    damper = next(term for term in terms if term["kind"] == "AsymmetricDamper")
    half = damper["c"] * (damper["ratio"] - 1.0) / (damper["ratio"] + 1.0)
    beyond = half * (np.hypot(_VELOCITY, damper["blend"]) - damper["blend"])
    velocity = float(from_si(_VELOCITY, curve.unit, "velocity"))
    parts = []
    for words, sign in (("compression", -1.0), ("rebound", 1.0)):
        force = sign * damper["c"] * _VELOCITY + beyond
        true = float(from_si(force, curve.force_unit, "force"))
        low, high = (
            float(np.interp(sign * velocity, curve_array(curve.grid), curve_array(side)))
            for side in curve.after.band95
        )
        place = "inside" if low <= true <= high else "outside"
        parts.append(f"{number(abs(true), 0.1)} in {words} ({place} the band)")
    return [
        f"True force of the simulated front damper at {number(velocity, 0.1)} "
        f"{readable_unit(curve.unit)}, in {readable_unit(curve.force_unit)}: {', '.join(parts)}."
    ]
