"""``bayes-asv inspect``."""

from __future__ import annotations

import click

from bayes_asv.cli import common

__all__ = ["command"]


@click.command("inspect")
@click.argument("log", metavar="FILE")
@click.option(
    "-o", "--output", "map_file", metavar="MAP.toml",
    help="Write the proposed channel map, for a person to correct.",
)  # fmt: skip
@common.json_option
@common.rate_option
def command(log: str, map_file: str | None, json_file: str | None, rate: float | None) -> int:
    """Show what a log of any logger holds, and propose its channel map."""
    common.check_outputs((log,), map_file, json_file)
    from bayes_asv.library.logs import inspect_log

    found = inspect_log(log, rate=rate)
    lines = found.lines()
    if map_file is not None:
        found.write_map(map_file)
        lines += ["", f"{map_file} has the proposed channel map: check it, line by line."]
    else:
        lines += ["", "-o channels.toml writes this as a channel map for you to correct."]
    common.output(found.to_dict(), lines, json_file)
    return common.EXIT_STATUS["ok"]
