"""Diagnosers: from recordings and vehicle to the document of a diagnosis."""

from __future__ import annotations

import importlib
import inspect
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, write_vehicle
from bayes_asv.io import write_recording
from benchmarks.battery.ablations import known, without

__all__ = ["DEFAULT", "Diagnoser", "by_command", "in_process", "resolve"]

DEFAULT = "benchmarks.battery.diagnoser:in_process"


class Diagnoser(Protocol):
    """A diagnosis to judge."""

    def __call__(
        self,
        recordings: Sequence[Recording],
        holdout: Sequence[Recording],
        vehicle: Vehicle,
        seed: int,
    ) -> dict[str, Any]:
        """Return the document ``bayes_asv/diagnose/1``."""
        ...


def resolve(text: str, ablation: str | None = None) -> Diagnoser:
    """Find a diagnoser by ``module:function``.

    Parameters
    ----------
    text : str
        Where it is.
    ablation : str, optional
        What it is to leave out; passed on as the keyword ``ablation``.

    Raises
    ------
    InputError
        When there is no such function, it cannot leave anything out, or there is no such part.
    """
    module, _, name = text.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as exc:
        raise InputError("--diagnoser", f"'{text}' cannot be found", f"write {DEFAULT}") from exc
    if ablation is not None and "ablation" not in inspect.signature(found).parameters:
        raise InputError(
            "--ablation",
            f"'{text}' does not support ablations",
            "name a diagnoser that takes 'ablation'",
        )
    if ablation is not None and found is in_process:
        known(ablation)
    whole: Diagnoser = found if ablation is None else partial(found, ablation=ablation)
    return whole


def in_process(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    vehicle: Vehicle,
    seed: int,
    ablation: str | None = None,
) -> dict[str, Any]:
    """Diagnose as the command does, within this process and without files.

    Parameters
    ----------
    recordings, holdout, vehicle, seed
        As the diagnosis takes them.
    ablation : str, optional
        Part to leave out, of :data:`benchmarks.battery.ablations.ABLATIONS`.
    """
    from bayes_asv.diagnosis.workflow import diagnose
    from bayes_asv.report.documents.diagnose import diagnose_document

    with without(ablation):
        return diagnose_document(diagnose(recordings, holdout, vehicle, seed)).to_dict()


def by_command(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    vehicle: Vehicle,
    seed: int,
) -> dict[str, Any]:
    """Diagnose by the command line: files in a folder, JSON on standard output.

    Raises
    ------
    RuntimeError
        If the command ends with another status than 0, 3 or 4, with its error message.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for recording in (*recordings, *holdout):
            write_recording(recording, folder / recording.source)
        write_vehicle(vehicle, folder / "car.toml")
        words = [sys.executable, "-m", "bayes_asv", "diagnose", *(r.source for r in recordings)]
        for recording in holdout:
            words += ["--holdout", recording.source]
        words += ["--vehicle", "car.toml", "--seed", str(seed), "--json", "-"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3, 4):
        raise RuntimeError(f"status {done.returncode}: {done.stderr.strip()[-500:]}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document
