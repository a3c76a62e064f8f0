"""The whole reproduction: tables, figures and the document."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from bayes_asv.domain.progress import Progress
from bayes_asv.domain.units import from_si
from bayes_asv.reference.document import reproduction_document
from bayes_asv.reference.experiments import (
    common_sensor_readings,
    engine_readings,
    fit_exact_accelerations,
    fit_exact_states,
    reproduce_runs,
    shipped_vehicle,
    simulate_exact_states,
    table_51_quantities,
)
from bayes_asv.reference.figures import Figure, draw_figures
from bayes_asv.reference.greybox import nominal_car
from bayes_asv.reference.printed import UNITS, car_of_table_41
from bayes_asv.reference.spectral import DAMPINGS, spectral_study
from bayes_asv.reference.tables import table_41, table_42, table_51, table_71

__all__ = ["RECORDS", "Reproduction", "reproduce"]


RECORDS = 50
"""Number of white-noise records of each length and damping."""


@dataclass(frozen=True)
class Reproduction:
    """A document (schema ``bayes_asv/reproduce/1``) and its figures."""

    document: dict[str, Any]
    figures: tuple[Figure, ...]


def reproduce(seed: int = 0, progress: Progress | None = None) -> Reproduction:
    """Reproduce the reference from the data shipped with the package.

    Parameters
    ----------
    seed : int
        Seed of all random numbers.
    progress : callable, optional
        Called with the fraction done and a description.

    Returns
    -------
    Reproduction
    """
    began = time.perf_counter()
    report = progress or (lambda share, words: None)
    report(0.0, "tables 4.1 to 7.1")
    simulated, baja = (shipped_vehicle(n) for n in ("thesis_simulation.toml", "baja2008.toml"))
    reference_method = table_51_quantities(fit_exact_states(simulated, "held"), simulated)
    deflections = table_51_quantities(fit_exact_accelerations(simulated), simulated)
    printed_units = [
        {name: from_si(value, *UNITS[name]) for name, value in quantities.items()}
        for quantities in (reference_method, deflections)
    ]
    tables = (table_41(), table_42(), table_51(*printed_units), table_71())
    studies = []
    for k, damping in enumerate(DAMPINGS):
        report(0.1 + 0.1 * k, f"white noise at {100 * damping:.0f} % damping")
        studies.append(spectral_study(car_of_table_41(), damping, RECORDS, seed))
    runs = reproduce_runs(baja, seed, lambda share, words: report(0.4 + 0.5 * share, words))
    report(0.9, "figures")
    figures = draw_figures(
        studies,
        simulate_exact_states(nominal_car(simulated)),
        common_sensor_readings(baja),
        engine_readings(baja, nominal_car(baja), seed),
        runs,
        baja.travel,
    )
    seconds = time.perf_counter() - began
    report(1.0, "done")
    return Reproduction(reproduction_document(tables, studies, runs, seed, seconds), tuple(figures))
