"""One small family of exceptions: what a person can mend, said in one sentence."""

from __future__ import annotations

__all__ = ["BayesAsvError", "InputError"]


class BayesAsvError(Exception):
    """Base class of everything this package raises on purpose."""


class InputError(BayesAsvError):
    """Something the user gave cannot be read or does not make sense.

    The message is one line: where (file, line or key), what is wrong, and the mend.
    The command line prints it on standard error and leaves with status 2.

    Parameters
    ----------
    where : str
        File, ``file:line`` or ``file: [table] key`` where the fault stands.
    what : str
        What is wrong there, in words.
    mend : str
        What to do about it.
    """

    def __init__(self, where: str, what: str, mend: str = "") -> None:
        self.where = _one_line(where)
        self.what = _one_line(what)
        self.mend = _one_line(mend)
        text = f"{self.where}: {self.what}"
        super().__init__(f"{text}; {self.mend}" if self.mend else text)


def _one_line(text: str) -> str:
    """Fold white space and control characters, so that a message stays on its line."""
    printable = "".join(ch if ch.isprintable() else " " for ch in text)
    folded = " ".join(printable.split())
    return folded if len(folded) <= _LONGEST else folded[: _LONGEST - 1] + "…"


_LONGEST = 300  # a quoted piece of a broken file must not flood a terminal
