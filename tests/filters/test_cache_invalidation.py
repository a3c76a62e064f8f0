"""What was compiled from older modules is forgotten."""

from __future__ import annotations

import os
from pathlib import Path

from bayes_asv.filters import purge_stale_cache


def _written(path: Path, at: int) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("")
    os.utime(path, (at, at))
    return path


def test_a_change_of_any_module_forgets_what_was_compiled_before(tmp_path: Path) -> None:
    _written(tmp_path / "caller.py", 100)
    _written(tmp_path / "called.py", 300)
    old = [_written(tmp_path / "__pycache__" / f"caller.run-1.py311.{end}", 200) for end in
           ("nbi", "1.nbc")]  # fmt: skip
    new = _written(tmp_path / "__pycache__" / "caller.walk-9.py311.nbi", 400)
    other = _written(tmp_path / "__pycache__" / "caller.cpython-311.pyc", 200)
    purge_stale_cache(tmp_path)
    assert not any(path.exists() for path in old)
    assert new.exists()
    assert other.exists()


def test_a_folder_without_anything_is_left_alone(tmp_path: Path) -> None:
    purge_stale_cache(tmp_path)
    purge_stale_cache(tmp_path / "nowhere")
    assert list(tmp_path.iterdir()) == []
