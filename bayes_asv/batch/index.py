"""What was done, kept so that an interrupted run continues: JSON answers and an index of them.

Every answer is a JSON file that is named after its key, a hash of all that it depends on.  The
index (SQLite) holds an extract of each, so that a thousand answers need not be read again; it is
made anew from the answers where it lacks one.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically

__all__ = ["AnswerIndex", "key_of"]


def key_of(parts: Iterable[str]) -> str:
    """Return a hash of texts, 32 hexadecimal digits."""
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()[:32]


class AnswerIndex:
    """Answers and their extracts in a folder, which one process at a time may write.

    Parameters
    ----------
    folder : Path
        Made where it does not exist; has ``index.sqlite`` and ``answers/KEY.json``.
    wait : float
        Time for another process to end, s.

    Raises
    ------
    InputError
        If the folder cannot be written, or another process writes it.
    """

    def __init__(self, folder: Path, wait: float = 2.0):
        self.folder = folder
        self._answers = folder / "answers"
        try:
            self._answers.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(folder / "index.sqlite", timeout=wait)
            with ExitStack() as failed:
                failed.callback(self._database.close)
                rows = self._opened()
                failed.pop_all()
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise InputError(
                    str(folder), "is being written by another run", "wait until it has ended"
                ) from None
            raise InputError(str(folder), f"cannot be written ({error})", "name another output"
            ) from None  # fmt: skip
        except sqlite3.DatabaseError:
            raise InputError(
                str(folder / "index.sqlite"), "is damaged",
                "delete it: it is made anew from the answers",
            ) from None  # fmt: skip
        except OSError as error:
            raise InputError(
                str(folder), f"cannot be made ({error.strerror})", "name another output"
            ) from None
        self._extracts: dict[str, dict[str, Any]] = {k: json.loads(text) for k, text in rows}

    def _opened(self) -> list[tuple[str, str]]:
        """Lock the index until the connection ends, at the latest with the process, and read it."""
        self._database.execute("PRAGMA locking_mode = EXCLUSIVE")
        self._database.execute("BEGIN EXCLUSIVE")
        self._database.execute(
            "CREATE TABLE IF NOT EXISTS answers (key TEXT PRIMARY KEY, extract TEXT NOT NULL)"
        )
        self._database.commit()
        return self._database.execute("SELECT key, extract FROM answers").fetchall()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._database.close()

    def answer(self, key: str) -> Path:
        """Return the path of an answer."""
        return self._answers / f"{key}.json"

    def get(
        self, key: str, extract: Callable[[Path], dict[str, Any] | None]
    ) -> dict[str, Any] | None:
        """Return the extract of an answer.

        Parameters
        ----------
        key : str
            Of the answer.
        extract : callable
            Makes it from the answer's file where the index lacks it; None if that is none.

        Returns
        -------
        dict or None
            None where there is no answer.
        """
        known = self._extracts.get(key)
        if known is not None and (known.get("answerless") or self.answer(key).exists()):
            return known
        if not self.answer(key).exists():
            return None
        made = extract(self.answer(key))
        if made is not None:
            self._insert(key, made)
        return made

    def put(self, key: str, answer: bytes | None, extract: dict[str, Any]) -> None:
        """Keep an answer, first its file; without one, an extract that stands for itself."""
        if answer is not None:
            write_atomically(self.answer(key), answer)
        self._insert(key, extract if answer is not None else {**extract, "answerless": True})

    def _insert(self, key: str, extract: dict[str, Any]) -> None:
        with self._database:
            self._database.execute(
                "INSERT OR REPLACE INTO answers VALUES (?, ?)", (key, json.dumps(extract))
            )
        self._extracts[key] = extract
