"""Reading in a process of its own.

Packages for binary formats may crash, hang or fill the memory on a damaged file, as tests with
damaged copies showed.  In a process of its own none of this reaches the caller.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bayes_asv.domain.errors import InputError

if TYPE_CHECKING:
    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import Format, LogFile

__all__ = ["read_isolated", "serve"]

_PATIENCE: Final = 30.0  # s, of which the import of a package may take ten on a slow disk
_PATIENCE_PER_BYTE: Final = 2e-6  # s; messages of a ROS bag are decoded at some 1 MB/s
_MEMORY: Final = 8 << 30  # bytes of address space: a log of the largest size, ten times
_ROOT: Final = Path(__file__).parents[3]


def read_isolated(form: Format, file: LogFile) -> Log:
    """Read a file by a format that needs a package.

    Raises
    ------
    InputError
        If the package is not installed, or the file cannot be read within the bounds.
    """
    if importlib.util.find_spec(form.needs) is None:
        raise InputError(
            file.source, f"is a file of {form.name}, which needs the package {form.needs}",
            f"pip install 'bayes-asv[{form.extra}]'",
        )  # fmt: skip
    patience = _PATIENCE + _PATIENCE_PER_BYTE * len(file.data)
    path = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH", "")]))
    environment = {
        **os.environ,
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",  # threads reserve address space
        "OPENBLAS_NUM_THREADS": "1",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
            input=pickle.dumps((form.name, file)),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            timeout=patience,
            check=False,
        )
    except subprocess.TimeoutExpired:
        what = f"takes the package {form.needs} more than {patience:.0f} s"
        raise InputError(file.source, what, _FIX) from None
    if done.returncode or not done.stdout:
        raise InputError(file.source, f"crashes the package {form.needs}", _FIX)
    result = pickle.loads(done.stdout)  # written by `serve`
    if isinstance(result, tuple):
        raise InputError(*result)
    log: Log = result
    for channel in log.channels:  # a pickle forgets that arrays are read-only
        channel.time.flags.writeable = False
        channel.values.flags.writeable = False
    return log


_FIX: Final = "it may be damaged; copy it from the logger again, or export it as CSV"


def serve() -> None:
    """Read the file that standard input holds, and write the log to standard output."""
    from bayes_asv.io.formats import FORMATS

    output = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # packages print
    with contextlib.suppress(ImportError):  # not on Windows
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    name, file = pickle.load(sys.stdin.buffer)
    form = next(one for one in FORMATS if one.name == name)
    result: Log | tuple[str, str, str]
    try:
        result = form.read(file)
    except InputError as exc:
        result = (exc.where, exc.what, exc.fix)
    with os.fdopen(output, "wb") as stream:
        pickle.dump(result, stream, protocol=pickle.HIGHEST_PROTOCOL)
        stream.flush()
    os._exit(0)  # packages may hang or crash when they are torn down
