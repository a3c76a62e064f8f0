"""Compiled kernels; they do not check their arguments.

Each kernel has a readable reference in ``bayes_asv.models`` or in the tests that holds it.

Numba keeps a compiled function beside its module and compiles again when that module changes, but
not when one does that it calls: a new branch of :mod:`.force_laws` would not reach :mod:`.kalman`.
So what is older than any module of this folder is removed before anything is compiled.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

__all__ = ["purge_stale_cache"]


def purge_stale_cache(folder: Path) -> None:
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


purge_stale_cache(Path(__file__).parent)
