"""Diagnose one blind case.

A module of its own: a process that is started for some cases imports the function by its name, and
cannot import the command.
"""

from __future__ import annotations

import json
import tempfile
import time
import zlib
from dataclasses import asdict
from pathlib import Path

from bayes_asv.diagnosis.workflow import diagnose
from bayes_asv.report.documents.diagnose import diagnose_document
from benchmarks.battery.run import Result, kept
from benchmarks.blind.cases import case
from benchmarks.calibration.store import About

__all__ = ["diagnosed"]


def diagnosed(told: About, key: tuple[str, int]) -> Result:
    """Diagnose one case; an exception is a result as well."""
    begun = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    with tempfile.TemporaryDirectory() as folder:
        recordings, holdout, vehicle, truth = case(*key, Path(folder))
        start = time.perf_counter()
        try:
            seed = zlib.crc32(json.dumps(key).encode())
            found = diagnose(recordings, holdout, vehicle, seed)
            document = kept(diagnose_document(found).to_dict())
        except Exception as exc:  # any exception counts as a result
            document = {"verdict": "error", "reasons": [f"{type(exc).__name__}: {exc}"[:300]]}
    seconds = round(time.perf_counter() - start, 2)
    return Result(*key, "", begun, seconds, {**document, "truth": asdict(truth)}, told)
