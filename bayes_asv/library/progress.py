"""A progress bar in a terminal or a notebook, and none in a batch."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Progress", "Report", "part_of", "progress_bar"]

Report = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and what is being done."""

Progress = bool | Report | None
"""What a function of the library takes as ``progress``.

None shows a bar on a terminal or in a notebook, True always, False never; a callable is called in
place of a bar.
"""


@contextmanager
def progress_bar(progress: Progress = None) -> Iterator[Report | None]:
    """Show a bar while something long runs, if it is wanted.

    Parameters
    ----------
    progress : bool, callable or None
        As in :data:`Progress`.

    Yields
    ------
    callable or None
        What the work reports to; None where nothing is shown.
    """
    if callable(progress):
        yield progress
        return
    notebook = _in_notebook()
    if progress is False or (progress is None and not (notebook or sys.stderr.isatty())):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("[bold]{task.percentage:3.0f} %"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    console = Console(stderr=not notebook, force_jupyter=notebook)
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("reading", total=1.0)

        def report(share: float, words: str) -> None:
            # an iterative step that repeats does not undo what was done
            bar.update(task, completed=max(share, bar.tasks[0].completed), description=words)

        yield report


def part_of(progress: Report | None, begin: float, end: float) -> Report | None:
    """Let a part of a longer work report its own progress from 0 to 1.

    Parameters
    ----------
    progress : callable or None
        Of the whole.
    begin, end : float
        Shares of the whole where the part begins and ends.
    """
    if progress is None:
        return None

    def report(share: float, words: str) -> None:
        progress(begin + (end - begin) * share, words)

    return report


def _in_notebook() -> bool:
    """Whether this runs in a Jupyter kernel."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"
