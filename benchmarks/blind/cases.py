"""Cases of the blind simulator, as files that a user would have, with their truth."""

from __future__ import annotations

import csv
from pathlib import Path

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.io import read_recording
from benchmarks.blind.simulator.cases import SEED, make
from benchmarks.blind.simulator.kinds import Drawn, Fault, Run
from tests.battery.truth import TrueEffect, Truth

__all__ = ["Case", "case", "in_turn"]

Case = tuple[list[Recording], list[Recording], Vehicle, Truth]


def case(cell: str, number: int, folder: Path) -> Case:
    """Write the files of a case and read them: recordings, held-out recordings, vehicle, truth.

    Parameters
    ----------
    cell : str
        One of the simulator's cells.
    number : int
        Number of the case.
    folder : Path
        Where the files go; their names do not reveal the case.
    """
    drawn = make(cell, number)
    (folder / "car.toml").write_text(drawn.vehicle_toml, encoding="utf-8")
    fitted, held = (
        [_as_read(run, folder / f"{name}-{k + 1}.csv") for k, run in enumerate(runs)]
        for name, runs in (("run", drawn.runs), ("held-out", drawn.held_out))
    )
    return fitted, held, read_vehicle(folder / "car.toml"), _truth(drawn)


def in_turn(cells: dict[str, int], runs: int | None = None) -> list[tuple[str, int]]:
    """Cells and numbers of cases in the order in which they are done: all cells side by side."""
    waiting = []
    for place, (cell, own) in enumerate(cells.items()):
        count = own if runs is None else min(runs, own)
        waiting += [((k + 0.5) / count, place, cell, k) for k in range(count)]
    return [(cell, k) for _, _, cell, k in sorted(waiting)]


def _as_read(run: Run, path: Path) -> Recording:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time [s]", *(f"{name} [m/s^2]" for name in run.channels)])
        for k, t in enumerate(run.time):
            table.writerow([f"{t:.9g}", *(f"{one[k]:.9g}" for one in run.channels.values())])
    return read_recording(path)


def _truth(drawn: Drawn) -> Truth:
    true = drawn.truth
    meant = {"c_f": true.c_f, "c_r": true.c_r, "i": true.i}
    return Truth(
        name=true.cell,
        seed=SEED,
        number=true.number,
        fleet="test",
        kind=true.cell.partition(":")[0],
        modifier="",
        strength=true.strength,
        effects=tuple(_effect(fault, true.strength) for fault in true.faults),
        car={name: 0.5 * (low + high) for name, (low, high) in meant.items()},
        meant=meant,
        terrain=true.road,
        held_out=true.held_out_road,
        family=true.family,
        noise=true.noise_factor,
        clipped=0,
        lifted=False,
    )


def _effect(fault: Fault, strength: float) -> TrueEffect:
    return TrueEffect(
        name=fault.name,
        where=fault.where or "",
        parameters={},
        size=0.0,
        tolerance=0.0,
        noncentrality=strength,
        held_out=strength,
        spans=dict(fault.parameters),
    )
