"""Calibration of the change points of ``bayes-asv fleet`` on seasons of simulated posteriors.

Six drives of the shipped car are estimated; their likelihoods, widened at random, are the
recordings of thousands of seasons with given values in error, scatter from run to run, and in half
of them a change of the front damper.  The whole way from the likelihoods of the recordings to the
probabilities is tested, on two kinds of seasons:

- ``prior``: number, kind and size of changes and the scatter follow the priors of the model;
- ``other``: they do not.  Changes are mostly single, of 3 to 40 %, at any time of the season; the
  scatter is 0.3 to 8 %, with Student-t tails (five degrees of freedom) in half of the seasons.

Counted are the expected calibration error of the probability of a change (ten bins), the share of
seasons without a change whose p-value is below 5 %, and for the changes that are reported how many
are true, and whether the interval of their size contains the true one.

``python -m benchmarks.change_points`` writes ``benchmarks/results/change_points.json`` (five
minutes of one core).
"""

from __future__ import annotations

import argparse
import json
import math
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

import bayes_asv as asv
from bayes_asv.analysis.random_effects import SPREAD_SCALE, RunLikelihood
from bayes_asv.analysis.trends import (
    CHANGE_SD,
    GRADUAL,
    MOST_CHANGES,
    NO_CHANGE,
    Coordinates,
    Trend,
    find_trend,
    values_of_runs,
)
from bayes_asv.domain.files import write_atomically
from bayes_asv.models.cars import car_model
from benchmarks.provenance import current_commit

__all__ = ["Season", "calibration_error", "main", "simulate_season"]

Array = NDArray[np.float64]

RESULTS = Path(__file__).parent / "results" / "change_points.json"
SEASONS = 2000
BINS = 10


@dataclass(frozen=True)
class Season:
    """A season of recordings and what is true of the front damper.

    Parameters
    ----------
    time : (R,) array
        Days.
    runs : list of RunLikelihood
        What each recording says.
    level : (R,) array
        Logarithm of the level.
    kind : str
        ``none``, ``gradual`` or ``sudden``.
    """

    time: Array
    runs: list[RunLikelihood]
    level: Array
    kind: str


def templates() -> tuple[Array, Array]:
    """Precisions (6, n, n) of the likelihoods of six drives, and B (n, 3)."""
    car = asv.read_vehicle(asv.example("baja2008.toml"))
    coordinates = Coordinates(car_model("half", car))
    found = []
    for seed in range(6):
        drive = asv.simulate(car, ("stops", "bump")[seed % 2], seed=seed)
        draws = asv.estimate(drive, car, seed=seed, progress=False).engine.draws
        found.append(coordinates.likelihood({n: x.ravel() for n, x in draws.items()}).precision)
    return np.stack(found), coordinates.directions


def simulate_season(rng: np.random.Generator, precisions: Array, way: Array, kind: str) -> Season:
    """Draw one season of the kind ``prior`` or ``other``."""
    count = round(8.0 * 8.0 ** rng.random())  # 8 to 64 recordings
    days = np.sort(rng.choice(200, size=max(3, count // 4), replace=False))
    time = np.sort(rng.choice(days, size=count) + rng.random(count) / 3.0)
    level, what = _changes(rng, time, kind)
    if kind == "prior":
        scatter = min(SPREAD_SCALE * abs(rng.standard_cauchy()), 1.0)
        noise = rng.standard_normal((count, 3))
    else:
        scatter = 0.003 * (0.08 / 0.003) ** rng.random()
        heavy = rng.random() < 0.5
        noise = rng.standard_t(5, (count, 3)) * math.sqrt(3 / 5) if heavy else (
            rng.standard_normal((count, 3))
        )  # fmt: skip
    theta = rng.standard_normal(len(way))
    widening = 10.0 ** rng.uniform(-3.0, 0.0)  # precision of the season's recordings
    runs = []
    for r in range(count):
        H = precisions[rng.integers(len(precisions))] * widening * 10.0 ** rng.uniform(-0.5, 0.0)
        u = scatter * noise[r]
        u[0] += level[r]
        values, vectors = np.linalg.eigh(H)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        runs.append(RunLikelihood(H, H @ (theta + way @ u) + root @ rng.standard_normal(len(way))))
    return Season(time, runs, level, what)


def _changes(rng: np.random.Generator, time: Array, kind: str) -> tuple[Array, str]:
    """Level (R,) of a season, and what kind of change it has."""
    count = len(time)
    if rng.random() < NO_CHANGE:
        return np.zeros(count), "none"
    if kind == "prior":
        gradual = rng.random() < GRADUAL / (1.0 - NO_CHANGE)
        share = 0.5 ** np.arange(1.0, MOST_CHANGES + 1.0)
        most = count // 2 - 1
        share[most:] = 0.0
        changes = 1 + int(rng.choice(MOST_CHANGES, p=share / share.sum()))
    else:
        gradual = rng.random() < 0.2
        changes = 1 if rng.random() < 0.75 else 2
    if gradual:
        size = CHANGE_SD * rng.standard_normal() if kind == "prior" else _size(rng)
        return size * (time - time[0]) / (time[-1] - time[0]), "gradual"
    while True:
        starts = np.sort(rng.choice(np.arange(2, count - 1), size=changes, replace=False))
        lengths = np.diff([0, *starts, count])
        if lengths.min() >= 2:
            break
    if kind == "prior":
        levels = CHANGE_SD / math.sqrt(2.0) * rng.standard_normal(changes + 1)
    else:
        levels = np.cumsum([0.0, *(_size(rng) for _ in range(changes))])
    return np.repeat(levels, lengths), "sudden"


def _size(rng: np.random.Generator) -> float:
    """Change by 3 to 40 %, up or down."""
    return float(rng.choice([-1.0, 1.0]) * math.log(1.0 + 0.03 * (0.4 / 0.03) ** rng.random()))


def calibration_error(probability: Array, happened: NDArray[np.bool_]) -> float:
    """Return the expected calibration error of probabilities (N,), in ten bins."""
    place = np.minimum((probability * BINS).astype(int), BINS - 1)
    gaps = [
        abs(float(np.sum(probability[place == b]) - np.sum(happened[place == b])))
        for b in range(BINS)
    ]
    return sum(gaps) / len(probability)


def _judge(season: Season, trend: Trend) -> list[dict[str, Any]]:
    """Compare the reported changes with the true level."""
    rows = []
    for change in trend.changes:
        true = season.level[change.last] - season.level[change.first]
        rows.append(
            {
                "probability": change.probability,
                "true": bool(true * math.log(change.ratio) > 0.0),
                "covered": bool(change.low <= math.exp(true) <= change.high),
                "sudden": season.kind == "sudden",
            }
        )
    return rows


def _share(hits: NDArray[np.bool_]) -> dict[str, Any]:
    """Share of hits with its 95 % interval."""
    found = binomtest(int(hits.sum()), len(hits)).proportion_ci(method="exact")
    return {
        "of": len(hits), "share": round(float(hits.mean()), 4),
        "interval95": [round(float(found.low), 4), round(float(found.high), 4)],
    }  # fmt: skip


def _score(kind: str, seasons: int, seed: int, precisions: Array, way: Array) -> dict[str, Any]:
    probability, p_value, kinds, reported = [], [], [], []
    for number in range(seasons):
        rng = np.random.default_rng([seed, number, kind == "prior"])
        season = simulate_season(rng, precisions, way, kind)
        value, sd, _ = values_of_runs(season.runs, way)
        trend = find_trend(season.time, value[:, 0], sd[:, 0], seed=number)
        assert trend is not None
        probability.append(1.0 - trend.no_change)
        p_value.append(trend.p_value)
        kinds.append(season.kind)
        reported += _judge(season, trend)
    chance, test = np.array(probability), np.array(p_value)
    changed = np.array(kinds) != "none"
    place = np.minimum((chance * BINS).astype(int), BINS - 1)
    sure = np.array([row["probability"] for row in reported])
    true = np.array([row["true"] for row in reported])
    sizes = [row for row in reported if row["sudden"] and row["true"]]
    return {
        "seasons": seasons,
        "expected calibration error": round(calibration_error(chance, changed), 4),
        "false alarms at 5 %": _share(test[~changed] < 0.05),
        "false alarms at 1 %": _share(test[~changed] < 0.01),
        "changes found at 5 %": _share(test[changed] < 0.05),
        "probability of a change above one half where there is none": _share(
            chance[~changed] > 0.5
        ),
        "reported changes": {
            "count": len(reported),
            "mean probability": round(float(sure.mean()), 4),
            "expected calibration error": round(calibration_error(sure, true), 4),
            "true": _share(true),
            "interval of the size contains the true one": _share(
                np.array([row["covered"] for row in sizes])
            ),
        },
        "bins": [
            {
                "seasons": int(np.sum(place == b)),
                "mean probability": round(float(chance[place == b].mean()), 4),
                "share changed": round(float(changed[place == b].mean()), 4),
            }
            for b in range(BINS)
            if np.any(place == b)
        ],
    }


def main() -> None:
    """Simulate, score and write the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seasons", type=int, default=SEASONS)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    precisions, way = templates()
    commit = current_commit()
    document = {
        "about": {
            "commit": commit, "version": asv.__version__,
            "python": platform.python_version(), "numpy": np.__version__, "seed": given.seed,
        },
        **{
            kind: _score(kind, given.seasons, given.seed, precisions, way)
            for kind in ("prior", "other")
        },
    }  # fmt: skip
    text = json.dumps(document, indent=1) + "\n"
    print(text)
    if given.seasons == SEASONS:
        write_atomically(RESULTS, text.encode())


if __name__ == "__main__":
    main()
