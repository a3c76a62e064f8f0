"""Diagnosers that know nothing, for what is around the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from tests.battery.effects import EFFECTS

__all__ = ["agrees", "breaks", "dice", "is_no_number"]


def agrees(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int,
    ablation: str = "",
) -> dict[str, Any]:  # fmt: skip
    """Say that all is well, and what was left out."""
    return {"schema": "bayes_asv/diagnose/1", "verdict": "agreement", "effects": [],
            "unexplained": {"present": False, "score": 0.0}, "reasons": [ablation],
            "curves": list(range(9))}  # fmt: skip


def dice(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Name anything with any probability; the seed decides."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(EFFECTS)))
    effect = {"name": name, "where": "front", "probability": float(rng.random()),
              "indistinguishable_from": []}  # fmt: skip
    return agrees(recordings, holdout, vehicle, seed) | {"verdict": "named", "effects": [effect]}


def breaks(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Break down."""
    raise ZeroDivisionError("of a determinant")


def is_no_number(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Return what no JSON can hold."""
    return agrees(recordings, holdout, vehicle, seed) | {
        "gap": {"holdout": {"before": float("nan")}}
    }
