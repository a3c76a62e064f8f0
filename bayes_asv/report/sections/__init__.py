"""Sections of a report, one file each, in the order of the page.

Those with a title of their own are the appendix.

To add one, write a file with a ``SECTION`` and list it here; ``docs/extending.md`` has an example.
"""

from __future__ import annotations

from typing import Final

from bayes_asv.report.schema import (
    CompareDocument,
    DiagnoseDocument,
    EstimateDocument,
    FleetDocument,
    TrackDocument,
)
from bayes_asv.report.sections import (
    compare,
    diagnosis,
    effects,
    fleet,
    localization,
    long_logs,
    online_filter,
    parameters,
    predictive_checks,
    prior_sensitivity,
    run_consistency,
    sampling,
    simulation,
    simulation_error,
    transmissibility,
    travel,
    uncertainty_budget,
    undeclared_faults,
    unnamed_causes,
)
from bayes_asv.report.sections.blocks import Section

__all__ = ["COMPARE", "DIAGNOSIS", "ESTIMATE", "FLEET", "TRACK"]

ESTIMATE: Final[tuple[Section[EstimateDocument], ...]] = (
    parameters.SECTION,
    effects.MODEL_SECTION,
    travel.SECTION,
    transmissibility.SECTION,
    long_logs.SECTION,
    parameters.DETAILS_SECTION,
    uncertainty_budget.SECTION,
    undeclared_faults.SECTION,
    prior_sensitivity.SECTION,
    run_consistency.SECTION,
    simulation.SECTION,
    predictive_checks.SECTION,
    sampling.SECTION,
)

DIAGNOSIS: Final[tuple[Section[DiagnoseDocument], ...]] = (
    diagnosis.SECTION,
    effects.SECTION,
    unnamed_causes.SECTION,
    simulation_error.SECTION,
    localization.SECTION,
    diagnosis.FAULTS_SECTION,
)

TRACK: Final[tuple[Section[TrackDocument], ...]] = (
    online_filter.SECTION,
    online_filter.DETAILS_SECTION,
)

FLEET: Final[tuple[Section[FleetDocument], ...]] = (fleet.SECTION, fleet.RECORDINGS_SECTION)

COMPARE: Final[tuple[Section[CompareDocument], ...]] = (compare.SECTION, compare.DETAILS_SECTION)
