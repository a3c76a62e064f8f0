"""Exceptions: faults in the input that the user can correct, each with a one-line message.

And how such a message lists several things.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["BayesAsvError", "FitError", "InputError", "enumerated"]


def enumerated(parts: Sequence[str], last: str = "and") -> str:
    """Join parts as in a sentence: ``a, b and c``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"


class BayesAsvError(Exception):
    """Base class of all exceptions that this package raises deliberately."""


class InputError(BayesAsvError):
    """An input cannot be read or is implausible.

    The message is one line, ``where: what; fix``.  The command line prints it on standard error and
    exits with status 2.

    Parameters
    ----------
    where : str
        Place of the fault: a file, ``file:line`` or ``file: [table] key``.
    what : str
        What is wrong.
    fix : str, optional
        How to correct it.
    """

    def __init__(self, where: str, what: str, fix: str = "") -> None:
        self.where = _one_line(where)
        self.what = _one_line(what)
        self.fix = _one_line(fix)
        text = f"{self.where}: {self.what}"
        super().__init__(f"{text}; {self.fix}" if self.fix else text)


class FitError(InputError):
    """What was fitted to a recording is no car, so that nothing can be said about it.

    Where a model is tried, it is given up; where none is left, the result is refused.
    """

    @property
    def reason(self) -> str:
        """The message as a result gives it."""
        return f"{self.what} ({self.where}); {self.fix}"


def _one_line(text: str) -> str:
    """Collapse white space and control characters, so that the message stays on one line."""
    printable = "".join(ch if ch.isprintable() else " " for ch in text)
    folded = " ".join(printable.split())
    return folded if len(folded) <= _MAX_LENGTH else folded[: _MAX_LENGTH - 1] + "…"


_MAX_LENGTH = 300  # characters; a quoted piece of a broken file must not fill the terminal
