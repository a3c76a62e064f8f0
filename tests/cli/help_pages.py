"""Write ``docs/commands.md``: ``python -m tests.cli.help_pages``."""

from __future__ import annotations

import importlib
from pathlib import Path

import click

from bayes_asv.cli import COMMANDS, cli

__all__ = ["PAGE", "page"]

PAGE = Path(__file__).parents[2] / "docs" / "commands.md"

_WIDTH = 90
_ABOUT = """\
# Commands

The help of `bayes-asv` and of each of its commands, written by `python -m tests.cli.help_pages`.
`python -m bayes_asv` is the same program. [library.md](library.md) says how the same is done from
Python.

Every command but `convert` and `logger` takes `--json FILE` (`-` for standard output), and those
whose answer can depend on random numbers take `--seed N`. The same seed gives the same bytes apart
from `seconds`, with any number of threads, with and without
compiled code in the cache, and on Python 3.11 to 3.13 with the same versions of the packages
(only `provenance.python` differs). Other versions of NumPy and SciPy add in another order: means,
deviations and intervals then differ from their ninth digit on, and a number that is a small
difference of large ones (a remainder's score, the probability of a name that is ruled out) from
its third. Progress is shown on a terminal only.

| exit status | |
|---|---|
| 0 | done |
| 2 | wrong usage or unreadable input: one line names the file, line or key, and the fix |
| 3 | refused: too short, saturated or not excited; `acquire`: incomplete; `plan`: none suffices |
| 4 | not converged: the numbers are written, but are not to be relied on |
| 5 | `watch` raised its alarm |
| 6 | `compare`: the sessions differ in something else, or the model does not hold |
| 128 + n | ended by signal n, such as 130 by Ctrl-C |
"""


def page() -> str:
    """Return the whole page."""
    parts = [_ABOUT, _section("bayes-asv", cli)]
    for name in COMMANDS:
        command = importlib.import_module(f"bayes_asv.cli.{name}_command").command
        assert isinstance(command, click.Command)
        parts.append(_section(f"bayes-asv {name}", command))
    return "\n".join(parts)


def _section(path: str, command: click.Command) -> str:
    settings = {"help_option_names": ["-h", "--help"]}
    context = click.Context(command, info_name=path, terminal_width=_WIDTH, **settings)  # type: ignore[arg-type]
    return f"## {path}\n\n```text\n{command.get_help(context)}\n```\n"


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
