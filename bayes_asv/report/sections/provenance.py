"""Files with their hashes, versions and seed."""

from __future__ import annotations

from collections.abc import Iterator

from bayes_asv.report.schema import EstimateDocument, PageDocument
from bayes_asv.report.sections.blocks import Block, Table, Text
from bayes_asv.report.words import MISSING, plain

__all__ = ["provenance"]


def provenance(document: PageDocument) -> Iterator[Block]:
    """List what is needed to repeat the computation."""
    origin = document.provenance
    files = [*origin.recordings, *([origin.vehicle] if origin.vehicle is not None else [])]
    rows = [[plain(f.file or MISSING), plain(f.sha256 or "no hash")] for f in files]
    if rows:
        yield Table("Provenance", ["file", "SHA-256"], rows, kind="hashes")
    versions = {"bayes_asv": document.version, "Python": origin.python, **origin.packages}
    shown = ", ".join(f"{plain(name)} {plain(v)}" for name, v in versions.items() if v)
    lines = [
        f"Versions: {shown}. Seed {document.seed}: the same files, versions and seed give the same "
        "numbers."
    ]
    if isinstance(document, EstimateDocument) and document.diagnostics.likelihood:
        car, likelihood = plain(document.car), plain(document.diagnostics.likelihood)
        lines[0] += f" Model of the car: {car}. Likelihood: {likelihood}."
    yield Text("", lines)
