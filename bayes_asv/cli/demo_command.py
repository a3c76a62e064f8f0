"""``bayes-asv demo``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from bayes_asv.cli import common

__all__ = ["command"]

_RUNS = ("stops-400hz.csv", "bump-400hz.csv")


@click.command("demo")
@click.option(
    "-o", "folder", default="out", show_default=True, metavar="FOLDER", help="Where to write."
)
@common.json_option
@common.seed_option
def command(folder: str, json_file: str | None, seed: int) -> int:
    """Estimate a car from two shipped drives and write an HTML and a PDF report."""
    from bayes_asv.errors import InputError
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
    outputs = [str(target / name) for name in ("demo.pdf", "demo.html")]
    common.check_outputs((), *outputs, json_file)
    paths = tuple(str(shipped("recordings", name)) for name in _RUNS)
    vehicle = str(shipped("vehicles", "baja2008.toml"))
    quiet = json_file == "-"
    click.echo(f"Two simulated drives of one car: {', '.join(_RUNS)}", err=quiet)
    runs, car = common.read_inputs(paths, vehicle, None)
    with common.progress_bar() as progress:
        from bayes_asv.inference.estimate import estimate
        from bayes_asv.report.document import estimate_document

        document = estimate_document(estimate(runs, car, seed=seed, progress=progress))
    click.echo("\n".join([*verdict_lines(document), _truth(document)]), err=quiet)
    common.write_json(document, json_file)
    for output in outputs:
        write_report(document, output)
    click.echo(f"\nThe report: {target / 'demo.html'} (and {target / 'demo.pdf'})", err=quiet)
    return common.EXIT_STATUS[document["verdict"]]


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
