"""``bayes-asv logger``."""

from __future__ import annotations

import contextlib
import signal
import sys
import tempfile
from pathlib import Path

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("logger")
@click.option("--emulated", is_flag=True, help="On simulated chips; needs a source checkout.")
@click.option(
    "--recording", metavar="REC",
    help="What the sensors see, again and again; a simulated car over two parking stops without.",
)  # fmt: skip
@click.option(
    "--vehicle", "-v", metavar="V.toml", help="Its sensors' zero and scale.  [default: the Baja]"
)
@click.option(
    "--loss", type=click.FloatRange(0.0, 0.5), default=0.05, show_default=True, metavar="SHARE",
    help="Radio packets lost between the boards.",
)  # fmt: skip
@click.option(
    "--errors", type=click.FloatRange(0.0, 0.01), default=1e-4, show_default=True,
    metavar="SHARE", help="Bits inverted between the modems.",
)  # fmt: skip
@click.option(
    "--speed", type=click.FloatRange(0.1, 20.0), default=1.0, show_default=True, metavar="X",
    help="Virtual seconds a second.",
)  # fmt: skip
@common.rate_option
@common.seed_option
def command(
    emulated: bool,
    recording: str | None,
    vehicle: str | None,
    loss: float,
    errors: float,
    speed: float,
    rate: float | None,
    seed: int,
) -> int:
    """Run the data logger without hardware: its firmware, radios and modem, and a car on a road.

    It tells the port at which it is to be reached, and runs until Ctrl-C.
    """
    if not emulated:
        raise click.UsageError("give --emulated; a real logger is reached by bayes-asv acquire")
    from bayes_asv.acquire.emulated import (
        EVERY,
        Emulation,
        built,
        default_drive,
        scenario,
        started,
        write_voltages,
    )
    from bayes_asv.shipped import shipped

    chosen = vehicle or str(shipped("vehicles", "baja2008.toml"))
    runs, car = common.read_inputs(() if recording is None else (recording,), chosen, rate)
    firmware = built()
    with tempfile.TemporaryDirectory(prefix="logger-") as name:
        folder = Path(name)
        drive = runs[0] if runs else default_drive(car, seed)
        inputs, warning = write_voltages(drive, car, folder)
        if warning:
            click.echo(f"Note: {warning}.", err=True)
        wanted = Emulation(seed=seed, loss=loss, errors=errors, speed=speed)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _interrupted)
        process, port = started(firmware, scenario(firmware, wanted, inputs), folder)
        click.echo(
            f"The emulated logger is at {port}; the car passes its road every {EVERY:g} s.\n"
            "In another terminal:\n"
            f"  bayes-asv acquire --port {port} --start --mode loop --frequency 400 -o run.csv\n"
            f"  bayes-asv estimate run.csv --vehicle {chosen}\n"
            "Ctrl-C ends it."
        )
        sys.stdout.flush()
        try:
            with contextlib.suppress(KeyboardInterrupt):
                process.wait()
        finally:  # nobody is to be left at the port, whatever ends this
            process.terminate()
            process.wait(timeout=10)
    return 0


def _interrupted(number: int, frame: object) -> None:
    raise KeyboardInterrupt
