"""``bayes-asv demo``."""

from __future__ import annotations

import os

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("demo")
@click.option(
    "-o", "folder", default="out", show_default=True, metavar="FOLDER",
    help="Folder for the reports.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(folder: str, json_file: str | None, seed: int) -> int:
    """Estimate a car from two shipped drives, diagnose two others, and report both.

    FOLDER gets demo.html and demo.pdf of the estimate, missing.html and missing.pdf of the
    diagnosis.
    """
    common.make_folder(folder)
    names = ("demo.pdf", "demo.html", "missing.pdf", "missing.html")
    outputs = [os.path.join(folder, name) for name in names]
    common.check_outputs((), *outputs, json_file)
    import bayes_asv as asv
    from bayes_asv.library.demo import DRIVES, VALVED_DRIVES, force_lines, parameter_line

    to_stderr = json_file == "-"

    def echo(*lines: str) -> None:
        click.echo("\n".join(lines), err=to_stderr)

    car = asv.read_vehicle(asv.example("baja2008.toml"))
    runs = asv.read_recordings(asv.example(name) for name in DRIVES)
    echo(f"Two simulated drives of one car: {', '.join(DRIVES)}")
    result = asv.estimate(runs, car, seed=seed)
    tracked = asv.track(runs[0], car, seed=seed).document
    result.document = result.document.model_copy(update={"online": tracked})
    common.print_answer(result, parameter_line(result), err=to_stderr)
    common.write_json(result.document.to_dict(), json_file)
    fit, held = VALVED_DRIVES
    echo(
        f"\nThe same car with other valves at the front, which the diagnosis has to find: {fit}; "
        f"{held} is held out"
    )
    run, other = (asv.read_recording(asv.example(name)) for name in VALVED_DRIVES)
    diagnosis = asv.diagnose(run, car, holdout=other, seed=seed)
    common.print_answer(diagnosis, *force_lines(diagnosis), err=to_stderr)
    for path in outputs:
        (result if os.path.basename(path).startswith("demo") else diagnosis).report(path)
    demo_pdf, demo, missing_pdf, missing = outputs
    echo(f"\nThe reports: {demo} and {missing} (and {demo_pdf}, {missing_pdf})")
    return common.EXIT_STATUS[result.verdict]
