"""The command line: arguments in, a call of the library, text and JSON out.

Commands are imported when they are run, so that ``--help`` is fast.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
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
        except KeyboardInterrupt:
            raise click.Abort from None  # click would print an empty line
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
    "5 watch raised its alarm, 6 the sessions of compare contradict each other.",
)
@click.version_option(__version__, prog_name="bayes-asv")
def cli() -> None:
    """Estimate damping rates and pitch inertia of a small car, with credible intervals.

    It needs four accelerometers (wheel hubs and chassis, front and rear), one drive over a bump,
    and the nominal values of the car.
    """


def main() -> NoReturn:
    """Run the command line and exit with its status.

    Ctrl-C, SIGTERM and SIGHUP end every command with one line and 128 plus the number of the
    signal; ``track``, ``watch`` and ``acquire`` first report what they have, and a second signal
    ends those too.  Warnings of libraries are for developers and are not shown, except with
    ``python -W``.
    """
    _open_missing_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(
                errors="replace"
            )  # a terminal without a character shows a question mark
    warnings.filterwarnings("ignore", append=True)  # whatever no other filter asks for
    if not logging.root.handlers:
        logging.root.addHandler(logging.NullHandler())
    with _signals() as received:
        try:
            status = _run()
        except BaseException:  # a library may wrap the interrupt in an exception of its own
            if received:
                _end(received[0])
            raise
        if received and (status == _INTERRUPTED or not _concludes()):
            _end(received[0])
        if status == _INTERRUPTED:
            _print_error("interrupted")
            status = 128 + signal.SIGINT
    sys.exit(status)


_INTERRUPTED = -1
_GRACE = 0.7  # s until a command ends whose libraries swallowed the interrupt or delay it


def _concludes() -> bool:
    """Whether the command reports what it has when it is interrupted."""
    command, options = sys.argv[1:2], sys.argv[2:]
    live = any(word.startswith(("--live", "--port")) for word in options)
    return command in (["watch"], ["acquire"], ["logger"]) or (command == ["track"] and live)


def _run() -> int:
    """Run the command that the arguments name; return its exit status or `_INTERRUPTED`."""
    try:
        status = cli.main(standalone_mode=False, prog_name="bayes-asv")
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return 2
    except click.ClickException as error:
        _print_error(_usage(error))
        return 2
    except (click.Abort, KeyboardInterrupt):
        return _INTERRUPTED
    except BayesAsvError as error:
        _print_error(str(error))
        return 2
    except MemoryError:
        _print_error("the memory does not suffice; give shorter recordings, or free some memory")
        return 2
    except OSError as error:
        _discard_output()
        if not isinstance(error, BrokenPipeError):  # else the reader of a pipe has closed it
            _print_error(f"output cannot be written ({error.strerror}); free some space")
            return 2
        return 0
    return status if isinstance(status, int) else 0


@contextlib.contextmanager
def _signals() -> Iterator[list[int]]:
    """Turn the first signal that ends a process into KeyboardInterrupt, and end at the second.

    Yields the numbers of those that came.  Signals that the caller ignores, as nohup does, stay
    ignored.
    """
    received: list[int] = []

    def on_signal(number: int, _: object) -> None:
        received.append(number)
        sys.unraisablehook = lambda _: None  # nor of what the interrupt broke off in destructors
        if len(received) > 1:
            _end(number)
        if not _concludes():
            timer = threading.Timer(_GRACE, _end, [number])
            timer.daemon = True
            timer.start()
        raise KeyboardInterrupt

    replaced = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # no SIGHUP on Windows
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                replaced[number] = signal.signal(number, on_signal)
    try:
        yield received
    finally:
        for number, handler in replaced.items():
            signal.signal(number, handler)


_ending = threading.Lock()


def _end(number: int) -> NoReturn:
    """End the process at once: threads may still compute what nobody waits for.

    The thread that comes first says so; another one waits, and does not say it again.
    """
    if not _ending.acquire(timeout=1.0):
        os._exit(128 + number)
    _print_error("interrupted" if number == signal.SIGINT else "terminated")
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(128 + number)


def _open_missing_streams() -> None:
    """Give standard streams that were closed a file, so that no other file takes their number.

    That of standard output is one that cannot be written: what would be lost is an error.
    """
    for name, number in (("stdin", 0), ("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is not None:
            continue
        with contextlib.suppress(OSError):
            opened = os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            mode = "r" if number == 0 else "w"
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8"))


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
    with contextlib.suppress(OSError):  # standard error may be closed, or its disk full
        click.echo(f"bayes-asv: {text}", err=True)
