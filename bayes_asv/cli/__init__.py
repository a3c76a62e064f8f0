"""The command line: argument → call → print.  Imported by nothing.

Commands are imported when they are run, so that ``--help`` answers at once.
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

# Name, module under bayes_asv.cli, and what it does.
COMMANDS = {
    "estimate": "Posterior of c_f, c_r and i from one or several recordings.",
    "track": "The same online, row by row, with a check of itself; or live from a port.",
    "watch": "Track, and raise an alarm when a damper has lost more than a chosen share.",
    "diagnose": "Where simulation and measurement disagree, and what is missing.",
    "report": "An HTML or PDF report of recordings or of saved estimates.",
    "acquire": "A recording from the data logger over a serial port.",
    "logger": "The data logger without hardware, on simulated chips.",
    "plan": "Which road, speed, rate and passes give what is wanted, before the drive.",
    "simulate": "A recording from a road and a vehicle, with a seed.",
    "modes": "Eigenvalue modes, and the spectrum of a recording.",
    "greybox": "Prediction-error point estimate, the reference's own method.",
    "reproduce": "The reference's tables, as printed, as corrected, as obtained here.",
    "demo": "The whole way on shipped data, with a report at the end.",
}


class _LazyGroup(click.Group):
    """A group that knows its commands by name and imports one only to run it."""

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
            _silence()  # click would leave with 1; whoever read our output has what they wanted
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
    """Damping rates and pitch inertia of a small car, with intervals you can trust.

    Four accelerometers (wheel hubs and chassis, front and rear), one drive over a bump, and the
    nominal values of the car are all it needs.
    """


def main() -> NoReturn:
    """Run the command line and leave with its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without a sign gets a question mark
    try:
        status = cli.main(standalone_mode=False, prog_name="bayes-asv")
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(2)
    except click.ClickException as error:
        _complain(_usage(error))
        sys.exit(2)
    except click.Abort:
        _complain("interrupted")
        sys.exit(130)
    except BayesAsvError as error:
        _complain(str(error))
        sys.exit(2)
    except OSError as error:
        _silence()
        if not isinstance(error, BrokenPipeError):  # else whoever read has left: nothing to say
            _complain(f"output cannot be written ({error.strerror}); free some space")
            sys.exit(2)
        sys.exit(0)
    sys.exit(status if isinstance(status, int) else 0)


def _silence() -> None:
    """Throw away what standard output still holds, so that leaving does not fail on it again."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _usage(error: click.ClickException) -> str:
    """One line for a usage error, naming the command to ask."""
    text = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "bayes-asv"
    return f"{text}; see {path} --help"


def _complain(text: str) -> None:
    click.echo(f"bayes-asv: {text}", err=True)
