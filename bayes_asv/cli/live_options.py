"""Options of ``bayes-asv track`` for what is followed and where it is shown."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from bayes_asv.live.port import BAUD

if TYPE_CHECKING:
    from bayes_asv.library.live import LiveSettings

__all__ = ["baud_option", "live_options", "live_settings"]


def baud_option(default: int | None = None) -> Callable[..., Any]:
    """Make the option for the speed of a serial port; None where it was not given."""
    return click.option(
        "--baud", type=click.IntRange(300, 4_000_000), default=default, metavar="N",
        help=f"Bits per second of the port.  [default: {BAUD}]",
    )  # fmt: skip


def live_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that `live_settings` takes."""
    for option in reversed(
        (
            click.option("--live", is_flag=True, help="Show it in a browser, on this machine."),
            click.option("--tui", is_flag=True, help="Show it in this terminal."),
            click.option("--gif", metavar="FILE.gif", help="Draw it as an animation."),
            click.option(
                "--speed", type=click.FloatRange(0.01, 100.0), metavar="X",
                help="Seconds of the recording per second, for the three above.  [default: 1; an "
                "animation lasts 4 to 6 s]",
            ),
            click.option("--no-browser", is_flag=True, help="With --live: open no browser."),
            click.option("--port", metavar="P", help="A serial port instead of a recording."),
            baud_option(),
            click.option(
                "--keep", metavar="FILE",
                help="File for every byte of the port.  [default: run-DATE-TIME.txt]",
            ),
        )
    ):  # fmt: skip
        command = option(command)
    return command


def live_settings(
    recording: str | None,
    *,
    live: bool,
    tui: bool,
    gif: str | None,
    speed: float | None,
    no_browser: bool,
    port: str | None,
    baud: int | None,
    keep: str | None,
) -> LiveSettings:
    """Combine the options, and refuse combinations that do not fit.

    Raises
    ------
    click.UsageError
        In one sentence.
    """
    from bayes_asv.library.live import LiveSettings, SerialPort, check_gif

    if (recording is None) == (port is None):
        raise click.UsageError("give either a recording or --port")
    if port is None and (baud is not None or keep is not None):
        raise click.UsageError("--baud and --keep belong to --port")
    if port is not None and (gif is not None or speed is not None):
        raise click.UsageError("--gif and --speed need a recording: a port runs in real time")
    if speed is not None and not (live or tui or gif is not None):
        raise click.UsageError("--speed belongs to --live, --tui or --gif")
    if no_browser and not live:
        raise click.UsageError("--no-browser belongs to --live")
    if tui and not sys.stderr.isatty():
        raise click.UsageError("--tui needs a terminal; use --live")
    if gif is not None:
        check_gif(gif)
    source = None
    if port is not None:
        kept = keep or time.strftime("run-%Y%m%d-%H%M%S.txt")
        source = SerialPort(port, kept, baud or BAUD)
    return LiveSettings(live, tui, gif, source, speed, not no_browser)
