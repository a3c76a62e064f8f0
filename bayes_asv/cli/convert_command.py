"""``bayes-asv convert``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("convert")
@click.argument("log", metavar="FILE")
@click.option(
    "--channels", "channel_map", required=True, metavar="MAP.toml",
    help="Channel map, as 'inspect' writes it.",
)  # fmt: skip
@click.option("-o", "--output", required=True, metavar="REC.csv", help="The recording to write.")
@common.rate_option
def command(log: str, channel_map: str, output: str, rate: float | None) -> int:
    """Write a log as a recording (CSV), by its channel map."""
    common.check_outputs((log, channel_map), output)
    import bayes_asv as asv

    recording = asv.read_recording(log, rate=rate, channels=channel_map)
    recording.to_csv(output)
    for text in recording.warnings:
        common.say(f"note: {text}")
    click.echo(
        f"{output}: {len(recording.time)} rows of {', '.join(recording.channels)}, "
        f"{recording.duration:.4g} s"
    )
    return common.EXIT_STATUS["ok"]
