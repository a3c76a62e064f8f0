"""``bayes-asv reproduce``."""

from __future__ import annotations

import os

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("reproduce")
@click.option(
    "-o", "folder", default="out", show_default=True, metavar="FOLDER",
    help="Folder for reproduce.html and reproduce.json.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(folder: str, json_file: str | None, seed: int) -> int:
    """Reproduce the reference's tables and figures: as printed, corrected and recomputed."""
    common.make_folder(folder)
    page, data = (os.path.join(folder, f"reproduce.{suffix}") for suffix in ("html", "json"))
    common.check_outputs((), page, data, json_file)
    from bayes_asv.domain.files import write_atomically
    from bayes_asv.library.progress import progress_bar
    from bayes_asv.reference.page import reproduction_page
    from bayes_asv.reference.reproduce import reproduce
    from bayes_asv.reference.text import reproduction_lines

    with progress_bar() as progress:
        found = reproduce(seed, progress)
        text = reproduction_page(found.document, found.figures)
    write_atomically(page, text.encode("utf-8"))
    common.write_json(found.document, data)
    lines = [*reproduction_lines(found.document), f"\nAll tables and figures: {page} (and {data})"]
    common.output(found.document, lines, json_file)
    return common.EXIT_STATUS[found.document["verdict"]]
