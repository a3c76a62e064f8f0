"""The reference's chapter 8 on recordings that travel with the package.

The reference's own recordings are not public.  Ours are simulated drives of a car with a worn front
damper over two parking stops at 400 and 800 Hz, whose truth is known (``data/recordings``).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.estimate import Estimate, estimate
from bayes_asv.io import read_recording
from bayes_asv.reference.greybox import PointEstimate, drift, grey_box
from bayes_asv.reference.integrated import REMOVALS, Integrated, integrate
from bayes_asv.shipped import shipped

__all__ = ["RUNS", "Run", "reproduce_runs", "shipped_vehicle"]

RUNS: Final = ("stops-400hz.csv", "stops-800hz.csv")
USUAL: Final = {"stops-400hz.csv": "trend", "stops-800hz.csv": "constant"}
"""What the reference takes off its 400 Hz and its 800 Hz data (section 8.1)."""

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Run:
    """One recording in three ways.

    Parameters
    ----------
    name : str
        Its file.
    recording : Recording
        As read.
    truth : dict of str to float
        True c_f, c_r, i and k_g of the simulated car, SI units.
    integrated : dict of str to Integrated
        States by what was taken off.
    its_way : dict of str to PointEstimate
        The reference's grey box by what was taken off: states, held inputs, at rest at first.
    deflection : PointEstimate
        The same criterion in deflections.
    posterior : Estimate
        What ``bayes-asv estimate`` says.
    """

    name: str
    recording: Recording
    truth: dict[str, float]
    integrated: dict[str, Integrated]
    its_way: dict[str, PointEstimate]
    deflection: PointEstimate
    posterior: Estimate

    @property
    def usual(self) -> str:
        """What the reference takes off such a record."""
        return USUAL[self.name]

    def drifted(self, removal: str) -> tuple[float, float]:
        """Largest deflection that integrating gives, front and rear, m."""
        front, rear = drift(self.integrated[removal])
        return float(front), float(rear)


def shipped_vehicle(name: str) -> Vehicle:
    """Read a vehicle that travels with the package."""
    return read_vehicle(shipped("vehicles", name))


def reproduce_runs(vehicle: Vehicle, seed: int, progress: Progress | None = None) -> list[Run]:
    """Take every shipped run of the stops through all ways.

    Parameters
    ----------
    vehicle : Vehicle
        The Baja car as its team knows it.
    seed : int
        Of the posterior's sampler.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    list of Run
    """
    tell = progress or (lambda share, words: None)
    found = []
    for n, name in enumerate(RUNS):
        tell(n / len(RUNS), f"{name}: grey box")
        recording = read_recording(shipped("recordings", name))
        integrated = {r: integrate(recording, vehicle, r) for r in REMOVALS}
        its_way = {
            r: grey_box(recording, vehicle, coordinates="integrated", initial="zero", removal=r)
            for r in REMOVALS
        }
        deflection = grey_box(recording, vehicle)
        tell((n + 0.5) / len(RUNS), f"{name}: posterior")
        posterior = estimate([recording], vehicle, seed=seed)
        found.append(Run(name, recording, _truth(name), integrated, its_way, deflection, posterior))
    return found


def _truth(name: str) -> dict[str, float]:
    file = shipped("recordings", name.replace(".csv", ".truth.json"))
    truth: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))["parameters"]["SI"]
    return {key: float(truth[key]) for key in ("c_f", "c_r", "i", "k_g")}
