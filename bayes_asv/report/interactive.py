"""The recordings of an estimate as plain data for the interactive page."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Run
from bayes_asv.report.schema.parts import Curve
from bayes_asv.report.sections.travel import motion_window
from bayes_asv.report.svg import axle_colour
from bayes_asv.report.words import plain, readable_unit

__all__ = ["interactive_data"]

_MAX_RUNS: Final = 10
"""Recordings that a page holds: 1500 points a curve, so that it stays below 3 MB."""

Data = dict[str, Any]


def interactive_data(document: EstimateDocument) -> Data:
    """Charts and states of every recording, ready for JSON.

    A chart has a title, a unit, times and curves over them; a state the travel and the velocity
    of one suspension element.
    """
    return {"runs": [_run(run) for run in document.runs[:_MAX_RUNS]]}


def _run(run: Run) -> Data:
    return {
        "name": plain(run.source),
        "window": list(motion_window(run)),
        "charts": [*_outputs(run), _wheels(run), *_states(run)],
        "states": [
            {
                "name": _words(place), "unit": readable_unit(run.travel.unit),
                "velocityUnit": readable_unit(run.travel.velocity_unit),
                "colour": _colour(place), "time": run.time, "travel": curves.deflection,
                "velocity": curves.velocity,
            }
            for place, curves in run.travel.entries.items()
        ],
    }  # fmt: skip


def _words(name: str) -> str:
    return plain(name.replace("_", " "))


def _colour(name: str) -> str:
    """Name of the custom property with the colour of an axle, or of the body."""
    axle = name.split("_")[0]
    return axle if axle in ("front", "rear") and axle_colour(name) else "good"


def _curve(name: str, label: str, colour: str, values: Curve, **look: Any) -> Data:
    return {"name": name, "label": label, "colour": colour, "values": values, **look}


def _outputs(run: Run) -> list[Data]:
    charts = []
    for name, output in (*run.chassis.items(), *run.outputs.items()):
        words, colour = _words(name), _colour(name)
        left = [
            None if m is None or s is None else float(f"{m - s:.5g}")
            for m, s in zip(output.measured, output.simulated, strict=True)
        ]
        charts.append(
            {
                "title": words, "unit": readable_unit(output.unit or run.unit), "time": run.time,
                "band": output.band95,
                "curves": [
                    _curve("measured", f"{words}, measured", "measured", output.measured, width=4),
                    _curve("simulated", f"{words}, simulated", colour, output.simulated),
                    _curve("residual", f"{words}, residual", "ink", left, width=0.8),
                ],
            }
        )  # fmt: skip
    return charts


def _by_place(title: str, unit: str, time: Curve, curves: dict[str, Curve]) -> Data:
    return {
        "title": title, "unit": readable_unit(unit), "time": time,
        "curves": [
            _curve(
                _words(name), f"{_words(name)} {title.split()[-1]}", _colour(name), values,
                dashed="right" in name,
            )
            for name, values in curves.items()
        ],
    }  # fmt: skip


def _wheels(run: Run) -> Data:
    curves = {name.removesuffix("_wheel"): curve for name, curve in run.wheels.entries.items()}
    chart = _by_place("wheel acceleration", run.unit, run.wheels.time, curves)
    for curve in chart["curves"]:
        curve["label"] = f"{curve['name']} wheel"
    return chart


def _states(run: Run) -> list[Data]:
    elements = run.travel.entries
    travel = {place: curves.deflection for place, curves in elements.items()}
    velocity = {place: curves.velocity for place, curves in elements.items()}
    return [
        _by_place("suspension travel", run.travel.unit, run.time, travel),
        _by_place("damper velocity", run.travel.velocity_unit, run.time, velocity),
    ]
