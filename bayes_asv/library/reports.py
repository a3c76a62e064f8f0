"""A report of recordings or of saved documents: what is missing is computed first."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike
from bayes_asv.library.progress import Progress, part_of, progress_bar

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.report.schema import ReportDocument

__all__ = ["report", "short_lines"]

_KIND_OF = {
    "bayes_asv/estimate/1": "estimate",
    "bayes_asv/diagnose/1": "diagnosis",
    "bayes_asv/track/1": "track",
    "bayes_asv/compare/1": "comparison",
}

_SHARES = (0.0, 0.24, 0.76, 0.8)  # of the time: estimate, diagnosis, track, writing


def report(
    output: PathLike,
    recordings: Sequence[Recording] = (),
    vehicle: Vehicle | None = None,
    *,
    saved: Sequence[PathLike] = (),
    diagnosis: bool = True,
    interactive: bool = False,
    car: str | None = None,
    below: float | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> ReportDocument:
    """Write a report of recordings and saved documents.

    Parameters
    ----------
    output : str or os.PathLike
        The report, HTML or PDF by its suffix.
    recordings : sequence of Recording
        Estimated, diagnosed and tracked, as far as this was not saved and the car can be.
    vehicle : Vehicle or None
        The car; None where nothing is to be computed.
    saved : sequence of path-like
        JSON that estimate, diagnose or track wrote, at most one of each, or that compare wrote,
        alone.
    diagnosis : bool
        Whether recordings are diagnosed.
    interactive : bool
        Write a page to look at the recordings of the estimate closely, in place of a report.
    car : str, optional
        Model of the car, as for :func:`bayes_asv.estimate`.
    below : float, optional
        Use only the motion below this frequency, Hz, as :func:`bayes_asv.estimate` does; then the
        recordings are neither diagnosed nor tracked, which needs the whole band.
    seed : int
        The same seed gives the same answer.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    EstimateDocument, DiagnoseDocument, TrackDocument or CompareDocument
        What the report was made of.

    Raises
    ------
    InputError
        If a document cannot be read or was made of other recordings, or the report cannot be
        written.
    """
    from bayes_asv.report.render import check_suffix, write_report

    check_suffix(output, interactive=interactive)
    documents = _read(saved)
    _check_recordings(saved, recordings)
    if below is not None and "estimate" in documents:
        raise InputError(
            "--below", "belongs to an estimate, which is given",
            "estimate with it, or leave the saved estimate out",
        )  # fmt: skip
    with progress_bar(progress) as bar:
        if vehicle is not None:
            parts = [part_of(bar, *span) or False for span in pairwise(_SHARES)]
            documents = _complete(
                documents, recordings, vehicle, diagnosis and not interactive, not interactive,
                car, below, seed, parts,
            )  # fmt: skip
        document = _combined(documents)
        if bar is not None:
            bar(_SHARES[-1] if vehicle is not None else 0.0, f"writing {output}")
        write_report(document, output, interactive=interactive)
    return document


def _read(paths: Sequence[PathLike]) -> dict[str, Any]:
    """Read saved documents by kind."""
    from bayes_asv.report.schema import read_saved

    documents: dict[str, Any] = {}
    for path in paths:
        document = read_saved(path)
        kind = _KIND_OF[document.schema_name]
        if kind in documents:
            raise InputError(
                str(path), f"a report holds one {kind}", "give --from once for each kind"
            )
        documents[kind] = document
    if "comparison" in documents and len(documents) > 1:
        raise InputError("report", "a comparison has a report of its own", "give it alone")
    return documents


def _combined(documents: dict[str, Any]) -> ReportDocument:
    """Return the estimate with the others in it, or the only document there is."""
    found: ReportDocument
    if "estimate" not in documents:
        if len(documents) > 1:
            raise InputError(
                "report", "a diagnosis and a track need the estimate beside them", "give it too"
            )
        (found,) = documents.values()
        return found
    beside = {"diagnosis": documents.get("diagnosis"), "online": documents.get("track")}
    given = {key: one for key, one in beside.items() if one is not None}
    found = documents["estimate"].model_copy(update=given)
    return found


def _check_recordings(saved: Sequence[PathLike], recordings: Sequence[Recording]) -> None:
    """Refuse a saved document of other recordings."""
    from bayes_asv.report.schema import read_saved

    given = {run.sha256 for run in recordings}
    if not given:
        return
    for path in saved:
        document = read_saved(path)
        if document.schema_name == "bayes_asv/compare/1":
            raise InputError(
                str(path), "a comparison has its recordings already", "give no others beside it"
            )
        known = {file.sha256 for file in document.provenance.recordings}
        same = {
            "bayes_asv/estimate/1": known == given,
            "bayes_asv/diagnose/1": given <= known,
            "bayes_asv/track/1": known <= given,
        }[document.schema_name]
        if known and not same:
            raise InputError(
                str(path), "was made of other recordings", "give those, or leave the file out"
            )


def _complete(
    documents: dict[str, Any],
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    diagnosis: bool,
    online: bool,
    car: str | None,
    below: float | None,
    seed: int,
    parts: Sequence[Progress],
) -> dict[str, Any]:
    """Compute the documents that were not saved.

    Only the half car with its four accelerations is tracked.
    """
    from bayes_asv.library.diagnoses import diagnose
    from bayes_asv.library.estimates import estimate
    from bayes_asv.library.tracks import track

    found = dict(documents)
    if "estimate" not in found:
        result = estimate(
            recordings, vehicle, car=car, below=below, seed=seed, progress=parts[0]
        )  # fmt: skip
        found["estimate"] = result.document
    which = found["estimate"].car
    if found["estimate"].verdict == "refused" or below is not None:
        return found
    if diagnosis and "diagnosis" not in found and found["estimate"].diagnosis is None:
        missing = diagnose(recordings, vehicle, car=which, seed=seed, progress=parts[1])
        found["diagnosis"] = missing.document
    usual = which == "half" and all(set(run.channels) == set(CHANNELS) for run in recordings)
    if online and usual and "track" not in found:
        tracked = track(recordings[:1], vehicle, seed=seed, progress=parts[2])
        found["track"] = tracked.document
    return found


def short_lines(document: ReportDocument) -> list[str]:
    """State the headline of a document, or the reasons of a refusal."""
    from bayes_asv.report.schema import CompareDocument, DiagnoseDocument, EstimateDocument
    from bayes_asv.report.sections.compare import compare_headline, compare_lines
    from bayes_asv.report.sections.diagnosis import diagnosis_headline, diagnosis_lines
    from bayes_asv.report.sections.verdict import (
        headline,
        track_headline,
        track_lines,
        verdict_lines,
    )

    refused = document.verdict == "refused"
    if isinstance(document, DiagnoseDocument):
        return diagnosis_lines(document) if refused else [diagnosis_headline(document)]
    if isinstance(document, CompareDocument):
        return compare_lines(document) if refused else [compare_headline(document)]
    if not isinstance(document, EstimateDocument):
        return track_lines(document) if refused else [track_headline(document)]
    if refused:
        return verdict_lines(document)
    lines = [headline(document)]
    if document.diagnosis is not None:
        lines.append(diagnosis_headline(document.diagnosis))
    return lines
