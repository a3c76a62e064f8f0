"""``asv.fleet``: every recording of a season by itself, and the trend of every damper."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bayes_asv import __version__
from bayes_asv.batch.dates import date_of_metadata
from bayes_asv.batch.index import AnswerIndex, key_of
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, check_writable, write_atomically
from bayes_asv.library.estimates import check_seed
from bayes_asv.library.extras import import_extra
from bayes_asv.library.inputs import check_car, check_vehicle
from bayes_asv.library.progress import Progress, Report, progress_bar
from bayes_asv.library.recordings import expanded
from bayes_asv.library.result import DocumentResult, html_table, json_text
from bayes_asv.report.words import plain

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.batch.workers import TaskFailedError
    from bayes_asv.domain.vehicle import Vehicle
    from bayes_asv.report.documents.fleet import SeasonFile
    from bayes_asv.report.schema.fleet import FleetDocument, FleetFile, FleetTrend

__all__ = ["Fleet", "fleet"]

_SUFFIXES: Final = (".parquet", ".csv")
_MODULES: Final = (
    "bayes_asv.posterior.sampler", "bayes_asv.report.documents.estimate", "bayes_asv.library.fleet",
)  # fmt: skip


class Fleet(DocumentResult):
    """A season of recordings, from :func:`bayes_asv.fleet`.

    ``result["c_f"]`` is the trend of the front damping rate, ``result.files`` says what came of
    each recording.  ``verdict`` is ``"refused"`` if no recording has a verdict on the dampers.
    """

    document: FleetDocument

    def __init__(self, document: FleetDocument, folder: Path):
        super().__init__(document)
        self.folder = folder

    @property
    def files(self) -> list[FleetFile]:
        """Recordings in order of their dates, each with its verdict and parameters."""
        return self.document.files

    @property
    def trends(self) -> dict[str, FleetTrend]:
        """Trends by the name of the damping rate."""
        return self.document.trends

    def __getitem__(self, name: str) -> FleetTrend:
        if name not in self.trends:
            why = "; ".join(self.reasons) or f"there are {', '.join(self.trends) or 'none'}"
            raise KeyError(f"there is no trend of {name}: {why}")
        return self.trends[name]

    def __contains__(self, name: object) -> bool:
        return name in self.trends

    def __iter__(self) -> Iterator[str]:
        return iter(self.trends)

    def answer(self, file: FleetFile) -> Path:
        """Return the path of the JSON of a recording's estimate, which ``report --from`` reads."""
        return self.folder / "answers" / file.answer

    def summary(self) -> pd.DataFrame:
        """Return the table that is written to the output, one row a recording."""
        pandas = import_extra("pandas", "summary()")
        frame = pandas.DataFrame(_columns(self.document))
        frame["date"] = pandas.to_datetime(frame["date"])
        return frame

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, schema ``bayes_asv/fleet/1``."""
        return self.document.to_dict()

    def lines(self) -> list[str]:
        """State the result in sentences, as the command line prints them."""
        from bayes_asv.report.sections.fleet import fleet_lines

        return fleet_lines(self.document)

    def __repr__(self) -> str:
        counts = ", ".join(f"{n} {verdict}" for verdict, n in self.document.counts.items())
        about = ", ".join(f"{name} {trend.kind}" for name, trend in self.trends.items())
        return f"<Fleet {self.verdict!r}: {counts}; {about or 'no trends'}>"

    def _repr_html_(self) -> str:
        from bayes_asv.report.sections.fleet import file_rows

        first, *others = self.lines()
        head, rows = file_rows(self.document)
        return html_table(first, head, rows, others)


class _Task(NamedTuple):
    """One recording that is to be estimated."""

    path: str
    sha256: str
    key: str
    vehicle: Vehicle
    options: Mapping[str, Any]


def fleet(
    recordings: PathLike | Iterable[PathLike],
    vehicle: Vehicle,
    *,
    output: PathLike,
    car: str | None = None,
    below: float | None = None,
    rate: float | None = None,
    seed: int = 0,
    jobs: int | None = None,
    dask: str | None = None,
    progress: Progress = None,
) -> Fleet:
    """Estimate every recording of a season by itself, and find the trend of every damper.

    Answers are kept in a folder beside the output, by the hashes of recording, vehicle, options
    and version of the package.  A run that was interrupted, or one with more recordings, does only
    what is not there yet.

    Parameters
    ----------
    recordings : str, os.PathLike or iterable of them
        Files, or patterns such as ``"season/**/*.csv"``.
    vehicle : Vehicle
        The car, with the channel map of its logger if it needs one.
    output : str or os.PathLike
        Table with one row a recording, ``.parquet`` or ``.csv``; the page is written beside it as
        ``.html``, and the answers are kept in a folder ``.fleet``.
    car : {'half', 'quarter-front', 'quarter-rear', 'roll'}, optional
        Model of the car, as for :func:`bayes_asv.estimate`.
    below : float, optional
        Use only the motion below this frequency, Hz.
    rate : float, optional
        Sampling rate, Hz, of recordings without time stamps.
    seed : int
        The same seed gives the same answer.
    jobs : int, optional
        Number of processes; by default one a processor.
    dask : str, optional
        Address of the scheduler of a Dask cluster, which is used instead of processes.
    progress : bool or callable, optional
        As for :func:`bayes_asv.estimate`.

    Returns
    -------
    Fleet
        A recording that cannot be read or estimated has a verdict that says so, and does not stop
        the others.

    Raises
    ------
    TypeError
        If the vehicle is none.
    InputError
        If a pattern fits no file, an option does not fit, or the output cannot be written.
    """
    from bayes_asv.report.documents.fleet import fleet_document

    began = time.perf_counter()
    given = check_vehicle("fleet", vehicle, "write asv.fleet('season/*.csv', vehicle, output=…)")
    check_car(car)
    check_seed(seed)
    if jobs is not None and jobs < 1:
        raise InputError(f"jobs={jobs}", "is no number of processes", "give 1 or more")
    target = _checked_output(output)
    options = {"car": car, "below": below, "rate": rate, "seed": seed}
    paths = _paths(recordings)
    folder = target.with_suffix(".fleet")
    with progress_bar(progress) as report, AnswerIndex(folder) as index:
        files = list(_hashed(paths, given, options))
        extracts, tasks = _known(files, index, given, options)
        failures = _estimate_all(tasks, index, extracts, len(files), jobs, dask, report)
        document = fleet_document(files, extracts, failures, given, seed)
    document = document.model_copy(update={"seconds": time.perf_counter() - began})
    found = Fleet(document, folder)
    _write_table(document, target)
    found.report(target.with_suffix(".html"))
    return found


def _checked_output(output: PathLike) -> Path:
    target = Path(output)
    if target.suffix.lower() not in _SUFFIXES:
        raise InputError(
            os.fspath(output), "a table is Parquet or CSV", "end the name in .parquet or .csv"
        )
    if target.suffix.lower() == ".parquet":
        import_extra("pyarrow", "a Parquet table", extra="fleet")
    for path in (target, target.with_suffix(".html")):
        check_writable(path)
    return target


def _paths(recordings: PathLike | Iterable[PathLike]) -> list[str]:
    patterns = [recordings] if isinstance(recordings, str | os.PathLike) else list(recordings)
    found = [os.fspath(path) for pattern in patterns for path in expanded(pattern)]
    found = [path for path in dict.fromkeys(found) if not os.path.isdir(path)]
    if not found:
        raise InputError("fleet", "no recording was given", "give at least one")
    return found


def _hashed(
    paths: Sequence[str], vehicle: Vehicle, options: Mapping[str, Any]
) -> Iterator[SeasonFile]:
    """Hash the files, and all that their answers depend on."""
    from bayes_asv.report.documents.fleet import SeasonFile

    about = (_vehicle_text(vehicle), json.dumps(options, sort_keys=True), __version__)
    for path in paths:
        try:
            with open(path, "rb") as file:
                sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            yield SeasonFile(path, "", "", f"cannot be read ({error.strerror})")
            continue
        # the suffix decides how some formats are read
        yield SeasonFile(path, sha256, key_of((sha256, Path(path).suffix, *about)))


def _vehicle_text(vehicle: Vehicle) -> str:
    """Write what a vehicle holds, without the names of its files."""
    mapped = vehicle.channel_map
    values = {f.name: getattr(vehicle, f.name) for f in fields(vehicle)}
    values["channel_map"] = None if mapped is None else repr(replace(mapped, source=""))
    return repr({k: v for k, v in values.items() if k not in ("source", "sha256")})


def _known(
    files: Sequence[SeasonFile], index: AnswerIndex, vehicle: Vehicle, options: Mapping[str, Any]
) -> tuple[dict[str, dict[str, Any]], list[_Task]]:
    """Find the answers that are there, and what is to be done for the others."""

    def extract(path: Path) -> dict[str, Any] | None:
        from pydantic import ValidationError

        from bayes_asv.report.documents.fleet import season_extract
        from bayes_asv.report.schema.fleet import FleetAnswer

        try:
            answer = FleetAnswer.model_validate(json.loads(path.read_bytes()))
        except (ValueError, ValidationError):
            return None  # not an answer any more: it is made again
        return season_extract(answer, answer.recorded, vehicle)

    extracts: dict[str, dict[str, Any]] = {}
    tasks: dict[str, _Task] = {}
    for file in files:
        if not file.key or file.key in extracts or file.key in tasks:
            continue
        found = index.get(file.key, extract)
        if found is None:
            tasks[file.key] = _Task(file.path, file.sha256, file.key, vehicle, options)
        else:
            extracts[file.key] = found
    return extracts, list(tasks.values())


def _estimate_all(
    tasks: Sequence[_Task],
    index: AnswerIndex,
    extracts: dict[str, dict[str, Any]],
    count: int,
    jobs: int | None,
    dask: str | None,
    report: Report | None,
) -> dict[str, str]:
    """Do the tasks, keep their answers, and return the reasons of failures, which are not kept."""
    failures: dict[str, str] = {}
    if not tasks:
        return failures
    from bayes_asv.batch.workers import DaskCluster, LocalProcesses, run_tasks

    left = len(tasks)

    def tell(name: str) -> None:
        if report is not None:
            done = count - left
            report(done / count, f"{done} of {count} recordings: {name}")

    def finished(task: _Task, result: _Answer | TaskFailedError) -> None:
        nonlocal left
        left -= 1
        if isinstance(result, _Answer):
            index.put(task.key, result.answer, result.extract)
            extracts[task.key] = result.extract
        else:
            failures[task.key] = str(result)
        tell(plain(Path(task.path).name))

    tell("starting processes")
    workers = LocalProcesses(jobs, _MODULES) if dask is None else DaskCluster(dask)
    run_tasks(workers, _estimate_file, tasks, finished)
    return failures


class _Answer(NamedTuple):
    """What a process returns: the JSON of the estimate if there is one, and its extract."""

    answer: bytes | None
    extract: dict[str, Any]


def _estimate_file(task: _Task) -> _Answer:
    """Estimate one recording; runs in another process."""
    from bayes_asv.library.estimates import estimate
    from bayes_asv.library.recordings import read_recording
    from bayes_asv.report.documents.fleet import season_extract

    options = task.options
    try:
        run = read_recording(task.path, rate=options["rate"], channels=task.vehicle.channel_map)
        if run.sha256 not in ("", task.sha256):
            raise RuntimeError("the file was changed while it was read")
        result = estimate(
            run, task.vehicle, below=options["below"], car=options["car"], seed=options["seed"],
            progress=False,
        )  # fmt: skip
    except InputError as error:
        reason = str(error).replace(task.path, Path(task.path).name)
        return _Answer(None, {"verdict": "unreadable", "reason": reason})
    date = date_of_metadata(run.metadata)
    recorded = "" if date is None else date.isoformat(timespec="seconds")
    data = {**result.document.to_dict(), "recorded": recorded}
    extract = season_extract(result.document, recorded, task.vehicle)
    return _Answer(json_text(data).encode("utf-8", "replace"), extract)


def _columns(document: FleetDocument) -> dict[str, list[Any]]:
    """Columns of the table of recordings; a parameter has its mean, sd and 95 % interval."""
    files = document.files
    columns: dict[str, list[Any]] = {
        key: [getattr(file, key) for file in files]
        for key in ("file", "date", "date_from", "verdict", "reason")
    }
    for name in dict.fromkeys(name for file in files for name in file.parameters):
        values = [file.parameters.get(name) for file in files]
        columns[f"{name}_mean"] = [v and v.mean for v in values]
        columns[f"{name}_sd"] = [v and v.sd for v in values]
        columns[f"{name}_low"] = [v and v.eti95[0] for v in values]
        columns[f"{name}_high"] = [v and v.eti95[1] for v in values]
    columns["answer"] = [file.answer for file in files]
    columns["sha256"] = [file.sha256 for file in files]
    return columns


def _spreadsheet_safe(cell: object) -> object:
    """Put an apostrophe before a text that a spreadsheet would compute: file names are foreign."""
    formula = isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r"))
    return f"'{cell}" if formula else cell


def _write_table(document: FleetDocument, target: Path) -> None:
    """Write one row a recording, Parquet or CSV."""
    columns = _columns(document)
    if target.suffix.lower() == ".csv":
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        rows = zip(*columns.values(), strict=True)
        writer.writerows([_spreadsheet_safe(cell) for cell in row] for row in rows)
        write_atomically(target, text.getvalue().encode("utf-8", "replace"))
        return
    import pyarrow
    from pyarrow import parquet

    columns["date"] = [datetime.fromisoformat(text) for text in columns["date"]]
    buffer = io.BytesIO()
    numbers = {
        name: pyarrow.array(values, pyarrow.float64())
        if name.endswith(("_mean", "_sd", "_low", "_high"))
        else pyarrow.array(values)
        for name, values in columns.items()
    }
    units = {f"unit of {name}": trend.unit for name, trend in document.trends.items()}
    table = pyarrow.table(numbers).replace_schema_metadata(units)
    parquet.write_table(table, buffer)
    write_atomically(target, buffer.getvalue())
