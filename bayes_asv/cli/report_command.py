"""``bayes-asv report``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from bayes_asv.cli import common

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording

__all__ = ["command"]

_KINDS = {
    "bayes_asv/estimate/1": "estimate",
    "bayes_asv/diagnose/1": "diagnosis",
    "bayes_asv/track/1": "track",
}


_COMPUTED = 0.8  # of the time, where there is something to compute


@click.command("report")
@click.argument("recordings", nargs=-1, metavar="[REC...]")
@click.option("--vehicle", "-v", metavar="V.toml", help="What is known of the car.")
@click.option("-o", "output", required=True, metavar="OUT", help="An .html or a .pdf file.")
@click.option(
    "--from", "saved", multiple=True, metavar="FILE",
    help="JSON that estimate, diagnose or track wrote before; once for each.",
)  # fmt: skip
@click.option(
    "--no-diagnosis", is_flag=True, help="Do not ask these recordings what the half car lacks."
)
@common.json_option
@common.rate_option
@common.seed_option
def command(
    recordings: tuple[str, ...],
    vehicle: str | None,
    output: str,
    saved: tuple[str, ...],
    no_diagnosis: bool,
    json_file: str | None,
    rate: float | None,
    seed: int,
) -> int:
    """Write a report of recordings, HTML or PDF by the suffix of OUT.

    What was saved with --json by estimate, diagnose and track is taken with --from and not computed
    again; with recordings and --vehicle the rest is computed.
    """
    from bayes_asv.report.render import check_suffix, write_report

    check_suffix(output)
    if len(saved) > len(_KINDS):
        raise click.UsageError(
            "a report tells one estimate, one diagnosis and one track; give --from once for each"
        )
    if not recordings and not saved:
        raise click.UsageError("give recordings and --vehicle, or --from a saved document")
    if vehicle is not None and not recordings:
        raise click.UsageError("--vehicle needs recordings; a saved document knows its car")
    if recordings and vehicle is None and len(saved) < len(_KINDS):
        raise click.UsageError("recordings need --vehicle")
    common.check_outputs((*recordings, vehicle, *saved), output, json_file)
    told = _saved(saved)
    with common.progress_bar() as progress:
        if recordings:
            work = (told, saved, recordings, vehicle, rate, seed, not no_diagnosis)
            told = _completed(*work, common.part_of(progress, 0.0, _COMPUTED))
        if "estimate" not in told and len(told) > 1:
            raise click.UsageError("a diagnosis and a track need the estimate beside them")
        document = told.get("estimate") or next(iter(told.values()))
        if "estimate" in told:
            beside = {"diagnosis": told.get("diagnosis"), "online": told.get("track")}
            document = {**document, **{key: one for key, one in beside.items() if one is not None}}
        if progress is not None:
            progress(_COMPUTED, f"writing {output}")
        write_report(document, output)
    common.write_json(document, json_file)
    click.echo("\n".join([*_said(document), output]), err=json_file == "-")
    return common.EXIT_STATUS.get(document["verdict"], 0)


def _saved(paths: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Read saved documents, by kind."""
    from bayes_asv.report.saved import read_saved

    told: dict[str, dict[str, Any]] = {}
    for path in paths:
        document = read_saved(path)
        kind = _KINDS[document["schema"]]
        if kind in told:
            raise click.UsageError(f"a report tells one {kind}; give --from once for each kind")
        told[kind] = document
    return told


def _completed(
    told: dict[str, dict[str, Any]],
    saved: tuple[str, ...],
    recordings: tuple[str, ...],
    vehicle: str | None,
    rate: float | None,
    seed: int,
    diagnosis: bool,
    progress: common.Progress | None,
) -> dict[str, dict[str, Any]]:
    """Compute of the recordings what was not saved."""
    if vehicle is None:  # both are there; the recordings are named to be held against them
        from bayes_asv.io import read_recording

        _same(told, saved, [read_recording(path, rate=rate) for path in recordings])
        return told
    runs, car = common.read_inputs(recordings, vehicle, rate)
    _same(told, saved, runs)
    told = dict(told)
    if "estimate" not in told:
        from bayes_asv.estimation import estimate
        from bayes_asv.report.document import estimate_document

        tell = common.part_of(progress, 0.0, 0.3)
        told["estimate"] = estimate_document(estimate(runs, car, seed=seed, progress=tell))
    wanted = diagnosis and told["estimate"]["verdict"] != "refused"
    if wanted and not (told.get("diagnosis") or told["estimate"].get("diagnosis")):
        from bayes_asv.diagnosis.workflow import diagnose
        from bayes_asv.report.diagnose_document import diagnose_document

        found = diagnose(runs, (), car, seed, common.part_of(progress, 0.3, 0.95))
        told["diagnosis"] = diagnose_document(found, runs)
    if "track" not in told and told["estimate"]["verdict"] != "refused":
        from bayes_asv.report.track_document import track_document
        from bayes_asv.tracking.track import track

        if progress is not None:
            progress(0.95, "following it online")
        told["track"] = track_document(track(runs[0], car), seed=seed)
    return told


def _same(told: dict[str, dict[str, Any]], saved: tuple[str, ...], runs: list[Recording]) -> None:
    """Refuse a saved document of other recordings."""
    from bayes_asv.domain.errors import InputError

    given = {run.sha256 for run in runs}
    for path, (kind, document) in zip(saved, told.items(), strict=True):
        files = (document.get("provenance") or {}).get("recordings") or []
        known = {file.get("sha256") for file in files}
        whole = {"estimate": known == given, "diagnosis": given <= known, "track": known <= given}
        if known and not whole[kind]:
            raise InputError(
                path, "was made of other recordings", "give those, or leave the file out"
            )


def _said(document: dict[str, Any]) -> list[str]:
    """Lines that are printed: what was found in short, or why nothing was."""
    from bayes_asv.report.diagnose_words import diagnose_headline, diagnosis_lines
    from bayes_asv.report.track_words import track_headline, track_lines
    from bayes_asv.report.words import headline, verdict_lines

    kind = _KINDS[document["schema"]]
    if document["verdict"] == "refused":
        whole = {"track": track_lines, "diagnosis": diagnosis_lines, "estimate": verdict_lines}
        return whole[kind](document)
    short = {"track": track_headline, "diagnosis": diagnose_headline, "estimate": headline}
    lines = [short[kind](document)]
    if kind == "estimate" and document.get("diagnosis"):
        lines.append(diagnose_headline(document["diagnosis"]))
    return lines
