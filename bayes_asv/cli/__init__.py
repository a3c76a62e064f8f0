"""The command line: arguments in, a call of the library, text and JSON out.

Commands are imported when they are run, so that ``--help`` is fast.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
from typing import NoReturn

import click

from bayes_asv import __version__
from bayes_asv.domain.errors import BayesAsvError

__all__ = ["COMMANDS", "cli", "main"]

# Name, and what it does; the module is bayes_asv.cli.NAME_command.
COMMANDS = {
    "inspect": "Show what a log of any logger holds, and propose its channel map.",
    "convert": "Write a log as a recording (CSV), by its channel map.",
    "calibrate": "Calibrate a sensor from a log in which it was held still.",
    "estimate": "Estimate damping rates and pitch inertia from recordings.",
    "track": "Track the parameters row by row, from a recording or live from a port.",
    "watch": "Track, and raise an alarm when a damper has become too soft.",
    "diagnose": "Find where simulation and measurement disagree, and what is missing.",
    "compare": "Test whether a parameter changed between two sets of recordings.",
    "fleet": "Estimate a season of recordings, and find when a damper changed.",
    "report": "Write an HTML or PDF report of recordings or saved results.",
    "acquire": "Read a recording from the data logger over a serial port.",
    "logger": "Run the data logger without hardware, on simulated chips.",
    "plan": "Find the drive that determines the parameters as well as wanted.",
    "simulate": "Simulate a recording of the vehicle over a road.",
    "modes": "Compute eigenvalue modes, and the spectrum of a recording.",
    "greybox": "Estimate by prediction errors, the reference's own method.",
    "reproduce": "Reproduce the reference's tables: as printed, corrected and recomputed.",
    "demo": "Estimate, diagnose and report shipped recordings.",
}


class _LazyGroup(click.Group):
    """A group that lists its commands by name and imports one only to run it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"bayes_asv.cli.{cmd_name}_command")
        command = module.command
        assert isinstance(command, click.Command)
        return command

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            _discard_output()  # click would exit with 1, but the reader of a pipe may close it
            ctx.exit(0)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            from bayes_asv.domain.files import closest

            near = closest(args[0], COMMANDS)
            fix = f"did you mean '{near}'?" if near else f"there are {', '.join(COMMANDS)}"
            raise click.UsageError(f"no command '{args[0]}'; {fix}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=_LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Exit status: 0 done, 2 unreadable input, 3 the data cannot answer, 4 not converged, "
    "5 watch raised its alarm.",
)
@click.version_option(__version__, prog_name="bayes-asv")
def cli() -> None:
    """Estimate damping rates and pitch inertia of a small car, with credible intervals.

    It needs four accelerometers (wheel hubs and chassis, front and rear), one drive over a bump,
    and the nominal values of the car.
    """


def main() -> NoReturn:
    """Run the command line and exit with its status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(
                errors="replace"
            )  # a terminal without a character shows a question mark
    try:
        status = cli.main(standalone_mode=False, prog_name="bayes-asv")
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(2)
    except click.ClickException as error:
        _print_error(_usage(error))
        sys.exit(2)
    except click.Abort:
        _print_error("interrupted")
        sys.exit(130)
    except BayesAsvError as error:
        _print_error(str(error))
        sys.exit(2)
    except OSError as error:
        _discard_output()
        if not isinstance(error, BrokenPipeError):  # else the reader of a pipe has closed it
            _print_error(f"output cannot be written ({error.strerror}); free some space")
            sys.exit(2)
        sys.exit(0)
    sys.exit(status if isinstance(status, int) else 0)


def _discard_output() -> None:
    """Discard what standard output still holds, so that the exit does not fail on it again."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _usage(error: click.ClickException) -> str:
    """One line for a usage error, with the command that shows the help."""
    text = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "bayes-asv"
    return f"{text}; see {path} --help"


def _print_error(text: str) -> None:
    click.echo(f"bayes-asv: {text}", err=True)
