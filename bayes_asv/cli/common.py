"""Options and habits that the commands share."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from bayes_asv.domain.recording import Recording
    from bayes_asv.domain.vehicle import Vehicle

__all__ = [
    "EXIT_STATUS",
    "check_outputs",
    "json_option",
    "part_of",
    "progress_bar",
    "rate_option",
    "read_inputs",
    "recordings_argument",
    "seed_option",
    "vehicle_option",
    "write_json",
]

Progress = Callable[[float, str], None]

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
    paths: tuple[str, ...], vehicle: str, rate: float | None, rolls: bool = False
) -> tuple[list[Recording], Vehicle]:
    """Read the vehicle first, then every recording; of single corners where the car rolls."""
    from bayes_asv.domain.recording import require_half_car, require_roll_car
    from bayes_asv.domain.vehicle import read_vehicle
    from bayes_asv.io import read_recording

    car = read_vehicle(vehicle)
    runs: list[Recording] = []
    for path in paths:
        run = read_recording(path, rate=rate)
        (require_roll_car if rolls else require_half_car)(run)
        twin = next((r for r in runs if r.sha256 == run.sha256), None)
        if twin is not None:  # it would be counted as twice the evidence
            raise InputError(path, f"holds the same as {twin.source}", "give each recording once")
        runs.append(run)
    return runs, car


def check_outputs(inputs: Iterable[str | None], *outputs: str | None) -> None:
    """Refuse outputs that cannot be written or would replace an input, before the work.

    Parameters
    ----------
    inputs : iterable of str or None
        Files that are read.
    *outputs : str or None
        Files that will be written; None and ``-`` are nothing to check.
    """
    from bayes_asv.domain.files import check_writable

    taken = {os.path.realpath(path): "is read by this command" for path in inputs if path}
    for path in outputs:
        if path is None or path == "-":
            continue
        check_writable(path)
        place = os.path.realpath(path)
        if place in taken:
            raise InputError(path, f"{taken[place]} and would be replaced", "name another file")
        taken[place] = "is written twice by this command"


def write_json(document: dict[str, Any], file: str | None) -> None:
    """Write a document where the user asked for it, whole or not at all."""
    if file is None:
        return
    # ASCII passes every terminal and pipe; a file is UTF-8 and easier to read.
    text = json.dumps(document, indent=1, ensure_ascii=file == "-", allow_nan=False) + "\n"
    if file == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    from bayes_asv.domain.files import write_atomically

    write_atomically(file, text.encode("utf-8", "replace"))  # a file's name need not be Unicode


def part_of(progress: Progress | None, begin: float, end: float) -> Progress | None:
    """Let a part of a longer work tell how far it is.

    Parameters
    ----------
    progress : callable or None
        Of the whole.
    begin, end : float
        Shares of the whole where the part begins and ends.
    """
    if progress is None:
        return None

    def tell(share: float, words: str) -> None:
        progress(begin + (end - begin) * share, words)

    return tell


@contextmanager
def progress_bar() -> Iterator[Progress | None]:
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
            # what is asked again does not undo what was done
            bar.update(task, completed=max(share, bar.tasks[0].completed), description=words)

        yield tell
