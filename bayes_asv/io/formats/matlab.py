"""MATLAB ``.mat``: versions 5 to 7.2 by scipy, 7.3 by h5py.

The workspace is a tree of arrays and structures.  A channel is a vector of numbers, or a column of
a matrix, as long as a vector of time in the same structure or in one around it; a structure with
the fields ``Time`` and ``Value``, as MoTeC exports it, is one channel.  Where there is no vector of
time, a scalar ``fs``, ``rate``, ``dt`` or ``Ts`` gives the rate, or else the user does.
"""

from __future__ import annotations

import io
import re
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bayes_asv.domain.errors import InputError
from bayes_asv.io.formats.format import Format, LogBuilder, library, listed
from bayes_asv.io.formats.stamps import repair, time_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bayes_asv.domain.log import Log
    from bayes_asv.io.formats.format import LogFile

__all__ = ["FORMAT", "HDF5_FORMAT"]

Tree = dict[str, Any]  # names to arrays of numbers, texts and trees

_TIME: Final = re.compile(
    r"(?:time|t|tout|zeit|timestamps?|time_?vec(?:tor)?)(?:_?(s|ms|us))?", re.I
)
_RATE: Final = re.compile(
    r"(?:fs|f_s|rate|sample_?rate|sampling_?(?:rate|frequency))(?:_?hz)?", re.I
)
_STEP: Final = re.compile(r"(?:dt|ts|delta_?t|sample_?time)", re.I)
_UNIT: Final = frozenset({"unit", "units"})
_VALUE: Final = frozenset({"value", "values", "data"})
_MAX_DEPTH: Final = 6
_MAX_COLUMNS: Final = 64
_FEWEST: Final = 3  # readings; shorter vectors are parameters


def _recognises(head: bytes) -> bool:
    return head.startswith(b"MATLAB 5.0 MAT-file")


def _read(file: LogFile) -> Log:
    builder = LogBuilder(file, FORMAT.name)
    with library(file, FORMAT):
        scipy_io = import_module("scipy.io")
        sizes = scipy_io.whosmat(io.BytesIO(file.data))
        builder.reserve(sum(int(np.prod(shape, dtype=float)) for _, shape, _ in sizes))
        workspace = scipy_io.loadmat(
            io.BytesIO(file.data),
            squeeze_me=True,
            struct_as_record=False,
            verify_compressed_data_integrity=True,
        )
        tree = _tree({key: value for key, value in workspace.items() if key[:2] != "__"})
    return _log(builder, tree)


def _recognises_hdf5(head: bytes) -> bool:
    return head.startswith(b"MATLAB 7.3 MAT-file")


def _read_hdf5(file: LogFile) -> Log:
    builder = LogBuilder(file, HDF5_FORMAT.name)
    with library(file, HDF5_FORMAT):
        h5py = import_module("h5py")
        workspace = h5py.File(io.BytesIO(file.data), "r")
        tree = _hdf5_tree(workspace, h5py, builder)
    return _log(builder, tree)


def _tree(value: Any, depth: int = 0) -> Any:
    """Structures as dictionaries, other values as they are."""
    if depth > _MAX_DEPTH:
        return None
    if hasattr(value, "_fieldnames"):
        value = {name: getattr(value, name) for name in value._fieldnames}
    if isinstance(value, dict):
        return {str(key): _tree(one, depth + 1) for key, one in value.items()}
    if isinstance(value, np.ndarray) and value.dtype == object and value.size <= _MAX_COLUMNS:
        return {str(i + 1): _tree(one, depth + 1) for i, one in enumerate(value.flat)}
    return value


def _hdf5_tree(group: Any, h5py: Any, builder: LogBuilder, depth: int = 0) -> Tree:
    result: Tree = {}
    for name, item in group.items():
        if name.startswith("#") or depth > _MAX_DEPTH:
            continue
        if isinstance(item, h5py.Group):
            result[name] = _hdf5_tree(item, h5py, builder, depth + 1)
        elif item.dtype.kind in "iufb":
            builder.reserve(item.size)
            array = np.squeeze(item[()].T)
            kind = item.attrs.get("MATLAB_class", b"")
            if kind == b"char" and array.size < 1000:
                result[name] = "".join(map(chr, array.astype(int).flat))
            else:
                result[name] = array
    return result


def _log(builder: LogBuilder, tree: Tree) -> Log:
    left_out: list[str] = []
    _add(builder, tree, "", None, None, left_out)
    if not builder.has_channels:
        raise InputError(
            builder.file.source, f"has no vector of time for {listed(left_out) or 'any vector'}",
            "save a vector named time with it, or give the rate (--rate 400)",
        )  # fmt: skip
    if left_out:
        builder.warnings.append(
            f"vectors that are not as long as a vector of time were left out: {listed(left_out)}"
        )
    return builder.build()


def _add(
    builder: LogBuilder,
    tree: Tree,
    path: str,
    stamps: _Stamps | None,
    rate: float | None,
    left_out: list[str],
) -> None:
    """Add the vectors of a structure; `stamps` and `rate` are those of the structure around it."""
    time = next((name for name in tree if _TIME.fullmatch(name) and _is_vector(tree[name])), None)
    if time is not None:
        stamps = _repaired(builder, tree[time], time, path)
    rate = _rate(tree) or rate or builder.file.rate
    unit = next((one for key, one in tree.items() if key.lower() in _UNIT and type(one) is str), "")
    parent, _, own = path.rstrip("/").rpartition("/")
    for name, value in tree.items():
        if isinstance(value, dict):
            _add(builder, value, f"{path}{name}/", stamps, rate, left_out)
            continue
        if name == time or not isinstance(value, np.ndarray) or value.dtype.kind not in "iufb":
            continue
        is_channel = name.lower() in _VALUE and bool(own)
        label, source = (own, parent) if is_channel else (name, path.rstrip("/"))
        for title, column in _columns(label, value):
            if column.size < _FEWEST:
                continue
            if stamps is not None and column.size == stamps.length:
                builder.add(title, unit, stamps.time, column[stamps.rows], source)
            elif rate:
                builder.add_uniform(title, unit, rate, column, source)
            else:
                left_out.append(title)


class _Stamps(NamedTuple):
    time: NDArray[np.float64]
    rows: NDArray[np.intp]
    length: int  # of the vectors that belong to it, before rows were left out


def _repaired(builder: LogBuilder, stamps: NDArray[Any], name: str, path: str) -> _Stamps:
    match = _TIME.fullmatch(name)
    factor = time_factor(match[1]) if match and match[1] else 1.0
    where = f"{builder.file.source}: {path}{name}"
    repaired = repair(stamps.astype(np.float64), factor, where)
    builder.warnings += repaired.warnings
    return _Stamps(repaired.time, repaired.rows, stamps.size)


def _columns(name: str, value: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    if value.ndim == 1:
        return [(name, value)]
    if value.ndim != 2 or min(value.shape) > _MAX_COLUMNS:
        return []
    table = value if value.shape[0] >= value.shape[1] else value.T
    return [(f"{name}[{one + 1}]", table[:, one]) for one in range(table.shape[1])]


def _is_vector(value: Any) -> bool:
    return (
        isinstance(value, np.ndarray)
        and value.ndim == 1
        and value.size >= _FEWEST
        and value.dtype.kind in "iuf"
    )


def _rate(tree: Tree) -> float | None:
    for name, value in tree.items():
        number = np.asarray(value)
        if number.size == 1 and number.dtype.kind in "iuf" and 0 < float(number.flat[0]) < 1e9:
            if _RATE.fullmatch(name):
                return float(number.flat[0])
            if _STEP.fullmatch(name):
                return 1.0 / float(number.flat[0])
    return None


FORMAT = Format("MATLAB .mat", (".mat",), _recognises, _read, "scipy")
HDF5_FORMAT = Format("MATLAB 7.3 .mat", (".mat",), _recognises_hdf5, _read_hdf5, "h5py")
