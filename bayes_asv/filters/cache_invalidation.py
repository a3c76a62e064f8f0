"""Removal of compiled kernels that are older than the modules they were compiled from.

Numba keeps a compiled function beside its module and compiles again when that module changes, but
not when one does that it calls: a branch added to :mod:`.forces` would not be in :mod:`.extended`.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

__all__ = ["forget_older"]


def forget_older(folder: Path) -> None:
    """Remove what was compiled before any module of a folder was last changed.

    Parameters
    ----------
    folder : Path
        Of modules, with what was compiled in its ``__pycache__``.  One that cannot be written is
        left as it is.
    """
    with suppress(OSError, ValueError):
        changed = max(module.stat().st_mtime_ns for module in folder.glob("*.py"))
        for compiled in (folder / "__pycache__").glob("*.nb[ci]"):
            if compiled.stat().st_mtime_ns < changed:
                compiled.unlink(missing_ok=True)
