"""The firmware on emulated boards, for longer than a test may take.

Two parts, in virtual time, with crystal errors drawn between -50 and +50 ppm a board:

*rates*      Runs at 50 to 800 Hz over a good link: overruns, the boards' instants at the start, and
             how far the times that the laptop works out for the two boards are wrong against each
             other.
*transfers*  Whole runs (synchronised by six steps, the short form and by radio in turn) and both
             blocks over a bad link: one packet in five between the boards is lost, one bit in a
             thousand between the modems inverted.  The laptop is `bayes_asv.acquire`; its
             recordings are held against what the converters gave, reading by reading.

``python -m benchmarks.logger`` writes ``benchmarks/results/logger.json``.  It needs what
``firmware/emulator`` needs, and some 20 minutes of two cores.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from bayes_asv import __version__
from bayes_asv.acquire.acquisition import acquire
from bayes_asv.acquire.messages import Settings
from bayes_asv.acquire.transfer import RunRequest
from bayes_asv.domain.recording import Recording, declared_rate, sample_times
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.shipped import shipped
from tests.firmware.emulated import FIRMWARE, Emulated, VirtualPort, build
from tests.firmware.logger import Logger, switched_on, why_not
from tests.firmware.scenarios import Setup, build_firmware
from tests.firmware.truth import rows_of

__all__ = ["main", "rates_of", "transfers_of"]

RESULTS = Path(__file__).parent / "results" / "logger.json"
RATES = (50, 100, 200, 400, 800)
SYNCHS = ("six steps", "short", "radio")
LOSS, ERROR_RATE = 0.2, 1e-3
LARGEST_PPM = 50.0
ROWS, READINGS = 800, 4
PATIENCE = 200.0  # virtual seconds without an answer
VEHICLE = read_vehicle(shipped("vehicles", "baja2008.toml"))

Row = dict[str, Any]


def crystals(rng: np.random.Generator) -> tuple[float, float, float]:
    """Crystal errors of the three boards in ppm."""
    one, two, three = (float(x) for x in rng.uniform(-LARGEST_PPM, LARGEST_PPM, 3).round(1))
    return one, two, three


def held_against_truth(emulated: Emulated, recording: Recording, since: float, ppm: float) -> Row:
    """Count the readings that differ, and measure how the two boards' times agree with the truth.

    Times are those that an estimate would use (`sample_offsets`), and compared between the boards:
    a constant that both share, such as the interrupt's latency, is left out. A missing cell is not
    wrong.

    Parameters
    ----------
    since : float
        Virtual time before the run, s.
    ppm : float
        True crystal error of Slave 1, whose seconds the recording's are.
    """
    truths = [rows_of(emulated, name, READINGS, since) for name in ("slave_1", "slave_2")]
    if any(truth.time.shape != (ROWS, 2) for truth in truths):
        return {"readings_wrong": 4 * ROWS}
    counts = np.concatenate([truth.count.T for truth in truths])
    instants = np.concatenate([truth.time.T for truth in truths])
    rate = declared_rate(recording)
    assert rate is not None
    rows = np.round(recording.time * rate).astype(int) + int(recording.get("first row") or 1) - 1
    got = recording.values
    wrong = int((np.abs(got - counts[:, rows]) > 0.5).sum())  # NaN compares false
    said = sample_times(recording, VEHICLE) / (1 + ppm * 1e-6) - instants[:, rows]
    apart = said[2:] - said[:2]
    start = truths[1].time[0] - truths[0].time[0]
    return {
        "readings_wrong": wrong,
        "readings_missing": 4 * ROWS - int(np.isfinite(got).sum()),
        "start_apart_us": round(1e6 * float(np.abs(start).max()), 3),
        "times_apart_us": round(1e6 * float(np.abs(apart).max()), 3),
    }


def run_of(logger: Logger, rate: int, synch: int, ppm: float, number: int) -> Row:
    """One run, the `number`th of this logger, started, fetched and merged by the package."""
    emulated = logger.emulated
    since = emulated.now
    outcome = acquire(
        VirtualPort(emulated),
        RunRequest(Settings(rate=rate, synch=synch), start=True),
        patience=PATIENCE,
        seq=37 * number % 256,
    )
    row: Row = {
        "synch": SYNCHS[synch],
        "verdict": outcome.verdict,
        "reasons": list(outcome.reasons),
        "overruns": [block["overruns"] for block in outcome.blocks],
        "seconds": round(emulated.now - since, 2),
        "frames_spoilt": outcome.corrupted,
        "commands_repeated": outcome.retries,
    }
    if outcome.recording is not None:
        row |= held_against_truth(emulated, outcome.recording, since, ppm)
    row["whole"] = outcome.verdict == "ok" and row["readings_wrong"] == row["readings_missing"] == 0
    # Wrong and not told: a reading that differs, or a gap under the verdict "ok".
    row["silently_wrong"] = bool(
        row.get("readings_wrong") or (outcome.verdict == "ok" and not row["whole"])
    )
    return row


def rates_of(seed: int) -> list[Row]:
    """One run at each rate, six steps, good link."""
    ppm = crystals(np.random.default_rng([seed, 1]))
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(seed=seed, ppm=ppm, extra=("log adc",))
        with switched_on(Path(folder), setup) as logger:
            return [
                {"seed": seed, "ppm": ppm[:2], "rate": rate} | run_of(logger, rate, 0, ppm[0], i)
                for i, rate in enumerate(RATES)
            ]


def transfers_of(seed: int, count: int) -> list[Row]:
    """Hold `count` runs at 800 Hz with their transfers over the bad link."""
    ppm, rows = crystals(np.random.default_rng([seed, 2])), []
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(seed=seed, ppm=ppm, loss=LOSS, error_rate=ERROR_RATE, extra=("log adc",))
        with switched_on(Path(folder), setup) as logger:
            for number in range(count):
                rows.append({"seed": seed, "number": number, "ppm": ppm[:2]})
                rows[-1] |= run_of(logger, 800, number % len(SYNCHS), ppm[0], number)
            logger.emulated.statistics()
            air = logger.emulated.totals("air")
            rows[-1]["totals"] = {
                "packets": air["packets"],
                "packets_lost": air["lost"],
                "bytes_spoilt": logger.emulated.totals("modem", name="vehicle")["spoilt"],
                "ram_free": logger.emulated.totals("board", name="slave_1")["ram_free"],
            }
    return rows


def summary_of(rates: Sequence[Row], transfers: Sequence[Row]) -> Row:
    """Figures for the table of results."""
    summary: Row = {}
    for rate in RATES:
        mine = [row for row in rates if row["rate"] == rate]
        summary[f"{rate} Hz"] = {
            "runs": len(mine),
            "overruns": overruns_of(mine),
            "whole": sum(row["whole"] for row in mine),
            "silently_wrong": sum(row["silently_wrong"] for row in mine),
            **largest_of(mine),
        }
    whole = sum(row["whole"] for row in transfers)
    interval = stats.binomtest(whole, len(transfers)).proportion_ci(method="exact")
    seconds = [row["seconds"] for row in transfers if row["whole"]]
    summary["transfers"] = {
        "count": len(transfers),
        "whole": whole,
        "told_incomplete": sum(row["verdict"] != "ok" for row in transfers),
        "silently_wrong": sum(row["silently_wrong"] for row in transfers),
        "whole_95_percent": [round(interval.low, 4), round(interval.high, 4)],
        "overruns": overruns_of(transfers),
        "seconds_median": float(np.median(seconds)),
        "seconds_longest": max(seconds),
        "frames_spoilt": sum(row["frames_spoilt"] for row in transfers),
    }
    for name in SYNCHS:
        mine = [row for row in transfers if row["synch"] == name]
        summary[name] = {
            "runs": len(mine),
            **largest_of(mine),
        }
    return summary


def overruns_of(rows: Sequence[Row]) -> int:
    """Overruns of both boards in all runs."""
    return sum(count or 0 for row in rows for count in row["overruns"])


def largest_of(rows: Sequence[Row]) -> Row:
    """How far apart the boards were, and how far wrong the merged times are, at most."""
    told = [row for row in rows if "times_apart_us" in row]
    return {
        f"{name}_largest": max((row[name] for row in told), default=None)
        for name in ("start_apart_us", "times_apart_us")
    }


def firmware_digest() -> str:
    """Short digest of the firmware's sources, which the results belong to."""
    digest = hashlib.sha256()
    for path in sorted((FIRMWARE / "src").rglob("*")):
        if path.suffix in {".cpp", ".h"}:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both parts and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=41)
    parser.add_argument("--transfers", type=int, default=200)
    parser.add_argument("--parts", type=int, default=10, help="processes that share the transfers")
    parser.add_argument("--rates", type=int, default=4, help="runs at each rate")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    reason = why_not()
    if reason is not None:
        print(reason, file=sys.stderr)
        return 2
    build()
    build_firmware()
    begun = time.monotonic()
    each = -(-given.transfers // given.parts)
    with ProcessPoolExecutor(given.jobs) as pool:
        parts = [
            pool.submit(transfers_of, given.seed + i, min(each, given.transfers - i * each))
            for i in range(given.parts)
            if i * each < given.transfers
        ]
        drives = [pool.submit(rates_of, given.seed + 1000 + i) for i in range(given.rates)]
        transfers = [row for job in parts for row in job.result()]
        rates = [row for job in drives for row in job.result()]
    summary = summary_of(rates, transfers)
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()
    about = {
        "commit": commit,
        "version": __version__,
        "firmware": firmware_digest(),
        "seed": given.seed,
        "packet_loss": LOSS,
        "bit_error_rate": ERROR_RATE,
        "minutes": round((time.monotonic() - begun) / 60, 1),
    }
    RESULTS.parent.mkdir(exist_ok=True)
    written = {"about": about, "summary": summary, "rates": rates, "transfers": transfers}
    RESULTS.write_text(json.dumps(written, indent=1) + "\n")
    print(json.dumps({"about": about, "summary": summary}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
