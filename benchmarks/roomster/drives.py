"""The drives, one by one: what the wheels can explain, and what each drive says of the car."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv.analysis.random_effects import HomogeneityTest, RunLikelihood, homogeneity_test
from bayes_asv.analysis.run_consistency import SingleRunFit, fit_single_run
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.io import read_recording
from bayes_asv.models.cars import car_model
from bayes_asv.posterior.free_simulation import simulate_free
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.data_checks import coherence
from bayes_asv.preprocessing.prepare import prepare
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs

__all__ = [
    "BELOW", "CUT", "HELD_OUT", "WORKED_ON", "at_full_band", "between", "coherence_row", "halves",
    "left_over", "posterior_row", "ratios", "read_all", "run_of", "variants",
]  # fmt: skip

Array = NDArray[np.float64]
Row = dict[str, Any]

WORKED_ON = ("04_1", "06_1", "08_1", "08_2")
HELD_OUT = ("02_1", "10_1", "10_2")  # looked at for prediction alone, once the method stood
BELOW = 4.0
WINDOW = 3.5  # s of a spectrum
EDGES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0)
LAGS = (0.01, 0.02)  # s by which both wheels may have been stamped too early
GAINS = (0.95, 1.05)  # of both wheels
ENDS = 3.0  # s at either end, where the drives have the transients of filters
CUT = "ends cut"


def read_all(folder: Path) -> tuple[dict[str, Recording], Vehicle]:
    """Read every drive and the vehicle file."""
    names = (*WORKED_ON, *HELD_OUT)
    drives = {name: read_recording(folder / f"drive{name}.csv") for name in names}
    return drives, read_vehicle(folder / "roomster.toml")


def run_of(
    recording: Recording, vehicle: Vehicle, seed: int, below: float = BELOW
) -> tuple[PreparedRecording, SingleRunFit]:
    """Lay a drive out below a frequency and ask it alone."""
    recordings, reasons, _ = prepare_runs([recording], vehicle, below)
    if reasons:
        raise SystemExit("\n".join(reasons))
    return recordings[0], fit_single_run(recordings[0], vehicle, seed)


def ratios(run: SingleRunFit) -> Array:
    """c_f/m, c_r/m (1/s), i/m (m²), k_f/m, k_r/m (1/s²) and the weight share: draws (S, 6)."""
    car = run.fit.space.values(run.z)
    over_mass = [car[name] / car["m"] for name in ("c_f", "c_r", "i", "k_f", "k_r")]
    return np.stack([*over_mass, car["wdf"]], axis=1)


def left_over(recording: PreparedRecording, car: Array) -> Array:
    """Root mean square of what a free-running car leaves of each chassis channel, a share (2,)."""
    output = simulate_free(recording, car).output
    out = np.empty(2)
    for axle in range(2):
        use = recording.kind[:, axle] == VALUE
        y = recording.reading[use, axle]
        out[axle] = np.sqrt(np.mean((y - output[use, axle]) ** 2) / np.var(y))
    return out


def posterior_row(recording: PreparedRecording, run: SingleRunFit) -> Row:
    """Tell one drive's posterior and how much its car leaves unexplained."""
    draws = ratios(run)
    names = ("c_f/m", "c_r/m", "i/m", "k_f/m", "k_r/m", "wdf")
    row: Row = {
        name: {"mean": float(x.mean()), "sd": float(x.std()), "eti95": _eti(x)}
        for name, x in zip(names, draws.T, strict=True)
    }
    for name, x in run.fit.space.quantities(run.z, 0).items():
        if name in ("c_f", "c_r", "i"):
            row[name] = {"mean": float(x.mean()), "sd": float(x.std()), "eti95": _eti(x)}
    best = run.fit.space.cars(run.fit.mode.z[None])[0]
    row["nrmse"] = left_over(recording, best).tolist()
    row["share"] = run.fit.shares[0] if run.fit.shares else None
    row["colour_order"] = run.fit.posterior.residual_ars[0].order
    row["effective_draws"] = run.effective
    row["refused"] = list(run.fit.reasons)
    row["seconds"] = float(recording.instants[-1] - recording.instants[0])
    return row


def coherence_row(recording: Recording, vehicle: Vehicle, car: Array) -> Row:
    """Share of the chassis' power that both wheels, and one half car, leave over by frequency."""
    line = prepare(recording, vehicle, car_model("half", vehicle))
    seen = coherence(line, WINDOW)
    if seen is None:
        raise SystemExit(f"{line.source} is too short for a spectrum")
    bands = list(pairwise(EDGES))
    return {
        "windows": seen.windows,
        "bands": [list(band) for band in bands],
        "left_by_any": [(1.0 - seen.explained(*band)).tolist() for band in bands],
        "left_by_half_car": [x.tolist() for x in _left_by_car(line, car, bands)],
        "explained_below": {
            f"{top:g}": seen.explained(EDGES[0], top).tolist() for top in (3.0, 4.0, 6.0, 8.0)
        },
    }


def _left_by_car(
    recording: PreparedRecording, car: Array, bands: Sequence[tuple[float, float]]
) -> list[Array]:
    """Shares (2,) of the power in each band that a free-running car leaves over."""
    from scipy.signal import welch

    output = simulate_free(recording, car).output
    shares = []
    for axle in range(2):
        use = recording.kind[:, axle] == VALUE
        y = recording.reading[use, axle]
        rate = 1.0 / recording.reading_step
        f, whole = welch(y, rate, nperseg=int(WINDOW * rate))
        _, left = welch(y - output[use, axle], rate, nperseg=int(WINDOW * rate))
        inside = [(f > low) & (f <= high) for low, high in bands]
        shares.append([left[k].sum() / whole[k].sum() for k in inside])
    return list(np.array(shares).T)


def at_full_band(recording: Recording, vehicle: Vehicle) -> Row:
    """Tell what the estimator says of a drive when no band is given."""
    lines, reasons, _ = prepare_runs([recording], vehicle)
    fit = best_fit(lines, vehicle)
    car = {name: float(x[0]) for name, x in fit.space.values(fit.mode.z[None]).items()}
    return {
        "reasons": [*reasons, *fit.reasons],
        "mode": {f"{name}/m": car[name] / car["m"] for name in ("c_f", "c_r", "i")},
        "converged": fit.mode.converged,
    }


def between(runs: Sequence[SingleRunFit], counted: bool) -> HomogeneityTest:
    """Test whether runs share c_f, c_r and i, given values shared.

    Parameters
    ----------
    runs : sequence of SingleRunFit
        Drives.
    counted : bool
        Whether readings count for the share that the parts of each drive say, or all of them.
    """
    scale = [1.0 if counted else 1.0 / (run.fit.shares[0] or 1.0) for run in runs]
    placed_effects = [_scaled(run.likelihood, by) for run, by in zip(runs, scale, strict=True)]
    return homogeneity_test(placed_effects, _way(runs[0]))


def halves(recording: Recording, vehicle: Vehicle, share: float, seed: int) -> Row:
    """Hold the halves of a drive against each other, with and without the drive's share."""
    middle = 0.5 * (recording.time[0] + recording.time[-1])
    runs = [
        run_of(_part(recording, rows), vehicle, seed)[1]
        for rows in (recording.time < middle, recording.time >= middle)
    ]
    placed_effects = [run.likelihood for run in runs]
    plain = homogeneity_test(placed_effects, _way(runs[0]))
    counted = homogeneity_test([_scaled(placed, share) for placed in placed_effects], _way(runs[0]))
    return {"q": plain.q, "q_counted": counted.q, "freedom": plain.freedom}


def variants(
    recording: Recording, vehicle: Vehicle, seed: int
) -> tuple[Row, dict[str, SingleRunFit]]:
    """Ask a drive again: wheels stamped later, read larger or smaller, or without its ends."""
    changed = {"as given": recording}
    for lag in LAGS:
        stamps = tuple((f"delay {wheel}", f"{lag} s") for wheel in ("front_wheel", "rear_wheel"))
        changed[f"{1e3 * lag:g} ms"] = replace(recording, metadata=recording.metadata + stamps)
    for gain in GAINS:
        values = recording.values.copy()
        values[[0, 2]] *= gain
        changed[f"gain {gain:g}"] = replace(recording, values=values)
    start, end = recording.time[[0, -1]]
    inside = (recording.time >= start + ENDS) & (recording.time <= end - ENDS)
    changed[CUT] = _part(recording, inside)
    row, runs = {}, {}
    for name, one in changed.items():
        line, run = run_of(one, vehicle, seed)
        best = run.fit.space.cars(run.fit.mode.z[None])[0]
        c_f, c_r, inertia = ratios(run).mean(axis=0)[:3]
        runs[name] = run
        row[name] = {
            "nrmse": left_over(line, best).tolist(),
            "c_f/m": float(c_f), "c_r/m": float(c_r), "i/m": float(inertia),
        }  # fmt: skip
    return row, runs


def _way(run: SingleRunFit) -> Array:
    """Directions of c_f, c_r and i in the coordinates of the car."""
    where = run.fit.space
    n = where.car_dimension
    return np.stack([where.from_logs({name: 1.0})[:n] for name in ("c_f", "c_r", "i")], axis=1)


def _scaled(placed: RunLikelihood, by: float) -> RunLikelihood:
    return RunLikelihood(by * placed.precision, by * placed.linear)


def _part(recording: Recording, rows: NDArray[np.bool_]) -> Recording:
    return replace(recording, time=recording.time[rows], values=recording.values[:, rows])


def _eti(x: Array) -> list[float]:
    return [float(v) for v in np.quantile(x, [0.025, 0.975])]
