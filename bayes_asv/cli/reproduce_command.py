"""``bayes-asv reproduce``."""

from __future__ import annotations

from pathlib import Path

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("reproduce")
@click.option(
    "-o", "folder", default="out", show_default=True, metavar="FOLDER",
    help="Where to write reproduce.html and reproduce.json.",
)  # fmt: skip
@common.json_option
@common.seed_option
def command(folder: str, json_file: str | None, seed: int) -> int:
    """Write the reference's tables and figures: as printed, as corrected, as obtained here."""
    from bayes_asv.domain.errors import InputError

    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            folder, f"cannot be made ({error.strerror})", "name another folder"
        ) from None
    page, data = str(target / "reproduce.html"), str(target / "reproduce.json")
    common.check_outputs((), page, data, json_file)
    with common.progress_bar() as progress:
        from bayes_asv.domain.files import write_atomically
        from bayes_asv.reference.page import reproduction_page
        from bayes_asv.reference.reproduce import reproduce
        from bayes_asv.reference.text import reproduction_lines

        found = reproduce(seed, progress)
        text = reproduction_page(found.document, found.figures)
    write_atomically(page, text.encode("utf-8"))
    common.write_json(found.document, data)
    common.write_json(found.document, json_file)
    quiet = json_file == "-"
    click.echo("\n".join(reproduction_lines(found.document)), err=quiet)
    click.echo(f"\nAll tables and figures: {page} (and {data})", err=quiet)
    return common.EXIT_STATUS[found.document["verdict"]]
