"""The index of answers: one writer, and made anew from the answers."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from bayes_asv.batch.index import AnswerIndex, key_of
from bayes_asv.domain.errors import InputError


def _extract(path: Path) -> dict[str, Any] | None:
    data = json.loads(path.read_text(encoding="utf-8"))
    return {"half": data["x"] / 2} if "x" in data else None


def _unread(path: Path) -> dict[str, Any]:
    raise AssertionError(f"{path} was read")


def test_answers_are_kept_and_the_index_is_made_anew(tmp_path: Path) -> None:
    with AnswerIndex(tmp_path / "a.fleet") as index:
        assert index.get("k", _extract) is None
        index.put("k", b'{"x": 4}', {"half": 2.0})
        index.put("none", None, {"reason": "unreadable"})
    with AnswerIndex(tmp_path / "a.fleet") as index:
        assert index.get("k", _unread) == {"half": 2.0}
        assert index.get("none", _unread) == {"reason": "unreadable", "answerless": True}
        index.answer("other").write_text('{"y": 1}', encoding="utf-8")
        assert index.get("other", _extract) is None
    (tmp_path / "a.fleet" / "index.sqlite").unlink()
    with AnswerIndex(tmp_path / "a.fleet") as index:
        assert index.get("k", _extract) == {"half": 2.0}
        assert index.get("none", _extract) is None
        index.answer("k").unlink()
        assert index.get("k", _extract) is None  # the answer is the truth, not the index


def test_two_runs_do_not_write_one_index(tmp_path: Path) -> None:
    with (
        AnswerIndex(tmp_path / "a.fleet"),
        pytest.raises(InputError, match="is being written by another run"),
    ):
        AnswerIndex(tmp_path / "a.fleet", wait=0.1)
    with AnswerIndex(tmp_path / "a.fleet"):
        pass


def test_a_damaged_index_says_what_to_do(tmp_path: Path) -> None:
    folder = tmp_path / "a.fleet"
    folder.mkdir()
    (folder / "index.sqlite").write_bytes(b"no database" * 200)
    with pytest.raises(InputError, match="delete it: it is made anew"):
        AnswerIndex(folder)
    (folder / "index.sqlite").unlink()
    AnswerIndex(folder).__exit__(None, None, None)
    with closing(sqlite3.connect(folder / "index.sqlite")) as database:
        assert database.execute("SELECT * FROM answers").fetchall() == []
    with pytest.raises(InputError, match="cannot be"):
        AnswerIndex(Path("/proc/there is no such folder/a.fleet"))


def test_keys_tell_their_parts_apart() -> None:
    assert key_of(["ab", "c"]) != key_of(["a", "bc"])
    assert len(key_of([])) == 32
