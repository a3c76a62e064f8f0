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
@click.option("--emulated", is_flag=True, help="Run on simulated chips; needs a source checkout.")
@click.option(
    "--recording", metavar="REC",
    help="What the sensors measure, repeated; by default a simulated car over two parking stops.",
)  # fmt: skip
@click.option(
    "--vehicle",
    "-v",
    metavar="V.toml",
    help="Zero and scale of its sensors.  [default: baja2008.toml]",
)
@click.option(
    "--loss", type=click.FloatRange(0.0, 0.5), default=0.05, show_default=True, metavar="SHARE",
    help="Share of the radio packets between the boards that is lost.",
)  # fmt: skip
@click.option(
    "--errors", type=click.FloatRange(0.0, 0.01), default=1e-4, show_default=True,
    metavar="SHARE", help="Share of the bits between the modems that is inverted.",
)  # fmt: skip
@click.option(
    "--speed", type=click.FloatRange(0.1, 20.0), default=1.0, show_default=True, metavar="X",
    help="Simulated seconds per second.",
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
    """Run the data logger without hardware: firmware, radios, modem, and a car on a road.

    It prints the port of the emulated logger, and runs until Ctrl-C.
    """
    if not emulated:
        raise click.UsageError("give --emulated; for a real logger use bayes-asv acquire")
    import bayes_asv as asv
    from bayes_asv.acquire.emulator import (
        PERIOD,
        EmulatorOptions,
        build_firmware,
        default_drive,
        scenario_text,
        start_emulator,
        write_voltages,
    )
    from bayes_asv.library.inputs import check_inputs

    chosen = vehicle or str(asv.example("baja2008.toml"))
    car = asv.read_vehicle(chosen)
    drive = None if recording is None else asv.read_recording(recording, rate=rate)
    if drive is not None:
        check_inputs("logger", drive, car)
    firmware = build_firmware()
    with tempfile.TemporaryDirectory(prefix="logger-") as name:
        folder = Path(name)
        inputs, warning = write_voltages(drive or default_drive(car, seed), car, folder)
        if warning:
            click.echo(f"Note: {warning}.", err=True)
        wanted = EmulatorOptions(seed=seed, loss=loss, errors=errors, speed=speed)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _interrupted)
        process, port = start_emulator(firmware, scenario_text(firmware, wanted, inputs), folder)
        click.echo(
            f"The emulated logger is at {port}; the car passes its road every {PERIOD:g} s.\n"
            "In another terminal:\n"
            f"  bayes-asv acquire --port {port} --start --mode loop --frequency 400 -o run.csv\n"
            f"  bayes-asv estimate run.csv --vehicle {chosen}\n"
            "Stop it with Ctrl-C."
        )
        sys.stdout.flush()
        try:
            with contextlib.suppress(KeyboardInterrupt):
                process.wait()
        finally:  # the process must not keep the port, however this ends
            process.terminate()
            process.wait(timeout=10)
    return 0


def _interrupted(number: int, frame: object) -> None:
    raise KeyboardInterrupt
