"""Options and habits that the commands share."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from bayes_asv.recording import Recording
    from bayes_asv.vehicle import Vehicle

__all__ = [
    "EXIT_STATUS",
    "json_option",
    "progress_bar",
    "rate_option",
    "read_inputs",
    "recordings_argument",
    "seed_option",
    "vehicle_option",
    "write_json",
]

EXIT_STATUS = {"ok": 0, "refused": 3, "not_converged": 4}

recordings_argument = click.argument("recordings", nargs=-1, required=True, metavar="REC...")
vehicle_option = click.option(
    "--vehicle", "-v", required=True, metavar="V.toml", help="What is known of the car."
)
json_option = click.option(
    "--json", "json_file", metavar="FILE", help="Write the result as JSON; '-' for standard output."
)
seed_option = click.option(
    "--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True,
    help="The same seed gives the same answer.",
)  # fmt: skip
rate_option = click.option(
    "--rate", type=float, metavar="HZ", help="Sampling rate of a recording that has no time stamps."
)


def read_inputs(
    paths: tuple[str, ...], vehicle: str, rate: float | None
) -> tuple[list[Recording], Vehicle]:
    """Read the vehicle first, then every recording."""
    from bayes_asv.formats import read_recording
    from bayes_asv.vehicle import read_vehicle

    car = read_vehicle(vehicle)
    return [read_recording(path, rate=rate) for path in paths], car


def write_json(document: dict[str, Any], file: str | None) -> None:
    """Write a document where the user asked for it, whole or not at all."""
    if file is None:
        return
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if file == "-":
        sys.stdout.write(text)
        return
    from bayes_asv.files import write_whole

    write_whole(file, text.encode("utf-8"))


@contextmanager
def progress_bar() -> Iterator[Callable[[float, str], None] | None]:
    """Show a bar on standard error while something long runs, only on a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("[bold]{task.percentage:3.0f} %"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0)

        def tell(share: float, words: str) -> None:
            bar.update(task, completed=share, description=words)

        yield tell
