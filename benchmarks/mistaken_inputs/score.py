"""Ask ``estimate`` about every case, and score what it says: ``python -m … .score CASES``.

A mistake counts as named where the doubt, the refusal or the error message has one of the names of
what is mistaken and one of the words by which a right answer is recognised, and as confidently
wrong where nothing is doubted and a damper that was said to be worn is not, or the other way round.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import Queue
from pathlib import Path
from typing import Any

import numpy as np

from bayes_asv.analysis.input_mistakes import check_input
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.estimation import estimate
from bayes_asv.io import read_recording
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.provenance import current_commit

RIGHT = "right input"
"""Key of the cases without a mistake."""
_CERTAIN = 0.95  # probability of a deviation from nominal that a reader takes for a verdict


def ask(folder: Path, name: str, mistaken: bool) -> dict[str, Any]:
    """Say what is doubted or refused in one case.

    Where that is nothing although there is a mistake, the posterior is sampled, to see how sure it
    is of each damper.
    """
    out: dict[str, Any] = {"case": name, "text": "", "doubt": False, "status": "refused"}
    try:
        vehicle = read_vehicle(folder / name / "vehicle.toml")
        paths = sorted((folder / name).glob("*.csv"))
        runs = [read_recording(path) for path in paths]
        even = [at_own_rate(run) for run in runs]
        reasons = tuple(prepare_runs(even, vehicle)[1])
        doubt = check_input(even, vehicle, refused=bool(reasons))
        if mistaken and not reasons and doubt is None:
            answer = estimate(runs, vehicle)
            reasons, doubt = answer.reasons, answer.input_check
            for axle, key in (("front", "c_f"), ("rear", "c_r")):
                if key in answer.draws:
                    draws = answer.draws[key]
                    softer = answer.probability_below_nominal(key)
                    out[axle] = [softer, *np.quantile(draws, [0.025, 0.5, 0.975]).tolist()]
    except InputError as error:
        out["text"] = str(error)
        return out
    out["status"] = "refused" if reasons else "ok"
    out["doubt"] = doubt is not None
    out["text"] = " | ".join([*([doubt.sentence] if doubt else []), *reasons])
    return out


def _named(text: str, recognise: dict[str, Any]) -> bool:
    plain = text.lower().replace("_", " ")
    names = [name.replace("_", " ") for name in recognise["names"]]
    if len(names) > 1 and "all axles" in plain:
        names += [name.partition(" ")[2] for name in names]
    names += ["nominal damping" for name in names if name.endswith("damping")]
    return any(n in plain for n in names) and any(w.lower() in plain for w in recognise["words"])


def _confidently_wrong(said: dict[str, Any], truth: dict[str, Any]) -> bool:
    if said["doubt"] or said["status"] != "ok" or "front" not in said:
        return False
    for axle in ("front", "rear"):
        softer = said[axle][0]
        deviation = truth["dampers"][axle]["deviation"]
        worn = truth["dampers"][axle]["worn"]
        if max(softer, 1.0 - softer) > _CERTAIN and (
            not worn or (softer > 0.5) != (deviation < 0.0)
        ):
            return True
    return False


def _stay_on(free: Queue[int]) -> None:
    """Keep a process on one processor, so that it starts no threads."""
    os.sched_setaffinity(0, {free.get()})


def main() -> None:
    """Run all cases, a process a processor, and print and write what came out."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    whole = json.loads((options.cases / "truth.json").read_text())
    truth = whole["cases"]
    names = list(truth)[:: options.every]
    rows = []
    processors = sorted(os.sched_getaffinity(0))
    free: Queue[int] = Queue()
    for processor in processors:
        free.put(processor)
    with ProcessPoolExecutor(len(processors), initializer=_stay_on, initargs=(free,)) as pool:
        mistaken = [truth[name]["kind"] is not None for name in names]
        for said in pool.map(partial(ask, options.cases), names, mistaken):
            case = truth[said["case"]]
            kind = case["kind"]
            said["kind"], said["details"] = kind, case["details"]
            caught = said["doubt"] or said["status"] != "ok"
            said["named"] = kind is not None and caught and _named(said["text"], case["recognise"])
            said["confident"] = _confidently_wrong(said, case)
            rows.append(said)
            bad = caught if kind is None else not said["named"]
            if bad or (said["confident"] and kind is not None):
                wrong = "CONFIDENT " if said["confident"] else ""
                where = f"{said['case']} {kind} {case['car']} {case['terrain']}"
                print(f"{where} {said['status']} {wrong}{said['text'][:400]}", flush=True)
    kinds = {
        kind: _counts([row for row in rows if (row["kind"] or RIGHT) == kind])
        for kind in sorted({row["kind"] or RIGHT for row in rows})
    }
    for kind, counts in kinds.items():
        print(f"{kind}: {counts}")
    if options.out:
        summary = {
            "commit": current_commit(),
            "seed": whole["seed"],
            "every": options.every,
            "kinds": kinds,
            "mistaken": _counts([row for row in rows if row["kind"] is not None]),
        }
        write_atomically(str(options.out), (json.dumps(summary, indent=1) + "\n").encode())


def _counts(rows: list[dict[str, Any]]) -> dict[str, int]:
    return {
        "cases": len(rows),
        "caught": sum(row["doubt"] or row["status"] != "ok" for row in rows),
        "named": sum(row["named"] for row in rows),
        "confidently_wrong": sum(row["confident"] for row in rows),
    }


if __name__ == "__main__":
    main()
