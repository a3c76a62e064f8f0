"""``bayes-asv estimate``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("estimate")
@common.recordings_argument
@common.vehicle_option
@click.option(
    "--car",
    "which",
    type=click.Choice(["half", "roll"]),
    default="half",
    show_default=True,
    help="'roll' takes seven channels and tells left dampers from right ones (docs/cars.md).",
)
@click.option(
    "--likelihood",
    type=click.Choice(["innovations", "output-error"]),
    default="innovations",
    show_default=True,
    help="With the wheel sensors' noise in the covariance, or with white residuals.",
)
@click.option(
    "--below",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="HZ",
    help="Use the motion below this frequency alone.",
)
@click.option(
    "--with",
    "effects",
    multiple=True,
    metavar="EFFECT",
    help="An effect the car has, such as bound_rebound@rear; may be given several times.",
)
@click.option(
    "--model",
    type=click.Choice(["linear", "auto"]),
    default="linear",
    show_default=True,
    help="'auto' adds what diagnose finds more likely than not.",
)
@click.option("--netcdf", metavar="FILE", help="Write the draws as ArviZ InferenceData.")
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str,
    which: str,
    likelihood: str,
    below: float | None,
    effects: tuple[str, ...],
    model: str,
    netcdf: str | None,
    json_file: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Posterior of c_f, c_r and i from one or several recordings together."""
    common.check_outputs((*recordings, vehicle), json_file, netcdf)
    if (effects or model == "auto") and (below is not None or likelihood != "innovations"):
        raise click.UsageError("effects need the whole band and the innovations likelihood")
    if which == "roll":
        half_only = (
            ("--likelihood", likelihood != "innovations"), ("--below", below is not None),
            ("--with", bool(effects)), ("--model", model != "linear"),
            ("--netcdf", netcdf is not None),
        )  # fmt: skip
        for option, asked in half_only:
            if asked:
                raise click.UsageError(f"{option} needs the half car; leave it or --car roll out")
        return _rolling(recordings, vehicle, json_file, rate, seed)
    runs, car = common.read_inputs(recordings, vehicle, rate)
    with common.progress_bar() as progress:
        from bayes_asv.estimation import estimate
        from bayes_asv.posterior.effect_fit import read_site

        sites = tuple(dict.fromkeys(read_site(text) for text in effects))
        if model == "auto":
            from bayes_asv.diagnosis.workflow import named_in

            tell = common.part_of(progress, 0.0, 0.6)
            sites += tuple(s for s in named_in(runs, car, seed, tell) if s not in sites)
            progress = common.part_of(progress, 0.6, 1.0)
        result = estimate(
            runs, car, likelihood=likelihood, below=below, seed=seed, progress=progress, sites=sites
        )
    from bayes_asv.report.diagnose_words import effects_lines
    from bayes_asv.report.document import estimate_document
    from bayes_asv.report.words import verdict_lines

    document = estimate_document(result)
    common.write_json(document, json_file)
    if netcdf is not None and result.draws:
        from bayes_asv.io.netcdf import write_netcdf

        write_netcdf(result, netcdf)
    elif netcdf is not None:
        click.echo(f"bayes-asv: no draws, so {netcdf} was not written", err=True)
    lines = [*verdict_lines(document), *effects_lines(document["effects"])]
    if model == "auto" and not sites and document["verdict"] != "refused":
        lines.append("Nothing was named, so the model is the linear half car.")
    click.echo("\n".join(lines), err=json_file == "-")
    return common.EXIT_STATUS[result.verdict]


def _rolling(
    recordings: tuple[str, ...], vehicle: str, json_file: str | None, rate: float | None, seed: int
) -> int:
    """Estimate a car that rolls."""
    runs, car = common.read_inputs(recordings, vehicle, rate, rolls=True)
    with common.progress_bar() as progress:
        from bayes_asv.posterior.roll.estimate import estimate_roll

        result = estimate_roll(runs, car, seed=seed, progress=progress)
    from bayes_asv.report.roll_document import roll_document
    from bayes_asv.report.roll_words import roll_lines

    document = roll_document(result)
    common.write_json(document, json_file)
    click.echo("\n".join(roll_lines(document)), err=json_file == "-")
    return common.EXIT_STATUS[result.verdict]
