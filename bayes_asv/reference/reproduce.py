"""Everything at once: tables, figures, and the document they come from."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bayes_asv.domain.units import from_si
from bayes_asv.reference.bench import engine_idling, one_sensor_everywhere
from bayes_asv.reference.document import reproduction_document
from bayes_asv.reference.greybox import nominal_car
from bayes_asv.reference.pictures import Picture, pictures
from bayes_asv.reference.printed import UNITS, car_of_table_41
from bayes_asv.reference.roundtrip import exact_states, found_of, in_states, round_trip
from bayes_asv.reference.runs import reproduce_runs, shipped_vehicle
from bayes_asv.reference.spectral import DAMPINGS, spectral_study
from bayes_asv.reference.tables import table_41, table_42, table_51, table_71

__all__ = ["RECORDS", "Reproduction", "reproduce"]

Progress = Callable[[float, str], None]

RECORDS = 50
"""White-noise records of each length and damping."""


@dataclass(frozen=True)
class Reproduction:
    """A document (schema ``bayes_asv/reproduce/1``) and its figures."""

    document: dict[str, Any]
    figures: tuple[Picture, ...]


def reproduce(seed: int = 0, progress: Progress | None = None) -> Reproduction:
    """Reproduce the reference from what travels with the package.

    Parameters
    ----------
    seed : int
        Same seed, same answer.
    progress : callable, optional
        Told the share done and a few words.

    Returns
    -------
    Reproduction
    """
    began = time.perf_counter()
    tell = progress or (lambda share, words: None)
    tell(0.0, "tables 4.1 to 7.1")
    simulated, baja = (shipped_vehicle(n) for n in ("thesis_simulation.toml", "baja2008.toml"))
    held = found_of(in_states(simulated, "held"), simulated)
    ours = found_of(round_trip(simulated), simulated)
    printed_units = [
        {name: from_si(value, *UNITS[name]) for name, value in found.items()}
        for found in (held, ours)
    ]
    tables = (table_41(), table_42(), table_51(*printed_units), table_71())
    studies = []
    for k, damping in enumerate(DAMPINGS):
        tell(0.1 + 0.1 * k, f"white noise at {100 * damping:.0f} % damping")
        studies.append(spectral_study(car_of_table_41(), damping, RECORDS, seed))
    runs = reproduce_runs(baja, seed, lambda share, words: tell(0.4 + 0.5 * share, words))
    tell(0.9, "figures")
    figures = pictures(
        studies,
        exact_states(nominal_car(simulated)),
        one_sensor_everywhere(baja),
        engine_idling(baja, nominal_car(baja), seed),
        runs,
        baja.travel,
    )
    seconds = time.perf_counter() - began
    tell(1.0, "done")
    return Reproduction(reproduction_document(tables, studies, runs, seed, seconds), tuple(figures))
