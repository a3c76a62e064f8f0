"""The firmware on emulated boards, for longer than a test may take.

Two parts, in virtual time, with crystal errors drawn between -50 and +50 ppm a board:

*rates*      Runs at 50 to 800 Hz over a good link: overruns, the boards' instants at the start, and
             how far the times that the laptop works out for the two boards are wrong against each
             other.
*transfers*  Whole runs (synchronised by six steps, the short form and by radio in turn) and both
             blocks over a bad link: one packet in five between the boards is lost, one bit in a
             thousand between the modems inverted.  What the laptop holds is held against what the
             converters gave, reading by reading.

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
from tests.firmware.emulated import FIRMWARE, build
from tests.firmware.laptop import Block, NoAnswerError
from tests.firmware.logger import Logger, switched_on, why_not
from tests.firmware.scenarios import Setup, build_firmware
from tests.firmware.truth import predicted_times, rows_of

__all__ = ["main", "rates_of", "transfers_of"]

RESULTS = Path(__file__).parent / "results" / "logger.json"
RATES = (50, 100, 200, 400, 800)
SYNCHS = ("six steps", "short", "radio")
LOSS, ERROR_RATE = 0.2, 1e-3
LARGEST_PPM = 50.0
ROWS = 800

Row = dict[str, Any]


def crystals(rng: np.random.Generator) -> tuple[float, float, float]:
    """Crystal errors of the three boards in ppm."""
    one, two, three = (float(x) for x in rng.uniform(-LARGEST_PPM, LARGEST_PPM, 3).round(1))
    return one, two, three


def held_against_truth(
    logger: Logger, blocks: tuple[Block, Block], since: float, ppm: float
) -> Row:
    """Count the readings that differ, and measure how the two boards' times agree with the truth.

    Times are compared between the boards: a constant that both share, such as the interrupt's
    latency, is left out.
    """
    truths = [
        rows_of(logger.emulated, name, block.head.readings, since)
        for name, block in zip(("slave_1", "slave_2"), blocks, strict=True)
    ]
    if any(truth.time.shape != (ROWS, 2) for truth in truths):
        return {"rows_wrong": 2 * ROWS}
    wrong = sum(
        int((np.abs(block.rows - truth.count) > 0.5).any(axis=1).sum())
        for block, truth in zip(blocks, truths, strict=True)
    )
    predicted = predicted_times(*blocks, ppm)
    apart = (predicted[1] - truths[1].time) - (predicted[0] - truths[0].time)
    start = truths[1].time[0] - truths[0].time[0]
    return {
        "rows_wrong": wrong,
        "overruns": [block.head.overruns for block in blocks],
        "start_apart_us": round(1e6 * float(np.abs(start).max()), 3),
        "times_apart_us": round(1e6 * float(np.abs(apart).max()), 3),
    }


def rates_of(seed: int) -> list[Row]:
    """One run at each rate, six steps, good link."""
    rng = np.random.default_rng([seed, 1])
    ppm, rows = crystals(rng), []
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(seed=seed, ppm=ppm, extra=("log adc",))
        with switched_on(Path(folder), setup) as logger:
            for rate in RATES:
                logger.laptop.events.clear()
                since = logger.start(rate)
                logger.finish()
                blocks = logger.transfer()
                head = blocks[0].head
                row = {
                    "seed": seed,
                    "ppm": ppm[:2],
                    "rate": rate,
                    "actual": 4e6 / (head.prescale * head.cycles),
                }
                rows.append(row | held_against_truth(logger, blocks, since, ppm[0]))
    return rows


def transfers_of(seed: int, count: int) -> list[Row]:
    """Hold `count` runs at 800 Hz with their transfers over the bad link."""
    rng = np.random.default_rng([seed, 2])
    ppm, rows = crystals(rng), []
    with tempfile.TemporaryDirectory() as folder:
        setup = Setup(seed=seed, ppm=ppm, loss=LOSS, error_rate=ERROR_RATE, extra=("log adc",))
        with switched_on(Path(folder), setup) as logger:
            for number in range(count):
                rows.append({"seed": seed, "number": number, "ppm": ppm[:2]})
                try:
                    rows[-1] |= transfer_of(logger, number % len(SYNCHS), ppm[0])
                except NoAnswerError as failure:
                    rows[-1] |= {"whole": False, "failure": str(failure)}
                    break
            logger.emulated.statistics()
            air = logger.emulated.totals("air")
            rows[-1]["totals"] = {
                "packets": air["packets"],
                "packets_lost": air["lost"],
                "bytes_spoilt": logger.emulated.totals("modem", name="vehicle")["spoilt"],
                "ram_free": logger.emulated.totals("board", name="slave_1")["ram_free"],
            }
    return rows


def transfer_of(logger: Logger, synch: int, ppm: float) -> Row:
    """One run and its transfer."""
    laptop, emulated = logger.laptop, logger.emulated
    laptop.events.clear()
    spoilt, repeats = laptop.spoilt, laptop.repeats
    since = logger.start(800, synch=synch)
    logger.finish()
    begun = emulated.now
    blocks = logger.transfer(within=400.0)
    took = emulated.now - begun
    row = held_against_truth(logger, blocks, since, ppm)
    return row | {
        "synch": SYNCHS[synch],
        "whole": row["rows_wrong"] == 0,
        "seconds": round(took, 2),
        "frames_spoilt": laptop.spoilt - spoilt,
        "commands_repeated": laptop.repeats - repeats,
    }


def summary_of(rates: Sequence[Row], transfers: Sequence[Row]) -> Row:
    """Figures for the table of results."""
    summary: Row = {}
    for rate in RATES:
        mine = [row for row in rates if row["rate"] == rate]
        summary[f"{rate} Hz"] = {
            "runs": len(mine),
            "actual": mine[0]["actual"],
            "overruns": sum(sum(row["overruns"]) for row in mine),
            "rows_wrong": sum(row["rows_wrong"] for row in mine),
            "start_apart_us_largest": max(row["start_apart_us"] for row in mine),
            "times_apart_us_largest": max(row["times_apart_us"] for row in mine),
        }
    whole = sum(bool(row["whole"]) for row in transfers)
    interval = stats.binomtest(whole, len(transfers)).proportion_ci(method="exact")
    seconds = [row["seconds"] for row in transfers if "seconds" in row]
    summary["transfers"] = {
        "count": len(transfers),
        "whole": whole,
        "whole_95_percent": [round(interval.low, 4), round(interval.high, 4)],
        "overruns": sum(sum(row.get("overruns", ())) for row in transfers),
        "seconds_median": float(np.median(seconds)),
        "seconds_longest": max(seconds),
        "frames_spoilt": sum(row.get("frames_spoilt", 0) for row in transfers),
    }
    for name in SYNCHS:
        mine = [row for row in transfers if row.get("synch") == name]
        summary[name] = {
            "runs": len(mine),
            "start_apart_us_largest": max(row["start_apart_us"] for row in mine),
            "times_apart_us_largest": max(row["times_apart_us"] for row in mine),
        }
    return summary


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
