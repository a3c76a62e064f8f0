"""``bayes-asv demo``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from bayes_asv.cli import common

__all__ = ["command"]

_RUNS = ("stops-400hz.csv", "bump-400hz.csv")
_VALVED = ("valved-bump-400hz.csv", "valved-stops-400hz.csv")  # to fit, and to prove it on
_PROBE = 0.5  # m/s at which a damper's force is held against the truth


@click.command("demo")
@click.option(
    "-o", "folder", default="out", show_default=True, metavar="FOLDER", help="Where to write."
)
@common.json_option
@common.seed_option
def command(folder: str, json_file: str | None, seed: int) -> int:
    """Estimate a car from two shipped drives, find what is missing in two others, and report both.

    FOLDER gets demo.html and demo.pdf of the estimate, missing.html and missing.pdf of the
    diagnosis.
    """
    from bayes_asv.domain.errors import InputError
    from bayes_asv.report.render import write_report
    from bayes_asv.report.words import verdict_lines
    from bayes_asv.shipped import shipped

    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            folder, f"cannot be made ({error.strerror})", "name another folder"
        ) from None
    outputs = [str(target / f"{name}.{kind}") for name in ("demo", "missing")
               for kind in ("pdf", "html")]  # fmt: skip
    common.check_outputs((), *outputs, json_file)
    paths = tuple(str(shipped("recordings", name)) for name in _RUNS)
    vehicle = str(shipped("vehicles", "baja2008.toml"))
    quiet = json_file == "-"
    click.echo(f"Two simulated drives of one car: {', '.join(_RUNS)}", err=quiet)
    runs, car = common.read_inputs(paths, vehicle, None)
    with common.progress_bar() as progress:
        from bayes_asv.estimation import estimate
        from bayes_asv.report.document import estimate_document
        from bayes_asv.report.track_document import track_document
        from bayes_asv.tracking.track import track

        tell = common.part_of(progress, 0.0, 0.9)
        document = estimate_document(estimate(runs, car, seed=seed, progress=tell))
        if progress is not None:
            progress(0.9, "following it online")
        document["online"] = track_document(track(runs[0], car), seed=seed)
    click.echo("\n".join([*verdict_lines(document), _truth(document)]), err=quiet)
    common.write_json(document, json_file)
    found = _diagnosed(vehicle, seed, quiet)
    with common.progress_bar() as progress:
        for k, output in enumerate(outputs):
            if progress is not None:
                progress(k / len(outputs), f"writing {output}")
            write_report(document if Path(output).stem == "demo" else found, output)
    click.echo(
        f"\nThe reports: {target / 'demo.html'} and {target / 'missing.html'} (and "
        f"{target / 'demo.pdf'}, {target / 'missing.pdf'})",
        err=quiet,
    )
    return common.EXIT_STATUS[document["verdict"]]


def _diagnosed(vehicle: str, seed: int, quiet: bool) -> dict[str, Any]:
    """Ask two drives of the same car with other valves what the linear half car lacks."""
    from bayes_asv.report.diagnose_words import diagnosis_lines
    from bayes_asv.shipped import shipped

    one, other = _VALVED
    click.echo(
        f"\nThe same car with other valves at the front, which nobody is told: {one}; {other} is "
        "held out",
        err=quiet,
    )
    paths = tuple(str(shipped("recordings", name)) for name in _VALVED)
    runs, car = common.read_inputs(paths, vehicle, None)
    with common.progress_bar() as progress:
        from bayes_asv.diagnosis.workflow import diagnose
        from bayes_asv.report.diagnose_document import diagnose_document

        found = diagnose_document(diagnose(runs[:1], runs[1:], car, seed, progress), runs)
    click.echo("\n".join([*diagnosis_lines(found), *_true_forces(found)]), err=quiet)
    return found


def _true_forces(found: dict[str, Any]) -> list[str]:
    """Hold the damper that was found against the simulated one, in force: forms may differ."""
    import numpy as np

    from bayes_asv.domain.units import from_si
    from bayes_asv.report.readable import number, readable_unit
    from bayes_asv.shipped import shipped

    curve = (found["laws"].get("front") or {}).get("damper")
    if curve is None:
        return []
    file = shipped("recordings", _VALVED[0].replace(".csv", ".truth.json"))
    law = json.loads(file.read_text(encoding="utf-8"))["car"]["front_law"]
    damper = next(term for term in law if term["kind"] == "AsymmetricDamper")
    half = damper["c"] * (damper["ratio"] - 1.0) / (damper["ratio"] + 1.0)
    beyond = half * (np.hypot(_PROBE, damper["blend"]) - damper["blend"])
    speed = float(from_si(_PROBE, curve["unit"], "velocity"))
    parts = []
    for words, sign in (("bound", -1.0), ("rebound", 1.0)):
        true = float(from_si(sign * damper["c"] * _PROBE + beyond, curve["force_unit"], "force"))
        low, high = (
            float(np.interp(sign * speed, curve["velocity"], side))
            for side in curve["after"]["band95"]
        )
        place = "inside" if low <= true <= high else "outside"
        parts.append(f"{number(abs(true), 0.1)} in {words} ({place} the band)")
    unit = readable_unit(curve["force_unit"])
    return [
        f"True force of the simulated front damper at {number(speed, 0.1)} "
        f"{readable_unit(curve['unit'])}, in {unit}: {', '.join(parts)}."
    ]


def _truth(document: dict[str, Any]) -> str:
    """Hold the answer against what the simulator knew and the estimate was not told."""
    from bayes_asv.report.readable import readable_unit
    from bayes_asv.report.words import LABELS
    from bayes_asv.shipped import shipped

    file = shipped("recordings", _RUNS[0].replace(".csv", ".truth.json"))
    truth = json.loads(file.read_text(encoding="utf-8"))["parameters"]
    true = truth[document["vehicle"]["units"]]
    parts = []
    for name in ("c_f", "c_r", "i"):
        p = document["parameters"].get(name)
        if p is not None:
            low, high = p["eti95"]
            place = "inside" if low <= true[name] <= high else "outside"
            unit = readable_unit(p["unit"])
            parts.append(f"{LABELS[name]} {true[name]:.3g} {unit} ({place} its interval)")
    return f"True values of the simulated car, not shown to the estimate: {', '.join(parts)}."
