"""The online filter on simulated drives: coverage, consistency, speed, drift, false alarms.

Nine parts, each stored in ``benchmarks/results/online.json``:

*coverage*  Drives of two seconds (bump, stops, rough road, rollers; 400 and 800 Hz; given values
    exact, or with the declared uncertainty): last 95 % intervals, errors, NIS and NEES.
*estimate*  The last interval compared with mode and curvature of the posterior of ``estimate``.
*speed*  Steps per second of both engines, and the replay of a minute at 800 Hz, in CPU time.
*change*  A front damper that loses 30 % in 20 s: the lag of the filter.
*alarms*  Hours of driving, five minutes a car, with a front damper at nominal, and at 5 % and 1 %
    above the share that ``watch`` tests: false alarms per hour, and the delay of a true one.
*white*  Coverage where the sensors' noise is white.
*effects*  Drives with effects, tracked with them: intervals, and the posterior of ``estimate``.
*verdicts*  Verdicts on drives as declared, and on drives that are not.
*failed*  A front damper that loses half or nine tenths of its rate at once.

``python -m benchmarks.online`` runs them all, ``--part NAME`` one; ``--page`` writes
``docs/online.md`` and ``docs/online.png`` from the results.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import platform
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, chi2

from bayes_asv import __version__
from bayes_asv.domain.files import write_atomically
from bayes_asv.simulation import ROADS
from benchmarks.online_effects import (
    EFFECTS,
    failed,
    judged,
    mistaken,
    simulated,
    with_effect,
)
from benchmarks.online_runs import (
    KNOWLEDGE,
    after_crossing,
    compared,
    covered,
    fading,
    nees_band,
    speeds,
    watched,
)
from benchmarks.provenance import current_commit
from tests.rig import SensorSpec

__all__ = ["RESULTS", "main"]

Row = dict[str, Any]

RESULTS = Path(__file__).parent / "results" / "online.json"
TERRAINS = ("bump", "stops", "rough", "rollers")
RATES = (400.0, 800.0)

_BELOW, _SURE = 0.8, 0.99  # defaults of `watch`
_MINUTES = 5.0


def share_interval(hits: int, of: int) -> tuple[float, float]:
    """Jeffreys 95 % interval of a share."""
    low, high = (float(beta.ppf(at, hits + 0.5, of - hits + 0.5)) for at in (0.025, 0.975))
    return low if hits else 0.0, high if hits < of else 1.0


def rate_interval(events: int, hours: float) -> tuple[float, float]:
    """Exact 95 % interval of a Poisson rate, events per hour."""
    low = 0.5 * chi2.ppf(0.025, 2 * events) if events else 0.0
    return float(low) / hours, float(0.5 * chi2.ppf(0.975, 2 * events + 2)) / hours


def coverage(options: argparse.Namespace) -> Row:
    """Track drives of fresh cars to their ends."""
    rows = [
        covered(terrain, rate, knowledge, options.seed + k)
        for knowledge in KNOWLEDGE
        for rate in RATES
        for terrain in TERRAINS
        for k in range(options.runs)
    ]
    parts = {}
    for wanted in itertools.product(KNOWLEDGE, RATES, TERRAINS):
        own = [r for r in rows if (r["knowledge"], r["rate"], r["terrain"]) == wanted]
        parts[f"{wanted[0]}, {wanted[1]:.0f} Hz, {wanted[2]}"] = summary(own)
    exact = [r for r in rows if r["knowledge"] == "exact"]
    return {
        "seed": options.seed,
        "all": summary(rows),
        "exact": summary(exact),
        "parts": parts,
        "rows": rows,
    }


def summary(rows: list[Row]) -> Row:
    """Summarise a set of runs."""
    z = np.array([np.array(r["error"]) / r["sd"] for r in rows])
    errors = 100.0 * np.abs([r["error"] for r in rows])
    inside = np.abs(z) < 1.959964
    nis = [r["nis_band95"][0] <= r["nis"] <= r["nis_band95"][1] for r in rows]
    return {
        "runs": len(rows),
        "coverage": float(inside.mean()),
        "coverage_interval": share_interval(int(inside.sum()), inside.size),
        "median_error_percent": float(np.median(errors)),
        "largest_error_percent": float(np.max(errors)),
        "rms_z": float(np.sqrt(np.mean(z**2))),
        "median_sd_percent": 100.0 * float(np.median([r["sd"] for r in rows])),
        "nis_inside": float(np.mean(nis)),
        "nis_mean": float(np.mean([r["nis"] for r in rows])),
        "nees": float(np.mean([r["nees"] for r in rows])),
        "nees_band95": nees_band(len(rows)),
        "consistent": float(np.mean([r["consistent"] for r in rows])),
        "resets": int(sum(r["resets"] for r in rows)),
    }


def estimate(options: argparse.Namespace) -> Row:
    """Compare the filter's last row with the posterior of the whole recording."""
    rows = [compared(t, options.seed + k) for t in TERRAINS for k in range(options.drives)]
    shifts = np.abs([r["shift"] for r in rows])
    ratios = np.array([r["ratio"] for r in rows])
    return {
        "seed": options.seed,
        "drives": len(rows),
        "shift_median": float(np.median(shifts)),
        "shift_largest": float(np.max(shifts)),
        "ratio_median": float(np.median(ratios)),
        "ratio_least": float(np.min(ratios)),
        "ratio_largest": float(np.max(ratios)),
        "rows": rows,
    }


def speed(options: argparse.Namespace) -> Row:
    """Time both engines."""
    timings = {name: speeds(name) for name in KNOWLEDGE}
    return {"seed": options.seed, "load": os.getloadavg()[0], **timings}


def change(options: argparse.Namespace) -> Row:
    """Track fading dampers, with a random walk and with constant parameters."""
    out: Row = {"seed": options.seed, "loss": 0.3, "seconds": 20.0}
    for name, forget in (("forget 60 s", 60.0), ("constant", None)):
        rows = [fading(options.seed + k, forget) for k in range(options.drives)]
        lags = [r["lag"] for r in rows]
        out[name] = {
            "drives": len(rows),
            "lag_median": float(np.median(lags)),
            "lag_largest": float(np.max(lags)),
            "rms_percent_median": float(np.median([r["rms_percent"] for r in rows])),
            "consistent_share": float(np.mean([r["consistent_share"] for r in rows])),
            "rows": rows,
        }
    return out


def alarms(options: argparse.Namespace) -> Row:
    """Count false alarms over hours, and measure the delay of true ones."""
    out: Row = {"seed": options.seed, "below": _BELOW, "sure": _SURE, "hold": 1.0, "forget": 60.0}
    count = max(round(options.hours * 60.0 / _MINUTES), 1)
    for name, left in (
        ("nominal", 1.0),
        ("5 % above the share", 1.05 * _BELOW),
        ("1 % above the share", 1.01 * _BELOW),
    ):
        rows = []
        for k in range(count):
            rows.append(watched(options.seed + k, _MINUTES, left, _BELOW, _SURE))
            print(name, rows[-1], file=sys.stderr, flush=True)
        hours = float(sum(r["hours"] for r in rows))
        false = sum(r["alarm"] is not None for r in rows)
        out[name] = {
            "hours": hours,
            "alarms": false,
            "an_hour": false / hours,
            "interval95": rate_interval(false, hours),
            "watches": len(rows),
            "told": float(np.mean([r["told"] for r in rows])),
            "largest": max(r["largest"] for r in rows),
            "rows": rows,
        }
    waits = [after_crossing(options.seed + k, _BELOW, _SURE) for k in range(options.drives)]
    out["after crossing"] = {"seconds": waits}
    return out


def white(options: argparse.Namespace) -> Row:
    """Coverage with white noise."""
    sensors = SensorSpec(noise_kind="white")
    rows = [
        covered(terrain, 400.0, "exact", options.seed + k, sensors)
        for terrain in TERRAINS
        for k in range(options.runs)
    ]
    return {"seed": options.seed, "all": summary(rows), "rows": rows}


def effects(options: argparse.Namespace) -> Row:
    """Track drives with effects: 100 of the first, a tenth of the others."""
    parts: Row = {}
    for name in EFFECTS:
        runs = 100 if name == EFFECTS[0] else 12
        rows = [with_effect(name, options.seed + k, compare=k < 2) for k in range(runs)]
        inside = sum(r["inside"] for r in rows)
        close = [r for r in rows if "shift" in r]
        parts[name] = {
            "runs": runs,
            "coverage": inside / runs,
            "coverage_interval": share_interval(inside, runs),
            "rates": float(np.mean(np.abs([r["z"] for r in rows]) < 1.959964)),
            "consistent": float(np.mean([r["consistency"] == "consistent" for r in rows])),
            "without": float(np.mean([r["without"] == "consistent" for r in rows])),
            "compared": len(close),
            "shift": max(abs(r["shift"]) for r in close),
            "ratios": [min(r["ratio"] for r in close), max(r["ratio"] for r in close)],
            "rows": rows,
        }
        print(name, {k: v for k, v in parts[name].items() if k != "rows"}, file=sys.stderr)
    return {"seed": options.seed, "parts": parts}


def verdicts(options: argparse.Namespace) -> Row:
    """Verdicts on drives as declared, and on drives that are not."""
    seeds = [options.seed + k for k in range(max(options.runs // 2, 1))]
    few = seeds[:3]
    filtered, white_ = SensorSpec(), SensorSpec(noise_kind="white")
    cases: dict[str, list[Row]] = {
        "as `simulate` writes them": [
            simulated(road, rate, s) for road in ROADS for rate in (200.0, *RATES) for s in few
        ]
    }
    for words, sensors in (
        ("filtered noise", filtered),
        ("white noise", white_),
        ("filtered noise, no converter", replace(filtered, adc=None)),
        ("white noise, no converter", replace(white_, adc=None)),
    ):
        cases[f"rig, {words}"] = [
            judged(t, rate, sensors, s) for t in TERRAINS for rate in RATES for s in few
        ]
    for fault in (
        "front wheel 20 ms late", "front chassis twice as noisy", "bound_rebound@front",
        "coulomb_friction@front", "progressive_spring@front",
    ):  # fmt: skip
        cases[f"not as declared: {fault}"] = [
            mistaken(TERRAINS[k % 4], fault, s) for k, s in enumerate(seeds)
        ]
    parts = {
        name: {
            "runs": len(rows),
            "consistent": float(np.mean([r["verdict"] == "consistent" for r in rows])),
            "nis": float(np.median([r["nis"] for r in rows])),
            "rows": rows,
        }
        for name, rows in cases.items()
    }
    return {"seed": options.seed, "parts": parts}


def failed_dampers(options: argparse.Namespace) -> Row:
    """Track dampers that fail at once."""
    parts = {}
    for loss in (0.5, 0.9):
        rows = [failed(loss, options.seed + k) for k in range(options.drives)]
        parts[str(loss)] = {
            "runs": len(rows),
            "median": float(np.median([r["followed"] for r in rows])),
            "largest": max(r["followed"] for r in rows),
            "trusted": float(np.mean([r["trusted_while_wrong"] for r in rows])),
            "rows": rows,
        }
    return {"seed": options.seed, "parts": parts}


PARTS: dict[str, Callable[[argparse.Namespace], Row]] = {
    "coverage": coverage,
    "estimate": estimate,
    "speed": speed,
    "change": change,
    "alarms": alarms,
    "white": white,
    "effects": effects,
    "verdicts": verdicts,
    "failed": failed_dampers,
}


def main() -> int:
    """Run the benchmark and store its results; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--runs", type=int, default=13, help="per terrain, rate and knowledge")
    parser.add_argument("--drives", type=int, default=10, help="with a damper that fades")
    parser.add_argument("--hours", type=float, default=3.0, help="per kind of watch")
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--page", action="store_true", help="write the page alone")
    options = parser.parse_args()
    results: Row = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
    if not options.page:
        commit = current_commit()
        for name in options.part or PARTS:
            about = {
                "commit": commit,
                "version": __version__,
                "python": platform.python_version(),
                "numpy": np.__version__,
                "cores": os.cpu_count(),
            }
            results[name] = {"about": about, **PARTS[name](options)}
            write_atomically(RESULTS, (json.dumps(results, indent=1) + "\n").encode())
            brief = {k: v for k, v in results[name].items() if k not in ("rows", "parts")}
            print(
                name, json.dumps(brief, indent=1, default=str)[:3000], file=sys.stderr, flush=True
            )
    if set(PARTS) <= set(results):
        from benchmarks.online_page import write_page

        write_page(results)
    return 0


if __name__ == "__main__":
    sys.exit(main())
