"""An attack on every file format and on whole commands: mutated inputs, kills, shortages.

Mutated inputs go to every reader in this process: each has to return or to raise an `InputError` of
one printable line, without a warning, within seconds of processor time and a bounded memory.

Whole commands are killed at random instants, interrupted, and run without space, memory, streams or
a cache: outputs are whole and old or whole and new, nothing is left beside them, and what is said
is one line.

``make attack`` writes ``benchmarks/results/attack.json`` and ``docs/attack.md``; the tests run it
in short.  The same seed makes the same inputs; where a kill strikes depends on the clock.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import math
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import click

from bayes_asv.acquire.acquisition import outcome_document, replay_file
from bayes_asv.cli import cli
from bayes_asv.domain.channel_map import read_channel_map
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import accelerations, require_half_car
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.io import read_log, read_recording
from bayes_asv.library.logs import inspect_log
from bayes_asv.live.text_stream import TextStreamReader
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.reference.modes_document import spectrum_document
from bayes_asv.report.render import html_report
from bayes_asv.report.schema import read_saved
from bayes_asv.tracking.track import track
from bayes_asv.tracking.tracker import Tracker, tracker_for
from benchmarks.provenance import current_commit
from benchmarks.strikes import (
    CAR,
    RECORDINGS,
    run_command,
    strike_commands,
    strike_seasons,
    strike_transfers,
)
from tests.acquire.synthetic import SyntheticBlock, counts, stream
from tests.io.formats import made

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results" / "attack.json"
PAGE = ROOT / "docs" / "attack.md"

SEED = 20
SECONDS_AN_INPUT = 10.0
MEMORY = 1 << 30
"""Bytes of address space that an input may take beyond what the process has."""
SECONDS_TO_END = 1.0
"""After Ctrl-C or SIGTERM, on a machine that does nothing else."""

TOKENS = (
    b"", b"\n", b"\0", b",", b";", b"\t", b'"', b"#", b"=", b"[", b"]", b"{", b"}", b"nan", b"inf",
    b"-", b"1e308", b"-1e12", b"1e-308", b"99999999999999999999", b"1_0", b"\xd9\xa3", b"\xff",
    b"\xe2\x80\xae", b"\x1b[2J", b"\r", b"\x0c", b"0", b"%", b"<script>", b"=1+1", b"true",
    b"# sample_rate = 1e-2 Hz", b"# clock rear = 1e5 ppm", b"# delay front_wheel = 1 s",
)  # fmt: skip
NUMBERS = (0.0, -1.0, 1.0, 0.5, 1e-30, 1e-9, 1e6, 1e9, -1e9, 1e15, -1e15, 1e300)


def mutate(data: bytes, chance: random.Random) -> bytes:
    """Change a file that was right in one to four places: bytes, numbers, lines, its end."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        reach = min(len(data), chance.choice((400, len(data) + 1)))
        at = chance.randrange(reach + 1)
        end = min(len(data), at + chance.randrange(40))
        piece = chance.choice(TOKENS) if chance.random() < 0.7 else chance.randbytes(4)
        kind = chance.choice(("flip", "flip", "number", "number", "cut", "drop", "put", "line"))
        if kind == "flip" and at < len(data):
            data = data[:at] + bytes([data[at] ^ (1 << chance.randrange(8))]) + data[at + 1 :]
        elif kind == "number":
            data = _another_number(data, at, chance)
        elif kind == "cut" and chance.random() < 0.3:
            data = data[:at]
        elif kind == "drop":
            data = data[:at] + data[end:]
        elif kind == "put":
            data = data[:at] + piece + data[end if chance.random() < 0.5 else at :]
        elif kind == "line":
            lines = data.split(b"\n")
            one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
            lines.insert(other, lines[one] if chance.random() < 0.5 else lines.pop(one))
            data = b"\n".join(lines)
    return data


def _another_number(data: bytes, at: int, chance: random.Random) -> bytes:
    """Replace the number at or behind a place by another one."""
    digits = b"0123456789+-.eE"
    while at < len(data) and data[at] not in digits:
        at += 1
    end = at
    while end < len(data) and data[end] in digits:
        end += 1
    return data[:at] + f"{chance.choice(NUMBERS):.12g}".encode() + data[end:]


def mutate_document(document: Any, chance: random.Random) -> Any:
    """Change one to three values of a JSON document, most often by others of their type."""
    document = copy.deepcopy(document)
    for _ in range(chance.choice((1, 1, 2, 3))):
        holder, key = document, None
        while True:
            inside = holder[key] if key is not None else holder
            if not isinstance(inside, dict | list) or not inside:
                break
            if key is not None and chance.random() < 0.1:
                break
            holder = inside
            key = chance.choice(list(inside)) if isinstance(inside, dict) else (
                chance.randrange(len(inside))
            )  # fmt: skip
        if key is not None:
            holder[key] = _another_value(holder[key], chance)
    return document


def _another_value(value: Any, chance: random.Random) -> Any:
    if chance.random() < 0.15:
        return chance.choice((None, True, -1, "", "x", [], {}, [1.0, 2.0], "\x1b[2J<b>"))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return chance.choice((0, 1, -value, 10**6, 10**12))
    if isinstance(value, float):
        return chance.choice((*NUMBERS, -value, 1e6 * value, 1e-6 * value))
    if isinstance(value, str):
        return chance.choice(("", value + "x", 9999 * "x", "<script>", "=1+1", "\u202e\x1b[2J"))
    if isinstance(value, list):
        n = len(value)
        return chance.choice((value[:1], 2 * value, value[::-1], n * [None], n * [0.0], n * [1e15]))
    left = list(value or [""])
    left.remove(chance.choice(left))
    return {key: value[key] for key in left}


class Target(NamedTuple):
    """A reader under attack.

    Parameters
    ----------
    seeds : tuple
        Files that are right, as bytes, or documents.
    read : callable
        From a path.
    weight : float
        Share of the inputs, before all are divided by their sum.
    seconds : float, optional
        Longest time of an input where it is not `SECONDS_AN_INPUT`: up to 30 pictures are drawn.
    """

    seeds: tuple[Any, ...]
    read: Callable[[Path], object]
    weight: float = 1.0
    seconds: float | None = None


_STOPS = str(RECORDINGS / "stops-400hz.csv")
_CALLS = (
    {
        "command": "simulate",
        "words": [],
        "options": {
            "-v": str(CAR), "-o": "drive.csv", "--road": "stops", "--rate": 400.0,
            "--seconds": 2.5, "--speed": "8 mph", "--set": "c_r=0.8", "--seed": 3,
            "--channels": "front_wheel,rear_wheel,front_travel",
        },
    },
    {"command": "modes", "words": [_STOPS], "options": {"-v": str(CAR), "--rate": 400.0}},
    {
        "command": "track",
        "words": [_STOPS],
        "options": {"-v": str(CAR), "--with": "bound_rebound@rear", "--forget": 10.0, "--seed": 3},
    },
    {
        "command": "watch",
        "words": [_STOPS],
        "options": {"-v": str(CAR), "--below": 80.0, "--sure": 99.0, "--hold": 1.0},
    },
    {"command": "inspect", "words": [_STOPS], "options": {"--rate": 400.0}},
)  # fmt: skip


def targets(folder: Path) -> dict[str, Target]:
    """All readers with their seeds; what has to be computed for them is made in a folder."""
    car = read_vehicle(CAR)
    short = _lines(RECORDINGS / "stops-400hz.csv", 60)
    long = _lines(RECORDINGS / "stops-400hz.csv", 900)
    raw = stream(SyntheticBlock(1, counts(1, 60)), SyntheticBlock(2, counts(2, 60)))
    dump = b"# sample_rate = 400 Hz\n" + b"".join(
        b"%d %d 641 581 636\n" % (n, 570 + n % 7) for n in range(1, 60)
    )
    checkpoint = folder / "tracker"
    run = read_recording(RECORDINGS / "stops-400hz.csv")
    tracker = tracker_for(run, car)
    tracker.feed(run.time[:300], _si(run, car)[:300])
    tracker.save(checkpoint)
    data = ROOT / "tests" / "report" / "data"
    names = ("us", "si", "two_runs", "refused", "diagnosis")
    documents = [json.loads((data / f"{name}.json").read_text("utf-8")) for name in names]
    documents.append(_tracked(run, car))
    proposed = (
        b'rate = "400 Hz"\n[channels.front_wheel]\ncolumn = "a"\nunit = "g"\noffset = 1.008\n'
        b'[channels.rear_wheel]\ncolumn = ["x", "y", "z"]\naxis = [0.4, 0.0, -0.9]\nunit = "g"\n'
        b'delay = "8 ms"\nsign = -1\n'
    )
    foreign = tuple(made.texts().values())

    def prepared(path: Path) -> None:
        recording = read_recording(path)
        require_half_car(recording)
        prepare_runs([recording], car)
        with contextlib.suppress(InputError):
            spectrum_document(recording, car)
        track(recording, car)

    def inspected(path: Path) -> None:
        found = inspect_log(path)
        found.lines()
        found.channel_map.recording(found.log)

    def called(path: Path) -> None:
        asked = json.loads(path.read_text("utf-8"))
        words = asked.get("words")
        words = [str(asked.get("command")), *map(str, words if isinstance(words, list) else ())]
        options = asked.get("options")
        for name, value in options.items() if isinstance(options, dict) else ():
            words += [str(name), str(value)]
        said = io.StringIO()
        with contextlib.chdir(folder), contextlib.redirect_stdout(said):
            try:
                cli.main(words, standalone_mode=False, prog_name="bayes-asv")
            except click.ClickException as error:  # the program shows its text on one line
                raise InputError("options", " ".join(error.format_message().split())) from None

    def replayed(path: Path) -> None:
        outcome_document(replay_file(path), "run.csv", "run.raw")

    def streamed(path: Path) -> None:
        reader, whole = TextStreamReader("port"), path.read_bytes()
        for at in range(0, len(whole), 97):
            reader.feed(whole[at : at + 97])
        reader.finish()

    def restored(path: Path) -> None:
        Tracker.restore(path, car)

    def reported(path: Path) -> None:
        html_report(read_saved(path))

    sampled = RECORDINGS.joinpath("stops-800hz.csv").read_bytes()[:4000]
    cars = (CAR.read_bytes(), CAR.with_name("baja2008_roll.toml").read_bytes())
    saved = tuple(documents)
    return {
        "recording (CSV)": Target((short, sampled), read_recording, 6.0),
        "recording (logger text)": Target((dump,), read_recording, 4.0),
        "logs of other loggers": Target(foreign, read_log, 2.0),
        "logs of other loggers, inspected": Target(foreign, inspected, 1.0),
        "options of commands": Target(_CALLS, called, 0.1, 60.0),
        "vehicle file": Target(cars, read_vehicle, 6.0),
        "channel map": Target((proposed,), read_channel_map, 4.0),
        "saved documents": Target(saved, read_saved, 3.0),
        "saved tracker": Target((checkpoint.read_bytes(),), restored, 0.5),
        "bytes of the logger": Target((raw, dump + b"# end\n"), replayed, 4.0),
        "text from a port": Target((short, dump), streamed, 4.0),
        "recording, prepared and tracked": Target((long,), prepared, 0.1),
        "saved documents, as a report": Target(saved, reported, 0.02, 60.0),
    }


def _lines(path: Path, rows: int) -> bytes:
    return b"\n".join(path.read_bytes().split(b"\n")[: rows + 3]) + b"\n"


def _si(recording: Any, car: Vehicle) -> Any:
    return accelerations(recording, car).T


def _tracked(recording: Any, car: Vehicle) -> Any:
    import bayes_asv as asv

    return json.loads(json.dumps(asv.track(recording, car).document.to_dict()))


class TooSlow(BaseException):
    """An input took more processor time than `SECONDS_AN_INPUT`."""


@contextlib.contextmanager
def bounds() -> Iterator[None]:
    """Bound the address space of this process, and make warnings and slowness exceptions."""

    def late(number: int, frame: FrameType | None) -> None:
        raise TooSlow

    old = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY, old[1]))
    handler = signal.signal(signal.SIGPROF, late)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)
        resource.setrlimit(resource.RLIMIT_AS, old)


def attack_readers(
    inputs: int, seconds: float, seed: int, faults: Path | None = None
) -> dict[str, Any]:
    """Read mutated inputs in this process.

    Parameters
    ----------
    inputs : int
        Number of inputs over all targets.
    seconds : float
        When to stop in any case.
    seed : int
        The same seed makes the same inputs.
    faults : Path, optional
        Folder for the inputs of the faults.

    Returns
    -------
    dict
        Inputs, accepted inputs, slowest input and faults of each target.
    """
    out: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        all_targets = targets(folder)
        for target in all_targets.values():  # what is compiled or imported first is not theirs
            for whole in target.seeds:
                with contextlib.suppress(InputError):
                    target.read(_written(folder / "seed", whole))
        total = sum(target.weight for target in all_targets.values())
        begin = time.monotonic()
        with bounds():
            for title, target in all_targets.items():
                share = target.weight / total
                left = seconds - (time.monotonic() - begin)
                out[title] = _attack_one(
                    title, target, math.ceil(share * inputs), left, seed, folder, faults
                )
                print(f"{title}: {out[title]['inputs']} inputs", file=sys.stderr, flush=True)
    return out


def _attack_one(
    title: str, target: Target, inputs: int, seconds: float, seed: int, folder: Path,
    faults: Path | None,
) -> dict[str, Any]:  # fmt: skip
    chance = random.Random(f"{seed} {title}")
    found: dict[str, dict[str, Any]] = {}
    accepted, slowest, done, end = 0, 0.0, 0, time.monotonic() + seconds
    path = folder / "input"
    while done < inputs and (done == 0 or time.monotonic() < end):
        done += 1
        whole = chance.choice(target.seeds)
        if isinstance(whole, bytes):
            changed: Any = mutate(whole, chance)
        else:
            changed = mutate_document(whole, chance)
        data = _written(path, changed).read_bytes()
        begin = time.process_time()  # other processes do not make an input slow
        signal.setitimer(signal.ITIMER_PROF, target.seconds or SECONDS_AN_INPUT)
        try:
            target.read(path)
            accepted += 1
        except InputError as fault:
            text = str(fault)
            if not (text.isprintable() and len(text) < 1500):
                _note(found, "a message of more than one printable line", data, faults)
        except (Exception, TooSlow) as fault:
            where = traceback.extract_tb(fault.__traceback__)
            own = [frame for frame in where if "bayes_asv" in frame.filename] or where[-1:]
            place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
            _note(found, f"{type(fault).__name__} in {place}: {str(fault)[:100]}", data, faults)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        slowest = max(slowest, time.process_time() - begin)
    return {
        "inputs": done, "accepted": accepted, "slowest_seconds": round(slowest, 2),
        "faults": found,
    }  # fmt: skip


def _written(path: Path, content: Any) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return path


def _note(
    found: dict[str, dict[str, Any]], what: str, data: bytes, faults: Path | None
) -> None:  # fmt: skip
    entry = found.setdefault(what, {"count": 0, "bytes": len(data)})
    entry["count"] += 1
    if faults is not None and entry["count"] == 1:
        faults.mkdir(parents=True, exist_ok=True)
        (faults / f"{abs(hash(what)):x}.input").write_bytes(data)


class Scarcity(NamedTuple):
    """A shortage, the command that has it, and what it has to end with."""

    words: tuple[str, ...]
    status: tuple[int, ...]
    options: dict[str, Any]


def scarcities() -> dict[str, Scarcity]:
    """Shortages of streams, memory and characters, by name."""
    modes = ("modes", str(RECORDINGS / "stops-400hz.csv"), "-v", str(CAR))

    def closed(number: int) -> Callable[[], None]:
        return lambda: os.close(number)

    def full() -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)

    def limited(kind: int, amount: int) -> Callable[[], None]:
        return lambda: resource.setrlimit(kind, (amount, amount))

    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    return {
        "standard output closed": Scarcity(modes, (2,), {"preexec_fn": closed(1)}),
        "standard input closed": Scarcity(modes, (0,), {"preexec_fn": closed(0)}),
        "disk of standard output full": Scarcity(modes, (2,), {"preexec_fn": full}),
        "no file may be written": Scarcity(
            (*modes, "--json", "out.json"), (2,),
            {"preexec_fn": limited(resource.RLIMIT_FSIZE, 100)},
        ),
        "C locale": Scarcity(modes, (0,), {"more": plain}),
        "no terminal": Scarcity(
            modes, (0,), {"start_new_session": True, "stdin": subprocess.DEVNULL}
        ),
        "1 GB of address space": Scarcity(
            ("estimate", str(RECORDINGS / "stops-400hz.csv"), "-v", str(CAR)), (0, 2),
            {"preexec_fn": limited(resource.RLIMIT_AS, 1 << 30)},
        ),
    }  # fmt: skip


def attack_resources(names: Iterable[str] | None = None) -> dict[str, Any]:
    """Run commands short of something, all or some; return status and faults of each."""
    out = {}
    every = scarcities()
    for name in every if names is None else names:
        words, expected, options = every[name]
        with tempfile.TemporaryDirectory() as folder:
            process = run_command(words, Path(folder), **options)
            _, err = process.communicate()
            lines = [line for line in err.decode("utf-8", "replace").splitlines() if line]
            faults = []
            if process.returncode not in expected:
                faults.append(f"status {process.returncode}: {lines[-1:]}")
            if len(lines) > 1:
                faults.append(f"{len(lines)} lines on standard error")
            left = [p.name for p in Path(folder).iterdir()]
            if left and process.returncode:
                faults.append(f"left {left[0]} behind")
            out[name] = {"status": process.returncode, "faults": faults}
    return out


def attack_cold_cache() -> dict[str, Any]:
    """Run two processes at once that find nothing compiled; both have to give the same answer."""
    words = ("track", str(RECORDINGS / "stops-400hz.csv"), "-v", str(CAR))
    with tempfile.TemporaryDirectory() as folder:
        more = {"NUMBA_CACHE_DIR": folder}
        both = [run_command(words, Path(folder), more=more) for _ in range(2)]
        said = [(*process.communicate(), process.returncode) for process in both]
    faults = [] if said[0] == said[1] else ["the answers differ"]
    faults += [f"status {status}: {err[-200:]!r}" for _, err, status in said if status or err]
    return {"status": said[0][2], "faults": faults}


_STRUCK = ("commands", "seasons", "transfers")


def page(result: dict[str, Any]) -> str:
    """Return the page of the documentation."""
    readers, commands = result["readers"], result["commands"]
    total = sum(one["inputs"] for one in readers.values())
    rows = [
        f"| {name} | {one['inputs']:,} | {one['accepted']:,} | {one['slowest_seconds']:.2f} s "
        f"| {sum(f['count'] for f in one['faults'].values())} |"
        for name, one in readers.items()
    ]
    strikes = ", ".join(f"{count} × {name}" for name, count in commands["strikes"].items())
    short = [
        f"| {name} | {one['status']} | {'; '.join(one['faults']) or 'none'} |"
        for name, one in result["resources"].items()
    ]
    faults = [
        f"- {name}: {' '.join(what.split())} ({fault['count']} inputs)"
        for name, one in readers.items()
        for what, fault in one["faults"].items()
    ] + [
        f"- {what} ({count} times)"
        for struck in _STRUCK
        for what, count in result[struck]["faults"].items()
    ]
    text = (ROOT / "benchmarks" / "attack_page.md.in").read_text(encoding="utf-8")
    origins = {
        f"of_{name}": f"commit {part['commit']:.7}, seed {part['seed']}"
        for name, part in result["parts"].items()
    }
    return text.format(
        total=f"{total:,}", **origins, readers="\n".join(rows), strikes=strikes,
        longest=f"{commands['longest_seconds_to_end']:.2f}", seasons=result["seasons"],
        transfers=result["transfers"], resources="\n".join(short),
        faults="\n".join(faults) or "None.", seconds=f"{SECONDS_AN_INPUT:g}",
    )  # fmt: skip


def main() -> int:
    """Attack, and write the results and the page after each part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--strikes", type=int, default=150)
    parser.add_argument("--minutes", type=float, default=30.0, help="of each part at most")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--faults", type=Path, help="folder for the inputs that are faults")
    parser.add_argument("--parts", help="some of them: readers,resources; the others stay")
    arguments = parser.parse_args()
    seconds, seed, strikes = 60.0 * arguments.minutes, arguments.seed, arguments.strikes
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "readers": lambda: attack_readers(arguments.inputs, seconds, seed, arguments.faults),
        "resources": lambda: {
            **attack_resources(), "two processes, cold cache": attack_cold_cache(),
        },
        "commands": lambda: strike_commands(strikes, seconds, seed),
        "seasons": lambda: strike_seasons(strikes // 2, seconds, seed),
        "transfers": lambda: strike_transfers(strikes // 2, seconds, seed),
    }  # fmt: skip
    result: dict[str, Any] = {"parts": {}}
    if RESULTS.exists():
        result = json.loads(RESULTS.read_text(encoding="utf-8"))
    for name in arguments.parts.split(",") if arguments.parts else parts:
        commit = current_commit() or "unknown"
        result[name] = parts[name]()
        result["parts"][name] = {"commit": commit, "seed": seed}
        RESULTS.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(result), encoding="utf-8")
    faults = sum(len(one["faults"]) for one in result["readers"].values())
    faults += sum(len(one["faults"]) for one in result["resources"].values())
    faults += sum(len(result[struck]["faults"]) for struck in _STRUCK)
    print(f"{faults} kinds of faults; see {RESULTS.relative_to(ROOT)}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
