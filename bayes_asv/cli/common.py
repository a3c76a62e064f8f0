"""Options, checks and outputs that the commands share."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import click

from bayes_asv.domain.errors import InputError

__all__ = [
    "CARS",
    "EXIT_STATUS",
    "answer",
    "below_option",
    "car_option",
    "car_option_of",
    "channels_option",
    "check_outputs",
    "effects_option",
    "json_option",
    "make_folder",
    "output",
    "print_answer",
    "quantity",
    "rate_option",
    "recordings_argument",
    "say",
    "seed_option",
    "vehicle_option",
    "write_json",
]

EXIT_STATUS = {"ok": 0, "refused": 3, "not_converged": 4}
"""Exit status of the verdicts of every command that estimates."""

recordings_argument = click.argument("recordings", nargs=-1, required=True, metavar="REC...")
vehicle_option = click.option(
    "--vehicle", "-v", required=True, metavar="V.toml", help="The vehicle file."
)
json_option = click.option(
    "--json", "json_file", metavar="FILE", help="Write the result as JSON; '-' for standard output."
)
seed_option = click.option(
    "--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True,
    help="The same seed gives the same answer.",
)  # fmt: skip
channels_option = click.option(
    "--channels", "channel_map", metavar="MAP.toml",
    help="Channel map of a foreign log, as 'inspect' writes it; by default that of the vehicle "
    "file.",
)  # fmt: skip
rate_option = click.option(
    "--rate", type=float, metavar="HZ", help="Sampling rate of a recording without time stamps."
)

effects_option = click.option(
    "--with", "effects", multiple=True, metavar="EFFECT",
    help="An effect that the car has, such as bound_rebound@rear; may be given several times.",
)  # fmt: skip

CARS = ("half", "quarter-front", "quarter-rear", "roll")
"""Names of :data:`bayes_asv.models.cars.CARS`, which takes time to import."""
below_option = click.option(
    "--below", type=click.FloatRange(min=0.0, min_open=True), metavar="HZ",
    help="Use only the motion below this frequency.",
)  # fmt: skip


def car_option_of(default: str) -> Callable[[Any], Any]:
    """Make the option of the car's model, whose default is said in words."""
    words = f"Model of the car (docs/cars.md); by default {default}."
    return click.option("--car", type=click.Choice(CARS), help=words)


car_option = car_option_of("the one whose wheels the first recording has")


def quantity(
    dimension: str, example: str, limits: tuple[float, float] = (0.0, math.inf)
) -> Callable[[click.Context, click.Parameter, str | None], str | None]:
    """Make the check of an option that takes a positive quantity with its unit.

    Parameters
    ----------
    dimension : str
        As in :mod:`bayes_asv.domain.units`.
    example : str
        A text that fits.
    limits : pair of float
        Smallest and largest value, SI units.
    """

    def check(ctx: click.Context, param: click.Parameter, text: str | None) -> str | None:
        from bayes_asv.library.inputs import positive_quantity

        try:
            positive_quantity(param.opts[0], text, dimension, example, limits)
        except InputError as fault:
            raise click.UsageError(str(fault), ctx) from None
        return text

    return check


def check_outputs(inputs: Iterable[str | None], *outputs: str | None) -> None:
    """Refuse outputs that cannot be written or would replace an input, before the work.

    Parameters
    ----------
    inputs : iterable of str or None
        Files that are read.
    *outputs : str or None
        Files that will be written; None and ``-`` are not checked.
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


def make_folder(folder: str) -> None:
    """Make the folder of the outputs."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise InputError(
            folder, f"cannot be made ({error.strerror})", "name another folder"
        ) from None


def write_json(document: Mapping[str, Any], file: str | None) -> None:
    """Write a document to a file atomically, or to standard output for ``-``."""
    if file is None:
        return
    from bayes_asv.domain.files import write_atomically
    from bayes_asv.library.result import json_text

    # ASCII passes every terminal and pipe; a file is UTF-8, which is easier to read.
    text = json_text(document, ascii_only=file == "-")
    if file == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    write_atomically(file, text.encode("utf-8", "replace"))  # a file's name need not be Unicode


def output(document: Mapping[str, Any], lines: Iterable[str], json_file: str | None) -> None:
    """Write the document where it was asked for, and print the lines.

    The lines go to standard error where standard output holds the JSON.
    """
    write_json(document, json_file)
    click.echo("\n".join(lines), err=json_file == "-")


def answer(result: Any, json_file: str | None) -> None:
    """Write the document of an estimate, a track or a diagnosis, and print its answer.

    The answer goes to standard error where standard output holds the JSON.
    """
    write_json(result.document.to_dict(), json_file)
    print_answer(result, err=json_file == "-")


def print_answer(result: Any, *further: str, err: bool = False) -> None:
    """Print the answer of an estimate, a track or a diagnosis, and further sentences.

    It is wrapped at words and has colours on a terminal that shows them, unless ``NO_COLOR`` is
    set.
    """
    from rich.console import Console
    from rich.text import Text

    from bayes_asv.report.terminal import WIDTH, answer_text

    console = Console(file=sys.stderr if err else sys.stdout, highlight=False, emoji=False)
    if not console.is_terminal:
        console.width = WIDTH
    for part in answer_text(result.document, [*result.lines(), *further], console.width):
        console.print(part, soft_wrap=isinstance(part, Text))


def say(text: str) -> None:
    """Print a message on standard error."""
    click.echo(text, err=True)
