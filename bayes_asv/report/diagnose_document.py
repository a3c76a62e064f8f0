"""The document a diagnosis is told in: plain data, in the vehicle's units, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.diagnosis.localization import Cell
from bayes_asv.diagnosis.simulation_error import Gap
from bayes_asv.diagnosis.workflow import Diagnosis, Named
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.diagnose_curves import law_curves, left_over
from bayes_asv.report.document import parameter_document
from bayes_asv.report.effect_document import effect_value

__all__ = ["SCHEMA", "diagnose_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

SCHEMA = "bayes_asv/diagnose/1"

_SHOWN = ("c_f", "c_r", "i", "k_g", "zeta_f", "zeta_r")


def diagnose_document(found: Diagnosis, recordings: Sequence[Recording] = ()) -> Document:
    """Tell a diagnosis as plain data.

    Parameters
    ----------
    found : Diagnosis
        From :func:`bayes_asv.diagnosis.workflow.diagnose`.
    recordings : sequence of Recording
        What it was given, fitted and held out, for the provenance.

    Returns
    -------
    dict
        Schema ``bayes_asv/diagnose/1`` of the stable interface, and besides ``p_value`` of the
        test for a disagreement, ``p_none``, ``map`` (the deflection–velocity plane of each axle),
        ``laws`` and ``residuals`` (see :mod:`bayes_asv.report.diagnose_curves`), ``runs`` and
        ``provenance``. Numbers that do not exist are None.
    """
    vehicle = found.vehicle
    document: Document = {
        "schema": SCHEMA,
        "verdict": found.verdict,
        "reasons": list(found.reasons),
        "warnings": [_by_name(text, recordings) for text in found.warnings],
        "preflight": list(found.preflight),
        "effects": _effects(found),
        "unexplained": _unexplained(found),
        "disagreement": _disagreement(found),
        "gap": _gaps(found.gaps or {}, vehicle),
        "parameters_before": _parameters(found.before, vehicle),
        "parameters_after": _parameters(found.after, vehicle),
        "p_value": found.p,
        "p_none": found.none,
        "map": _map(found),
        "laws": law_curves(found),
        "residuals": left_over(found),
        "runs": {
            "fit": [line.source for line in found.fit],
            "holdout": [line.source for line in found.holdout],
        },
        "vehicle": {"name": vehicle.name, "units": vehicle.units},
        "provenance": {
            "recordings": [{"file": Path(r.source).name, "sha256": r.sha256} for r in recordings],
            "vehicle": {"file": Path(vehicle.source).name, "sha256": vehicle.sha256},
        },
        "seconds": found.seconds,
        "version": __version__,
        "seed": found.seed,
    }
    told: Document = _clean(document)
    return told


def _by_name(text: str, recordings: Sequence[Recording]) -> str:
    """Call recordings by their files' names: where they lie is nobody's business."""
    for recording in recordings:
        text = text.replace(recording.source, Path(recording.source).name)
    return text


def _clean(value: Any) -> Any:
    """None for numbers that do not exist, since JSON has no word for them."""
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_clean(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _effects(found: Diagnosis) -> list[Document]:
    out: list[Document] = []
    if found.engine is not None:
        force = display_units(found.vehicle.units)["force"]
        shown = {
            "frequency": (found.engine.frequency, "Hz"),
            "amplitude": (
                [float(from_si(x, force, "force")) for x in found.engine.amplitude],
                force,
            ),
        }
        out.append(
            {
                "name": "engine_vibration",
                "where": None,
                "title": "an engine that shakes the frame",
                "probability": found.believed(found.engine),
                "indistinguishable_from": [],
                "drive": "the same drive with the engine off",
                "parameters": {
                    k: {"mean": value, "eti95": [low, high], "unit": unit}
                    for k, ((value, low, high), unit) in shown.items()
                },
                "gap": _gaps(found.gaps or {}, found.vehicle) if not found.named else {},
                "tones": list(found.engine.tones),
            }
        )
    return out + [_effect(named, found) for named in found.named]


def _effect(named: Named, found: Diagnosis) -> Document:
    draws = (found.effects or {}).get(str(named.site), {})
    others = [
        {
            "name": o.site.effect.name,
            "where": o.site.where or None,
            "title": o.site.effect.title,
        }
        for o in named.others
    ]
    return {
        "name": named.site.effect.name,
        "where": named.site.where or None,
        "title": named.site.effect.title,
        "probability": found.believed(named),
        "indistinguishable_from": others + _relatives(named, found),
        "drive": named.site.effect.drive,
        "parameters": {
            p.name: effect_value(p, draws[p.name], named.site, found.vehicle)
            for p in named.site.effect.parameters
            if p.name in draws
        },
        "gap": _gaps(named.gaps, found.vehicle),
        "run": None if named.site.run is None else found.fit[named.site.run].source,
    }


def _relatives(named: Named, found: Diagnosis) -> list[Document]:
    """Members that have no signature of their own: a mass that is off scales both springs."""
    springs = {n.site.where for n in found.named if n.site.effect.name == "spring_rate"}
    if named.site.effect.name == "spring_rate" and springs == {"front", "rear"}:
        return [{"name": "mass_scale", "where": None, "title": "a mass that is off"}]
    return []


def _gaps(gaps: Mapping[str, Gap], vehicle: Vehicle) -> Document:
    unit = display_units(vehicle.units)["acceleration"]
    factor = float(from_si(1.0, unit, "acceleration"))
    out: Document = {
        name: None
        if name not in gaps
        else {
            "before": gaps[name].before * factor,
            "after": gaps[name].after * factor,
            "floor": gaps[name].floor * factor,
            "closed": gaps[name].closed,
            "worse": gaps[name].worse,
        }
        for name in ("fit", "holdout")
    }
    return {**out, "unit": unit}


def _unexplained(found: Diagnosis) -> Document:
    if found.left is None:
        return {"present": False, "score": None}
    return {
        "present": found.left.present,
        "score": found.left.score,
        "axle": found.left.axle,
        "p_memory": found.left.p_memory,
        "swollen": list(found.left.swollen),
        "p_decoy": found.left.p_decoy,
        "like": found.left.like,
        "failed": list(found.left.failed),
        "ended": found.left.ended,
        "p_jitter": found.left.p_jitter,
        "jitters": found.left.jitters,
        "rival": found.left.rival if math.isfinite(found.left.rival) else None,
    }


def _disagreement(found: Diagnosis) -> Document | None:
    seen = found.seen
    if seen is None:
        return None
    return {
        "channel": seen.channel,
        "axle": seen.axle,
        "time": [[a, b] for _, a, b in seen.time],
        "time_run": [found.fit[run].source for run, _, _ in seen.time],
        "frequency": [[a, b] for a, b in seen.frequency],
        "state": None if seen.state is None else _cell(seen.state, found.vehicle),
    }


def _map(found: Diagnosis) -> Document | None:
    if found.seen is None:
        return None
    return {
        axle: [_cell(cell, found.vehicle) for cell in cells]
        for axle, cells in found.seen.planes.items()
    }


def _cell(cell: Cell, vehicle: Vehicle) -> Document:
    shown = display_units(vehicle.units)
    return {
        "deflection": [float(from_si(v, shown["length"], "length")) for v in cell.delta],
        "velocity": [float(from_si(v, shown["velocity"], "velocity")) for v in cell.rate],
        "force": float(from_si(cell.force, shown["force"], "force")),
        "t": cell.t,
        "units": [shown["length"], shown["velocity"], shown["force"]],
    }


def _parameters(draws: dict[str, Array] | None, vehicle: Vehicle) -> Document:
    return {n: parameter_document(n, draws[n], vehicle) for n in _SHOWN if draws and n in draws}
