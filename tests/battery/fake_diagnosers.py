"""Diagnosers that do not diagnose, to test the battery around them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from tests.battery.effects import EFFECTS

__all__ = ["agreement", "not_a_number", "raises", "random_name"]


def agreement(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int,
    ablation: str = "",
) -> dict[str, Any]:  # fmt: skip
    """Report agreement, and the ablation."""
    return {"schema": "bayes_asv/diagnose/1", "verdict": "agreement", "effects": [],
            "unexplained": {"present": False, "score": 0.0}, "reasons": [ablation],
            "curves": list(range(9))}  # fmt: skip


def random_name(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Name a random effect with a random probability."""
    rng = np.random.default_rng(seed)
    name = str(rng.choice(list(EFFECTS)))
    effect = {"name": name, "where": "front", "probability": float(rng.random()),
              "indistinguishable_from": []}  # fmt: skip
    return agreement(recordings, holdout, vehicle, seed) | {"verdict": "named", "effects": [effect]}


def raises(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Raise an exception."""
    raise ZeroDivisionError("of a determinant")


def not_a_number(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle, seed: int
) -> dict[str, Any]:
    """Return a number that JSON cannot hold."""
    return agreement(recordings, holdout, vehicle, seed) | {
        "gap": {"holdout": {"before": float("nan")}}
    }
