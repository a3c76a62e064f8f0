"""The firmware on emulated boards: runs that take longer than a test may take.

Two parts, in virtual time; each board's crystal error is drawn uniformly from -50 to +50 ppm:

*rates*      Runs at 50 to 800 Hz over a good link: overruns, the difference between the boards'
             start instants, and the error of the merged recording's time difference between the
             two boards.
*transfers*  Complete runs (synchronised in turn by six steps, by the short form and by radio) whose
             blocks are fetched over a bad link: the radio loses one packet in five and the modem
             inverts one bit in a thousand.  `bayes_asv.acquire` fetches and merges them; each
             reading of its recordings is compared with the count that the converter gave.

``python -m benchmarks.logger`` writes ``benchmarks/results/logger.json``.  It needs what
``firmware/emulator`` needs, and some 20 minutes on two cores.
"""

from __future__ import annotations

import argparse
import hashlib
import json
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
from benchmarks.provenance import current_commit
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


def draw_crystal_errors(rng: np.random.Generator) -> tuple[float, float, float]:
    """Crystal errors of the three boards in ppm."""
    one, two, three = (float(x) for x in rng.uniform(-LARGEST_PPM, LARGEST_PPM, 3).round(1))
    return one, two, three


def compare_with_truth(
    emulated: Emulated, recording: Recording, start_time: float, ppm: float
) -> Row:
    """Compare a recording's readings and times with those of the emulated converters.

    The times are those that an estimate uses (`sample_times`). Only their difference between the
    boards is compared, so that a constant common to both, such as the interrupt's latency, cancels.
    A missing reading does not count as wrong.

    Parameters
    ----------
    start_time : float
        Virtual time before the run, s.
    ppm : float
        True crystal error of Slave 1, whose clock gives the recording's times.
    """
    truths = [rows_of(emulated, name, READINGS, start_time) for name in ("slave_1", "slave_2")]
    if any(truth.time.shape != (ROWS, 2) for truth in truths):
        return {"readings_wrong": 4 * ROWS}
    counts = np.concatenate([truth.count.T for truth in truths])
    instants = np.concatenate([truth.time.T for truth in truths])
    rate = declared_rate(recording)
    assert rate is not None
    rows = np.round(recording.time * rate).astype(int) + int(recording.get("first row") or 1) - 1
    values = recording.values
    wrong = int((np.abs(values - counts[:, rows]) > 0.5).sum())  # NaN compares false
    error = sample_times(recording, VEHICLE) / (1 + ppm * 1e-6) - instants[:, rows]
    difference = error[2:] - error[:2]
    start = truths[1].time[0] - truths[0].time[0]
    return {
        "readings_wrong": wrong,
        "readings_missing": 4 * ROWS - int(np.isfinite(values).sum()),
        "start_apart_us": round(1e6 * float(np.abs(start).max()), 3),
        "times_apart_us": round(1e6 * float(np.abs(difference).max()), 3),
    }


def run_of(logger: Logger, rate: int, synch: int, ppm: float, number: int) -> Row:
    """Start, fetch and merge run `number` of this logger with the package."""
    emulated = logger.emulated
    start_time = emulated.now
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
        "seconds": round(emulated.now - start_time, 2),
        "frames_spoilt": outcome.corrupted,
        "commands_repeated": outcome.retries,
    }
    if outcome.recording is not None:
        row |= compare_with_truth(emulated, outcome.recording, start_time, ppm)
    row["whole"] = outcome.verdict == "ok" and row["readings_wrong"] == row["readings_missing"] == 0
    # An error that is not reported: a wrong reading, or a gap under the verdict "ok".
    row["silently_wrong"] = bool(
        row.get("readings_wrong") or (outcome.verdict == "ok" and not row["whole"])
    )
    return row


def rates_of(seed: int) -> list[Row]:
    """Take one run at each rate over a good link, synchronised by six steps."""
    ppm = draw_crystal_errors(np.random.default_rng([seed, 1]))
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(seed=seed, ppm=ppm, extra=("log adc",))
        with switched_on(Path(folder), setup) as logger:
            return [
                {"seed": seed, "ppm": ppm[:2], "rate": rate} | run_of(logger, rate, 0, ppm[0], i)
                for i, rate in enumerate(RATES)
            ]


def transfers_of(seed: int, count: int) -> list[Row]:
    """Take `count` runs at 800 Hz and fetch them over the bad link."""
    ppm, rows = draw_crystal_errors(np.random.default_rng([seed, 2])), []
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
    """Summarise the runs for the table of results."""
    summary: Row = {}
    for rate in RATES:
        selected = [row for row in rates if row["rate"] == rate]
        summary[f"{rate} Hz"] = {
            "runs": len(selected),
            "overruns": overruns_of(selected),
            "whole": sum(row["whole"] for row in selected),
            "silently_wrong": sum(row["silently_wrong"] for row in selected),
            **largest_of(selected),
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
        selected = [row for row in transfers if row["synch"] == name]
        summary[name] = {
            "runs": len(selected),
            **largest_of(selected),
        }
    return summary


def overruns_of(rows: Sequence[Row]) -> int:
    """Total overruns of both boards over all runs."""
    return sum(count or 0 for row in rows for count in row["overruns"])


def largest_of(rows: Sequence[Row]) -> Row:
    """Largest difference of the start instants and largest error of the merged time differences."""
    merged = [row for row in rows if "times_apart_us" in row]
    return {
        f"{name}_largest": max((row[name] for row in merged), default=None)
        for name in ("start_apart_us", "times_apart_us")
    }


def firmware_digest() -> str:
    """Short digest of the firmware's sources for which the results hold."""
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
    options = parser.parse_args(arguments)
    reason = why_not()
    if reason is not None:
        print(reason, file=sys.stderr)
        return 2
    build()
    build_firmware()
    started = time.monotonic()
    share = -(-options.transfers // options.parts)
    with ProcessPoolExecutor(options.jobs) as pool:
        transfer_jobs = [
            pool.submit(transfers_of, options.seed + i, min(share, options.transfers - i * share))
            for i in range(options.parts)
            if i * share < options.transfers
        ]
        rate_jobs = [pool.submit(rates_of, options.seed + 1000 + i) for i in range(options.rates)]
        transfers = [row for job in transfer_jobs for row in job.result()]
        rates = [row for job in rate_jobs for row in job.result()]
    summary = summary_of(rates, transfers)
    commit = current_commit()
    about = {
        "commit": commit,
        "version": __version__,
        "firmware": firmware_digest(),
        "seed": options.seed,
        "packet_loss": LOSS,
        "bit_error_rate": ERROR_RATE,
        "minutes": round((time.monotonic() - started) / 60, 1),
    }
    RESULTS.parent.mkdir(exist_ok=True)
    written = {"about": about, "summary": summary, "rates": rates, "transfers": transfers}
    RESULTS.write_text(json.dumps(written, indent=1) + "\n")
    print(json.dumps({"about": about, "summary": summary}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
