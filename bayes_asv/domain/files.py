"""Read and write whole files; every failure is an `InputError` with a fix."""

from __future__ import annotations

import contextlib
import difflib
import os
import secrets
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["check_writable", "closest", "decode", "read_bytes", "write_atomically"]

PathLike = str | os.PathLike[str]

_MAX_NEIGHBOURS: Final = 2000
_MAX_NAME_LENGTH: Final = 120

# First bytes of common files that are not text in UTF-8.
_MAGIC_NUMBERS: Final = (
    (b"\x1f\x8b", "is gzip-compressed", "decompress it first (gunzip)"),
    (b"PK\x03\x04", "is a workbook or a zip archive", "save the sheet as CSV UTF-8, or unzip it"),
    (b"\xd0\xcf\x11\xe0", "is an old Excel workbook", "save the sheet as CSV UTF-8"),
    (b"MDF ", "is an MDF measurement file", "export it as CSV"),
    (b"\xff\xfe", "is UTF-16 text", "save it as UTF-8"),
    (b"\xfe\xff", "is UTF-16 text", "save it as UTF-8"),
)


def closest(name: str, names: Iterable[str]) -> str | None:
    """Return the entry of `names` closest in spelling to `name`, or None if none is close."""
    near = difflib.get_close_matches(name[:_MAX_NAME_LENGTH], list(names), n=1, cutoff=0.6)
    return near[0] if near else None


def read_bytes(path: PathLike, limit: int) -> bytes:
    """Read all bytes of a regular file.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    limit : int
        Largest size accepted, bytes.

    Returns
    -------
    bytes
        The content, never empty.

    Raises
    ------
    InputError
        If the file does not exist, is not a regular file, cannot be read, is empty or is longer
        than `limit`.
    """
    where = os.fspath(path)
    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise InputError(where, "is a folder", "name a file in it")
        if not stat.S_ISREG(status.st_mode):
            raise InputError(where, "is not an ordinary file", "save it to a file first")
        with open(path, "rb") as file:
            # read(n) allocates n bytes at once, so that no more than the file's size is asked for
            data = file.read(min(limit, status.st_size) + 1)
            if len(data) > status.st_size:  # it grew, or its system states no size
                data += file.read(limit + 1 - len(data))
    except FileNotFoundError:
        raise InputError(where, "no such file", _similar_name(Path(path))) from None
    except PermissionError:
        raise InputError(where, "may not be read", "check its permissions") from None
    except MemoryError:
        raise InputError(where, "does not fit into memory", "split it into pieces") from None
    except (OSError, ValueError) as exc:
        reason = getattr(exc, "strerror", None) or str(exc)
        raise InputError(where, f"cannot be read ({reason})", "check the name") from None
    if not data:
        raise InputError(where, "is empty", "export or copy it again")
    if len(data) > limit:
        raise InputError(where, f"is longer than {limit} bytes", "split it or check what it is")
    return data


def decode(data: bytes, where: str) -> str:
    """Decode UTF-8 text with or without a byte order mark.

    Raises
    ------
    InputError
        If the bytes are another file format or another encoding; the message names the line.
    """
    for magic, what, fix in _MAGIC_NUMBERS:
        if data.startswith(magic):
            raise InputError(where, what, fix)
    if b"\0" in data:
        raise InputError(where, "is not a text file", "export it as text, CSV UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as exc:
        line = data.count(b"\n", 0, exc.start) + 1
        raise InputError(f"{where}:{line}", "is not UTF-8 text", "save it as UTF-8") from None


def check_writable(path: PathLike) -> None:
    """Check that a file can be written, before a long computation rather than after it.

    Raises
    ------
    InputError
        As `write_whole` would.
    """
    where = os.fspath(path)
    try:
        target = Path(os.path.realpath(path))  # keep a symbolic link a link
        _check_not_special(target, where)
        if not target.parent.is_dir():
            raise FileNotFoundError
        if not os.access(target.parent, os.W_OK | os.X_OK):
            raise PermissionError
    except (OSError, ValueError) as exc:
        raise _write_error(where, exc) from None


def write_atomically(path: PathLike, data: bytes | Iterable[bytes]) -> None:
    """Write a file atomically, from one or several pieces of bytes.

    The bytes go to a temporary file in the same folder, which then replaces `path` in one step.  A
    failure leaves the old file unchanged.  Where the system has files without a name (Linux), the
    temporary file is one until it is complete, so that not even a process that is killed leaves it
    behind; only between two system calls, while it replaces another file, has it a name of its own.

    Raises
    ------
    InputError
        If the folder does not exist or may not be written, or `path` is not a regular file.
    """
    where = os.fspath(path)
    try:
        target = Path(os.path.realpath(path))  # keep a symbolic link a link
        _check_not_special(target, where)
        pieces = [data] if isinstance(data, bytes) else data
        beside = target.with_name(f".{secrets.token_hex(8)}.part")
        unnamed = _open_unnamed(target.parent)
        # open() rather than mkstemp(): the new file then gets the permissions of the umask
        file = open(beside, "xb") if unnamed is None else os.fdopen(unnamed, "wb")  # noqa: SIM115
        try:
            with file:
                file.writelines(pieces)
                file.flush()
                os.fsync(file.fileno())
                if unnamed is not None:
                    # with a folder's descriptor, which is not used, the link itself is followed
                    os.link(f"/proc/self/fd/{unnamed}", beside, src_dir_fd=unnamed)
            if target.exists():
                os.chmod(beside, stat.S_IMODE(target.stat().st_mode))
            os.replace(beside, target)
        finally:
            with contextlib.suppress(OSError):
                os.unlink(beside)
    except (OSError, ValueError) as exc:
        raise _write_error(where, exc) from None


def _open_unnamed(folder: Path) -> int | None:
    """Open a file of a folder that has no name yet; None where the system has no such files."""
    flag = getattr(os, "O_TMPFILE", None)  # Linux alone
    if flag is None or not os.path.exists("/proc/self/fd"):
        return None
    try:
        return os.open(folder, flag | os.O_WRONLY | os.O_CLOEXEC, 0o666)
    except OSError:  # not every file system has them; what else is wrong, open() will say
        return None


def _check_not_special(target: Path, where: str) -> None:
    if target.is_dir():
        raise InputError(where, "is a folder", "name a file in it")
    if target.exists() and not target.is_file():
        raise InputError(where, "is not an ordinary file", "name another file")


def _write_error(where: str, fault: OSError | ValueError) -> InputError:
    if isinstance(fault, FileNotFoundError | NotADirectoryError):
        return InputError(where, "its folder does not exist", "make the folder first")
    if isinstance(fault, PermissionError):
        return InputError(where, "may not be written", "check the folder's permissions")
    reason = getattr(fault, "strerror", None) or str(fault)
    return InputError(where, f"cannot be written ({reason})", "name another file")


def _similar_name(path: Path) -> str:
    """Suggest the file in the same folder whose name is closest to that of `path`."""
    try:
        with os.scandir(path.parent) as entries:
            names = [entry.name for _, entry in zip(range(_MAX_NEIGHBOURS), entries, strict=False)]
    except (OSError, ValueError):
        return "its folder does not exist either; check the path"
    near = closest(path.name, names)
    return f"did you mean {path.with_name(near)}?" if near else "check the name"
